"""Build the BVHs that `bvh.py` traverses, on the CPU, one triangle after the other.

A set of triangles is split where the surface area heuristic is lowest, over 16 bins of their boxes' middles on each
axis; the larger part is split again until there are four. Source: I. Wald, "On fast construction of SAH-based bounding
volume hierarchies", 2007.
"""

import warp as wp

from mmw.kernels.core.bvh import LEAF_FACES, LEAF_ROWS, MAX_DEPTH, NODE_ROWS, REFERENCE_ROW

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False, "max_unroll": 1})

BINS = wp.constant(16)
"""Bins of an axis; a set may be split between any two."""

MAX_FLOAT = wp.constant(3.0e38)

MARGIN = wp.constant(2.5e-7)
"""Relative margin of a box around what it holds, over its coordinates."""

MIN_MARGIN = wp.constant(wp.vec3(1.0e-3, 1.0e-3, 1.0e-3))
"""Margin that is added to them [m]: a box that ends at the coordinate 0 is larger too, or a ray along an axis in that
plane would pass it, and the lowest of equal faces with it."""

Corners = wp.types.matrix(shape=(4, 3), dtype=wp.float32)
"""A corner of the box of each child."""


@wp.struct
class Work:
    """Input of a build and the arrays that it writes between its steps. M triangles."""

    corner: wp.array2d[wp.vec3]
    """Corners [m], shape [M, 3]."""
    order: wp.array[int]
    """Triangles; every node and leaf holds a range of them, shape [M]."""
    lower: wp.array[wp.vec3]
    """Lower corner of the box of each triangle in that order [m], shape [M]."""
    upper: wp.array[wp.vec3]
    """Upper corner [m], shape [M]."""
    stack: wp.array2d[int]
    """Nodes that are not built yet: number, first triangle, last + 1, level; shape [M, 4]."""
    bin_count: wp.array2d[int]
    """Triangles in each bin of each axis, shape [3, BINS]."""
    bin_lower: wp.array2d[wp.vec3]
    """Lower corner of the box about what lies in it [m]."""
    bin_upper: wp.array2d[wp.vec3]
    cost_behind: wp.array[float]
    """Area times number of what lies in a bin and behind it, shape [BINS]."""


@wp.struct
class Box:
    """A box."""

    lower: wp.vec3
    upper: wp.vec3


@wp.func
def no_box() -> Box:
    """Return a box that holds nothing."""
    box = Box()
    box.lower = wp.vec3(MAX_FLOAT, MAX_FLOAT, MAX_FLOAT)
    box.upper = -box.lower
    return box


@wp.func
def half_area(box: Box) -> float:
    """Return half the surface of a box that is not empty [m2]."""
    side = box.upper - box.lower
    return side[0] * side[1] + side[1] * side[2] + side[2] * side[0]


@wp.func
def box_of(work: Work, begin: int, end: int) -> Box:
    """Return the box about a range of triangles [m]."""
    box = no_box()
    for i in range(begin, end):
        box.lower = wp.min(box.lower, work.lower[i])
        box.upper = wp.max(box.upper, work.upper[i])
    return box


@wp.func
def box_of_bins(work: Work, axis: int, first: int, last: int) -> Box:
    """Return the box about what lies in bins, `last` included [m]."""
    box = no_box()
    for k in range(first, last + 1):
        box.lower = wp.min(box.lower, work.bin_lower[axis, k])
        box.upper = wp.max(box.upper, work.bin_upper[axis, k])
    return box


@wp.func
def bins_of(middle: wp.vec3, start: wp.vec3, scale: wp.vec3) -> wp.vec3i:
    """Return the bins of a triangle whose box has this middle."""
    at = wp.cw_mul(middle - start, scale)
    return wp.vec3i(
        wp.clamp(int(at[0]), 0, BINS - 1), wp.clamp(int(at[1]), 0, BINS - 1), wp.clamp(int(at[2]), 0, BINS - 1)
    )


@wp.struct
class Split:
    """Two parts of a range of triangles."""

    middle: int
    """Start of the second."""
    left: Box
    right: Box


@wp.func
def halves(work: Work, begin: int, end: int) -> Split:
    """Return the two halves of a range of triangles in its present order."""
    split = Split()
    split.middle = (begin + end) // 2
    split.left = box_of(work, begin, split.middle)
    split.right = box_of(work, split.middle, end)
    return split


