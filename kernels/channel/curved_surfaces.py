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

from mmw.kernels.channel.finite_surfaces import FAR_EDGE, INSET_M, FresnelFrame, coordinates, nearest_share
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
EDGE_WAVE = wp.constant(wp.float64(0.3))
"""Times 1 / d, more than the field at d Fresnel coordinates beyond a straight edge: 1 / (pi sqrt(2) d) of an edge wave,
and a corner of two."""


@wp.struct
class CurvedFacets:
    """Facets of curved surfaces of town and instances, and the outlines of those surfaces, in the carriers' frames."""

    surface: wp.array[int]
    """Surface of each facet, growing, shape [F]."""
    shape: wp.array[int]
    """Shape of each facet, which the instances of a model share, shape [F]."""
    corner: wp.array[wp.vec3d]
    """Corners of the shapes [m], shape [3 S]."""
    normal: wp.array[wp.vec3d]
    """Outward unit normal at each corner, shape [3 S]."""
    curvature: wp.array[wp.mat33d]
    """Curvature at each corner, a symmetric matrix over the plane across its normal [1/m], shape [3 S]."""
    outside: wp.array[wp.vec3d]
    """1 for each corner of a shape beyond an outline, 0 for others, shape [S]."""
    edge: wp.array[int]
    """Edge of the outline that a shape extends, -1 for a facet of the mesh, shape [S]."""
    member: wp.array[wp.vec2i]
    """Begin and end of the facets among which are all of the body of each surface, on its carrier, shape [G]."""
    group: wp.array[int]
    """Curved surface that the geometry row of each surface belongs to, -1 for none, shape [R]."""
    first: wp.array[int]
    """First edge of the outline of each curved surface and then of each piece of one material, and the number of edges,
    shape [Q + M + 1]."""
    begin: wp.array[wp.vec3d]
    """Begin of each edge, counter-clockwise seen from outside [m], shape [E]."""
    end: wp.array[wp.vec3d]
    """End of each edge [m], shape [E]."""
    facing: wp.array[wp.vec3d]
    """Outward unit normal of the facet at each edge, shape [E]."""
    begin_normal: wp.array[wp.vec3d]
    """Outward unit normal of the curved surface at the begin of each edge, shape [E]."""
    end_normal: wp.array[wp.vec3d]
    """The same at the end, shape [E]."""
    weakest: wp.float64
    """Reflections beyond an outline with a smaller share of the field of a flat mirror are left out."""


@wp.struct
class CurvedPoint:
    """Point of reflection on a facet, in the frame of what carries it."""

    is_found: wp.bool
    point: wp.vec3d
    normal: wp.vec3d
    along: wp.vec3d
    """Unit vector along the first edge of the facet."""
    shape: int
    share: wp.vec3d
    """Barycentric coordinates of the point."""
    touched: wp.vec3d
    """Point of the surface that a path touches: the same, or next to it on the outline if that is beyond."""
    touched_normal: wp.vec3d
    most: wp.float64
    """About the largest share of the field of a flat mirror that the surface reflects there."""
    jacobian: wp.float64
    """Determinant of H by the normals of the facet [1/m^2]; of two points that meet and end, one's is negative."""


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
def point_on_shape(facets: CurvedFacets, shape: int, tx: wp.vec3d, rx: wp.vec3d) -> CurvedPoint:
    """Return the point of a shape that reflects from `tx` to `rx`, in the carrier's frame."""
    out = CurvedPoint()
    corner = 3 * shape
    a = facets.corner[corner]
    ab = facets.corner[corner + 1] - a
    ac = facets.corner[corner + 2] - a
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
    det = wp.float64(0.0)
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
    tilt = wp.dot(n, up)
    n = wp.normalize(n)
    if not wp.min(wp.dot(n, tx - p), wp.dot(n, rx - p)) > wp.float64(0.0):
        return out
    is_face = facets.edge[shape] < 0
    bulge = HALF * (
        share_a * off_plane(p, a, na) + share_b * off_plane(p, a + ab, nb) + share_c * off_plane(p, a + ac, nc)
    )
    if is_face and wp.dot(bulge, up) > wp.float64(0.0):  # a hollow stays behind its facet, which would hide it
        p = p + bulge
    out.is_found = True
    out.point = p
    out.normal = n
    out.along = e1
    out.shape = shape
    out.share = wp.vec3d(share_a, share_b, share_c)
    out.touched = p
    out.touched_normal = n
    out.jacobian = det / (tilt * tilt)  # over the plane of the facet, and times the square of the mean normal's length
    return out


@wp.func
def carried(tangent: wp.vec3d, normal: wp.vec3d, other: wp.vec3d) -> wp.vec3d:
    """Return a tangent, turned with its normal to another normal the shortest way."""
    return tangent - (wp.dot(other, tangent) / (wp.float64(1.0) + wp.dot(normal, other))) * (normal + other)


