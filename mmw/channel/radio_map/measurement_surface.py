"""Make measurement surfaces of radio maps: cells on a plane, above the roads, or the triangles of a mesh."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from mmw.core.errors import InputError
from mmw.core.mesh import TriangleMesh
from mmw.core.transforms import quaternion_to_matrix
from mmw.scene.radio_devices import finite_vector, unit_quaternion
from mmw.scene.scene_data import SceneData
from mmw.scene.scene_edits import check_mesh

ROAD_LABELS = ("road", "road_line")
"""Semantic classes of the objects that a road grid covers."""

MIN_LEVEL_GAP_M = 1.0
"""Surfaces over one another that are closer than this [m] are one level of road (a marking lies on its road)."""

MIN_ROAD_COSINE = 0.7
"""Faces of a road whose normal is farther from the vertical than this cosine are kerb or wall, not road."""

MAX_CELLS = 10_000_000
"""Maximum number of cells of a grid: 1 GB of corners."""


_FAN = np.array([[0, 1, 2], [0, 2, 3]], dtype=np.int32)
"""Triangles of a four-sided cell; a cell of three corners is the first alone."""


@dataclass(frozen=True, eq=False)
class MeasurementSurface:
    """Cells of three or four corners each; the order of the corners turns about the cell.

    Raises:
        InputError: If the corners have another shape, are not finite, or a cell has no area.
    """

    corners: np.ndarray
    """Corners of each cell, world frame [m], shape [C, 3, 3] or [C, 4, 3], float64."""
    grid_shape: tuple[int, int] | None = None
    """Rows and columns of a grid on a plane, where cell = row * columns + column; None for any other surface."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "corners", np.asarray(self.corners, dtype=np.float64))
        shape = self.corners.shape
        if len(shape) != 3 or shape[0] < 1 or shape[1] not in (3, 4) or shape[2] != 3:
            raise InputError(
                f"measurement surface: corners of shape {shape}; [C, 3, 3] or [C, 4, 3] with at least one cell is "
                "needed; give three or four corners a cell"
            )
        _check_cells(np.isfinite(self.corners).all(axis=(1, 2)), "corners that are not finite")
        _check_cells(self.area > 0.0, "no area")
        if self.grid_shape is not None and self.grid_shape[0] * self.grid_shape[1] != len(self):
            raise InputError(
                f"measurement surface: grid_shape = {self.grid_shape} for {len(self)} cells; rows times columns must "
                "be the number of cells; correct it"
            )

    def __len__(self) -> int:
        return len(self.corners)

    @property
    def center(self) -> np.ndarray:
        """Mean of the corners of each cell, world frame [m], shape [C, 3]."""
        return self.corners.mean(axis=1)

    @cached_property
    def area(self) -> np.ndarray:
        """Area of each cell, that of its triangles [m^2], shape [C]."""
        triangles = self.corners[:, _FAN[: self.corners.shape[1] - 2]]
        cross = np.cross(triangles[:, :, 1] - triangles[:, :, 0], triangles[:, :, 2] - triangles[:, :, 0])
        return 0.5 * np.linalg.norm(cross, axis=2).sum(axis=1)

    @property
    def faces(self) -> np.ndarray:
        """Triangles as indices into `corners.reshape(-1, 3)`, shape [F, 3], int32; see `cell_of_face`."""
        sides = self.corners.shape[1]
        first = sides * np.arange(len(self), dtype=np.int32)
        return (first[:, None, None] + _FAN[: sides - 2]).reshape(-1, 3)

    @property
    def cell_of_face(self) -> np.ndarray:
        """Cell of each of the `faces`, shape [F], int32; the faces of a cell follow one another."""
        return np.repeat(np.arange(len(self), dtype=np.int32), self.corners.shape[1] - 2)

    @cached_property
    def mesh(self) -> TriangleMesh:
        """The `faces` as a mesh."""
        return TriangleMesh(self.corners.reshape(-1, 3), self.faces)


