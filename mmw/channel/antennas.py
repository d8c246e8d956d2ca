"""Element patterns and polarisation: the field vector of an antenna in any direction.

Angles: zenith theta from +z, azimuth phi from +x. The local frame of an antenna is the agent's frame: x forward, y
left, z up; a vertical dipole lies along local z, and turns with the agent's full attitude.

Source: patterns and polarisation models of 3GPP TR 38.901, section 7.3, and of Sionna RT 2.2, whose amplitudes these
equal.
"""

from typing import Literal

import numpy as np

from mmw.channel.vectors import direction_angles, dot, rotate, spherical_basis, unrotate

PatternName = Literal["iso", "dipole", "hw_dipole", "tr38901"]
PolarizationName = Literal["V", "H", "VH", "cross"]
PolarizationModel = Literal["tr38901_1", "tr38901_2"]

SLANTS: dict[str, tuple[float, ...]] = {
    "V": (0.0,),
    "H": (np.pi / 2,),
    "VH": (0.0, np.pi / 2),
    "cross": (-np.pi / 4, np.pi / 4),
}
"""Slant angle of each element of a polarisation [rad]."""


def pattern_amplitude(name: PatternName, theta: np.ndarray, phi: np.ndarray) -> np.ndarray:
    """Return the amplitude (the square root of the gain) of an element, >= 0.

    Args:
        name: `iso`; `dipole`, a short one along z of gain 1.5; `hw_dipole`, half a wavelength long; `tr38901`, a
            sector.
        theta: Zenith in the antenna's frame [rad].
        phi: Azimuth in the antenna's frame [rad].

    Raises:
        ValueError: If the pattern is not known.

    Source: TR 38.901 table 7.3-1 for `tr38901`; C. A. Balanis, Antenna Theory, sections 4.2 and 4.6 for the dipoles.
    """
    if name == "iso":
        return np.ones_like(theta)
    if name == "dipole":
        return np.sqrt(1.5) * np.abs(np.sin(theta))
    if name == "hw_dipole":
        sine = np.sin(theta)
        on_axis = np.abs(sine) < 1e-9
        return np.where(
            on_axis, 0.0, np.sqrt(1.643) * np.abs(np.cos(np.pi / 2 * np.cos(theta)) / np.where(on_axis, 1.0, sine))
        )
    if name == "tr38901":
        beam = np.deg2rad(65.0)
        vertical = np.minimum(12.0 * ((theta - np.pi / 2) / beam) ** 2, 30.0)
        horizontal = np.minimum(12.0 * (phi / beam) ** 2, 30.0)
        return 10.0 ** ((8.0 - np.minimum(vertical + horizontal, 30.0)) / 20.0)
    raise ValueError(f"pattern = {name!r}; known patterns are iso, dipole, hw_dipole, tr38901")


def polarization_components(
    slant: float, theta: np.ndarray, phi: np.ndarray, model: PolarizationModel = "tr38901_2"
) -> tuple[np.ndarray, np.ndarray]:
    """Return the share of the amplitude along the local theta and phi unit vectors.

    Args:
        slant: Slant angle, 0 for vertical and pi/2 for horizontal [rad].
        theta: Zenith in the antenna's frame [rad].
        phi: Azimuth in the antenna's frame [rad].
        model: `tr38901_2` has the same slant in every direction; `tr38901_1` turns a slanted element in space.

    Source: TR 38.901 section 7.3.2, equations 7.3-3 to 7.3-5.
    """
    if model == "tr38901_2":
        return np.full_like(theta, np.cos(slant)), np.full_like(theta, np.sin(slant))
    along = np.cos(slant) * np.cos(theta) - np.sin(slant) * np.sin(phi) * np.sin(theta)
    scale = np.sqrt(np.maximum(1.0 - along**2, 0.0))
    scale = np.where(scale < 1e-9, 1.0, scale)
    return (
        (np.cos(slant) * np.sin(theta) + np.sin(slant) * np.sin(phi) * np.cos(theta)) / scale,
        np.sin(slant) * np.cos(phi) / scale,
    )


def antenna_field(
    direction: np.ndarray,
    rotation: np.ndarray,
    pattern: PatternName,
    polarization: PolarizationName,
    model: PolarizationModel = "tr38901_2",
) -> np.ndarray:
    """Return the far field of an antenna in the world's theta and phi basis.

    Args:
        direction: Unit directions away from the antenna, world frame, shape [P, 3]. For a receiver: towards the
            incoming wave.
        rotation: Antenna-to-world rotations, shape [P, 3, 3].
        pattern: Element pattern.
        polarization: One element for `V` and `H`, two for `VH` and `cross`.
        model: Polarisation model.

    Returns:
        Real field components (theta, phi), shape [P, elements, 2].
    """
    local = unrotate(rotation, direction)
    theta, phi = direction_angles(local)
    theta_hat, phi_hat = (rotate(rotation, vector) for vector in spherical_basis(theta, phi))
    basis = spherical_basis(*direction_angles(direction))
    amplitude = pattern_amplitude(pattern, theta, phi)
    field = np.empty((len(direction), len(SLANTS[polarization]), 2))
    for element, slant in enumerate(SLANTS[polarization]):
        along_theta, along_phi = polarization_components(slant, theta, phi, model)
        vector = amplitude[:, None] * (along_theta[:, None] * theta_hat + along_phi[:, None] * phi_hat)
        for axis in range(2):
            field[:, element, axis] = dot(vector, basis[axis])
    return field
