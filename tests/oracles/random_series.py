"""Random series in NumPy, all nodes of a tree at once: the oracle of the kernels behind `mmw.core.random_series`."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike

from mmw.core.frame_rate import SPAN
from mmw.core.random_series import DEPTH

ROUNDS = 10
"""Rounds of Philox4x32; the authors' recommended number."""

MULTIPLIERS = (np.uint64(0xD2511F53), np.uint64(0xCD9E8D57))
"""Constants of Philox4x32's two multiplications."""

WEYL_STEPS = (np.uint64(0x9E3779B9), np.uint64(0xBB67AE85))
"""Increments of the two key words after every round of Philox."""

PART_LEVEL = 64
"""Level of the counter of the first millisecond of a frame; those of the tree are below it."""

LOW, HIGH_SHIFT = np.uint64(0xFFFFFFFF), np.uint64(32)


def philox(key: ArrayLike, counter: ArrayLike) -> np.ndarray:
    """Return four independent 32-bit words for every key and counter, shape [..., 4], uint32.

    Args:
        key: Key of the stream, two 32-bit words, shape [..., 2]; leading shapes broadcast.
        counter: Position in the stream, four 32-bit words, shape [..., 4].

    Source: Philox4x32-10, J. Salmon et al., "Parallel random numbers: as easy as 1, 2, 3" (2011).
    """
    key, counter = np.asarray(key, dtype=np.uint64), np.asarray(counter, dtype=np.uint64)
    k0, k1 = key[..., 0], key[..., 1]
    c0, c1, c2, c3 = counter[..., 0], counter[..., 1], counter[..., 2], counter[..., 3]
    for _ in range(ROUNDS):
        one, two = MULTIPLIERS[0] * c0, MULTIPLIERS[1] * c2
        c0, c1 = (two >> HIGH_SHIFT) ^ c1 ^ k0, two & LOW
        c2, c3 = (one >> HIGH_SHIFT) ^ c3 ^ k1, one & LOW
        k0, k1 = (k0 + WEYL_STEPS[0]) & LOW, (k1 + WEYL_STEPS[1]) & LOW
    out = np.empty((*c0.shape, 4), dtype=np.uint32)  # two rounds have brought all words to this shape
    out[..., 0], out[..., 1], out[..., 2], out[..., 3] = c0, c1, c2, c3
    return out


def white_series(keys: ArrayLike, frames: ArrayLike, count: int, parts: ArrayLike = 0) -> np.ndarray:
    """Return `mmw.core.random_series.white_series`."""
    return _normal(keys, np.asarray(frames, dtype=np.int64), _levels(parts, 0), count)


def random_walk(keys: ArrayLike, frames: ArrayLike, count: int, parts: ArrayLike = 0) -> np.ndarray:
    """Return `mmw.core.random_series.random_walk`."""
    half = 2.0 ** np.arange(-1, DEPTH)

    def at_frames(wanted: np.ndarray) -> np.ndarray:
        return _bisect(keys, wanted, count, np.full(DEPTH + 1, 0.5), np.sqrt(0.5 * half), 0.0, np.sqrt(2.0**DEPTH))

    return _refined(keys, np.asarray(frames, dtype=np.int64), parts, count, at_frames, _walk_step)


def gauss_markov(
    keys: ArrayLike, frames: ArrayLike, count: int, correlation_frames: float, parts: ArrayLike = 0
) -> np.ndarray:
    """Return `mmw.core.random_series.gauss_markov`."""
    half = 2.0 ** np.arange(-1, DEPTH) / correlation_frames
    decay = np.exp(-half)
    # Given both ends, p the correlation over half a span: mean p (left + right) / (1 + p^2), variance
    # (1 - p^2) / (1 + p^2).
    weight, spread = decay / (1.0 + decay**2), np.sqrt(np.tanh(half))
    # The whole span may be shorter than the correlation time: its ends are correlated.
    whole = 2.0**DEPTH / correlation_frames
    last, carry = float(np.sqrt(-np.expm1(-2.0 * whole))), float(np.exp(-whole))

    def at_frames(wanted: np.ndarray) -> np.ndarray:
        return _bisect(keys, wanted, count, weight, spread, 1.0, last, carry)

    def step(left: float) -> tuple[float, float, float]:
        # With a = one and b = rest: weights sinh(b) / sinh(a + b) and sinh(a) / sinh(a + b), without large numbers.
        one, rest = 1.0 / (SPAN * correlation_frames), left / (SPAN * correlation_frames)
        low, high, whole = (-np.expm1(-2.0 * span) for span in (one, rest, one + rest))
        return np.exp(-one) * high / whole, np.exp(-rest) * low / whole, np.sqrt(low * high / whole)

    return _refined(keys, np.asarray(frames, dtype=np.int64), parts, count, at_frames, step)


