"""Statistics of links against closed forms of two paths, SciPy and definitions written out."""

import numpy as np
import pytest
import scipy.stats

from mmw.channel import CarrierPaths
from mmw.channel import statistics as st
from tests.fixtures.path_tables import path_table, two_paths


def rows_with_an_empty_link() -> CarrierPaths:
    paths = CarrierPaths.from_table(path_table(), 28e9)
    return CarrierPaths(**{**vars(paths), "keys": np.concatenate([paths.keys, paths.keys[:1]])})


def test_two_paths_in_closed_form() -> None:
    """Powers 4 : 1, 50 ns and 300 Hz apart, 0.2 rad apart across the seam of the azimuth."""
    paths = two_paths([200e-9, 250e-9], [2e-5j, -1e-5], doppler_hz=[100.0, -200.0])
    paths = CarrierPaths(
        **{**vars(paths), "phi_t": np.array([np.pi - 0.1, -np.pi + 0.1]), "theta_r": np.array([1.0, 1.5])}
    )
    assert st.path_loss_db(paths).item() == pytest.approx(-10 * np.log10(5e-10), abs=1e-10)
    assert st.k_factor(paths).item() == pytest.approx(4.0, rel=1e-10)
    assert st.mean_delay(paths).item() == pytest.approx(210e-9, rel=1e-10)
    assert st.rms_delay_spread(paths).item() == pytest.approx(20e-9, rel=1e-10)  # sqrt(0.8 * 0.2) * 50 ns
    assert st.mean_doppler(paths).item() == pytest.approx(40.0, rel=1e-10)
    assert st.doppler_spread(paths).item() == pytest.approx(120.0, rel=1e-10)
    length = abs(0.8 + 0.2 * np.exp(0.2j))
    assert st.azimuth_spread(paths, "tx").item() == pytest.approx(np.sqrt(-2 * np.log(length)), rel=1e-10)
    length = abs(0.8 + 0.2 * np.exp(0.5j))
    assert st.zenith_spread(paths, "rx").item() == pytest.approx(np.sqrt(-2 * np.log(length)), rel=1e-10)
    assert st.azimuth_spread(paths, "rx").item() == st.zenith_spread(paths, "tx").item() == 0.0
    assert st.coherence_bandwidth(paths).item() == pytest.approx(10e6)
    assert st.coherence_bandwidth(paths, 0.9).item() == pytest.approx(1e6)
    spacing = np.array([0.0, 5e6, 10e6, 20e6])
    expected = np.sqrt(0.8**2 + 0.2**2 + 2 * 0.8 * 0.2 * np.cos(2 * np.pi * spacing * 50e-9))
    np.testing.assert_allclose(st.frequency_correlation(paths, spacing)[0], expected, rtol=1e-10)
    equal = np.ones(2)
    assert st.k_factor(paths, equal).item() == 1.0
    assert st.rms_delay_spread(paths, equal).item() == pytest.approx(25e-9)


def test_links_against_scipy() -> None:
    paths = rows_with_an_empty_link()
    angle = np.random.default_rng(0).uniform(-np.pi, np.pi, len(paths))
    paths = CarrierPaths(**{**vars(paths), "phi_r": angle})
    power = np.random.default_rng(1).integers(1, 5, len(paths)).astype(float)
    for link in range(paths.link_count - 1):
        repeat = power[paths.link == link].astype(int)

        def every(values: np.ndarray, link: int = link, repeat: np.ndarray = repeat) -> np.ndarray:
            return np.repeat(values[paths.link == link], repeat)

        assert st.mean_delay(paths, power)[link] == pytest.approx(np.mean(every(paths.tau)))
        assert st.rms_delay_spread(paths, power)[link] == pytest.approx(np.std(every(paths.tau)))
        assert st.doppler_spread(paths, power)[link] == pytest.approx(np.std(every(paths.doppler_hz)))
        spread = scipy.stats.circstd(every(angle), high=np.pi, low=-np.pi)
        assert st.azimuth_spread(paths, "rx", power)[link] == pytest.approx(spread, abs=1e-7)
        los = paths.is_los[paths.link == link]
        rest = repeat[~los].sum()
        expected = repeat[los].sum() / rest if rest else np.inf
        assert st.k_factor(paths, power)[link] == pytest.approx(expected)
        assert st.path_loss_db(paths, power)[link] == pytest.approx(-10 * np.log10(repeat.sum()))


