"""The road network: every road, junction and lane of a town, the ground between them, and what must hold for them."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import shapely

from mmw.core.errors import InputError
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.worlds.towns.alignment import Alignment, make_alignment, make_elevation
from mmw.worlds.towns.block_description import PropsSection, is_named
from mmw.worlds.towns.block_outlines import enclosed, link_chains
from mmw.worlds.towns.bridge_mesh import build_solid
from mmw.worlds.towns.bridge_piers import add_piers
from mmw.worlds.towns.checks import check_clearance, check_connected, check_crossings, check_grade, check_lanes
from mmw.worlds.towns.description import Junction, Road, Terrain, TownDescription
from mmw.worlds.towns.elevated_roads import (
    Structure,
    Walls,
    end_lines,
    find_walls,
    ground_chains,
    islands_of,
    kerb_lines,
    plan_of,
)
from mmw.worlds.towns.ground_height import Ground
from mmw.worlds.towns.junctions import Arm, build_pad, find_trims, sort_arms
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.road_details import add_road_details
from mmw.worlds.towns.roads import RoadBody, RoadEnd, build_road
from mmw.worlds.towns.roundabouts import expand_roundabouts
from mmw.worlds.towns.section import make_section
from mmw.worlds.towns.strip_mesh import Chain
from mmw.worlds.towns.terrain import mesh_terrain
from mmw.worlds.towns.turn_lanes import build_turns

FLAT_END = 2.0
"""Length over which a road stays level next to a junction [m]."""


@dataclass(frozen=True)
class RoadNetwork:
    """Roads, sidewalks, junctions and lanes of a town."""

    parts: list[MeshPart]
    """Meshes of `Roads/...`, `Sidewalks/...` and the verges, `Terrain/verge_...`, on the ground."""
    lanes: LaneGraph
    carriageway: shapely.Geometry
    """Drivable area on the ground in plan, between the kerbs."""
    corridor: shapely.Geometry
    """Carriageway, kerbs, sidewalks, verges and the fill of bridges in plan: nothing is built here."""
    centre_lines: dict[str, np.ndarray]
    """Road -> its reference line between the junctions [m], shape [N, 3]."""
    terrain: list[MeshPart]
    """Ground outside the corridor."""
    edges: list[np.ndarray]
    """Closed loops of kerb foot, kerb top, inner and outer edge of the sidewalk, and verge, the carriageway on the left
    [m], each [N, 5, 3]; at the end of a bridge the kerb runs straight across the road."""
    structures: tuple[Structure, ...]
    """Bridges and elevated roads, in the order of the roads."""

    @property
    def structure_parts(self) -> list[MeshPart]:
        """Meshes of `Bridges/...`; they are no ground."""
        return [part for structure in self.structures for part in structure.parts]

    @cached_property
    def overhead(self) -> shapely.Geometry:
        """Plan of all structures with their piers and walls; empty without any. Whatever is tall keeps clear."""
        return shapely.union_all([structure.cover for structure in self.structures])

    @cached_property
    def _ground(self) -> Ground:
        return Ground([*self.parts, *self.terrain])

    def height(self, x: np.ndarray, y: np.ndarray) -> np.ndarray:
        """Return the height of the ground [m], of the shape of `x`; NaN beyond the terrain."""
        return self._ground.height(x, y)


def build_network(description: TownDescription) -> RoadNetwork:
    """Return the roads of a town.

    Raises:
        InputError: If the description cannot be built: roads too short for their junctions, a grade above 0.20, roads
            that overlap or cross on the ground, a bridge that begins above the ground, leaves less than 5 m of
            clearance or finds no place for a pier, a way too tight or too close to a kerb, a dead end.
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
    check_crossings(bodies)
    parts = [part for body in bodies.values() for part in body.parts]
    corners: list[Chain] = []
    lanes = {lane.name: lane for body in bodies.values() for lane in body.lanes}
    for name in nodes:
        pad = build_pad(name, arms[name], trims[name], bodies)
        parts += pad.parts
        corners += pad.corners
        is_signalled = is_named(name, description.props.signalled)
        for before, lane in build_turns(name, arms[name], trims[name], bodies, chosen[name], pad, is_signalled):
            lanes[lane.name] = lane
            lanes[before] = replace(lanes[before], successors=(*lanes[before].successors, lane.name))
    bridges = [body for body in bodies.values() if body.cut is not None]
    walls, loops = _ground_loops(description.terrain, bodies, corners, parts)
    islands = [island for body in bodies.values() for island in islands_of(body)]
    carriageway, corridor = enclosed(loops, 0), enclosed(loops, 4)
    if islands:
        carriageway = shapely.difference(carriageway, shapely.union_all(islands))
    graph = LaneGraph(dict(sorted(lanes.items())))
    caps = [cap for body in bridges for cap in end_lines(body)]
    own = {lane.name: kerb_lines(body) for body in bridges for lane in body.lanes}
    check_lanes(graph, shapely.difference(shapely.boundary(carriageway), shapely.union_all(caps)), own)
    check_connected(graph)
    terrain = _terrain(description.terrain, loops, bridges)
    structures = _build_bridges(bridges, walls, (carriageway, corridor), Ground([*parts, *terrain]))
    check_clearance(structures, _surfaces(parts))
    lines = {name: body.centre_line for name, body in bodies.items()}
    parts = add_road_details(parts, bodies, graph)
    return RoadNetwork(parts, graph, carriageway, corridor, lines, terrain, loops, structures)


