"""The road network: every road, junction and lane of a town, the ground between them, and what must hold for them."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
import shapely

from mmw.town.alignment import Alignment, make_alignment, make_elevation
from mmw.town.block_description import PropsSection, is_named
from mmw.town.checks import check_clearance, check_connected, check_grade, check_lanes
from mmw.town.description import Junction, Road, TownDescription
from mmw.town.ground import Ground
from mmw.town.junctions import Arm, build_pad, find_trims, sort_arms
from mmw.town.lanes import LaneGraph
from mmw.town.loops import enclosed, link_chains
from mmw.town.parts import MeshPart
from mmw.town.roads import RoadBody, RoadEnd, build_road
from mmw.town.roundabouts import expand_roundabouts
from mmw.town.section import make_section
from mmw.town.strips import Chain
from mmw.town.terrain import mesh_terrain
from mmw.town.turns import build_turns

FLAT_END = 2.0
"""Length over which a road stays level next to a junction [m]."""


@dataclass(frozen=True)
class RoadNetwork:
    """Roads, sidewalks, junctions and lanes of a town."""

    parts: list[MeshPart]
    """Meshes of `Roads/...`, `Sidewalks/...` and the verges, `Terrain/verge_...`."""
    lanes: LaneGraph
    carriageway: shapely.Geometry
    """Drivable area in plan, between the kerbs."""
    corridor: shapely.Geometry
    """Carriageway, kerbs, sidewalks and verges in plan: nothing is built here."""
    centre_lines: dict[str, np.ndarray]
    """Road -> its reference line between the junctions [m], shape [N, 3]."""
    kerbs: list[np.ndarray]
    """Closed kerb lines at road level, the carriageway on the left, not repeating the first point [m], each [N, 3]."""
    terrain: list[MeshPart]
    """Ground outside the corridor."""
    junction_outlines: dict[str, np.ndarray] = field(default_factory=dict)
    """Node -> border of its carriageway, counter-clockwise [m], shape [N, 2]."""

    @cached_property
    def _ground(self) -> Ground:
        return Ground([*self.parts, *self.terrain])

    def height(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the height of the ground [m], of the shape of `x`; NaN beyond the terrain.

        Args:
            x: East [m].
            y: North [m], shape of `x`.
        """
        return self._ground.height(x, y)


def build_network(description: TownDescription) -> RoadNetwork:
    """Return the roads of a town.

    Raises:
        ValueError: If the description cannot be built: roads too short for their junctions, a grade above 0.20, roads
            that overlap or cross with less than 5 m between them, a way too tight or too close to a kerb, a dead end.
    """
    nodes, roads, settings = expand_roundabouts(description)
    sections = {name: make_section(name, profile) for name, profile in description.profiles.items()}
    alignments = {road.id: _align(road, nodes) for road in roads}
    arms: dict[str, list[Arm]] = {name: [] for name in nodes}
    for road in roads:
        for node, is_start in ((road.start, True), (road.end, False)):
            arms[node].append(Arm(road, sections[road.profile], alignments[road.id], is_start))
    trims: dict[str, list[float]] = {}
    ends: dict[tuple[str, bool], RoadEnd] = {}
    chosen = {name: settings.get(name, Junction()) for name in nodes}
    _check_names(description.props, list(nodes))
    for name in nodes:
        is_signalled = is_named(name, description.props.signalled)
        arms[name] = sort_arms(arms[name])
        trims[name] = find_trims(name, arms[name], chosen[name].corner_radius or description.corner_radius)
        for arm, trim in zip(arms[name], trims[name], strict=True):
            ends[arm.key] = _end(arm, arms[name], trim, chosen[name], is_signalled)
    bodies: dict[str, RoadBody] = {}
    for road in roads:
        pair = (ends[road.id, True], ends[road.id, False])
        length = alignments[road.id].length
        heights = (nodes[road.start][2], nodes[road.end][2])
        flat = (pair[0].trim + FLAT_END, pair[1].trim + FLAT_END)
        elevation = make_elevation(length, heights, flat, road.z, description.vertical_curve, road.id)
        check_grade(road.id, elevation)
        bodies[road.id] = build_road(road, sections[road.profile], alignments[road.id], elevation, pair)
    check_clearance(bodies)
    parts = [part for body in bodies.values() for part in body.parts]
    chains: list[Chain] = [chain for body in bodies.values() for chain in (body.right, body.left)]
    lanes = {lane.name: lane for body in bodies.values() for lane in body.lanes}
    outlines = {}
    for name in nodes:
        pad = build_pad(name, arms[name], trims[name], bodies, chosen[name])
        parts += pad.parts
        chains += pad.corners
        outlines[name] = pad.outline
        for before, lane in build_turns(name, arms[name], trims[name], bodies, chosen[name]):
            lanes[lane.name] = lane
            lanes[before] = replace(lanes[before], successors=(*lanes[before].successors, lane.name))
    loops = link_chains(chains)
    carriageway, corridor = enclosed(loops, 0), enclosed(loops, 4)
    graph = LaneGraph(dict(sorted(lanes.items())))
    check_lanes(graph, carriageway)
    check_connected(graph)
    terrain = mesh_terrain([loop[:, 4] for loop in loops], description.terrain.spacing, description.terrain.margin)
    lines = {name: body.centre_line for name, body in bodies.items()}
    kerbs = [loop[:, 0] for loop in loops]
    return RoadNetwork(parts, graph, carriageway, corridor, lines, kerbs, terrain, outlines)


def _align(road: Road, nodes: dict[str, tuple[float, float, float]]) -> Alignment:
    points = np.array([nodes[road.start][:2], *(corner[:2] for corner in road.via), nodes[road.end][:2]])
    return make_alignment(points, np.array([corner[2] for corner in road.via]), road.id)


def _check_names(props: PropsSection, nodes: list[str]) -> None:
    for key, patterns in (("signalled", props.signalled), ("give_way", props.give_way)):
        for pattern in patterns:
            if not any(is_named(node, [pattern]) for node in nodes):
                raise ValueError(f"props.{key} = {pattern!r}: names no junction; junctions are {', '.join(nodes)}")


def _end(arm: Arm, arms: list[Arm], trim: float, settings: Junction, is_signalled: bool) -> RoadEnd:
    """Paint across the end of an arm: none where the road only bends or on a ring, no stop line on a main road.

    Where there are traffic lights, every arm has a stop line.
    """
    has_lanes_in = not arm.is_start or len(arm.section.backward) > 0
    highest = max(other.road.priority for other in arms)
    is_plain = len(arms) == 2 or not arm.section.backward
    waits = is_signalled or arm.road.priority < highest or all(other.road.priority == highest for other in arms)
    return RoadEnd(trim, settings.crosswalks and not is_plain, has_lanes_in and waits and not is_plain)
