"""Fields along paths in NumPy: what the kernels on the host compute, for any rows at once."""

import numpy as np

from mmw.core.constants import SPEED_OF_LIGHT
from mmw.physics.em.interaction import DIFFRACTION, DIFFUSE, SPECULAR, TRANSMISSION
from mmw.physics.em.vectors import direction_angles, dot, norm, rotate, spherical_basis, unrotate

OPAQUE_NEPER = 100.0
"""Weakening of a slab above which it lets nothing through [Np]."""


def perpendicular(direction: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return the unit TE axis; any axis across the ray at normal incidence. Shape [..., 3]."""
    axis = np.cross(direction, normal)
    other = np.where(np.abs(direction[..., :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    axis = np.where((dot(axis, axis) < 1e-12)[..., None], np.cross(direction, other), axis)
    length = norm(axis)
    return axis / np.where(length > 0.0, length, 1.0)[..., None]  # behind a path of no length there is no axis


def path_geometry(
    tx: np.ndarray, rx: np.ndarray, kind: np.ndarray, vertex: np.ndarray, normal: np.ndarray, edge: np.ndarray
) -> dict[str, np.ndarray]:
    """Return the arrays of `mmw.physics.em.field.PathGeometry` by name."""
    count, depth = kind.shape
    order, column = (kind != 0).sum(axis=1)[:, None], np.arange(depth + 1)
    inner = np.where((column[:-1] < order)[..., None], vertex, rx[:, None])
    span = np.diff(np.concatenate([tx[:, None], inner, rx[:, None]], axis=1), axis=1)
    length = norm(span)
    unit = span / np.where(length > 0.0, length, 1.0)[..., None]
    direction = unit[np.arange(count)[:, None], np.minimum(column, order)]
    k_in, k_out = direction[:, :-1], direction[:, 1:]
    angles = [direction_angles(end) for end in (direction[:, 0], -direction[:, -1])]
    leaving, arriving = (np.stack(spherical_basis(*angle), axis=1) for angle in angles)
    has_normal = np.isin(kind, (SPECULAR, TRANSMISSION, DIFFUSE))
    facing = np.where(has_normal[..., None], normal, [0.0, 0.0, 1.0])
    is_edge, is_rough, is_none = ((kind == code)[..., None, None] for code in (DIFFRACTION, DIFFUSE, 0))
    across = perpendicular(k_in, facing)
    into_axis = np.where(is_edge[..., 0], perpendicular(k_in, edge), across)
    out_axis = np.where(is_edge[..., 0], -perpendicular(k_out, edge), across)
    into = np.stack([into_axis, np.cross(k_in, into_axis)], axis=2)
    out = np.stack([out_axis, np.cross(k_out, out_axis)], axis=2)
    into = np.where(is_rough, np.stack(spherical_basis(*direction_angles(k_in)), axis=2), into)
    out = np.where(is_rough, np.stack(spherical_basis(*direction_angles(k_out)), axis=2), out)
    into, out = (np.where(is_none, arriving[:, None], basis) for basis in (into, out))
    all_into = np.concatenate([into, arriving[:, None]], axis=1)
    all_out = np.concatenate([leaving[:, None], out], axis=1)
    turn = np.einsum("psix,psjx->psij", all_into, all_out)
    turn[column > order] = np.eye(2)
    cosine = np.where(has_normal, np.minimum(np.abs(dot(k_in, facing)), 1.0), 1.0)
    names = "direction", "segment_length", "cosine", "incoming", "turn", "theta_t", "phi_t", "theta_r", "phi_r"
    return dict(zip(names, (direction, length, cosine, into, turn, *angles[0], *angles[1]), strict=True))


def slab(
    permittivity: np.ndarray, cosine: np.ndarray, thickness: np.ndarray, carrier_hz: np.ndarray
) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Return r_TE and r_TM, then t_TE and t_TM: ITU-R P.2040-4, equations 37, 43 and 44."""
    conductor = np.isinf(permittivity)
    eta = np.where(conductor, 1.0, permittivity)
    inner = np.sqrt(eta - (1.0 - cosine**2))
    inner = np.where(inner.imag > 0.0, -inner, inner)
    inner = np.where(eta == 1.0, cosine, inner)
    exponent = -2j * np.pi * thickness * carrier_hz / SPEED_OF_LIGHT * inner
    through = (thickness > 0.0) & ~(exponent.real < -OPAQUE_NEPER)
    trip = np.where(through, np.exp(np.where(through, exponent, 0.0)), 0.0)
    reflected, passed = [], []
    for outside, of_conductor in ((cosine + 0j, -1.0), (eta * cosine, 1.0)):
        total = np.where(outside + inner == 0.0, 1.0, outside + inner)
        crossing = 4.0 * outside * inner / total**2
        echoes = (1.0 - trip**2) + crossing * trip**2
        reflected.append(np.where(conductor, of_conductor, (outside - inner) / total * (1.0 - trip**2) / echoes))
        passed.append(np.where(conductor, 0.0, crossing * trip / echoes))
    return (reflected[0], reflected[1]), (passed[0], passed[1])


def mirror_share(
    scattering: np.ndarray, rms_height: np.ndarray, cosine: np.ndarray, carrier_hz: np.ndarray
) -> np.ndarray:
    """Return sqrt(1 - S^2) exp(-8 (pi s cos / lambda)^2), shape of the arguments."""
    phase = np.pi * rms_height * cosine * carrier_hz / SPEED_OF_LIGHT
    return np.sqrt(1.0 - scattering**2) * np.exp(-8.0 * phase**2)


def transfer(matrices: np.ndarray, turn: np.ndarray, factor: np.ndarray) -> np.ndarray:
    """Return the product of all turns and matrices, from the transmitter to the receiver, times a factor.

    Args:
        matrices: Matrix of each interaction, shape [P, C, D, 2, 2].
        turn: Matrices between them, shape [P, D + 1, 2, 2].
        factor: Shape [P, C].
    """
    total = turn[:, None, 0].astype(np.complex128)
    for step in range(matrices.shape[2]):
        total = turn[:, None, step + 1] @ matrices[:, :, step] @ total
    return factor[..., None, None] * total


def antenna_field(
    direction: np.ndarray, rotation: np.ndarray, amplitude: np.ndarray, slants: tuple[float, ...], model: str
) -> np.ndarray:
    """Return the field (theta, phi) of elements, shape [P, elements, 2]: TR 38.901, section 7.3.2.

    Args:
        direction: Unit directions, world frame, shape [P, 3].
        rotation: Antenna-to-world rotations, shape [P, 3, 3].
        amplitude: Amplitudes (theta, phi) in the antenna's frame without a slant, shape [P, 2].
        slants: Slant of each element [rad].
        model: `tr38901_1` or `tr38901_2`.
    """
    theta, phi = direction_angles(unrotate(rotation, direction))
    own = [rotate(rotation, axis) for axis in spherical_basis(theta, phi)]
    world = spherical_basis(*direction_angles(direction))
    out = []
    for slant in slants:
        cosine, sine = np.full(len(theta), np.cos(slant)), np.full(len(theta), np.sin(slant))
        if model == "tr38901_1":
            along = np.cos(slant) * np.cos(theta) - np.sin(slant) * np.sin(phi) * np.sin(theta)
            scale = np.sqrt(np.maximum(1.0 - along**2, 0.0))
            scale = np.where(scale < 1e-9, 1.0, scale)
            cosine = (np.cos(slant) * np.sin(theta) + np.sin(slant) * np.sin(phi) * np.cos(theta)) / scale
            sine = np.sin(slant) * np.cos(phi) / scale
        parts = (
            amplitude[:, 0] * cosine - amplitude[:, 1] * sine,
            amplitude[:, 0] * sine + amplitude[:, 1] * cosine,
        )
        vector = sum(part[:, None] * axis for part, axis in zip(parts, own, strict=True))
        out.append(np.stack([dot(vector, axis) for axis in world], axis=1))
    return np.stack(out, axis=1)
