"""Find the faces of a mesh that may lie along an edge."""

import warp as wp

from mmw.kernels.core.compiler import DOUBLE_PRECISION

wp.set_module_options(DOUBLE_PRECISION)

TOUCH_M = wp.constant(wp.float64(1e-3))
"""A face this close to an edge touches it [m]."""
TOUCH_SHARE = wp.constant(wp.float64(0.05))
"""The same as a share of a short edge's length."""
MIN_CONTACT_M = wp.constant(wp.float64(1e-2))
"""Shortest stretch of an edge that a face touches [m]; a shorter one, or half of a short edge, counts for nothing."""
MAX_TILT = wp.constant(wp.float64(0.02))
"""A face touches an edge only if its plane is tilted against it by less than this [rad]."""


@wp.struct
class EdgeBoxes:
    """Edges of a mesh with boxes around them, and the corners of its faces."""

    lower: wp.array[wp.vec3]
    """Low corner of each edge's box, shape [E]."""
    upper: wp.array[wp.vec3]
    """High corner of each edge's box, shape [E]."""
    begin: wp.array[wp.vec3d]
    """One end of each edge [m], shape [E]."""
    end: wp.array[wp.vec3d]
    """Other end [m], shape [E]."""
    own_0: wp.array[int]
    """A face that has the edge, shape [E]."""
    own_n: wp.array[int]
    """Another one, or the same, shape [E]."""
    corner: wp.array[wp.vec3d]
    """Corners of all faces [m], shape [3 M]."""


@wp.func
def beside(
    part: wp.vec2d, normal: wp.vec3d, a: wp.vec3d, b: wp.vec3d, unit: wp.vec3d, touch: wp.float64
) -> wp.vec2d:  # fmt: skip
    """Return the part of a line through 0 on the inner side of one side of a triangle, turned over if there is none.

    A line that is parallel to the side counts as on it if they are within `touch` of each other.
    """
    inward = wp.normalize(wp.cross(normal, b - a))
    offset = wp.dot(inward, a)
    low = part[0] * wp.dot(inward, unit) - offset
    high = part[1] * wp.dot(inward, unit) - offset
    clipped = part
    if wp.abs(high - low) <= touch:
        if wp.max(low, high) < -touch:
            clipped = wp.vec2d(part[1], part[0])
    else:
        cross = part[0] - low * (part[1] - part[0]) / (high - low)
        if low < wp.float64(0.0):
            clipped[0] = wp.where(high < wp.float64(0.0), part[1], cross)
        if high < wp.float64(0.0):
            clipped[1] = wp.where(low < wp.float64(0.0), part[0], cross)
    return clipped


@wp.func
def contact_with(edges: EdgeBoxes, edge: int, face: int) -> wp.vec2d:
    """Return where along an edge a face touches it, from and to [m]; nowhere if the first is not below the second."""
    begin = edges.begin[edge]
    span = edges.end[edge] - begin
    length = wp.length(span)
    unit = span / length
    touch = wp.min(TOUCH_M, TOUCH_SHARE * length)
    least = wp.min(MIN_CONTACT_M, wp.float64(0.5) * length)
    a = edges.corner[3 * face] - begin
    b = edges.corner[3 * face + 1] - begin
    c = edges.corner[3 * face + 2] - begin
    along = wp.vec3d(wp.dot(unit, a), wp.dot(unit, b), wp.dot(unit, c))
    part = wp.vec2d(wp.max(wp.min(along), wp.float64(0.0)), wp.min(wp.max(along), length))
    is_found = part[1] - part[0] > least
    if is_found:
        normal = wp.normalize(wp.cross(b - a, c - a))
        tilt = wp.dot(normal, unit)
        is_found = wp.abs(tilt) < MAX_TILT
        if is_found:
            part = beside(part, normal, a, b, unit, touch)
            if part[1] - part[0] > least:
                part = beside(part, normal, b, c, unit, touch)
            if part[1] - part[0] > least:
                part = beside(part, normal, c, a, unit, touch)
            offset = wp.dot(normal, a)
            height = wp.max(wp.abs(part[0] * tilt - offset), wp.abs(part[1] * tilt - offset))
            is_found = part[1] - part[0] > least and height <= touch
    if not is_found:
        part = wp.vec2d()
    return part


@wp.kernel
def edge_contacts_kernel(
    boxes: wp.uint64,
    edges: EdgeBoxes,
    wanted: wp.array[int],
    is_writing: wp.bool,
    end: wp.array[int],
    # out
    count_out: wp.array[int],
    edge_out: wp.array[int],
    face_out: wp.array[int],
    part_out: wp.array[wp.vec2d],
):
    """Count the faces that touch each wanted edge without having it, or write them and where they do [m].

    `boxes` is a `wp.Bvh` over the boxes of the faces. Writing needs `end`, the inclusive sum of the counts, and does
    not change `count_out`; counting changes nothing else. Launch: dim=W, block_dim=64.
    """
    row = wp.tid()
    edge = wanted[row]
    count = wp.int32(0)
    at = wp.int32(0)
    if is_writing:
        at = end[row] - count_out[row]
    query = wp.bvh_query_aabb(boxes, edges.lower[edge], edges.upper[edge])
    face = wp.int32(0)
    while wp.bvh_query_next(query, face):
        if face != edges.own_0[edge] and face != edges.own_n[edge]:
            part = contact_with(edges, edge, face)
            if part[0] < part[1]:
                if is_writing:
                    edge_out[at + count] = edge
                    face_out[at + count] = face
                    part_out[at + count] = part
                count = count + 1
    if not is_writing:
        count_out[row] = count
