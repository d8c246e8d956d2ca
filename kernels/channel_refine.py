"""From candidate chains to exact paths: points of interaction in float64, and every leg between them traced."""

import warp as wp

from mmw.kernels.channel_surfaces import (
    LinkEnds,
    Plane,
    Surfaces,
    is_mirror,
    largest,
    mean_plane,
    mirror_point,
    mirrored,
    single,
    surface_at,
    triangle_at,
    triangle_plane,
)
from mmw.kernels.channel_wedges import Wedges, edge_point, edge_world, is_outside
from mmw.kernels.structs import MISS_ID, Scene
from mmw.kernels.trace import closest_hit, is_blocked

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})

SPECULAR = wp.constant(1)
"""Interaction: mirror reflection. The numbers are those of Sionna RT."""
TRANSMISSION = wp.constant(4)
"""Interaction: straight through a slab."""
DIFFRACTION = wp.constant(8)
"""Interaction: around a wedge."""

MIN_LEG = wp.constant(wp.float64(0.01))
"""Shortest leg of a path [m]; nearer than this the far field means nothing. Source: Sionna RT 2.2 uses the same."""
LIFT = wp.constant(wp.float64(2e-6))
"""A leg starts off its surface by this times (5 m + largest coordinate): 16 roundings of float32."""
EDGE_LIFTS = wp.constant(wp.float64(4.0))
"""A leg starts off an edge by this many lifts, along the middle of the two outward normals."""
COVER_SHARE = wp.constant(wp.float64(0.75))
"""Share of the lift, from its upper end, that is searched for a surface that lies on the reflecting one."""
END_SLACK = wp.constant(wp.float64(6e-6))
"""Share of a leg at each antenna that is not searched for obstacles: an antenna may lie on a surface."""


@wp.struct
class Trials:
    """Candidate paths: a link and what it meets, from transmitter to receiver."""

    link: wp.array[int]
    """Link of each candidate, shape [C]."""
    step: wp.array2d[int]
    """What it meets: a surface id (or plane id), -2 - wedge id, or -1 behind the end, shape [C, D]."""
    is_plane: wp.bool
    """Whether steps are planes, of which the point picks the surface; `step` then takes the surfaces that are found."""
    image: wp.array2d[wp.vec3d]
    """Scratch: image of the end that a step belongs to, before its surface [m], shape [C, D]."""
    normal: wp.array2d[wp.vec3d]
    """Scratch: plane of each step, shape [C, D]."""
    offset: wp.array2d[wp.float64]
    """Scratch: plane of each step, shape [C, D]."""
    point: wp.array2d[wp.vec3d]
    """Scratch: point of each step [m], shape [C, D]."""


@wp.func
def is_covered(
    scene: Scene, slot: int, start: wp.vec3d, normal: wp.vec3d, lift: wp.float64, origin: wp.vec3d, surface: int
) -> bool:
    """Return whether another surface lies between a point of reflection and `start`, its legs' start above it."""
    reach = wp.float32(lift * COVER_SHARE)
    hit = closest_hit(scene, slot, single(start - origin), -single(normal), reach, MISS_ID)
    return hit.surface != MISS_ID and hit.surface != surface


@wp.func
def is_own(surface: int, own: wp.vec4i) -> bool:
    """Return whether a surface is one of those on which a leg begins or ends."""
    return surface == own[0] or surface == own[1] or surface == own[2] or surface == own[3]


@wp.func
def plane_at(trials: Trials, trial: int, step: int) -> Plane:
    """Return the plane of a step."""
    plane = Plane()
    plane.normal = trials.normal[trial, step]
    plane.offset = trials.offset[trial, step]
    return plane


