"""Weigh the reflection at a finite flat surface: the Kirchhoff integral over its outline, per carrier, in float64.

Around the point where the infinite plane reflects, the phase of the wave is pi/2 (u^2 + v^2), in coordinates u along
the plane of incidence and v across it,

    u = x cos(theta) sqrt(2 / (lambda rho)),    v = y sqrt(2 / (lambda rho)),    rho = s' s / (s' + s),

and the share of the mirror's field that a surface S reflects is F = j/2 times the integral of exp(-j pi/2 (u^2 + v^2))
over S. By Stokes' theorem it is an integral along the outline,

    F = [the point is in S] - 1/(2 pi) times the integral of exp(-j pi/2 r^2) d(phi),

whose parts are those of straight edges: an edge at distance d, from x1 d to x2 d along its line, gives G(x2) - G(x1) of
`edge_integral` with beta = pi d^2 / 2.

Source: J. W. Goodman, Introduction to Fourier Optics, section 4.2 (Fresnel coordinates); A. Rubinowicz, The Miyamoto-
Wolf diffraction wave, Progress in Optics 4 (1965) (integral along the edge).
"""

import warp as wp

from mmw.kernels.channel.edge_integral import HALF_PI, Quadrature, edge_part, times, turn
from mmw.kernels.channel.selected_pairs import select_pair
from mmw.kernels.channel.surfaces import EDGE_MARGIN, LinkEnds, Plane, Surfaces, from_carrier, to_carrier
from mmw.kernels.core.compiler import DOUBLE_PRECISION
from mmw.kernels.core.geometry import is_inside, reflection_point

wp.set_module_options(DOUBLE_PRECISION)

TWO_PI_64 = wp.constant(wp.float64(6.283185307179586))
FAR_EDGE = wp.constant(wp.float64(5.0))
"""An edge farther than this from the point of reflection is left out [Fresnel coordinate]: its wave is 0.045 of the
mirror's there. Design value."""
NEAR_EDGE = wp.constant(wp.float64(3.0))
"""An edge nearer than this counts in full; in between its share falls smoothly [Fresnel coordinate]."""
ON_EDGE = wp.constant(wp.float64(1e-9))
"""A point nearer than this to the line of an edge is on it [Fresnel coordinate]."""
LOBE = wp.constant(wp.float64(0.5))
"""Edges of a surface of width w count (1 + `LOBE` / w) times as far out, so past the first null of a narrow one, which
is 2 / w from the point of reflection [Fresnel coordinate]."""
INSET_M = wp.constant(wp.float64(1e-3))
"""A path that reflects beside a surface touches it this far inside its outline [m]."""


@wp.struct
class Outlines:
    """Outlines of the flat surfaces: of all that are coplanar on one carrier together, in its frame, float64."""

    group: wp.array[int]
    """Outline of each plane, shape [K]."""
    first: wp.array[int]
    """First edge of each outline, and the number of edges, shape [G + 1]."""
    begin: wp.array[wp.vec3d]
    """Begin of each edge, counter-clockwise around `normal` [m], shape [E]."""
    end: wp.array[wp.vec3d]
    """End of each edge [m], shape [E]."""
    normal: wp.array[wp.vec3d]
    """Unit normal of each outline, shape [G]."""
    width: wp.array[wp.float64]
    """Smaller extent of each outline [m], shape [G]."""
    area: wp.array[wp.float64]
    """Area inside each outline [m^2], shape [G]."""
    rule: Quadrature
    """Quadrature along an edge."""
    longest_m: wp.float64
    """Longest wavelength [m]; 0 where surfaces count as infinite."""
    shortest_m: wp.float64
    """Shortest wavelength [m]."""
    weakest: wp.float64
    """Reflections with a smaller share of the mirror's amplitude at every carrier are left out."""


@wp.struct
class FresnelFrame:
    """Fresnel coordinates around a point of reflection, in the frame of a carrier."""

    point: wp.vec3d
    u: wp.vec3d
    """Vector whose product with an offset [m] is the coordinate u [1/m]."""
    v: wp.vec3d
    """The same for v."""


