"""Compute channel state information: frequency responses, impulse responses and taps from the paths' coefficients.

Which A_m: `apply_arrays` returns A_m **without** the carrier phase, the coefficient that the dataset stores. The matrix
A_m of the Multimodal-Wireless paper is the complex gain at f_c, **with** it: `complex_gain` of ours. So

    H(f_k) = sum_m A_m exp(-j 2 pi (f_c + f_k) tau_m)              A_m from `apply_arrays`, carrier_phase=True (default)
           = sum_m A'_m exp(-j 2 pi f_k tau_m)                     A'_m from `complex_gain`, carrier_phase=False

are the same numbers. f_k counts from the carrier. Delays are absolute, so phases are too, over links, frames and
carriers; `normalize_delays=True` sets the first path of each link to delay 0 before any phase is formed, which is what
Sionna RT does unless told otherwise, and what the published files of the paper hold. Time t moves each path by its
Doppler shift only, exp(j 2 pi f_D t). Patterns and array phases are those at f_c: no beam squint.

Source: Sionna RT 2.2, `PathSet.cir`, `PathSet.cfr`, `PathSet.taps`; D. Tse and P. Viswanath, Fundamentals of Wireless
Communication, section 2.2.
"""

from collections.abc import Iterator
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from mmw.channel.path_table import CarrierPaths
from mmw.core.errors import InputError


