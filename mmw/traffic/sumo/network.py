"""Write the lane graph as a SUMO network: the same lanes, connections and right of way.

Lanes beside each other become one edge, lanes across a junction become its internal lanes, with our points as shapes.
The network is written as it is, so SUMO's netconvert is not needed.

Source: the format, https://sumo.dlr.de/docs/Networks/SUMO_Road_Networks.html.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mmw.traffic.roads.lane_graph import Lane, LaneGraph

CLOSE = 2.4
"""Connections whose center lines come nearer than this conflict [m]: the width of a lorry."""

VISIBILITY = "50"
"""Drivers that have to give way see the others from this far before a junction [m]; SUMO's 4.5 m makes them stop."""

SLOWEST = 1.5
"""Lowest speed limit that is written [m/s]."""


@dataclass(frozen=True)
class SumoPlace:
    """A lane of ours in the SUMO network."""

    edge: str
    index: int
    """Number of the lane in its edge, from the right."""
    scale: float
    """SUMO's length over ours; lanes of one edge are equally long there [-]."""


@dataclass(frozen=True)
class SumoNetwork:
    """A network and how to find our lanes in it."""

    root: ElementTree.Element
    place: Mapping[str, SumoPlace]
    """Our lane -> its place; lanes that cross a junction have none."""
    internal: Mapping[str, str]
    """SUMO's lane id -> our lane, for every lane of the network."""

    def write(self, path: Path) -> None:
        """Write the network as a `.net.xml` file."""
        ElementTree.indent(self.root)
        ElementTree.ElementTree(self.root).write(path, encoding="utf-8", xml_declaration=True)


@dataclass(frozen=True)
class _Link:
    """One connection from a lane to a lane."""

    before: str
    across: str
    """The lane across the junction; empty where a road goes on."""
    after: str


def make_network(graph: LaneGraph, limit: Mapping[str, float]) -> SumoNetwork:
    """Return the SUMO network of a lane graph.

    Args:
        graph: The lanes. A lane of a junction between two lanes outside it becomes an internal lane; other lanes become
            lanes of edges.
        limit: Speed limit of every lane, bends regarded [m/s].
    """
    lanes = graph.lanes
    inside = {name for name, lane in lanes.items() if _is_internal(graph, lane)}
    edges = _group_edges(graph, inside)
    edge_of = {name: edge for edge, names in edges.items() for name in names}
    links = _find_links(graph, inside)
    node = _find_nodes(edges, edge_of, links, graph)
    mean = {edge: float(np.mean([lanes[name].plan_length for name in names])) for edge, names in edges.items()}
    place = {
        name: SumoPlace(edge, index, mean[edge] / lanes[name].plan_length)
        for edge, names in edges.items()
        for index, name in enumerate(names)
    }
    root = ElementTree.Element("net", version="1.20", junctionCornerDetail="5", limitTurnSpeed="-1")
    _write_location(root, graph)
    at_node: dict[str, list[_Link]] = {}
    for link in sorted(links, key=lambda link: link.before):  # incoming lanes by name, then as the lanes name them
        at_node.setdefault(node[f"end {edge_of[link.before]}"], []).append(link)
    internal: dict[str, str] = {f"{spot.edge}_{spot.index}": name for name, spot in place.items()}
    via: dict[_Link, str] = {}
    for junction in sorted(at_node):
        for number, link in enumerate(at_node[junction]):
            if link.across:
                via[link] = f":{junction}_{number}"
                edge = ElementTree.SubElement(root, "edge", id=via[link], function="internal")
                lane = lanes[link.across]
                _write_lane(edge, f"{via[link]}_0", 0, lane, lane.plan_length, max(limit[link.across], SLOWEST))
                internal[f"{via[link]}_0"] = link.across
    for edge in sorted(edges):
        ends = {"from": node[f"start {edge}"], "to": node[f"end {edge}"]}
        element = ElementTree.SubElement(root, "edge", id=edge, priority="1", **ends)
        for index, name in enumerate(edges[edge]):
            _write_lane(element, f"{edge}_{index}", index, lanes[name], mean[edge], max(limit[name], SLOWEST))
    gives_way: dict[_Link, bool] = {}
    for junction in sorted(set(node.values())):
        yields = _write_junction(root, junction, at_node.get(junction, []), edges, node, via, graph)
        gives_way |= zip(at_node.get(junction, []), yields.any(axis=1).tolist(), strict=True)
    for junction in sorted(at_node):
        for link in at_node[junction]:
            _write_connection(root, link, place, via.get(link), "m" if gives_way[link] else "M")
    return SumoNetwork(root, place, internal)


def _is_internal(graph: LaneGraph, lane: Lane) -> bool:
    around = (*lane.successors, *graph.predecessors[lane.name])
    return (
        bool(lane.junction)
        and len(lane.successors) == 1
        and len(graph.predecessors[lane.name]) > 0
        and not any(graph.lanes[name].junction for name in around)
    )


def _group_edges(graph: LaneGraph, inside: set[str]) -> dict[str, list[str]]:
    """Return edges with their lanes from the right: chains of lanes that name each other as neighbors."""
    edges, seen = {}, set(inside)
    for name in sorted(graph.lanes):
        if name in seen:
            continue
        chain = [name]
        while (right := graph.lanes[chain[0]].right) and right not in seen and right not in chain:
            chain.insert(0, right)
        while (left := graph.lanes[chain[-1]].left) and left not in seen and left not in chain:
            chain.append(left)
        seen.update(chain)
        edges[min(chain)] = chain
    return edges


