"""Generate random series with random access by frame: white noise, random walk, first-order Gauss-Markov noise.

White noise is a function of (key, frame). A random walk and a Gauss-Markov series are sums over all earlier frames, so
their values are drawn from coarse to fine instead: both ends of a span of 2^31 frames first, then the middle of the
span, then the middles of its halves, and so on down to the frame. The middle of a span given its ends is normal for
both processes, with mean and standard deviation in closed form, so the values have exactly the distribution of the
sums. Every node of the tree has its own counter of the generator. A frame costs 31 nodes, n consecutive frames about
2 n at any position, and no value depends on the other requested frames.

Frames are those of 100 Hz. Instants between two of them (`mmw.core.frame_rate.instants`) continue the same process: the
milliseconds of a frame are drawn one after the other, each given the one before and the frame at the end.

Source: Brownian bridge, P. Levy, "Processus stochastiques et mouvement brownien" (1948); the middle of a first-order
Gauss-Markov (Ornstein-Uhlenbeck) series follows from its correlation exp(-|t| / T) by conditioning a normal vector.
"""

import math
from collections.abc import Callable
from functools import lru_cache

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from mmw.core.frame_rate import SPAN
from mmw.core.packed_arrays import Layout, borrow_arrays
from mmw.core.repeated_launch import launch_again
from mmw.kernels.core import random_series as kernels

DEPTH = 31
"""Levels of the tree: frames from 0 to 2^31 - 1, the range of the tables' `frame` column (248 days)."""

WORDS = 4
"""Words, and normal numbers, of one draw of the generator."""


def philox(key: ArrayLike, counter: ArrayLike) -> np.ndarray:
    """Return four independent 32-bit words for every key and counter, shape [..., 4], uint32.

    Args:
        key: Key of the stream, two 32-bit words, shape [..., 2]; leading shapes broadcast.
        counter: Position in the stream, four 32-bit words, shape [..., 4].

    Source: Philox4x32-10, J. Salmon et al., "Parallel random numbers: as easy as 1, 2, 3" (2011).
    """
    key, counter = np.asarray(key), np.asarray(counter)
    shape = np.broadcast_shapes(key.shape[:-1], counter.shape[:-1])
    keys = key if key.ndim == 1 else np.broadcast_to(key, (*shape, 2))
    out = np.empty((*shape, WORDS), dtype=np.uint32)
    inputs = (
        (keys.reshape(-1, 2), wp.vec2ui),
        (np.broadcast_to(counter, (*shape, WORDS)).reshape(-1, WORDS), wp.vec4ui),
    )
    arrays = [wp.array(values.astype(np.uint32), dtype=kind, device="cpu") for values, kind in inputs]
    words = wp.array(out.reshape(-1, WORDS), dtype=wp.vec4ui, device="cpu", copy=False)
    launch_again(kernels.philox_kernel, words.shape, [*arrays, words], "cpu")
    return out


def white_series(keys: ArrayLike, frames: ArrayLike, count: int, parts: ArrayLike = 0) -> np.ndarray:
    """Return independent standard normal numbers for each frame, shape [A, F, count].

    Args:
        keys: Keys of the streams, shape [A, 2], uint32, from `mmw.core.random_keys`.
        frames: Frame numbers, 0 to 2^31 - 1, in any order, shape [F].
        count: Number of values per frame.
        parts: Milliseconds since the frame, 0 to 9, shape [F], or one for all.

    Raises:
        ValueError: If a frame is out of range.
    """
    return _drawn(keys, frames, parts, count, None)


def random_walk(keys: ArrayLike, frames: ArrayLike, count: int, parts: ArrayLike = 0) -> np.ndarray:
    """Return random walks, 0 at frame 0, whose steps from frame to frame are independent standard normal numbers.

    Args and Raises as `white_series`; shape [A, F, count].
    """
    return _drawn(keys, frames, parts, count, _walk())


def gauss_markov(
    keys: ArrayLike, frames: ArrayLike, count: int, correlation_frames: float, parts: ArrayLike = 0
) -> np.ndarray:
    """Return stationary series of variance 1 whose values n frames apart correlate by exp(-n / correlation_frames).

    Such a series follows x[k + 1] = p x[k] + sqrt(1 - p^2) N(0, 1) with p = exp(-1 / correlation_frames).

    Args and Raises as `white_series`; shape [A, F, count].
    """
    return _drawn(keys, frames, parts, count, _markov(correlation_frames))