def subcarrier_frequencies(count: int, spacing_hz: float, grid: Literal["centered", "fft"] = "centered") -> np.ndarray:
    """Return the baseband frequencies of OFDM subcarriers [Hz], growing, shape [count].

    Args:
        count: Number of subcarriers K.
        spacing_hz: Subcarrier spacing df [Hz].
        grid: `centered`: f_k = (k - (K + 1) / 2) df for k = 1 ... K, symmetric about the carrier (the paper's).
            `fft`: df times -K/2 ... K/2 - 1, or -(K-1)/2 ... (K-1)/2 for odd K, which has a subcarrier on the carrier
            (Sionna's). For even K the two are half a subcarrier apart.

    Raises:
        InputError: If the count is below 1, or the grid is not known.

    Examples:
        >>> subcarrier_frequencies(4, 120e3).tolist()
        [-180000.0, -60000.0, 60000.0, 180000.0]
        >>> subcarrier_frequencies(4, 120e3, grid="fft").tolist()
        [-240000.0, -120000.0, 0.0, 120000.0]
    """
    if count < 1:
        raise InputError(f"subcarrier_frequencies: count = {count}; it is at least 1")
    if grid == "centered":
        return (np.arange(1, count + 1) - (count + 1) / 2) * spacing_hz
    if grid == "fft":
        return (np.arange(count) - count // 2) * spacing_hz
    raise InputError(f"subcarrier_frequencies: grid = {grid!r}; it is centered or fft")


def delays(paths: CarrierPaths, normalize_delays: bool = False) -> np.ndarray:
    """Return the delay of each path, absolute or after the first path of its link [s], shape [P]."""
    if not normalize_delays:
        return paths.tau
    first = np.full(paths.link_count, np.inf)
    np.minimum.at(first, paths.link, paths.tau)
    return paths.tau - first[paths.link]


def complex_gain(
    a: np.ndarray, paths: CarrierPaths, carrier_hz: float, time_s: float = 0.0, *, normalize_delays: bool = False
) -> np.ndarray:
    """Return the complex gains at the carrier, a exp(-j 2 pi f_c tau) exp(j 2 pi f_D t), shape of `a`.

    This is the paper's A_m. Pass it on with `carrier_phase=False` and no other time: the phases are in it.

    Args:
        a: Coefficients without the carrier phase, shape [P, ...].
        paths: The paths.
        carrier_hz: Carrier f_c of the paths [Hz].
        time_s: Time t after the instant of the paths [s].
        normalize_delays: Count delays from the first path of each link.

    Examples:
        >>> import mmw
        >>> paths = mmw.open_dataset("out/quickstart").paths(28e9, weather="sunny", frames=range(0, 1))
        >>> gain = complex_gain(paths.a, paths, 28e9)  # with the phase of the carrier
        >>> bool((abs(gain / paths.a).round(9) == 1.0).all())
        True
    """
    phase = _rotation(a, paths, carrier_hz, np.float64(time_s), True, normalize_delays)
    return a * phase.reshape(len(paths), *(1,) * (a.ndim - 1))


def frequency_response(
    a: np.ndarray,
    paths: CarrierPaths,
    frequencies_hz: ArrayLike,
    carrier_hz: float,
    time_s: ArrayLike = 0.0,
    *,
    carrier_phase: bool = True,
    normalize_delays: bool = False,
    normalize: bool = False,
    average: bool = False,
) -> np.ndarray:
    """Return the frequency response H of every link.

    Args:
        a: Coefficients, shape [P, N_r, N_t]: those of `apply_arrays`, or, with `carrier_phase=False`, of
            `complex_gain`.
        paths: The paths that `a` belongs to.
        frequencies_hz: Baseband frequencies f_k, counted from the carrier [Hz], shape [K]; 0 alone is a single-carrier
            (narrowband) channel.
        carrier_hz: Carrier f_c of the paths [Hz].
        time_s: Times t after the instant of the paths [s], one or shape [T]; absolute phase advances by Doppler.
        carrier_phase: Apply exp(-j 2 pi f_c tau); False for coefficients that hold it.
        normalize_delays: Count delays from the first path of each link. With `carrier_phase=False` this shifts the
            baseband phases only.
        normalize: Divide each link by the root mean square of |H| over antennas, times and frequencies (Sionna's
            `cfr(normalize=True)`). With `average` too, of the average.
        average: Return the mean over frequencies, without ever holding all of them.

    Returns:
        Shape [L, N_r, N_t, K], [L, N_r, N_t, T, K] if `time_s` has a shape; without K if averaged. complex128. 0 for a
        link without path.

    Raises:
        InputError: If shapes do not fit or the carrier is not that of the paths.

    Examples:
        >>> import mmw
        >>> paths = mmw.open_dataset("out/quickstart").paths(28e9, weather="sunny", frames=range(0, 1))
        >>> a = paths.a[:, None, None]  # between the antennas of the dataset: one at each end
        >>> h = frequency_response(a, paths, subcarrier_frequencies(64, 120e3), 28e9)
        >>> h.shape  # links, receive antennas, transmit antennas, subcarriers
        (3, 1, 1, 64)
    """
    frequencies = np.atleast_1d(np.asarray(frequencies_hz, dtype=np.float64))
    tau = delays(paths, normalize_delays)
    turn = _rotation(a, paths, carrier_hz, np.asarray(time_s, dtype=np.float64), carrier_phase, normalize_delays)
    if average:
        weights = np.zeros((len(paths), 1), dtype=np.complex128)
        for frequency in frequencies:
            weights[:, 0] += np.exp(-2j * np.pi * frequency * tau)
        weights /= len(frequencies)
    else:
        weights = np.exp(-2j * np.pi * tau[:, None] * frequencies)
    response = _sum(a, paths, turn, weights)
    if normalize:
        axes = tuple(range(1, response.ndim))
        scale = np.sqrt(np.mean(np.abs(response) ** 2, axis=axes, keepdims=True))
        response = response / np.where(scale > 0, scale, 1.0)
    return response[..., 0] if average else response


def taps(
    a: np.ndarray,
    paths: CarrierPaths,
    bandwidth_hz: float,
    l_min: int,
    l_max: int,
    carrier_hz: float,
    time_s: ArrayLike = 0.0,
    *,
    carrier_phase: bool = True,
    normalize_delays: bool = False,
) -> np.ndarray:
    """Return the taps of the discrete baseband channel, h_l = sum_m a_m sinc(l - W tau_m), l = l_min ... l_max.

    Args:
        a: Coefficients, shape [P, N_r, N_t], as for `frequency_response`.
        paths: The paths that `a` belongs to.
        bandwidth_hz: Bandwidth W, the rate of the taps [Hz].
        l_min: First tap; below 0, because a sinc starts before its path.
        l_max: Last tap. With absolute delays it must reach beyond W tau of the last path.
        carrier_hz: Carrier f_c of the paths [Hz].
        time_s: Times t after the instant of the paths [s], one or shape [T].
        carrier_phase: Apply exp(-j 2 pi f_c tau); False for coefficients that hold it.
        normalize_delays: Count delays from the first path of each link.

    Returns:
        Shape [L, N_r, N_t, l_max - l_min + 1], or with T before the taps; complex128. 0 for a link without path.

    Raises:
        InputError: If l_max is below l_min, the bandwidth is not above 0, shapes do not fit, or the carrier differs.

    Examples:
        >>> import mmw
        >>> paths = mmw.open_dataset("out/quickstart").paths(28e9, weather="sunny", frames=range(0, 1))
        >>> h = taps(paths.a[:, None, None], paths, 100e6, -6, 64, 28e9)
        >>> h.shape, int(abs(h[0, 0, 0]).argmax()) - 6  # the strongest tap of the first link
        ((3, 1, 1, 71), 13)
    """
    if l_max < l_min or not bandwidth_hz > 0:
        raise InputError(f"taps: l_min = {l_min}, l_max = {l_max}, W = {bandwidth_hz:g} Hz; l_min <= l_max and W > 0")
    turn = _rotation(a, paths, carrier_hz, np.asarray(time_s, dtype=np.float64), carrier_phase, normalize_delays)
    shape = np.sinc(np.arange(l_min, l_max + 1) - bandwidth_hz * delays(paths, normalize_delays)[:, None])
    return _sum(a, paths, turn, shape)


def impulse_response(
    a: np.ndarray,
    paths: CarrierPaths,
    carrier_hz: float,
    time_s: ArrayLike = 0.0,
    *,
    carrier_phase: bool = True,
    normalize_delays: bool = False,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the impulse response sum_m a_m delta(t - tau_m) of every link as dense arrays over M, the most paths.

    Args:
        a: Coefficients, shape [P, N_r, N_t], as for `frequency_response`.
        paths: The paths that `a` belongs to.
        carrier_hz: Carrier f_c of the paths [Hz].
        time_s: Times t after the instant of the paths [s], one or shape [T].
        carrier_phase: Apply exp(-j 2 pi f_c tau); False for coefficients that hold it.
        normalize_delays: Count delays from the first path of each link.

    Returns:
        Gains, shape [L, N_r, N_t, M] or [L, N_r, N_t, M, T], complex128, and delays [s], shape [L, M]. Places after the
        last path of a link hold gain 0 and delay -1, as in Sionna.

    Raises:
        InputError: If shapes do not fit or the carrier is not that of the paths.

    Examples:
        >>> import mmw
        >>> paths = mmw.open_dataset("out/quickstart").paths(28e9, weather="sunny", frames=range(0, 1))
        >>> a, tau = impulse_response(paths.a[:, None, None], paths, 28e9)
        >>> a.shape, tau.shape  # of each link the paths, as many as the link with most of them has
        ((3, 1, 1, 4), (3, 4))
    """
    turn = _rotation(a, paths, carrier_hz, np.asarray(time_s, dtype=np.float64), carrier_phase, normalize_delays)
    if a.ndim != 3:
        raise InputError(f"a has shape {a.shape}; it is [P, N_r, N_t]")
    count = paths.path_count
    index = np.arange(len(paths)) - (np.cumsum(count) - count)[paths.link]
    max_count = int(count.max(initial=0))
    gains = np.zeros((paths.link_count, max_count, *a.shape[1:], *turn.shape[1:]), dtype=np.complex128)
    gains[paths.link, index] = a.reshape(*a.shape, *(1,) * (turn.ndim - 1)) * turn[:, None, None]
    tau = np.full((paths.link_count, max_count), -1.0)
    tau[paths.link, index] = delays(paths, normalize_delays)
    return np.moveaxis(gains, 1, 3), tau


def _rotation(
    a: np.ndarray,
    paths: CarrierPaths,
    carrier_hz: float,
    time_s: np.ndarray,
    carrier_phase: bool,
    normalize_delays: bool,
) -> np.ndarray:
    """Return exp(-j 2 pi f_c tau) exp(j 2 pi f_D t) of every path, shape [P] or [P, T]."""
    if len(a) != len(paths):
        raise InputError(f"a has {len(a)} paths, CarrierPaths {len(paths)}; give the coefficients of these paths")
    if carrier_hz != paths.carrier_hz:
        raise InputError(f"carrier_hz = {carrier_hz:g}, the paths are at {paths.carrier_hz:g} Hz; give their carrier")
    if time_s.ndim > 1:
        raise InputError(f"time_s has shape {time_s.shape}; give one time, or shape [T]")
    cycles = np.multiply.outer(paths.doppler_hz, time_s)
    if carrier_phase:
        carried = carrier_hz * delays(paths, normalize_delays)
        cycles = cycles - carried.reshape(len(paths), *(1,) * time_s.ndim)
    return np.exp(2j * np.pi * cycles)


def _sum(a: np.ndarray, paths: CarrierPaths, turn: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Return the sums over each link's paths of a [P, N_r, N_t] turn [P, ...] weights [P, K], [L, N_r, N_t, ..., K]."""
    if a.ndim != 3:
        raise InputError(f"a has shape {a.shape}; it is [P, N_r, N_t]")
    weights = turn[..., None] * weights.reshape(len(paths), *(1,) * (turn.ndim - 1), weights.shape[1])
    flat = weights.reshape(len(paths), int(np.prod(weights.shape[1:])))
    out = np.zeros((paths.link_count, a.shape[1] * a.shape[2], flat.shape[1]), dtype=np.complex128)
    for links, path in _equal_links(paths):
        gains = a[path].reshape(*path.shape, -1)
        out[links] = np.swapaxes(gains, 1, 2) @ flat[path]
    return out.reshape(paths.link_count, *a.shape[1:], *weights.shape[1:])


def _equal_links(paths: CarrierPaths) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Yield links with equally many paths, shape [n], and their paths, shape [n, count]."""
    count = paths.path_count
    start = np.cumsum(count) - count
    for value in np.unique(count[count > 0]):
        links = np.flatnonzero(count == value)
        yield links, start[links, None] + np.arange(value)
