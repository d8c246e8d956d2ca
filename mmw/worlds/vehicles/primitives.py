"""Closed triangle shapes that vehicles are put together from: boxes, wheels, and the shading normals of any mesh."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import product

import numpy as np

from mmw.core.errors import InputError
from mmw.core.mesh import TriangleMesh, merge
from mmw.worlds.crease_normals import crease_normals

WELD = 1e-6
"""Vertices closer than this become one [m]."""

CREASE_COS = float(np.cos(np.radians(38.0)))
"""Faces that meet at a larger angle keep a hard edge between them."""


@dataclass(frozen=True, eq=False)
class Shape(TriangleMesh):
    """A triangle mesh in the body frame whose faces carry the name of their part (`body`, `glass`, ...)."""

    parts: np.ndarray
    """Part name of each face, shape [M], str."""
    st: np.ndarray | None = None
    """Texture coordinates of each corner of each face, shape [M, 3, 2]; None for zeros."""

    def moved(self, offset: Sequence[float]) -> "Shape":
        """Return the shape shifted by `offset` [m], shape [3]."""
        return replace(self, points=self.points + np.asarray(offset, dtype=np.float64))

    def mirrored(self) -> "Shape":
        """Return the mirror image in the plane y = 0, its faces still turned outward."""
        st = None if self.st is None else self.st[:, ::-1].copy()
        return Shape(self.points * [1.0, -1.0, 1.0], self.faces[:, ::-1].copy(), self.parts, st)

    def coordinates(self) -> np.ndarray:
        """Return the texture coordinates, zeros where there are none, shape [M, 3, 2]."""
        return np.zeros((len(self.faces), 3, 2)) if self.st is None else self.st


def join(shapes: Sequence[Shape]) -> Shape:
    """Return the shapes as one, without welding anything."""
    mesh = merge(shapes)
    return Shape(
        mesh.points,
        mesh.faces,
        np.concatenate([shape.parts for shape in shapes]),
        np.concatenate([shape.coordinates() for shape in shapes]),
    )


def weld(shape: Shape) -> Shape:
    """Return the shape with coincident vertices merged and faces without area removed."""
    keys = np.round(shape.points / WELD).astype(np.int64)
    _, first, inverse = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    faces = inverse.reshape(-1)[shape.faces]
    points = shape.points[first]
    distinct = (faces[:, 0] != faces[:, 1]) & (faces[:, 1] != faces[:, 2]) & (faces[:, 2] != faces[:, 0])
    return Shape(points, faces[distinct].astype(np.int32), shape.parts[distinct], shape.coordinates()[distinct])


def quads(grid: np.ndarray, part: Callable[[int, int], str]) -> Shape:
    """Return a lattice of points as triangles, each quad split along its shorter diagonal.

    Args:
        grid: Points [m], shape [A, B, 3]; the outside is where (a-direction) x (b-direction) points.
        part: Part name of the quad between (a, b) and (a + 1, b + 1).

    Returns:
        The open patch; degenerate quads stay in until `weld`.
    """
    rows, columns = grid.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    corners = np.stack([index[:-1, :-1], index[1:, :-1], index[1:, 1:], index[:-1, 1:]], axis=-1).reshape(-1, 4)
    points = grid.reshape(-1, 3)
    first = np.linalg.norm(points[corners[:, 0]] - points[corners[:, 2]], axis=1)
    second = np.linalg.norm(points[corners[:, 1]] - points[corners[:, 3]], axis=1)
    along = (first <= second + 1e-9)[:, None, None]
    faces = np.where(along, corners[:, [[0, 1, 2], [0, 2, 3]]], corners[:, [[0, 1, 3], [1, 2, 3]]]).reshape(-1, 3)
    names = [part(a, b) for a in range(rows - 1) for b in range(columns - 1)]
    return Shape(points, faces.astype(np.int32), np.repeat(np.array(names, dtype=np.str_), 2))


def box(low: Sequence[float], high: Sequence[float], part: str, bevel: float = 0.0) -> Shape:
    """Return an axis-aligned box, its edges cut at 45 degrees where `bevel` is positive.

    Args:
        low: Least corner [m], shape [3].
        high: Greatest corner [m], shape [3].
        part: Part name of every face.
        bevel: Width of the cut along each face [m].

    Raises:
        InputError: If a side is not longer than twice the bevel.
    """
    centre = (np.asarray(low, dtype=np.float64) + high) / 2
    half = (np.asarray(high, dtype=np.float64) - low) / 2
    if np.any(half <= bevel) or bevel < 0:
        raise InputError(
            f"box {low}..{high}: bevel = {bevel}; needed is 0 to half of the shortest side; make it smaller"
        )
    points = centre + _box_points(half, bevel)
    faces = _box_faces(bevel > 0)
    return Shape(points, faces, np.full(len(faces), part))


def _box_points(half: np.ndarray, bevel: float) -> np.ndarray:
    """Return the corners of a box about the origin, three for each corner where it is bevelled [m], shape [N, 3]."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
    if bevel == 0.0:
        return signs * half
    return np.concatenate([signs * (half - bevel * (1 - np.eye(3)[axis])) for axis in range(3)])


