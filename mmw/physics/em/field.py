"""Compute the field along traced paths: angles, polarization, interactions and spreading, all in float64.

Every interaction is a 2x2 matrix between a basis of the incoming and one of the outgoing wave; between interactions,
and at both ends, real 2x2 matrices turn one basis into the next. So geometry is worked out once, and a weather or a
carrier only changes the matrices of the interactions.

Source: image theory for the spreading; ITU-R P.2040-4 for the coefficients; polarization by ray-fixed TE and TM axes as
in C. A. Balanis, Advanced Engineering Electromagnetics, chapter 5.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.transforms import cross
from mmw.physics.em.interaction import DIFFRACTION, DIFFUSE, SPECULAR, TRANSMISSION
from mmw.physics.em.surface_response import SurfaceResponse
from mmw.physics.em.vectors import direction_angles, dot, norm, spherical_basis


@dataclass(frozen=True)
class PathGeometry:
    """Geometry of paths, before any material or frequency. D interactions at most."""

    interaction: np.ndarray
    """Kind of each interaction, 0 behind the last, shape [P, D]."""
    direction: np.ndarray
    """Unit direction of each segment; behind the last segment that of the last, shape [P, D + 1, 3]."""
    segment_length: np.ndarray
    """Length of each segment [m], 0 behind the last, shape [P, D + 1]."""
    cosine: np.ndarray
    """Cosine of incidence at each interaction, 1 where there is no plane, shape [P, D]."""
    incoming: np.ndarray
    """Two unit vectors across the incoming wave that each interaction works in, shape [P, D, 2, 3]."""
    turn: np.ndarray
    """Real matrices from the basis before to the basis of the next interaction; the first starts at the transmitter's
    (theta, phi), the one behind the last interaction ends in the receiver's, the rest is 1. Shape [P, D + 1, 2, 2]."""
    theta_t: np.ndarray
    phi_t: np.ndarray
    theta_r: np.ndarray
    phi_r: np.ndarray

    def take(self, rows: np.ndarray) -> "PathGeometry":
        """Return some of the paths."""
        return PathGeometry(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))

    @property
    def departure(self) -> np.ndarray:
        """Unit direction leaving the transmitter, shape [P, 3]."""
        return self.direction[:, 0]

    @property
    def arrival(self) -> np.ndarray:
        """Unit direction from the receiver back along the path, shape [P, 3]."""
        return -self.direction[:, -1]

    @property
    def length(self) -> np.ndarray:
        """Total length [m], shape [P]."""
        total = self.segment_length[:, 0]
        for k in range(1, self.segment_length.shape[1]):
            total = total + self.segment_length[:, k]
        return total

    def lengths_around(self, path: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the lengths of paths before and behind their interaction `step` [m], shape [Q] each."""
        before, behind = np.zeros(len(path)), np.zeros(len(path))
        for k in range(self.segment_length.shape[1]):
            length = self.segment_length[path, k]
            before += np.where(k <= step, length, 0.0)
            behind += np.where(k > step, length, 0.0)
        return before, behind


def path_geometry(
    tx: np.ndarray, rx: np.ndarray, interaction: np.ndarray, vertex: np.ndarray, normal: np.ndarray, edge: np.ndarray
) -> PathGeometry:
    """Return directions, lengths and polarization bases of paths.

    Args:
        tx: Transmitters [m], shape [P, 3].
        rx: Receivers [m], shape [P, 3].
        interaction: Kind of each interaction, 0 behind the last, shape [P, D].
        vertex: Points of interaction [m], NaN behind the last, shape [P, D, 3].
        normal: Unit normals at the points, either side, shape [P, D, 3].
        edge: Unit vectors along the edge of each diffraction, anything elsewhere, shape [P, D, 3].
    """
    count, depth = interaction.shape
    order = (interaction != 0).sum(axis=1)[:, None]
    column = np.arange(depth + 1)
    points = np.empty((count, depth + 2, 3))
    points[:, 0], points[:, -1] = tx, rx
    points[:, 1:-1] = np.where((column[:-1] < order)[..., None], vertex, rx[:, None])
    span = points[:, 1:] - points[:, :-1]
    segment_length = norm(span)
    unit = span / np.where(segment_length > 0.0, segment_length, 1.0)[..., None]
    direction = unit[np.arange(count)[:, None], np.minimum(column, order)]
    ends = np.empty((2, count, 3))
    ends[0], ends[1] = direction[:, 0], -direction[:, -1]
    theta, phi = direction_angles(ends)
    basis = _pair(*spherical_basis(theta, phi))
    into, out = np.empty((2, count, depth + 1, 2, 3))
    incoming, outgoing, cosine = _bases(direction[:, :-1], direction[:, 1:], interaction, normal, edge)
    is_none = (interaction == 0)[..., None, None]
    into[:, :-1], out[:, 1:] = (
        np.where(is_none, basis[1, :, None], incoming),
        np.where(is_none, basis[1, :, None], outgoing),
    )
    into[:, -1], out[:, 0] = basis[1], basis[0]
    turn = dot(into[..., :, None, :], out[..., None, :, :])
    turn[column > order] = np.eye(2)
    return PathGeometry(
        interaction, direction, segment_length, cosine, into[:, :-1], turn, theta[0], phi[0], theta[1], phi[1]
    )


def _bases(
    k_in: np.ndarray, k_out: np.ndarray, kind: np.ndarray, normal: np.ndarray, edge: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the basis of the incoming and of the outgoing wave, shape [..., 2, 3] each, and the cosine of incidence,
    shape [...], of interactions."""
    kinds = np.bitwise_or.reduce(kind, axis=None)  # their numbers are bits
    has_normal = (kind & (SPECULAR | TRANSMISSION | DIFFUSE)) != 0
    facing = np.where(has_normal[..., None], normal, [0.0, 0.0, 1.0])
    axis = out_axis = perpendicular(k_in, facing)
    if kinds & DIFFRACTION:
        edges = (kind == DIFFRACTION)[..., None]
        axis = np.where(edges, perpendicular(k_in, edge), axis)
        out_axis = np.where(edges, -perpendicular(k_out, edge), axis)
    into, out = _pair(axis, cross(k_in, axis)), _pair(out_axis, cross(k_out, out_axis))
    if kinds & DIFFUSE:
        rough = (kind == DIFFUSE)[..., None, None]
        into = np.where(rough, _pair(*spherical_basis(*direction_angles(k_in))), into)
        out = np.where(rough, _pair(*spherical_basis(*direction_angles(k_out))), out)
    cosine = np.where(has_normal, np.minimum(np.abs(dot(k_in, facing)), 1.0), 1.0)
    return into, out, cosine


def _pair(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return two vectors in one array, shape [..., 3] each -> [..., 2, 3]."""
    out = np.empty((*first.shape[:-1], 2, 3))
    out[..., 0, :], out[..., 1, :] = first, second
    return out


def perpendicular(direction: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return the unit TE axis, direction x normal; any axis across the ray at normal incidence. Shape [..., 3]."""
    axis = cross(direction, normal)
    square = dot(axis, axis)
    is_normal = square < 1e-12
    if is_normal.any():
        other = np.where(np.abs(direction[..., :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
        axis = np.where(is_normal[..., None], cross(direction, other), axis)
        square = dot(axis, axis)
    return axis / np.sqrt(square)[..., None]


def plane_matrices(geometry: PathGeometry, material_id: np.ndarray, response: SurfaceResponse) -> np.ndarray:
    """Return the matrices of all reflections and transmissions; 1 behind the last interaction, 0 for the other kinds.

    Args:
        geometry: The paths.
        material_id: Material at each interaction and carrier, shape [C, P, D]; ignored where there is none.
        response: The materials. Scattering leaves a share for the reflected field.

    Returns:
        Shape [C, P, D, 2, 2], complex128, in the bases of `geometry`.

    Source: ITU-R P.2040-4, equations 37, 43, 44; S after V. Degli-Esposti et al., IEEE Trans. AP 55(1), 2007.
    """
    kind, carriers = geometry.interaction, len(material_id)
    matrices = np.zeros((*material_id.shape, 2, 2), dtype=np.complex128)
    matrices[:, kind == 0] = np.eye(2)
    for code, coefficients in ((SPECULAR, response.reflection), (TRANSMISSION, response.transmission)):
        path, step = np.nonzero(kind == code)
        if not len(path):
            continue
        material, cosine = material_id[:, path, step].ravel(), np.tile(geometry.cosine[path, step], carriers)
        pair = coefficients(material, cosine)
        share = response.specular_share(material, cosine) if code == SPECULAR else 1.0
        for row, values in enumerate(pair):
            matrices[:, path, step, row, row] = (values * share).reshape(carriers, -1)
    return matrices


def polarimetric_transfer(
    geometry: PathGeometry,
    matrices: np.ndarray,
    spreading: np.ndarray,
    carriers_hz: np.ndarray,
    attenuate: Callable[[int, np.ndarray], np.ndarray] | None = None,
) -> np.ndarray:
    """Return the 2x2 transfer of every path: receive by transmit component in the (theta, phi) basis.

    Args:
        geometry: The paths.
        matrices: Matrix of each interaction at each carrier, shape [C, P, D, 2, 2].
        spreading: Spreading factor, 1 / length for image theory [1/m], shape [P].
        carriers_hz: Carrier frequencies [Hz], shape [C].
        attenuate: Function of the number of an interaction and the field that arrives there, [C, P, 2, 2], that returns
            a factor for each column, [C, P, 2]; see `mmw.physics.em.scattering.rough_columns`.

    Returns:
        lambda / (4 pi) times spreading times the polarization matrix, without carrier phase, [C, P, 2, 2], complex128.
    """
    total = np.broadcast_to(geometry.turn[:, 0], (len(matrices), *geometry.turn[:, 0].shape)).astype(np.complex128)
    for k in range(matrices.shape[2]):
        if attenuate is not None:
            total = total * attenuate(k, total)[..., None, :]
        total = times(geometry.turn[:, k + 1], times(matrices[:, :, k], total))
    scale = (SPEED_OF_LIGHT / carriers_hz / (4.0 * np.pi))[:, None] * spreading
    return scale[..., None, None] * total


def times(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the products of 2x2 matrices, shape [..., 2, 2] each, written out so that rows do not depend on others."""
    return a[..., :, 0, None] * b[..., None, 0, :] + a[..., :, 1, None] * b[..., None, 1, :]


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
    transmitted = [transfer[:, row, None, 0] * theta + transfer[:, row, None, 1] * phi for row in range(2)]
    return receive[:, :, 0, None] * transmitted[0][:, None, :] + receive[:, :, 1, None] * transmitted[1][:, None, :]
