"""Matrices of quaternions, many at once, against those of USD, bit for bit, and against the quaternions themselves."""

import numpy as np
import pytest

from mmw.core.transforms import normalize, quaternion_to_matrix
from mmw.usd import orient_matrices as of_usd


@pytest.mark.parametrize(
    "scale", [(1, 1, 1, 1), (1e-3, 1e-3, 1, 1), (1e-9, 1e-10, 1e-10, -1), (0, 0, 1, 0), (0, 0, 0, 1)]
)
def test_matrices_are_those_of_usd(scale: tuple[float, ...]) -> None:
    """Slopes, vehicles on a plane, vector parts about the least length that is a turn, half turns, no turn.

    USD's angle is an arc cosine, which loses half of the digits of small turns: 3e-8.
    """
    q = normalize(np.random.default_rng(0).normal(size=(2000, 4)) * np.array(scale))
    assert of_usd.orient_matrices(q).tobytes() == np.ascontiguousarray(of_usd._matrices_by_usd(q)).tobytes()
    np.testing.assert_allclose(of_usd.orient_matrices(q), quaternion_to_matrix(q).swapaxes(1, 2), atol=1e-7)


def test_usd_makes_them_where_it_rounds_otherwise(monkeypatch: pytest.MonkeyPatch) -> None:
    """Builds for some processors fuse products and sums."""
    monkeypatch.setattr(of_usd, "_matrices_by_usd", lambda q: np.full((len(q), 3, 3), 0.5))
    of_usd.rounds_as_usd.cache_clear()
    try:
        assert (of_usd.orient_matrices(np.array([[0.0, 0.0, 0.0, 1.0]])) == 0.5).all()
    finally:
        of_usd.rounds_as_usd.cache_clear()
