"""Random series: the generator's published answers, the laws of the series, any frames in any order."""

import numpy as np
import pytest

from mmw.core import random_series
from mmw.core.random_keys import random_keys
from mmw.core.random_series import gauss_markov, philox, random_walk, white_series
from tests.oracles import random_series as oracle

KEYS = random_keys([(1, "a"), (1, "b"), (2, "a")])

SERIES = {
    "white": lambda keys, frames: white_series(keys, frames, 6),
    "walk": lambda keys, frames: random_walk(keys, frames, 6),
    "markov": lambda keys, frames: gauss_markov(keys, frames, 6, 300.0),
}


@pytest.mark.parametrize(
    ("counter", "key", "words"),
    [
        ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
        ((2**32 - 1,) * 4, (2**32 - 1,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
        (
            (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
            (0xA4093822, 0x299F31D0),
            (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
        ),
    ],
)
def test_philox_gives_the_authors_known_answers(counter: tuple, key: tuple, words: tuple) -> None:
    """Source: kat_vectors of Random123 1.14.0, lines `philox4x32 10`."""
    assert tuple(philox(key, counter)) == words
    assert tuple(philox([key, (1, 2)], [[counter], [(5, 6, 7, 8)]])[0, 0]) == words


@pytest.mark.parametrize("name", ["white_series", "random_walk", "gauss_markov"])
def test_values_are_those_of_all_nodes_at_once(name: str) -> None:
    """The words are the same; logarithms and cosines of NumPy may differ in the last bits from those of a kernel.

    A value is a sum of 31 such numbers, so 1e-12 of the largest is far above their rounding.
    """
    frames, parts = np.array([0, 1, 2, 3, 500, 77, 77, 2**31 - 2, 10**6]), np.array([0, 3, 9, 0, 1, 2, 2, 5, 0])
    more = (300.0,) if name == "gauss_markov" else ()
    for part in (0, parts):
        found = getattr(random_series, name)(KEYS, frames, 6, *more, parts=part)
        wanted = getattr(oracle, name)(KEYS, frames, 6, *more, parts=part)
        np.testing.assert_allclose(found, wanted, rtol=0, atol=1e-12 * np.abs(wanted).max())


@pytest.mark.parametrize("name", SERIES)
def test_values_do_not_depend_on_the_frames_asked_for(name: str) -> None:
    whole = SERIES[name](KEYS, range(1000))
    assert whole.shape == (3, 1000, 6)
    for frames in (range(100, 200), [999, 3, 3, 500], range(1), range(0), [511, 512]):
        np.testing.assert_array_equal(SERIES[name](KEYS, frames), whole[:, list(frames)])
    np.testing.assert_array_equal(SERIES[name](KEYS[1:2], range(1000)), whole[1:2])
    np.testing.assert_array_equal(SERIES[name](KEYS, [7, 10**6, 2**31 - 1])[:, 0], whole[:, 7])


@pytest.mark.parametrize("name", SERIES)
def test_streams_differ(name: str) -> None:
    one, two, three = SERIES[name](KEYS, range(1, 40))
    assert not np.any(one == two)
    assert not np.any(one == three)
    assert len(np.unique(one[0])) == 6


@pytest.mark.parametrize("frames", [[-1], [5, 2**31]])
@pytest.mark.parametrize("name", SERIES)
def test_frames_out_of_range_are_refused(name: str, frames: list[int]) -> None:
    with pytest.raises(ValueError, match="a frame number is 0 to 2147483647"):
        SERIES[name](KEYS, frames)


def is_standard_white(values: np.ndarray) -> None:
    """Check independent columns [N, C] of standard normal numbers: each bound is five standard errors."""
    count = len(values)
    assert np.abs(values.mean(axis=0)).max() < 5 / np.sqrt(count)
    assert np.abs(values.var(axis=0) - 1).max() < 5 * np.sqrt(2 / count)
    assert np.abs(np.corrcoef(values.T) - np.eye(values.shape[1])).max() < 5 / np.sqrt(count)
    for lag in (1, 2, 3, 4, 8, 64):
        assert np.abs(np.mean(values[lag:] * values[:-lag], axis=0)).max() < 5 / np.sqrt(count)
    share = np.mean(np.abs(values) > 1.959964)
    assert abs(share - 0.05) < 5 * np.sqrt(0.05 * 0.95 / values.size)


@pytest.mark.parametrize("start", [0, 1_000_000, 2**30 - 20_000])
def test_steps_of_a_random_walk_are_white(start: int) -> None:
    walk = random_walk(KEYS[:1], range(start, start + 40_000), 6)[0]
    is_standard_white(np.diff(walk, axis=0))


def test_random_walk_spreads_with_the_square_root_of_time() -> None:
    keys = random_keys((3, k) for k in range(2000))
    walk = random_walk(keys, [0, 1, 37, 5000, 2**30 + 12345], 6)
    np.testing.assert_array_equal(walk[:, 0], 0.0)
    for k, frame in enumerate([1, 37, 5000, 2**30 + 12345], start=1):
        # 12,000 values: the standard error of a standard deviation is 0.65 %.
        assert walk[:, k].std() == pytest.approx(np.sqrt(frame), rel=0.03)
    # Steps over separate stretches are independent.
    assert abs(np.corrcoef(walk[:, 2].ravel(), (walk[:, 3] - walk[:, 2]).ravel())[0, 1]) < 5 / np.sqrt(12_000)


@pytest.mark.parametrize("correlation", [0.5, 20.0, 1e4])
def test_gauss_markov_follows_its_recursion(correlation: float) -> None:
    series = gauss_markov(KEYS[:1], range(777, 40_777), 6, correlation)[0]
    p = np.exp(-1.0 / correlation)
    is_standard_white((series[1:] - p * series[:-1]) / np.sqrt(1 - p**2))


@pytest.mark.parametrize("correlation", [1e-3, 50.0, 1e9, 1e15])
def test_gauss_markov_is_stationary(correlation: float) -> None:
    keys = random_keys((4, k) for k in range(2000))
    frames = [0, 30, 2**20, 2**31 - 1]
    series = np.moveaxis(gauss_markov(keys, frames, 6, correlation), 1, 0).reshape(4, -1)
    np.testing.assert_allclose(series.std(axis=1), 1.0, rtol=0.03)
    expected = np.exp(-np.abs(np.subtract.outer(frames, frames)) / correlation)
    np.testing.assert_allclose(np.corrcoef(series), expected, atol=5 / np.sqrt(12_000))


def test_white_series_is_white() -> None:
    is_standard_white(white_series(KEYS[:1], range(40_000), 6)[0])


def test_milliseconds_leave_the_frames_alone_and_do_not_depend_on_each_other() -> None:
    frames, parts = np.repeat(np.arange(5), 10), np.tile(np.arange(10), 5)
    for series in (
        lambda f, p: white_series(KEYS, f, 6, p),
        lambda f, p: random_walk(KEYS, f, 6, p),
        lambda f, p: gauss_markov(KEYS, f, 6, 300.0, p),
    ):
        whole = series(frames, parts)
        assert np.array_equal(whole[:, ::10], series(np.arange(5), 0))
        for some in ([3], [41, 7, 7], [10, 11], [0, 49]):
            assert np.array_equal(series(frames[some], parts[some]), whole[:, some])
        assert len(np.unique(whole[0, :, 0])) == 50


def test_milliseconds_of_a_walk_are_steps_of_a_tenth_of_the_variance() -> None:
    keys = random_keys([(3, n) for n in range(300)])
    frames, parts = np.divmod(np.arange(100, 141), 10)
    steps = np.diff(random_walk(keys, frames, 4, parts), axis=1)
    assert np.var(steps, axis=(0, 2)) == pytest.approx(np.full(40, 0.1), rel=0.25)
    flat = np.moveaxis(steps, 1, 0).reshape(40, -1)
    assert np.abs(np.corrcoef(flat) - np.eye(40)).max() < 0.15  # also across the border of two frames


@pytest.mark.parametrize("correlation", [300.0, 2.0, 0.05])
def test_milliseconds_of_a_gauss_markov_series_have_its_correlation(correlation: float) -> None:
    keys = random_keys([(4, n) for n in range(3000)])
    frames, parts = np.divmod(np.arange(503, 528), 10)
    series = np.moveaxis(gauss_markov(keys, frames, 4, correlation, parts), 1, 0).reshape(25, -1)
    lag = np.abs(np.subtract.outer(np.arange(25), np.arange(25))) / 10.0
    assert np.cov(series) == pytest.approx(np.exp(-lag / correlation), abs=0.06)
