"""Turn rules: which lane leads to which across a junction, on which curve, and with which priority."""

from collections.abc import Sequence

import numpy as np

from mmw.core.errors import InputError
from mmw.traffic.roads.lane_graph import Lane
from mmw.worlds.towns.description import Junction
from mmw.worlds.towns.junctions import MARGIN, Arm, Pad, blend
from mmw.worlds.towns.roads import RoadBody
from mmw.worlds.towns.signal_phases import assign_phases
from mmw.worlds.towns.u_turns import KERB_CLEARANCE, MIN_U_TURN_RADIUS, u_turn

STRAIGHT = np.radians(35)
"""Turns below this angle count as straight on [rad]."""
RANK = {"straight": 3, "right": 2, "left": 1, "back": 0}
"""Among roads of one priority, priority of turns in right-hand traffic."""
MIN_RADIUS = 5.5
"""Minimum radius of a lane through a junction [m]: about the turning radius of a car's outer front wheel."""
CONCENTRIC = np.radians(60)
"""Right turns sharper than this run at a constant distance from the kerb [rad], so that long vehicles stay off it."""
ARC_STEP = np.radians(1.5)
"""Largest change of heading from one point of a lane to the next [rad]."""


def kind_of_turn(turn: float) -> str:
    """Return `straight`, `left` or `right` for a change of heading [rad], positive to the left."""
    if abs(turn) < STRAIGHT:
        return "straight"
    return "left" if turn > 0 else "right"


def incoming(body: RoadBody, is_start: bool) -> list[Lane]:
    """Return the lanes of a road that end at its start or at its end, from the middle outward."""
    count = len(body.section.forward)
    return list(body.lanes[count:] if is_start else body.lanes[:count])


def choose_turns(
    arms: list[Arm], lanes_in: list[int], lanes_out: list[int], settings: Junction
) -> list[tuple[int, int, int, int, str]]:
    """Return every turn at a junction but U-turns.

    The left lane turns left, the right lane turns right, every lane goes straight on into the lane of the same place.
    A lane that these rules leave without a turn, or that none leads to, gets the nearest one.

    Returns:
        Arm and lane before, arm and lane after, kind of turn.
    """
    found: dict[tuple[int, int, int, int], str] = {}
    heading = [arm.outward(0.0) for arm in arms]
    for i in range(len(arms)):
        n = lanes_in[i]
        options = []
        for j in range(len(arms)):
            if lanes_out[j] == 0 or n == 0 or i == j:
                continue
            turn = float((heading[j] - heading[i]) % (2 * np.pi) - np.pi)
            options.append((j, turn, kind_of_turn(turn)))
        for j, _, kind in options:
            m = lanes_out[j]
            if settings.parallel or kind == "straight" or len(options) == 1:
                for k in range(n):
                    found[(i, k, j, min(k, m - 1))] = kind
                for k in range(n, m):
                    found[(i, n - 1, j, k)] = kind
            elif kind == "left":
                found[(i, 0, j, 0)] = kind
            else:
                found[(i, n - 1, j, m - 1)] = kind
        for k in range(n):
            if options and not any(a == i and lane == k for a, lane, _, _ in found):
                j, _, kind = max(options, key=lambda option: option[1])
                found[(i, k, j, min(k, lanes_out[j] - 1))] = kind
    for j in range(len(arms)):
        for k in range(lanes_out[j]):
            fed = [way for way in found if way[2] == j]
            if fed and not any(way[3] == k for way in fed):
                nearest = max(fed, key=lambda way: (RANK[found[way]], -abs(way[3] - k), way))
                found[(nearest[0], nearest[1], j, k)] = found[nearest]
    return [(*way, kind) for way, kind in sorted(found.items())]


