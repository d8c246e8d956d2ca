"""Find the boxes that hold a point, in trees of boxes: one of many triangles, or surfaces, without asking each.

The nodes of a tree lie in the order of a walk that takes every node before those below it, so that the walk needs no
stack: it goes on with the next node, or, where the box does not hold the point, with the one behind all below it.
"""

import warp as wp

from mmw.kernels.core.compiler import DOUBLE_PRECISION

wp.set_module_options(DOUBLE_PRECISION)

BOX_MARGIN = wp.constant(wp.float64(1e-6))
"""Slack of the box test, which only has to be generous [m]."""

FEW = 16
"""Most entries of a row without a tree. Design value."""

LEAF = 4
"""Entries of a leaf, and nodes below another one. Design value."""


@wp.struct
class BoxTrees:
    """Trees of boxes, one for each row of many entries."""

    root: wp.array[int]
    """First node of each row's tree, -1 for rows of up to `FEW` entries, which have none, shape [K]."""
    lower: wp.array[wp.vec3d]
    """Low corner of the box of each node [m], shape [N]."""
    upper: wp.array[wp.vec3d]
    """High corner of that box [m], shape [N]."""
    node: wp.array[wp.vec3i]
    """Node behind all below it; first entry in `order` of a leaf and the one behind its last, equal for others, shape
    [N]."""
    order: wp.array[int]
    """Entries of all rows, those of a row one after the other, sorted in space where it has a tree, shape [E]."""


@wp.func
def largest(v: wp.vec3d) -> wp.float64:
    """Return the largest magnitude among the components."""
    return wp.max(wp.max(wp.abs(v[0]), wp.abs(v[1])), wp.abs(v[2]))


@wp.func
def in_box(low: wp.vec3d, high: wp.vec3d, point: wp.vec3d) -> bool:
    """Return whether a point lies in a box, or very near it."""
    slack = -BOX_MARGIN * (wp.float64(1.0) + largest(point))
    return wp.min(point - low) >= slack and wp.min(high - point) >= slack


@wp.func
def next_leaf(trees: BoxTrees, node: int, end: int, point: wp.vec3d, slack: wp.vec3d) -> int:
    """Return the first leaf from `node` to before `end` whose box holds a point, with some slack [m]; `end` if none."""
    at = node
    found = end
    while at < end:
        step = trees.node[at]
        if in_box(trees.lower[at] - slack, trees.upper[at] + slack, point):
            if step[1] < step[2]:
                found = at
                end = at
            at = at + 1
        else:
            at = step[0]
    return found
