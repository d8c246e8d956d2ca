"""Compute in plan: areas and triangles of polygons, heights of faces above points, heights between known ones."""

import math
from collections.abc import Sequence
from typing import TypeVar

import numpy as np
import scipy.sparse
import scipy.sparse.linalg
import shapely

Areas = TypeVar("Areas", shapely.Geometry, np.ndarray)
"""A geometry, or an array of them."""


def twice_areas(triangles: np.ndarray) -> np.ndarray:
    """Return twice the signed area in plan of triangles [M, 3, 2 or 3], positive when counter-clockwise, shape [M]."""
    a, b, c = (triangles[:, k] for k in range(3))
    return (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])


def rotation(yaw: float) -> np.ndarray:
    """Return the matrix that turns column vectors in plan by `yaw` [rad]."""
    return np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])


def rectangle_at(center: Sequence[float], yaw: float, length: float, width: float) -> shapely.Polygon:
    """Return a rectangle with its length along `yaw` [rad]."""
    corners = 0.5 * np.array([[-length, -width], [length, -width], [length, width], [-length, width]])
    return shapely.Polygon(corners @ rotation(yaw).T + np.asarray(center))


def samples(area: shapely.Geometry, step: float) -> np.ndarray:
    """Return points over an area and along its border, about `step` apart [m], shape [N, 2]."""
    west, south, east, north = area.bounds
    grid = np.stack(np.meshgrid(np.arange(west, east, step), np.arange(south, north, step)), axis=-1).reshape(-1, 2)
    border = shapely.get_coordinates(shapely.segmentize(area.boundary, step))
    return np.concatenate([grid[shapely.contains_xy(area, *grid.T)], border])


def polygons_of(area: shapely.Geometry, above: float) -> list[shapely.Polygon]:
    """Return the polygons of a geometry, or of the collections in it, of more than some area [m^2]."""
    parts = shapely.get_parts(shapely.get_parts([area]))
    return [part for part in parts if part.geom_type == "Polygon" and part.area > above]


def subtract_area(area: shapely.Geometry, other: shapely.Geometry, grid_size: float) -> shapely.Geometry:
    """Return the polygons of an area that another does not cover, on a grid [m].

    On a grid, slivers collapse to lines beside the polygons; GEOS takes no such mixture as input of the next overlay.
    """
    rest = shapely.difference(area, other, grid_size=grid_size)
    mixed = rest.geom_type not in ("Polygon", "MultiPolygon")
    return shapely.MultiPolygon(polygons_of(rest, 0.0)) if mixed else rest


def intersect_areas(first: Areas, second: Areas) -> Areas:
    """Return what areas share, on a grid of a micrometer.

    Without a grid, GEOS 3.14 may return the whole of one of two rectangles that only touch, if the corners that they
    share differ in the last bit.
    """
    return shapely.intersection(first, second, grid_size=1e-6)


def triangulate_polygons(polygons: shapely.Polygon | Sequence[shapely.Polygon]) -> np.ndarray:
    """Return triangles that fill polygons and use all of their vertices, counter-clockwise, shape [M, 3, 2]."""
    split = shapely.get_parts(shapely.constrained_delaunay_triangles(np.atleast_1d(np.array(polygons, object))))
    triangles = shapely.get_coordinates(split).reshape(-1, 4, 2)[:, :3]
    return np.where((twice_areas(triangles) < 0)[:, None, None], triangles[:, ::-1], triangles)


def row_stations(points: np.ndarray) -> np.ndarray:
    """Return how far along a line, in the dimensions of its points [N, D], each point lies [m], shape [N]."""
    return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])


def at_stations(station: np.ndarray, known: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Return the points of a line [N, D], known at stations [N], at other stations [K], by linear interpolation."""
    return np.column_stack([np.interp(station, known, points[:, k]) for k in range(points.shape[1])])


class PlanFaces:
    """Faces looked up in plan."""

    def __init__(self, corners: np.ndarray) -> None:
        """Store faces that look upward: their corners [m], shape [M, 3, 3]."""
        self._corners = corners
        self._tree = shapely.STRtree(np.asarray(shapely.polygons(corners[:, [0, 1, 2, 0], :2])))

    def hits(self, xy: np.ndarray, within: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return all faces over points in plan, or `within` some distance of them [m].

        Args:
            xy: Points [m], shape [N, 2].
            within: Largest distance of a face from its point, in plan [m].

        Returns:
            Of every hit the index of the point, shape [H]; the barycentric weights of the second and the third corner,
            shape [2, H]; the height of the face's plane there [m], shape [H].
        """
        query, face = (
            self._tree.query(shapely.points(xy), predicate="dwithin", distance=within)
            if within
            else self._tree.query(shapely.points(xy), predicate="intersects")
        )
        a, b, c = (self._corners[face, k] for k in range(3))
        u, v, w = b[:, :2] - a[:, :2], c[:, :2] - a[:, :2], xy[query] - a[:, :2]
        area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
        s = (w[:, 0] * v[:, 1] - w[:, 1] * v[:, 0]) / area
        t = (u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]) / area
        return query, np.stack([s, t]), a[:, 2] + s * (b[:, 2] - a[:, 2]) + t * (c[:, 2] - a[:, 2])


def harmonic_heights(faces: np.ndarray, count: int, known: np.ndarray) -> np.ndarray:
    """Return heights that equal `known` at the first vertices and, at the others, the mean of their neighbors [m].

    Discrete harmonic interpolation: no bump or hollow between roads, and level ground between level roads.

    Args:
        faces: Triangles, shape [M, 3].
        count: Number of vertices N.
        known: Heights of the first vertices [m], shape [K].

    Returns:
        Heights of all vertices, shape [N].
    """
    fixed = len(known)
    if fixed == count:
        return known
    i, j = faces[:, [0, 1, 2, 1, 2, 0]].ravel(), faces[:, [1, 2, 0, 0, 1, 2]].ravel()
    link = scipy.sparse.coo_matrix((np.ones(len(i)), (i, j)), shape=(count, count)).tocsr()
    link.data[:] = 1.0
    free = (scipy.sparse.diags(np.asarray(link.sum(axis=1)).ravel()) - link).tocsr()[fixed:]
    inner = scipy.sparse.linalg.spsolve(free[:, fixed:].tocsc(), -free[:, :fixed] @ known)
    return np.concatenate([known, np.round(np.atleast_1d(inner), 6)])


def triangular_lattice(low: np.ndarray, high: np.ndarray, count: np.ndarray, inner_only: bool = False) -> np.ndarray:
    """Return the points of a triangular lattice over a box, which has one Delaunay triangulation, a square one many.

    Args:
        low: Lower corner [m], shape [2].
        high: Upper corner [m], shape [2].
        count: Cells along x and y, shape [2].
        inner_only: Whether points on the left and the right side stay where they are.

    Returns:
        Shape [(count x + 1) (count y + 1), 2].
    """
    x, y = (np.linspace(low[k], high[k], count[k] + 1) for k in range(2))
    grid = np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1)
    grid[slice(1, -1) if inner_only else slice(None), 1::2, 0] += 0.5 * (x[1] - x[0])
    return grid.reshape(-1, 2)
