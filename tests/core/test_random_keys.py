"""Counter-based random numbers: the hash against integers in NumPy, moments, and independence of keys and counters."""

import numpy as np
import warp as wp

from mmw.core.random_keys import random_key, random_keys, stream_keys, stream_name
from mmw.kernels.core import noise
from tests.fixtures.kernels import launched

COUNT = 1 << 18


@wp.kernel
def draw_kernel(
    key: wp.vec2ui,
    draw: int,
    bits_out: wp.array[wp.vec4ui],
    uniform_out: wp.array[wp.vec4],
    normal_out: wp.array[wp.vec2],
):
    item = wp.tid()
    bits_out[item] = noise.random_bits(key, item, draw)
    u = noise.uniform4(key, item, draw)
    uniform_out[item] = u
    normal_out[item] = noise.normal2(u[0], u[1])


def draws(device: str, key: tuple[int, int], draw: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return tuple(launched(draw_kernel, COUNT, [wp.vec2ui(*key), draw], device))


def pcg4d(key: tuple[int, int], item: np.ndarray, draw: int) -> np.ndarray:
    """Compute the published hash in 64-bit integers, taken modulo 2^32."""
    mask = np.uint64(0xFFFFFFFF)
    x, y, z, w = (np.broadcast_to(np.uint64(v), item.shape).astype(np.uint64) for v in (*key, 0, draw))
    z = item.astype(np.uint64)
    x, y, z, w = ((v * np.uint64(1664525) + np.uint64(1013904223)) & mask for v in (x, y, z, w))
    for turn in range(2):
        x = (x + y * w) & mask
        y = (y + z * x) & mask
        z = (z + x * y) & mask
        w = (w + y * z) & mask
        if turn == 0:
            x, y, z, w = (v ^ (v >> np.uint64(16)) for v in (x, y, z, w))
    return np.stack([x, y, z, w], axis=1).astype(np.uint32)


def test_hash_equals_the_published_one(device: str) -> None:
    key = random_key(42, "town", "sunny")
    bits, _, _ = draws(device, key, 3)
    np.testing.assert_array_equal(bits, pcg4d(key, np.arange(COUNT), 3))


def test_numbers_are_uniform_and_normal(device: str) -> None:
    _, uniform, normal = draws(device, random_key(1, "a"))
    assert uniform.min() > 0.0 and uniform.max() < 1.0
    edge = np.sqrt(COUNT)
    for column in uniform.T:
        counts = np.bincount((column * 64).astype(int), minlength=64)
        chi2 = ((counts - COUNT / 64) ** 2 / (COUNT / 64)).sum()
        assert 63 - 5 * np.sqrt(126) < chi2 < 63 + 5 * np.sqrt(126)
    for column in normal.T:
        assert abs(column.mean()) < 5 / edge and abs(column.var() - 1) < 5 * np.sqrt(2) / edge
        assert abs((column**4).mean() - 3) < 5 * np.sqrt(96) / edge


def test_neighbours_are_independent() -> None:
    """Neighboring items, draws, frames and the words of one draw do not correlate."""
    _, here, _ = draws("cpu", random_key(1, "s", 10))
    others = [draws("cpu", random_key(1, "s", 10), 1)[1], draws("cpu", random_key(1, "s", 11))[1], np.roll(here, 1, 0)]
    for other in others:
        table = np.corrcoef(here.T, other.T)[:4, 4:]
        assert np.abs(table).max() < 6 / np.sqrt(COUNT)
    own = np.corrcoef(here.T) - np.eye(4)
    assert np.abs(own).max() < 6 / np.sqrt(COUNT)


def test_keys_differ_by_every_part() -> None:
    parts = [(seed, scenario, frame) for seed in range(3) for scenario in ("a", "b", "ab") for frame in range(50)]
    keys = random_keys(parts)
    assert keys.shape == (450, 2) and keys.dtype == np.uint32
    assert len({tuple(key) for key in keys}) == 450
    assert random_key("a", "bc") != random_key("ab", "c")


def test_parts_of_a_name_may_be_joined_before() -> None:
    parts = (42, "town", "sunny", "front", "cav_1", "12.3")
    joined = stream_name(42, stream_name("town", "sunny"), stream_name("front", "cav_1", "12.3"))
    np.testing.assert_array_equal(stream_keys([joined, joined]), random_keys([parts, parts]))
    assert tuple(stream_keys([joined])[0].tolist()) == random_key(*parts)
    assert stream_keys([]).shape == (0, 2) and stream_keys([]).dtype == np.uint32
