"""Compute large-scale and dispersion statistics of links from the powers of their paths.

Every function returns one value a link, shape [L], and NaN for a link without path (or whose paths all have power 0).
`power` is the power of each path, shape [P]; |a|^2 of the dataset's own antennas when not given. For arrays give
`antenna_power(apply_arrays(...))`. Paths count as resolved: powers add, phases do not matter.
"""

from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from mmw.channel.path_table import CarrierPaths
from mmw.core.errors import InputError

__all__ = [
    "antenna_power", "azimuth_spread", "coherence_bandwidth", "doppler_spread", "frequency_correlation", "k_factor",
    "k_factor_by_moments", "k_factor_of_strongest", "mean_delay", "mean_doppler", "path_loss_db", "rms_delay_spread",
    "zenith_spread",
]  # fmt: skip


def antenna_power(a: np.ndarray) -> np.ndarray:
    """Return the mean of |a|^2 over all pairs of antennas, shape [P, N_r, N_t] -> [P]."""
    return np.mean(np.abs(a) ** 2, axis=(1, 2))


def _power(paths: CarrierPaths, power: np.ndarray | None) -> np.ndarray:
    if power is None:
        return np.abs(paths.a) ** 2
    if np.shape(power) != (len(paths),):
        raise InputError(f"power has shape {np.shape(power)}; it has one value a path, [{len(paths)}]")
    return np.asarray(power, dtype=np.float64)


def _total(paths: CarrierPaths, values: np.ndarray) -> np.ndarray:
    """Return the sum over the paths of each link, shape [L]."""
    return np.bincount(paths.link, weights=values, minlength=paths.link_count)


def _weights(paths: CarrierPaths, power: np.ndarray | None) -> np.ndarray:
    """Return the share of each path in the power of its link, shape [P]; NaN where that is 0."""
    power = _power(paths, power)
    total = _total(paths, power)
    return power / np.where(total > 0, total, np.nan)[paths.link]


