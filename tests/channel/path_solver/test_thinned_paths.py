"""Thinning of diffuse paths against the variance that it may add, for weights over six decades."""

import numpy as np
import pytest

from mmw.channel.path_solver.thinned_paths import thin_out
from mmw.channel.path_solver.traced_paths import TracedPaths


def rays(count: int, first: int = 0) -> TracedPaths:
    """Return paths of rays that differ in their number and in their vertex, on one surface."""
    ints = np.zeros((count, 1), dtype=np.int32)
    ray = np.arange(first, first + count, dtype=np.int32)
    points = np.zeros((count, 1, 3))
    points[:, 0, 0] = ray
    return TracedPaths(ints[:, 0], ints[:, 0] + 1, ints + 2, ints, points, points, ray, np.full(count, 0.01))


@pytest.mark.parametrize("decades", [0.5, 3.0, 6.0])
def test_sums_keep_their_mean(decades: float) -> None:
    """40 sets of 20,000 paths: at most 1,000 stay, the mean is right, and the error below that of the formula."""
    rng, errors = np.random.default_rng(3), []
    for _ in range(40):
        weight = 10.0 ** (-decades * rng.random(20_000))
        kept = thin_out(rays(20_000), np.zeros(20_000, dtype=np.int64), weight, 1000)
        assert len(kept) <= 1001
        own = weight[kept.ray] * kept.solid_angle / 0.01
        errors.append(own.sum() / weight.sum() - 1.0)
    assert np.std(errors) < 1.0 / np.sqrt(1000) * 1.3
    assert abs(np.mean(errors)) < 4.0 / np.sqrt(1000 * 40)


def test_links_do_not_change_each_other_and_few_paths_stay() -> None:
    """Two links shuffled into each other are thinned as each alone; one with few paths keeps all."""
    rng = np.random.default_rng(5)
    weight = rng.random(3100)
    row = np.repeat([2, 0, 1], [1500, 1500, 100])
    paths = rays(3100)
    order = rng.permutation(3100)
    together = thin_out(paths.take(order), row[order], weight[order], 200)
    for link in range(3):
        own = row == link
        alone = thin_out(paths.take(np.flatnonzero(own)), 0 * row[own], weight[own], 200)
        mine = together.take(np.flatnonzero(np.isin(together.ray, paths.ray[own])))
        by_ray = np.argsort(mine.ray)
        np.testing.assert_array_equal(mine.ray[by_ray], np.sort(alone.ray))
        np.testing.assert_array_equal(mine.solid_angle[by_ray], alone.solid_angle[np.argsort(alone.ray)])
    assert np.isin(paths.ray[row == 1], together.ray).all()
