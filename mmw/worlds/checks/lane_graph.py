"""Check the lane graph: lanes that cannot be reached, dead ends, gaps, kinks, neighbors."""

import numpy as np

from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.worlds.checks.findings import Finding, as_place, does_not_apply, listed
from mmw.worlds.checks.stage_model import StageModel
from mmw.worlds.lane_reach import strong_components

GAP_M = 0.05
"""Largest distance from the end of a lane to the start of its successor [m]; design value."""

KINK_RAD = np.radians(5.0)
"""Largest change of heading there [rad]; design value, ten times what a lane of 1 m segments bends in a junction."""

PARALLEL_RAD = np.radians(5.0)
"""Largest angle between neighbors [rad]; design value."""


def lane_findings(model: StageModel) -> list[Finding]:
    """Return islands, dead ends, gaps, kinks and neighbors that are none."""
    graph = model.lanes
    if graph is None:
        return [does_not_apply("lanes", "no lanes")]
    return [*_islands(graph), *_ends(graph), *_joints(graph), *_neighbours(graph)]


def _islands(graph: LaneGraph) -> list[Finding]:
    groups = strong_components(graph)
    return [
        Finding(
            "warning", "islands", f"lane {listed(group, 6)}",
            f"{len(group)} of {len(graph.lanes)} lanes cannot be reached from the others, or not be left to them",
            "join their roads to the rest of the town", as_place(graph.lanes[group[0]].points[0]),
        )
        for group in groups[1:]
    ]  # fmt: skip


def _ends(graph: LaneGraph) -> list[Finding]:
    found = []
    for lane in graph.lanes.values():
        for others, point, text, cure in (
            (lane.successors, -1, "leads nowhere", "give it a successor; vehicles cannot drive on here"),
            (graph.predecessors[lane.name], 0, "no lane leads to it", "make it a successor of another one"),
        ):
            if not others:
                place = as_place(lane.points[point])
                found.append(Finding("warning", "dead_ends", f"lane {lane.name}", text, cure, place))
    return found


def _joints(graph: LaneGraph) -> list[Finding]:
    found, kinks = [], graph.kinks()
    for lane in graph.lanes.values():
        for name in lane.successors:
            end = lane.points[-1]
            gap = float(np.linalg.norm(graph.lanes[name].points[0] - end))
            paths = f"lane {lane.name} and lane {name}"
            if gap > GAP_M:
                text = f"{gap:.2f} m between the end of the first and the start of the second"
                found.append(Finding("error", "gaps", paths, text, "let them share a point", as_place(end)))
            elif kinks[lane.name, name] > KINK_RAD:
                text = f"the heading changes by {np.degrees(kinks[lane.name, name]):.1f} deg where they meet"
                found.append(Finding("warning", "kinks", paths, text, "let them share a tangent", as_place(end)))
    return found


def _neighbours(graph: LaneGraph) -> list[Finding]:
    found = []
    for lane in graph.lanes.values():
        for side, name in (("left", lane.left), ("right", lane.right)):
            text = misfit(lane, graph.lanes[name], side) if name else ""
            if text:
                paths, cure = f"lane {lane.name} and lane {name}", "correct mmw:lane:left and mmw:lane:right"
                place = as_place(lane.points[len(lane.points) // 2])
                found.append(Finding("error", "neighbours", paths, text, cure, place))
    return found


def misfit(lane: Lane, other: Lane, side: str) -> str:
    """Return why a lane is no neighbor of another, empty if it is one."""
    back = other.right if side == "left" else other.left
    if back != lane.name:
        return f"the second lies to the {side} of the first, but not the first to the other side of the second"
    middle = len(lane.points) // 2
    segment = min(middle, len(lane.headings) - 1)
    away = other.points - lane.points[middle]
    near = int(np.argmin(np.linalg.norm(away, axis=1)))
    turn = lane.headings[segment] - other.headings[min(near, len(other.headings) - 1)]
    turn = abs(float((turn + np.pi) % (2.0 * np.pi) - np.pi))
    if turn > PARALLEL_RAD:
        return f"neighbors, but {np.degrees(turn):.1f} deg apart in heading"
    forward = np.array([np.cos(lane.headings[segment]), np.sin(lane.headings[segment])])
    to_left = float(forward[0] * away[near, 1] - forward[1] * away[near, 0])
    if (to_left > 0.0) != (side == "left"):
        return f"the second is called the {side} neighbor, but lies on the other side"
    widest = lane.width + other.width
    distance = float(np.linalg.norm(away[near]))
    return f"neighbors, but {distance:.1f} m apart" if distance > widest else ""
