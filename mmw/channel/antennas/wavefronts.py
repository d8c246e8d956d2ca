"""Follow the lengths of paths over the elements of arrays at both ends: exact spherical wavefronts.

A path of length L leaves the transmitter along k_t and reaches the receiver, which sees it along k_r. Between elements
at offsets a and b from the phase centers it is, with R the product of the Householder matrices I - 2 n n^T of its
mirrors,

    |L k_r + R a - b|                            flat mirrors and slabs: the image of the element, exact
    sqrt((rho_t + rho_r)^2 + (z_t - z_r)^2)      one edge: rho and z of the elements' images in the edge's cylindrical
                                                 coordinates, exact by Fermat's principle
    |s_t k_t - a| + |s_r k_r - b|                a diffuse point, s_t and s_r away, radiates as a point source
    the least over the surface                   a curved surface, see `curved_waves`

Mirrors' normals halve the angle at the vertices. R k_t = -k_r, so R counts only where both ends have arrays.

Source: J. B. Keller, Geometrical theory of diffraction, JOSA 52 (1962) (rays at an edge); image theory, C. A. Balanis,
Antenna Theory, section 4.7.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from mmw.channel.antennas.curved_waves import symmetric
from mmw.channel.path_table import WAVEFRONT_COLUMNS, PathSamples
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.errors import InputError
from mmw.physics.em.interaction import DIFFRACTION, DIFFUSE, SPECULAR, TRANSMISSION
from mmw.physics.em.vectors import norm, unit_vector

Wavefront = Literal["auto", "plane", "spherical"]
"""Shape of waves over an array; see `mmw.channel.apply_arrays`."""

MAX_PLANE_WAVE_ERROR_RAD = np.pi / 8
"""Phase error from which on `auto` takes spherical waves [rad]: that at the Fraunhofer distance 2 D^2 / lambda. Source:
C. A. Balanis, Antenna Theory, section 4.4."""


@dataclass(frozen=True)
class Wavefronts:
    """Waves of P paths over the arrays of both ends."""

    length: np.ndarray
    """Length of each path [m], shape [P]."""
    tx_source: np.ndarray
    """Distance of the source that the transmitter sees along its direction [m], shape [P]: the length of the path to
    its edge, curved surface or first diffuse point, or its whole length; NaN where rows do not tell."""
    rx_source: np.ndarray
    """The same for the receiver and the last diffuse point [m], shape [P]."""
    departure: np.ndarray
    """Unit direction from the transmitter to that source, shape [P, 3]."""
    arrival: np.ndarray
    """Unit direction from the receiver to that source, shape [P, 3]."""
    is_point: np.ndarray
    """Whether a path has a diffuse point, shape [P]."""
    is_edge: np.ndarray
    """Whether a path has an edge, shape [P]."""
    tx_axis: np.ndarray
    """Unit vector along the edge as the transmitter sees it in its mirrors, shape [P, 3]; 0 without an edge."""
    rx_axis: np.ndarray
    """The same for the receiver, along the same way of the edge, shape [P, 3]."""
    mirror: np.ndarray
    """Matrix R, from offsets at the transmitter to those of its image, shape [P, 3, 3]."""
    is_curved: np.ndarray
    """Whether a curved surface reflects the path, shape [P]."""
    curvature: np.ndarray
    """Its curvature [1/m], shape [P, 3, 3]; NaN without one."""

    def take(self, rows: np.ndarray) -> "Wavefronts":
        """Return those of some paths."""
        return Wavefronts(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))

    def check(self) -> None:
        """Check that the waves of all paths are known.

        Raises:
            InputError: If rows of one do not tell its waves.
        """
        is_known = (self.tx_source > 0.0) & (self.rx_source > 0.0) & np.isfinite(self.tx_axis).all(axis=1)
        if not is_known.all():
            raise InputError(
                f"spherical waves: {int((~is_known).sum())} paths in the near field of an array have no, or impossible "
                f"{', '.join(WAVEFRONT_COLUMNS)}; read these columns of `paths` too, or take wavefront='plane' where "
                "an older schema lacks them"
            )

    def plane_wave_error(self, tx_radius: float, rx_radius: float, carrier_hz: float) -> np.ndarray:
        """Return the largest phase error of plane waves [rad], shape [P]; see `mmw.channel.plane_wave_error`.

        Sources of one path count for themselves. Where rows do not tell their distance, the path's length counts.

        Args:
            tx_radius: Largest distance of an element of the transmitter from its phase center [m].
            rx_radius: The same of the receiver [m].
            carrier_hz: Carrier [Hz].

        Raises:
            InputError: If a delay is not above 0.
        """
        if not (self.length > 0.0).all():
            raise InputError(
                f"waves over an array: a path has the delay {self.length.min() / SPEED_OF_LIGHT:g} s; absolute delays "
                "above 0 are needed; give those, or take wavefront='plane'"
            )
        whole = (tx_radius + rx_radius) ** 2 / self.length
        is_known = np.isfinite(self.tx_source)
        tx, rx = (np.where(is_known, source, self.length) for source in (self.tx_source, self.rx_source))
        with np.errstate(divide="ignore"):
            apart = tx_radius**2 / tx + rx_radius**2 / rx
        is_split = (self.is_point | self.is_edge | self.is_curved) & is_known
        return np.pi * carrier_hz / SPEED_OF_LIGHT * np.where(is_split, apart, whole)


def find_wavefronts(paths: PathSamples) -> Wavefronts:
    """Return the waves of paths over the arrays of both ends.

    Raises:
        InputError: If a path has an interaction of an unknown kind, or several that break its wavefront in other ways
            than two diffuse points.
    """
    kind, count = paths.interaction, len(paths.tau)
    known = (0, SPECULAR, DIFFUSE, TRANSMISSION, DIFFRACTION)
    if not np.isin(kind, (*known, -1)).all():
        wrong = int(kind[~np.isin(kind, (*known, -1))][0])
        raise InputError(
            f"spherical waves: an interaction of kind {wrong}; known kinds are {', '.join(map(str, known[1:]))}; take "
            "wavefront='plane' for these paths"
        )
    edge_step, rough_step = kind == DIFFRACTION, kind == DIFFUSE
    is_edge, is_point = edge_step.any(axis=1), rough_step.any(axis=1)
    if (edge_step.sum(axis=1) > 1).any() or (is_edge & is_point).any():
        raise InputError(
            "spherical waves: a path with two edges, or with an edge and a diffuse point; one edge or diffuse points "
            "are known; take wavefront='plane' for these paths"
        )
    is_curved = np.isfinite(paths.curvature).all(axis=1)
    if (is_curved & ((kind != 0).sum(axis=1) > 1)).any():
        raise InputError(
            "spherical waves: a path of a curved surface and something else; a curved surface is known alone; take "
            "wavefront='plane' for these paths"
        )
    length = SPEED_OF_LIGHT * paths.tau
    departure, arrival = unit_vector(paths.theta_t, paths.phi_t), unit_vector(paths.theta_r, paths.phi_r)
    depth, order = kind.shape[1], (kind != 0).sum(axis=1)
    mirror = np.broadcast_to(np.eye(3), (count, 3, 3)).copy()
    tx_axis, rx_axis = np.zeros((count, 3)), np.zeros((count, 3))
    tx_source, rx_source = length.copy(), length.copy()
    into, travelled = departure, paths.first_segment_m
    for step in range(depth):
        is_there, is_last = kind[:, step] != 0, step + 1 == order
        span = np.zeros((count, 3)) if step + 1 == depth else paths.vertex[:, step + 1] - paths.vertex[:, step]
        span = np.where((is_there & ~is_last)[:, None], span, 0.0)
        size = norm(span)
        out = np.where(is_last[:, None], -arrival, span / np.where(size > 0.0, size, 1.0)[:, None])
        rows = np.flatnonzero(kind[:, step] == SPECULAR)
        normal = out[rows] - into[rows]
        normal /= np.maximum(norm(normal), 1e-300)[:, None]
        for moved in (mirror, rx_axis):
            along = np.einsum("pi,pi...->p...", normal, moved[rows])
            moved[rows] -= 2.0 * np.einsum("pi,p...->pi...", normal, along)
        at_edge = np.flatnonzero(edge_step[:, step])
        rx_axis[at_edge] = paths.edge[at_edge]
        tx_axis[at_edge] = np.einsum("pji,pj->pi", mirror[at_edge], paths.edge[at_edge])
        is_break = edge_step[:, step] | rough_step[:, step] | (is_curved & (step == 0))
        is_first = is_break & (tx_source == length)
        tx_source = np.where(is_first, travelled, tx_source)
        rx_source = np.where(is_break, length - travelled, rx_source)
        into, travelled = np.where(is_there[:, None], out, into), travelled + size
    is_unread = (kind == -1).any(axis=1)
    tx_source[is_unread] = rx_source[is_unread] = np.nan
    return Wavefronts(
        length, tx_source, rx_source, departure, arrival, is_point, is_edge, tx_axis, rx_axis, mirror, is_curved,
        symmetric(paths.curvature),
    )  # fmt: skip
