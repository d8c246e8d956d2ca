"""Weigh the reflection at a curved surface: its divergence and the Kirchhoff integral over its outline, in float64.

See `curved_surfaces` for the coordinates, and `finite_surfaces` for the integral. Beyond the outline the integral lacks
the 1 of the point itself.
"""

import warp as wp

from mmw.kernels.channel.curved_surfaces import (
    HALF,
    CurvedFacets,
    CurvedPoint,
    curvature_along,
    curved_frame,
    curved_point,
    divergence,
)
from mmw.kernels.channel.edge_integral import HALF_PI, edge_part, times, turn
from mmw.kernels.channel.finite_surfaces import (
    FAR_EDGE,
    NEAR_EDGE,
    ON_EDGE,
    TWO_PI_64,
    Outlines,
    coordinates,
    nearest_share,
    smooth_step,
)
from mmw.kernels.channel.surfaces import Surfaces, to_carrier
from mmw.kernels.core.compiler import DOUBLE_PRECISION

wp.set_module_options(DOUBLE_PRECISION)

TURNED_AWAY = wp.constant(wp.float64(0.2))
"""Edges at facets whose normals have a smaller cosine with that at the point of reflection are behind the surface."""
FACING = wp.constant(wp.float64(0.6))
"""From this cosine on an edge counts in full. Design values, like the one before."""


@wp.kernel
def curved_share_kernel(
    surfaces: Surfaces,
    facets: CurvedFacets,
    outlines: Outlines,
    pose: wp.array2d[wp.transformd],
    wavelength: wp.array[wp.float64],
    batch_index: wp.array[int],
    facet: wp.array[int],
    tx: wp.array[wp.vec3d],
    rx: wp.array[wp.vec3d],
    vertex: wp.array[wp.vec3d],
    # out
    share_out: wp.array2d[wp.vec2d],
    curvature_out: wp.array[wp.mat33d],
):
    """Compute the share of a flat mirror's field that each curved reflection has at each carrier: D and the integral.
    The curvature of the surface is in the world frame [1/m].

    `facet` is the first one of the reflecting surface; `tx` and `rx` are the points before and behind it in the world
    frame, `vertex` is where the path touches it. Phases are relative to the path over `vertex`. Launch: dim=(Q, C).
    """
    hit, column = wp.tid()
    surface = facets.surface[facet[hit]]
    carrier = surfaces.carrier[surface]
    from_tx = to_carrier(tx[hit], pose, batch_index[hit], carrier)
    to_rx = to_carrier(rx[hit], pose, batch_index[hit], carrier)
    touched = to_carrier(vertex[hit], pose, batch_index[hit], carrier)
    found = CurvedPoint()
    index = facet[hit]
    while index < facets.surface.shape[0]:
        if facets.surface[index] != surface:
            index = facets.surface.shape[0]
        else:
            other = curved_point(facets, facets.shape[index], from_tx, to_rx, outlines.longest_m)
            is_nearer = wp.length(other.touched - touched) < wp.length(found.touched - touched)
            if other.is_found and (is_nearer or not found.is_found):
                found = other
            index = index + 1
    share_out[hit, column] = wp.vec2d()
    if not found.is_found:
        return
    if column == 0:
        n = found.normal
        t1 = wp.normalize(found.along - wp.dot(found.along, n) * n)
        t2 = wp.cross(n, t1)
        bent = curvature_along(facets, found, t1, t2)
        if carrier < pose.shape[1]:
            t1 = wp.transform_vector(pose[batch_index[hit], carrier], t1)
            t2 = wp.transform_vector(pose[batch_index[hit], carrier], t2)
        mixed = bent[1] * (wp.outer(t1, t2) + wp.outer(t2, t1))
        curvature_out[hit] = bent[0] * wp.outer(t1, t1) + mixed + bent[2] * wp.outer(t2, t2)
    frame = curved_frame(facets, found, from_tx, to_rx, wavelength[column])
    total = wp.vec2d()
    if facets.edge[found.shape] < 0:
        total = wp.vec2d(wp.float64(1.0), wp.float64(0.0))
    group = facets.group[surfaces.row[surface]]
    for edge in range(facets.first[group], facets.first[group + 1]):
        facing = smooth_step(wp.dot(facets.facing[edge], found.normal), TURNED_AWAY, FACING)
        if facing > wp.float64(0.0):
            p = coordinates(frame, facets.begin[edge])
            q = coordinates(frame, facets.end[edge])
            along = q - p
            length = wp.length(along)
            nearest = wp.length(p + nearest_share(p, q) * along)
            weight = facing * (wp.float64(1.0) - smooth_step(nearest, NEAR_EDGE, FAR_EDGE))
            cross = p[0] * q[1] - p[1] * q[0]
            if weight > wp.float64(0.0) and length > wp.float64(0.0):
                distance = wp.max(wp.abs(cross) / length, ON_EDGE)
                beta = HALF_PI * distance * distance
                x1 = wp.dot(p, along) / (length * distance)
                x2 = wp.dot(q, along) / (length * distance)
                wave = edge_part(outlines.rule, beta, x2) - edge_part(outlines.rule, beta, x1)
                total = total - (weight * wp.sign(cross) / TWO_PI_64) * wave
    total = divergence(found, frame, from_tx, to_rx, wavelength[column]) * total
    if facets.edge[found.shape] >= 0:
        beside = coordinates(frame, found.touched)
        total = times(total, turn(-HALF_PI * wp.dot(beside, beside)))
        outside = wp.dot(found.share, facets.outside[found.shape])
        total = (wp.float64(1.0) - smooth_step(outside, HALF, wp.float64(1.0))) * total
    share_out[hit, column] = total
