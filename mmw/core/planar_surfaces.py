"""Find the surfaces of a triangle mesh: its planar pieces, which reflect radio waves.

A surface is a maximal set of coplanar faces, connected by edges, of one object and material.
"""

from collections.abc import Sequence
from itertools import product

import numpy as np

WELD_M = 2.0e-4
"""Weld tolerance [m]: vertices closer than half of this on every axis are one vertex."""

PLANE_M = 1.0e-3
"""Maximum distance of a vertex of a surface from its plane [m]."""

ANGLE_RAD = 1.0e-4
"""Maximum angle between neighboring faces of a surface [rad]; float32 vertices of a 0.1 m face at 100 m give 1e-4."""


def find_surfaces(points: np.ndarray, faces: np.ndarray, object_id: np.ndarray, material: np.ndarray) -> np.ndarray:
    """Return the surface of every face.

    Faces of opposite winding may be coplanar. A face without area is a surface of its own. Surfaces are numbered in
    the order of their first faces.

    Args:
        points: Vertices [m], shape [N, 3].
        faces: Vertex indices, shape [M, 3].
        object_id: Object of each face, shape [M].
        material: Material of each face, shape [M].

    Returns:
        Surface of each face, 0 to K - 1, shape [M], int32.
    """
    if len(faces) == 0:
        return np.zeros(0, dtype=np.int32)
    corners = points.take(faces, axis=0).astype(np.float64)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    twice_area = np.linalg.norm(cross, axis=1)
    has_area = twice_area > 1e-12
    normal = np.where(has_area[:, None], cross / np.maximum(twice_area, 1e-300)[:, None], 0.0)
    first, second = _neighbors(weld(points).take(faces), object_id, material)
    keep = has_area[first] & has_area[second]
    keep &= np.linalg.norm(np.cross(normal[first], normal[second]), axis=1) < ANGLE_RAD
    first, second = first[keep], second[keep]
    keep = _plane_distance(corners, corners[first, 0], normal[first], second) < PLANE_M
    keep &= _plane_distance(corners, corners[second, 0], normal[second], first) < PLANE_M
    first, second = first[keep], second[keep]
    surface = np.arange(len(faces))
    while len(first):
        label = components(len(faces), first, second)
        surface = label[surface]
        own = np.flatnonzero(np.bincount(label, minlength=len(faces))[label] > 2)  # pairs were checked above
        if len(own) == 0:
            break
        fits, is_bent = np.ones(len(faces), dtype=bool), np.zeros(len(faces), dtype=bool)
        fits[own], is_bent[own] = _plane_fit(label[own], corners[own], normal[own], twice_area[own])
        surface = np.where(is_bent, np.arange(len(faces)), surface)
        keep = is_bent[first] & (fits[first] == fits[second])
        first, second = first[keep], second[keep]
    return np.unique(surface, return_inverse=True)[1].astype(np.int32)


def weld(points: np.ndarray) -> np.ndarray:
    """Return a vertex index for every point, the same for points that are closer than `WELD_M` / 2 on every axis."""
    return linked_rows(points / WELD_M)


def linked_rows(values: np.ndarray, kind: np.ndarray | None = None) -> np.ndarray:
    """Return the lowest row of the cluster of each row, where close rows are connected, shape [N].

    Rows in one cell of a unit grid are close. Using a grid for every subset of columns, shifted by half a step along
    them, two rows that differ by less than 1/2 in every column share a cell of at least one grid.

    Args:
        values: Numbers to compare, shape [N, K], float64.
        kind: Integer label of each row; rows of different labels are never close, shape [N].
    """
    count, width = values.shape
    halves = list(np.floor(2.0 * values.T + 0.38).astype(np.int64))  # half cells; two form a cell of a grid
    kind = np.zeros(count, dtype=np.int64) if kind is None else kind
    ends = [_same_cells(sum(_hashed([*halves, kind])))]
    rows = np.setdiff1d(np.arange(count), ends[0][0], assume_unique=True)  # one row of each half cell
    halves, kind = [half[rows] for half in halves], kind[rows]
    cells = [_hashed([*((half + by) >> 1 for half in halves), kind]) for by in (0, 1)]
    for moved in product((0, 1), repeat=width):
        first, second = _same_cells(sum((cells[by][k] for k, by in enumerate(moved)), start=cells[0][width]))
        ends.append((rows[first], rows[second]))
    first, second = (np.concatenate(end) for end in zip(*ends, strict=True))
    return components(count, first, second)


