"""Compute diffraction at wedges by the uniform theory, with the reflection coefficients of the two faces.

Source: R. G. Kouyoumjian and P. H. Pathak, Proc. IEEE 62(11), 1974, for the transition function and the four terms;
ITU-R P.526-15, section 4.4, and Sionna RT 2.2's technical report for faces of finite conductivity.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mmw.core.constants import SPEED_OF_LIGHT
from mmw.physics.em.field import PathGeometry, perpendicular
from mmw.physics.em.finite_surfaces import edge_share
from mmw.physics.em.surface_response import SurfaceResponse
from mmw.physics.em.transition import transition
from mmw.physics.em.vectors import dot

DiffractionModel = Literal["utd", "sionna"]
"""Combination of the four terms of the theory with the reflection matrices of the faces; see `wedge_matrices`."""


@dataclass(frozen=True)
class WedgeHits:
    """The diffractions of a set of paths: one row each, Q of them. World frame."""

    path: np.ndarray
    """Row of the path, shape [Q]."""
    step: np.ndarray
    """Index of the interaction in its path, shape [Q]."""
    edge: np.ndarray
    """Unit vector along the edge, shape [Q, 3]."""
    normal_0: np.ndarray
    """Outward normal of one face, shape [Q, 3]."""
    normal_n: np.ndarray
    """Outward normal of the other face, shape [Q, 3]."""
    away: np.ndarray
    """Unit vector across the edge into the open, shape [Q, 3]."""
    at: np.ndarray
    """Distance of the point of diffraction from the begin of its edge [m], shape [Q]."""
    is_curved: np.ndarray
    """True where the faces are facets of one curved surface, shape [Q]."""


def wedge_spreading(geometry: PathGeometry, hits: WedgeHits) -> np.ndarray:
    """Return 1 / sqrt(s' s (s' + s)) of each diffraction, s' the path before and s the path behind it, shape [Q]."""
    before, behind = geometry.lengths_around(hits.path, hits.step)
    return 1.0 / np.sqrt(before * behind * (before + behind))


def is_lit(geometry: PathGeometry, hits: WedgeHits) -> np.ndarray:
    """Return whether the observer of each diffraction sees the source past the wedge, or its reflection, shape [Q].

    Source: Kouyoumjian and Pathak 1974, figure 3: only behind the incidence shadow boundary, phi > pi + phi', does the
    diffracted field stand alone.
    """
    _, phi_in, phi_out, _ = _angles(geometry, hits)
    return phi_out <= np.pi + phi_in


@dataclass(frozen=True)
class WedgeTerms:
    """Terms of the theory at one carrier, which do not depend on the materials."""

    d: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
    """D1 to D4 of each diffraction, shape [Q] each, complex128."""
    swap: np.ndarray
    """Whether its second face is the 0-face, shape [Q]."""
    is_dark: np.ndarray
    """Whether the source does not see the n-face, shape [Q]."""


