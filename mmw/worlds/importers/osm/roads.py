"""The roads of an OpenStreetMap extract as an extract of their own, cut at its bounds: what netconvert reads."""

import xml.etree.ElementTree as ElementTree

import numpy as np
import shapely

from mmw.worlds.importers.osm.feature import Extract
from mmw.worlds.importers.osm.ground import WIDTH
from mmw.worlds.importers.osm.xml import number
from mmw.worlds.importers.sumo.netconvert import plane_degrees

NO_LANES = {
    "highway": ("track", "bus_guideway", "raceway", "busway"),
    "service": ("parking_aisle", "driveway", "drive-through", "emergency_access"),
    "area": ("yes",),
    "access": ("no", "private"),
    "motor_vehicle": ("no",),
}
"""Tags of roads that get no lanes: they are drawn as surfaces."""
WALKED = (
    "residential", "living_street", "unclassified", "tertiary", "secondary", "primary", "tertiary_link",
    "secondary_link", "primary_link",
)  # fmt: skip
"""Classes of roads that have sidewalks on both sides where no tag says otherwise; design value."""
SIDEWALK_TAGS = ("sidewalk", "sidewalk:both", "sidewalk:left", "sidewalk:right", "foot", "motorroad")
KEPT = (
    "highway", "lanes", "oneway", "maxspeed", "width", "junction", "turn", "sidewalk", "name", "layer", "bridge",
    "access", "service", "bus", "cycleway", "crossing", "traffic_signals", "surface", "change", "priority", "stop",
    "give_way", "direction", "except", "type", "restriction", "segregated", "driving_side", "tracktype",
)  # fmt: skip
"""First words of the keys that netconvert may use; others could only be misread."""


def has_lanes(tags: dict[str, str]) -> bool:
    """Return whether the tags of a way say that cars drive on it, in the plane of the ground."""
    if tags.get("highway") not in WIDTH or any(tags.get(key) in values for key, values in NO_LANES.items()):
        return False
    return tags.get("tunnel", "no") in ("no", "building_passage") and tags.get("indoor", "no") == "no"


def road_elements(extract: Extract) -> tuple[ElementTree.Element, list[str]]:
    """Return the roads inside the frame of an extract, with nodes and turn restrictions, as OSM XML; notes for people.

    The world is flat, so of two roads that cross on different levels the one farther from the ground is left out.
    Ids of editors, which count down, become numbers above all others: to netconvert a minus sign is the way back.
    """
    root = extract.root
    nodes = {node.get("id", ""): node for node in root.findall("node")}
    ids = _Numbers(extract)
    made = ElementTree.Element("osm", {"version": "0.6"})
    ways, used, pieces_of = [], {}, {}
    driven = [(way, tags) for way in root.findall("way") if has_lanes(tags := tags_of(way)) and is_present(way)]
    above = _on_other_levels(driven, extract)
    notes = []
    if above:
        named = ", ".join(sorted(above)[:4]) + (", ..." if len(above) > 4 else "")
        notes.append(f"{len(above)} roads that cross others on a bridge have no lanes: the world is flat ({named})")
    for way, tags in driven:
        if way.get("id", "") in above:
            continue
        if tags["highway"] in WALKED and not any(key in tags for key in SIDEWALK_TAGS):
            tags["sidewalk"] = "both"
        refs = [nd.get("ref", "") for nd in way.findall("nd")]
        pieces = _inside(refs, extract, ids)
        for k, piece in enumerate(pieces):
            key = ids.of(way.get("id", ""), "way") if not k else ids.new()
            element = ElementTree.Element("way", {"id": key, "version": "1"})
            for ref, xy in piece:
                used[ref] = xy
                ElementTree.SubElement(element, "nd", {"ref": ids.of(ref, "node")})
            _add_tags(element, tags)
            ways.append(element)
            pieces_of.setdefault(way.get("id", ""), key)
    for ref, xy in used.items():
        lat, lon = plane_degrees(xy)
        node = ElementTree.SubElement(made, "node", {"id": ids.of(ref, "node"), "version": "1"})
        node.attrib |= {"lat": f"{lat:.10f}", "lon": f"{lon:.10f}"}
        if ref in nodes:
            _add_tags(node, tags_of(nodes[ref]))
    made.extend(ways)
    for relation in root.findall("relation"):
        tags = tags_of(relation)
        members = relation.findall("member")
        kinds = {"way": pieces_of, "node": used}
        if tags.get("type") != "restriction" or not is_present(relation):
            continue
        if any(m.get("ref") not in kinds.get(m.get("type", ""), ()) for m in members):
            continue
        element = ElementTree.SubElement(made, "relation", {"id": ids.of(relation.get("id", ""), "relation")})
        for member in members:
            kind, ref = member.get("type", ""), member.get("ref", "")
            key = pieces_of[ref] if kind == "way" else ids.of(ref, "node")
            ElementTree.SubElement(element, "member", {"type": kind, "ref": key, "role": member.get("role", "")})
        _add_tags(element, tags)
    return made, notes


