"""Reflect at curved surfaces that meshes show as facets: the point by interpolated normals, the field by curvature.

The normal N of a facet is interpolated linearly between those of its corners, so that it turns without a step from one
facet to the next; the point of reflection is where the bisector h of the directions to both ends is along N,

    h x N = 0,    h = (tx - p) / |tx - p| + (rx - p) / |rx - p|.

The curvature K, too, is interpolated between the corners, where it is the mean of the facets that meet there: the level
has no step from one facet to the next, and the whole bend is that of the mesh. With it the second derivative of the
length of the path over the tangent plane is

    H = (1/s' + 1/s) (I - a a^T) + 2 cos(theta) K,

where a is the direction of incidence along that plane, and the first term, H0, is that of a flat mirror. The field is
that of the mirror times D = sqrt(det H0 / det H), the divergence of geometrical optics, and times the Kirchhoff
integral over the surface in coordinates in which its phase is pi/2 (u^2 + v^2).

Source: B. T. Phong, Illumination for computer generated pictures, CACM 18 (1975) (interpolated normals); T. Boubekeur
and M. Alexa, Phong tessellation, ACM TOG 27 (2008) (a surface that follows them); R. G. Kouyoumjian and P. H. Pathak,
Proc. IEEE 62 (1974), equations 6 to 14 (divergence at a curved surface); S. Rusinkiewicz, Estimating curvatures
and their derivatives on triangle meshes, 3DPVT 2004 (curvature of facets, and its mean at corners).
"""

import warp as wp

from mmw.kernels.channel.edge_integral import HALF_PI, edge_part
from mmw.kernels.channel.finite_surfaces import (
    FAR_EDGE,
    NEAR_EDGE,
    ON_EDGE,
    TWO_PI_64,
    FresnelFrame,
    Outlines,
    coordinates,
    nearest_share,
)
from mmw.kernels.channel.selected_pairs import select_pair
from mmw.kernels.channel.surfaces import LinkEnds, Surfaces, to_carrier
from mmw.kernels.core.compiler import DOUBLE_PRECISION
from mmw.kernels.core.geometry import is_inside, reflection_point

wp.set_module_options(DOUBLE_PRECISION)

NEWTON_STEPS = wp.constant(12)
"""Steps of Newton's method that look for a point of reflection; most need three."""
FACET_SLACK = wp.constant(wp.float64(1e-9))
"""A point this far outside a facet is on it, in shares of the facet: no gap opens between neighbors."""
CONE_SLACK = wp.constant(wp.float64(0.02))
"""Angle that is added to the cone of a facet's normals in a first test [rad]."""
HALF = wp.constant(wp.float64(0.5))
"""Share of the way to the planes of a facet's corners at which the surface lies: exact for a circle to second order."""
TURNED_AWAY = wp.constant(wp.float64(0.2))
"""Edges at facets whose normals have a smaller cosine with that at the point of reflection are behind the surface."""
FACING = wp.constant(wp.float64(0.6))
"""From this cosine on an edge counts in full. Design values, like the one before."""


@wp.struct
class CurvedFacets:
    """Facets of curved surfaces of town and instances, and the outlines of those surfaces, in the carriers' frames."""

    surface: wp.array[int]
    """Surface of each facet, growing, shape [F]."""
    corner: wp.array[int]
    """First corner of each facet among those of `Surfaces`, shape [F]."""
    normal: wp.array[wp.vec3d]
    """Outward unit normal at each corner of `Surfaces`, 0 where it is not on a curved surface, shape [3 T]."""
    curvature: wp.array[wp.mat33d]
    """Curvature at each corner, a symmetric matrix over the plane across its normal [1/m], shape [3 T]."""
    group: wp.array[int]
    """Curved surface that the geometry row of each surface belongs to, -1 for none, shape [R]."""
    first: wp.array[int]
    """First edge of the outline of each curved surface, and the number of edges, shape [Q + 1]."""
    begin: wp.array[wp.vec3d]
    """Begin of each edge, counter-clockwise seen from outside [m], shape [E]."""
    end: wp.array[wp.vec3d]
    """End of each edge [m], shape [E]."""
    facing: wp.array[wp.vec3d]
    """Outward unit normal of the facet at each edge, shape [E]."""


@wp.struct
class CurvedPoint:
    """Point of reflection on a facet, in the frame of what carries it."""

    is_found: wp.bool
    point: wp.vec3d
    normal: wp.vec3d
    along: wp.vec3d
    """Unit vector along the first edge of the facet."""
    corner: int
    """First corner of the facet."""
    share: wp.vec3d
    """Barycentric coordinates of the point."""


