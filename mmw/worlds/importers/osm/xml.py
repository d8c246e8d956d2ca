"""An OpenStreetMap extract: ways and areas with their tags, in meters about the middle of the extract."""

import re
import xml.etree.ElementTree as ElementTree
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import shapely

from mmw.core.errors import InputError
from mmw.core.geodesy import world_from_wgs84
from mmw.worlds.importers.osm.bounds import cut, default_frame, outline, read_bounds
from mmw.worlds.importers.osm.feature import Extract, Feature, polygonal
from mmw.worlds.importers.osm.file import read_elements

Placing = Callable[[np.ndarray], np.ndarray]
MAX_EXTENT = 20e3
"""Largest extent of an extract [m]: farther out a plane map is wrong by more than a few centimeters."""


def read_extract(
    path: Path, origin: tuple[float, float] | None, bbox: np.ndarray | None = None, place: Placing | None = None
) -> Extract:
    """Read an extract.

    Args:
        path: The file.
        origin: Latitude and longitude of (0, 0) [deg]; the middle of the extract's `bounds` if None, or of its nodes.
        bbox: South, west, north and east [deg], shape [4], that count instead of the `bounds`.
        place: Map of latitudes and longitudes [deg] to the world [m], shape [N, 2] each; None for the tangent plane at
            the origin.

    Raises:
        InputError: If it is no OSM file, a node has no position on the earth, or the extract is too large.
    """
    root = read_elements(path)
    nodes = [node for node in _present(root, "node") if node.get("lat") is not None]
    if not nodes:
        raise InputError(f"{path}: has no nodes; an extract with nodes and ways is needed; download it again")
    position = np.array([_position(node, path) for node in nodes])
    bounds = read_bounds(root, path) if bbox is None else bbox
    if origin is None:
        box = np.concatenate([position.min(axis=0), position.max(axis=0)]) if bounds is None else bounds
        latitude, longitude = np.round(0.5 * (box[:2] + box[2:]), 6).tolist()
        origin = (latitude, longitude)
    elif not (abs(origin[0]) <= 90 and abs(origin[1]) <= 180):
        raise InputError(
            f"{path}: origin {origin}; latitude -90 to 90 and longitude -180 to 180 are needed; correct it"
        )
    reference = (*origin, 0.0)

    def tangent_plane(degrees: np.ndarray) -> np.ndarray:
        # in the tangent plane, a distance d on the ellipsoid is R sin(d / R): less than 1 mm shorter within 5 km
        return world_from_wgs84(np.pad(degrees, ((0, 0), (0, 1))), reference)[:, :2]

    place = place or tangent_plane
    xy = place(position)
    extract = Extract(path, origin, root=root)
    extract.places = places = {node.get("id", ""): xy[k] for k, node in enumerate(nodes)}
    extract.points = [
        Feature(f"n{node.get('id')}", tags, xy[k : k + 1]) for k, node in enumerate(nodes) if (tags := _tags(node))
    ]
    whole = _add_ways(extract, root, places)
    _add_relations(extract, root, whole)
    _cut_at_bounds(extract, None if bounds is None else outline(bounds, place))
    every = (*extract.points, *extract.ways, *extract.relations)
    for feature in every:
        check_tags(feature, path)
    ends = [f.xy for f in extract.ways if len(f.xy) and f.tags]
    ends += [np.reshape(f.area.bounds, (2, 2)) for f in every if f.area is not None and f.tags]
    size = np.ptp(np.concatenate(ends), axis=0).max() if ends else 0.0
    far = max((float(np.abs(line).max()) for line in ends), default=0.0)
    if size > MAX_EXTENT or far > MAX_EXTENT:
        raise InputError(
            f"{path}: the extract is {size / 1e3:.1f} km wide and reaches {far / 1e3:.1f} km from the origin; "
            f"{MAX_EXTENT / 1e3:.0f} km or less are needed; cut out a smaller area"
        )
    return extract


