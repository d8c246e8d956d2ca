"""Sort paths and leave out those that stand for another one, on the host in float64."""

import warp as wp

from mmw.kernels.channel.segments import DIFFRACTION
from mmw.kernels.core.compiler import AS_NUMPY
from mmw.kernels.core.row_order import sort_rows

wp.set_module_options(AS_NUMPY)

SAME_POINT_M = 1e-3
"""Two interactions of one link closer than this, or than a segment's lift, are duplicates on coincident surfaces."""

SAME_NORMAL_COS = 0.995
"""Coincident surfaces have normals, on either side, with a larger cosine between them: bends below 0.1 rad."""

SAME_POINT = wp.constant(wp.float64(SAME_POINT_M))
SAME_NORMAL = wp.constant(wp.float64(SAME_NORMAL_COS))


@wp.struct
class PathRows:
    """Paths of at most D interactions, P of them at most."""

    link: wp.array[int]
    """Link of each, shape [P]."""
    order: wp.array[int]
    """Number of interactions, shape [P]."""
    kind: wp.array2d[int]
    """Kind of each interaction, 0 behind the last, shape [P, D]."""
    surface: wp.array2d[int]
    """Global surface id of each, wedge id for a diffraction, -1 behind the last, shape [P, D]."""
    vertex: wp.array2d[wp.vec3d]
    """Point of each [m], shape [P, D]."""
    normal: wp.array2d[wp.vec3d]
    """Unit normal of each, 0 for a diffraction, shape [P, D]."""
    ray: wp.array[int]
    """Ray of a diffuse path, -1 for all others, shape [P]."""
    solid_angle: wp.array[wp.float64]
    """Solid angle of that ray, see `TracedPaths`, shape [P]."""


@wp.struct
class PathOrder:
    """Order of paths; all but the count is scratch."""

    key: wp.array2d[wp.float64]
    """Keys by which paths are sorted, shape [P, 3 + 2 D]."""
    near_key: wp.array2d[wp.float64]
    """Link, order and length [m], shape [P, 3]."""
    size: wp.array[wp.float64]
    """Sum of the areas of a path's surfaces [m^2], shape [P]."""
    rank: wp.array[int]
    """Place of each in the order of the keys, shape [P]."""
    is_dropped: wp.array[wp.uint8]
    """Shape [P]."""
    near: wp.array[int]
    """Paths in the order of `near_key`, shape [P]."""
    spare: wp.array[int]
    """Shape [P]."""
    row: wp.array[int]
    """Paths in the order of the keys, shape [P]."""
    count: wp.array[int]
    """Number of paths to keep, shape [1]."""


@wp.struct
class PathEnds:
    """Ends of L links."""

    number: wp.array[int]
    """Link that each number of a path that is given stands for, shape [L]."""
    tx: wp.array[wp.vec3d]
    """Transmitter of each link [m], shape [L]."""
    rx: wp.array[wp.vec3d]
    """Receiver of each [m], shape [L]."""


@wp.func
def distance(a: wp.vec3d, b: wp.vec3d) -> wp.float64:
    """Return the distance of two points [m]."""
    x = a[0] - b[0]
    y = a[1] - b[1]
    z = a[2] - b[2]
    return wp.sqrt(x * x + y * y + z * z)


@wp.func
def path_length(paths: PathRows, path: int, tx: wp.vec3d, rx: wp.vec3d) -> wp.float64:
    """Return the length of a path [m]."""
    total = wp.float64(0.0)
    last = tx
    for step in range(paths.order[path]):
        total = total + distance(paths.vertex[path, step], last)
        last = paths.vertex[path, step]
    return total + distance(rx, last)


@wp.func
def same_place_m(paths: PathRows, path: int, origin: wp.vec3d, lift: wp.float64) -> wp.float64:
    """Return below which distance interactions are in the same place as those of a path [m]."""
    reach = wp.float64(0.0)
    for step in range(paths.order[path]):
        for axis in range(3):
            reach = wp.max(reach, wp.abs(paths.vertex[path, step][axis] - origin[axis]))
    return wp.max(SAME_POINT, lift * (wp.float64(5.0) + reach))


