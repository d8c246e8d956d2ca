"""Roundabouts: each becomes ordinary nodes on a circle, joined by one-way arcs."""

import numpy as np

from mmw.core.errors import InputError
from mmw.worlds.towns.description import Junction, Road, Roundabout, TownDescription

RING_PRIORITY = 9
"""Priority of ring roads: circulating traffic goes first."""


def expand_roundabouts(
    description: TownDescription,
) -> tuple[dict[str, tuple[float, float, float]], list[Road], dict[str, Junction]]:
    """Return all nodes, roads and junction settings, with those that roundabouts stand for.

    Raises:
        InputError: If two neighboring arms of a roundabout are less than 30 or more than 150 deg apart.
    """
    nodes, roads, junctions = dict(description.nodes), list(description.roads), dict(description.junctions)
    for ring in description.roundabouts:
        order = sorted(ring.arms, key=lambda arm: ring.arms[arm] % 360)
        for k, arm in enumerate(order):
            after = order[(k + 1) % len(order)]
            begin = np.radians(ring.arms[arm])
            span = np.radians((ring.arms[after] - ring.arms[arm]) % 360)
            if not np.radians(30) <= span <= np.radians(150):
                raise InputError(
                    f"roundabout {ring.id!r}: arms {arm!r} and {after!r} are {np.degrees(span):.0f} deg apart; "
                    "30 to 150 deg are needed; move an arm"
                )
            x, y, z = ring.centre
            nodes[f"{ring.id}_{arm}"] = (x + ring.radius * np.cos(begin), y + ring.radius * np.sin(begin), z)
            roads.append(_ring_road(ring, arm, after, begin, span))
            junctions.setdefault(f"{ring.id}_{arm}", Junction(corner_radius=ring.corner_radius, parallel=True))
    return nodes, roads, junctions


def _ring_road(ring: Roundabout, arm: str, after: str, begin: float, span: float) -> Road:
    """Return the arc from one arm to the next: one corner point whose arc uses up both legs."""
    reach = ring.radius / np.cos(0.5 * span)
    corner = (
        float(ring.centre[0] + reach * np.cos(begin + 0.5 * span)),
        float(ring.centre[1] + reach * np.sin(begin + 0.5 * span)),
        ring.radius,
    )
    return Road.model_validate(
        {
            "id": f"{ring.id}_{arm}_{after}",
            "from": f"{ring.id}_{arm}",
            "to": f"{ring.id}_{after}",
            "profile": ring.profile,
            "speed": ring.speed,
            "via": [corner],
            "priority": RING_PRIORITY,
        }
    )
