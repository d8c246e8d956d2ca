"""Pairs of boxes that overlap, and convex pieces cut by planes: what the geometric checks have in common."""

from collections.abc import Iterator
from itertools import product

import numpy as np
import warp as wp

from mmw.kernels.core.box_pairs import pairs_kernel

MIN_CELL = 0.25
"""Side of the smallest cell of the grid [m]; smaller boxes share it."""

CHUNK = 100_000_000
"""Candidates that are looked at together; bounds the memory."""

_HASH = np.uint64(0x9E3779B97F4A7C15)
"""Odd multiplier near 2^64 divided by the golden ratio: spreads cells over 64 bits. Source: Knuth, TAOCP 3, 6.4."""

Pairs = tuple[np.ndarray, np.ndarray]


def box_pairs(low_a: np.ndarray, high_a: np.ndarray, low_b: np.ndarray, high_b: np.ndarray) -> Iterator[Pairs]:
    """Yield every pair of a box of set a and another box of set b that overlap or touch, once, in chunks.

    Boxes of one power of two in size share a grid with cells of that size, where each lies in few cells; a pair is
    searched in the grid of its larger box and counted in the cell that holds the lowest corner of the intersection.

    Args:
        low_a: Lower corners of set a, shape [A, D]; the first three axes are meters, further ones are compared alike
            and span at most `MIN_CELL`.
        high_a: Upper corners, shape [A, D].
        low_b: The same for set b, shape [B, D].
        high_b: Upper corners, shape [B, D].
    """
    level_a, level_b = _levels(low_a, high_a), _levels(low_b, high_b)
    is_own = low_a is low_b and high_a is high_b
    for a, b in product(np.unique(level_a), np.unique(level_b)):
        if is_own and a > b:
            continue
        cell = np.full(low_a.shape[1], MIN_CELL)
        cell[:3] = MIN_CELL * 2.0 ** max(a, b)
        rows_a, rows_b = np.flatnonzero(level_a == a), np.flatnonzero(level_b == b)
        for i, j in _join(low_a[rows_a], high_a[rows_a], low_b[rows_b], high_b[rows_b], cell):
            kept = i < j if is_own and a == b else slice(None)
            yield rows_a[i[kept]], rows_b[j[kept]]


def own_pairs(low: np.ndarray, high: np.ndarray) -> Iterator[Pairs]:
    """Yield every pair of two different boxes of one set that overlap or touch, once; see `box_pairs`."""
    return box_pairs(low, high, low, high)


