"""Frequency responses, taps and impulse responses against closed forms, sums written out, and Sionna RT."""

import numpy as np
import pytest

from mmw.channel import (
    CarrierPaths,
    complex_gain,
    frequency_response,
    impulse_response,
    subcarrier_frequencies,
    taps,
)
from mmw.channel.path_table import NEEDED_COLUMNS
from mmw.core.constants import SPEED_OF_LIGHT
from tests.fixtures.path_tables import CARRIER, path_table, two_paths
from tests.oracles.sionna import read_case


def random_rows() -> tuple[CarrierPaths, np.ndarray]:
    """Return paths of links with different counts, one link without any, and coefficients [P, 2, 3]."""
    paths = CarrierPaths.from_table(path_table(), 28e9)
    keys = np.concatenate([paths.keys, paths.keys[:1]])
    keys[-1]["agent"] = "cav_9"
    paths = CarrierPaths(**{**vars(paths), "keys": keys, "doppler_hz": 300 * paths.doppler_hz})
    rng = np.random.default_rng(0)
    return paths, rng.normal(size=(len(paths), 2, 3)) + 1j * rng.normal(size=(len(paths), 2, 3))


def test_grids() -> None:
    np.testing.assert_array_equal(subcarrier_frequencies(4, 120e3), np.array([-1.5, -0.5, 0.5, 1.5]) * 120e3)
    np.testing.assert_array_equal(subcarrier_frequencies(4, 120e3, "fft"), np.array([-2, -1, 0, 1]) * 120e3)
    for grid in ("centered", "fft"):
        np.testing.assert_array_equal(subcarrier_frequencies(5, 10.0, grid), [-20, -10, 0, 10, 20])
    k = np.arange(1, 1025)
    np.testing.assert_array_equal(subcarrier_frequencies(1024, 120e3), (k - 1025 / 2) * 120e3)
    with pytest.raises(ValueError, match="grid = 'dc'"):
        subcarrier_frequencies(4, 1.0, "dc")
    with pytest.raises(ValueError, match="count = 0"):
        subcarrier_frequencies(0, 1.0)


def test_two_paths_in_closed_form() -> None:
    """H = g1 e^{-j 2 pi f t1} + g2 e^{-j 2 pi f t2}: fading with the period 1 / (t2 - t1), written out by hand."""
    t1, t2, g1, g2 = 200e-9, 250e-9, 1e-5, 4e-6 * np.exp(0.7j)
    paths = two_paths([t1, t2], [g1, g2], doppler_hz=[1000.0, -400.0])
    a = paths.a[:, None, None]
    f = subcarrier_frequencies(64, 1e6)
    carried = [np.exp(-2j * np.pi * ((CARRIER * t) % 1.0)) for t in (t1, t2)]
    expected = g1 * carried[0] * np.exp(-2j * np.pi * f * t1) + g2 * carried[1] * np.exp(-2j * np.pi * f * t2)
    h = frequency_response(a, paths, f, CARRIER)
    assert h.shape == (1, 1, 1, 64)
    assert np.abs(h[0, 0, 0] - expected).max() < 1e-10 * np.abs(expected).max()
    turn = 2 * np.pi * (f + CARRIER) * (t2 - t1)
    power = g1**2 + abs(g2) ** 2 + 2 * g1 * abs(g2) * np.cos(turn - 0.7)
    np.testing.assert_allclose(np.abs(h[0, 0, 0]) ** 2, power, rtol=1e-9)

    normal = frequency_response(a, paths, f, CARRIER, normalize_delays=True)[0, 0, 0]
    np.testing.assert_allclose(normal, g1 + g2 * np.exp(-1j * turn), rtol=1e-9)
    baseband = frequency_response(a, paths, f, CARRIER, carrier_phase=False)[0, 0, 0]
    np.testing.assert_allclose(
        baseband, g1 * np.exp(-2j * np.pi * f * t1) + g2 * np.exp(-2j * np.pi * f * t2), rtol=1e-10
    )
    late = frequency_response(a, paths, 0.0, CARRIER, time_s=[0.0, 1e-3])[0, 0, 0, :, 0]
    moved = g1 * carried[0] * np.exp(2j * np.pi * 1.0) + g2 * carried[1] * np.exp(-2j * np.pi * 0.4)
    np.testing.assert_allclose(late, [g1 * carried[0] + g2 * carried[1], moved], rtol=1e-10)

    width = 100e6
    lags = np.arange(-4, 60)
    offset = [lags - width * t for t in (t1, t2)]  # 20 and 25 taps: whole numbers, one tap each
    hand = sum(g * c * (np.abs(x) < 1e-6) for g, c, x in zip((g1, g2), carried, offset, strict=True))
    assert np.abs(taps(a, paths, width, -4, 59, CARRIER)[0, 0, 0] - hand).max() < 1e-10 * g1
    half = taps(a, paths, 90e6, -4, 59, CARRIER)[0, 0, 0]  # 18 and 22.5 taps
    x = lags - 22.5
    spread = g2 * carried[1] * np.sin(np.pi * x) / (np.pi * x) + g1 * carried[0] * (lags == 18)
    assert np.abs(half - spread).max() < 1e-10 * g1


