"""Compute the field along traced paths: angles, polarization, interactions and spreading, all in float64.

Every interaction is a 2x2 matrix between a basis of the incoming and one of the outgoing wave; between interactions,
and at both ends, real 2x2 matrices turn one basis into the next. So geometry is worked out once, and a weather or a
carrier only changes the matrices of the interactions.

Source: image theory for the spreading; ITU-R P.2040-4 for the coefficients; polarization by ray-fixed TE and TM axes as
in C. A. Balanis, Advanced Engineering Electromagnetics, chapter 5.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from mmw.core.host_kernels import as_complex, as_pairs, run_on_host
from mmw.kernels.channel.path_geometry import path_geometry_kernel, perpendicular_kernel
from mmw.kernels.channel.path_transfer import combine_kernel, path_transfer_kernel
from mmw.kernels.channel.plane_response import PlaneMaterials


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
    ends: np.ndarray
    """Unit directions that leave the transmitter, and from the receiver back along the path, shape [P, 2, 3]."""
    angles: np.ndarray
    """Zenith and azimuth of both [rad], shape [P, 2, 2]."""
    range_rate: np.ndarray
    """Rate of change of the length [m/s], shape [P]."""
    length: np.ndarray
    """Total length [m], shape [P]."""

    def take(self, rows: np.ndarray) -> "PathGeometry":
        """Return some of the paths."""
        return PathGeometry(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))

    @property
    def theta_t(self) -> np.ndarray:
        """Zenith of departure [rad], shape [P]."""
        return self.angles[:, 0, 0]

    @property
    def phi_t(self) -> np.ndarray:
        """Azimuth of departure [rad], shape [P]."""
        return self.angles[:, 0, 1]

    @property
    def theta_r(self) -> np.ndarray:
        """Zenith of arrival [rad], shape [P]."""
        return self.angles[:, 1, 0]

    @property
    def phi_r(self) -> np.ndarray:
        """Azimuth of arrival [rad], shape [P]."""
        return self.angles[:, 1, 1]

    @property
    def departure(self) -> np.ndarray:
        """Unit direction leaving the transmitter, shape [P, 3]."""
        return self.ends[:, 0]

    @property
    def arrival(self) -> np.ndarray:
        """Unit direction from the receiver back along the path, shape [P, 3]."""
        return self.ends[:, 1]

    def lengths_around(self, path: np.ndarray, step: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the lengths of paths before and behind their interaction `step` [m], shape [Q] each."""
        before, behind = np.zeros(len(path)), np.zeros(len(path))
        for k in range(self.segment_length.shape[1]):
            length = self.segment_length[path, k]
            before += np.where(k <= step, length, 0.0)
            behind += np.where(k > step, length, 0.0)
        return before, behind


@dataclass(frozen=True)
class MovingBodies:
    """Rigid bodies that carry points of paths."""

    body: np.ndarray
    """Body of each interaction, -1 for none, shape [P, D]."""
    pose: np.ndarray
    """Pose of each body in the world, shape [B, 7]."""
    velocity: np.ndarray
    """Velocity of each body, world frame [m/s], shape [B, 3]."""
    rate: np.ndarray
    """Angular velocity of each body, world frame [rad/s], shape [B, 3]."""


def path_geometry(
    link: np.ndarray,
    place: tuple[np.ndarray, np.ndarray],
    velocity: tuple[np.ndarray, np.ndarray],
    interaction: np.ndarray,
    vertex: np.ndarray,
    normal: np.ndarray,
    edge: np.ndarray | None = None,
    bodies: MovingBodies | None = None,
) -> PathGeometry:
    """Return directions, lengths and polarization bases of paths.

    Args:
        link: Link of each path, shape [P].
        place: Transmitter and receiver of each link [m], shape [L, 3] each.
        velocity: Their velocities [m/s], shape [L, 3] each.
        interaction: Kind of each interaction, 0 behind the last, shape [P, D].
        vertex: Points of interaction [m], NaN behind the last, shape [P, D, 3].
        normal: Unit normals at the points, either side, shape [P, D, 3].
        edge: Unit vectors along the edge of each diffraction, anything elsewhere, shape [P, D, 3]; None without any.
        bodies: What moves and carries some of the points; None for nothing.

    Source: of the rates first-order Doppler, Sionna RT 2.2 technical report.
    """
    (count, depth), along = interaction.shape, _NO_EDGES if edge is None else edge
    moving = _NO_BODIES if bodies is None else (bodies.body, bodies.pose, bodies.velocity, bodies.rate)
    inputs = link, *place, *velocity, interaction, vertex, normal, along, *moving
    of_path, of_step, of_segment = (count,), (count, depth), (count, depth + 1)
    outputs = of_segment, of_segment, of_step, (*of_step, 2), of_segment, (count, 2), (count, 2), of_path, of_path
    return PathGeometry(interaction, *run_on_host(path_geometry_kernel, (count,), inputs, (), outputs))