@wp.func
def find_points(
    trials: Trials,
    wedges: Wedges,
    pose: wp.array2d[wp.transformd],
    slot: int,
    trial: int,
    steps: int,
    edge: int,
    tx: wp.vec3d,
    rx: wp.vec3d,
) -> bool:
    """Write the points of all steps by the image method, and return whether there are any.

    Images of the transmitter go up to the wedge at step `edge` (`steps` if there is none), images of the receiver down
    to it; the point on the wedge follows from both, the reflections from the point.
    """
    image = tx
    for k in range(edge):
        trials.image[trial, k] = image
        image = mirrored(image, plane_at(trials, trial, k))
    target = rx
    is_open = wp.bool(True)
    if edge < steps:
        back = rx
        step = steps - 1
        while step > edge:
            trials.image[trial, step] = back
            back = mirrored(back, plane_at(trials, trial, step))
            step = step - 1
        wedge = -2 - trials.step[trial, edge]
        ends = edge_world(wedges, pose, slot, wedge)
        found = edge_point(ends, image, back)
        is_open = found[3] > wp.float64(0.0)
        target = wp.vec3d(found[0], found[1], found[2])
        trials.point[trial, edge] = target
        on = target
        step = edge + 1
        while is_open and step < steps:
            plane = plane_at(trials, trial, step)
            is_open = is_mirror(plane.normal, plane.offset, trials.image[trial, step], on)
            if is_open:
                on = mirror_point(plane, trials.image[trial, step], on)
                trials.point[trial, step] = on
            step = step + 1
    step = edge - 1
    while is_open and step >= 0:
        plane = plane_at(trials, trial, step)
        is_open = is_mirror(plane.normal, plane.offset, trials.image[trial, step], target)
        if is_open:
            target = mirror_point(plane, trials.image[trial, step], target)
            trials.point[trial, step] = target
        step = step - 1
    return is_open


@wp.func
def find_exact_points(
    trials: Trials,
    surfaces: Surfaces,
    wedges: Wedges,
    pose: wp.array2d[wp.transformd],
    slot: int,
    trial: int,
    steps: int,
    edge: int,
    tx: wp.vec3d,
    rx: wp.vec3d,
) -> bool:
    """Write the exact points of all steps, and return whether there are any.

    The mean planes of the surfaces pick surfaces and triangles, without gaps at inner edges; the planes of those
    triangles then give the points.
    """
    for k in range(steps):
        if k != edge:
            surface = trials.step[trial, k]
            if trials.is_plane:
                surface = surfaces.lead[surface]
            plane = mean_plane(surfaces, pose, slot, surface)
            trials.normal[trial, k] = plane.normal
            trials.offset[trial, k] = plane.offset
    is_open = find_points(trials, wedges, pose, slot, trial, steps, edge, tx, rx)
    step = wp.int32(0)
    while is_open and step < steps:
        if step != edge:
            if trials.is_plane:
                trials.step[trial, step] = surface_at(
                    surfaces, pose, slot, trials.step[trial, step], trials.point[trial, step]
                )
            is_open = trials.step[trial, step] >= 0
            if is_open:
                surface = trials.step[trial, step]
                corner = triangle_at(surfaces, pose, slot, surface, trials.point[trial, step])
                is_open = corner >= 0
                if is_open:
                    plane = triangle_plane(surfaces, pose, slot, surface, corner)
                    trials.normal[trial, step] = plane.normal
                    trials.offset[trial, step] = plane.offset
        step = step + 1
    if is_open and steps > 0:
        is_open = find_points(trials, wedges, pose, slot, trial, steps, edge, tx, rx)
    return is_open


@wp.func
def walk_leg(
    scene: Scene,
    surfaces: Surfaces,
    pose: wp.array2d[wp.transformd],
    origin: wp.vec3d,
    slot: int,
    begin: wp.vec3d,
    end: wp.vec3d,
    start: wp.vec3d,
    stop: wp.vec3d,
    own: wp.vec4i,
    trial: int,
    filled: int,
    room: int,
    kind_out: wp.array2d[int],
    surface_out: wp.array2d[int],
    vertex_out: wp.array2d[wp.vec3d],
    normal_out: wp.array2d[wp.vec3d],
) -> int:
    """Trace a leg; write the slabs that it passes through, `room` at most; return how many rows are filled, or -1.

    `begin` and `end` are its true ends, `start` and `stop` the same lifted off what they lie on. The surfaces of `own`,
    being flat, cannot stand in the leg's own way.
    """
    leg = stop - start
    length = wp.length(leg)
    if not length > MIN_LEG:
        return -1
    place = single(start - origin)
    direction = wp.normalize(single(leg / length))
    left = wp.float32(length)
    if not is_blocked(scene, slot, place, direction, left, MISS_ID):
        return filled
    written = filled
    passed = wp.int32(MISS_ID)
    tries = wp.int32(16)
    while tries > 0:
        hit = closest_hit(scene, slot, place, direction, left, MISS_ID)
        if hit.surface == MISS_ID:
            return written
        if not is_own(hit.surface, own) and hit.surface != passed:
            if written - filled >= room or surfaces.is_open[hit.surface] == wp.uint8(0):
                return -1
            passed = hit.surface
            at = start + wp.float64(length - wp.float64(left) + wp.float64(hit.t)) * (leg / length)
            plane = mean_plane(surfaces, pose, slot, passed)
            corner = triangle_at(surfaces, pose, slot, passed, at)
            if corner >= 0:
                plane = triangle_plane(surfaces, pose, slot, passed, corner)
            share = (plane.offset - wp.dot(plane.normal, begin)) / wp.dot(plane.normal, end - begin)
            if wp.dot(plane.normal, end - begin) > wp.float64(0.0):
                plane.normal = -plane.normal
            kind_out[trial, written] = TRANSMISSION
            surface_out[trial, written] = passed
            vertex_out[trial, written] = begin + share * (end - begin)
            normal_out[trial, written] = plane.normal
            written = written + 1
        step = hit.t + 1e-5 * (1.0 + hit.t)
        place = place + step * direction
        left = left - step
        tries = tries - 1
    return -1


