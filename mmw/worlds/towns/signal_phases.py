"""Phases of traffic lights: which arms of a junction have green together."""

from itertools import combinations

import numpy as np

OPPOSITE = np.radians(35)
"""Two arms face each other if the angle between them differs from 180 deg by less than this [rad]; design value. Then
only a left turn of one crosses oncoming traffic of the other."""


def assign_phases(heading: list[float], lanes_in: list[int]) -> list[str]:
    """Return the phase of every arm of a junction with traffic lights.

    Arms that face each other share a phase, best pairs first; every other arm has one of its own.

    Args:
        heading: Direction of every arm away from the node [rad], arms counter-clockwise.
        lanes_in: Lanes of every arm that lead to the node (count).

    Returns:
        `a`, `b`, ... in the order of the arms; empty for an arm that no lane comes from.
    """
    arms = [k for k, count in enumerate(lanes_in) if count]
    apart = []
    for i, j in combinations(arms, 2):
        miss = abs(float((heading[j] - heading[i]) % (2 * np.pi) - np.pi))
        if miss < OPPOSITE:
            apart.append((miss, i, j))
    partner: dict[int, int] = {}
    for _, i, j in sorted(apart):
        if i not in partner and j not in partner:
            partner[i], partner[j] = j, i
    phases = [""] * len(heading)
    for k in arms:
        if not phases[k]:
            letter = chr(ord("a") + len(set(phases) - {""}))
            phases[k] = letter
            if k in partner:
                phases[partner[k]] = letter
    return phases
