"""Place frames in time: rates, and instants that frames of any rate share.

Traffic is made at `FRAME_RATE_HZ` (100 Hz), and noise belongs to instants. A frame therefore has an instant on a grid
of milliseconds, given as the frame of 100 Hz at or before it and the milliseconds since then. Frames of two rates at
one time have one instant, so what is drawn or computed from it does not depend on the rate.
"""

from collections.abc import Iterable
from math import gcd

import numpy as np
from numpy.typing import ArrayLike

from mmw.core.constants import FRAME_DT, FRAME_RATE_HZ
from mmw.core.errors import InputError

MILLISECONDS = 1000
"""Instants per second: the frames of every rate fall on them."""

FRAME_RATES = tuple(rate for rate in range(1, MILLISECONDS + 1) if MILLISECONDS % rate == 0)
"""Rates of frames [Hz]: a frame takes a whole number of milliseconds."""

SPAN = MILLISECONDS // FRAME_RATE_HZ
"""Milliseconds from one frame of 100 Hz to the next."""


def check_frame_rate(rate_hz: float) -> int:
    """Return a rate of frames as a whole number.

    Raises:
        InputError: If it is not one of `FRAME_RATES`.
    """
    if rate_hz not in FRAME_RATES:
        near = nearest_values(rate_hz, FRAME_RATES)
        raise InputError(
            f"{rate_hz:g} Hz: a frame takes a whole number of milliseconds, at most 1000 frames a second; "
            f"give {' or '.join(near)}"
        )
    return int(rate_hz)


def nearest_values(value: float, known: Iterable[float]) -> list[str]:
    """Return the texts of the largest of some numbers that is not above a value, and of the smallest above it."""
    known = sorted(known)
    below, above = [one for one in known if one <= value][-1:], [one for one in known if one > value][:1]
    return [f"{one:.9g}" for one in below + above]


def pose_stride(rate_hz: int) -> int:
    """Return how many poses are held for each frame: derivatives are taken over 10 ms at most, whatever the rate."""
    period = MILLISECONDS // rate_hz
    return 1 if period <= SPAN else period // gcd(period, SPAN)


def base_frames(frame_count: int, rate_hz: int) -> int:
    """Return how many frames of 100 Hz cover a number of frames, the last one included."""
    return -(-(frame_count - 1) * MILLISECONDS // rate_hz // SPAN) + 1


def instants(frames: ArrayLike, rate_hz: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the frame of 100 Hz at or before each frame, and the milliseconds since then, int64 each."""
    base, part = np.divmod(np.asarray(frames, dtype=np.int64) * (MILLISECONDS // rate_hz), SPAN)
    return base, part


def instant_names(frames: ArrayLike, rate_hz: int) -> list[str]:
    """Return the name of each frame's instant, by which random numbers are drawn: `12` or `12.3`, see `instants`."""
    base, part = instants(frames, rate_hz)
    return [f"{one}.{more}" if more else f"{one}" for one, more in zip(base.tolist(), part.tolist(), strict=True)]


def seconds(frames: ArrayLike, rate_hz: int) -> np.ndarray:
    """Return the times of frames after the start of their scenario [s], the same to the bit at every rate."""
    base, part = instants(frames, rate_hz)
    return base * FRAME_DT + part / MILLISECONDS