def _moments(paths: CarrierPaths, values: np.ndarray, power: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
    """Return mean and standard deviation of a value of the paths, weighted by power, shape [L] each."""
    weight = _weights(paths, power)
    is_empty = paths.path_count == 0
    mean = np.where(is_empty, np.nan, _total(paths, weight * values))
    spread = np.sqrt(_total(paths, weight * (values - mean[paths.link]) ** 2))
    return mean, np.where(is_empty, np.nan, spread)


def path_loss_db(paths: CarrierPaths, power: np.ndarray | None = None) -> np.ndarray:
    """Return -10 log10 of the sum of the powers of the paths [dB], patterns included, shape [L].

    It is minus `gain_db` of table `links`. Source: ITU-R P.1407, section 2.2.1 (total power).

    Examples:
        >>> import mmw
        >>> paths = mmw.open_dataset("out/quickstart").paths(28e9, weather="sunny", frames=range(0, 1))
        >>> path_loss_db(paths).round(1).tolist()
        [89.5, 109.1, 87.5]
    """
    total = _total(paths, _power(paths, power))
    return -10 * np.log10(np.where(total > 0, total, np.nan))


def k_factor(paths: CarrierPaths, power: np.ndarray | None = None) -> np.ndarray:
    """Return the Rician K-factor: power of the line of sight over that of all other paths, linear, shape [L].

    Infinite if there is the line of sight alone, 0 without it. Source: 3GPP TR 38.901, equation 7.5-30.
    """
    power = _power(paths, power)
    return _ratio(paths, np.where(paths.is_los, power, 0.0), np.where(paths.is_los, 0.0, power))


def k_factor_of_strongest(paths: CarrierPaths, power: np.ndarray | None = None) -> np.ndarray:
    """Return the K-factor of the strongest path: its power over that of all other paths, linear, shape [L].

    It is `k_factor` where the line of sight is the strongest, infinite if there is one path alone; it is defined
    without line of sight too. Source: the Rice factor of a dominant component, A. F. Molisch, Wireless Communications,
    2nd edition, section 5.5.
    """
    power = _power(paths, power)
    is_strongest = _is_strongest(paths, power)
    return _ratio(paths, np.where(is_strongest, power, 0.0), np.where(is_strongest, 0.0, power))


def k_factor_by_moments(paths: CarrierPaths, power: np.ndarray | None = None) -> np.ndarray:
    """Return the K-factor of the narrowband gain by the method of moments, linear, shape [L].

    The method takes mean G and variance V of |h|^2: K = sqrt(1 - V / G^2) / (1 - sqrt(1 - V / G^2)). Phases of paths
    that are independent and uniform give G = sum P and V = G^2 - sum P^2, so that K = q / (sum P - q) with
    q = sqrt(sum P^2). Two equal paths have K = 2.41, N equal paths about 1 / sqrt(N); one path alone has infinity.

    Source: L. J. Greenstein, D. G. Michelson and V. Erceg, "Moment-method estimation of the Ricean K-factor", IEEE
    Communications Letters 3(6), 1999; the moments for uniform phases follow from E|h|^4 = 2 G^2 - sum P^2.
    """
    power = _power(paths, power)
    others = np.where(_is_strongest(paths, power), 0.0, power)
    constant, strongest = np.sqrt(_total(paths, power**2)), _total(paths, power - others)
    # sum P - q without cancellation where one path is far above the others: q - P_0 = sum of others^2 / (q + P_0)
    both = np.where(constant > 0, constant + strongest, 1.0)
    rest = _total(paths, others) - _total(paths, others**2) / both
    alone = np.where(constant > 0, np.inf, np.nan)
    return np.where(rest > 0, constant / np.where(rest > 0, rest, 1.0), alone)


def _is_strongest(paths: CarrierPaths, power: np.ndarray) -> np.ndarray:
    """Return True for one path a link, that of the most power, shape [P]."""
    order = np.lexsort((power, paths.link))
    out = np.zeros(len(paths), dtype=bool)
    out[order[np.cumsum(paths.path_count)[paths.path_count > 0] - 1]] = True
    return out


def _ratio(paths: CarrierPaths, dominant: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Return the power of some paths over that of the others, infinite without others, shape [L]."""
    above, rest = _total(paths, dominant), _total(paths, others)
    alone = np.where(above > 0, np.inf, np.nan)
    return np.where(rest > 0, above / np.where(rest > 0, rest, 1.0), alone)


def mean_delay(paths: CarrierPaths, power: np.ndarray | None = None) -> np.ndarray:
    """Return the mean absolute delay weighted by power [s], shape [L]. Source: ITU-R P.1407, section 2.2.2."""
    return _moments(paths, paths.tau, power)[0]


def rms_delay_spread(paths: CarrierPaths, power: np.ndarray | None = None) -> np.ndarray:
    """Return the standard deviation of the delay weighted by power [s], shape [L].

    Source: ITU-R P.1407, section 2.2.3.

    Examples:
        >>> import mmw
        >>> paths = mmw.open_dataset("out/quickstart").paths(28e9, weather="sunny", frames=range(0, 1))
        >>> (rms_delay_spread(paths) * 1e9).round(1).tolist()  # nanoseconds
        [36.9, 0.0, 18.3]
    """
    return _moments(paths, paths.tau, power)[1]


def mean_doppler(paths: CarrierPaths, power: np.ndarray | None = None) -> np.ndarray:
    """Return the mean Doppler shift weighted by power [Hz], shape [L]. Source: as `doppler_spread`."""
    return _moments(paths, paths.doppler_hz, power)[0]


def doppler_spread(paths: CarrierPaths, power: np.ndarray | None = None) -> np.ndarray:
    """Return the standard deviation of the Doppler shift weighted by power [Hz], shape [L].

    Source: A. F. Molisch, Wireless Communications, 2nd edition, chapter 6 (moments of the Doppler spectrum).
    """
    return _moments(paths, paths.doppler_hz, power)[1]


def azimuth_spread(paths: CarrierPaths, end: Literal["tx", "rx"], power: np.ndarray | None = None) -> np.ndarray:
    """Return the circular spread of the azimuths of departure (`tx`) or arrival (`rx`) [rad], shape [L].

    AS = sqrt(-2 ln (|sum P e^{j phi}| / sum P)): 0 for one direction, without bound where directions cancel. It does
    not depend on where azimuths start. Source: 3GPP TR 38.901, Annex A.1, equation A-1.
    """
    return _circular_spread(paths, _angle(end, paths.phi_t, paths.phi_r), power)


def zenith_spread(paths: CarrierPaths, end: Literal["tx", "rx"], power: np.ndarray | None = None) -> np.ndarray:
    """Return the circular spread of the zenith angles of departure (`tx`) or arrival (`rx`) [rad], shape [L].

    Source: 3GPP TR 38.901, Annex A.1, equation A-1, which holds for zenith angles too.
    """
    return _circular_spread(paths, _angle(end, paths.theta_t, paths.theta_r), power)


def _angle(end: str, departure: np.ndarray, arrival: np.ndarray) -> np.ndarray:
    if end not in ("tx", "rx"):
        raise InputError(f"end = {end!r}; it is tx or rx")
    return departure if end == "tx" else arrival


def _circular_spread(paths: CarrierPaths, angle: np.ndarray, power: np.ndarray | None) -> np.ndarray:
    weight = _weights(paths, power)
    mean = np.arctan2(_total(paths, weight * np.sin(angle)), _total(paths, weight * np.cos(angle)))
    # About the mean direction the sum is real: 1 - |sum| loses no digits however small the spread is.
    lost = 2 * _total(paths, weight * np.sin(0.5 * (angle - mean[paths.link])) ** 2)
    is_empty = paths.path_count == 0
    with np.errstate(divide="ignore"):
        spread = np.sqrt(-2 * np.log1p(-np.minimum(lost, 1.0)))
    return np.where(is_empty, np.nan, spread)


def frequency_correlation(paths: CarrierPaths, spacings_hz: ArrayLike, power: np.ndarray | None = None) -> np.ndarray:
    """Return |sum P e^{-j 2 pi df tau}| / sum P of frequencies that lie df apart, shape [L, K].

    Source: the Fourier transform of the power delay profile (uncorrelated scattering); ITU-R P.1407, section 4.2.1.
    """
    weight = _weights(paths, power)
    columns = []
    for spacing in np.atleast_1d(np.asarray(spacings_hz, dtype=np.float64)):
        phase = 2 * np.pi * spacing * paths.tau
        columns.append(np.hypot(_total(paths, weight * np.cos(phase)), _total(paths, weight * np.sin(phase))))
    return np.where((paths.path_count == 0)[:, None], np.nan, np.stack(columns, axis=1))


def coherence_bandwidth(paths: CarrierPaths, level: float = 0.5, power: np.ndarray | None = None) -> np.ndarray:
    """Return the coherence bandwidth from the rms delay spread [Hz], shape [L]; infinite for a single path.

    1 / (5 sigma) for a correlation of 0.5, 1 / (50 sigma) for 0.9: rules of thumb, right to a factor of a few.
    `frequency_correlation` gives the correlation itself.

    Raises:
        InputError: If the level is neither.

    Source: T. S. Rappaport, Wireless Communications, 2nd edition, equations 5.38 and 5.39.
    """
    if level not in (0.5, 0.9):
        raise InputError(f"coherence_bandwidth: level = {level}; the rules hold for 0.5 and 0.9")
    spread = rms_delay_spread(paths, power)
    with np.errstate(divide="ignore"):
        return 1.0 / ((5.0 if level == 0.5 else 50.0) * spread)
