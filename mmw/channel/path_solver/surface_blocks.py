"""Put boxes around blocks of triangles and of surfaces, so that a point is not tested against each."""

import numpy as np

from mmw.core.spatial_order import spatial_order
from mmw.kernels.channel.surfaces import BLOCK

BLOCK_MARGIN_M = 1e-2
"""Points this far from the box of some triangles may still count as in them [m]: ten times what a flat surface may
bend (`mmw.core.planar_surfaces.PLANE_M`)."""


def triangle_blocks(triangle: np.ndarray, first: np.ndarray, count: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return boxes around blocks of successive triangles, so that a point is not tested against all of a surface.

    Args:
        triangle: Corners of all triangles [m], shape [T, 3, 3].
        first: First triangle of each row, shape [K].
        count: Triangles of each row, > 0, shape [K].

    Returns:
        First block of each row, 0 for rows of up to `BLOCK` triangles, which have none, shape [K]; low and high corners
        of the blocks [m], shapes [B, 3].
    """
    first_block, begin, end = _blocks(first, count)
    lower, upper = _boxes(begin, end, triangle.min(axis=1), triangle.max(axis=1))
    return first_block, lower - BLOCK_MARGIN_M, upper + BLOCK_MARGIN_M


def member_blocks(first: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return boxes around blocks of surfaces that are neighbors in their plane.

    Args:
        first: First surface of each plane, and the number of all, shape [K + 1].
        lower: Low corners of the surfaces' boxes [m], shape [G, 3].
        upper: High corners [m], shape [G, 3].

    Returns:
        Surfaces sorted in space within each plane of more than `BLOCK`, shape [G]; first block of each plane, 0
        for planes of up to `BLOCK` surfaces, which have none, shape [K]; low and high corners of the blocks [m], shapes
        [M, 3].
    """
    count = np.diff(first)
    plane = np.repeat(np.arange(len(count)), count)
    order = np.arange(len(lower))
    many = np.flatnonzero(count[plane] > BLOCK)
    if len(many):
        near = many[spatial_order(0.5 * (lower[many] + upper[many]))]
        order[many] = near[np.argsort(plane[near], kind="stable")]
    first_block, begin, end = _blocks(first[:-1], count)
    return order, first_block, *_boxes(begin, end, lower[order], upper[order])


def _blocks(first: np.ndarray, count: np.ndarray) -> tuple[np.ndarray, ...]:
    """Return the first block of each row, 0 for those without, and where each block begins and ends."""
    blocks = np.where(count > BLOCK, -(-count // BLOCK), 0)
    first_block = np.cumsum(blocks) - blocks
    row = np.repeat(np.arange(len(count)), blocks)
    begin = first[row] + BLOCK * (np.arange(len(row)) - first_block[row])
    return first_block, begin, np.minimum(begin + BLOCK, first[row] + count[row])


def _boxes(begin: np.ndarray, end: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return low and high corners of the boxes around blocks of boxes, shapes [M, 3]."""
    if not len(begin):
        return np.zeros((0, 3)), np.zeros((0, 3))
    ends = np.column_stack([begin, end]).reshape(-1)
    ends = ends[: len(ends) - (ends[-1] == len(lower))]  # `reduceat` takes no end behind the last
    return np.minimum.reduceat(lower, ends)[::2], np.maximum.reduceat(upper, ends)[::2]
