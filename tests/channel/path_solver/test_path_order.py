"""Paths are sorted, and duplicates on coincident surfaces left out, as NumPy does it with whole columns."""

import numpy as np
import pytest
import warp as wp

from mmw.channel.links import Links
from mmw.channel.path_solver.path_order import paths_to_keep
from mmw.channel.path_solver.traced_paths import TracedPaths
from mmw.physics.em.interaction import DIFFRACTION, DIFFUSE, SPECULAR, TRANSMISSION
from mmw.scene.mounted_antennas import RadioDevices
from tests.oracles.path_order import rows_in_order

SURFACES = 12


def links_between(tx: np.ndarray, rx: np.ndarray) -> Links:
    """Return links of one frame between points [m]."""
    count = len(tx)
    ends = [RadioDevices(position, np.tile(np.eye(3), (count, 1, 1)), np.zeros((count, 3))) for position in (tx, rx)]
    return Links(*(np.zeros(count, dtype=np.int32) for _ in range(7)), *ends)


def random_paths(generator: np.random.Generator, count: int, depth: int, links: int) -> TracedPaths:
    """Return paths, most of them in few places, so that many are near each other by less than a millimeter or more."""
    order = generator.integers(0, depth + 1, count).astype(np.int32)
    is_there = np.arange(depth) < order[:, None]
    kind = generator.choice([SPECULAR, TRANSMISSION, DIFFRACTION], (count, depth)).astype(np.int32)
    ray = np.full(count, -1, dtype=np.int32)
    diffuse = (order > 0) & (generator.random(count) < 0.2)
    kind[diffuse, 0], ray[diffuse] = DIFFUSE, generator.integers(0, 3, int(diffuse.sum()))
    places = np.array([[1.0, 2.0, 3.0], [4.0, -2.0, 3.0], [900.0, 0.0, 1.0]])
    at = places[generator.integers(0, len(places), (count, depth))]
    at = at + generator.choice([0.0, 1e-5, 9e-4, 1.1e-3, 1.0], (count, depth, 1)) * generator.normal(size=at.shape)
    bend = generator.choice([0.0, 0.09, 0.11, 1.0], (count, depth))
    normal = np.stack([np.sin(bend), np.zeros_like(bend), np.cos(bend)], axis=2)
    normal *= generator.choice([-1.0, 1.0], (count, depth, 1))
    normal[kind == DIFFRACTION] = 0.0
    surface = np.where(is_there, generator.integers(0, SURFACES, (count, depth)), -1).astype(np.int32)
    return TracedPaths(
        generator.integers(0, links, count).astype(np.int32),
        order,
        np.where(is_there, kind, 0).astype(np.int32),
        surface,
        np.where(is_there[..., None], at, np.nan),
        np.where(is_there[..., None], normal, np.nan),
        ray,
        np.where(ray == -1, 0.0, generator.random(count)),
    )


@pytest.mark.parametrize("depth", [1, 2, 4])
@pytest.mark.parametrize("count", [1, 2, 63, 700])
def test_rows_are_those_of_whole_columns(count: int, depth: int) -> None:
    generator = np.random.default_rng(100 * count + depth)
    links = 3
    tx, rx = generator.normal(size=(2, links, 3)) * 10.0
    area = generator.choice([1.0, 2.0, 3.0], SURFACES)  # many are equal
    origin = np.array([0.5, -3.0, 0.0])
    found = random_paths(generator, count, depth, links)
    host_area = wp.array(area, dtype=wp.float64, device="cpu")
    number = generator.permutation(links)  # of the link of each number that is given
    given = TracedPaths(np.argsort(number)[found.link].astype(np.int32), *found.columns[1:])
    kept = paths_to_keep(given, number, links_between(tx, rx), host_area, origin)
    wanted = found.take(rows_in_order(found, tx, rx, area, origin))
    for values, expected in zip(kept.columns, wanted.columns, strict=True):
        np.testing.assert_array_equal(values, expected)
        assert values.dtype == expected.dtype
    assert count < 700 or len(kept) < count, "no duplicate was made"
