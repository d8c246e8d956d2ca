"""Lane graph of a SUMO network: roads as they are, and one lane for each connection through a junction."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.worlds.importers.mesh_cleanup import free_name, identifier
from mmw.worlds.importers.sumo.network import Connection, Network, NetworkLane
from mmw.worlds.importers.sumo.smooth_line import curve, direction, resampled, rounded
from mmw.worlds.towns.plan_geometry import at_stations, row_stations
from mmw.worlds.towns.signal_phases import assign_phases
from mmw.worlds.towns.turn_lanes import RANK

STEP = 1.0
"""Largest distance of the points of a lane on a road [m]; half of it in junctions; design value."""
KINK = np.radians(3.0)
"""A connection that bends more where it meets its lanes is replaced by a curve [rad]; design value."""
DEFAULT_SPEED = 50 / 3.6
"""Speed limit where the network gives none [m/s]; the limit in towns of most countries."""
PARALLEL = np.radians(5.0)
"""Vehicles change between lanes whose headings differ by less than this [rad]; the limit of `mmw town check`."""
MAX_GAP = 0.5
"""Lanes that are connected directly lie at most this far apart [m]; as for OpenDRIVE."""
SHORTEST = 1e-3
"""Points of a line that is split lie at least this far from the new one [m]; design value."""
LIT = "oOgGrRyYu"
"""States of connections with a traffic light."""


def build_lanes(network: Network, held: Mapping[str, float] | None = None) -> tuple[LaneGraph, list[str]]:
    """Return the lane graph of a network in the plane z = 0, and notes for people.

    Roads are named `road_<edge>_<index>`, connections `<junction>_<number>`; a minus sign, the opposite direction of an
    edge, becomes `b`.

    Args:
        network: The network.
        held: Id of a lane -> how long before its end vehicles stop [m]. It ends there, and the rest is part of its
            connections.
    """
    held = held or {}
    lines = {lane.id: rounded(lane.points) for edge in network.roads for lane in edge.lanes if lane.is_driven}
    edge_of = {lane.id: edge for edge in network.edges.values() for lane in edge.lanes}
    names: dict[str, str] = {}
    for edge in sorted(network.roads, key=lambda edge: edge.id):
        for lane in edge.lanes:
            if lane.is_driven:
                text = f"road_{edge.id.replace('-', 'b')}_{lane.index}"
                names[lane.id] = free_name(identifier(text), names.values())
    used = [c for c in network.connections if c.first in lines and c.last in lines]
    phases = _phases(network, used, lines)
    successors: dict[str, list[str]] = defaultdict(list)
    through: dict[str, Lane] = {}
    apart = 0
    inside = {c.first: c for c in network.connections if c.first.startswith(":")}
    lanes = network.lanes
    for connection in sorted(used, key=lambda c: (c.first, c.last)):
        first, last = names[connection.first], names[connection.last]
        line = _through(connection, inside, lanes, lines)
        if line is None:
            gap = float(np.linalg.norm(lines[connection.first][-1] - lines[connection.last][0]))
            apart += gap > MAX_GAP
            if gap <= MAX_GAP:
                lines[connection.last][0] = lines[connection.first][-1]
                successors[first].append(last)
            continue
        junction = edge_of[connection.first].end
        place = identifier(f"junction_{junction}")
        name = free_name(f"{place}_{len(through)}", [*names.values(), *through])
        if connection.first in held:
            line = np.concatenate([_split(lines[connection.first], held[connection.first])[1], line[1:]])
        width = min(lanes[connection.first].width, lanes[connection.last].width)
        speed = lanes[connection.via].speed or DEFAULT_SPEED
        through[name] = Lane(
            name, _flat(resampled(line, 0.5 * STEP)), width, speed, place, _priority(connection, network.is_left_hand),
            (last,), signal=phases.get((junction, connection.first), "") if connection.state in LIT else "",
        )  # fmt: skip
        successors[first].append(name)
    found = {}
    for edge in network.roads:
        driven = {lane.index: lane for lane in edge.lanes if lane.is_driven}
        for index, lane in driven.items():
            outer, inner = (names.get(driven[k].id, "") if k in driven else "" for k in (index - 1, index + 1))
            left, right = (outer, inner) if network.is_left_hand else (inner, outer)
            line = _split(lines[lane.id], held[lane.id])[0] if lane.id in held else lines[lane.id]
            found[names[lane.id]] = Lane(
                names[lane.id], _flat(resampled(line, STEP)), lane.width, lane.speed or DEFAULT_SPEED,
                successors=tuple(sorted(successors[names[lane.id]])), left=left, right=right,
            )  # fmt: skip
    notes = [f"{apart} connections between lanes over {MAX_GAP} m apart were left out"] * bool(apart)
    for name, lane in found.items():
        sides = {side: other for side in ("left", "right") if (other := getattr(lane, side))}
        unfit = {side: "" for side, other in sides.items() if not _are_parallel(lane, found[other])}
        found[name] = replace(lane, **unfit)
    return LaneGraph(dict(sorted({**found, **through}.items()))), notes


def _are_parallel(lane: Lane, other: Lane) -> bool:
    """Return whether two lanes of one road run beside each other where vehicles would change between them."""
    worst = 0.0
    for one, two in ((lane, other), (other, lane)):
        away = np.linalg.norm(one.points[:, None, :2] - two.points[None, :, :2], axis=2)
        if away.min(axis=1).max() > lane.width + other.width:
            return False
        near = np.argmin(away, axis=1)
        turn = one.headings - two.headings[np.minimum(near[:-1], len(two.headings) - 1)]
        turn = np.abs((turn + np.pi) % (2 * np.pi) - np.pi)
        worst = max(worst, float(turn[len(turn) // 4 : max(len(turn) // 4 + 1, 3 * len(turn) // 4)].max()))
    return worst < PARALLEL


def _split(line: np.ndarray, rest: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the two parts of a line, the second one `rest` [m] long."""
    station = row_stations(line)
    cut = float(station[-1]) - rest
    middle = at_stations(np.array([cut]), station, line)
    return (
        np.concatenate([line[station < cut - SHORTEST], middle]),
        np.concatenate([middle, line[station > cut + SHORTEST]]),
    )