def _levels(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the power of two of the grid in which each box spans at most two cells an axis, shape [N]."""
    size = (high - low)[:, :3].max(axis=1, initial=MIN_CELL)
    return np.ceil(np.log2(size / MIN_CELL)).astype(np.int64)


def _cells(low: np.ndarray, high: np.ndarray, cell: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return every (box, cell) where the box reaches into the cell: box [rows], cell [rows, D], and key [rows]."""
    first, last = (np.floor(corner / cell).astype(np.int32) for corner in (low, high))
    box, where = np.arange(len(low), dtype=np.int32), first
    for axis in range(low.shape[1]):
        wide = np.flatnonzero((last[:, axis] > first[:, axis])[box])
        beside = where[wide]
        beside[:, axis] += 1
        box, where = np.concatenate([box, box[wide]]), np.concatenate([where, beside])
    key = np.zeros(len(box), dtype=np.uint64)
    for axis in range(low.shape[1]):
        key = key * _HASH + where[:, axis].astype(np.uint64)
    return box, where, key


def _join(
    low_a: np.ndarray, high_a: np.ndarray, low_b: np.ndarray, high_b: np.ndarray, cell: np.ndarray
) -> Iterator[Pairs]:
    box_b, _, key_b = _cells(low_b, high_b, cell)
    order = np.argsort(key_b, kind="stable")
    box_b, key_b = box_b[order], key_b[order]
    box_a, where, key_a = _cells(low_a, high_a, cell)
    span = np.stack([np.searchsorted(key_b, key_a, side) for side in ("left", "right")], axis=1)
    rows = np.flatnonzero(span[:, 1] > span[:, 0])
    if not len(rows):
        return
    ends = np.cumsum(span[rows, 1] - span[rows, 0])
    boxes = [_on_device(values, wp.float64) for values in (low_a, high_a, low_b, high_b, cell)]
    on_device_b, begin = _on_device(box_b, wp.int32), 0
    while begin < len(rows):
        done = ends[begin - 1] if begin else 0
        end = max(int(np.searchsorted(ends, done + CHUNK, "right")), begin + 1)
        chunk = rows[begin:end]
        cells = [_on_device(values[chunk], wp.int32) for values in (box_a, where)]
        row, j = _overlapping([*boxes, *cells, on_device_b], span[chunk])
        yield box_a[chunk[row]], j
        begin = end


def _overlapping(given: list[wp.array], span: np.ndarray) -> Pairs:
    """Return (row, box of set b) of the candidates that overlap; see `pairs_kernel` for its inputs."""
    given = [*given, _on_device(span, wp.int32)]
    offset, none = wp.empty(len(span), dtype=int, device="cpu"), wp.empty(0, dtype=int, device="cpu")
    wp.launch(pairs_kernel, len(span), inputs=[*given, False], outputs=[offset, none, none], device="cpu")
    count = offset.numpy().astype(np.int64)
    offset = _on_device(np.cumsum(count) - count, wp.int32)
    row, other = (wp.empty(int(count.sum()), dtype=int, device="cpu") for _ in range(2))
    wp.launch(pairs_kernel, len(span), inputs=[*given, True], outputs=[offset, row, other], device="cpu")
    return row.numpy(), other.numpy()


def _on_device(values: np.ndarray, dtype: type) -> wp.array:
    return wp.array(values, dtype=dtype, device="cpu")


def clip(points: np.ndarray, count: np.ndarray, normal: np.ndarray, offset: np.ndarray) -> Pairs:
    """Cut convex polygons by a half-space each: what is left has normal . p <= offset.

    Source: I. E. Sutherland and G. W. Hodgman, Communications of the ACM 17(1), 1974.

    Args:
        points: Corners in order, shape [P, K, D]; the first `count` of a row count.
        count: Corners of each polygon, shape [P].
        normal: Shape [P, D] or [D].
        offset: Shape [P], or a number.

    Returns:
        Corners, shape [P, K + 1, D], and their number, shape [P]; 0 where nothing is left.
    """
    rows, size, axes = points.shape
    column = np.arange(size)
    is_corner = column < count[:, None]
    height = (points * np.asarray(normal)[..., None, :]).sum(axis=2) - np.reshape(offset, (-1, 1))
    follower = np.where(column + 1 < count[:, None], column + 1, 0)
    row = np.arange(rows)[:, None]
    next_height = height[row, follower]
    is_in = height <= 0.0
    crosses = is_corner & (is_in != (next_height <= 0.0))
    fall = np.where(crosses, height - next_height, 1.0)
    cut = points + (points[row, follower] - points) * (height / fall)[..., None]
    both = np.stack([points, cut], axis=2).reshape(rows, 2 * size, axes)
    keep = np.stack([is_corner & is_in, crosses], axis=2).reshape(rows, 2 * size)
    order = np.argsort(~keep, axis=1, kind="stable")[:, : size + 1]
    return both[row, order], np.minimum(keep.sum(axis=1), size + 1)


def spiral(z: np.ndarray) -> np.ndarray:
    """Return unit vectors at heights z [N] that turn by the golden angle from one to the next, shape [N, 3]."""
    turn = 2.0 * np.pi * 0.6180339887498949 * np.arange(len(z))
    return np.stack([np.sqrt(1 - z * z) * np.cos(turn), np.sqrt(1 - z * z) * np.sin(turn), z], axis=1)


def area_and_centre(points: np.ndarray, count: np.ndarray) -> Pairs:
    """Return the area [P] and the middle [P, 2] of convex plane polygons [P, K, 2]; 0 and any place if empty."""
    column = np.arange(points.shape[1])
    used = np.where((column < count[:, None])[..., None], points, points[:, :1])
    local = used - points[:, :1]
    other = np.roll(local, -1, axis=1)
    cross = local[..., 0] * other[..., 1] - local[..., 1] * other[..., 0]
    twice = cross.sum(axis=1)
    weight = np.where(np.abs(twice) > 0.0, 3.0 * twice, 1.0)
    centre = (cross[..., None] * (local + other)).sum(axis=1) / weight[:, None] + points[:, 0]
    return 0.5 * np.abs(twice) * (count > 2), centre