def _find_links(graph: LaneGraph, inside: set[str]) -> list[_Link]:
    links = []
    for name, lane in graph.lanes.items():
        if name in inside:
            continue
        for successor in lane.successors:
            if successor in inside:
                links.append(_Link(name, successor, graph.lanes[successor].successors[0]))
            else:
                links.append(_Link(name, "", successor))
    return links


def _find_nodes(
    edges: Mapping[str, list[str]], edge_of: Mapping[str, str], links: list[_Link], graph: LaneGraph
) -> dict[str, str]:
    """Return the junction at both ends of every edge: keys are `start EDGE` and `end EDGE`."""
    ends = [f"{end} {edge}" for edge in edges for end in ("start", "end")]
    members = {end: {end} for end in ends}  # end -> the set, shared by all in it, of ends that are one junction
    for link in links:
        before = members[f"end {edge_of[link.before]}"]
        names = [f"start {edge_of[link.after]}"]
        names += [f"junction {graph.lanes[link.across].junction}"] if link.across else []
        for name in names:
            before |= members.setdefault(name, {name})
            members.update(dict.fromkeys(before, before))
    number = {group: f"J{index}" for index, group in enumerate(sorted({min(members[end]) for end in ends}))}
    return {end: number[min(members[end])] for end in ends}


def _yields(links: list[_Link], foes: np.ndarray, graph: LaneGraph) -> np.ndarray:
    """Return which link gives way to which, shape [L, L]: by priority, between equals the later one in the list.

    This is an order, so no vehicles wait for each other in a circle.
    """
    priority = [graph.lanes[link.across or link.after].priority for link in links]
    rank = np.array(sorted(range(len(links)), key=lambda index: (-priority[index], index)))
    place = np.argsort(rank)
    return foes & (place[:, None] > place[None, :])


def _foes(links: list[_Link], graph: LaneGraph) -> np.ndarray:
    """Return which links of a junction conflict, shape [L, L]: their lines come close or meet."""
    out = np.zeros((len(links), len(links)), bool)
    lines = [graph.lanes[link.across].points if link.across else None for link in links]
    for i, one in enumerate(lines):
        for j in range(i):
            other = lines[j]
            if one is None or other is None or links[i].before == links[j].before:
                continue
            apart = np.linalg.norm(one[:, None, :2] - other[None, :, :2], axis=-1)
            level = np.abs(one[:, None, 2] - other[None, :, 2]) < CLOSE
            out[i, j] = out[j, i] = links[i].after == links[j].after or bool((level & (apart < CLOSE)).any())
    return out


def _write_location(root: ElementTree.Element, graph: LaneGraph) -> None:
    points = np.concatenate([lane.points[:, :2] for lane in graph.lanes.values()])
    box = ",".join(f"{value:.2f}" for value in (*points.min(axis=0), *points.max(axis=0)))
    frame = {"netOffset": "0.00,0.00", "convBoundary": box, "origBoundary": box, "projParameter": "!"}
    ElementTree.SubElement(root, "location", frame)


def _write_lane(edge: ElementTree.Element, name: str, index: int, lane: Lane, length: float, speed: float) -> None:
    size = {"speed": f"{speed:.3f}", "length": f"{length:.4f}", "width": f"{lane.width:.3f}"}
    shape = " ".join(f"{x:.4f},{y:.4f},{z:.4f}" for x, y, z in lane.points)
    ElementTree.SubElement(edge, "lane", size, id=name, index=str(index), shape=shape)


def _write_junction(
    root: ElementTree.Element,
    name: str,
    links: list[_Link],
    edges: Mapping[str, list[str]],
    node: Mapping[str, str],
    via: Mapping[_Link, str],
    graph: LaneGraph,
) -> np.ndarray:
    """Write a junction and return which of its links gives way to which, shape [L, L]."""
    ending = [edge for edge in edges if node[f"end {edge}"] == name]
    coming = {lane: f"{edge}_{index}" for edge in ending for index, lane in enumerate(edges[edge])}
    going = [edges[edge][0] for edge in edges if node[f"start {edge}"] == name]
    place = graph.lanes[min(coming)].points[-1] if coming else graph.lanes[min(going)].points[0]
    attributes = {axis: f"{value:.4f}" for axis, value in zip("xyz", place, strict=True)}
    attributes |= {"type": "priority" if links else "dead_end", "shape": ""}
    attributes["incLanes"] = " ".join(coming[lane] for lane in sorted(coming))
    attributes["intLanes"] = " ".join(f"{via[link]}_0" for link in links if link in via)
    element = ElementTree.SubElement(root, "junction", attributes, id=name)
    foes = _foes(links, graph)
    yields = _yields(links, foes, graph)
    for index, (response, conflicts) in enumerate(zip(map(_bits, yields), map(_bits, foes), strict=True)):
        ElementTree.SubElement(element, "request", index=str(index), response=response, foes=conflicts, cont="0")
    return yields


def _bits(row: np.ndarray) -> str:
    """Return flags as SUMO writes them: link 0 at the right."""
    return "".join("1" if flag else "0" for flag in row[::-1])


def _write_connection(
    root: ElementTree.Element, link: _Link, place: Mapping[str, SumoPlace], via: str | None, state: str
) -> None:
    before, after = place[link.before], place[link.after]
    common = {"to": after.edge, "toLane": str(after.index), "dir": "s"}
    first = {"from": before.edge, "fromLane": str(before.index), **common, "state": state, "visibility": VISIBILITY}
    ElementTree.SubElement(root, "connection", first | ({"via": f"{via}_0"} if via else {}))
    if via:
        ElementTree.SubElement(root, "connection", {"from": via, "fromLane": "0", **common, "state": "M"})
