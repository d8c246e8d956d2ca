"""Sample antenna patterns that are functions, so that kernels can interpolate them."""

import numpy as np

from mmw.channel.antennas.patterns import Pattern, PatternTable, pattern_components
from mmw.core.errors import InputError

STEPS = 720
"""Steps of a sampled pattern in zenith, and half of those in azimuth: 0.25 deg, 33 MB. Of a smooth pattern the error is
at most step^2 / 8 times the second derivatives of its amplitude: 1e-5 of the peak for the sector of TR 38.901."""

MAX_POWER_ERROR = 0.01
"""Maximum mean error of the power of a sampled pattern, relative to its mean power: 0.04 dB. A pattern that steps at
some edges stays below; one whose beams are narrower than about 2 deg, or whose phase turns as fast, does not."""


def pattern_table(pattern: Pattern) -> PatternTable:
    """Return a pattern as a table: a table as it is, anything else sampled every 0.25 deg.

    Args:
        pattern: A table, a function (theta, phi) as of `pattern_components`, or a name.

    Raises:
        InputError: If a function returns values of another shape or none that are finite, or changes too fast.
    """
    if isinstance(pattern, PatternTable):
        return pattern
    theta, phi = np.linspace(0.0, np.pi, STEPS + 1), np.linspace(-np.pi, np.pi, 2 * STEPS + 1)[1:]
    table = PatternTable(theta, phi, *pattern_components(pattern, *np.meshgrid(theta, phi, indexing="ij")))
    error = power_error(pattern, table)
    if error > MAX_POWER_ERROR:
        raise InputError(
            f"radio map: pattern function changes too fast: sampled every {180 / STEPS:g} deg its power is off by "
            f"{100 * error:.3g} % on average, {100 * MAX_POWER_ERROR:g} % is the limit; give a PatternTable of a grid "
            "that is fine enough"
        )
    return table


def power_error(pattern: Pattern, table: PatternTable) -> float:
    """Return the mean error of a table's power in the middles of its grid, relative to the mean power of the pattern.

    It bounds the error of the power in any polarization: the mean of |F - F'| (|F| + |F'|) over the sphere.

    Args:
        pattern: The exact pattern.
        table: Samples of it.
    """
    middle = [0.5 * (axis[1:] + axis[:-1]) for axis in (table.theta, np.append(table.phi, table.phi[0] + 2 * np.pi))]
    theta, phi = np.meshgrid(middle[0], np.mod(middle[1] + np.pi, 2 * np.pi) - np.pi, indexing="ij")
    exact = np.stack(pattern_components(pattern, theta, phi))
    sampled = np.stack(table(theta, phi))
    size, other, apart = (np.sqrt((np.abs(field) ** 2).sum(axis=0)) for field in (exact, sampled, exact - sampled))
    power = (size**2 * np.sin(theta)).sum()
    return float((apart * (size + other) * np.sin(theta)).sum() / power) if power > 0.0 else 0.0
