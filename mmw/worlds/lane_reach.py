"""Find the lanes that vehicles can reach."""

from collections.abc import Callable, Iterable

from mmw.traffic.roads.lane_graph import LaneGraph

Step = Callable[[str], Iterable[str]]
"""Lane -> lanes one step from it."""


def beside(graph: LaneGraph, name: str) -> tuple[str, ...]:
    """Return the lanes that vehicles on a lane may change to."""
    return tuple(side for side in (graph.lanes[name].left, graph.lanes[name].right) if side)


def ahead(graph: LaneGraph) -> Step:
    """Return the step to the successors and neighbors of a lane."""
    return lambda name: (*graph.lanes[name].successors, *beside(graph, name))


def behind(graph: LaneGraph) -> Step:
    """Return the step to the predecessors and neighbors of a lane."""
    return lambda name: (*graph.predecessors[name], *beside(graph, name))


def reach(start: str, *steps: Step) -> set[str]:
    """Return the lanes that some kinds of steps lead to from a lane, itself included."""
    seen, queue = {start}, [start]
    while queue:
        name = queue.pop()
        fresh = {other for step in steps for other in step(name)} - seen
        seen |= fresh
        queue += fresh
    return seen


def partition(graph: LaneGraph, group_of: Callable[[str], set[str]]) -> list[list[str]]:
    """Return the lanes in groups, the largest first, then by name, given the group of a lane."""
    left, groups = set(graph.lanes), []
    while left:
        groups.append(sorted(group_of(min(left))))
        left -= set(groups[-1])
    return sorted(groups, key=lambda group: (-len(group), group[0]))


def strong_components(graph: LaneGraph) -> list[list[str]]:
    """Return the sets of lanes that can all be reached from each other, the largest first, then by name."""
    return partition(graph, lambda name: reach(name, ahead(graph)) & reach(name, behind(graph)))
