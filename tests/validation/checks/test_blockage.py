"""Closed forms of blockage against other ones."""

import numpy as np
import pytest
from scipy.special import fresnel, hankel2

from mmw.validation.checks.blockage import hankel, knife_edge_db, two_ray_db


@pytest.mark.parametrize("x", [8.5, 11.3, 64.0, 3000.0])
def test_hankel_functions_equal_those_of_scipy(x: float) -> None:
    order = np.arange(min(int(x) + 30, 120))
    np.testing.assert_allclose(hankel(len(order), x), hankel2(order, x), rtol=1e-5)  # the expansion has eight terms


def test_the_knife_edge_is_that_of_fresnel_integrals() -> None:
    clearance = np.linspace(-0.7, 3.0, 30)
    sine, cosine = fresnel(clearance)
    exact = -20.0 * np.log10(np.sqrt((1.0 - cosine - sine) ** 2 + (cosine - sine) ** 2) / 2.0)  # P.526, equation 30
    np.testing.assert_allclose(knife_edge_db(clearance), exact, atol=0.3)  # how well the approximation fits


def test_two_rays_over_a_conductor_cancel_or_add() -> None:
    """At grazing incidence a conductor reflects the vertical field by +1: the field has maxima of 6 dB."""
    distance = np.linspace(5000.0, 6000.0, 2000)
    level = two_ray_db(distance, (20.0, 20.0), 28e9, 1.0 - 1e9j)
    assert level.max() == pytest.approx(6.02, abs=0.05)
    assert level.min() < -20.0
