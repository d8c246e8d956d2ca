"""Measure how long segments run inside closed hulls, such as crowns of trees."""

import warp as wp

from mmw.kernels.core.compiler import DOUBLE_PRECISION
from mmw.kernels.core.geometry import single

wp.set_module_options(DOUBLE_PRECISION)

NO_FACE = wp.constant(-1)
"""No crossing is left."""
EVERY_FACE = wp.constant(2**31 - 1)
"""After every face: crossings at the same distance are none of those to come."""


@wp.struct
class Hulls:
    """Closed hulls, whose faces are counter-clockwise from outside; they may overlap."""

    bvh: wp.uint64
    """wp.Bvh id over boxes of the faces, scene frame."""
    corner: wp.array2d[wp.vec3d]
    """Corners of each face, scene frame [m], shape [F, 3]; equal where faces meet."""


@wp.struct
class Ray:
    """A ray, with two axes across it; right-handed with the direction."""

    begin: wp.vec3d
    direction: wp.vec3d
    across: wp.vec3d
    up: wp.vec3d


@wp.struct
class Crossing:
    """Point at which a ray enters or leaves a hull."""

    t: wp.float64
    """Distance along the ray [m]."""
    face: int
    side: int
    """1 for a ray that leaves, -1 for one that enters, 0 for no crossing."""


@wp.func
def ray_along(begin: wp.vec3d, direction: wp.vec3d) -> Ray:
    """Return a ray with its axes."""
    ray = Ray()
    ray.begin = begin
    ray.direction = direction
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    other = wp.where(wp.abs(direction[0]) < wp.float64(0.6), wp.vec3d(one, zero, zero), wp.vec3d(zero, one, zero))
    ray.across = wp.normalize(wp.cross(other, direction))
    ray.up = wp.cross(direction, ray.across)
    return ray


@wp.func
def turn(a: wp.vec3d, b: wp.vec3d) -> wp.vec2d:
    """Return twice the signed area of the origin, a and b in their first two coordinates, and its sign.

    Faces that share an edge get opposite numbers, to the last bit: the lower end always comes first. Where the origin
    is on the edge, the sign is that for an origin moved by (d, d^2), d > 0 small. So of the faces around an edge or a
    vertex on the ray exactly as many count as a ray beside it would cross.

    Source: H. Edelsbrunner and E. Muecke, "Simulation of simplicity", ACM Trans. Graphics 9(1), 1990.
    """
    is_swapped = b[0] < a[0] or (b[0] == a[0] and b[1] < a[1])
    low = a
    high = b
    if is_swapped:
        low = b
        high = a
    area = low[0] * high[1] - low[1] * high[0]
    sign = wp.sign(area)
    if area == wp.float64(0.0):
        sign = wp.float64(1.0)
        if high[1] > low[1]:
            sign = wp.float64(-1.0)
    if is_swapped:
        area = -area
        sign = -sign
    return wp.vec2d(area, sign)


@wp.func
def seen_from(ray: Ray, point: wp.vec3d) -> wp.vec3d:
    """Return a point in the axes of a ray: across, up, along."""
    offset = point - ray.begin
    return wp.vec3d(wp.dot(offset, ray.across), wp.dot(offset, ray.up), wp.dot(offset, ray.direction))


@wp.func
def cross_face(hulls: Hulls, ray: Ray, face: int) -> Crossing:
    """Return where the line of a ray crosses a face, before its begin too."""
    a = seen_from(ray, hulls.corner[face, 0])
    b = seen_from(ray, hulls.corner[face, 1])
    c = seen_from(ray, hulls.corner[face, 2])
    ab = turn(a, b)
    bc = turn(b, c)
    ca = turn(c, a)
    crossing = Crossing()
    crossing.face = face
    if ab[1] == bc[1] and bc[1] == ca[1]:
        total = ab[0] + bc[0] + ca[0]
        crossing.side = wp.where(ab[1] > wp.float64(0.0), 1, -1)
        crossing.t = a[2]
        if total != wp.float64(0.0):
            crossing.t = (ab[0] * c[2] + bc[0] * a[2] + ca[0] * b[2]) / total
    return crossing


@wp.func
def next_crossing(hulls: Hulls, ray: Ray, before: Crossing, end: wp.float64) -> Crossing:
    """Return the first crossing after another one and before `end`; equal distances are in the order of faces."""
    found = Crossing()
    found.t = end
    found.face = NO_FACE
    face = wp.int32(0)
    query = wp.bvh_query_ray(hulls.bvh, single(ray.begin), single(ray.direction))
    while wp.bvh_query_next(query, face, wp.float32(end) * 1.001 + 0.1):
        own = cross_face(hulls, ray, face)
        is_after = own.t > before.t or (own.t == before.t and face > before.face)
        is_first = own.t < found.t or (own.t == found.t and found.face != NO_FACE and face < found.face)
        if own.side != 0 and is_after and is_first:
            found = own
    return found


@wp.func
def hulls_around_begin(hulls: Hulls, ray: Ray) -> int:
    """Return how many hulls the begin of a ray is inside: how many more times the ray leaves than it enters."""
    count = wp.int32(0)
    face = wp.int32(0)
    query = wp.bvh_query_ray(hulls.bvh, single(ray.begin), single(ray.direction))
    while wp.bvh_query_next(query, face, wp.inf):
        own = cross_face(hulls, ray, face)
        if own.side != 0 and own.t > wp.float64(0.0):
            count = count + own.side
    return count


@wp.kernel
def length_inside_kernel(
    hulls: Hulls,
    begin: wp.array[wp.vec3d],
    end: wp.array[wp.vec3d],
    # out
    length_out: wp.array[wp.float64],
):
    """Measure the part of each segment that is inside any hull [m]; what is inside several counts once.

    `begin` and `end` are in the scene frame [m]. Launch: dim=S, block_dim=64.
    """
    segment = wp.tid()
    span = end[segment] - begin[segment]
    length = wp.length(span)
    inside = wp.float64(0.0)
    if length > wp.float64(0.0):
        ray = ray_along(begin[segment], span / length)
        depth = hulls_around_begin(hulls, ray)
        last = Crossing()
        last.face = EVERY_FACE
        crossing = next_crossing(hulls, ray, last, length)
        while crossing.face != NO_FACE:
            if depth > 0:
                inside = inside + (crossing.t - last.t)
            depth = depth - crossing.side
            last = crossing
            crossing = next_crossing(hulls, ray, last, length)
        if depth > 0:
            inside = inside + (length - last.t)
    length_out[segment] = inside