@wp.func
def is_same(paths: PathRows, one: int, other: int, apart: wp.float64) -> bool:
    """Return whether two paths of one link have the same kinds of interactions in the same places.

    At a corner two surfaces are near each other, but not in one plane.
    """
    for step in range(paths.order[one]):
        if paths.kind[one, step] != paths.kind[other, step]:
            return False
        if distance(paths.vertex[one, step], paths.vertex[other, step]) > apart:
            return False
        if paths.kind[one, step] != DIFFRACTION:
            a = paths.normal[one, step]
            b = paths.normal[other, step]
            if wp.abs(a[0] * b[0] + a[1] * b[1] + a[2] * b[2]) < SAME_NORMAL:
                return False
    return True


@wp.kernel
def order_paths_kernel(
    paths: PathRows,
    ends: PathEnds,
    count: int,
    area: wp.array[wp.float64],
    origin: wp.vec3d,
    lift: wp.float64,
    # out
    order_out: PathOrder,
    paths_out: PathRows,
):
    """Write the paths to keep, sorted by link, order, kinds, surfaces and ray.

    Of paths of one link with the same interactions in the same places, see `SAME_POINT_M`, the one on the smallest
    surfaces stays (a marking lies on its road), and the lowest surface ids among equals. Diffuse paths all stay.
    `area` is that of every surface [m^2]; `origin` of the scene frame [m] and `lift` tell how exact points are.
    Launch: dim=1.
    """
    depth = paths.kind.shape[1]
    many = wp.int32(0)
    for path in range(count):
        order_out.key[path, 0] = wp.float64(ends.number[paths.link[path]])
        order_out.key[path, 1] = wp.float64(paths.order[path])
        for step in range(depth):
            order_out.key[path, 2 + step] = wp.float64(paths.kind[path, step])
            order_out.key[path, 2 + depth + step] = wp.float64(paths.surface[path, step])
        order_out.key[path, 2 + 2 * depth] = wp.float64(paths.ray[path])
        order_out.row[path] = path
    sort_rows(order_out.key, count, order_out.row, order_out.spare)
    for place in range(count):
        path = order_out.row[place]
        order_out.rank[path] = place
        order_out.is_dropped[path] = wp.uint8(0)
        if paths.ray[path] == -1 and paths.order[path] > 0:
            link = ends.number[paths.link[path]]
            order_out.near_key[path, 0] = order_out.key[path, 0]
            order_out.near_key[path, 1] = order_out.key[path, 1]
            order_out.near_key[path, 2] = path_length(paths, path, ends.tx[link], ends.rx[link])
            size = wp.float64(0.0)
            for step in range(depth):
                surface = paths.surface[path, step]
                if paths.kind[path, step] != DIFFRACTION and surface >= 0:
                    size = size + area[surface]
            order_out.size[path] = size
            order_out.near[many] = path
            many = many + 1
    sort_rows(order_out.near_key, many, order_out.near, order_out.spare)
    for place in range(many):
        one = order_out.near[place]
        apart = same_place_m(paths, one, origin, lift)
        reach = wp.float64(2.0) * apart * wp.float64(paths.order[one])
        after = place + 1
        while after < many:
            other = order_out.near[after]
            is_near = order_out.near_key[other, 0] == order_out.near_key[one, 0]
            is_near = is_near and order_out.near_key[other, 1] == order_out.near_key[one, 1]
            if is_near and order_out.near_key[other, 2] - order_out.near_key[one, 2] <= reach:
                if is_same(paths, one, other, apart):
                    is_first = order_out.size[one] < order_out.size[other]
                    if order_out.size[one] == order_out.size[other]:
                        is_first = order_out.rank[one] < order_out.rank[other]
                    order_out.is_dropped[wp.where(is_first, other, one)] = wp.uint8(1)
                after = after + 1
            else:
                after = many
    kept = wp.int32(0)
    for place in range(count):
        path = order_out.row[place]
        if order_out.is_dropped[path] == wp.uint8(0):
            paths_out.link[kept] = ends.number[paths.link[path]]
            paths_out.order[kept] = paths.order[path]
            paths_out.ray[kept] = paths.ray[path]
            paths_out.solid_angle[kept] = paths.solid_angle[path]
            for step in range(depth):
                paths_out.kind[kept, step] = paths.kind[path, step]
                paths_out.surface[kept, step] = paths.surface[path, step]
                paths_out.vertex[kept, step] = paths.vertex[path, step]
                paths_out.normal[kept, step] = paths.normal[path, step]
            kept = kept + 1
    order_out.count[0] = kept
