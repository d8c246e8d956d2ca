"""Find edges that run side by side."""

import warp as wp

from mmw.kernels.core.compiler import DOUBLE_PRECISION

wp.set_module_options(DOUBLE_PRECISION)


@wp.struct
class Edges:
    """Edges with boxes around them."""

    lower: wp.array[wp.vec3]
    """Low corner of each edge's box, widened by half the distance that counts, shape [E]."""
    upper: wp.array[wp.vec3]
    """High corner, shape [E]."""
    begin: wp.array[wp.vec3d]
    """One end of each edge [m], shape [E]."""
    span: wp.array[wp.vec3d]
    """From there to the other end [m], shape [E]."""
    body: wp.array[int]
    """Body of each; edges of different bodies do not count, shape [E]."""


@wp.func
def squared_distance(between: wp.vec3d, one: wp.vec3d, other: wp.vec3d) -> wp.float64:
    """Return the squared distance between two segments [m^2].

    Source: closest points of two segments, C. Ericson, Real-Time Collision Detection, section 5.1.9.

    Args:
        between: From the begin of the other segment to that of the first [m].
        one: From begin to end of the first, not 0 [m].
        other: From begin to end of the other, not 0 [m].
    """
    zero, unit = wp.float64(0.0), wp.float64(1.0)
    a = wp.dot(one, one)
    e = wp.dot(other, other)
    b = wp.dot(one, other)
    c = wp.dot(one, between)
    f = wp.dot(other, between)
    denominator = a * e - b * b
    s = zero
    if denominator > wp.float64(1e-12) * a * e:
        s = wp.clamp((b * f - c * e) / denominator, zero, unit)
    t = (b * s + f) / e
    if t < zero or t > unit:
        t = wp.clamp(t, zero, unit)
        s = wp.clamp((b * t - c) / a, zero, unit)
    return wp.length_sq(between + s * one - t * other)


@wp.kernel
def side_by_side_kernel(
    tree: wp.uint64,
    edges: Edges,
    distance: wp.float64,
    min_cos: wp.float64,
    is_writing: bool,
    start: wp.array[int],
    # out
    count_out: wp.array[int],
    other_out: wp.array[int],
):
    """Find the later edges of its body that run beside each edge: near it and nearly parallel.

    Launch: dim=edges, first to count, then to write them to `other_out` from `start` on.
    """
    edge = wp.tid()
    span = edges.span[edge]
    length = wp.length(span)
    found = wp.int32(0)
    at = wp.int32(0)
    if is_writing:
        at = start[edge]
    query = wp.bvh_query_aabb(tree, edges.lower[edge], edges.upper[edge])
    index = wp.int32(0)
    while wp.bvh_query_next(query, index):
        side = edges.span[index]
        is_parallel = wp.abs(wp.dot(span, side)) >= min_cos * length * wp.length(side)
        if index > edge and edges.body[index] == edges.body[edge] and is_parallel:
            between = edges.begin[edge] - edges.begin[index]
            if squared_distance(between, span, side) <= distance * distance:
                if is_writing:
                    other_out[at + found] = index
                found = found + 1
    if not is_writing:
        count_out[edge] = found
