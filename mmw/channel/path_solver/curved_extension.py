"""Extend curved surfaces beyond their outlines, where they still reflect, less and less, as flat ones do.

Half of the field of the endless surface reflects at a straight edge, and what is beyond falls off over a few Fresnel
zones. Each edge of an outline carries two triangles that go on outward as the surface bends there.
"""

from dataclasses import dataclass

import numpy as np

from mmw.channel.path_solver.curvature import turn_curvature
from mmw.core.planar_surfaces import sums_by_row
from mmw.physics.em.vectors import dot, norm

REACH_M = 3.0
"""Farthest that a surface is extended [m]. Design value: five Fresnel zones at 28 GHz and 60 m."""

MAX_TURN_RAD = 0.7
"""Farthest that its normal turns over the extension [rad]: farther on no second-order surface fits. Design value."""

SPLIT_COSINE = 0.25
"""An edge whose outward direction has a smaller cosine with the mean of the edges at its end goes outward by itself."""


@dataclass(frozen=True)
class Extension:
    """Triangles beyond outlines, two of each edge."""

    corner: np.ndarray
    """Shape [N, 3, 3], [m]."""
    normal: np.ndarray
    """Unit normal at each corner, shape [N, 3, 3]."""
    curvature: np.ndarray
    """Curvature at each corner [1/m], shape [N, 3, 3, 3]."""
    outside: np.ndarray
    """1 at corners away from the outline, 0 at those on it, shape [N, 3]."""
    edge: np.ndarray
    """Edge of the outline, shape [N]."""


def extend(end: np.ndarray, vertex: np.ndarray, facing: np.ndarray, normal: np.ndarray, bend: np.ndarray) -> Extension:
    """Return the triangles beyond the edges of outlines.

    Args:
        end: Both ends of each edge, counter-clockwise seen from outside [m], shape [E, 2, 3].
        vertex: Vertex of a curved surface at each end, shape [E, 2].
        facing: Outward unit normal of the facet at each edge, shape [E, 3].
        normal: Unit normal of the curved surface at each end, shape [E, 2, 3].
        bend: Its curvature there [1/m], shape [E, 2, 3, 3].
    """
    count = len(end)
    own = np.cross(end[:, 1] - end[:, 0], facing)
    own /= np.maximum(norm(own), 1e-300)[:, None]
    place, both = vertex.reshape(-1), np.repeat(own, 2, axis=0)
    total = sums_by_row(place, both, int(place.max(initial=-1)) + 1)[place]
    n, k = normal.reshape(-1, 3), bend.reshape(-1, 3, 3)
    out = _across(total, n)
    out = np.where((dot(out, both) < SPLIT_COSINE)[:, None], _across(both, n), out)
    turn = np.einsum("nij,nj->ni", k, out)
    rate, bow = norm(turn), np.maximum(dot(turn, out), 0.0)
    reach = np.minimum(REACH_M, MAX_TURN_RAD / np.maximum(rate, 1e-12))
    turned = np.cos(rate * reach)[:, None] * n + (reach * np.sinc(rate * reach / np.pi))[:, None] * turn
    half = 0.5 * bow * reach  # a circle goes sin(2 half) / bow outward, and 2 sin(half)^2 / bow down
    ahead, down = reach * np.sinc(2.0 * half / np.pi), reach * np.sinc(half / np.pi) * np.sin(half)
    beyond = end.reshape(-1, 3) + ahead[:, None] * out - down[:, None] * n
    four = [
        np.stack([inner.reshape(count, 2, *inner.shape[1:]), outer.reshape(count, 2, *outer.shape[1:])], axis=1)
        for inner, outer in ((end.reshape(-1, 3), beyond), (n, turned), (k, turn_curvature(k, n, turned)))
    ]  # [E, inner or outer, begin or end, ...]
    sides, ends = np.array([[0, 0, 1], [0, 1, 1]]), np.array([[0, 1, 1], [0, 1, 0]])
    corner, normals, curvature = (values[:, sides, ends].reshape(2 * count, 3, *values.shape[3:]) for values in four)
    outside = np.tile(sides.astype(np.float64), (count, 1))
    return Extension(corner, normals, curvature, outside, np.repeat(np.arange(count), 2))


def _across(vector: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return the unit vectors along the parts of vectors across unit normals, 0 for those without one, [N, 3]."""
    out = vector - dot(vector, normal)[:, None] * normal
    return out / np.maximum(norm(out), 1e-12)[:, None]