@pytest.mark.parametrize("carrier_phase", [True, False])
@pytest.mark.parametrize("normalize_delays", [True, False])
def test_response_is_the_sum_over_each_links_paths(carrier_phase: bool, normalize_delays: bool) -> None:
    paths, a = random_rows()
    f, times = subcarrier_frequencies(7, 3e6), np.array([0.0, 2e-4, 5e-3])
    options = {"carrier_phase": carrier_phase, "normalize_delays": normalize_delays}
    expected = np.zeros((paths.link_count, 2, 3, 3, 7), dtype=complex)
    lags = np.zeros((paths.link_count, 2, 3, 3, 9), dtype=complex)
    for p in range(len(paths)):
        link = paths.link[p]
        tau = paths.tau[p] - (paths.tau[paths.link == link].min() if normalize_delays else 0.0)
        for t, time in enumerate(times):
            turn = np.exp(2j * np.pi * (paths.doppler_hz[p] * time - (CARRIER * tau if carrier_phase else 0.0)))
            for k in range(7):
                expected[link, :, :, t, k] += a[p] * turn * np.exp(-2j * np.pi * f[k] * tau)
            for n in range(9):
                lags[link, :, :, t, n] += a[p] * turn * np.sinc(n - 2 - 10e6 * tau)
    scale = np.abs(expected).max()
    got = frequency_response(a, paths, f, CARRIER, times, **options)
    np.testing.assert_allclose(got, expected, atol=1e-12 * scale)
    assert not got[-1].any()
    np.testing.assert_allclose(
        frequency_response(a, paths, f, CARRIER, 2e-4, **options), expected[:, :, :, 1], atol=1e-12 * scale
    )
    for times_given, mean in ((times, expected.mean(axis=-1)), (5e-3, expected[:, :, :, 2].mean(axis=-1))):
        average = frequency_response(a, paths, f, CARRIER, times_given, average=True, **options)
        np.testing.assert_allclose(average, mean, atol=1e-12 * scale)
    np.testing.assert_allclose(taps(a, paths, 10e6, -2, 6, CARRIER, times, **options), lags, atol=1e-12 * scale)
    gains, tau = impulse_response(a, paths, CARRIER, times, **options)
    most = int(paths.path_count.max())
    assert gains.shape == (paths.link_count, 2, 3, most, 3) and tau.shape == (paths.link_count, most)
    for link, count in enumerate(paths.path_count):
        assert (tau[link, count:] == -1).all() and not gains[link, :, :, count:].any()
        assert (tau[link, :count] >= 0).all()
    again = np.einsum("lrtmn,lmk->lrtnk", gains, np.exp(-2j * np.pi * f * tau[..., None]))
    np.testing.assert_allclose(again, expected, atol=1e-12 * scale)
    assert impulse_response(a, paths, CARRIER)[0].shape == (paths.link_count, 2, 3, most)


def test_the_papers_complex_gain() -> None:
    """A_m with the carrier phase and the baseband sum give the same H as A_m without it and the whole sum."""
    paths, a = random_rows()
    f = subcarrier_frequencies(16, 120e3)
    for options in ({}, {"normalize_delays": True}):
        whole = frequency_response(a, paths, f, CARRIER, **options)
        gain = complex_gain(a, paths, CARRIER, **options)
        np.testing.assert_allclose(
            frequency_response(gain, paths, f, CARRIER, carrier_phase=False, **options), whole, atol=1e-12
        )
    np.testing.assert_allclose(np.abs(gain), np.abs(a))
    np.testing.assert_allclose(complex_gain(a[:, 0, 0], paths, CARRIER, normalize_delays=True), gain[:, 0, 0])