def plane_grid(
    center_m: ArrayLike, size_m: ArrayLike, cell_size_m: float, orientation: ArrayLike | None = None
) -> MeasurementSurface:
    """Return square cells on a plane, row by row: cell = row * columns + column.

    Args:
        center_m: Middle of the grid, world frame [m], shape [3].
        size_m: Extent along the plane's x and y [m], shape [2]; the grid has as many whole cells as cover it, about the
            same middle.
        cell_size_m: Side of a cell [m].
        orientation: Plane to world, quaternion (x, y, z, w); columns run along the plane's x, rows along its y. Level
            by default.

    Raises:
        InputError: If a value has another shape or is not finite, size or cell is not positive, or there are too many
            cells.
    """
    center, size = finite_vector("plane_grid: center_m", center_m, 3), finite_vector("plane_grid: size_m", size_m, 2)
    _check_cell(cell_size_m)
    if not (size > 0.0).all():
        raise InputError(f"plane_grid: size_m = {size.tolist()}; both must be above 0 m; give the plane's extent")
    counts = np.ceil(size / cell_size_m - 1e-9).tolist()
    _check_count(counts[0] * counts[1], cell_size_m)
    columns, rows = (int(count) for count in counts)
    row, column = (k.ravel() for k in np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij"))
    step = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]) - [columns / 2.0, rows / 2.0]
    cells = np.zeros((rows * columns, 4, 3))
    cells[..., :2] = cell_size_m * (np.stack([column, row], axis=1)[:, None] + step)
    if orientation is not None:
        cells = cells @ quaternion_to_matrix(unit_quaternion("plane_grid: orientation", orientation)).T
    return MeasurementSurface(cells + center, (rows, columns))


def mesh_surface(points: ArrayLike, faces: ArrayLike, *, offset_m: float = 0.0) -> MeasurementSurface:
    """Return the triangles of a mesh as cells: cell = face.

    Args:
        points: Vertices, world frame [m], shape [N, 3].
        faces: Triangles as indices of vertices, counter-clockwise seen from outside, shape [M, 3].
        offset_m: Distance by which each triangle is moved along its outward normal [m]. On the surface of an object it
            must be above 0.01 m for its own reflections to count: the path solver takes no shorter segment.

    Raises:
        InputError: If a value has another shape, is not finite or names no vertex, a triangle has no area, or there are
            too many.
    """
    vertices, rows = check_mesh("mesh_surface", points, faces)
    if not np.isfinite(offset_m):
        raise InputError(f"mesh_surface: offset_m = {offset_m:g}; a finite distance is needed; correct it")
    if len(rows) > MAX_CELLS:
        raise InputError(f"mesh_surface: {len(rows):,} faces; at most {MAX_CELLS:,} can be cells; simplify the mesh")
    mesh = TriangleMesh(vertices, rows)
    return MeasurementSurface(mesh.corners + offset_m * mesh.normals[:, None])


def road_grid(
    arrays: SceneData,
    cell_size_m: float,
    height_m: float,
    labels: Sequence[str] = ROAD_LABELS,
    within_m: tuple[float, float, float, float] | None = None,
) -> MeasurementSurface:
    """Return cells that follow the roads of a scene at a height above them.

    The grid's lines lie at whole multiples of `cell_size_m` in x and y. A cell is there where its middle has road below
    it; it has the height and slope of that road, and shares its corners with its neighbors. A bridge and the road below
    it are two levels with cells of their own; of surfaces less than 1 m apart the upper one counts.

    Args:
        arrays: The scene.
        cell_size_m: Side of a cell seen from above [m].
        height_m: Vertical distance of the cells from the road [m], above 0.
        labels: Semantic classes of the objects that count as road.
        within_m: Lowest x, lowest y, highest x and highest y of the cells' middles [m]; all by default.

    Raises:
        InputError: If cell or height is not positive, there are too many cells, or no road is there.
    """
    _check_cell(cell_size_m)
    if not height_m > 0.0:
        raise InputError(f"road_grid: height_m = {height_m:g}; it must be above 0 m; give the height of an antenna")
    is_road = np.array([item.label in labels for item in arrays.objects], dtype=bool)
    triangles = arrays.points[arrays.faces[is_road[arrays.object_id]]] if len(arrays.faces) else np.zeros((0, 3, 3))
    if within_m is not None:
        low, high = triangles[..., :2].min(axis=1), triangles[..., :2].max(axis=1)
        triangles = triangles[((high >= within_m[:2]) & (low <= within_m[2:])).all(axis=1)]
    column, height, slope = _columns(triangles, cell_size_m)
    if within_m is not None:
        middle = (column + 0.5) * cell_size_m
        inside = ((middle >= within_m[:2]) & (middle <= within_m[2:])).all(axis=1)
        column, height, slope = column[inside], height[inside], slope[inside]
    if not len(column):
        found = ", ".join(sorted({item.label for item in arrays.objects})) or "nothing"
        raise InputError(
            f"road_grid: no cell of {cell_size_m:g} m has its middle over {' or '.join(labels)}; the scene has "
            f"{found}; use a smaller cell, a place with roads, or a plane"
        )
    keep = _upper(column, height)
    column, height, slope = column[keep], height[keep], slope[keep]
    step = np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    corner = column[:, None] + step
    z = height[:, None] + cell_size_m * np.einsum("cx,kx->ck", slope, step - 0.5)
    z = _shared(corner.reshape(-1, 2), z.ravel()).reshape(-1, 4)
    return MeasurementSurface(np.concatenate([corner * cell_size_m, z[..., None] + height_m], axis=2))


