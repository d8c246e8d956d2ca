"""Track the code of satellites that arrive on several paths: error of the delay, carrier to noise, thermal noise.

The receiver correlates with a replica of the code, BPSK(1) of infinite bandwidth: a triangle of one chip on either
side. The delay lock loop has the noncoherent early-minus-late power discriminator, and holds the largest peak. The
carriers of the paths beat by their Doppler shifts: within an integration each but the strongest loses coherence, and
the loop averages power over 1 / (2 B), B its noise bandwidth. At rest paths interfere with the phases of their lengths.

Source: E. D. Kaplan and C. J. Hegarty (eds.), "Understanding GPS: Principles and Applications", 2nd ed. (2006), section
5.6.3, equation 5.23; discriminator with multipath: R. D. J. van Nee, "Spread-spectrum code and carrier synchronization
errors caused by multipath and interference", IEEE Trans. AES 29 (1993).
"""

from dataclasses import dataclass

import numpy as np

from mmw.core.constants import SPEED_OF_LIGHT
from mmw.sensors.gnss.config import Gnss

CARRIER_HZ = 1575.42e6
"""Carrier L1 [Hz]; IS-GPS-200."""

CHIP_M = SPEED_OF_LIGHT / 1.023e6
"""Length of a chip of the C/A code, 293 m; IS-GPS-200."""

TERMS_AT_ONCE = 2**22
"""Products of paths that are held at once."""

BISECTIONS = 40
"""Halvings of the bracket of the loop's zero, at most one chip wide: below 1e-9 m."""


@dataclass(frozen=True)
class SignalPaths:
    """Paths of L signals, P in all, sorted by signal; receiver's view, the satellite as the source of a plane wave."""

    count: np.ndarray
    """Paths of each signal, shape [L]."""
    amplitude: np.ndarray
    """Field behind the antenna relative to a free line of sight at zenith, without the phase of the excess, shape
    [P], complex128."""
    excess: np.ndarray
    """Length beyond the straight line to the satellite [m], shape [P]."""
    range_rate: np.ndarray
    """Rate of the length by the motion of receiver and reflectors [m/s], shape [P]."""

    def take(self, rows: np.ndarray) -> "SignalPaths":
        """Return the paths of some signals with equal counts, M, as arrays of shape [n, M]."""
        at = (np.cumsum(self.count) - self.count)[rows, None] + np.arange(self.count[rows[0]])
        return SignalPaths(self.count[rows], self.amplitude[at], self.excess[at], self.range_rate[at])


@dataclass(frozen=True)
class TrackedCode:
    """Delay and power that the loop of each signal holds."""

    error: np.ndarray
    """Delay of the loop beyond that of the straight line [m], shape [L]; NaN without a path."""
    power: np.ndarray
    """Power of the prompt correlator relative to a free line of sight at zenith, shape [L]; 0 without a path."""


def track_code(paths: SignalPaths, config: Gnss) -> TrackedCode:
    """Return the delay that each loop settles at, and its power.

    Args:
        paths: The paths.
        config: Spacing, integration time and bandwidth of the loop.
    """
    error, power = np.full(len(paths.count), np.nan), np.zeros(len(paths.count))
    for count in np.unique(paths.count[paths.count > 0]):  # signals of one count together: no padding to add up
        rows = np.flatnonzero(paths.count == count)
        for begin in range(0, len(rows), max(1, TERMS_AT_ONCE // int(3 * count**3))):
            part = rows[begin : begin + max(1, TERMS_AT_ONCE // int(3 * count**3))]
            error[part], power[part] = _settle(paths.take(part), config)
    return TrackedCode(np.where(power > 0.0, error, np.nan), power)


def _settle(paths: SignalPaths, config: Gnss) -> tuple[np.ndarray, np.ndarray]:
    """Return delay [m] and power of the loops of signals with M paths each, shape [n] each.

    The largest power of the correlator lies at a kink, since it is convex between them; the discriminator changes sign
    within half a spacing of it, and is halved there.
    """
    delay, weight = paths.excess / CHIP_M, _mean_products(paths, config)

    def power(at: np.ndarray) -> np.ndarray:
        """Return the correlator's power at delays [chips], shape [n, K]."""
        triangle = np.maximum(1.0 - np.abs(at[:, :, None] - delay[:, None, :]), 0.0)
        return np.sum(np.sum(triangle[:, :, :, None] * weight[:, None], axis=2) * triangle, axis=2)

    kinks = np.concatenate([delay, delay - 1.0, delay + 1.0], axis=1)
    middle = np.take_along_axis(kinks, power(kinks).argmax(axis=1)[:, None], axis=1)
    half = 0.5 * config.correlator_spacing_chips
    low, high = middle - half, middle + half
    for _ in range(BISECTIONS):
        at = 0.5 * (low + high)
        is_before = power(at + half) > power(at - half)  # the late correlator is nearer to the peak
        low, high = np.where(is_before, at, low), np.where(is_before, high, at)
    settled = 0.5 * (low + high)
    return settled[:, 0] * CHIP_M, np.maximum(power(settled)[:, 0], 0.0)


def _mean_products(paths: SignalPaths, config: Gnss) -> np.ndarray:
    """Return the mean over the loop's time of the products of every two paths, real part, shape [n, M, M]."""
    wavelength = SPEED_OF_LIGHT / CARRIER_HZ
    frequency = -paths.range_rate / wavelength
    strongest = np.abs(paths.amplitude).argmax(axis=1)[:, None]
    beat = frequency - np.take_along_axis(frequency, strongest, axis=1)
    phase = -2.0 * np.pi * paths.excess / wavelength
    field = paths.amplitude * np.exp(1j * phase) * np.sinc(beat * config.integration_time_s)
    between = frequency[:, :, None] - frequency[:, None, :]
    averaged = np.sinc(between * 0.5 / config.loop_bandwidth_hz)
    return np.real(field[:, :, None] * np.conj(field[:, None, :])) * averaged


def thermal_noise_m(cn0_db_hz: np.ndarray, config: Gnss) -> np.ndarray:
    """Return the standard deviation of the tracked delay by thermal noise [m], shape of the argument.

    Equation 5.23 of Kaplan and Hegarty for a front end that is wide against 1 / spacing:
    sqrt(B D / (2 C/N0) (1 + 2 / (T C/N0 (2 - D)))) chips.

    Args:
        cn0_db_hz: Carrier to noise density [dB Hz].
        config: Spacing D, integration time T, bandwidth B.
    """
    ratio = 10.0 ** (np.asarray(cn0_db_hz, dtype=np.float64) / 10.0)
    spacing = config.correlator_spacing_chips
    squaring = 1.0 + 2.0 / (config.integration_time_s * ratio * (2.0 - spacing))
    return CHIP_M * np.sqrt(config.loop_bandwidth_hz * spacing / (2.0 * ratio) * squaring)
