"""Compute reflection and transmission at a flat surface: half-space, slab or perfect conductor, in complex float64."""

from typing import Any

import numpy as np

from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.host_kernels import as_complex, as_pairs, run_on_host
from mmw.kernels.channel.plane_response import OPAQUE_NEPER as _OPAQUE_NEPER
from mmw.kernels.channel.plane_response import slab_kernel

OPAQUE_NEPER = float(_OPAQUE_NEPER.value)
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
    return _coefficients(False, permittivity, cosine, thickness, carrier_hz)


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
    return _coefficients(True, permittivity, cosine, thickness, carrier_hz)


def _coefficients(is_through: bool, *given: Any) -> tuple[np.ndarray, np.ndarray]:
    """Return TE and TM of what a slab lets through, or reflects, of arguments that broadcast.

    q = 2 pi d sqrt(eta - sin^2) / lambda. A half-space sends nothing back from its far side: its e^{-jq} is 0.
    """
    permittivity, cosine, thickness, carrier_hz = np.broadcast_arrays(*given)
    shape, count = permittivity.shape, permittivity.size
    wave_number = 2.0 * np.pi / SPEED_OF_LIGHT * carrier_hz.reshape(-1)
    inputs = as_pairs(permittivity.reshape(-1)), cosine.reshape(-1), thickness.reshape(-1), wave_number
    (out,) = run_on_host(slab_kernel, (count,), inputs, [is_through], ((count,),))
    te, tm = as_complex(out.reshape(count, 2, 2)).T
    return te.reshape(shape), tm.reshape(shape)
