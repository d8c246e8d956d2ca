"""Stripes of the crossings that an OpenStreetMap extract marks, besides those that netconvert makes."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
import shapely
import shapely.ops

from mmw.worlds.importers.osm.feature import Extract
from mmw.worlds.importers.osm.ground import LANE, WALK, WIDTH
from mmw.worlds.importers.osm.roads import has_lanes, is_present, tags_of
from mmw.worlds.importers.osm.xml import length_m, number
from mmw.worlds.importers.sumo.network import Network
from mmw.worlds.importers.sumo.plan import ZEBRA
from mmw.worlds.importers.sumo.smooth_line import direction, rounded
from mmw.worlds.towns.plan_geometry import polygons_of

ACROSS = 4.0
"""Width of a crossing [m]. Source: SUMO documentation, netconvert, --default.crossing-width."""
WIDTHS = (2.0, 8.0)
"""Least and largest width that a tag `width` may give [m]; design values."""
ASIDE = 1.5
"""How much farther than half the width of its road a crossing without a way of its own may reach [m]; design value."""
SHORT = 2.0
"""Crossings below this length are left out [m]; design value."""
APART = 8.0
"""Crossings nearer than this that run side by side are one [m]; design value: netconvert moves them to the junction."""
SIMILAR = float(np.cos(np.radians(30.0)))
"""Cosine of the largest angle between directions that count as the same [-]; design value."""
FAR = 15.0
"""Crossings farther from the end of a lane are not those of its junction [m]; design value."""
BEFORE = 1.0
"""Distance of a stop line from a crossing [m]; design value."""
LEFT = 10.0
"""Least length of a lane before its stop line [m]; design value."""
EDGE = 0.05
"""Distance of paint from the edge of the asphalt [m]; design value, as that of other paint."""
UNMARKED = ("no", "unmarked", "informal")
"""Values of `crossing` and `crossing:markings` that say that there is no paint."""


@dataclass(frozen=True)
class Crossing:
    """A crossing of the map."""

    line: shapely.LineString
    """Center line, over the carriageway and beyond [m]."""
    width: float
    """Width [m]."""
    node: shapely.Point | None = None
    """The node that it is made of; None for a way, which may cross several carriageways."""


@dataclass
class _Node:
    """A node `highway=crossing` of a road for cars."""

    tags: dict[str, str]
    xy: np.ndarray
    heading: np.ndarray = field(default_factory=lambda: np.zeros(2))
    """Direction of the road, a unit vector."""
    reach: float = 0.0
    """Half the width of the road [m]."""
    footway: np.ndarray | None = None
    """Direction of a footway through it, a unit vector."""
    is_taken: bool = False
    """Whether a way is the crossing."""


def stripe_crossings(
    extract: Extract, asphalt: shapely.Geometry, made: Sequence[np.ndarray]
) -> tuple[shapely.Geometry, int]:
    """Return the stripes of marked crossings on asphalt [m], and how many crossings they are.

    Args:
        extract: The extract.
        asphalt: Carriageways [m].
        made: Center lines of crossings that are there already [m], each of shape [N, 2].
    """
    there = [shapely.LineString(line) for line in made if len(line) > 1]
    inner = asphalt.buffer(-EDGE, quad_segs=2)
    painted: list[shapely.Geometry] = []
    covered: list[shapely.Geometry] = []
    for crossing in find_crossings(extract):
        for piece in shapely.get_parts(shapely.line_merge(shapely.intersection(crossing.line, asphalt))):
            if piece.geom_type != "LineString" or piece.length < SHORT:
                continue
            if crossing.node is not None and piece.distance(crossing.node) > ASIDE:
                continue
            if any(_is_same(piece, other) for other in there):
                continue
            there.append(piece)
            free = shapely.difference(inner, shapely.union_all(covered))  # two that meet share no stripes
            painted.append(shapely.intersection(_stripes(piece, crossing.width), free))
            covered.append(piece.buffer(0.5 * crossing.width, cap_style="flat"))
    return shapely.MultiPolygon(polygons_of(shapely.union_all(painted), 0.01)), len(painted)


def _stripes(line: shapely.LineString, width: float) -> shapely.Geometry:
    """Return stripes along a line, the same gap at both of its ends."""
    count = int((line.length + ZEBRA) / (2 * ZEBRA))
    first = 0.5 * (line.length - (2 * count - 1) * ZEBRA)
    stripes = [
        shapely.ops.substring(line, start, start + ZEBRA).buffer(0.5 * width, cap_style="flat")
        for start in first + 2 * ZEBRA * np.arange(count)
    ]
    return shapely.union_all(stripes)


def hold_before_crossings(network: Network, extract: Extract, made: Sequence[np.ndarray]) -> dict[str, float]:
    """Return how long before the end of their lanes vehicles stop [m], by the lane's id: before crossings there.

    Only lanes that end at lights or stop signs have a place to stop; netconvert puts it at the border of the junction,
    and before crossings that it makes.

    Args:
        network: The network.
        extract: The extract that it is made of.
        made: As for `stripe_crossings`.
    """
    held: dict[str, float] = {}
    there = [shapely.LineString(line) for line in made if len(line) > 1]
    crossings = [c for c in find_crossings(extract) if not any(_is_same(c.line, other) for other in there)]
    stopping = {c.first for c in network.connections if c.light or c.state in "sw"}
    through = [c for c in network.connections if c.first in stopping]
    stopping -= {c.first for c in through if not c.via}
    for edge in network.roads:
        for lane in edge.lanes:
            if not lane.is_driven or lane.id not in stopping:
                continue
            points = rounded(lane.points)
            line = shapely.LineString([*points, points[-1] + WIDTHS[1] * direction(points, -1)])
            length = line.length - WIDTHS[1]
            tail = shapely.ops.substring(line, max(length - FAR, 0.0), line.length)
            for crossing in crossings:
                met = shapely.intersection(tail, crossing.line)
                if met.geom_type == "Point" and not met.is_empty:
                    rest = length - line.project(met) + 0.5 * crossing.width + BEFORE
                    if 0.0 < rest < length - LEFT:
                        held[lane.id] = max(rest, held.get(lane.id, 0.0))
    return held


def find_crossings(extract: Extract) -> list[Crossing]:
    """Return the crossings with markings: ways `footway=crossing`, and nodes `highway=crossing` that lie on none.

    A way that does not tell its markings has those of its nodes. Crossings of nodes follow a footway through them, else
    they are at right angles to the road.
    """
    nodes = {
        node.get("id", ""): _Node(tags, extract.places[node.get("id", "")])
        for node in extract.root.findall("node")
        if (tags := tags_of(node)).get("highway") == "crossing" and node.get("id") in extract.places
    }
    ways = [(tags_of(way), _refs(way, extract)) for way in extract.root.findall("way") if is_present(way)]
    roads = {ref: node for ref, node in nodes.items() if _put_on_road(node, ref, ways, extract)}
    found = []
    for tags, refs in ways:
        own = [roads[ref] for ref in refs if ref in roads]
        if tags.get("highway") not in WALK or len(refs) < 2 or not own:
            continue
        if "crossing" in (tags.get("footway"), tags.get("cycleway"), tags.get("path")):
            is_told = "crossing" in tags or "crossing:markings" in tags
            for node in own:
                node.is_taken = True
            if _is_marked(tags) if is_told else any(_is_marked(node.tags) for node in own):
                line = shapely.LineString([extract.places[ref] for ref in refs])
                found.append(Crossing(line, float(np.clip(length_m(tags.get("width")) or ACROSS, *WIDTHS))))
        else:
            for ref in refs:
                if ref in roads:
                    roads[ref].footway = _heading(ref, refs, extract)
    for node in roads.values():
        if not node.is_taken and _is_marked(node.tags):
            across = np.array([-node.heading[1], node.heading[0]])
            if node.footway is not None and abs(float(node.footway @ across)) > 0.7:
                across = node.footway
            ends = node.xy + np.array([[-1.0], [1.0]]) * (node.reach + ASIDE) * across
            found.append(Crossing(shapely.LineString(ends), ACROSS, shapely.Point(node.xy)))
    return found


def _refs(way: ElementTree.Element, extract: Extract) -> list[str]:
    return [ref for nd in way.findall("nd") if (ref := nd.get("ref", "")) in extract.places]


def _put_on_road(node: _Node, ref: str, ways: list[tuple[dict[str, str], list[str]]], extract: Extract) -> bool:
    """Set direction and width of the road of a node; return whether it is on one for cars."""
    for tags, refs in ways:
        if ref in refs and len(refs) > 1 and has_lanes(tags):
            lanes = number(tags.get("lanes"))
            node.heading = _heading(ref, refs, extract)
            node.reach = 0.5 * (length_m(tags.get("width")) or (lanes * LANE if lanes else WIDTH[tags["highway"]]))
            return True
    return False


def _heading(ref: str, refs: list[str], extract: Extract) -> np.ndarray:
    """Return the direction of a way at a node, a unit vector; zeros where its nodes lie in one place."""
    at = refs.index(ref)
    step = extract.places[refs[min(at + 1, len(refs) - 1)]] - extract.places[refs[max(at - 1, 0)]]
    length = float(np.linalg.norm(step))
    return step / length if length > 0 else np.zeros(2)


def _is_marked(tags: dict[str, str]) -> bool:
    return tags.get("crossing") not in UNMARKED and tags.get("crossing:markings") not in UNMARKED


def _is_same(piece: shapely.LineString, other: shapely.LineString) -> bool:
    """Return whether two lines cross the same stretch of road: near, in about one direction, side by side."""
    ends = [np.asarray(line.coords)[[0, -1]] for line in (piece, other)]
    first, last = (pair[1] - pair[0] for pair in ends)
    lengths = float(np.linalg.norm(first)), float(np.linalg.norm(last))
    if min(lengths) == 0 or abs(float(first @ last)) < SIMILAR * lengths[0] * lengths[1]:
        return False
    along = last / lengths[1]
    low, high = sorted((ends[0] - ends[1][0]) @ along)
    is_beside = min(high, lengths[1]) - max(low, 0.0) > 0.5 * min(lengths)
    return is_beside and piece.distance(other) < APART