def _check_cells(is_good: np.ndarray, fault: str) -> None:
    if not is_good.all():
        raise InputError(
            f"measurement surface: cell {int(np.argmin(is_good))} has {fault}, as {int((~is_good).sum()):,} in all; "
            "cells with finite corners and an area are needed; correct or remove them"
        )


def _check_cell(cell_size_m: float) -> None:
    if not 0.0 < cell_size_m < np.inf:
        raise InputError(f"cell_size_m = {cell_size_m:g}; it must be above 0 m; give the side of a cell, such as 2")


def _check_count(count: float, cell_size_m: float) -> None:
    if count > MAX_CELLS:
        raise InputError(
            f"cell_size_m = {cell_size_m:g} makes {count:,.0f} cells to look at; at most {MAX_CELLS:,} can be; use "
            "larger ones"
        )


def _columns(triangles: np.ndarray, cell_size_m: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return where the vertical lines through the middles of cells intersect triangles that are not steep.

    Args:
        triangles: Corners [m], shape [M, 3, 3].
        cell_size_m: Side of a cell [m].

    Returns:
        Cell (x, y), shape [K, 2], int64; height [m], shape [K]; slope dz/dx, dz/dy, shape [K, 2].
    """
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    is_flat = np.abs(normal[:, 2]) > MIN_ROAD_COSINE * np.linalg.norm(normal, axis=1)
    triangles, normal = triangles[is_flat], normal[is_flat]
    low = np.ceil(triangles[..., :2].min(axis=1) / cell_size_m - 0.5).astype(np.int64)
    high = np.floor(triangles[..., :2].max(axis=1) / cell_size_m - 0.5).astype(np.int64)
    width = np.maximum(high - low + 1, 0)
    count = width.prod(axis=1)
    _check_count(count.sum(), cell_size_m)
    face = np.repeat(np.arange(len(triangles)), count)
    number = np.arange(len(face)) - np.repeat(np.cumsum(count) - count, count)
    column = low[face] + np.stack([number % width[face, 0], number // width[face, 0]], axis=1)
    middle = (column + 0.5) * cell_size_m
    inside = np.ones(len(face), dtype=bool)
    for k in range(3):
        a, b = triangles[face, k, :2], triangles[face, (k + 1) % 3, :2]
        edge, to_middle = b - a, middle - a
        turn = (edge[:, 0] * to_middle[:, 1] - edge[:, 1] * to_middle[:, 0]) * np.sign(normal[face, 2])
        inside &= turn >= -1e-9 * np.linalg.norm(edge, axis=1)
    face, column, middle = face[inside], column[inside], middle[inside]
    slope = -normal[face, :2] / normal[face, 2:]
    height = triangles[face, 0, 2] + np.einsum("kx,kx->k", slope, middle - triangles[face, 0, :2])
    return column, height, slope


def _upper(column: np.ndarray, height: np.ndarray) -> np.ndarray:
    """Return the rows that are the upper surface of a level, sorted by row, column and from the top down."""
    order = np.lexsort((-height, column[:, 0], column[:, 1]))
    same = (np.diff(column[order], axis=0) == 0).all(axis=1) & (-np.diff(height[order]) < MIN_LEVEL_GAP_M)
    return order[np.concatenate([[True], ~same])]


def _shared(corner: np.ndarray, z: np.ndarray) -> np.ndarray:
    """Return heights in which the corners of neighboring cells of one level have their mean.

    Args:
        corner: Grid point of each corner, shape [K, 2].
        z: Height after the corner's own cell [m], shape [K].
    """
    order = np.lexsort((z, corner[:, 0], corner[:, 1]))
    same = (np.diff(corner[order], axis=0) == 0).all(axis=1) & (np.diff(z[order]) < MIN_LEVEL_GAP_M)
    group = np.concatenate([[0], np.cumsum(~same)])
    mean = np.bincount(group, z[order]) / np.bincount(group)
    shared = np.empty_like(z)
    shared[order] = mean[group]
    return shared