def wedge_terms(
    geometry: PathGeometry,
    hits: WedgeHits,
    carriers_hz: Sequence[float],
    model: DiffractionModel,
    width: np.ndarray | None = None,
) -> tuple[WedgeTerms, ...]:
    """Return the four terms of each diffraction at every carrier.

    With finite faces, `utd` leaves out what the Kirchhoff integral over a face holds of its edge: the pole of the term
    at the boundary of reflection, as far as `mmw.physics.em.finite_surfaces.edge_share` says.

    Args:
        geometry: The paths.
        hits: Their diffractions.
        carriers_hz: Carrier frequencies [Hz], shape [C].
        model: How they combine with the reflections; see `wedge_matrices`.
        width: Smaller extents of both faces [m], shape [Q, 2]; None if they reflect as if they were infinite.
    """
    k_in = geometry.direction[hits.path, hits.step]
    swap, phi_in, phi_out, n = _angles(geometry, hits)
    wave = 2.0 * np.pi * np.array(carriers_hz)[:, None] / SPEED_OF_LIGHT
    sin_b = np.sqrt(np.maximum(1.0 - dot(k_in, hits.edge) ** 2, 1e-300))
    before, behind = geometry.lengths_around(hits.path, hits.step)
    reach = wave * before * behind / (before + behind) * sin_b**2
    scale = -np.exp(-0.25j * np.pi) / (2.0 * n * np.sqrt(2.0 * np.pi * wave) * sin_b)
    minus, plus = phi_out - phi_in, phi_out + phi_in
    widths = None
    if width is not None and model == "utd":
        far = np.sqrt(2.0 / (np.pi * before * behind / (before + behind)) * 0.5 * wave)  # sqrt(2 / (lambda rho))
        wide = far[..., None] * np.where(swap[:, None], width[:, ::-1], width)
        before_n = (n * np.pi - phi_in < np.pi) & (n * np.pi - phi_out < np.pi)  # both ends in front of the face
        before_0 = (phi_in < np.pi) & (phi_out < np.pi)
        widths = np.where(np.stack([before_n, before_0])[:, None], np.stack([wide[..., 1], wide[..., 0]]), np.nan)
    beta, sign = np.stack([minus, minus, plus, plus]), np.array([1.0, -1.0, 1.0, -1.0])
    d1, d2, d3, d4 = scale * _terms(beta[:, None], sign[:, None, None], n, reach, widths)
    is_dark = n * np.pi > np.pi + phi_in
    return tuple(
        WedgeTerms((d1[column], d2[column], d3[column], d4[column]), swap, is_dark) for column in range(len(wave))
    )


def wedge_matrices(
    geometry: PathGeometry,
    hits: WedgeHits,
    terms: WedgeTerms,
    material_id: np.ndarray,
    response: SurfaceResponse,
    model: DiffractionModel,
) -> np.ndarray:
    """Return the matrix of each diffraction in the bases of `geometry`, shape [Q, 2, 2], complex128.

    `utd`: -(D1 + D2) + R_0 D4 + R_n D3, which is exact for a perfect conductor (to the order of the theory) and makes
    the whole field continuous across the shadow and reflection boundaries of any material. `sionna`: R_0 (D1 - D4) +
    R_n (D2 - D3) with R_n = -1 where the second face is dark, as Sionna RT 2.2 computes it; it is continuous across the
    shadow boundary only.

    The edge between two facets of a curved surface is that of its rim: it has -(D1 + D2) alone, since what the surface
    reflects has no boundary there.

    Args:
        geometry: The paths.
        hits: Their diffractions.
        terms: `wedge_terms` of the diffractions at the carrier.
        material_id: Material of both faces, shape [Q, 2].
        response: The materials at the carrier.
        model: Which of the two.
    """
    k_in = geometry.direction[hits.path, hits.step]
    described = zip((hits.normal_0, hits.normal_n), material_id.T, strict=True)
    faces = [_face(k_in, hits.edge, *face, response) for face in described]
    swapped = terms.swap[:, None, None]
    r_0, r_n = np.where(swapped, faces[1], faces[0]), np.where(swapped, faces[0], faces[1])
    d1, d2, d3, d4 = (d[:, None, None] for d in terms.d)
    if model == "utd":
        has_mirrors = ~hits.is_curved[:, None, None]
        return np.where(has_mirrors, r_0 * d4 + r_n * d3, 0.0) - np.eye(2) * (d1 + d2)
    r_n = np.where(terms.is_dark[:, None, None], -np.eye(2), r_n)
    return r_0 * (d1 - d4) + r_n * (d2 - d3)


