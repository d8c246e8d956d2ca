"""Code tracking: the multipath error envelope in closed form, detours, moving receivers, thermal noise."""

import numpy as np
import pytest

from mmw.core.constants import SPEED_OF_LIGHT
from mmw.sensors import Gnss
from mmw.sensors.gnss.code_tracking import CARRIER_HZ, CHIP_M, SignalPaths, thermal_noise_m, track_code

WAVELENGTH = SPEED_OF_LIGHT / CARRIER_HZ


def tracked(config: Gnss, *paths: tuple[complex, float, float]) -> tuple[float, float]:
    """Return error [m] and power of one signal of (amplitude, excess [m], range rate [m/s])."""
    amplitude, excess, rate = (np.array(column) for column in zip(*paths, strict=True))
    found = track_code(SignalPaths(np.array([len(paths)]), amplitude.astype(complex), excess, rate), config)
    return float(found.error[0]), float(found.power[0])


def reflected(alpha: float, excess: float) -> complex:
    """Return the amplitude of a reflection whose phase at the receiver is 0, or 180 deg for a negative one."""
    return alpha * np.exp(2j * np.pi * excess / WAVELENGTH)


def envelope(alpha: float, delay: float, spacing: float) -> float:
    """Return the error of one reflection in phase (alpha > 0) or against it, in chips.

    Early and late correlators of triangles meet on straight pieces: alpha delay / (1 + alpha) while both lie on the
    flanks of the two peaks, then alpha spacing / 2 until the late one leaves the reflection's peak, then a fall to 0.

    Source: R. D. J. van Nee, IEEE Trans. AES 29 (1993); pieces by hand.
    """
    half = 0.5 * spacing
    if delay < (1.0 + alpha) * half:
        return alpha * delay / (1.0 + alpha)
    if delay < 1.0 - half + alpha * half:
        return alpha * half
    if delay < 1.0 + half:
        return alpha * (1.0 + half - delay) / (2.0 - alpha)
    return 0.0


@pytest.mark.parametrize("spacing", [0.1, 0.5, 1.0])
@pytest.mark.parametrize("alpha", [0.5, -0.5, 0.1, -0.3])
def test_multipath_error_envelope(spacing: float, alpha: float) -> None:
    """The largest error, alpha spacing / 2, is 73 m at a spacing of one chip and half the amplitude: 293 m / 4."""
    config = Gnss(correlator_spacing_chips=spacing)
    for delay in np.arange(0.01, 1.3, 0.0173):
        excess = delay * CHIP_M
        error, _ = tracked(config, (1.0, 0.0, 0.0), (reflected(alpha, excess), excess, 0.0))
        assert error == pytest.approx(envelope(alpha, delay, spacing) * CHIP_M, abs=1e-6)


def test_a_detour_alone_is_the_whole_error() -> None:
    error, power = tracked(Gnss(), (0.3j, 87.5, 1.0))
    assert error == pytest.approx(87.5, abs=1e-6) and power == pytest.approx(0.09)
    # The largest peak is held, also behind a weaker line of sight that is more than a chip before.
    error, power = tracked(Gnss(), (0.1, 0.0, 0.0), (reflected(0.4, 500.0), 500.0, 0.0))
    assert error == pytest.approx(500.0, abs=1e-6) and power == pytest.approx(0.16)


def test_a_moving_receiver_averages_the_phase() -> None:
    """Powers add up: the zero of sum A_k^2 (t - d_k) for short delays, less what the integration loses of the beat."""
    config = Gnss(loop_bandwidth_hz=0.05, integration_time_s=0.02)
    alpha, excess, rate = 0.6, 20.0, -10.0 * WAVELENGTH  # a beat of 10 Hz, 100 turns in the loop's time
    lost = np.sinc(10.0 * 0.02) ** 2
    error, _ = tracked(config, (1.0, 0.0, 0.0), (alpha, excess, rate))
    share = alpha**2 * lost
    assert error == pytest.approx(share * excess / (1.0 + share), rel=1e-6)
    # At a beat of a whole turn in an integration nothing is left of the reflection.
    error, power = tracked(config, (1.0, 0.0, 0.0), (alpha, excess, -50.0 * WAVELENGTH))
    assert abs(error) < 1e-6 and power == pytest.approx(1.0)


def test_signals_do_not_change_each_other() -> None:
    """Any number of signals with any numbers of paths: the bits of each are those of it alone; none without a path."""
    rng = np.random.default_rng(4)
    count = rng.integers(0, 6, 200)
    total = int(count.sum())
    amplitude = rng.normal(size=total) + 1j * rng.normal(size=total)
    paths = SignalPaths(count, amplitude, rng.uniform(0, 400, total), rng.uniform(-20, 20, total))
    whole, begin = track_code(paths, Gnss()), 0
    for row, own in enumerate(count):
        part = slice(begin, begin + own)
        begin += own
        columns = (values[part] for values in (paths.amplitude, paths.excess, paths.range_rate))
        alone = track_code(SignalPaths(count[row : row + 1], *columns), Gnss())
        np.testing.assert_array_equal(alone.error[0], whole.error[row])
        np.testing.assert_array_equal(alone.power[0], whole.power[row])
    assert (np.isnan(whole.error) == (count == 0)).all()
    assert (whole.power[count == 0] == 0.0).all()


def test_thermal_noise_of_the_loop() -> None:
    """Kaplan and Hegarty, equation 5.23, by hand: B = 2 Hz, D = 0.5, T = 20 ms at 30 dB Hz.

    2 x 0.5 / (2 x 1000) x (1 + 2 / (0.02 x 1000 x 1.5)) = 5.3333e-4 chips^2.
    """
    config = Gnss(loop_bandwidth_hz=2.0, correlator_spacing_chips=0.5, integration_time_s=0.02)
    assert thermal_noise_m(np.array([30.0]), config)[0] == pytest.approx(np.sqrt(5.33333e-4) * 293.0523, rel=1e-5)
    assert np.all(np.diff(thermal_noise_m(np.arange(20.0, 50.0), config)) < 0)