def build_turns(
    node: str,
    arms: list[Arm],
    trims: list[float],
    bodies: dict[str, RoadBody],
    settings: Junction,
    pad: Pad,
    is_signalled: bool,
) -> list[tuple[str, Lane]]:
    """Return the turns of a junction as lanes, each with the name of the lane that leads to it.

    Raises:
        InputError: If a lane ends here without a turn, a turn is too tight for a car, or no arm has room for a U-turn.
    """
    before = [incoming(bodies[arm.road.id], arm.is_start) for arm in arms]
    after = [incoming(bodies[arm.road.id], not arm.is_start) for arm in arms]  # they end at the other end
    ways = choose_turns(arms, [len(lanes) for lanes in before], [len(lanes) for lanes in after], settings)
    for i, lanes in enumerate(before):
        for k, lane in enumerate(lanes):
            if not any(way[0] == i and way[1] == k for way in ways):
                raise InputError(f"node {node!r}: lane {lane.name!r} ends here; join a road that leads on")
    heading = [arm.outward(0.0) for arm in arms]
    phases = assign_phases(heading, [len(lanes) for lanes in before]) if is_signalled else [""] * len(arms)
    made = []
    for i, k, j, m, kind in ways:
        first, last = before[i][k], after[j][m]
        h0, h1 = arms[i].outward(trims[i]) + np.pi, arms[j].outward(trims[j])
        p0, p1 = first.points[-1], last.points[0]
        bend = float((h0 - h1) % (2 * np.pi))  # to the right
        lead = MARGIN if CONCENTRIC < bend < np.pi else 0.0
        curve = blend(p0[:2], h0, p1[:2], h1, ARC_STEP, 1.0, lead)
        if curve.radius < MIN_RADIUS:
            raise InputError(
                f"node {node!r}: the way from {first.name!r} to {last.name!r} has a radius of {curve.radius:.1f} m; "
                f"{MIN_RADIUS} m or more are needed; increase corner_radius or the angle between the roads"
            )
        made.append(_turn_lane(node, first, last, curve.xy, 10 * arms[i].road.priority + RANK[kind], phases[i]))
    if settings.uturn:
        back = _u_turn_lanes(node, arms, trims, before, after, pad, phases)
        if not back:
            raise InputError(
                f"node {node!r}: uturn: true, but no arm has room to turn back; {MIN_U_TURN_RADIUS} m of radius and "
                f"{KERB_CLEARANCE} m from the kerbs are needed; increase corner_radius or `centre`, or remove uturn"
            )
        made += back
    return made


def _u_turn_lanes(
    node: str,
    arms: list[Arm],
    trims: list[float],
    before: Sequence[Sequence[Lane]],
    after: Sequence[Sequence[Lane]],
    pad: Pad,
    phases: list[str],
) -> list[tuple[str, Lane]]:
    """Return the U-turns from the innermost lane of every arm that has room for one."""
    kerbs = [corner.table[:, 0, :2] for corner in pad.corners]
    made = []
    for i, arm in enumerate(arms):
        if not before[i] or not after[i]:
            continue
        first, heading = before[i][0], arm.outward(trims[i]) + np.pi
        exits = [lane.points[0, :2] for lane in after[i]]
        found = u_turn(first.points[-1, :2], heading, exits, pad.outline, kerbs, ARC_STEP)
        if found is not None:
            lane, xy = found
            made.append(_turn_lane(node, first, after[i][lane], xy, 10 * arm.road.priority + RANK["back"], phases[i]))
    return made


def _turn_lane(node: str, first: Lane, last: Lane, xy: np.ndarray, priority: int, phase: str) -> tuple[str, Lane]:
    p0, p1 = first.points[-1], last.points[0]
    points = np.column_stack([xy, np.linspace(p0[2], p1[2], len(xy))])
    points[0], points[-1] = p0, p1
    lane = Lane(
        f"{node}_{first.name}_{last.name}",
        points,
        min(first.width, last.width),
        min(first.speed, last.speed),
        node,
        priority,
        (last.name,),
        signal=phase,
    )
    return first.name, lane
