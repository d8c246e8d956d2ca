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
    order = (interaction != 0).sum(axis=1)
    direction, segment_length = np.empty((count, depth + 1, 3)), np.zeros((count, depth + 1))
    before = tx
    for k in range(depth + 1):
        is_last, is_segment = k == order, k <= order
        at = vertex[:, k] if k < depth else rx
        at = np.where(is_last[:, None], rx, at)
        at = np.where(is_segment[:, None], at, before)
        span = at - before
        segment_length[:, k] = norm(span)
        unit = span / np.where(segment_length[:, k] > 0.0, segment_length[:, k], 1.0)[:, None]
        direction[:, k] = np.where(is_segment[:, None], unit, direction[:, k - 1] if k else unit)
        before = at
    theta_t, phi_t = direction_angles(direction[:, 0])
    theta_r, phi_r = direction_angles(-direction[:, -1])
    outgoing = _pair(*spherical_basis(theta_t, phi_t))
    end_basis = _pair(*spherical_basis(theta_r, phi_r))
    turn, cosine = np.empty((count, depth + 1, 2, 2)), np.ones((count, depth))
    incoming = np.zeros((count, depth, 2, 3))
    for k in range(depth):
        kind = interaction[:, k]
        into, out, cosine[:, k] = _bases(direction[:, k], direction[:, k + 1], kind, normal[:, k], edge[:, k])
        into = np.where((kind == 0)[:, None, None], end_basis, into)
        turn[:, k] = np.where((k > order)[:, None, None], np.eye(2), _turn(into, outgoing))
        incoming[:, k], outgoing = into, np.where((kind == 0)[:, None, None], end_basis, out)
    turn[:, depth] = np.where((depth > order)[:, None, None], np.eye(2), _turn(end_basis, outgoing))
    angles = theta_t, phi_t, theta_r, phi_r
    return PathGeometry(interaction, direction, segment_length, cosine, incoming, turn, *angles)


def _turn(into: np.ndarray, out: np.ndarray) -> np.ndarray:
    """Return the matrix from components in `out` to components in `into`, shapes [P, 2, 3] -> [P, 2, 2]."""
    return dot(into[:, :, None], out[:, None, :])


def _bases(
    k_in: np.ndarray, k_out: np.ndarray, kind: np.ndarray, normal: np.ndarray, edge: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the basis of the incoming and of the outgoing wave, shape [P, 2, 3] each, and the cosine of incidence."""
    is_plane = (kind == SPECULAR) | (kind == TRANSMISSION)
    is_rough, is_edge = kind == DIFFUSE, kind == DIFFRACTION
    has_normal = is_plane | is_rough
    facing = np.where(has_normal[:, None], normal, [0.0, 0.0, 1.0])
    axis = out_axis = perpendicular(k_in, facing)
    if is_edge.any():
        edges = is_edge[:, None]
        axis = np.where(edges, perpendicular(k_in, edge), axis)
        out_axis = np.where(edges, -perpendicular(k_out, edge), axis)
    into, out = _pair(axis, cross(k_in, axis)), _pair(out_axis, cross(k_out, out_axis))
    if is_rough.any():
        rough = is_rough[:, None, None]
        into = np.where(rough, _pair(*spherical_basis(*direction_angles(k_in))), into)
        out = np.where(rough, _pair(*spherical_basis(*direction_angles(k_out))), out)
    cosine = np.where(has_normal, np.minimum(np.abs(dot(k_in, facing)), 1.0), 1.0)
    return into, out, cosine


def _pair(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return two vectors of each path in one array, shape [P, 3] each -> [P, 2, 3]."""
    out = np.empty((len(first), 2, 3))
    out[:, 0], out[:, 1] = first, second
    return out


def perpendicular(direction: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return the unit TE axis, direction x normal; any axis across the ray at normal incidence. Shape [P, 3]."""
    axis = cross(direction, normal)
    is_normal = dot(axis, axis) < 1e-12
    if is_normal.any():
        other = np.where(np.abs(direction[:, :1]) < 0.9, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
        axis = np.where(is_normal[:, None], cross(direction, other), axis)
    return axis / norm(axis)[:, None]


def plane_matrices(geometry: PathGeometry, material_id: np.ndarray, response: SurfaceResponse) -> np.ndarray:
    """Return the matrices of all reflections and transmissions; 1 behind the last interaction, 0 for the other kinds.

    Args:
        geometry: The paths.
        material_id: Material at each interaction, shape [P, D]; ignored where there is none.
        response: The materials at the carrier. Scattering leaves a share for the reflected field.

    Returns:
        Shape [P, D, 2, 2], complex128, in the bases of `geometry`.

    Source: ITU-R P.2040-4, equations 37, 43, 44; S after V. Degli-Esposti et al., IEEE Trans. AP 55(1), 2007.
    """
    kind = geometry.interaction
    matrices = np.zeros((*kind.shape, 2, 2), dtype=np.complex128)
    matrices[kind == 0] = np.eye(2)
    for code, coefficients in ((SPECULAR, response.reflection), (TRANSMISSION, response.transmission)):
        at = np.nonzero(kind == code)
        if not len(at[0]):
            continue
        te, tm = coefficients(material_id[at], geometry.cosine[at])
        specular_share = response.specular_share(material_id[at], geometry.cosine[at]) if code == SPECULAR else 1.0
        matrices[(*at, 0, 0)], matrices[(*at, 1, 1)] = te * specular_share, tm * specular_share
    return matrices


def polarimetric_transfer(
    geometry: PathGeometry,
    matrices: np.ndarray,
    spreading: np.ndarray,
    carrier_hz: float,
    attenuate: Callable[[int, np.ndarray], np.ndarray] | None = None,
) -> np.ndarray:
    """Return the 2x2 transfer of every path: receive by transmit component in the (theta, phi) basis.

    Args:
        geometry: The paths.
        matrices: Matrix of each interaction, shape [P, D, 2, 2].
        spreading: Spreading factor, 1 / length for image theory [1/m], shape [P].
        carrier_hz: Carrier frequency [Hz].
        attenuate: Function of the number of an interaction and the field that arrives there, [P, 2, 2], that returns a
            factor for each column, [P, 2]; see
            `mmw.physics.em.scattering.rough_columns`.

    Returns:
        lambda / (4 pi) times spreading times the polarization matrix, without carrier phase, [P, 2, 2], complex128.
    """
    total = geometry.turn[:, 0].astype(np.complex128)
    for k in range(matrices.shape[1]):
        if attenuate is not None:
            total = total * attenuate(k, total)[:, None, :]
        total = times(geometry.turn[:, k + 1], times(matrices[:, k], total))
    scale = SPEED_OF_LIGHT / carrier_hz / (4.0 * np.pi) * spreading
    return scale[:, None, None] * total


def times(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return the products of 2x2 matrices, shape [P, 2, 2] each, written out so that rows do not depend on others."""
    out = np.empty(b.shape, dtype=np.result_type(a, b))
    for i in range(2):
        for j in range(2):
            out[:, i, j] = a[:, i, 0] * b[:, 0, j] + a[:, i, 1] * b[:, 1, j]
    return out


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
