"""The nominal constellation: orbits by Kepler, places at the epoch, and a sky as receivers of middle latitudes have."""

import numpy as np
import pytest

from mmw.core.geodesy import geodetic_from_ecef, world_from_ecef
from mmw.sensors.gnss.constellation import (
    EARTH_RATE_RAD_S,
    SEMI_MAJOR_AXIS_M,
    SLOT_NAMES,
    SLOTS,
    satellite_positions,
    seconds_since_slots,
)
from mmw.sensors.gnss.position_fix import dilution


def test_places_at_the_epoch_by_rotations() -> None:
    """Each slot by turning a satellite on the x axis along its orbit, about the node, to its right ascension."""

    def turned(axis: int, angle: float) -> np.ndarray:
        c, s = np.cos(angle), np.sin(angle)
        i, j = [k for k in range(3) if k != axis]
        matrix = np.eye(3)
        matrix[i, i] = matrix[j, j] = c
        matrix[i, j], matrix[j, i] = (s, -s) if axis == 1 else (-s, s)
        return matrix

    found = satellite_positions([0.0])[0]
    greenwich = np.radians(279.06)  # 18 h 36 min 14.4 s at 15 deg an hour
    for name, place in zip(SLOT_NAMES, found, strict=True):
        node, along = np.radians(SLOTS[name])
        orbit = turned(2, node - greenwich) @ turned(0, np.radians(55.0)) @ turned(2, along)
        np.testing.assert_allclose(place, orbit @ [SEMI_MAJOR_AXIS_M, 0, 0], atol=1e-3)


def test_orbits_take_half_a_sidereal_day() -> None:
    """Ground tracks repeat after a sidereal day, within the 2 deg to which the slots are kept."""
    day = 2.0 * np.pi / EARTH_RATE_RAD_S
    times = np.arange(0.0, day, 600.0)
    one, next_day = satellite_positions(times), satellite_positions(times + day)
    np.testing.assert_allclose(np.linalg.norm(one, axis=-1), SEMI_MAJOR_AXIS_M, rtol=1e-12)
    cosine = (one * next_day).sum(axis=-1) / SEMI_MAJOR_AXIS_M**2
    assert np.degrees(np.arccos(cosine.clip(-1.0, 1.0))).max() < 2.0
    latitude = geodetic_from_ecef(one)[..., 0]
    assert 54.0 < latitude.max() < 55.5 and -55.5 < latitude.min() < -54.0


@pytest.mark.parametrize("latitude", [22.3, 35.0, 49.0])
def test_the_sky_of_middle_latitudes(latitude: float) -> None:
    """24 satellites give 6 to 11 above 5 deg; dilution of precision of GPS under open sky is 0.8 to 1.4 and 1.1 to 2.3.

    Mean of VDOP / HDOP 1.474 with the almanac of 2008, D. Milbert, "Dilution of precision revisited", NAVIGATION 55
    (2008), abstract; with fewer satellites than then it is within 0.2.
    """
    times = seconds_since_slots("2026-06-21T00:00:00Z") + np.arange(0.0, 86_400.0, 600.0)
    satellites = world_from_ecef(satellite_positions(times), (latitude, 8.0, 0.0))
    direction = satellites / np.linalg.norm(satellites, axis=-1, keepdims=True)
    is_up = direction[..., 2] > np.sin(np.radians(5.0))
    assert 7.5 < is_up.sum(axis=1).mean() < 9.0
    assert is_up.sum(axis=1).min() >= 5 and is_up.sum(axis=1).max() <= 12
    hdop, vdop = np.array([dilution(some[up]) for some, up in zip(direction, is_up, strict=True)]).T
    assert 0.8 < np.median(hdop) < 1.1 and 1.2 < np.median(vdop) < 1.7
    assert np.median(vdop / hdop) == pytest.approx(1.474, abs=0.2)


def test_epochs_have_zones() -> None:
    assert seconds_since_slots("1993-07-01T00:00:00Z") == 0.0
    assert seconds_since_slots("1993-07-01T02:00:30") == 7230.0
    assert seconds_since_slots("1993-07-01T02:00:00+02:00") == 0.0
