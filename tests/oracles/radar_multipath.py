"""Multipath of radars in closed form, float64: reflection over flat ground, images behind a plate, Lambert's sphere."""

from collections.abc import Callable

import numpy as np

LIGHT_M_S = 299_792_458.0


def vertical_reflection(permittivity: complex, grazing: np.ndarray) -> np.ndarray:
    """Return the reflection coefficient of flat ground for vertical polarization, e^{+jwt}.

    Args:
        permittivity: Complex relative permittivity, imaginary part at most 0.
        grazing: Angle between ray and ground [rad].

    Source: M. Skolnik, Introduction to Radar Systems, section on propagation over a plane earth.
    """
    root = np.sqrt(permittivity - np.cos(grazing) ** 2)
    return (permittivity * np.sin(grazing) - root) / (permittivity * np.sin(grazing) + root)


def propagation_factor(
    radar_m: float, target_m: np.ndarray, ground_range: np.ndarray, reflect: Callable[[np.ndarray], np.ndarray],
    carrier_hz: float, *, rms_height: float = 0.0, beam_rad: float = np.inf,
) -> np.ndarray:  # fmt: skip
    """Return F^4, the power of a point target above flat ground over that in free space.

    F = |1 + a rho Gamma e^{-jkd} R1 / R2| for a radar whose beam is Gaussian and level: a is the field that it sends to
    the ground over that to the target, rho Ament's factor of a rough surface, R1 and R2 the two lengths, d = R2 - R1.

    Args:
        radar_m: Height of the radar [m].
        target_m: Height of the target [m].
        ground_range: Horizontal distance [m].
        reflect: Grazing angle [rad] -> reflection coefficient of the smooth ground, e^{+jwt}.
        carrier_hz: Carrier frequency [Hz].
        rms_height: Standard deviation of the height of the ground [m].
        beam_rad: Half-power width in elevation [rad].

    Source: L. Blake in Skolnik, Radar Handbook; W. Ament, Proc. IRE 41, 1953; D. Barton, Modern Radar System Analysis.
    """
    wavelength = LIGHT_M_S / carrier_hz
    direct = np.hypot(ground_range, target_m - radar_m)
    bounced = np.hypot(ground_range, target_m + radar_m)
    # The difference of two long lengths, without cancellation.
    longer = 4.0 * radar_m * target_m / (direct + bounced)
    grazing = np.arctan2(target_m + radar_m, ground_range)
    elevation = np.arctan2(target_m - radar_m, ground_range)
    rough = np.exp(-8.0 * (np.pi * rms_height * np.sin(grazing) / wavelength) ** 2)
    beam = np.exp(-2.0 * np.log(2.0) * (grazing**2 - elevation**2) / beam_rad**2)
    phase = np.exp(-2j * np.pi * longer / wavelength)
    return np.abs(1.0 + beam * rough * reflect(grazing) * phase * direct / bounced) ** 4


def lambert_sphere_phase(angle: np.ndarray) -> np.ndarray:
    """Return what Lambert's sphere scatters by an angle between the ways in and out [rad], over what it scatters back.

    Source: J. Lambert, Photometria, 1760: (sin a + (pi - a) cos a) / pi.
    """
    return (np.sin(angle) + (np.pi - angle) * np.cos(angle)) / np.pi
