"""Propagate the nominal GPS constellation, 24 slots on circular orbits in six planes.

A slot is given by the right ascension of its ascending node and its argument of latitude at one epoch. Both then change
evenly: the argument of latitude by Kepler's third law, the node by the oblateness of the earth. The orbits of real
satellites deviate from their slots by up to 2 deg; no almanac is read.

Source: GPS Standard Positioning Service Performance Standard (October 2001), Table 3-1 and Table A-2-1; gravity and
rotation of the earth as in WGS-84 (IS-GPS-200).
"""

from datetime import UTC, datetime

import numpy as np
from numpy.typing import ArrayLike

SLOTS = {
    "A1": (272.847, 268.126), "A2": (272.847, 161.786), "A3": (272.847, 11.676), "A4": (272.847, 41.806),
    "B1": (332.847, 80.956), "B2": (332.847, 173.336), "B3": (332.847, 309.976), "B4": (332.847, 204.376),
    "C1": (32.847, 111.876), "C2": (32.847, 11.796), "C3": (32.847, 339.666), "C4": (32.847, 241.556),
    "D1": (92.847, 135.226), "D2": (92.847, 265.446), "D3": (92.847, 35.156), "D4": (92.847, 167.356),
    "E1": (152.847, 197.046), "E2": (152.847, 302.596), "E3": (152.847, 66.066), "E4": (152.847, 333.686),
    "F1": (212.847, 238.886), "F2": (212.847, 345.226), "F3": (212.847, 105.206), "F4": (212.847, 135.346),
}  # fmt: skip
"""Slot -> right ascension of the ascending node and argument of latitude at `SLOT_EPOCH` [deg]."""

SLOT_NAMES = tuple(SLOTS)
"""Names of the slots."""

SLOT_EPOCH = datetime(1993, 7, 1, tzinfo=UTC)
"""Epoch of the slots."""

SLOT_EPOCH_GREENWICH_DEG = 15.0 * (18.0 + 36.0 / 60.0 + 14.4 / 3600.0)
"""Greenwich hour angle at `SLOT_EPOCH`, 18 h 36 min 14.4 s [deg]."""

SEMI_MAJOR_AXIS_M = 26_559.7e3
"""Radius of the orbits [m]."""

INCLINATION_DEG = 55.0
"""Inclination of the orbits [deg]."""

NODE_RATE_DEG_S = -4.4874e-7
"""Rate of the right ascension of the nodes [deg/s]; Table A-2-1."""

GRAVITY_M3_S2 = 3.986005e14
"""Gravitational constant times mass of the earth [m^3/s^2]; WGS-84 value of IS-GPS-200."""

EARTH_RATE_RAD_S = 7.2921151467e-5
"""Rotation of the earth [rad/s]; WGS-84 value of IS-GPS-200."""


def seconds_since_slots(epoch: str) -> float:
    """Return the time from `SLOT_EPOCH` to a date and time of ISO 8601 [s]; UTC without a zone, no leap seconds."""
    when = datetime.fromisoformat(epoch)
    return ((when if when.tzinfo else when.replace(tzinfo=UTC)) - SLOT_EPOCH).total_seconds()


def satellite_positions(times: ArrayLike) -> np.ndarray:
    """Return the places of the satellites, earth-centered and earth-fixed [m], shape [T, 24, 3].

    Args:
        times: Times since `SLOT_EPOCH` [s], shape [T].
    """
    time = np.asarray(times, dtype=np.float64)[:, None]
    node, latitude = np.radians(np.array(list(SLOTS.values()))).T
    along = latitude + np.sqrt(GRAVITY_M3_S2 / SEMI_MAJOR_AXIS_M**3) * time
    turned = node + np.radians(NODE_RATE_DEG_S) * time  # against the stars
    longitude = turned - np.radians(SLOT_EPOCH_GREENWICH_DEG) - EARTH_RATE_RAD_S * time
    inclination = np.radians(INCLINATION_DEG)
    across = np.sin(along) * np.cos(inclination)
    return SEMI_MAJOR_AXIS_M * np.stack(
        [
            np.cos(along) * np.cos(longitude) - across * np.sin(longitude),
            np.cos(along) * np.sin(longitude) + across * np.cos(longitude),
            np.sin(along) * np.sin(inclination),
        ],
        axis=-1,
    )