@wp.func
def off_plane(point: wp.vec3d, corner: wp.vec3d, normal: wp.vec3d) -> wp.vec3d:
    """Return the way from a point to the plane of a corner."""
    return -wp.dot(point - corner, normal) * normal


@wp.func
def nearest_on_edge(point: wp.vec3d, begin: wp.vec3d, end: wp.vec3d) -> wp.vec3d:
    """Return the point of an edge that is nearest to a point."""
    along = end - begin
    share = wp.dot(point - begin, along) / wp.dot(along, along)
    return begin + wp.clamp(share, wp.float64(0.0), wp.float64(1.0)) * along


@wp.func
def nearest_on_facet(point: wp.vec3d, a: wp.vec3d, b: wp.vec3d, c: wp.vec3d) -> wp.vec3d:
    """Return the point of a facet that is nearest to a point in its plane."""
    if is_inside(point, a, b, c, wp.float64(0.0)):
        return point
    nearest = nearest_on_edge(point, a, b)
    other = nearest_on_edge(point, b, c)
    if wp.length(point - other) < wp.length(point - nearest):
        nearest = other
    other = nearest_on_edge(point, c, a)
    if wp.length(point - other) < wp.length(point - nearest):
        nearest = other
    return nearest


@wp.func
def curved_point(
    surfaces: Surfaces, facets: CurvedFacets, corner: int, tx: wp.vec3d, rx: wp.vec3d
) -> CurvedPoint:  # fmt: skip
    """Return the point of a facet, by its first corner, that reflects from `tx` to `rx`, in the carrier's frame."""
    out = CurvedPoint()
    a = surfaces.corner[corner]
    ab = surfaces.corner[corner + 1] - a
    ac = surfaces.corner[corner + 2] - a
    na = facets.normal[corner]
    nb = facets.normal[corner + 1]
    nc = facets.normal[corner + 2]
    middle = a + (ab + ac) / wp.float64(3.0)
    to_tx = tx - middle
    to_rx = rx - middle
    tx_away = wp.length(to_tx)
    rx_away = wp.length(to_rx)
    mean = wp.normalize(na + nb + nc)
    bisector = to_tx / tx_away + to_rx / rx_away
    size = wp.length(bisector)
    cosine = wp.dot(bisector, mean)
    # the turn of the bisector over the facet, from both ends, is below its size over their distances
    reach = wp.max(wp.length(ab), wp.length(ac)) * (wp.float64(1.0) / tx_away + wp.float64(1.0) / rx_away)
    spread = wp.acos(wp.min(wp.min(wp.dot(mean, na), wp.min(wp.dot(mean, nb), wp.dot(mean, nc))), wp.float64(1.0)))
    angle = wp.acos(wp.clamp(cosine / wp.max(size, wp.float64(1e-12)), wp.float64(-1.0), wp.float64(1.0)))
    if not angle <= spread + reach / wp.max(size, wp.float64(1e-12)) + CONE_SLACK:  # nor for NaN, an absent instance
        return out
    bx = wp.length(ab)
    e1 = ab / bx
    up = wp.normalize(wp.cross(ab, ac))
    if wp.dot(up, mean) < wp.float64(0.0):
        up = -up
    e2 = wp.cross(up, e1)
    cx = wp.dot(ac, e1)
    cy = wp.dot(ac, e2)
    dx = (nb - na) / bx
    dy = (nc - na) / cy - (cx / (cy * bx)) * (nb - na)
    if wp.dot(up, to_tx) > wp.float64(0.0) and wp.dot(up, to_rx) > wp.float64(0.0):  # near what the plane reflects
        middle = nearest_on_facet(reflection_point(tx, rx, up, wp.dot(up, a)), a, a + ab, a + ac)
    x = wp.dot(middle - a, e1)
    y = wp.dot(middle - a, e2)
    limit = wp.float64(4.0) * (bx + wp.abs(cx) + wp.abs(cy))
    step = wp.int32(0)
    moved = wp.float64(1.0)
    share_b = wp.float64(-1.0)
    share_c = wp.float64(-1.0)
    ut = wp.vec3d()
    ur = wp.vec3d()
    n = wp.vec3d()
    while step < NEWTON_STEPS and moved > wp.float64(1e-13) and wp.abs(x) + wp.abs(y) < limit:
        p = a + x * e1 + y * e2
        share_c = y / cy
        share_b = (x - cx * share_c) / bx
        n = na + share_b * (nb - na) + share_c * (nc - na)
        s1 = wp.length(tx - p)
        s2 = wp.length(rx - p)
        ut = (tx - p) / s1
        ur = (rx - p) / s2
        h = ut + ur
        h1 = wp.dot(h, e1)
        h2 = wp.dot(h, e2)
        h3 = wp.dot(h, up)
        n1 = wp.dot(n, e1)
        n2 = wp.dot(n, e2)
        n3 = wp.dot(n, up)
        hx = -((e1 - wp.dot(ut, e1) * ut) / s1 + (e1 - wp.dot(ur, e1) * ur) / s2)
        hy = -((e2 - wp.dot(ut, e2) * ut) / s1 + (e2 - wp.dot(ur, e2) * ur) / s2)
        g1 = h1 * n3 - h3 * n1
        g2 = h2 * n3 - h3 * n2
        g1x = wp.dot(hx, e1) * n3 + h1 * wp.dot(dx, up) - wp.dot(hx, up) * n1 - h3 * wp.dot(dx, e1)
        g1y = wp.dot(hy, e1) * n3 + h1 * wp.dot(dy, up) - wp.dot(hy, up) * n1 - h3 * wp.dot(dy, e1)
        g2x = wp.dot(hx, e2) * n3 + h2 * wp.dot(dx, up) - wp.dot(hx, up) * n2 - h3 * wp.dot(dx, e2)
        g2y = wp.dot(hy, e2) * n3 + h2 * wp.dot(dy, up) - wp.dot(hy, up) * n2 - h3 * wp.dot(dy, e2)
        det = g1x * g2y - g1y * g2x
        if wp.abs(det) < wp.float64(1e-30):
            return out
        step_x = (g2y * g1 - g1y * g2) / det
        step_y = (g1x * g2 - g2x * g1) / det
        x = x - step_x
        y = y - step_y
        moved = (wp.abs(step_x) + wp.abs(step_y)) / (bx + wp.abs(cy))
        step = step + 1
    share_c = y / cy
    share_b = (x - cx * share_c) / bx
    share_a = wp.float64(1.0) - share_b - share_c
    if not (moved <= wp.float64(1e-9) and wp.min(share_a, wp.min(share_b, share_c)) >= -FACET_SLACK):  # nor for NaN
        return out
    p = a + x * e1 + y * e2
    n = na + share_b * (nb - na) + share_c * (nc - na)
    n = wp.normalize(n)
    if not wp.min(wp.dot(n, tx - p), wp.dot(n, rx - p)) > wp.float64(0.0):
        return out
    bulge = HALF * (
        share_a * off_plane(p, a, na) + share_b * off_plane(p, a + ab, nb) + share_c * off_plane(p, a + ac, nc)
    )
    if wp.dot(bulge, up) > wp.float64(0.0):  # a hollow stays behind its facet, which would hide it
        p = p + bulge
    out.is_found = True
    out.point = p
    out.normal = n
    out.along = e1
    out.corner = corner
    out.share = wp.vec3d(share_a, share_b, share_c)
    return out


