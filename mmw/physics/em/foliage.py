"""Compute how foliage weakens waves, and what radio material its outer leaves scatter by."""

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from mmw.core.remember import remembered
from mmw.physics.materials.material import Material

KNEE_M = 14.0
"""Length beyond which waves find their way around leaves, and the loss grows slower [m]."""

SCATTERING, XPD = 1.0, 0.2
"""Scattering coefficient S and cross-polarisation coefficient of leaves without a coefficient of their own: nothing is
left for a mirror, and with the Fresnel coefficient of wood (0.17 at normal incidence) a hull sends back 4 S^2 Gamma^2 =
-9 dB at normal incidence, close to what the radar's leaves do (`mmw.sensors.radar.reflectivity`). Engineering values:
of measured crowns the strength spreads by 10 dB."""


def foliage_loss_db(carriers_hz: ArrayLike, length_m: ArrayLike) -> np.ndarray:
    """Return the one-way loss of each path in foliage, trees in leaf.

    The formula is fitted from 0.23 to 95 GHz and to 400 m; beyond, its powers go on. It falls by 0.4 % at 14 m.

    Args:
        carriers_hz: Carrier frequencies [Hz], shape [C].
        length_m: Length inside of foliage along each path [m], shape [P].

    Returns:
        Loss [dB], shape [P, C]; 0 without foliage.

    Source: M. A. Weissberger, "An initial critical summary of models for predicting the attenuation of radio waves by
    trees", ESD-TR-81-101, 1982: the modified exponential decay model.
    """
    ghz = np.atleast_1d(np.asarray(carriers_hz, dtype=np.float64)) / 1e9
    length = np.asarray(length_m, dtype=np.float64)[:, None]
    return ghz**0.284 * np.where(length < KNEE_M, 0.45 * length, 1.33 * length**0.588)


@remembered(size=64)
def with_scattering_foliage(materials: tuple[Material, ...]) -> tuple[Material, ...]:
    """Return materials by id, of which those of foliage without a scattering coefficient have `SCATTERING`."""
    return tuple(
        replace(material, radio=replace(material.radio, scattering=SCATTERING, xpd=XPD))
        if material.radio.medium == "foliage" and material.radio.scattering == 0.0
        else material
        for material in materials
    )