@wp.func
def smooth_step(value: wp.float64, low: wp.float64, high: wp.float64) -> wp.float64:
    """Return 0 at `low` and before it, 1 at `high` and behind it, and smoothly in between."""
    t = wp.clamp((value - low) / (high - low), wp.float64(0.0), wp.float64(1.0))
    return t * t * (wp.float64(3.0) - wp.float64(2.0) * t)


@wp.func
def edge_share(distance: wp.float64, width: wp.float64) -> wp.float64:
    """Return the share with which an edge counts: 1 near the point of reflection, 0 far from it, smooth in between.

    A surface narrower than the Fresnel zone scatters more widely, so its edges count farther out. `distance` and
    `width` of the surface are Fresnel coordinates. `mmw.physics.em.finite_surfaces.edge_share` is the same function.
    """
    scaled = distance / (wp.float64(1.0) + LOBE / wp.max(width, wp.float64(1e-9)))
    return smooth_step(scaled, FAR_EDGE, NEAR_EDGE)


@wp.func
def fresnel_scale(wavelength: wp.float64, before: wp.float64, behind: wp.float64) -> wp.float64:
    """Return sqrt(2 / (lambda rho)) [1/m] for the lengths of a path before and behind a reflection [m]."""
    return wp.sqrt(wp.float64(2.0) * (before + behind) / (wavelength * before * behind))


@wp.func
def fresnel_frame(point: wp.vec3d, incoming: wp.vec3d, normal: wp.vec3d, scale: wp.float64) -> FresnelFrame:
    """Return Fresnel coordinates around a point of reflection for a unit direction of incidence, all in one frame."""
    cosine = wp.dot(incoming, normal)
    along = incoming - cosine * normal
    size = wp.length(along)
    if size < wp.float64(1e-9):
        other = wp.vec3d(wp.float64(1.0), wp.float64(0.0), wp.float64(0.0))
        if wp.abs(normal[0]) > wp.float64(0.9):
            other = wp.vec3d(wp.float64(0.0), wp.float64(1.0), wp.float64(0.0))
        along = wp.cross(normal, other)
        size = wp.length(along)
    along = along / size
    frame = FresnelFrame()
    frame.point = point
    frame.u = scale * wp.abs(cosine) * along
    frame.v = scale * wp.cross(normal, along)
    return frame


@wp.func
def coordinates(frame: FresnelFrame, point: wp.vec3d) -> wp.vec2d:
    """Return the Fresnel coordinates of a point."""
    offset = point - frame.point
    return wp.vec2d(wp.dot(frame.u, offset), wp.dot(frame.v, offset))


@wp.func
def nearest_share(a: wp.vec2d, b: wp.vec2d) -> wp.float64:
    """Return where the edge from `a` to `b` is nearest to the point of reflection, 0 to 1."""
    along = b - a
    size = wp.max(wp.dot(along, along), wp.float64(1e-300))
    return wp.clamp(-wp.dot(a, along) / size, wp.float64(0.0), wp.float64(1.0))


@wp.func
def reflected_share(
    outlines: Outlines, outline: int, frame: FresnelFrame, width: wp.float64, is_in: wp.bool
) -> wp.vec2d:
    """Return F, the share of the mirror's field that the inside of an outline reflects; `width` in Fresnel
    coordinates."""
    total = wp.vec2d()
    for edge in range(outlines.first[outline], outlines.first[outline + 1]):
        a = coordinates(frame, outlines.begin[edge])
        b = coordinates(frame, outlines.end[edge])
        along = b - a
        length = wp.length(along)
        share = edge_share(wp.length(a + nearest_share(a, b) * along), width)
        cross = a[0] * b[1] - a[1] * b[0]
        if share > wp.float64(0.0) and length > wp.float64(0.0):
            distance = wp.abs(cross) / length
            side = wp.sign(cross)
            if distance < ON_EDGE:  # the point is on the line of the edge: the limit from its own side
                distance = ON_EDGE
                side = wp.where(is_in, wp.float64(1.0), wp.float64(-1.0))
            beta = HALF_PI * distance * distance
            x1 = wp.dot(a, along) / (length * distance)
            x2 = wp.dot(b, along) / (length * distance)
            wave = edge_part(outlines.rule, beta, x2) - edge_part(outlines.rule, beta, x1)
            total = total - (share * side / TWO_PI_64) * wave
    if is_in:
        total = total + wp.vec2d(wp.float64(1.0), wp.float64(0.0))
    return total


