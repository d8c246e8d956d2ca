"""The field along found paths: angles, polarisation, reflection and spreading, all in float64.

Source: image theory for the spreading; ITU-R P.2040-4 for the coefficients; polarisation by ray-fixed TE and TM axes as
in C. A. Balanis, Advanced Engineering Electromagnetics, chapter 5.
"""

from dataclasses import dataclass

import numpy as np

from mmw.channel.fresnel import reflection
from mmw.channel.vectors import direction_angles, dot, norm, spherical_basis
from mmw.constants import SPEED_OF_LIGHT


@dataclass(frozen=True)
class PathGeometry:
    """What the field of a path needs, before any material or frequency."""

    departure: np.ndarray
    """Unit direction leaving the transmitter, shape [P, 3]."""
    arrival: np.ndarray
    """Unit direction from the receiver back along the path, shape [P, 3]."""
    length: np.ndarray
    """Total length [m], shape [P]."""
    cosine: np.ndarray
    """Cosine of incidence, shape [P]; 1 for the line of sight."""
    te: np.ndarray
    """Weights of the TE coefficient (or of 1, for the line of sight) in the transfer, shape [P, 2, 2]."""
    tm: np.ndarray
    """Weights of the TM coefficient in the transfer, shape [P, 2, 2]; 0 for the line of sight."""
    theta_t: np.ndarray
    phi_t: np.ndarray
    theta_r: np.ndarray
    phi_r: np.ndarray


def path_geometry(tx: np.ndarray, rx: np.ndarray, vertex: np.ndarray, normal: np.ndarray) -> PathGeometry:
    """Return directions, length and polarisation weights of paths.

    Args:
        tx: Transmitters [m], shape [P, 3].
        rx: Receivers [m], shape [P, 3].
        vertex: Points of reflection [m], shape [P, 3]; NaN for the line of sight.
        normal: Unit normals at the points, either side, shape [P, 3]; NaN for the line of sight.
    """
    is_los = ~np.isfinite(vertex[:, 0])
    first = np.where(is_los[:, None], rx, vertex) - tx
    last = np.where(is_los[:, None], tx, vertex) - rx
    first_length, last_length = norm(first), norm(last)
    departure, arrival = first / first_length[:, None], last / last_length[:, None]
    theta_t, phi_t = direction_angles(departure)
    theta_r, phi_r = direction_angles(arrival)
    out_basis, in_basis = spherical_basis(theta_t, phi_t), spherical_basis(theta_r, phi_r)

    safe_normal = np.where(is_los[:, None], [0.0, 0.0, 1.0], normal)
    te_axis = _perpendicular(departure, safe_normal)
    parallel_in, parallel_out = np.cross(departure, te_axis), np.cross(-arrival, te_axis)
    te, tm = np.empty((len(tx), 2, 2)), np.empty((len(tx), 2, 2))
    for row in range(2):
        for column in range(2):
            direct = dot(in_basis[row], out_basis[column])
            s_part = dot(in_basis[row], te_axis) * dot(te_axis, out_basis[column])
            p_part = dot(in_basis[row], parallel_out) * dot(parallel_in, out_basis[column])
            te[:, row, column] = np.where(is_los, direct, s_part)
            tm[:, row, column] = np.where(is_los, 0.0, p_part)
    return PathGeometry(
        departure=departure,
        arrival=arrival,
        length=first_length + np.where(is_los, 0.0, last_length),
        cosine=np.where(is_los, 1.0, np.minimum(np.abs(dot(departure, safe_normal)), 1.0)),
        te=te,
        tm=tm,
        theta_t=theta_t,
        phi_t=phi_t,
        theta_r=theta_r,
        phi_r=phi_r,
    )


def _perpendicular(direction: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return the unit TE axis, direction x normal; any axis across the ray at normal incidence. Shape [P, 3]."""
    axis = np.cross(direction, normal)
    is_normal = dot(axis, axis) < 1e-12
    other = np.where(np.abs(direction[:, :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    axis = np.where(is_normal[:, None], np.cross(direction, other), axis)
    return axis / norm(axis)[:, None]


def polarimetric_transfer(
    geometry: PathGeometry,
    is_reflected: np.ndarray,
    permittivity: np.ndarray,
    thickness: np.ndarray,
    scattering: np.ndarray,
    carrier_hz: float,
) -> np.ndarray:
    """Return the 2x2 transfer of every path: receive by transmit component in the (theta, phi) basis.

    Args:
        geometry: The paths.
        is_reflected: False for the line of sight, whose material values are ignored, shape [P].
        permittivity: Complex relative permittivity of the reflecting material, shape [P].
        thickness: Slab thickness, 0 for a half-space [m], shape [P].
        scattering: Scattering coefficient S, which leaves sqrt(1 - S^2) for the specular field, shape [P].
        carrier_hz: Carrier frequency [Hz].

    Returns:
        lambda / (4 pi length) times the polarisation matrix, without carrier phase, shape [P, 2, 2], complex128.

    Source: ITU-R P.2040-4, equations 37, 43, 44; S after V. Degli-Esposti et al., IEEE Trans. AP 55(1), 2007.
    """
    te, tm = reflection(np.where(is_reflected, permittivity, 1.0), geometry.cosine, thickness, carrier_hz)
    left = np.sqrt(1.0 - scattering**2)
    te, tm = np.where(is_reflected, te * left, 1.0), np.where(is_reflected, tm * left, 0.0)
    spread = SPEED_OF_LIGHT / carrier_hz / (4.0 * np.pi * geometry.length)
    weights = te[:, None, None] * geometry.te + tm[:, None, None] * geometry.tm
    return spread[:, None, None] * weights


def combine(receive: np.ndarray, transfer: np.ndarray, transmit: np.ndarray) -> np.ndarray:
    """Return the coefficient between every pair of elements.

    Args:
        receive: Receive fields (theta, phi), shape [P, K, 2].
        transfer: Polarimetric transfer, shape [P, 2, 2].
        transmit: Transmit fields, shape [P, T, 2].

    Returns:
        F_r^T transfer F_t, shape [P, K, T], complex128.
    """
    theta, phi = transmit[:, :, 0], transmit[:, :, 1]
    sent = [transfer[:, row, None, 0] * theta + transfer[:, row, None, 1] * phi for row in range(2)]
    return receive[:, :, 0, None] * sent[0][:, None, :] + receive[:, :, 1, None] * sent[1][:, None, :]
