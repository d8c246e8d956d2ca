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
    point_at_edge,
)
from mmw.kernels.channel.edge_integral import HALF_PI, edge_part, times, turn
from mmw.kernels.channel.finite_surfaces import (
    FAR_EDGE,
    NEAR_EDGE,
    ON_EDGE,
    TWO_PI_64,
    FresnelFrame,
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
SAME_TOUCH_M = wp.constant(wp.float64(1e-6))
"""Points of reflection, and those at which paths touch a surface, are the same if they are closer than this [m]."""
NEAR_SURFACE = wp.constant(wp.float64(0.15))
"""An edge counts in full up to this height over the surface that normal and curvature at the point of reflection
describe, in shares of its distance from that point: it goes on as that surface does."""
OFF_SURFACE = wp.constant(wp.float64(0.4))
"""From this height on it belongs to other parts of the body, in front of the surface or behind it. Design values."""
ROUGHNESS_M = wp.constant(wp.float64(2e-3))
"""Heights that meshes are wrong by [m], and are always added to those."""
ONE_BODY_M = wp.constant(wp.float64(0.25))
"""Points of reflection closer than this are one in full [m]: a few facets."""
TWO_BODIES_M = wp.constant(wp.float64(0.5))
"""Points of reflection farther apart than this have nothing to do with each other [m]. Design values."""


@wp.func
def on_surface(
    found: CurvedPoint,
    frame: FresnelFrame,
    point: wp.vec3d,
    tx: wp.vec3d,
    rx: wp.vec3d,
    wavelength: wp.float64,
) -> wp.float64:
    """Return the share with which a point of a body is on the surface around a point of reflection: without it the
    level would step where an edge passes in front of that point or behind it.
    """
    before = wp.length(tx - found.point)
    behind = wp.length(rx - found.point)
    incoming = (found.point - tx) / before
    offset = point - found.point
    height = wp.dot(found.normal, offset)
    aside = offset - height * found.normal
    a = wp.dot(incoming, aside)
    c = coordinates(frame, point)
    mirror = (wp.float64(1.0) / before + wp.float64(1.0) / behind) * (wp.dot(aside, aside) - a * a)
    bow = wp.float64(0.5) * wavelength * wp.dot(c, c) - mirror  # c holds the whole second derivative H
    height = wp.abs(height + bow / (wp.float64(4.0) * wp.abs(wp.dot(incoming, found.normal))))
    away = wp.length(aside)
    return smooth_step(height, OFF_SURFACE * away + wp.float64(2.0) * ROUGHNESS_M, NEAR_SURFACE * away + ROUGHNESS_M)


@wp.func
def outline_share(
    facets: CurvedFacets,
    outlines: Outlines,
    group: int,
    found: CurvedPoint,
    tx: wp.vec3d,
    rx: wp.vec3d,
    wavelength: wp.float64,
    is_in: wp.bool,
) -> wp.vec2d:
    """Return the share of a flat mirror's field that a curved surface reflects at a point of reflection, with phases
    relative to the path over the point that it touches; of a piece of the surface, that has the point only if `is_in`.
    """
    frame = curved_frame(facets, found, tx, rx, wavelength)
    own = facets.edge[found.shape]
    total = wp.vec2d()
    if own < 0 and is_in:
        total = wp.vec2d(wp.float64(1.0), wp.float64(0.0))
    for edge in range(facets.first[group], facets.first[group + 1]):
        facing = smooth_step(wp.dot(facets.facing[edge], found.normal), TURNED_AWAY, FACING)
        if facing > wp.float64(0.0):
            p = coordinates(frame, facets.begin[edge])
            q = coordinates(frame, facets.end[edge])
            along = q - p
            length = wp.length(along)
            nearest = nearest_share(p, q)
            far = smooth_step(wp.length(p + nearest * along), NEAR_EDGE, FAR_EDGE)
            weight = facing * (wp.float64(1.0) - far)
            if weight > wp.float64(0.0) and edge != own:
                point = facets.begin[edge] + nearest * (facets.end[edge] - facets.begin[edge])
                if own < 0:
                    point = point_at_edge(facets, edge, nearest)
                weight = weight * on_surface(found, frame, point, tx, rx, wavelength)
            if weight > wp.float64(0.0) and length > wp.float64(0.0):
                cross = p[0] * q[1] - p[1] * q[0]
                distance = wp.max(wp.abs(cross) / length, ON_EDGE)
                beta = HALF_PI * distance * distance
                x1 = wp.dot(p, along) / (length * distance)
                x2 = wp.dot(q, along) / (length * distance)
                wave = edge_part(outlines.rule, beta, x2) - edge_part(outlines.rule, beta, x1)
                total = total - (weight * wp.sign(cross) / TWO_PI_64) * wave
    total = divergence(found, frame, tx, rx, wavelength) * total
    if own >= 0:
        beside = coordinates(frame, found.touched)
        total = times(total, turn(-HALF_PI * wp.dot(beside, beside)))
        outside = wp.dot(found.share, facets.outside[found.shape])
        total = (wp.float64(1.0) - smooth_step(outside, HALF, wp.float64(1.0))) * total
    return total


@wp.func
def touching_point(
    surfaces: Surfaces,
    facets: CurvedFacets,
    outlines: Outlines,
    first: int,
    is_facet: wp.bool,
    touched: wp.vec3d,
    tx: wp.vec3d,
    rx: wp.vec3d,
    wavelength: wp.float64,
) -> CurvedPoint:
    """Return the point of reflection whose path touches a surface at `touched`, of several the strongest.

    `first` is the facet that reflects if `is_facet`, or else the first one of its surface.
    """
    surface = facets.surface[first]
    group = facets.group[surfaces.row[surface]]
    own = CurvedPoint()
    nearest = wp.float64(1e300)
    largest = wp.float64(0.0)
    index = first
    while index < facets.surface.shape[0]:
        if facets.surface[index] != surface:
            index = facets.surface.shape[0]
        else:
            found = curved_point(facets, facets.shape[index], tx, rx, outlines.longest_m)
            away = wp.length(found.touched - touched)
            if found.is_found and away < nearest + SAME_TOUCH_M:
                size = wp.length(outline_share(facets, outlines, group, found, tx, rx, wavelength, True))
                if away < nearest - SAME_TOUCH_M or size > largest:
                    largest = size
                    own = found
                nearest = wp.min(nearest, away)
            index = index + 1
            if is_facet:
                index = facets.surface.shape[0]
    return own


@wp.kernel
def curved_share_kernel(
    surfaces: Surfaces,
    facets: CurvedFacets,
    outlines: Outlines,
    pose: wp.array2d[wp.transformd],
    wavelength: wp.array[wp.float64],
    is_facet: wp.bool,
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

    The normals of a mesh waver, so that a surface that should reflect at one point may do so at three. A point comes
    and goes together with one at which the determinant of the normals is negative. So the sum of the amplitudes of
    close points, each with the sign of its determinant, is that of one point and goes on without a step. Beyond an
    outline the strongest of close points stands for all, and on the surface only those beyond its own edges count, not
    those beyond others, across a gap.

    `facet` is the one that reflects, or else the first one of its surface, of whose points that touch at `vertex` the
    strongest counts; `tx` and `rx` are the points before and behind it in the world frame, `vertex` is where the path
    touches it. Phases are relative to the path over `vertex`. Launch: dim=(Q, C).
    """
    hit, column = wp.tid()
    surface = facets.surface[facet[hit]]
    carrier = surfaces.carrier[surface]
    from_tx = to_carrier(tx[hit], pose, batch_index[hit], carrier)
    to_rx = to_carrier(rx[hit], pose, batch_index[hit], carrier)
    touched = to_carrier(vertex[hit], pose, batch_index[hit], carrier)
    group = facets.group[surfaces.row[surface]]
    share = wp.vec2d()
    wave = wavelength[column]
    own = touching_point(surfaces, facets, outlines, facet[hit], is_facet, touched, from_tx, to_rx, wave)
    if own.is_found:
        share = outline_share(facets, outlines, group, own, from_tx, to_rx, wave, True)
    if column == 0 and own.is_found:
        n = own.normal
        t1 = wp.normalize(own.along - wp.dot(own.along, n) * n)
        t2 = wp.cross(n, t1)
        bent = curvature_along(facets, own, t1, t2)
        if carrier < pose.shape[1]:
            t1 = wp.transform_vector(pose[batch_index[hit], carrier], t1)
            t2 = wp.transform_vector(pose[batch_index[hit], carrier], t2)
        mixed = bent[1] * (wp.outer(t1, t2) + wp.outer(t2, t1))
        curvature_out[hit] = bent[0] * wp.outer(t1, t1) + mixed + bent[2] * wp.outer(t2, t2)
    total = wp.length(share)
    if own.is_found and facets.edge[own.shape] < 0:
        total = wp.float64(0.0)
        members = facets.member[surface]
        for index in range(members[0], members[1]):
            shape = facets.shape[index]
            if facets.group[surfaces.row[facets.surface[index]]] == group:
                found = curved_point(facets, shape, from_tx, to_rx, outlines.longest_m)
                away = wp.length(found.point - own.point)
                is_counted = found.is_found and (shape == own.shape or away > SAME_TOUCH_M)  # on a seam it is of both
                edge = facets.edge[shape]
                if edge >= 0:
                    out = wp.cross(facets.end[edge] - facets.begin[edge], facets.facing[edge])
                    is_counted = is_counted and wp.dot(out, own.point - facets.begin[edge]) < wp.float64(0.0)
                if is_counted and away < TWO_BODIES_M:
                    size = wp.length(share)
                    if shape != own.shape:
                        other = outline_share(facets, outlines, group, found, from_tx, to_rx, wave, True)
                        size = wp.length(other)
                    size = size * smooth_step(away, TWO_BODIES_M, ONE_BODY_M)
                    frame = curved_frame(facets, own, from_tx, to_rx, wave)
                    size = size * on_surface(own, frame, found.point, from_tx, to_rx, wave)
                    total = total + size * wp.sign(found.jacobian)
    share_out[hit, column] = wp.max(total, wp.float64(0.0)) * wp.normalize(share)


@wp.kernel
def curved_piece_kernel(
    surfaces: Surfaces,
    facets: CurvedFacets,
    outlines: Outlines,
    pose: wp.array2d[wp.transformd],
    wavelength: wp.array[wp.float64],
    batch_index: wp.array[int],
    facet: wp.array[int],
    piece: wp.array[int],
    is_own: wp.array[wp.bool],
    tx: wp.array[wp.vec3d],
    rx: wp.array[wp.vec3d],
    vertex: wp.array[wp.vec3d],
    # out
    share_out: wp.array2d[wp.vec2d],
):
    """Compute the part of pieces of curved surfaces in reflections, over the field of a flat mirror: the integral over
    the piece alone. Arguments as in `curved_share_kernel`; `piece` is an outline, `is_own` whether the path touches the
    surface inside it. Launch: dim=(Q, C).
    """
    hit, column = wp.tid()
    carrier = surfaces.carrier[facets.surface[facet[hit]]]
    from_tx = to_carrier(tx[hit], pose, batch_index[hit], carrier)
    to_rx = to_carrier(rx[hit], pose, batch_index[hit], carrier)
    touched = to_carrier(vertex[hit], pose, batch_index[hit], carrier)
    wave = wavelength[column]
    own = touching_point(surfaces, facets, outlines, facet[hit], False, touched, from_tx, to_rx, wave)
    share = wp.vec2d()
    if own.is_found:
        share = outline_share(facets, outlines, piece[hit], own, from_tx, to_rx, wave, is_own[hit])
    share_out[hit, column] = share