@wp.kernel
def refine_kernel(
    scene: Scene,
    ends: LinkEnds,
    surfaces: Surfaces,
    wedges: Wedges,
    pose: wp.array2d[wp.transformd],
    origin: wp.vec3d,
    trials: Trials,
    passes: int,
    # out
    order_out: wp.array[int],
    kind_out: wp.array2d[int],
    surface_out: wp.array2d[int],
    vertex_out: wp.array2d[wp.vec3d],
    normal_out: wp.array2d[wp.vec3d],
):
    """Find the exact points of each candidate and trace its legs, through up to `passes` slabs on the way.

    Rows of the outputs hold the interactions from transmitter to receiver, -1 and 0 behind the end. `order_out` is
    their number, -1 where there is no path. `surface_out` of a diffraction is its wedge. A normal is turned to the side
    that the wave comes from; that of a diffraction is zero. `origin` is the world position of the scene frame's origin.
    Launch: dim=C, block_dim=64.
    """
    trial = wp.tid()
    link = trials.link[trial]
    slot = ends.slot[link]
    world = ends.tx.shape[1] - 1
    tx = ends.tx[link, world]
    rx = ends.rx[link, world]
    order_out[trial] = -1
    steps = wp.int32(0)
    edge = wp.int32(-1)
    while steps < trials.step.shape[1] and trials.step[trial, steps] != MISS_ID:
        if trials.step[trial, steps] < MISS_ID:
            edge = steps
        steps = steps + 1
    if edge < 0:
        edge = steps
    if not find_exact_points(trials, surfaces, wedges, pose, slot, trial, steps, edge, tx, rx):
        return
    depth = kind_out.shape[1]
    room = wp.min(depth - steps, passes)
    filled = wp.int32(0)
    begin = tx
    start = tx
    own = wp.vec4i(MISS_ID, MISS_ID, MISS_ID, MISS_ID)
    for k in range(steps + 1):
        end = rx
        stop = rx
        away = wp.vec3d()
        own[2] = MISS_ID
        own[3] = MISS_ID
        if k < steps:
            end = trials.point[trial, k]
            lift = LIFT * (wp.float64(5.0) + largest(end - origin))
            if k == edge:
                wedge = -2 - trials.step[trial, k]
                own[2] = wedges.surface_0[wedge]
                own[3] = wedges.surface_n[wedge]
                after = rx
                if k + 1 < steps:
                    after = trials.point[trial, k + 1]
                ends_w = edge_world(wedges, pose, slot, wedge)
                if not (is_outside(ends_w, begin) and is_outside(ends_w, after)):
                    return
                stop = end + EDGE_LIFTS * lift * ends_w.away
            else:
                own[2] = trials.step[trial, k]
                away = trials.normal[trial, k]
                if wp.dot(away, begin) < trials.offset[trial, k]:
                    away = -away
                stop = end + lift * away
                if is_covered(scene, slot, stop, away, lift, origin, own[2]):
                    return
        if k == 0:
            start = start + END_SLACK * (end - start)
        if k == steps:
            stop = stop + END_SLACK * (begin - stop)
        filled = walk_leg(
            scene,
            surfaces,
            pose,
            origin,
            slot,
            begin,
            end,
            start,
            stop,
            own,
            trial,
            filled,
            room - (filled - k),
            kind_out,
            surface_out,
            vertex_out,
            normal_out,
        )
        if filled < 0:
            return
        if k < steps:
            kind_out[trial, filled] = wp.where(k == edge, DIFFRACTION, SPECULAR)
            surface_out[trial, filled] = wp.where(k == edge, -2 - trials.step[trial, k], trials.step[trial, k])
            vertex_out[trial, filled] = end
            normal_out[trial, filled] = away
            filled = filled + 1
        begin = end
        start = stop
        own[0] = own[2]
        own[1] = own[3]
    order_out[trial] = filled