def _walk_step(left: float) -> tuple[float, float, float]:
    """Return, for a step of a random walk by one millisecond, weights of start and end of a span, and the spread.

    Args:
        left: Milliseconds from the step to the end of the span.
    """
    return left / (left + 1.0), 1.0 / (left + 1.0), np.sqrt(left / (left + 1.0) / SPAN)


def _refined(
    keys: ArrayLike,
    frames: np.ndarray,
    parts: ArrayLike,
    count: int,
    at_frames: Callable[[np.ndarray], np.ndarray],
    step: Callable[[float], tuple[float, float, float]],
) -> np.ndarray:
    """Return a series at milliseconds within frames, given the series at frames, shape [A, F, count].

    A Markov process between two known values is drawn from the left: each value is normal given its left neighbor and
    the right end, with weights and spread from `step`.
    """
    parts = np.broadcast_to(np.asarray(parts, dtype=np.int64), frames.shape)
    if not parts.any():
        return at_frames(frames)
    base, back = np.unique(frames, return_inverse=True)
    value, end = at_frames(base), at_frames(base + 1)
    out = value[:, back]
    for part in range(1, int(parts.max()) + 1):
        near, far, spread = step(float(SPAN - part))
        value = near * value + far * end + spread * _normal(keys, base, _levels(part, 0), count)
        out = np.where((parts == part)[:, None], value[:, back], out)
    return out


def _levels(parts: ArrayLike, level: int) -> np.ndarray:
    """Return the level of the counter of milliseconds in a frame; that of the frame itself is `level`."""
    parts = np.asarray(parts, dtype=np.int64)
    return np.where(parts == 0, level, PART_LEVEL + parts)


def _bisect(
    keys: ArrayLike,
    frames: ArrayLike,
    count: int,
    weight: np.ndarray,
    spread: np.ndarray,
    first: float,
    last: float,
    carry: float = 1.0,
) -> np.ndarray:
    """Return the values of a tree at some frames, shape [A, F, count].

    Args:
        keys: As `white_series`.
        frames: As `white_series`.
        count: As `white_series`.
        weight: Weight of both ends in the mean of the middle of a span of 2^level frames, shape [DEPTH + 1].
        spread: Standard deviation of the middle about that mean, shape [DEPTH + 1].
        first: Standard deviation of the value at frame 0.
        last: Standard deviation of the value at frame 2^DEPTH about `carry` times the first.
        carry: See `last`.
    """
    wanted, back = np.unique(np.asarray(frames, dtype=np.int64), return_inverse=True)
    spans = [wanted]  # of every level, from the frames up to the single span that contains all
    for _ in range(DEPTH):
        parents = spans[-1] >> 1
        spans.append(parents[np.concatenate([np.ones(min(len(parents), 1), dtype=bool), np.diff(parents) > 0])])
    stop = np.cumsum([0, *(len(span) for span in spans[1:])])
    level = np.repeat(np.arange(1, DEPTH + 1), np.diff(stop))
    draws = _normal(keys, np.concatenate(spans[1:]), level, count)  # one call of the generator for the whole tree
    ends = _normal(keys, np.array([0, 1]), DEPTH + 1, count)
    left = first * ends[:, :1]
    right = carry * left + last * ends[:, 1:]
    left, right = (np.repeat(end, len(spans[DEPTH]), axis=1) for end in (left, right))
    for depth in range(DEPTH, 0, -1):
        middle = weight[depth] * (left + right) + spread[depth] * draws[:, stop[depth - 1] : stop[depth]]
        parent = np.searchsorted(spans[depth], spans[depth - 1] >> 1)
        is_right = (spans[depth - 1] & 1).astype(bool)[:, None]
        left, right = (
            np.where(is_right, middle[:, parent], left[:, parent]),
            np.where(is_right, right[:, parent], middle[:, parent]),
        )
    return left[:, back]


def _normal(keys: ArrayLike, item: np.ndarray, level: ArrayLike, count: int) -> np.ndarray:
    """Return standard normal numbers for every key and (item, level), shape [A, N, count].

    Source: G. Box and M. Muller, "A note on the generation of random normal deviates" (1958).
    """
    draw = np.arange(-(-count // 4))
    counter = np.zeros((len(item), len(draw), 4), dtype=np.uint64)
    counter[..., 0] = item[:, None]
    counter[..., 1] = draw
    counter[..., 2] = np.asarray(level)[..., None]
    bits = philox(np.asarray(keys).reshape(-1, 1, 1, 2), counter)
    uniform = (bits + 0.5) * 2.0**-32  # center of one of 2^32 cells: never zero, for the logarithm
    radius, angle = np.sqrt(-2.0 * np.log(uniform[..., ::2])), 2.0 * np.pi * uniform[..., 1::2]
    normal = np.empty((*radius.shape, 2))
    normal[..., 0], normal[..., 1] = radius * np.cos(angle), radius * np.sin(angle)
    return normal.reshape(*normal.shape[:2], 4 * len(draw))[..., :count]