@wp.func
def best_split(work: Work, begin: int, end: int) -> Split:
    """Order a range of triangles so that its two parts have the lowest cost; halve it if all have one middle."""
    low = wp.vec3(MAX_FLOAT, MAX_FLOAT, MAX_FLOAT)
    high = -low
    for i in range(begin, end):
        middle = 0.5 * (work.lower[i] + work.upper[i])
        low = wp.min(low, middle)
        high = wp.max(high, middle)
    width = high - low
    scale = wp.vec3(0.0, 0.0, 0.0)
    for axis in range(3):
        if width[axis] > 0.0:
            scale[axis] = float(BINS) / width[axis]
        for k in range(BINS):
            work.bin_count[axis, k] = 0
            work.bin_lower[axis, k] = wp.vec3(MAX_FLOAT, MAX_FLOAT, MAX_FLOAT)
            work.bin_upper[axis, k] = wp.vec3(-MAX_FLOAT, -MAX_FLOAT, -MAX_FLOAT)
    for i in range(begin, end):
        lower = work.lower[i]
        upper = work.upper[i]
        at = bins_of(0.5 * (lower + upper), low, scale)
        for axis in range(3):
            k = at[axis]
            work.bin_count[axis, k] = work.bin_count[axis, k] + 1
            work.bin_lower[axis, k] = wp.min(work.bin_lower[axis, k], lower)
            work.bin_upper[axis, k] = wp.max(work.bin_upper[axis, k], upper)
    min_cost = wp.float32(MAX_FLOAT)
    best_axis = wp.int32(-1)
    best_bin = wp.int32(0)
    for axis in range(3):
        if width[axis] > 0.0:
            behind = no_box()
            count = wp.int32(0)
            for j in range(BINS - 1):
                k = BINS - 1 - j
                count += work.bin_count[axis, k]
                behind.lower = wp.min(behind.lower, work.bin_lower[axis, k])
                behind.upper = wp.max(behind.upper, work.bin_upper[axis, k])
                work.cost_behind[k] = MAX_FLOAT
                if count > 0:
                    work.cost_behind[k] = half_area(behind) * float(count)
            before = no_box()
            count = wp.int32(0)
            for k in range(BINS - 1):
                count += work.bin_count[axis, k]
                before.lower = wp.min(before.lower, work.bin_lower[axis, k])
                before.upper = wp.max(before.upper, work.bin_upper[axis, k])
                if count > 0 and work.cost_behind[k + 1] < MAX_FLOAT:
                    cost = half_area(before) * float(count) + work.cost_behind[k + 1]
                    if cost < min_cost:
                        min_cost = cost
                        best_axis = axis
                        best_bin = k
    if best_axis < 0:
        return halves(work, begin, end)
    split = Split()
    split.left = box_of_bins(work, best_axis, 0, best_bin)
    split.right = box_of_bins(work, best_axis, best_bin + 1, BINS - 1)
    first = wp.int32(begin)
    last = wp.int32(end - 1)
    while first <= last:
        lower = work.lower[first]
        upper = work.upper[first]
        at = bins_of(0.5 * (lower + upper), low, scale)
        if at[best_axis] <= best_bin:
            first += 1
        else:
            face = work.order[first]
            work.order[first] = work.order[last]
            work.lower[first] = work.lower[last]
            work.upper[first] = work.upper[last]
            work.order[last] = face
            work.lower[last] = lower
            work.upper[last] = upper
            last -= 1
    split.middle = first
    return split


@wp.func
def depth_of(count: int, leaf_faces: int) -> int:
    """Return the depth of a BVH over `count` triangles whose nodes quarter them down to leaves of `leaf_faces`."""
    depth = wp.int32(1)
    held = wp.int32(4 * leaf_faces)
    while held < count:
        held *= 4
        depth += 1
    return depth


@wp.func
def write_leaf(
    work: Work, begin: int, count: int, leaf: int,
    # out
    leaves_out: wp.array2d[wp.vec4],
):  # fmt: skip
    """Write the corners and numbers of a range of triangles, the last one again where there are fewer than four."""
    for corner in range(3):
        for axis in range(3):
            row = wp.vec4()
            for j in range(LEAF_FACES):
                row[j] = work.corner[work.order[begin + wp.min(j, count - 1)], corner][axis]
            leaves_out[leaf, 3 * corner + axis] = row
    last = wp.vec4()
    for j in range(LEAF_FACES):
        last[j] = wp.cast(work.order[begin + wp.min(j, count - 1)], float)
    leaves_out[leaf, LEAF_ROWS - 1] = last


