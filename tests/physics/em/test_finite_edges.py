"""Share of the wave of an edge of finite length against the Fresnel integral, by quadrature in float64."""

import numpy as np
import pytest

from mmw.core.constants import SPEED_OF_LIGHT
from mmw.physics.em.finite_surfaces import finite_edge_share


def integral(low: float, high: float) -> complex:
    """Return exp(j pi/4) / sqrt(2) times the integral of exp(-j pi/2 w^2)."""
    node, weight = np.polynomial.legendre.leggauss(400)
    w = 0.5 * (high - low) * node + 0.5 * (low + high)
    return np.exp(0.25j * np.pi) / np.sqrt(2) * 0.5 * (high - low) * (weight * np.exp(-0.5j * np.pi * w**2)).sum()


@pytest.mark.parametrize(("before", "behind"), [(0.1, 0.1), (0.0, 0.4), (0.3, 0.05), (0.0, 0.02)])
def test_a_short_edge_has_the_share_of_its_fresnel_integral(before: float, behind: float) -> None:
    """Ends that are near the point of diffraction count in full: exact."""
    carriers, before_m, behind_m, sin_b = (4.9e9, 28e9), 12.0, 20.0, 0.8
    scale = sin_b * np.sqrt((before_m + behind_m) / (before_m * behind_m))
    share = finite_edge_share(*(np.array([v]) for v in (before, behind, scale)), carriers)
    for column, carrier in enumerate(carriers):
        wave = np.sqrt(2 * carrier / SPEED_OF_LIGHT) * scale
        assert max(before, behind) * wave < 3.0
        assert share[0, column] == pytest.approx(integral(-before * wave, behind * wave), abs=1e-12)


def test_a_long_edge_has_its_whole_wave_and_its_end_half() -> None:
    """Ends that are far away do not count."""
    share = finite_edge_share(np.array([50.0, 0.0]), np.array([80.0, 80.0]), np.array([0.4, 0.4]), (28e9,))
    np.testing.assert_allclose(share[:, 0], [1.0, 0.5], atol=1e-12)