@wp.func
def curvature_along(facets: CurvedFacets, found: CurvedPoint, one: wp.vec3d, two: wp.vec3d) -> wp.vec3d:
    """Return the curvature 11, 12, 22 along two unit vectors across the normal at a point of reflection [1/m]."""
    k11 = wp.float64(0.0)
    k12 = wp.float64(0.0)
    k22 = wp.float64(0.0)
    for k in range(3):
        corner = 3 * found.shape + k
        curvature = facets.curvature[corner]
        t1 = carried(one, found.normal, facets.normal[corner])
        t2 = carried(two, found.normal, facets.normal[corner])
        k11 = k11 + found.share[k] * wp.dot(t1, curvature * t1)
        k12 = k12 + found.share[k] * wp.dot(t1, curvature * t2)
        k22 = k22 + found.share[k] * wp.dot(t2, curvature * t2)
    return wp.vec3d(k11, k12, k22)


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
    bent = curvature_along(facets, found, t1, t2)
    bend = wp.float64(1.0) / before + wp.float64(1.0) / behind
    h11 = bend * (wp.float64(1.0) - a1 * a1) + wp.float64(2.0) * cosine * bent[0]
    h12 = -bend * a1 * a2 + wp.float64(2.0) * cosine * bent[1]
    h22 = bend * (wp.float64(1.0) - a2 * a2) + wp.float64(2.0) * cosine * bent[2]
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
def divergence(
    found: CurvedPoint, frame: FresnelFrame, tx: wp.vec3d, rx: wp.vec3d, wavelength: wp.float64
) -> wp.float64:
    """Return the share of a flat mirror's field that an endless curved surface reflects."""
    before = wp.length(tx - found.point)
    behind = wp.length(rx - found.point)
    cosine = wp.abs(wp.dot(found.normal, tx - found.point)) / before
    mirror = wp.float64(2.0) * cosine * (wp.float64(1.0) / before + wp.float64(1.0) / behind) / wavelength
    return mirror / wp.length(wp.cross(frame.u, frame.v))


@wp.func
def point_at_edge(facets: CurvedFacets, edge: int, at: wp.float64) -> wp.vec3d:
    """Return a point of the curved surface at an edge of its outline, `at` of the way along it."""
    begin = facets.begin[edge]
    end = facets.end[edge]
    point = begin + at * (end - begin)
    one = off_plane(point, begin, facets.begin_normal[edge])
    two = off_plane(point, end, facets.end_normal[edge])
    bulge = HALF * ((wp.float64(1.0) - at) * one + at * two)
    if wp.dot(bulge, facets.facing[edge]) > wp.float64(0.0):
        point = point + bulge
    return point


@wp.func
def curved_point(facets: CurvedFacets, shape: int, tx: wp.vec3d, rx: wp.vec3d, longest_m: wp.float64) -> CurvedPoint:
    """Return the point of a facet that reflects from `tx` to `rx`, and where the path touches, in the carrier's frame.

    A point beyond the outline counts within `FAR_EDGE` Fresnel coordinates at the longest wavelength, and where the
    surface reflects `facets.weakest` of the field of a flat mirror or more. It is touched at the edge that it lies
    beyond.
    """
    out = point_on_shape(facets, shape, tx, rx)
    if not out.is_found:
        return out
    frame = curved_frame(facets, out, tx, rx, longest_m)
    out.most = divergence(out, frame, tx, rx, longest_m)
    edge = facets.edge[shape]
    if edge < 0:
        return out
    begin = facets.begin[edge]
    end = facets.end[edge]
    p = coordinates(frame, begin)
    q = coordinates(frame, end)
    share = nearest_share(p, q)
    distance = wp.length(p + share * (q - p))
    out.most = out.most * wp.min(HALF, EDGE_WAVE / wp.max(distance, wp.float64(1e-9)))
    is_near = distance < FAR_EDGE and out.most >= facets.weakest
    length = wp.length(end - begin)
    inset = wp.min(INSET_M, wp.float64(0.25) * length)
    at = wp.clamp(share, inset / length, wp.float64(1.0) - inset / length)
    along = (end - begin) / length
    point = point_at_edge(facets, edge, at)
    out.touched = point + inset * wp.cross(facets.facing[edge], along)
    out.touched_normal = wp.normalize((wp.float64(1.0) - at) * facets.begin_normal[edge] + at * facets.end_normal[edge])
    is_front = wp.min(wp.dot(out.touched_normal, tx - point), wp.dot(out.touched_normal, rx - point)) > wp.float64(0.0)
    out.is_found = is_near and is_front
    return out
