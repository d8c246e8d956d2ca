"""Plan fixed-time traffic lights for every junction, and decide when drivers stop at amber."""

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from math import ceil, pi

import numpy as np

from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.traffic.spawn import seeded

GREEN = 12.0
"""Green of every phase [s]; design value, 6 to 8 vehicles a lane."""

ALL_RED = 2.0
"""All phases red after amber [s]. Source: ITE, Traffic Engineering Handbook, 7th ed., chapter 10: 1 to 2 s."""

MIN_AMBER = 3.0
"""Shortest amber [s]. Source: MUTCD 2009, section 4D.26: 3 to 6 s."""

REACTION = 1.0
"""Time until a driver brakes for amber [s]. Source: ITE, as above."""

AMBER_BRAKING = 3.05
"""Largest deceleration for amber [m/s^2]. Source: ITE, as above: 10 ft/s^2."""

LEFT_TURN = 35 * pi / 180
"""Lanes that turn further to the left than this yield to oncoming traffic [rad]; as in the town kit's turn rules."""


@dataclass(frozen=True)
class SignalPlan:
    """The fixed-time plan of one junction."""

    phases: tuple[str, ...]
    """Names, in the order in which they become green."""
    amber: float
    """Length of amber [s]."""
    offset: float
    """Time since the first phase became green, at time 0 [s]."""

    def state(self, time: float) -> dict[str, str]:
        """Return `green`, `amber` or `red` of every phase at a time [s]."""
        share = GREEN + self.amber + ALL_RED
        turn, within = divmod((time + self.offset) % (share * len(self.phases)), share)
        shows = "green" if within < GREEN else "amber" if within < GREEN + self.amber else "red"
        return {phase: shows if index == int(turn) else "red" for index, phase in enumerate(self.phases)}


def make_plans(graph: LaneGraph, seed: int) -> dict[str, SignalPlan]:
    """Return the plan of every junction that has lights, by the junction's name; empty if none has.

    Amber lasts as long as the fastest driver that cannot stop needs: reaction + speed / (2 deceleration).
    Source: Gazis, Herman, Maradudin, Operations Research 8 (1960), 112, equation 4; ITE, as above.

    Args:
        graph: Lanes; those in a junction name their phase in `signal`.
        seed: Draws the offset of every junction.
    """
    found: dict[str, set[str]] = {}
    fastest: dict[str, float] = {}
    for lane in graph.lanes.values():
        if lane.signal:
            found.setdefault(lane.junction, set()).add(lane.signal)
            before = [graph.lanes[name].speed for name in graph.predecessors[lane.name]]
            fastest[lane.junction] = max([fastest.get(lane.junction, 0.0), lane.speed, *before])
    plans = {}
    for junction in sorted(found):
        phases = tuple(sorted(found[junction]))
        amber = max(MIN_AMBER, ceil(10 * (REACTION + fastest[junction] / (2 * AMBER_BRAKING))) / 10)
        generator = seeded(seed, zlib.crc32(junction.encode()))
        cycle = len(phases) * (GREEN + amber + ALL_RED)
        plans[junction] = SignalPlan(phases, amber, float(generator.uniform(0, cycle)))
    return plans


def signal_states(graph: LaneGraph, seed: int, time: float) -> dict[str, dict[str, str]]:
    """Return junction -> phase -> `green`, `amber` or `red` at a time since frame 0 [s]; empty without lights."""
    return {junction: plan.state(time) for junction, plan in make_plans(graph, seed).items()}


def light_state(states: Mapping[str, Mapping[str, str]], lane: Lane) -> str:
    """Return the state of the light of a lane through a junction, `green` where there is none."""
    return states[lane.junction][lane.signal] if lane.signal and states else "green"


def must_stop(distance: float, speed: float) -> bool:
    """Return whether a driver can stop in comfort within a distance [m] from a speed [m/s] when the light turns amber.

    Source: Gazis, Herman, Maradudin, as above, equation 2.
    """
    return distance > REACTION * speed + speed**2 / (2 * AMBER_BRAKING)


def turns_left(lane: Lane) -> bool:
    """Return whether a lane through a junction turns left, and so yields to oncoming traffic of the same phase."""
    return float(np.unwrap(lane.headings)[-1] - lane.headings[0]) > LEFT_TURN
