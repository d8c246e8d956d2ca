"""Rates of frames: which there are, and instants that frames of several rates share."""

from fractions import Fraction

import numpy as np
import pytest

from mmw.core.errors import InputError
from mmw.core.frame_rate import (
    FRAME_RATES,
    base_frames,
    check_frame_rate,
    instant_names,
    instants,
    pose_stride,
    seconds,
)

WANTED = (10, 20, 25, 50, 100, 200, 250, 500, 1000)


def test_rates_have_whole_milliseconds() -> None:
    assert set(WANTED) <= set(FRAME_RATES)
    assert all(Fraction(1000, rate).denominator == 1 for rate in FRAME_RATES)
    assert [check_frame_rate(rate) for rate in (10, 250.0)] == [10, 250]


@pytest.mark.parametrize(
    ("rate", "near"), [(30, "25 or 40"), (2000, "1000"), (0.5, "1"), (300.5, "250 or 500"), (-4, "1")]
)
def test_other_rates_name_the_nearest(rate: float, near: str) -> None:
    with pytest.raises(InputError, match=f"whole number of milliseconds.*; give {near}$"):
        check_frame_rate(rate)


@pytest.mark.parametrize("rate", FRAME_RATES)
def test_instants_are_those_of_fractions(rate: int) -> None:
    frames = np.array([0, 1, 2, 3, 7, 99, 12_345, 2_000_000])
    base, part = instants(frames, rate)
    for frame, one, more in zip(frames.tolist(), base.tolist(), part.tolist(), strict=True):
        assert Fraction(frame, rate) == Fraction(one, 100) + Fraction(more, 1000) and 0 <= more < 10
    np.testing.assert_allclose(seconds(frames, rate), frames / rate, rtol=1e-15)


@pytest.mark.parametrize("rate", FRAME_RATES)
def test_frames_at_one_time_are_one_instant(rate: int) -> None:
    """Frame n of any rate is frame n (1000 / rate) of 1000 Hz, to the bit; those of 100 Hz have the plain number."""
    frames = np.arange(50)
    fine = frames * (1000 // rate)
    assert instant_names(frames, rate) == instant_names(fine, 1000)
    assert seconds(frames, rate).tolist() == seconds(fine, 1000).tolist()
    assert instant_names([0, 7, 12], 100) == ["0", "7", "12"]
    assert len(set(instant_names(range(200), 1000))) == 200


@pytest.mark.parametrize("rate", FRAME_RATES)
def test_poses_are_at_most_ten_milliseconds_apart(rate: int) -> None:
    stride = pose_stride(rate)
    step = Fraction(1, rate * stride)
    assert step <= Fraction(1, 100) and (Fraction(1, rate) / step).denominator == 1
    assert (Fraction(1, rate) > Fraction(1, 100)) == (stride > 1)


@pytest.mark.parametrize("rate", FRAME_RATES)
@pytest.mark.parametrize("count", [1, 2, 3, 11, 101])
def test_base_frames_reach_the_last_frame_and_no_further(rate: int, count: int) -> None:
    last, needed = Fraction(count - 1, rate), base_frames(count, rate)
    assert Fraction(needed - 1, 100) >= last > Fraction(needed - 2, 100)
