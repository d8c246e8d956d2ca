"""An OpenStreetMap extract: ways and areas with their tags, in meters about the middle of the extract."""

import re
import xml.etree.ElementTree as ElementTree
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import shapely

from mmw.core.errors import InputError
from mmw.core.geodesy import world_from_wgs84
from mmw.worlds.importers.xml_nodes import parse_xml

MAX_EXTENT = 20e3
"""Largest extent of an extract [m]: farther out a plane map is wrong by more than a few centimeters."""


@dataclass(frozen=True)
class Feature:
    """A node, way or relation with tags."""

    id: str
    """Kind and number, such as `w123`."""
    tags: dict[str, str]
    xy: np.ndarray
    """Position of a node, line of a way [m], shape [N, 2]; of a relation, no points."""
    area: shapely.Polygon | shapely.MultiPolygon | None = None
    """Area enclosed by a closed way or multipolygon [m]; None for others."""


@dataclass
class Extract:
    """Everything with tags."""

    path: Path
    origin: tuple[float, float]
    """Latitude and longitude of (0, 0) [deg]."""
    points: list[Feature] = field(default_factory=list)
    ways: list[Feature] = field(default_factory=list)
    relations: list[Feature] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def read_extract(path: Path, origin: tuple[float, float] | None) -> Extract:
    """Read an .osm file.

    Args:
        path: The file.
        origin: Latitude and longitude of (0, 0) [deg]; the middle of the extract's `bounds` if None, or of its nodes.

    Raises:
        InputError: If it is no OSM file, a node has no position on the earth, or the extract is too large.
    """
    root = parse_xml(path, "osm", "download the extract again")
    nodes = [node for node in root.findall("node") if node.get("action") != "delete" and node.get("lat") is not None]
    if not nodes:
        raise InputError(f"{path}: has no nodes; an extract with nodes and ways is needed; download it again")
    position = np.array([_position(node, path) for node in nodes])
    low, high = position.min(axis=0), position.max(axis=0)
    if origin is None:
        low, high = _box(root, path) or (low, high)  # openstreetmap.org gives ways as a whole, far beyond the box
        origin = tuple(np.round(0.5 * (low + high), 6).tolist())
    elif not (abs(origin[0]) <= 90 and abs(origin[1]) <= 180):
        raise InputError(
            f"{path}: origin {origin}; latitude -90 to 90 and longitude -180 to 180 are needed; correct it"
        )
    # in the tangent plane, a distance d on the ellipsoid is R sin(d / R): less than 1 mm shorter within 5 km
    xy = world_from_wgs84(np.pad(position, ((0, 0), (0, 1))), (*origin, 0.0))[:, :2]
    extract = Extract(path, origin)
    place = {node.get("id", ""): xy[k] for k, node in enumerate(nodes)}
    extract.points = [
        Feature(f"n{node.get('id')}", tags, xy[k : k + 1]) for k, node in enumerate(nodes) if (tags := _tags(node))
    ]
    ways = {}
    incomplete = 0
    for way in root.findall("way"):
        refs = [nd.get("ref", "") for nd in way.findall("nd")]
        kept = [ref for k, ref in enumerate(refs) if ref in place and (k == 0 or ref != refs[k - 1])]
        is_whole = all(ref in place for ref in refs)
        incomplete += not is_whole
        line = np.array([place[ref] for ref in kept]).reshape(-1, 2)
        area = shapely.Polygon(line) if is_whole and len(kept) >= 4 and kept[0] == kept[-1] else None
        ways[way.get("id", "")] = Feature(f"w{way.get('id')}", _tags(way), line, area)
    if incomplete:
        extract.notes.append(
            f"{incomplete} ways reach beyond the extract; what lies inside was kept, areas were dropped"
        )
    extract.ways = list(ways.values())
    _add_relations(extract, root, ways)
    for feature in (*extract.points, *extract.ways, *extract.relations):
        _check_tags(feature, path)
    used = [f.xy for f in extract.ways if len(f.xy) and f.tags]
    size = np.ptp(np.concatenate(used), axis=0).max() if used else 0.0
    far = max((float(np.abs(line).max()) for line in used), default=0.0)
    if size > MAX_EXTENT or far > MAX_EXTENT:
        raise InputError(
            f"{path}: the extract is {size / 1e3:.1f} km wide and reaches {far / 1e3:.1f} km from the origin; "
            f"{MAX_EXTENT / 1e3:.0f} km or less are needed; cut out a smaller area"
        )
    return extract