def _terrain(settings: Terrain, loops: list[np.ndarray], bridges: list[RoadBody]) -> list[MeshPart]:
    cover = [plan_of(body) for body in bridges]
    return mesh_terrain([loop[:, 4] for loop in loops], settings.spacing, settings.margin, cover)


def _ground_loops(
    settings: Terrain, bodies: dict[str, RoadBody], corners: list[Chain], parts: list[MeshPart]
) -> tuple[dict[str, Walls], list[np.ndarray]]:
    """Return where bridges are filled, and the closed edges of roads, junctions and fills.

    How far a bridge is filled depends on the ground below it: a first terrain is closed straight across its ends.
    """
    bridges = [body for body in bodies.values() if body.cut is not None]
    walls: dict[str, Walls] = {}
    for _ in range(2 if bridges else 1):
        chains = [chain for name, body in bodies.items() for chain in ground_chains(body, walls.get(name))]
        loops = link_chains([*chains, *corners])
        if bridges and not walls:
            ground = Ground([*parts, *_terrain(settings, loops, bridges)])
            walls = {body.road.id: find_walls(body, ground) for body in bridges}
    return walls, loops


def _build_bridges(
    bridges: list[RoadBody],
    walls: dict[str, Walls],
    areas: tuple[shapely.Geometry, shapely.Geometry],
    ground: Ground,
) -> tuple[Structure, ...]:
    """Return the bridges with piers that keep clear of carriageway and corridor, the two areas, and of each other."""
    made = []
    solids = {body.road.id: build_solid(body, walls[body.road.id]) for body in bridges}
    for body in bridges:
        name = body.road.id
        others = [solid.plan for other, solid in solids.items() if other != name]
        blocked = shapely.union_all([areas[1], *others])
        made.append(add_piers(body, solids[name], walls[name], blocked, areas[0], ground))
    return tuple(made)


def _surfaces(parts: list[MeshPart]) -> dict[str, np.ndarray]:
    """Return the triangles of every road and junction on the ground by its name."""
    found: dict[str, list[np.ndarray]] = {}
    for part in parts:
        if part.label in ("road", "road_line"):
            found.setdefault(part.path.split("/")[1], []).append(part.mesh.corners)
    return {name: np.concatenate(triangles) for name, triangles in found.items()}


def _align(road: Road, nodes: dict[str, tuple[float, float, float]]) -> Alignment:
    points = np.array([nodes[road.start][:2], *(corner[:2] for corner in road.via), nodes[road.end][:2]])
    return make_alignment(points, np.array([corner[2] for corner in road.via]), road.id)


def _check_names(props: PropsSection, nodes: list[str]) -> None:
    for key, patterns in (("signalled", props.signalled), ("give_way", props.give_way)):
        for pattern in patterns:
            if not any(is_named(node, [pattern]) for node in nodes):
                raise InputError(f"props.{key} = {pattern!r}: names no junction; junctions are {', '.join(nodes)}")


def _end(arm: Arm, arms: list[Arm], trim: float, settings: Junction, is_signalled: bool) -> RoadEnd:
    """Return the paint across the end of an arm: none where it only bends or on a ring; no stop line on a main road.

    Where there are traffic lights, every arm has a stop line.
    """
    has_lanes_in = not arm.is_start or len(arm.section.backward) > 0
    highest = max(other.road.priority for other in arms)
    is_plain = len(arms) == 2 or not arm.section.backward
    waits = is_signalled or arm.road.priority < highest or all(other.road.priority == highest for other in arms)
    return RoadEnd(trim, settings.crosswalks and not is_plain, has_lanes_in and waits and not is_plain)
