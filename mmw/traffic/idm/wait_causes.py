"""Find out whether a stopped vehicle waits, directly or not, for a red light or for a moving vehicle."""

from collections.abc import Mapping, Sequence
from collections.abc import Set as AbstractSet

STANDING = 0.5
"""A vehicle slower than this counts as standing [m/s]."""


def find_causes(speed: Sequence[float], blockers: Mapping[int, Sequence[int]], at_red: AbstractSet[int]) -> list[bool]:
    """Return which vehicles stand with a cause.

    A standing vehicle has a cause if it waits for green, or for a vehicle that moves or stands with a cause. So the
    last vehicle of a queue has the cause of the first, and vehicles that wait for each other in a circle have none.

    Args:
        speed: Speed of every vehicle [m/s].
        blockers: Vehicle -> those it waits for: its leader in a queue, crossing vehicles, and those that occupy the
            room behind the junction.
        at_red: Vehicles that wait for green.

    Returns:
        One value a vehicle; False for moving ones.
    """
    stands = [value < STANDING for value in speed]
    found = [is_standing and index in at_red for index, is_standing in enumerate(stands)]
    is_settled = False
    while not is_settled:
        is_settled = True
        for index, others in blockers.items():
            if stands[index] and not found[index] and any(found[other] or not stands[other] for other in others):
                found[index], is_settled = True, False
    return found
