"""Compute reflection and transmission at a flat surface: half-space, slab or perfect conductor, in complex float64."""

import numpy as np

from mmw.core.constants import SPEED_OF_LIGHT

OPAQUE_NEPER = 100.0
"""A slab that weakens a wave more than this on one crossing, by 869 dB, lets nothing through [Np]: products of such
numbers would underflow."""


def reflection(
    permittivity: np.ndarray, cosine: np.ndarray, thickness: np.ndarray, carrier_hz: float | np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the reflection coefficients perpendicular (TE) and parallel (TM) to the plane of incidence.

    Args:
        permittivity: Complex relative permittivity of the surface, imaginary part at most 0, shape [P]; infinite means
            a perfect conductor, r_TE = -1 and r_TM = +1 exactly; 1 reflects exactly 0.
        cosine: Cosine of the angle between ray and normal, 0 to 1, shape [P].
        thickness: Slab thickness [m], shape [P]; 0 means a half-space.
        carrier_hz: Carrier frequency [Hz], one or shape [P].

    Returns:
        Coefficients for e^{+jwt}, shape [P] each. At normal incidence r_TM = -r_TE.

    Source: ITU-R P.2040-4, equations 37a, 37b (half-space), 43 and 44 (slab).
    """
    conductor, single_trip, interfaces = _slab(permittivity, cosine, thickness, carrier_hz)
    round_trip = single_trip**2
    te, tm = (r * (1.0 - round_trip) / _echoes(crossing, round_trip) for r, crossing in interfaces)
    return np.where(conductor, -1.0, te), np.where(conductor, 1.0, tm)


def transmission(
    permittivity: np.ndarray, cosine: np.ndarray, thickness: np.ndarray, carrier_hz: float | np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return the transmission coefficients of a slab with air on both sides, for both polarizations.

    The wave goes on in its old direction. The coefficient holds the phase of the slab, e^{-jq}; the length of
    a straight ray through the slab is counted on top of it, as Sionna RT does.

    Args:
        permittivity: Complex relative permittivity, shape [P]; infinite (a perfect conductor) lets nothing through.
        cosine: Cosine of the angle between ray and normal, 0 to 1, shape [P].
        thickness: Slab thickness [m], shape [P]; 0 means a half-space, which lets nothing through.
        carrier_hz: Carrier frequency [Hz], one or shape [P].

    Returns:
        Coefficients t_TE and t_TM for e^{+jwt}, shape [P] each; 0 where nothing comes through.

    Source: ITU-R P.2040-4, equations 43 and 44: T = (1 - r^2) e^{-jq} / (1 - r^2 e^{-2jq}).
    """
    conductor, single_trip, interfaces = _slab(permittivity, cosine, thickness, carrier_hz)
    te, tm = (crossing * single_trip / _echoes(crossing, single_trip**2) for _, crossing in interfaces)
    return np.where(conductor, 0.0, te), np.where(conductor, 0.0, tm)


def _slab(
    permittivity: np.ndarray, cosine: np.ndarray, thickness: np.ndarray, carrier_hz: float | np.ndarray
) -> tuple[np.ndarray, np.ndarray, list[tuple[np.ndarray, np.ndarray]]]:
    """Return where the surface is a perfect conductor, e^{-jq} of one crossing, and (r, 1 - r^2) of TE and of TM.

    q = 2 pi d sqrt(eta - sin^2) / lambda. A half-space sends nothing back from its far side: its e^{-jq} is 0.
    """
    conductor = np.isinf(permittivity)
    eta = np.where(conductor, 1.0, permittivity)
    inner = np.sqrt(eta - (1.0 - cosine**2))
    inner = np.where(inner.imag > 0.0, -inner, inner)  # the wave dies out inside, also without any loss
    inner = np.where(eta == 1.0, cosine, inner)  # vacuum reflects exactly nothing: 1 - (1 - c^2) is only close to c^2
    exponent = -2j * np.pi * thickness * carrier_hz / SPEED_OF_LIGHT * inner
    through = (thickness > 0.0) & ~(exponent.real < -OPAQUE_NEPER)
    single_trip = np.where(through, np.exp(np.where(through, exponent, 0.0)), 0.0)
    interfaces = []
    for outside in (cosine, eta * cosine):
        total = outside + inner
        total = np.where(total == 0.0, 1.0, total)  # vacuum at grazing incidence: r = 0 / 0, and nothing reflects
        interfaces.append(((outside - inner) / total, 4.0 * outside * inner / total**2))
    return conductor, single_trip, interfaces


def _echoes(crossing: np.ndarray, round_trip: np.ndarray) -> np.ndarray:
    """Return 1 - r^2 e^{-2jq}, from 1 - r^2: r^2 itself is too close to 1 at grazing angles."""
    return (1.0 - round_trip) + crossing * round_trip