def test_energy() -> None:
    """Parseval: over one period of lags, taps hold the energy that the response has over the band."""
    paths = two_paths([0.0, 30e-9, 80e-9], [1.0, 0.5j, -0.2])
    a, width, count = paths.a[:, None, None], 100e6, 64
    f = subcarrier_frequencies(count, width / count, "fft")
    h = frequency_response(a, paths, f, CARRIER)[0, 0, 0]
    lags = taps(a, paths, width, 0, count - 1, CARRIER)[0, 0, 0]
    assert np.sum(np.abs(lags) ** 2) == pytest.approx(np.mean(np.abs(h) ** 2))
    np.testing.assert_allclose(np.fft.fft(lags), np.fft.ifftshift(h), atol=1e-9)
    unit = frequency_response(*random_rows()[::-1], f, CARRIER, [0.0, 1e-3], normalize=True)
    np.testing.assert_allclose(np.mean(np.abs(unit) ** 2, axis=(1, 2, 3, 4)), [1.0] * (len(unit) - 1) + [0.0])


def test_errors() -> None:
    paths, a = random_rows()
    with pytest.raises(ValueError, match=rf"a has 3 paths, CarrierPaths {len(paths)}"):
        frequency_response(a[:3], paths, 0.0, CARRIER)
    with pytest.raises(ValueError, match=r"a has shape \(\d+,\)"):
        frequency_response(a[:, 0, 0], paths, 0.0, CARRIER)
    with pytest.raises(ValueError, match=r"carrier_hz = 4\.9e\+09"):
        taps(a, paths, 1e6, 0, 1, 4.9e9)
    with pytest.raises(ValueError, match="l_min = 3, l_max = 2"):
        taps(a, paths, 1e6, 3, 2, CARRIER)
    with pytest.raises(ValueError, match=r"time_s has shape \(1, 1\)"):
        impulse_response(a, paths, CARRIER, [[0.0]])


def reference_rows(case: dict, tau: str) -> CarrierPaths:
    table = {name: np.zeros(len(case["rx"])) for name in NEEDED_COLUMNS}
    table |= {name: np.full(len(case["rx"]), "-") for name in ("scenario", "weather", "peer")}
    table |= {
        "agent": np.array([f"cav_{rx}" for rx in case["rx"]]),
        "carrier_hz": np.full(len(case["rx"]), CARRIER),
        "tau_s": case[tau].astype(np.float64),
        "doppler_hz": case["doppler"].astype(np.float64),
    }
    return CarrierPaths.from_table(table)


def test_sionna_fun_cir_cfr_taps() -> None:
    """Sionna's own paths through our sums give Sionna's CFR, taps and CIR; so do the paths redone in float64."""
    case = read_case("fun_cir_cfr_taps")
    for columns, absolute, relative in (("", 2e-3, 2e-4), ("64", 2e-3, 2e-3)):
        a, paths = case[f"a{columns}"].astype(np.complex128), reference_rows(case, f"tau{columns}")
        assert paths.link_count == 4 and (paths.row == np.arange(len(paths))).all()
        times = np.arange(3) / 1e4
        for view, bound in (("abs", absolute), ("norm", relative)):
            options = {"normalize_delays": view == "norm"}

            def error(got: np.ndarray, key: str) -> float:
                expected = case[key][:, :, 0]
                assert got.shape == expected.shape
                return float(np.abs(got - expected).max() / np.abs(expected).max())

            h = frequency_response(a, paths, case["freqs"], CARRIER, times[:2], **options)
            assert error(h, f"cfr_{view}") < bound
            assert error(taps(a, paths, 100e6, -6, 40, CARRIER, times[:1], **options), f"taps_{view}") < bound
            gains, tau = impulse_response(a, paths, CARRIER, times, **options)
            is_path = tau >= 0
            np.testing.assert_array_equal(is_path, case["tensor_valid"][:, 0])
            order = np.argsort(np.where(is_path, tau, np.inf), axis=1)
            theirs = case[f"cir_tau_{view}"][:, 0]
            other = np.argsort(np.where(case["tensor_valid"][:, 0], theirs, np.inf), axis=1)
            pick = np.take_along_axis
            mine = np.where(pick(is_path, order, 1), pick(tau, order, 1), 0.0)
            np.testing.assert_allclose(
                mine, np.where(mine > 0, pick(theirs, other, 1), mine), atol=1e-4 / SPEED_OF_LIGHT
            )
            gains = pick(gains, order[:, None, None, :, None], 3)
            reference = pick(case[f"cir_a_{view}"][:, :, 0], other[:, None, None, :, None], 3)
            valid = pick(is_path, order, 1)[:, None, None, :, None]
            worst = np.abs(np.where(valid, gains - reference, 0.0)).max() / np.abs(reference).max()
            assert worst < max(bound, 5e-4)  # single paths carry float32 phases of their own
        unit = frequency_response(a, paths, case["freqs"], CARRIER, [0.0], normalize_delays=True, normalize=True)
        assert error(unit, "cfr_unit_energy") < relative