def _flat(line: np.ndarray) -> np.ndarray:
    return np.pad(line, ((0, 0), (0, 1)))


def _through(
    connection: Connection,
    inside: Mapping[str, Connection],
    lanes: Mapping[str, NetworkLane],
    lines: Mapping[str, np.ndarray],
) -> np.ndarray | None:
    """Return the line of a connection through its junction, None if it has none there."""
    parts, via = [], connection.via
    while via in lanes and len(parts) < 10:
        parts.append(lanes[via].points)
        via = inside[via].via if via in inside else ""
    if not parts:
        return None
    before, after = lines[connection.first], lines[connection.last]
    along, onward = direction(before, -1), direction(after, 0)
    line = np.concatenate([before[-1:], *parts, after[:1]])
    step = np.linalg.norm(np.diff(line, axis=0), axis=1)
    line = line[np.append(True, step > 1e-3)]
    if len(line) > 1 and np.linalg.norm(line[-1] - after[0]) > 0:
        line[-1] = after[0]
    if len(line) < 2:
        return None
    line = rounded(line)
    bent = [np.arccos(np.clip(direction(line, e) @ d, -1, 1)) for e, d in ((0, along), (-1, onward))]
    return curve(before[-1], along, after[0], onward) if max(bent) > KINK else line


def _priority(connection: Connection, is_left_hand: bool) -> int:
    """Return the rank of a connection: of main roads first, then straight on before turns, the near turn first."""
    near, far = ("l", "r") if is_left_hand else ("r", "l")
    kind = {"s": "straight", "t": "back", near: "right", far: "left"}.get(connection.direction.lower(), "straight")
    return 10 * (1 + (connection.state in "MOG")) + RANK[kind]


def _phases(
    network: Network, connections: list[Connection], lines: Mapping[str, np.ndarray]
) -> dict[tuple[str, str], str]:
    """Return the phase in which a lane that enters a junction has green, by junction and lane."""
    arms: dict[str, dict[str, list[str]]] = defaultdict(lambda: defaultdict(list))
    edge_of = {lane.id: edge for edge in network.roads for lane in edge.lanes}
    for connection in connections:
        if connection.light:
            edge = edge_of[connection.first]
            if connection.first not in arms[edge.end][edge.id]:
                arms[edge.end][edge.id].append(connection.first)
    found = {}
    for junction, entries in arms.items():
        heading = []
        for lanes in entries.values():
            x, y = -direction(lines[lanes[0]], -1)
            heading.append(float(np.arctan2(y, x) % (2 * np.pi)))
        order = np.argsort(heading, kind="stable").tolist()
        lanes_in = [list(entries.values())[k] for k in order]
        phases = assign_phases([heading[k] for k in order], [len(lanes) for lanes in lanes_in])
        if len(set(phases)) > 1:
            found |= {(junction, lane): phase for lanes, phase in zip(lanes_in, phases, strict=True) for lane in lanes}
    return found
