"""Building the trees that `tree.py` walks, on the CPU, one triangle after the other.

A set of triangles is split where the surface area heuristic is least, over 16 bins of their boxes' middles on each
axis; the larger part is split again until there are four. Source: I. Wald, "On fast construction of SAH-based bounding
volume hierarchies", 2007.
"""

import warp as wp

from mmw.kernels.tree import LEAF_FACES, LEAF_ROWS, MOST_LEVELS, NODE_ROWS

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False, "max_unroll": 1})

BINS = wp.constant(16)
"""Places on an axis where a set may be split, and one."""

LARGEST = wp.constant(3.0e38)


@wp.struct
class Work:
    """What a build needs of the triangles, and where it writes between its steps. M triangles."""

    corner: wp.array2d[wp.vec3]
    """Corners [m], shape [M, 3]."""
    lower: wp.array[wp.vec3]
    """Lower corner of each triangle's box [m], shape [M]."""
    upper: wp.array[wp.vec3]
    """Upper corner [m], shape [M]."""
    order: wp.array[int]
    """Triangles; every node and leaf holds a stretch of them, shape [M]."""
    waiting: wp.array2d[int]
    """Nodes that are not made yet: number, first triangle, last + 1, level; shape [M, 4]."""
    bin_count: wp.array[int]
    """Triangles in each bin, shape [BINS]."""
    bin_lower: wp.array[wp.vec3]
    bin_upper: wp.array[wp.vec3]
    cost_behind: wp.array[float]
    """Area times number of what lies in a bin and behind it, shape [BINS]."""


@wp.func
def half_area(lower: wp.vec3, upper: wp.vec3) -> float:
    """Return half the surface of a box [m2]."""
    side = upper - lower
    return side[0] * side[1] + side[1] * side[2] + side[2] * side[0]


@wp.func
def area_of(work: Work, begin: int, end: int) -> float:
    """Return half the surface of the box about a stretch of triangles [m2]."""
    lower = wp.vec3(LARGEST, LARGEST, LARGEST)
    upper = -lower
    for i in range(begin, end):
        lower = wp.min(lower, work.lower[work.order[i]])
        upper = wp.max(upper, work.upper[work.order[i]])
    return half_area(lower, upper)


@wp.func
def bin_of(work: Work, face: int, axis: int, start: float, scale: float) -> int:
    """Return the bin of a triangle."""
    middle = 0.5 * (work.lower[face][axis] + work.upper[face][axis])
    return wp.clamp(int((middle - start) * scale), 0, BINS - 1)


@wp.func
def split(work: Work, begin: int, end: int) -> int:
    """Order a stretch of triangles so that its two parts cost rays least, and return where the second begins.

    A stretch whose triangles share one middle is halved as it stands.
    """
    low = wp.vec3(LARGEST, LARGEST, LARGEST)
    high = -low
    for i in range(begin, end):
        face = work.order[i]
        middle = 0.5 * (work.lower[face] + work.upper[face])
        low = wp.min(low, middle)
        high = wp.max(high, middle)
    least = wp.float32(LARGEST)
    best_axis = wp.int32(-1)
    best_bin = wp.int32(0)
    for axis in range(3):
        width = high[axis] - low[axis]
        if width > 0.0:
            scale = float(BINS) / width
            for k in range(BINS):
                work.bin_count[k] = 0
                work.bin_lower[k] = wp.vec3(LARGEST, LARGEST, LARGEST)
                work.bin_upper[k] = wp.vec3(-LARGEST, -LARGEST, -LARGEST)
            for i in range(begin, end):
                face = work.order[i]
                k = bin_of(work, face, axis, low[axis], scale)
                work.bin_count[k] = work.bin_count[k] + 1
                work.bin_lower[k] = wp.min(work.bin_lower[k], work.lower[face])
                work.bin_upper[k] = wp.max(work.bin_upper[k], work.upper[face])
            lower = wp.vec3(LARGEST, LARGEST, LARGEST)
            upper = -lower
            count = wp.int32(0)
            for j in range(BINS - 1):
                k = BINS - 1 - j
                count += work.bin_count[k]
                lower = wp.min(lower, work.bin_lower[k])
                upper = wp.max(upper, work.bin_upper[k])
                work.cost_behind[k] = wp.where(count > 0, half_area(lower, upper) * float(count), LARGEST)
            lower = wp.vec3(LARGEST, LARGEST, LARGEST)
            upper = -lower
            count = wp.int32(0)
            for k in range(BINS - 1):
                count += work.bin_count[k]
                lower = wp.min(lower, work.bin_lower[k])
                upper = wp.max(upper, work.bin_upper[k])
                if count > 0 and work.cost_behind[k + 1] < LARGEST:
                    cost = half_area(lower, upper) * float(count) + work.cost_behind[k + 1]
                    if cost < least:
                        least = cost
                        best_axis = axis
                        best_bin = k
    if best_axis < 0:
        return (begin + end) // 2
    start = low[best_axis]
    scale = float(BINS) / (high[best_axis] - start)
    first = wp.int32(begin)
    last = wp.int32(end - 1)
    while first <= last:
        face = work.order[first]
        if bin_of(work, face, best_axis, start, scale) <= best_bin:
            first += 1
        else:
            work.order[first] = work.order[last]
            work.order[last] = face
            last -= 1
    return first


