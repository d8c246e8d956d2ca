"""Pairs of boxes that overlap, and convex pieces cut by planes: what the geometric checks have in common."""

from collections.abc import Iterator
from typing import Literal

import numpy as np
import warp as wp

from mmw.core.errors import InputError
from mmw.kernels.core.box_pairs import pairs_kernel

CHUNK = 2_000_000
"""Pairs that are looked at together; bounds the memory."""

MAX_PAIRS = 50_000_000
"""Pairs that are looked at in all; design value, a shipped town has a few million."""

Pairs = tuple[np.ndarray, np.ndarray]


def box_pairs(low_a: np.ndarray, high_a: np.ndarray, low_b: np.ndarray, high_b: np.ndarray) -> Iterator[Pairs]:
    """Yield every pair of a box of set a and a box of set b that overlap or touch, once, in chunks.

    Sweep and prune: along the first axis, of two boxes that overlap one begins within the other.

    Args:
        low_a: Lower corners of set a, shape [A, D].
        high_a: Upper corners, shape [A, D].
        low_b: The same for set b, shape [B, D].
        high_b: Upper corners, shape [B, D].
    """
    for i, j in _begun_within(low_a, high_a, low_b, high_b, "left"):
        yield i, j
    for j, i in _begun_within(low_b, high_b, low_a, high_a, "right"):
        yield i, j


def own_pairs(low: np.ndarray, high: np.ndarray) -> Iterator[Pairs]:
    """Yield every pair of two different boxes of one set that overlap or touch, once; see `box_pairs`."""
    order = np.argsort(low[:, 0], kind="stable")
    for i, j in _begun_within(low[order], high[order], low[order], high[order], None):
        yield order[i], order[j]


def _begun_within(
    low_a: np.ndarray, high_a: np.ndarray, low_b: np.ndarray, high_b: np.ndarray, side: Literal["left", "right"] | None
) -> Iterator[Pairs]:
    """Yield the pairs in which b begins within a along the first axis.

    At the begin of a, from the `left` or from the `right` of boxes that begin there too; None if both are the same
    sorted set: behind a itself.
    """
    order = np.argsort(low_b[:, 0], kind="stable")
    begins = low_b[order, 0]
    first = np.arange(1, len(begins) + 1) if side is None else np.searchsorted(begins, low_a[:, 0], side)
    span = np.stack([first, np.searchsorted(begins, high_a[:, 0], "right")], axis=1)
    given = [_on_device(values, wp.float64) for values in (low_a, high_a, low_b, high_b)]
    given += [_on_device(order, wp.int32), _on_device(span, wp.int32)]
    counts, none = (wp.empty(size, dtype=int, device="cpu") for size in (len(low_a), 0))
    wp.launch(pairs_kernel, len(low_a), [*given, 0, False], [counts, none, none], device="cpu")
    ends = np.cumsum(counts.numpy(), dtype=np.int64)
    if len(ends) and ends[-1] > MAX_PAIRS:
        raise InputError(
            f"the stage: {ends[-1]:,} pairs of its faces overlap or touch; at most {MAX_PAIRS:,} are checked; remove "
            "repeated faces and meshes"
        )
    begin, done = 0, 0
    while begin < len(ends):
        end = max(int(np.searchsorted(ends, done + CHUNK, "right")), begin + 1)
        offset = _on_device(np.append(0, ends[begin : end - 1] - done), wp.int32)
        a, b = (wp.empty(int(ends[end - 1]) - done, dtype=int, device="cpu") for _ in range(2))
        wp.launch(pairs_kernel, end - begin, [*given, begin, True], [offset, a, b], device="cpu")
        yield a.numpy(), b.numpy()
        begin, done = end, int(ends[end - 1])


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
        Corners, shape [P, Q, D], and their number, shape [P]; 0 where nothing is left. A cut adds a corner; where
        several corners lie in the plane, rounding may put them on both sides in turn, with a cut between any two.
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
    left = keep.sum(axis=1)
    order = np.argsort(~keep, axis=1, kind="stable")[:, : max(1, int(left.max(initial=0)))]
    return both[row, order], left


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
