"""Average the curvature of a mesh around its vertices, in float64."""

import warp as wp

from mmw.kernels.core.compiler import DOUBLE_PRECISION

wp.set_module_options(DOUBLE_PRECISION)

SAME_SIDE = wp.constant(wp.float64(0.5))
"""Vertices whose normals have a smaller cosine are on different sides of a body."""


@wp.func
def turned(matrix: wp.mat33d, normal: wp.vec3d, other: wp.vec3d) -> wp.mat33d:
    """Return a matrix over the plane across a unit normal, turned with it to another one the shortest way."""
    middle = normal + other
    one = wp.float64(1.0)
    turn = wp.identity(n=3, dtype=wp.float64) - wp.outer(middle, middle) / (one + wp.dot(normal, other))
    turn = turn + wp.float64(2.0) * wp.outer(other, normal)
    return turn * matrix * wp.transpose(turn)


@wp.kernel
def smooth_curvature_kernel(
    grid: wp.uint64,
    point: wp.array[wp.vec3],
    normal: wp.array[wp.vec3d],
    group: wp.array[int],
    area: wp.array[wp.float64],
    total: wp.array[wp.mat33d],
    radius: float,
    # out
    mean_out: wp.array[wp.mat33d],
):
    """Write the mean of `total` / `area` over the vertices of one group within `radius` [m], weighted by `area` and by
    (1 - d^2 / radius^2)^2 of their distance d. Launch: dim=V.
    """
    vertex = wp.tid()
    sums = wp.mat33d()
    weights = wp.float64(0.0)
    query = wp.hash_grid_query(grid, point[vertex], radius)
    other = wp.int32(0)
    while wp.hash_grid_query_next(query, other):
        distance = wp.length(point[other] - point[vertex]) / radius
        is_near = distance < 1.0 and group[other] == group[vertex]
        if is_near and wp.dot(normal[other], normal[vertex]) > SAME_SIDE:
            closeness = wp.float64(1.0 - distance * distance)
            weight = closeness * closeness
            weights = weights + weight * area[other]
            sums = sums + weight * turned(total[other], normal[other], normal[vertex])
    mean_out[vertex] = sums / wp.max(weights, wp.float64(1e-300))