@wp.kernel
def cull_curved_kernel(
    ends: LinkEnds,
    surfaces: Surfaces,
    facets: CurvedFacets,
    first_link: int,
    # out
    count_out: wp.array[int],
    pair_out: wp.array2d[int],
):
    """Select the (link, facet) pairs with a point of reflection. Launch: dim=(L, F)."""
    row, facet = wp.tid()
    link = first_link + row
    carrier = surfaces.carrier[facets.surface[facet]]
    found = curved_point(surfaces, facets, facets.corner[facet], ends.tx[link, carrier], ends.rx[link, carrier])
    if found.is_found:
        select_pair(row, facet, count_out, pair_out)


@wp.kernel
def curved_points_kernel(
    ends: LinkEnds,
    surfaces: Surfaces,
    facets: CurvedFacets,
    pose: wp.array2d[wp.transformd],
    link: wp.array[int],
    facet: wp.array[int],
    # out
    point_out: wp.array2d[wp.vec3d],
    normal_out: wp.array2d[wp.vec3d],
):
    """Write point and normal of each reflection in the world frame [m], in column 0. Launch: dim=C."""
    row = wp.tid()
    own = link[row]
    carrier = surfaces.carrier[facets.surface[facet[row]]]
    found = curved_point(surfaces, facets, facets.corner[facet[row]], ends.tx[own, carrier], ends.rx[own, carrier])
    point = found.point
    normal = found.normal
    if carrier < pose.shape[1]:
        point = wp.transform_point(pose[ends.batch_index[own], carrier], point)
        normal = wp.transform_vector(pose[ends.batch_index[own], carrier], normal)
    point_out[row, 0] = point
    normal_out[row, 0] = normal