def _box(root: ElementTree.Element, path: Path) -> tuple[np.ndarray, np.ndarray] | None:
    """Return the lowest and the highest latitude and longitude that were asked for [deg]; None if not given."""
    box = root.find("bounds")
    if box is None:
        return None
    corners = [box.get(key, "") for key in ("minlat", "minlon", "maxlat", "maxlon")]
    try:
        values = np.array([float(value) for value in corners])
    except ValueError:
        values = np.full(4, np.nan)
    low, high = values[:2], values[2:]
    if not ((np.abs(values) <= [90, 180, 90, 180]).all() and (low <= high).all()):
        raise InputError(f"{path}: <bounds> are {', '.join(corners)}; degrees are needed; correct or remove the line")
    return low, high


def _position(node: ElementTree.Element, path: Path) -> tuple[float, float]:
    try:
        lat, lon = float(node.get("lat", "")), float(node.get("lon", ""))
    except ValueError:
        lat = lon = float("nan")
    if not (abs(lat) <= 90 and abs(lon) <= 180):
        raise InputError(
            f"{path}: node {node.get('id')}: lat {node.get('lat')!r}, lon {node.get('lon')!r}; -90 to 90 and -180 to "
            "180 degrees are needed; download the extract again"
        )
    return lat, lon


def _tags(element: ElementTree.Element) -> dict[str, str]:
    return {tag.get("k", ""): tag.get("v", "") for tag in element.findall("tag")}


def _add_relations(extract: Extract, root: ElementTree.Element, ways: dict[str, Feature]) -> None:
    """Assemble the multipolygons: outer rings less inner rings, each of one or more ways."""
    dropped = 0
    for relation in root.findall("relation"):
        tags = _tags(relation)
        if tags.get("type") != "multipolygon" or len(tags) < 2:
            continue
        rings: dict[str, list[shapely.LineString]] = {"outer": [], "inner": []}
        is_whole = True
        for member in relation.findall("member"):
            way = ways.get(member.get("ref", ""))
            if member.get("type") == "way":
                is_whole &= way is not None and len(way.xy) >= 2
                if way is not None and len(way.xy) >= 2:
                    rings["inner" if member.get("role") == "inner" else "outer"].append(shapely.LineString(way.xy))
        outer, inner = (shapely.union_all(shapely.get_parts(shapely.polygonize(rings[k]))) for k in ("outer", "inner"))
        area = shapely.difference(outer, inner)
        if not is_whole or area.is_empty:
            dropped += 1
            continue
        extract.relations.append(Feature(f"r{relation.get('id')}", tags, np.zeros((0, 2)), area))
    if dropped:
        extract.notes.append(f"{dropped} multipolygons reach beyond the extract and were dropped")


def length_m(text: str | None) -> float | None:
    """Return a length tag in meters; None if there is none or it cannot be read.

    Source: OpenStreetMap wiki, Map features/Units: meters unless a unit follows; feet and inches as 7'4".
    """
    if text is None:
        return None
    text = text.strip().replace(",", ".")
    found = re.fullmatch(r"([-+]?\d+(?:\.\d+)?)\s*(m|km|ft|cm)?", text)
    if found:
        return float(found[1]) * {"m": 1.0, "km": 1000.0, "ft": 0.3048, "cm": 0.01}[found[2] or "m"]
    found = re.fullmatch(r"(\d+(?:\.\d+)?)'\s*(?:(\d+(?:\.\d+)?)\")?", text)
    return None if found is None else float(found[1]) * 0.3048 + float(found[2] or 0) * 0.0254


def _check_tags(feature: Feature, path: Path) -> None:
    """Raise InputError for a tag that no building or street has."""
    for key, (read, low, high) in LIMITS.items():
        text = feature.tags.get(key)
        value = read(text) if text else None
        if value is not None and not low <= value <= high:
            raise InputError(
                f"{path}: {feature.id}: {key} = {(text or '')[:40]!r}; {low:g} to {high:g} is needed; correct the tag"
            )


def number(text: str | None) -> float | None:
    """Return a plain number tag such as building:levels; None if there is none or it cannot be read."""
    if text is None or not re.fullmatch(r"\s*-?\d+([.,]\d+)?\s*", text):
        return None
    return float(text.replace(",", "."))


LIMITS = {
    "height": (length_m, -100.0, 2e3),
    "min_height": (length_m, -100.0, 2e3),
    "roof:height": (length_m, 0.0, 500.0),
    "building:levels": (number, -50.0, 500.0),
    "building:min_level": (number, -50.0, 500.0),
    "roof:levels": (number, 0.0, 100.0),
    "width": (length_m, 0.0, 500.0),
    "lanes": (number, 0.0, 100.0),
}
"""Tag -> how it is read, and the least and the greatest value, lengths in meters; design values beyond all that is."""
