"""Find lanes that cross at one level outside a common junction, so that vehicles give way to each other there.

Files exist whose junctions do not name all roads across an intersection, or that part one intersection into several.
"""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import shapely

from mmw.traffic.polyline import sample_polyline
from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.worlds.importers.opendrive.ground import OVERPASS

LONGEST = 60.0
"""Lanes of roads up to this length become connections of a junction [m]; design value, the width of an intersection."""
MIN_AWAY = 1.0
"""Lanes that cross nearer to an end of one [m] lie beside each other at the ends of their roads; design value."""


def join_crossings(lanes: Mapping[str, Lane], ranks: Mapping[str, int]) -> tuple[dict[str, Lane], list[str]]:
    """Return the lanes with one junction for all that cross, directly or through others, and notes for people.

    Lanes of roads become connections of the junction if vehicles can wait before them, on another lane, and they are no
    longer than `LONGEST`. A junction is named as the first of those that it joins, or after its first lane.

    Args:
        lanes: All lanes by name.
        ranks: Their priorities as connections.
    """
    joined, left = [], []
    before = LaneGraph(dict(lanes)).predecessors
    for pair in _crossing_pairs(lanes, before):
        fits = all(lanes[k].junction or (before[k] and lanes[k].plan_length <= LONGEST) for k in pair)
        (joined if fits else left).append(pair)
    group = _groups([tuple(lanes[name].junction or name for name in pair) for pair in joined])
    within = {name for pair in joined for name in pair}
    first: dict[str, str] = {}
    for name in sorted(lanes):
        if name in within:
            first.setdefault(group[lanes[name].junction or name], f"crossing_{name}")
    for junction in sorted({lane.junction for lane in lanes.values()} & set(group), reverse=True):
        first[group[junction]] = junction
    made = dict(lanes)
    new = [name for name in within if not lanes[name].junction]
    for name, lane in lanes.items():
        if name in new:
            made[name] = replace(lane, junction=first[group[name]], priority=ranks[name], left="", right="")
        elif lane.junction in group:
            made[name] = replace(lane, junction=first[group[lane.junction]])
        elif lane.left in new or lane.right in new:
            sides = {side: "" for side in ("left", "right") if getattr(lane, side) in new}
            made[name] = replace(lane, **sides)
    notes = []
    if joined:
        a, b = joined[0]
        notes.append(
            f"{len(joined)} pairs of lanes cross outside a common junction, such as {a} and {b}; they were given one"
        )
    if left:
        a, b = left[0]
        notes.append(
            f"{len(left)} pairs of lanes cross without a junction, such as {a} and {b}, and one is longer than "
            f"{LONGEST:g} m or follows on no other: vehicles do not see each other there; add a junction to the file"
        )
    return made, notes


def _crossing_pairs(lanes: Mapping[str, Lane], before: Mapping[str, tuple[str, ...]]) -> list[tuple[str, str]]:
    """Return the pairs of lanes that cross at one level and neither share a junction or an end nor are linked."""
    names = sorted(lanes)
    lines = np.array([shapely.LineString(lanes[name].points[:, :2]) for name in names])
    found = []
    for i, j in shapely.STRtree(lines).query(lines, predicate="crosses").T.tolist():
        a, b = lanes[names[i]], lanes[names[j]]
        if i >= j or (a.junction and a.junction == b.junction):
            continue
        onward, back = set(a.successors), set(before[a.name])
        if b.name in onward | back or onward & set(b.successors) or back & set(before[b.name]):
            continue
        common = shapely.points(shapely.get_coordinates(shapely.intersection(lines[i], lines[j])))
        height, away = [], []
        for lane, line in ((a, lines[i]), (b, lines[j])):
            station = shapely.line_locate_point(line, common)
            height.append(sample_polyline(lane.points, lane.plan_station, station)[:, 2])
            away.append(np.minimum(station, lane.plan_length - station))
        if ((np.abs(height[0] - height[1]) < OVERPASS) & (np.minimum(*away) > MIN_AWAY)).any():
            found.append((a.name, b.name))
    return sorted(found)


def _groups(pairs: list[tuple[str, ...]]) -> dict[str, str]:
    """Return for every name of some pairs the first name of those that it is joined with, directly or not."""
    beside: dict[str, set[str]] = defaultdict(set)
    for a, b in pairs:
        beside[a].add(b)
        beside[b].add(a)
    group: dict[str, str] = {}
    for name in sorted(beside):
        queue = [name] if name not in group else []
        while queue:
            here = queue.pop()
            if here not in group:
                group[here] = name
                queue += sorted(beside[here])
    return group
