"""Integrate antenna patterns: radiated power and directivity. No pattern is normalized; these tell how it stands."""

import numpy as np

from mmw.channel.antennas.patterns import Pattern, pattern_components
from mmw.core.errors import InputError

NODES = (128, 256)
"""Directions of the integration along cosine of the zenith and azimuth."""


def radiated_power(pattern: Pattern) -> float:
    """Return the gain of a pattern averaged over the sphere, 1/(4 pi) integral of |C_theta|^2 + |C_phi|^2 [-].

    It is the power that leaves the antenna over that of an isotropic one with the same input: 1 for a lossless antenna,
    less with losses, and above 1 for a pattern that a lossless antenna cannot have. The sum is accurate to 1e-4 for
    patterns with features of 5 degrees or more.

    Args:
        pattern: A name, a `PatternTable` or a function (see `mmw.channel.antennas.patterns.pattern_components`).

    Raises:
        InputError: If it is no pattern.

    Source: C. A. Balanis, Antenna Theory, sections 2.2 to 2.6.
    """
    rows, columns = NODES
    node, weight = np.polynomial.legendre.leggauss(rows)
    phi = (np.arange(columns) + 0.5) * 2.0 * np.pi / columns - np.pi
    theta, azimuth = np.meshgrid(np.arccos(node), phi, indexing="ij")
    return float(weight @ _gain(pattern, theta, azimuth).mean(axis=1)) / 2.0


def pattern_directivity(pattern: Pattern) -> float:
    """Return the largest gain of a pattern, of directions every degree, over its mean (`radiated_power`) [-].

    Args:
        pattern: As for `radiated_power`.

    Raises:
        InputError: If it is no pattern, or radiates nothing.
    """
    power = radiated_power(pattern)
    if power == 0.0:
        raise InputError("pattern_directivity: the pattern is 0 in all directions; one that radiates is needed")
    degree = np.pi / 180.0
    theta, phi = np.meshgrid(np.arange(181) * degree, np.arange(-180, 180) * degree, indexing="ij")
    return float(_gain(pattern, theta, phi).max()) / power


def _gain(pattern: Pattern, theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
    parts = pattern_components(pattern, theta.ravel(), phi.ravel())
    return sum(np.abs(part) ** 2 for part in parts).reshape(theta.shape)
