"""Permittivities, reflection coefficients and antenna patterns against values worked out by hand, and against laws."""

import numpy as np
import pytest

from mmw.channel.antennas import antenna_field, pattern_amplitude
from mmw.channel.fresnel import reflection
from mmw.channel.materials import PERMITTIVITY, permittivity_table, relative_permittivity
from mmw.constants import SPEED_OF_LIGHT, VACUUM_PERMITTIVITY
from mmw.materials import RadioMaterial
from mmw.poses import quaternion_from_ypr, quaternion_to_matrix
from tests.scenes import material

ANGLES = np.radians(np.linspace(0.0, 89.9, 200))


def itu(name: str, carrier_hz: float) -> tuple[float, float]:
    value = relative_permittivity(RadioMaterial("itu", itu=name), carrier_hz)
    return value.real, -value.imag * 2 * np.pi * carrier_hz * VACUUM_PERMITTIVITY


def test_itu_values() -> None:
    assert itu("itu_concrete", 28e9) == pytest.approx((5.24, 0.0462 * 28**0.7822))
    assert itu("concrete", 4.9e9) == pytest.approx((5.24, 0.0462 * 4.9**0.7822))
    assert itu("itu_medium_dry_ground", 4.9e9) == pytest.approx((15 * 4.9**-0.1, 0.035 * 4.9**1.63))
    assert itu("itu_concrete", 140e9) == pytest.approx((5.17, 0.0145 * 140**1.09))
    assert itu("itu_marble", 60e9)[0] == pytest.approx(7.074)


@pytest.mark.parametrize(
    ("ground", "values"), [("very_dry", (2.5, 0.03)), ("medium_dry", (3.0, 0.4)), ("wet", (3.0, 2.5))]
)
def test_paper_grounds_at_28_ghz(ground: str, values: tuple[float, float]) -> None:
    assert itu(f"itu_{ground}_ground", 28e9) == pytest.approx(values)
    assert itu(f"itu_{ground}_grnd_28", 28e9) == pytest.approx(values)


def test_constant_material() -> None:
    radio = RadioMaterial("constant", relative_permittivity=2.5, conductivity=0.001)
    assert relative_permittivity(radio, 1e9) == pytest.approx(
        2.5 - 1j * 0.001 / (2 * np.pi * 1e9 * VACUUM_PERMITTIVITY)
    )


def test_frequency_outside_the_ranges() -> None:
    with pytest.raises(ValueError, match=r"'asphalt' \(itu_very_dry_ground\).* 15 GHz; .*1-10 GHz, 26.5-29.5 GHz"):
        permittivity_table((material("asphalt"),), [28e9, 15e9])
    assert np.isnan(permittivity_table((material("asphalt"),), [15e9], used=[])).all()


def test_unknown_material() -> None:
    with pytest.raises(ValueError, match=r"'itu_cheese' is not a radio material; use one of .*itu_concrete"):
        relative_permittivity(RadioMaterial("itu", itu="itu_cheese"), 28e9)


def test_every_row_has_a_range() -> None:
    for rows in PERMITTIVITY.values():
        assert all(0 < row.min_ghz < row.max_ghz and row.a >= 1 and row.c >= 0 for row in rows)


def test_brewster_angle() -> None:
    te, tm = reflection(np.array([4.0 + 0j]), np.cos(np.arctan([2.0])), np.zeros(1), 1e9)
    assert abs(tm[0]) < 1e-15
    assert te[0] == pytest.approx(-0.6)


@pytest.mark.parametrize("thickness", [0.0, 0.003, 0.1, 10.0])
def test_reflection_never_exceeds_one(thickness: float) -> None:
    rng = np.random.default_rng(1)
    eta = rng.uniform(1, 30, 200) - 1j * 10.0 ** rng.uniform(-6, 7, 200)
    for r in reflection(eta, np.cos(ANGLES), np.full(200, thickness), 28e9):
        assert np.isfinite(r).all()
        assert np.abs(r).max() <= 1 + 1e-12


def test_reflection_limits() -> None:
    carrier, eta = 28e9, np.full(200, 5.0 - 0.5j)
    half = reflection(eta, np.cos(ANGLES), np.zeros(200), carrier)
    thick = reflection(eta, np.cos(ANGLES), np.full(200, 5.0), carrier)
    np.testing.assert_allclose(half, thick, atol=1e-12)  # nothing comes back from the far side of a lossy slab
    assert half[0][0] == pytest.approx(-half[1][0])
    wave = SPEED_OF_LIGHT / carrier
    window = reflection(np.array([4.0 + 0j]), np.ones(1), np.array([wave / 4]), carrier)  # half a wave inside
    assert abs(window[0][0]) < 1e-12
    quarter = reflection(np.array([4.0 + 0j]), np.ones(1), np.array([wave / 8]), carrier)
    assert quarter[0][0] == pytest.approx((1 - 4) / (1 + 4))
    conductor = reflection(np.full(200, 1 - 1e14j), np.cos(ANGLES), np.zeros(200), carrier)
    np.testing.assert_allclose(conductor[0], -1.0, atol=1e-6)
    np.testing.assert_allclose(conductor[1], 1.0, atol=1e-3)  # but for the last grazing angles


@pytest.mark.parametrize(
    ("pattern", "gain"), [("iso", 1.0), ("dipole", 1.5), ("hw_dipole", 1.643), ("tr38901", 6.3096)]
)
def test_pattern_gain_and_power(pattern: str, gain: float) -> None:
    theta = (np.arange(400) + 0.5) * np.pi / 400
    phi = (np.arange(400) + 0.5) * 2 * np.pi / 400 - np.pi
    grid = np.meshgrid(theta, phi, indexing="ij")
    amplitude = pattern_amplitude(pattern, *grid)
    assert (amplitude**2).max() == pytest.approx(gain, rel=1e-3)
    if pattern != "tr38901":  # the sector of TR 38.901 is an envelope that radiates less than it is fed
        power = (amplitude**2 * np.sin(grid[0])).sum() * (np.pi / 400) * (2 * np.pi / 400) / (4 * np.pi)
        assert power == pytest.approx(1.0, rel=2e-3)


def test_unknown_pattern() -> None:
    with pytest.raises(ValueError, match="'horn'; known patterns are iso"):
        pattern_amplitude("horn", np.zeros(1), np.zeros(1))


def test_tilted_dipole_radiates_along_its_own_axis() -> None:
    """A dipole that a 30 deg roll tilts has its null along the tilted axis, and its field in the plane of that axis."""
    rotation = quaternion_to_matrix(quaternion_from_ypr(0.4, 0.1, np.radians(30.0)))
    rng = np.random.default_rng(2)
    direction = rng.normal(size=(50, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    direction[0] = rotation[:, 2]
    field = antenna_field(direction, np.broadcast_to(rotation, (50, 3, 3)), "dipole", "V")[:, 0]
    theta, phi = np.arccos(direction[:, 2]), np.arctan2(direction[:, 1], direction[:, 0])
    theta_hat = np.stack([np.cos(theta) * np.cos(phi), np.cos(theta) * np.sin(phi), -np.sin(theta)], axis=1)
    phi_hat = np.stack([-np.sin(phi), np.cos(phi), 0 * phi], axis=1)
    vector = field[:, :1] * theta_hat + field[:, 1:] * phi_hat
    axis = rotation[:, 2]
    across = direction * (direction @ axis)[:, None] - axis  # short dipole: minus the axis, projected across the ray
    np.testing.assert_allclose(vector, np.sqrt(1.5) * across, atol=1e-7)
