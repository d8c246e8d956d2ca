"""Compute reflection and transmission of a stack of flat layers and thin conducting sheets, in complex float64.

Each layer turns the load behind it into the load in front of it, from the back to the front: the wave admittance across
the layers for TE, where sheets lie in parallel, and the wave impedance for TM. A load is a ratio, of which numerator
and denominator are kept apart, so that a perfect conductor and a layer at grazing incidence need no case of their own.
No growing exponential appears, so thick lossy layers are safe.

Source: the transmission-line form of plane waves in layers, as in C. A. Balanis, Advanced Engineering Electromagnetics,
chapter 5, and S. J. Orfanidis, Electromagnetic Waves and Antennas, chapter 8; the same coefficients as those of the
multilayer slab of ITU-R P.2040-4. A sheet thinner than its skin depth is a jump of the tangential magnetic field.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mmw.core.constants import SPEED_OF_LIGHT
from mmw.physics.em.fresnel import OPAQUE_NEPER

FREE_SPACE_OHM = 376.730313412
"""Wave impedance of vacuum [ohm]. Source: CODATA 2022."""


@dataclass(frozen=True)
class StackLayer:
    """One layer at one carrier: a substance, or a sheet."""

    permittivity: complex = 1.0 + 0.0j
    """Complex relative permittivity for e^{+jwt}; infinite for a perfect conductor."""
    thickness: float = 0.0
    """Thickness [m]; of the last layer 0 for a half-space."""
    sheet_resistance: float = 0.0
    """Resistance of a conducting sheet [ohm/square]; 0 for a substance."""


@dataclass(frozen=True)
class StackCoefficients:
    """Reflection and transmission of a stack for both polarizations, in the conventions of `mmw.physics.em.fresnel`."""

    r_te: np.ndarray
    r_tm: np.ndarray
    t_te: np.ndarray
    t_tm: np.ndarray


def stack_coefficients(layers: Sequence[StackLayer], cosine: np.ndarray, carrier_hz: float) -> StackCoefficients:
    """Return the coefficients of layers with air in front, and air behind unless the last one is a half-space.

    Args:
        layers: Layers from the front to the back; the last may have thickness 0, which makes it a half-space.
        cosine: Cosine of the angle between ray and normal, 0 to 1, shape [P].
        carrier_hz: Carrier frequency [Hz].

    Returns:
        Coefficients for e^{+jwt}, complex128, shape [P] each. The transmission holds the phase of the layers on top of
        that of a straight ray, as `mmw.physics.em.fresnel.transmission` does.
    """
    r_te, t_te = _coefficients(layers, cosine, carrier_hz, is_te=True)
    r_tm, t_tm = _coefficients(layers, cosine, carrier_hz, is_te=False)
    return StackCoefficients(r_te, r_tm, t_te, t_tm)


def _coefficients(
    layers: Sequence[StackLayer], cosine: np.ndarray, carrier_hz: float, *, is_te: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Return reflection and transmission of one polarization, shape [P] each."""
    outside = cosine + 0j
    numerator, denominator = outside, np.ones_like(outside)
    through = np.ones_like(outside)
    for layer in reversed(layers):
        if layer.sheet_resistance > 0.0:
            conductance = FREE_SPACE_OHM / layer.sheet_resistance
            if is_te:
                numerator = numerator + conductance * denominator
            else:
                denominator = denominator + conductance * numerator
            continue
        if np.isinf(layer.permittivity):  # no tangential field: admittance infinite, impedance 0
            numerator, denominator = np.full_like(outside, is_te), np.full_like(outside, not is_te)
            through = np.zeros_like(outside)
            continue
        inner = _across(layer.permittivity, cosine)
        wave = inner if is_te else inner / layer.permittivity
        if layer.thickness == 0.0:
            numerator, denominator, through = wave, np.ones_like(outside), np.zeros_like(outside)
            continue
        exponent = -2j * np.pi * layer.thickness * carrier_hz / SPEED_OF_LIGHT * inner
        is_open = ~(exponent.real < -OPAQUE_NEPER)
        exponent = np.where(is_open, exponent, 0.0)
        trip = np.where(is_open, np.exp(exponent), 0.0)
        lost = np.where(is_open, -np.expm1(2.0 * exponent), 1.0)  # 1 - e^{-2jq}, exact for thin layers
        difference = wave * denominator - numerator
        numerator, denominator = (
            wave * (2.0 * numerator + difference * lost),
            2.0 * wave * denominator - difference * lost,
        )
        through = through * 2.0 * wave * trip
    total = outside * denominator + numerator
    total = np.where(total == 0.0, 1.0, total)  # vacuum at grazing incidence: nothing reflects
    return (outside * denominator - numerator) / total, through * 2.0 * outside / total


def _across(permittivity: complex, cosine: np.ndarray) -> np.ndarray:
    """Return the wave number across a layer over that of vacuum, shape [P]; the wave dies out inside."""
    if permittivity == 1.0:
        return cosine + 0j
    inner = np.sqrt(permittivity - (1.0 - cosine**2) + 0j)
    return np.where(inner.imag > 0.0, -inner, inner)
