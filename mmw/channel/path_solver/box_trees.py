"""Put trees of boxes around triangles and surfaces, so that a point is not tested against each."""

from dataclasses import dataclass

import numpy as np
import warp as wp

from mmw.core.spatial_order import spatial_order
from mmw.kernels.channel.box_tree import FEW, LEAF, BoxTrees

BOX_MARGIN_M = 1e-2
"""Points this far from the box of some triangles may still count as in them [m]: ten times what a flat surface may
bend (`mmw.core.planar_surfaces.PLANE_M`)."""


@dataclass(frozen=True)
class HostTrees:
    """Fields of `BoxTrees` on the host."""

    root: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    node: np.ndarray
    order: np.ndarray

    def to_device(self, device: str) -> BoxTrees:
        """Return the trees on a device."""
        trees = BoxTrees()
        for name, field in BoxTrees.vars.items():
            setattr(trees, name, wp.array(getattr(self, name), dtype=field.type.dtype, device=device))
        return trees


def triangle_trees(triangle: np.ndarray, first: np.ndarray, count: np.ndarray) -> HostTrees:
    """Return trees of the triangles of each surface.

    Args:
        triangle: Corners of all triangles [m], shape [T, 3, 3].
        first: First triangle of each row, shape [K].
        count: Triangles of each row, > 0, shape [K].
    """
    return box_trees(first, count, triangle.min(axis=1) - BOX_MARGIN_M, triangle.max(axis=1) + BOX_MARGIN_M)


def box_trees(first: np.ndarray, count: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> HostTrees:
    """Return trees of boxes.

    Args:
        first: First entry of each row, rows one after the other, shape [K].
        count: Entries of each row, > 0, shape [K].
        lower: Low corner of the box of each entry [m], shape [E, 3].
        upper: High corner [m], shape [E, 3].
    """
    row = np.repeat(np.arange(len(count)), count)
    order = np.arange(len(lower))
    many = np.flatnonzero(count[row] > FEW)
    root = np.full(len(count), -1)
    if not len(many):
        return HostTrees(root, np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int64), order)
    near = many[spatial_order(0.5 * (lower[many] + upper[many]))]
    order[many] = near[np.argsort(row[near], kind="stable")]
    tall = np.flatnonzero(count > FEW)
    levels = _level_counts(-(-count[tall] // LEAF))
    total = levels.sum(axis=1)
    root[tall] = np.cumsum(total) - total
    size = int(total.sum())
    low, high, node = np.empty((size, 3)), np.empty((size, 3)), np.zeros((size, 3), dtype=np.int64)
    for level, wide in enumerate(levels.T):
        tree = np.repeat(np.arange(len(tall)), wide)
        begin = LEAF**level * (np.arange(len(tree)) - np.repeat(np.cumsum(wide) - wide, wide))  # in leaves
        end = np.minimum(begin + LEAF**level, levels[tree, 0])
        below = sum(-(-(end - begin) // LEAF**k) for k in range(level + 1))
        place = root[tall][tree] + _nodes_before(levels, tree, level, begin)
        entry = first[tall][tree] + LEAF * begin
        stop = np.minimum(first[tall][tree] + LEAF * end, (first + count)[tall][tree])
        low[place], high[place] = _boxes(entry, stop, lower[order], upper[order])
        node[place, 0] = place + below
        if level == 0:
            node[place, 1], node[place, 2] = entry, stop
    return HostTrees(root, low, high, node, order)


def _level_counts(leaves: np.ndarray) -> np.ndarray:
    """Return the nodes of each tree on each level, from the leaves to the root and 0 above it, shape [N, levels]."""
    levels = [leaves]
    while (levels[-1] > 1).any():
        levels.append(np.where(levels[-1] > 1, -(-levels[-1] // LEAF), 0))
    return np.stack(levels, axis=1)


def _nodes_before(levels: np.ndarray, tree: np.ndarray, level: int, begin: np.ndarray) -> np.ndarray:
    """Return how many nodes of its tree come before each node of a level that begins at a leaf.

    These are the nodes of any level that begin before it, and the larger ones that begin with it.
    """
    before = np.zeros(len(tree), dtype=np.int64)
    for other in range(levels.shape[1]):
        own = -(-begin // LEAF**other)
        if other > level:
            own = own + (begin % LEAF**other == 0)
        before += np.where(levels[tree, other] > 0, own, 0)
    return before


def _boxes(begin: np.ndarray, end: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return low and high corners of the boxes around ranges of boxes, in any order, shapes [M, 3]."""
    ends = np.column_stack([begin, end]).reshape(-1)
    ends = ends[: len(ends) - (ends[-1] == len(lower))]  # `reduceat` takes no end behind the last
    return np.minimum.reduceat(lower, ends)[::2], np.maximum.reduceat(upper, ends)[::2]