@lru_cache(maxsize=1)
def _walk() -> kernels.Process:
    """Return the process of a random walk."""

    def step(left: float) -> tuple[float, float, float]:
        return left / (left + 1.0), 1.0 / (left + 1.0), np.sqrt(left / (left + 1.0) / SPAN)

    half = 2.0 ** np.arange(-1, DEPTH)
    return _process(np.full(DEPTH + 1, 0.5), np.sqrt(0.5 * half), (0.0, math.sqrt(2.0**DEPTH), 1.0), step)


@lru_cache(maxsize=64)
def _markov(correlation_frames: float) -> kernels.Process:
    """Return the process of a first-order Gauss-Markov series."""
    half = 2.0 ** np.arange(-1, DEPTH) / correlation_frames
    decay = np.exp(-half)
    # Given both ends, p the correlation over half a span: mean p (left + right) / (1 + p^2), variance
    # (1 - p^2) / (1 + p^2).
    weight, spread = decay / (1.0 + decay**2), np.sqrt(np.tanh(half))
    # The whole span may be shorter than the correlation time: its ends are correlated.
    whole = 2.0**DEPTH / correlation_frames
    last, carry = float(np.sqrt(-np.expm1(-2.0 * whole))), float(np.exp(-whole))

    def step(left: float) -> tuple[float, float, float]:
        # With a = one and b = rest: weights sinh(b) / sinh(a + b) and sinh(a) / sinh(a + b), without large numbers.
        one, rest = 1.0 / (SPAN * correlation_frames), left / (SPAN * correlation_frames)
        low, high, whole = (-np.expm1(-2.0 * span) for span in (one, rest, one + rest))
        return np.exp(-one) * high / whole, np.exp(-rest) * low / whole, np.sqrt(low * high / whole)

    return _process(weight, spread, (1.0, last, carry), step)


def _process(
    weight: np.ndarray,
    spread: np.ndarray,
    ends: tuple[float, float, float],
    step: Callable[[float], tuple[float, float, float]],
) -> kernels.Process:
    """Return a Markov process.

    Args:
        weight: Weight of both ends in the mean of the middle of a span of 2^level frames, shape [DEPTH + 1].
        spread: Standard deviation of the middle about that mean, shape [DEPTH + 1].
        ends: Standard deviations of the value at frame 0, and of that at frame 2^DEPTH about a multiple of the first;
            the multiple.
        step: Returns, by the milliseconds from a step of one millisecond to the end of its frame, the weights of the
            value before and of the value at the end, and the standard deviation about their sum.
    """
    out = kernels.Process()
    out.weight, out.spread = (wp.array(values, dtype=wp.float64, device="cpu") for values in (weight, spread))
    out.first, out.last, out.carry = ends
    steps = [(0.0, 0.0, 0.0), *(step(float(SPAN - part)) for part in range(1, SPAN))]
    out.step = wp.array(np.array(steps), dtype=wp.float64, device="cpu")
    return out


def _drawn(
    keys: ArrayLike, frames: ArrayLike, parts: ArrayLike, count: int, process: "kernels.Process | None"
) -> np.ndarray:
    """Return a series at instants, shape [A, F, count]: white without a process."""
    streams, base = np.asarray(keys, dtype=np.uint32).reshape(-1, 2), np.asarray(frames, dtype=np.int64).reshape(-1)
    part = np.broadcast_to(np.asarray(parts, dtype=np.int64), base.shape)
    # Between two frames the later one is needed too.
    _check(base, base if process is None else base + (part > 0))
    draws = -(-count // WORDS)
    numbers: Layout = (base.shape, wp.int32)
    values: Layout = ((len(streams), len(base), draws), wp.vec4d)
    ends: Layout = ((0 if process is None else len(streams) * draws, DEPTH + 1, 2), wp.vec4d)
    block = borrow_arrays("cpu", ((len(streams),), wp.vec2ui), numbers, numbers, ends, values)
    block.host[0][:], block.host[1][:], block.host[2][:] = streams, base, part
    *inputs, scratch, out = block.arrays
    if process is None:
        launch_again(kernels.white_kernel, out.shape, [*inputs, out], "cpu")
    elif len(base):
        launch_again(kernels.markov_kernel, out.shape[::2], [*inputs, process, scratch, out], "cpu")
    drawn = block.host[-1].reshape(len(streams), len(base), draws * WORDS)[..., :count].copy()
    block.release()
    return drawn


def _check(first: np.ndarray, last: np.ndarray) -> None:
    if len(first) and not 0 <= first.min() <= last.max() < 2**DEPTH:
        raise ValueError(
            f"random series: frames {first.min()} to {last.max()}; a frame number is 0 to {2**DEPTH - 1}; "
            "give frames of a recording"
        )
