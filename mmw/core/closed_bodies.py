"""Find the bodies of a triangle mesh, which of them close, and turn those that are inside out."""

from dataclasses import dataclass

import numpy as np

from mmw.core.planar_surfaces import components, weld


@dataclass(frozen=True)
class HalfEdges:
    """Edges between vertices; each has a half-edge of every face that it bounds, side by side."""

    vertex: np.ndarray
    """Both ends of each half-edge in the order of its face, shape [H, 2]."""
    face: np.ndarray
    """Face of each half-edge, shape [H]."""
    corner: np.ndarray
    """Number of the corner of that face where the half-edge begins, 0 to 2, shape [H]."""
    first: np.ndarray
    """First half-edge of each edge, shape [E]."""
    size: np.ndarray
    """Number of half-edges of each edge, shape [E]."""


@dataclass(frozen=True)
class Bodies:
    """Faces that edges of two faces connect."""

    body: np.ndarray
    """Body of each face: the lowest of its faces, shape [M]."""
    is_open: np.ndarray
    """True for a face of a body that does not close or whose faces disagree about the outside, shape [M]."""
    is_turned: np.ndarray
    """True for a face of a closed body of negative volume, whose faces look inward, shape [M]."""


def find_half_edges(faces: np.ndarray) -> HalfEdges:
    """Return the edges of faces, sorted by their vertices; those between equal vertices are left out.

    Args:
        faces: Welded vertices of the faces, shape [M, 3].
    """
    edges = faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    low, high = edges.min(axis=1), edges.max(axis=1)
    order = np.lexsort((high, low))
    order = order[low[order] != high[order]]
    low, high = low[order], high[order]
    first = np.flatnonzero(np.append(True, (low[1:] != low[:-1]) | (high[1:] != high[:-1]))[: len(order)])
    return HalfEdges(edges[order], order // 3, order % 3, first, np.diff(np.append(first, len(order))))


def find_bodies(corner: np.ndarray, half: HalfEdges) -> Bodies:
    """Return the bodies of a mesh.

    A body closes if its faces run through every edge as often in one direction as in the other, and is inside out if
    its volume is negative.

    Args:
        corner: Corners of the faces [m], shape [M, 3, 3], float64.
        half: Edges of the faces.

    Source: volume by the divergence theorem, sum of (p0 - c) . ((p1 - c) x (p2 - c)) / 6 over the faces.
    """
    is_forward = half.vertex[:, 0] < half.vertex[:, 1]
    seam = half.first[half.size == 2]
    body = components(len(corner), half.face[seam], half.face[seam + 1])
    edge = np.repeat(np.arange(len(half.size)), half.size)
    own = np.unique(edge * len(corner) + body[half.face], return_inverse=True)[1].reshape(-1)  # edge of one body
    is_uneven = np.bincount(own, weights=np.where(is_forward, 1.0, -1.0)) != 0.0
    is_open = np.bincount(body[half.face], weights=is_uneven[own], minlength=len(corner)) > 0.0
    arm = corner - corner[body][:, :1]
    volume = np.bincount(body, weights=np.einsum("fk,fk->f", arm[:, 0], np.cross(arm[:, 1], arm[:, 2])) / 6.0)
    extent = np.bincount(body, weights=np.linalg.norm(arm, axis=2).max(axis=1) ** 3)
    is_turned = ~is_open[: len(volume)] & (volume < -1e-12 * extent)  # a body without thickness has no inside
    return Bodies(body, is_open[body], is_turned[body])


def turn_outward(points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, int]:
    """Return the faces of a mesh with its inside-out bodies turned, and how many those are.

    A body inside another closed one of the mesh stays: its faces look into a cavity.

    Args:
        points: Vertices [m], shape [N, 3].
        faces: Triangles, shape [M, 3].
    """
    corner = points[faces].astype(np.float64)
    found = find_bodies(corner, find_half_edges(weld(points)[faces]))
    turned = np.unique(found.body[found.is_turned])
    if not len(turned):
        return faces, 0
    rows = np.flatnonzero(~found.is_open)
    rows = rows[np.argsort(found.body[rows], kind="stable")]  # the faces of a body lie side by side
    closed, first = np.unique(found.body[rows], return_index=True)
    own, end = corner[rows], np.append(first[1:], len(rows))
    low = np.minimum.reduceat(own.min(axis=1), first)
    high = np.maximum.reduceat(own.max(axis=1), first)
    is_cavity = np.zeros(len(turned), bool)
    for k, body in enumerate(turned):
        mine = np.searchsorted(closed, body)
        around = np.flatnonzero(((low < low[mine]) & (high[mine] < high)).all(axis=1))
        is_cavity[k] = any(_encloses(own[first[other] : end[other]], corner[body, 0]) for other in around)
    turned = turned[~is_cavity]
    return np.where(np.isin(found.body, turned)[:, None], faces[:, ::-1], faces), len(turned)


def _encloses(corner: np.ndarray, place: np.ndarray) -> bool:
    """Return whether a closed body contains a point: its faces cover the full solid angle, from outside none.

    Source: A. Van Oosterom, J. Strackee, "The solid angle of a plane triangle", IEEE Trans. Biomed. Eng. 30 (1983).
    """
    a, b, c = np.moveaxis(corner - place, 1, 0)
    lengths = [np.linalg.norm(arm, axis=1) for arm in (a, b, c)]
    triple = np.einsum("fk,fk->f", a, np.cross(b, c))
    product = lengths[0] * lengths[1] * lengths[2]
    for first, second, third in ((a, b, lengths[2]), (b, c, lengths[0]), (c, a, lengths[1])):
        product = product + np.einsum("fk,fk->f", first, second) * third
    return bool(abs(2.0 * np.arctan2(triple, product).sum()) > 2.0 * np.pi)
