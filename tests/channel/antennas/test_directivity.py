"""Radiated power and directivity of patterns against closed forms and a brute-force sum."""

import numpy as np
import pytest
from scipy.integrate import quad

from mmw.channel import PatternTable, pattern_directivity, radiated_power
from mmw.channel.antennas.patterns import Pattern, pattern_components


def brute_force(pattern: Pattern, count: int = 1000) -> float:
    """Return the mean gain over the sphere by the midpoint rule in zenith and azimuth."""
    theta, phi = (
        np.pi * (np.arange(count) + 0.5) / count,
        2 * np.pi * (np.arange(2 * count) + 0.5) / (2 * count) - np.pi,
    )
    theta, phi = np.repeat(theta, 2 * count), np.tile(phi, count)
    power = sum(np.abs(part) ** 2 for part in pattern_components(pattern, theta, phi))
    return float(np.mean(power * np.sin(theta)) * np.pi / 2)


def test_power_of_the_patterns_of_mmw() -> None:
    """A dipole of half a wavelength has 1.643 at most: its mean is off 1 by the rounding of that number."""
    assert radiated_power("iso") == pytest.approx(1.0, abs=1e-12)
    assert radiated_power("dipole") == pytest.approx(1.0, abs=1e-12)
    whole = quad(lambda theta: np.cos(np.pi / 2 * np.cos(theta)) ** 2 / np.sin(theta), 0.0, np.pi)[0]
    assert radiated_power("hw_dipole") == pytest.approx(1.643 * whole / 2, abs=1e-9)
    assert radiated_power("hw_dipole") == pytest.approx(1.0, abs=2e-3)
    assert radiated_power("tr38901") == pytest.approx(brute_force("tr38901"), abs=1e-5)
    assert 10 * np.log10(radiated_power("tr38901")) == pytest.approx(-1.83, abs=0.01)  # its 8 dBi hold losses


def test_directivity_of_the_patterns_of_mmw() -> None:
    assert pattern_directivity("iso") == pytest.approx(1.0, abs=1e-12)
    assert pattern_directivity("dipole") == pytest.approx(1.5, abs=1e-12)
    assert pattern_directivity("hw_dipole") == pytest.approx(1.6409, abs=1e-4)  # Balanis, equation 4-91: 1.643
    assert pattern_directivity("tr38901") * radiated_power("tr38901") == pytest.approx(10**0.8, rel=1e-12)


@pytest.mark.parametrize("exponent", [1, 2, 8, 40])
def test_power_of_a_horn(exponent: int) -> None:
    """cos^n x over the front half: directivity 2 (n + 1), at any level, in either component."""

    def horn(theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
        return np.maximum(np.sin(theta) * np.cos(phi), 0.0) ** (exponent / 2)

    closed = 1 / (2 * (exponent + 1))
    assert radiated_power(horn) == pytest.approx(closed, rel=1e-4)
    assert radiated_power(lambda theta, phi: (3j * horn(theta, phi), 4 * horn(theta, phi))) == pytest.approx(
        25 * closed, rel=1e-4
    )
    assert pattern_directivity(lambda theta, phi: 5 * horn(theta, phi)) == pytest.approx(2 * (exponent + 1), rel=1e-4)


def test_power_of_a_table() -> None:
    theta, phi = np.radians(np.arange(0, 181, 1.0)), np.radians(np.arange(0, 360, 10.0))
    table = PatternTable(theta, phi, np.repeat(np.sqrt(1.5) * np.sin(theta)[:, None], len(phi), axis=1))
    assert radiated_power(table) == pytest.approx(1.0, abs=1e-4)
    assert pattern_directivity(table) == pytest.approx(1.5, abs=2e-4)


def test_errors() -> None:
    with pytest.raises(ValueError, match="pattern is 0 in all directions"):
        pattern_directivity(lambda theta, phi: 0.0)
    with pytest.raises(ValueError, match="not finite"):
        radiated_power(lambda theta, phi: theta * np.nan)
    with pytest.raises(ValueError, match="'horn'; known patterns are iso"):
        radiated_power("horn")