def _angles(geometry: PathGeometry, hits: WedgeHits) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return whether the second face is the 0-face, phi' and phi from the 0-face [rad], and n, shape [Q] each.

    The 0-face is the first one if the source is in front of it, the other one otherwise; n pi is the angle of the open.
    """
    to_source = -geometry.direction[hits.path, hits.step]
    to_target = geometry.direction[hits.path, hits.step + 1]
    swap = dot(hits.normal_0, to_source) < 0.0
    n0 = np.where(swap[:, None], hits.normal_n, hits.normal_0)
    nn = np.where(swap[:, None], hits.normal_0, hits.normal_n)
    across = np.cross(n0, hits.edge)
    across = np.where((dot(hits.away, across) > 0.0)[:, None], -across, across)  # in the 0-face, away from the edge

    def angle(direction: np.ndarray) -> np.ndarray:
        value = np.arctan2(dot(direction, n0), dot(direction, across))
        return np.where(value < -1e-9, value + 2.0 * np.pi, np.maximum(value, 0.0))

    n = 2.0 - np.arccos(np.clip(-dot(n0, nn), -1.0, 1.0)) / np.pi
    return swap, angle(to_source), angle(to_target), n


def _terms(
    beta: np.ndarray, sign: np.ndarray, n: np.ndarray, reach: np.ndarray, width: np.ndarray | None = None
) -> np.ndarray:
    """Return cot((pi +- beta) / 2n) F(reach a(beta)), finite on the shadow boundaries, shape [4, C, Q].

    With a width, without what the Kirchhoff integral over the face holds: the pole of the cotangent, n / sin(angle from
    the boundary / 2), times F, the wave of a straight edge in Fresnel's approximation.

    Args:
        beta: Difference or sum of the angles of source and observer from the 0-face [rad], shape [4, 1, Q].
        sign: 1 or -1, of pi, shape [4, 1, 1].
        n: Open angle over pi, shape [Q].
        reach: Wave number times the distance parameter, shape [C, Q].
        width: Smaller extent of the face, Fresnel coordinate, NaN where it holds nothing, of the last two
            terms, shape [2, C, Q]; or None.
    """
    turns = np.round((beta + sign * np.pi) / (2.0 * n * np.pi))
    a = 2.0 * np.cos(0.5 * (2.0 * n * np.pi * turns - beta)) ** 2
    angle = (np.pi + sign * beta) / (2.0 * n)
    off = angle - np.pi * np.round(angle / np.pi)
    is_boundary = np.abs(off) < 1e-9
    limit = np.where(off < 0.0, -1.0, 1.0) * n * np.sqrt(2.0 * np.pi * reach) * np.exp(0.25j * np.pi)
    faded = transition(reach * a)
    value = np.where(is_boundary, limit, faded / np.tan(np.where(is_boundary, 1.0, off)))
    if width is None:
        return value
    is_boundary, off, a = is_boundary[2:], off[2:], a[2:]
    pole = np.where(is_boundary, limit[2:], faded[2:] * n / np.sin(np.where(is_boundary, 1.0, n * off)))
    share = np.where(np.isnan(width), 0.0, edge_share(np.sqrt(2.0 * reach * a / np.pi), width))
    value[2:] -= share * pole
    return value


def _face(
    k_in: np.ndarray, edge: np.ndarray, normal: np.ndarray, material_id: np.ndarray, response: SurfaceResponse
) -> np.ndarray:
    """Return the reflection at a face from the wedge's incoming basis to its outgoing one of the mirrored direction."""
    k_out = k_in - 2.0 * dot(k_in, normal)[:, None] * normal
    axis = perpendicular(k_in, normal)
    cosine = np.minimum(np.abs(dot(k_in, normal)), 1.0)
    te, tm = response.reflection(material_id, cosine)
    specular_share = response.specular_share(material_id, cosine)
    into, out = perpendicular(k_in, edge), -perpendicular(k_out, edge)
    basis_in, basis_out = (into, np.cross(k_in, into)), (out, np.cross(k_out, out))
    tm_in, tm_out = np.cross(k_in, axis), np.cross(k_out, axis)
    matrix = np.empty((len(k_in), 2, 2), dtype=np.complex128)
    for i in range(2):
        for j in range(2):
            matrix[:, i, j] = specular_share * (
                te * dot(basis_out[i], axis) * dot(axis, basis_in[j])
                + tm * dot(basis_out[i], tm_out) * dot(tm_in, basis_in[j])
            )
    return matrix