@wp.func
def levels_of(count: int) -> int:
    """Return the levels of nodes over so many triangles if each node quarters them."""
    levels = wp.int32(1)
    held = wp.int32(4 * LEAF_FACES)
    while held < count:
        held *= 4
        levels += 1
    return levels


@wp.kernel
def build_tree_kernel(
    work: Work,
    # out
    nodes_out: wp.array2d[wp.vec4],
    leaves_out: wp.array2d[wp.vec4],
    counts_out: wp.array[int],
):
    """Build the tree of one mesh; the root is node 0. `counts_out` is how many nodes and leaves there are.

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
    work.waiting[0, 0] = 0
    work.waiting[0, 1] = 0
    work.waiting[0, 2] = faces
    work.waiting[0, 3] = 0
    while size > 0:
        size -= 1
        node = work.waiting[size, 0]
        level = work.waiting[size, 3]
        begin = wp.vec4i(work.waiting[size, 1], 0, 0, 0)
        end = wp.vec4i(work.waiting[size, 2], 0, 0, 0)
        # A tree that has become deep goes on by halves, so that it ends.
        is_deep = level + levels_of(end[0] - begin[0]) >= MOST_LEVELS
        area = wp.vec4(1.0, 0.0, 0.0, 0.0)
        children = wp.int32(1)
        is_whole = wp.bool(False)
        while children < 4 and not is_whole:
            widest = wp.int32(-1)
            for k in range(children):
                if end[k] - begin[k] > LEAF_FACES and (widest < 0 or area[k] > area[widest]):
                    widest = k
            if widest < 0:
                is_whole = True
            else:
                from_face = begin[widest]
                to_face = end[widest]
                middle = (from_face + to_face) // 2
                if is_deep:
                    area[widest] = float(middle - from_face)
                    area[children] = float(to_face - middle)
                else:
                    middle = split(work, from_face, to_face)
                    area[widest] = area_of(work, from_face, middle)
                    area[children] = area_of(work, middle, to_face)
                end[widest] = middle
                begin[children] = middle
                end[children] = to_face
                children += 1
        lower_x = wp.vec4(LARGEST, LARGEST, LARGEST, LARGEST)
        lower_y = lower_x
        lower_z = lower_x
        upper_x = -lower_x
        upper_y = -lower_x
        upper_z = -lower_x
        child = wp.vec4i(-1, -1, -1, -1)
        for k in range(children):
            lower = wp.vec3(LARGEST, LARGEST, LARGEST)
            upper = -lower
            for i in range(begin[k], end[k]):
                lower = wp.min(lower, work.lower[work.order[i]])
                upper = wp.max(upper, work.upper[work.order[i]])
            lower = lower - 2.5e-7 * wp.abs(lower)
            upper = upper + 2.5e-7 * wp.abs(upper)
            lower_x[k] = lower[0]
            lower_y[k] = lower[1]
            lower_z[k] = lower[2]
            upper_x[k] = upper[0]
            upper_y[k] = upper[1]
            upper_z[k] = upper[2]
            count = end[k] - begin[k]
            if count <= LEAF_FACES:
                child[k] = -1 - (8 * leaf_count + count)
                for corner in range(3):
                    for axis in range(3):
                        row = wp.vec4()
                        for j in range(LEAF_FACES):
                            face = work.order[begin[k] + wp.min(j, count - 1)]
                            row[j] = work.corner[face, corner][axis]
                        leaves_out[leaf_count, 3 * corner + axis] = row
                last = wp.vec4()
                for j in range(LEAF_FACES):
                    last[j] = wp.cast(work.order[begin[k] + wp.min(j, count - 1)], float)
                leaves_out[leaf_count, LEAF_ROWS - 1] = last
                leaf_count += 1
            else:
                child[k] = node_count
                work.waiting[size, 0] = node_count
                work.waiting[size, 1] = begin[k]
                work.waiting[size, 2] = end[k]
                work.waiting[size, 3] = level + 1
                size += 1
                node_count += 1
        nodes_out[node, 0] = lower_x
        nodes_out[node, 1] = lower_y
        nodes_out[node, 2] = lower_z
        nodes_out[node, 3] = upper_x
        nodes_out[node, 4] = upper_y
        nodes_out[node, 5] = upper_z
        nodes_out[node, 6] = wp.vec4(
            wp.cast(child[0], float), wp.cast(child[1], float), wp.cast(child[2], float), wp.cast(child[3], float)
        )
        nodes_out[node, NODE_ROWS - 1] = wp.vec4()
    counts_out[0] = node_count
    counts_out[1] = leaf_count
