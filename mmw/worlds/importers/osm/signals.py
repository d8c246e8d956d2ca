"""Traffic lights at the stop lines of junctions that have them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import shapely

from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.props import build_prop

ASIDE = 0.9
"""Distance of a pole from the edge of the outermost lane [m]; design value."""
BEFORE = 0.3
"""Distance of a pole from the end of its lane [m]; design value."""
FREE = 0.3
"""Distance of a pole from carriageways and buildings [m]; design value."""
OUTWARD = (0.0, 0.6, 1.2, 2.0)
"""How much farther aside a pole may stand where its place is taken [m]; design values."""
FIRST_PHASE = "a"
"""Phase whose lights show green in a world at rest, as in the town kit."""


def build_signals(
    graph: LaneGraph, paved: shapely.Geometry, buildings: Sequence[shapely.Geometry], *, is_left_hand: bool
) -> tuple[list[MeshPart], int]:
    """Return a traffic light beside each approach of a junction with lights, and how many approaches have no room.

    Args:
        graph: The lanes.
        paved: Carriageways [m].
        buildings: Plans of buildings [m].
        is_left_hand: Whether poles stand on the left.
    """
    taken = shapely.union_all([paved.buffer(FREE, quad_segs=2), *buildings])
    shapely.prepare(taken)
    parts: list[MeshPart] = []
    crowded = 0
    for number, lane in enumerate(_outermost(graph, is_left_hand)):
        step = lane.points[-1, :2] - lane.points[-2, :2]
        along = step / np.linalg.norm(step)
        aside = np.array([-along[1], along[0]]) * (1.0 if is_left_hand else -1.0)
        corner = lane.points[-1, :2] - BEFORE * along + (0.5 * lane.width + ASIDE) * aside
        free = [corner + more * aside for more in OUTWARD if not shapely.contains_xy(taken, *(corner + more * aside))]
        if not free:
            crowded += 1
            continue
        is_green = any(graph.lanes[name].signal == FIRST_PHASE for name in lane.successors)
        kind = "traffic_light_green" if is_green else "traffic_light"
        yaw = float(np.arctan2(-along[1], -along[0]))
        name, rng = f"traffic_light_{number:03d}", np.random.default_rng(number)
        if not is_left_hand:
            parts += build_prop(name, kind, (*free[0].tolist(), 0.0), yaw, rng)
            continue
        for part in build_prop(name, kind, (0.0, 0.0, 0.0), 0.0, rng):  # its arm reaches to the other side
            cos, sin = np.cos(yaw), np.sin(yaw)
            turned = (part.points * (1.0, -1.0, 1.0)) @ np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
            parts.append(replace(part, points=turned + np.array([*free[0], 0.0]), faces=part.faces[:, ::-1]))
    return parts, crowded


def _outermost(graph: LaneGraph, is_left_hand: bool) -> list[Lane]:
    """Return the lane beside the sidewalk of each approach with a light, by name."""
    side = "left" if is_left_hand else "right"
    found = []
    for name in sorted(graph.lanes):
        lane = graph.lanes[name]
        if lane.junction or not any(graph.lanes[other].signal for other in lane.successors):
            continue
        beside = getattr(lane, side)
        if not beside or not any(graph.lanes[other].signal for other in graph.lanes[beside].successors):
            found.append(lane)
    return found
