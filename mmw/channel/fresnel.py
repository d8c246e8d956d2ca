"""Reflection at a flat surface: half-space or slab, for both polarisations, in complex float64."""

import numpy as np

from mmw.constants import SPEED_OF_LIGHT


def reflection(
    permittivity: np.ndarray, cosine: np.ndarray, thickness: np.ndarray, carrier_hz: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the reflection coefficients perpendicular (TE) and parallel (TM) to the plane of incidence.

    Args:
        permittivity: Complex relative permittivity of the surface, shape [P].
        cosine: Cosine of the angle between ray and normal, 0 to 1, shape [P].
        thickness: Slab thickness [m], shape [P]; 0 means a half-space.
        carrier_hz: Carrier frequency [Hz].

    Returns:
        Coefficients for e^{+jwt}, shape [P] each. At normal incidence r_TM = -r_TE.

    Source: ITU-R P.2040-4, equations 37a, 37b (half-space), 43 and 44 (slab).
    """
    inner = np.sqrt(permittivity - (1.0 - cosine**2))
    te = (cosine - inner) / (cosine + inner)
    tm = (permittivity * cosine - inner) / (permittivity * cosine + inner)
    # exp(-2jq), q = 2 pi d sqrt(eta - sin^2) / lambda; a half-space sends nothing back from its far side.
    round_trip = np.exp(-4j * np.pi * thickness * carrier_hz / SPEED_OF_LIGHT * inner)
    round_trip = np.where(thickness > 0.0, round_trip, 0.0)
    te, tm = (r * (1.0 - round_trip) / (1.0 - r * r * round_trip) for r in (te, tm))
    return te, tm