@cache
def _box_faces(is_bevelled: bool) -> np.ndarray:
    """Return the triangles of every box, in the order of `_box_points`, shape [M, 3]."""
    points = _box_points(np.ones(3), 0.25 if is_bevelled else 0.0)
    directions = np.array([d for d in product((-1.0, 0.0, 1.0), repeat=3) if is_bevelled or np.abs(d).sum() == 1.0])
    directions = directions[directions.any(axis=1)]
    faces = []
    for normal in sorted((directions / np.linalg.norm(directions, axis=1, keepdims=True)).tolist()):
        height = points @ normal
        ring = np.flatnonzero(height > height.max() - 1e-9)
        across = points[ring[1]] - points[ring[0]]
        middle = points[ring] - points[ring].mean(axis=0)
        order = ring[np.argsort(np.arctan2(middle @ np.cross(normal, across), middle @ across))]
        faces += [[order[0], order[i], order[i + 1]] for i in range(1, len(order) - 1)]
    return np.array(faces, dtype=np.int32)


def pod(low: Sequence[float], high: Sequence[float], part: str, segments: int = 10, rings: int = 5) -> Shape:
    """Return a closed box with rounded sides, a superellipsoid, such as the shell of a mirror.

    Args:
        low: Least corner [m], shape [3].
        high: Greatest corner [m], shape [3].
        part: Part name of every face.
        segments: Facets around the x axis.
        rings: Facets from the front to the rear end.
    """
    centre = (np.asarray(low, dtype=np.float64) + high) / 2
    half = (np.asarray(high, dtype=np.float64) - low) / 2
    around = 2 * np.pi * (np.arange(segments + 1) + 0.5) / segments
    around[-1] = around[0]
    along = np.pi * np.arange(rings + 1) / rings

    def bulge(value: np.ndarray) -> np.ndarray:
        return np.sign(value) * np.sqrt(np.abs(np.where(np.abs(value) < 1e-12, 0.0, value)))

    grid = np.empty((segments + 1, rings + 1, 3))
    ring = bulge(np.sin(along))
    grid[..., 0] = bulge(np.cos(along))
    grid[..., 1] = bulge(np.sin(around))[:, None] * ring
    grid[..., 2] = bulge(np.cos(around))[:, None] * ring
    return weld(quads(centre + half * grid, lambda _, __: part))


def corner_normals(mesh: TriangleMesh) -> np.ndarray:
    """Return the shading normal of every corner, shared by faces that touch below the crease angle, shape [M, 3, 3]."""
    return crease_normals(mesh.faces, mesh.normals, np.repeat(mesh.crosses, 3, axis=0), CREASE_COS)