def _present(root: ElementTree.Element, tag: str) -> Iterator[ElementTree.Element]:
    """Yield the elements that an editor has not deleted.

    Source: OpenStreetMap wiki, JOSM file format: `action`; OSM XML: `visible` of histories.
    """
    return (e for e in root.findall(tag) if e.get("action") != "delete" and e.get("visible") != "false")


def _add_ways(extract: Extract, root: ElementTree.Element, places: dict[str, np.ndarray]) -> dict[str, Feature]:
    """Add the ways, and return those with all of their nodes by id.

    A way that leaves the extract and comes back becomes one feature for each run of nodes.
    """
    whole, incomplete = {}, 0
    for way in _present(root, "way"):
        refs = [nd.get("ref", "") for nd in way.findall("nd")]
        name, tags = f"w{way.get('id')}", _tags(way)
        runs: list[list[str]] = [[]]
        for ref in refs:
            if ref not in places:
                runs.append([])
            elif not runs[-1] or runs[-1][-1] != ref:
                runs[-1].append(ref)
        if len(runs) > 1:
            incomplete += 1
            lines = [np.array([places[ref] for ref in run]) for run in runs if len(run) > 1]
            extract.ways += [Feature(name, tags, line) for line in lines]
            continue
        kept = runs[0]
        line = np.array([places[ref] for ref in kept]).reshape(-1, 2)
        area = polygonal(shapely.Polygon(line)) if len(kept) >= 4 and kept[0] == kept[-1] else None
        whole[way.get("id", "")] = Feature(name, tags, line, area)
    if incomplete:
        extract.notes.append(
            f"{incomplete} ways reach beyond the extract; what lies inside was kept, areas were dropped"
        )
    extract.ways += whole.values()
    return whole


def _cut_at_bounds(extract: Extract, bounds: shapely.Polygon | None) -> None:
    """Cut everything at the bounds of the file; without them, areas at a box around roads and buildings."""
    if bounds is not None and (
        bounds.area < 1.0 or np.ptp(np.reshape(bounds.bounds, (2, 2)), axis=0).max() > MAX_EXTENT
    ):
        extract.notes.append("<bounds> enclose no area, or more than 20 km, and were not used to cut")
        bounds = None
    if bounds is not None:
        extract.points, _, _ = cut(extract.points, bounds)
    frame = bounds if bounds is not None else default_frame([*extract.ways, *extract.relations])
    extract.frame = frame
    if frame is None:
        return
    ways, shortened, outside = cut([way for way in extract.ways if way.tags], frame)
    relations, more, others = cut(extract.relations, frame)
    extract.ways, extract.relations = ways, relations
    if shortened + more + outside + others:
        extract.notes.append(
            f"cut at {'the bounds of the file' if bounds is not None else 'a box around roads and buildings'}: "
            f"{shortened + more} ways and areas, and {outside + others} outside left out; buildings across stay whole"
        )


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
    """Assemble the multipolygons: outer rings less inner rings, each of one or more ways.

    Args:
        extract: Gets the multipolygons.
        root: The file.
        ways: The ways that have all of their nodes by id.
    """
    dropped = 0
    for relation in _present(root, "relation"):
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
        outer, inner = (_enclosed(rings[k]) for k in ("outer", "inner"))
        area = polygonal(shapely.difference(outer, inner))
        if not is_whole or area is None:
            dropped += 1
            continue
        extract.relations.append(Feature(f"r{relation.get('id')}", tags, np.zeros((0, 2)), area))
    if dropped:
        extract.notes.append(f"{dropped} multipolygons reach beyond the extract, or do not close, and were dropped")


def _enclosed(rings: list[shapely.LineString]) -> shapely.Geometry:
    """Return all that lines enclose; they are split where they cross, for polygons of others are not valid."""
    split = shapely.get_parts(shapely.union_all(rings))
    return shapely.union_all(shapely.get_parts(shapely.polygonize(split)))


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


def check_tags(feature: Feature, path: Path) -> None:
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