_NO_EDGES = np.zeros((0, 0, 3))
_NO_BODIES = np.zeros((0, 0), dtype=np.int32), np.zeros((0, 7)), np.zeros((0, 3)), np.zeros((0, 3))
"""Arguments of the kernel for what there is not."""


def perpendicular(direction: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return the unit TE axis, direction x normal; any axis across the ray at normal incidence. Shape [N, 3]."""
    shape = (len(direction),)
    return run_on_host(perpendicular_kernel, shape, (direction, normal), (), (shape,))[0]


@dataclass(frozen=True)
class GivenMatrices:
    """Matrices of interactions that do not follow from a material without layers."""

    is_given: np.ndarray
    """Whether an interaction has one, shape [P, D], bool."""
    matrix: np.ndarray
    """The matrices in the bases of the geometry, shape [P, C, D, 2, 2], complex128."""


def polarimetric_transfer(
    geometry: PathGeometry,
    material_id: np.ndarray,
    materials: PlaneMaterials,
    factor: np.ndarray,
    given: GivenMatrices | None = None,
    columns: Sequence[Callable[[int, np.ndarray], np.ndarray]] = (),
    fields: np.ndarray | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return the 2x2 transfer of every path: receive by transmit component in the (theta, phi) basis.

    Args:
        geometry: The paths.
        material_id: Material of each interaction, shape [P, D]; ignored where there is none.
        materials: The materials, at C carriers.
        factor: Factor of each path at each carrier, lambda / (4 pi length) for image theory, real or complex, shape
            [P, C].
        given: Matrices of the interactions that are no reflection at, or passage through, one of these materials.
        columns: For each carrier, a function of the number of an interaction and the field that arrives there, shape
            [P, 2, 2], that returns a factor for each column, [P, 2]; see `mmw.physics.em.scattering.rough_columns`.
        fields: Far fields (theta, phi) of the antennas of transmitter and receiver, shape [P, 2, 2]; None for none.

    Returns:
        The factor times the polarization matrix, without carrier phase, shape [P, C, 2, 2], and the coefficients
        between the antennas, shape [P, C], or [0, C] without fields; complex128.
    """
    (count, depth), carriers = geometry.interaction.shape, factor.shape[1]
    shape = (count, carriers, 4)
    rows = geometry.interaction, material_id, geometry.cosine, geometry.turn
    matrices = (_NO_FLAGS, _NO_MATRICES)
    if given is not None:
        matrices = given.is_given, as_pairs(given.matrix.reshape(count, carriers, depth, 4))

    antennas = _NO_FIELD if fields is None else as_pairs(fields)
    outputs = shape, (len(antennas), carriers)

    def between(first: int, stop: int, arriving: np.ndarray, scale: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the field behind some interactions, shape [P, C, 2, 2], and the coefficients."""
        inputs = *rows, as_pairs(scale), *matrices, arriving, antennas
        others = materials, first, stop
        field, between_antennas = run_on_host(path_transfer_kernel, shape[:2], inputs, others, outputs)
        return as_complex(field).reshape(count, carriers, 2, 2), as_complex(between_antennas)

    if not columns:
        return between(0, depth, _NO_FIELD, factor)
    total = np.broadcast_to(geometry.turn[:, None, 0], (count, carriers, 2, 2)).astype(np.complex128)
    coefficients = np.zeros((0, carriers), dtype=np.complex128)
    for step in range(depth):
        factors = [column(step, total[:, carrier]) for carrier, column in enumerate(columns)]
        total = total * np.stack(factors, axis=1)[:, :, None]
        scale = factor if step == depth - 1 else np.ones(factor.shape)
        total, coefficients = between(step, step + 1, as_pairs(total.reshape(shape)), scale)
    return total, coefficients


_NO_FLAGS, _NO_MATRICES, _NO_FIELD = np.zeros((0, 0), dtype=bool), np.zeros((0, 0, 0, 0, 2)), np.zeros((0, 0, 0, 2))
"""Arguments of the kernel for what there is not."""


def combine(receive: np.ndarray, transfer: np.ndarray, transmit: np.ndarray) -> np.ndarray:
    """Return the coefficient between every pair of elements.

    Args:
        receive: Receive fields (theta, phi), shape [P, K, 2].
        transfer: Polarimetric transfer, shape [P, C, 2, 2].
        transmit: Transmit fields, shape [P, T, 2].

    Returns:
        F_r^T transfer F_t, shape [P, C, K, T], complex128.
    """
    (count, carriers), receivers, transmitters = transfer.shape[:2], receive.shape[1], transmit.shape[1]
    values = receive, transmit, transfer.reshape(count, carriers, 4)
    inputs = [as_pairs(part) for part in values]
    shape = (count, carriers, receivers, transmitters)
    (pairs,) = run_on_host(combine_kernel, shape[:2], inputs, (), (shape,))
    return as_complex(pairs)