@wp.func
def carried(tangent: wp.vec3d, normal: wp.vec3d, other: wp.vec3d) -> wp.vec3d:
    """Return a tangent, turned with its normal to another normal the shortest way."""
    return tangent - (wp.dot(other, tangent) / (wp.float64(1.0) + wp.dot(normal, other))) * (normal + other)


@wp.func
def curved_frame(
    facets: CurvedFacets, found: CurvedPoint, tx: wp.vec3d, rx: wp.vec3d, wavelength: wp.float64
) -> FresnelFrame:
    """Return the coordinates in which the phase over a curved surface is pi/2 (u^2 + v^2), to second order."""
    n = found.normal
    t1 = wp.normalize(found.along - wp.dot(found.along, n) * n)
    t2 = wp.cross(n, t1)
    before = wp.length(tx - found.point)
    behind = wp.length(rx - found.point)
    incoming = (found.point - tx) / before
    cosine = wp.abs(wp.dot(incoming, n))
    a1 = wp.dot(incoming, t1)
    a2 = wp.dot(incoming, t2)
    k11 = wp.float64(0.0)
    k12 = wp.float64(0.0)
    k22 = wp.float64(0.0)
    for k in range(3):
        curvature = facets.curvature[found.corner + k]
        one = carried(t1, n, facets.normal[found.corner + k])
        two = carried(t2, n, facets.normal[found.corner + k])
        k11 = k11 + found.share[k] * wp.dot(one, curvature * one)
        k12 = k12 + found.share[k] * wp.dot(one, curvature * two)
        k22 = k22 + found.share[k] * wp.dot(two, curvature * two)
    bend = wp.float64(1.0) / before + wp.float64(1.0) / behind
    h11 = bend * (wp.float64(1.0) - a1 * a1) + wp.float64(2.0) * cosine * k11
    h12 = -bend * a1 * a2 + wp.float64(2.0) * cosine * k12
    h22 = bend * (wp.float64(1.0) - a2 * a2) + wp.float64(2.0) * cosine * k22
    l11 = wp.sqrt(h11)
    l21 = h12 / l11
    l22 = wp.sqrt(wp.max(h22 - l21 * l21, wp.float64(1e-300)))
    scale = wp.sqrt(wp.float64(2.0) / wavelength)
    frame = FresnelFrame()
    frame.point = found.point
    frame.u = scale * (l11 * t1 + l21 * t2)
    frame.v = scale * l22 * t2
    return frame


@wp.func
def smooth_step(value: wp.float64, low: wp.float64, high: wp.float64) -> wp.float64:
    """Return 0 below `low`, 1 above `high`, and smoothly in between."""
    t = wp.clamp((value - low) / (high - low), wp.float64(0.0), wp.float64(1.0))
    return t * t * (wp.float64(3.0) - wp.float64(2.0) * t)


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
    # out
    share_out: wp.array2d[wp.vec2d],
):
    """Compute the share of a flat mirror's field that each curved reflection has at each carrier: D and the integral.

    `facet` is the first one of the reflecting surface; `tx` and `rx` are the points before and behind it in the world
    frame. Launch: dim=(Q, C).
    """
    hit, column = wp.tid()
    surface = facets.surface[facet[hit]]
    carrier = surfaces.carrier[surface]
    from_tx = to_carrier(tx[hit], pose, batch_index[hit], carrier)
    to_rx = to_carrier(rx[hit], pose, batch_index[hit], carrier)
    found = CurvedPoint()
    index = facet[hit]
    while index < facets.surface.shape[0] and not found.is_found:
        if facets.surface[index] != surface:
            index = facets.surface.shape[0]
        else:
            found = curved_point(surfaces, facets, facets.corner[index], from_tx, to_rx)
            index = index + 1
    share_out[hit, column] = wp.vec2d()
    if not found.is_found:
        return
    frame = curved_frame(facets, found, from_tx, to_rx, wavelength[column])
    before = wp.length(from_tx - found.point)
    behind = wp.length(to_rx - found.point)
    cosine = wp.abs(wp.dot(found.normal, from_tx - found.point)) / before
    mirror = wp.float64(2.0) * cosine * (wp.float64(1.0) / before + wp.float64(1.0) / behind) / wavelength[column]
    divergence = mirror / wp.length(wp.cross(frame.u, frame.v))
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
    share_out[hit, column] = divergence * total