def test_k_factors_of_a_strongest_path_in_closed_form() -> None:
    """Powers 1, 9 and 4: the strongest is not the line of sight; q = sqrt(1 + 81 + 16)."""
    paths = two_paths([1e-7, 2e-7, 3e-7], [1.0, 3.0j, -2.0])
    assert st.k_factor(paths).item() == pytest.approx(1 / 13, rel=1e-12)
    assert st.k_factor_of_strongest(paths).item() == pytest.approx(9 / 5, rel=1e-12)
    assert st.k_factor_by_moments(paths).item() == pytest.approx(np.sqrt(98) / (14 - np.sqrt(98)), rel=1e-12)
    two = two_paths([1e-7, 2e-7], [1.0, 1.0])
    assert st.k_factor_by_moments(two).item() == pytest.approx(1 + np.sqrt(2), rel=1e-12)
    assert st.k_factor_of_strongest(two).item() == 1.0  # one of two equal ones is the strongest
    faint = two_paths([1e-7, 2e-7], [1.0, 1e-10])  # K = 1 / P_1 to first order, with all its digits
    assert st.k_factor_by_moments(faint).item() == pytest.approx(1e20, rel=1e-12)


def test_k_factor_by_moments_is_that_of_drawn_phases() -> None:
    """The moments of |h|^2 over 10^6 draws of phases give K; their error is 1 / sqrt(10^6) and a few times more."""
    rng = np.random.default_rng(4)
    level = np.array([1.0, 0.5, 0.4, 0.3, 0.2])
    paths = two_paths(list(1e-7 * np.arange(1, 6)), list(level))
    gain = np.abs(np.exp(2j * np.pi * rng.random((10**6, 5))) @ level) ** 2
    root = np.sqrt(1.0 - gain.var() / gain.mean() ** 2)
    assert st.k_factor_by_moments(paths).item() == pytest.approx(root / (1.0 - root), rel=0.01)


def test_spread_of_nearly_equal_directions_keeps_its_digits() -> None:
    paths = two_paths([1e-7, 2e-7], [1.0, 1.0])
    paths = CarrierPaths(**{**vars(paths), "phi_t": np.array([2.0, 2.0 + 2e-9])})
    assert st.azimuth_spread(paths, "tx").item() == pytest.approx(1e-9, rel=1e-5)


def test_nothing_is_nan() -> None:
    paths = rows_with_an_empty_link()
    functions = [
        st.path_loss_db, st.k_factor, st.k_factor_of_strongest, st.k_factor_by_moments, st.mean_delay,
        st.rms_delay_spread, st.mean_doppler, st.doppler_spread,
        st.coherence_bandwidth,
    ]  # fmt: skip
    silent = np.where(paths.link == 0, 0.0, 1.0)
    for function in functions:
        value = function(paths)
        assert value.shape == (paths.link_count,)
        np.testing.assert_array_equal(np.isnan(value), paths.path_count == 0)
        options = {"level": 0.5} if function is st.coherence_bandwidth else {}
        heard = function(paths, power=silent, **options)
        np.testing.assert_array_equal(np.isnan(heard), (paths.path_count == 0) | (np.arange(len(heard)) == 0))
    for end in ("tx", "rx"):
        for function in (st.azimuth_spread, st.zenith_spread):
            np.testing.assert_array_equal(np.isnan(function(paths, end)), paths.path_count == 0)
    np.testing.assert_array_equal(
        np.isnan(st.frequency_correlation(paths, [0.0, 1e6])).all(axis=1), paths.path_count == 0
    )


def test_one_path() -> None:
    paths = two_paths([1e-7], [1e-5])
    assert st.k_factor(paths).item() == np.inf and st.coherence_bandwidth(paths).item() == np.inf
    assert st.rms_delay_spread(paths).item() == 0.0 and st.azimuth_spread(paths, "rx").item() == 0.0
    assert st.k_factor_of_strongest(paths).item() == st.k_factor_by_moments(paths).item() == np.inf
    blocked = CarrierPaths(**{**vars(paths), "is_los": np.zeros(1, dtype=bool)})
    assert st.k_factor(blocked).item() == 0.0


def test_power_of_arrays() -> None:
    a = np.arange(12).reshape(2, 2, 3) * (1 + 1j)
    np.testing.assert_allclose(
        st.antenna_power(a), [2 * np.mean(np.arange(6) ** 2), 2 * np.mean(np.arange(6, 12) ** 2)]
    )


def test_errors() -> None:
    paths = two_paths([1e-7, 2e-7], [1.0, 1.0])
    with pytest.raises(ValueError, match=r"power has shape \(3,\).*\[2\]"):
        st.path_loss_db(paths, np.ones(3))
    with pytest.raises(ValueError, match="end = 'bs'"):
        st.azimuth_spread(paths, "bs")
    with pytest.raises(ValueError, match=r"level = 0\.7"):
        st.coherence_bandwidth(paths, 0.7)
