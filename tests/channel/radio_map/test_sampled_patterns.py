"""Functions as patterns of radio maps: the error of their samples, and the ones that cannot be sampled."""

import numpy as np
import pytest

from mmw.channel.antennas.patterns import PatternTable, pattern_components
from mmw.channel.radio_map.sampled_patterns import MAX_POWER_ERROR, pattern_table, power_error
from mmw.core.errors import InputError


def beam(width_deg: float):
    """Return a pencil beam along x, 3 dB at half the width off it."""
    steep = np.log(2.0) / (1.0 - np.cos(np.radians(width_deg) / 2.0))

    def pattern(theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
        return np.exp(0.5 * steep * (np.sin(theta) * np.cos(phi) - 1.0))

    return pattern


def test_a_table_is_used_as_it_is() -> None:
    table = PatternTable(np.array([0.0, np.pi]), np.array([0.0]), np.ones((2, 1)))
    assert pattern_table(table) is table


@pytest.mark.parametrize(("name", "bound"), [("dipole", 3.5e-6), ("hw_dipole", 5e-6), ("tr38901", 3e-5)])
def test_error_of_samples(name, bound: float) -> None:
    """The amplitude of known patterns, given as functions, anywhere, relative to the peak."""
    rng = np.random.default_rng(2)
    theta, phi = np.arccos(rng.uniform(-1, 1, 100_000)), rng.uniform(-np.pi, np.pi, 100_000)
    table = pattern_table(lambda theta, phi: pattern_components(name, theta, phi))
    exact = pattern_components(name, theta, phi)[0]
    smooth = np.ones(len(theta), dtype=bool)
    if name == "tr38901":  # the loss has a corner at 30 dB, where an error of first order is 50 times below the peak
        loss = 8.0 - 20 * np.log10(exact)
        smooth = loss < 29.0
        assert np.abs(table(theta, phi)[0] - exact).max() / exact.max() < 1e-3
    assert np.abs(table(theta, phi)[0] - exact)[smooth].max() / exact.max() < bound
    assert power_error(name, table) < 1e-4


def test_both_components_and_constants() -> None:
    table = pattern_table(lambda theta, phi: (1.0, 1j * np.cos(phi)))
    theta, phi = np.array([0.3, 2.0]), np.array([-3.14, 1.0])
    np.testing.assert_allclose(table(theta, phi)[0], 1.0)
    np.testing.assert_allclose(table(theta, phi)[1], 1j * np.cos(phi), atol=1e-5)
    assert power_error(lambda theta, phi: np.zeros_like(theta), table) == 0.0


def test_the_limit_is_the_mean_power() -> None:
    """A step at two edges is sampled; beams of 3 deg are, beams of 1 deg and fast phases are not."""
    sector = pattern_table(lambda theta, phi: np.where(np.abs(phi) < 1.0, 2.0, 0.1))
    assert 1e-4 < power_error(lambda theta, phi: np.where(np.abs(phi) < 1.0, 2.0, 0.1), sector) < MAX_POWER_ERROR
    table = pattern_table(beam(3.0))
    theta, phi = np.random.default_rng(3).normal(size=(2, 10_000)) * 0.02 + [[np.pi / 2], [0.0]]
    exact = pattern_components(beam(3.0), theta, phi)[0]
    assert np.abs(table(theta, phi)[0] ** 2 - exact**2).max() < 0.01
    for wrong in (beam(1.0), lambda theta, phi: np.exp(60j * phi)):
        with pytest.raises(InputError, match=r"changes too fast: sampled every 0.25 deg its power is off by .* % "):
            pattern_table(wrong)
    with pytest.raises(InputError, match="not finite"):
        pattern_table(lambda theta, phi: np.where(theta > 1.0, np.nan, 1.0))