@wp.kernel
def share_kernel(
    outlines: Outlines,
    pose: wp.array2d[wp.transformd],
    wavelength: wp.array[wp.float64],
    batch_index: wp.array[int],
    outline: wp.array[int],
    carrier: wp.array[int],
    point: wp.array[wp.vec3d],
    vertex: wp.array[wp.vec3d],
    incoming: wp.array[wp.vec3d],
    before: wp.array[wp.float64],
    behind: wp.array[wp.float64],
    is_own: wp.array[wp.bool],
    # out
    share_out: wp.array2d[wp.vec2d],
):
    """Compute the share of the mirror's field that each reflection has at each carrier.

    `point` is where the infinite plane reflects, `vertex` where the path touches the surface, other than `point` only
    beside it; phases are relative to the path over `vertex`, inside the outline only if `is_own`. Launch: dim=(Q, C).
    """
    hit, column = wp.tid()
    own = outline[hit]
    normal = outlines.normal[own]
    at = to_carrier(point[hit], pose, batch_index[hit], carrier[hit])
    touched = to_carrier(vertex[hit], pose, batch_index[hit], carrier[hit])
    direction = incoming[hit]
    if carrier[hit] < pose.shape[1]:
        direction = wp.transform_vector(wp.transform_inverse(pose[batch_index[hit], carrier[hit]]), direction)
    scale = fresnel_scale(wavelength[column], before[hit], behind[hit])
    frame = fresnel_frame(at, direction, normal, scale)
    beside = coordinates(frame, touched)
    is_in = wp.length(at - touched) < wp.float64(1e-6) * (wp.float64(1.0) + wp.length(at))
    share = reflected_share(outlines, own, frame, scale * outlines.width[own], is_in and is_own[hit])
    phase = wp.float64(0.0)
    if not is_in:
        phase = -HALF_PI * wp.dot(beside, beside)
    share_out[hit, column] = times(share, turn(phase))


@wp.func
def beside_surface(
    outlines: Outlines,
    surfaces: Surfaces,
    pose: wp.array2d[wp.transformd],
    batch_index: int,
    plane: int,
    mean: Plane,
    tx: wp.vec3d,
    rx: wp.vec3d,
) -> wp.vec4d:
    """Return the point of a plane's surfaces, world frame [m], at which a path touches them that the plane would
    reflect beside them, and 1; 0 if it is too far from them to reflect."""
    outline = outlines.group[plane]
    carrier = surfaces.carrier[surfaces.lead[plane]]
    point = reflection_point(tx, rx, mean.normal, mean.offset)
    before = wp.length(point - tx)
    behind = wp.length(rx - point)
    scale = fresnel_scale(outlines.longest_m, before, behind)
    direction = (point - tx) / before
    local = to_carrier(point, pose, batch_index, carrier)
    if carrier < pose.shape[1]:
        direction = wp.transform_vector(wp.transform_inverse(pose[batch_index, carrier]), direction)
    normal = outlines.normal[outline]
    frame = fresnel_frame(local, direction, normal, scale)
    nearest = wp.float64(1e300)
    touched = wp.vec3d()
    for edge in range(outlines.first[outline], outlines.first[outline + 1]):
        begin = outlines.begin[edge]
        end = outlines.end[edge]
        a = coordinates(frame, begin)
        b = coordinates(frame, end)
        share = nearest_share(a, b)
        distance = wp.length(a + share * (b - a))
        if distance < nearest:
            nearest = distance
            length = wp.length(end - begin)
            inset = wp.min(INSET_M, wp.float64(0.25) * length)
            inward = wp.cross(normal, (end - begin) / length)
            along = wp.clamp(share * length, inset, length - inset)
            touched = begin + along * (end - begin) / length + INSET_M * inward
    if edge_share(nearest, scale * outlines.width[outline]) == wp.float64(0.0):
        return wp.vec4d()
    touched = from_carrier(touched, pose, batch_index, carrier)
    return wp.vec4d(touched[0], touched[1], touched[2], wp.float64(1.0))