def tags_of(element: ElementTree.Element) -> dict[str, str]:
    """Return the tags of an element."""
    return {tag.get("k", ""): tag.get("v", "") for tag in element.findall("tag")}


def is_present(element: ElementTree.Element) -> bool:
    """Return whether an editor has not deleted an element."""
    return element.get("action") != "delete" and element.get("visible") != "false"


def _on_other_levels(driven: list[tuple[ElementTree.Element, dict[str, str]]], extract: Extract) -> set[str]:
    """Return the ids of the roads that cross another one on another level, and are farther from the ground."""
    lines, levels, refs, keys = [], [], [], []
    for way, tags in driven:
        own = [ref for nd in way.findall("nd") if (ref := nd.get("ref", "")) in extract.places]
        if len(own) > 1:
            lines.append(shapely.LineString([extract.places[ref] for ref in own]))
            levels.append(number(tags.get("layer")) or float(tags.get("bridge", "no") != "no"))
            refs.append(set(own))
            keys.append(way.get("id", ""))
    if not lines:
        return set()
    found = set()
    first, second = shapely.STRtree(lines).query(lines, predicate="intersects")
    for i, j in zip(first.tolist(), second.tolist(), strict=True):
        if abs(levels[i]) > abs(levels[j]):
            met = shapely.intersection(lines[i], lines[j])
            common = [extract.places[ref] for ref in refs[i] & refs[j]]
            if common:
                met = shapely.difference(met, shapely.multipoints(common).buffer(0.1))
            if not met.is_empty:
                found.add(keys[i])
    return found


class _Numbers:
    """Positive ids: those of the file, and new ones above them."""

    def __init__(self, extract: Extract) -> None:
        every = [element.get("id", "") for element in extract.root]
        self._last = max((int(key) for key in every if key.lstrip("-").isdigit()), default=0)
        self._last = max(self._last, 0)
        self._new: dict[tuple[str, str], str] = {}

    def of(self, key: str, kind: str) -> str:
        """Return the positive id of an element."""
        if key.isdigit() and int(key) > 0:
            return key
        if (kind, key) not in self._new:
            self._new[kind, key] = self.new()
        return self._new[kind, key]

    def new(self) -> str:
        """Return an id that nothing has."""
        self._last += 1
        return str(self._last)


def _add_tags(element: ElementTree.Element, tags: dict[str, str]) -> None:
    for key, value in tags.items():
        if key.split(":")[0] in KEPT:
            ElementTree.SubElement(element, "tag", {"k": key, "v": value})


def _inside(refs: list[str], extract: Extract, ids: _Numbers) -> list[list[tuple[str, np.ndarray]]]:
    """Return the pieces of a way inside the frame: nodes and their places [m], new ones where it is cut."""
    pieces: list[list[tuple[str, np.ndarray]]] = []
    run: list[tuple[str, np.ndarray]] = []

    def close() -> None:
        if len(run) > 1:
            pieces.append(run.copy())
        run.clear()

    before = ""
    for ref in refs:
        if ref not in extract.places:
            close()
            before = ""
            continue
        is_in = _is_inside(extract, ref)
        if before and is_in != _is_inside(extract, before):
            cut = (f"cut {ids.new()}", _crossing(extract, before, ref))
            run.append(cut)
            if not is_in:
                close()
        if is_in and not (run and run[-1][0] == ref):
            run.append((ref, extract.places[ref]))
        before = ref
    close()
    return pieces


def _is_inside(extract: Extract, ref: str) -> bool:
    return extract.frame is None or bool(shapely.intersects_xy(extract.frame, *extract.places[ref]))


def _crossing(extract: Extract, a: str, b: str) -> np.ndarray:
    """Return where the line between two nodes crosses the frame [m], shape [2]."""
    assert extract.frame is not None
    first, last = extract.places[a], extract.places[b]
    met = shapely.get_coordinates(shapely.intersection(shapely.LineString([first, last]), extract.frame.boundary))
    return met[0] if len(met) else first