@wp.kernel
def build_tree_kernel(
    work: Work,
    leaf_faces: int,
    # out
    nodes_out: wp.array2d[wp.vec4],
    leaves_out: wp.array2d[wp.vec4],
    counts_out: wp.array[int],
):
    """Build the BVH of one mesh; the root is node 0. `counts_out` holds the numbers of nodes and leaves.

    A leaf gets `leaf_faces` triangles at most, 1 to `LEAF_FACES`.

    Launch: dim=1, on the CPU.
    """
    wp.tid()
    faces = work.corner.shape[0]
    for i in range(faces):
        a = work.corner[i, 0]
        b = work.corner[i, 1]
        c = work.corner[i, 2]
        work.lower[i] = wp.min(a, wp.min(b, c))
        work.upper[i] = wp.max(a, wp.max(b, c))
        work.order[i] = i
    node_count = wp.int32(1)
    leaf_count = wp.int32(0)
    size = wp.int32(1)
    work.stack[0, 0] = 0
    work.stack[0, 1] = 0
    work.stack[0, 2] = faces
    work.stack[0, 3] = 0
    while size > 0:
        size -= 1
        node = work.stack[size, 0]
        depth_above = work.stack[size, 3]
        begin = wp.vec4i(work.stack[size, 1], 0, 0, 0)
        end = wp.vec4i(work.stack[size, 2], 0, 0, 0)
        # Deep in the BVH split by halves, so that it ends.
        is_deep = depth_above + depth_of(end[0] - begin[0], leaf_faces) >= MAX_DEPTH
        area = wp.vec4(1.0, 0.0, 0.0, 0.0)
        lower = Corners()
        upper = Corners()
        if faces <= leaf_faces:  # one leaf below the root
            whole = box_of(work, 0, faces)
            lower[0] = whole.lower
            upper[0] = whole.upper
        children = wp.int32(1)
        is_whole = wp.bool(False)
        while children < 4 and not is_whole:
            widest = wp.int32(-1)
            for k in range(children):
                if end[k] - begin[k] > leaf_faces and (widest < 0 or area[k] > area[widest]):
                    widest = k
            if widest < 0:
                is_whole = True
            else:
                from_face = begin[widest]
                to_face = end[widest]
                parts = Split()
                if is_deep:
                    parts = halves(work, from_face, to_face)
                    area[widest] = float(parts.middle - from_face)
                    area[children] = float(to_face - parts.middle)
                else:
                    parts = best_split(work, from_face, to_face)
                    area[widest] = half_area(parts.left)
                    area[children] = half_area(parts.right)
                end[widest] = parts.middle
                begin[children] = parts.middle
                end[children] = to_face
                lower[widest] = parts.left.lower
                upper[widest] = parts.left.upper
                lower[children] = parts.right.lower
                upper[children] = parts.right.upper
                children += 1
        lower_x = wp.vec4(MAX_FLOAT, MAX_FLOAT, MAX_FLOAT, MAX_FLOAT)
        lower_y = lower_x
        lower_z = lower_x
        upper_x = -lower_x
        upper_y = -lower_x
        upper_z = -lower_x
        child = wp.vec4i(-1, -1, -1, -1)
        for k in range(children):
            low = lower[k] - MARGIN * (wp.abs(lower[k]) + MIN_MARGIN)
            high = upper[k] + MARGIN * (wp.abs(upper[k]) + MIN_MARGIN)
            lower_x[k] = low[0]
            lower_y[k] = low[1]
            lower_z[k] = low[2]
            upper_x[k] = high[0]
            upper_y[k] = high[1]
            upper_z[k] = high[2]
            count = end[k] - begin[k]
            if count <= leaf_faces:
                child[k] = -1 - (8 * leaf_count + count)
                write_leaf(work, begin[k], count, leaf_count, leaves_out)
                leaf_count += 1
            else:
                child[k] = node_count
                work.stack[size, 0] = node_count
                work.stack[size, 1] = begin[k]
                work.stack[size, 2] = end[k]
                work.stack[size, 3] = depth_above + 1
                size += 1
                node_count += 1
        nodes_out[node, 0] = lower_x
        nodes_out[node, 1] = lower_y
        nodes_out[node, 2] = lower_z
        nodes_out[node, 3] = upper_x
        nodes_out[node, 4] = upper_y
        nodes_out[node, 5] = upper_z
        nodes_out[node, REFERENCE_ROW] = wp.vec4(
            wp.cast(child[0], float), wp.cast(child[1], float), wp.cast(child[2], float), wp.cast(child[3], float)
        )
        nodes_out[node, NODE_ROWS - 1] = wp.vec4()
    counts_out[0] = node_count
    counts_out[1] = leaf_count