@wp.func
def most_share(
    outlines: Outlines, outline: int, scale: wp.float64, cosine: wp.float64, distance: wp.float64
) -> wp.float64:
    """Return more than the largest share that an outline can reflect, as a rectangle of its width and area.

    The share of a strip is below w / sqrt(2), below 1.4, and `distance` d beside it [m] below 0.64 sqrt(2) / d of two
    edges; one of two axes holds d / sqrt(2) at least.
    """
    width = scale * outlines.width[outline]
    length = scale * outlines.area[outline] / wp.max(outlines.width[outline], wp.float64(1e-9))
    half = wp.float64(0.7071067811865476)
    limit = wp.float64(0.64) / wp.max(scale * distance, wp.float64(1e-9))
    across = wp.min(half * width, wp.float64(1.4))
    along = wp.min(half * length, wp.float64(1.4))
    most = wp.max(wp.min(across, limit) * along, across * wp.min(along, limit))
    return wp.min(most, wp.float64(0.5) * width * length * cosine)


@wp.kernel
def cull_finite_kernel(
    ends: LinkEnds,
    surfaces: Surfaces,
    outlines: Outlines,
    first_link: int,
    first_source: int,
    is_hit: wp.array2d[wp.uint8],
    # out
    count_out: wp.array[int],
    pair_out: wp.array2d[int],
):
    """Select the (link, plane) pairs that may reflect, on the plane's surfaces or beside them.

    `is_hit` as in `cull_reflections_kernel`. Launch: dim=(L, K).
    """
    row, plane = wp.tid()
    link = first_link + row
    is_seen = is_hit.shape[0] == 0
    if not is_seen:  # a kernel looks at both sides of `or`
        is_seen = is_hit[ends.source[link] - first_source, plane] != wp.uint8(0)
    if not is_seen:
        return
    lead = surfaces.lead[plane]
    carrier = surfaces.carrier[lead]
    normal = surfaces.normal[surfaces.row[lead]]
    offset = surfaces.offset[surfaces.row[lead]]
    tx = ends.tx[link, carrier]
    rx = ends.rx[link, carrier]
    tx_height = wp.dot(normal, tx) - offset
    rx_height = wp.dot(normal, rx) - offset
    if not tx_height * rx_height > wp.float64(0.0):  # nor for NaN, the pose of an absent instance
        return
    point = reflection_point(tx, rx, normal, offset)
    before = wp.length(point - tx)
    behind = wp.length(rx - point)
    cosine = wp.abs(tx_height) / before
    outline = outlines.group[plane]
    low = surfaces.plane_lower[plane]
    high = surfaces.plane_upper[plane]
    away = wp.max(wp.max(low - point, point - high), wp.vec3d())
    distance = cosine * wp.max(wp.length(away) - wp.float64(1e-4), wp.float64(0.0))
    coarsest = fresnel_scale(outlines.longest_m, before, behind)
    finest = fresnel_scale(outlines.shortest_m, before, behind)
    most = wp.max(
        most_share(outlines, outline, coarsest, cosine, distance),
        most_share(outlines, outline, finest, cosine, distance),
    )
    share = edge_share(coarsest * distance, coarsest * outlines.width[outline])
    if share > wp.float64(0.0) and most >= outlines.weakest:
        select_pair(row, plane, count_out, pair_out)


@wp.kernel
def lies_on_kernel(
    point: wp.array[wp.vec3d],
    own: wp.array[int],
    group: wp.array[int],
    first: wp.array[int],
    corner: wp.array[wp.vec3d],
    surface: wp.array[int],
    area: wp.array[wp.float64],
    # out
    lies_on_out: wp.array[wp.uint8],
):
    """Find the surfaces that lie on a larger one of their group: a point of theirs is in one of its triangles.

    `point`, `own` surface and `group` have a row a surface that is asked for; the triangles of group g are `first[g]`
    to `first[g + 1]` of `corner` (three each) and `surface`; `area` has an entry a surface. Launch: dim=M.
    """
    row = wp.tid()
    mine = own[row]
    triangle = first[group[row]]
    last = first[group[row] + 1]
    found = wp.uint8(0)
    while triangle < last and found == wp.uint8(0):
        other = surface[triangle]
        if area[other] > area[mine] or (area[other] == area[mine] and other < mine):
            a = corner[3 * triangle]
            if is_inside(point[row], a, corner[3 * triangle + 1], corner[3 * triangle + 2], EDGE_MARGIN):
                found = wp.uint8(1)
        triangle = triangle + 1
    lies_on_out[row] = found