def _hashed(columns: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Return terms whose sum is a 64-bit hash of rows of integers."""
    return [column.astype(np.uint64) * np.uint64(pow(_HASH, k, 1 << 64)) for k, column in enumerate(columns)]


def _same_cells(cell: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return pairs of rows that connect all rows of a cell, given the cell of each row, shape [pairs] each, int64."""
    order = np.argsort(cell)
    ordered = cell[order]
    is_same = ordered[1:] == ordered[:-1]
    return order[1:][is_same], order[:-1][is_same]


_HASH = 0x9E3779B97F4A7C15
"""Odd multiplier near 2^64 divided by the golden ratio: distributes cells over 64 bits. Source: Knuth, TAOCP 3, 6.4."""


def _neighbors(faces: np.ndarray, object_id: np.ndarray, material: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the pairs of faces that share an edge, an object and a material; each array has shape [pairs]."""
    begin, end = faces.ravel(), faces[:, [1, 2, 0]].ravel()
    low, high = np.minimum(begin, end), np.maximum(begin, end)
    real = np.flatnonzero(low != high)
    edge = low[real] * (int(high.max(initial=0)) + 1) + high[real]
    order = np.argsort(edge)
    edge, face = edge[order], real[order] // 3
    same_as_next = edge[1:] == edge[:-1]
    first, second = [], []
    row = np.flatnonzero(same_as_next)
    step = 1
    while len(row):  # rows whose edge has `step` more rows; at most two in a manifold mesh
        first.append(face[row])
        second.append(face[row + step])
        row = row[row + step < len(face) - 1]
        row = row[same_as_next[row + step]]
        step += 1
    if not first:
        return np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64)
    one, two = np.concatenate(first), np.concatenate(second)
    keep = (object_id[one] == object_id[two]) & (material[one] == material[two])
    return one[keep], two[keep]


def sums_by_row(row: np.ndarray, values: np.ndarray, count: int) -> np.ndarray:
    """Return sums of values that belong to the same of `count` rows, shapes [N] and [N, K] -> [count, K]."""
    return np.stack([np.bincount(row, own, count) for own in values.T], axis=1)


def components(count: int, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """Return the lowest index of the connected component of every node of an undirected graph, shape [count]."""
    label = np.arange(count)
    while True:
        a, b = label[first], label[second]
        apart = a != b
        if not apart.any():
            return label
        first, second, a, b = first[apart], second[apart], a[apart], b[apart]
        np.minimum.at(label, np.maximum(a, b), np.minimum(a, b))
        jumped = label[label]
        while not np.array_equal(jumped, label):
            label, jumped = jumped, jumped[jumped]


def _plane_distance(corners: np.ndarray, origin: np.ndarray, normal: np.ndarray, face: np.ndarray) -> np.ndarray:
    """Return the maximum distance of the corners of each face from its plane [m]."""
    return np.abs(np.einsum("pcx,px->pc", corners.take(face, axis=0) - origin[:, None], normal)).max(
        axis=1, initial=0.0
    )


def _plane_fit(
    label: np.ndarray, corners: np.ndarray, normal: np.ndarray, area: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Find the components that are curved by many small bends, and the planar piece to split off each.

    A component is planar if it fits its mean plane. A curved one is split at a face near its center: the faces that fit
    the plane of that face stay together, the others are examined again.

    Returns:
        Whether the face fits the plane of its component's central face, and whether its component is curved; both [M].
    """
    group = np.unique(label, return_inverse=True)[1]
    count, face = int(group.max()) + 1, np.arange(len(label))
    largest = np.zeros(count)
    np.maximum.at(largest, group, area)
    total = np.bincount(group, area, count)
    centre = (corners[:, 0] + corners[:, 1] + corners[:, 2]) / 3.0
    mean = sums_by_row(group, area[:, None] * centre, count) / total[:, None]
    away = np.linalg.norm(centre - mean[group], axis=1)
    away[area < 0.5 * largest[group]] = np.inf  # the normal of a small face is inaccurate
    order = np.lexsort((away, group))
    middle = order[np.searchsorted(group[order], np.arange(count))]
    turned = np.where(np.einsum("fx,fx->f", normal, normal[middle[group]])[:, None] < 0.0, -normal, normal)
    mean_normal = sums_by_row(group, area[:, None] * turned, count)
    mean_normal /= np.linalg.norm(mean_normal, axis=1, keepdims=True)
    off_mean = _plane_distance(corners, mean[group], mean_normal[group], face) > PLANE_M
    fits = _plane_distance(corners, centre[middle[group]], normal[middle[group]], face) <= PLANE_M
    is_bent = (np.bincount(group, off_mean, count) > 0) & (np.bincount(group, ~fits, count) > 0)
    return fits, is_bent[group]
