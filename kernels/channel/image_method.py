"""Image method: exact paths from candidates, interaction points in float64, every segment between them traced."""

import warp as wp

from mmw.kernels.channel.edges import Wedges, edge_point, edge_world, is_outside
from mmw.kernels.channel.segments import (
    DIFFRACTION,
    EDGE_LIFTS,
    END_SLACK,
    LIFT,
    SPECULAR,
    HitBuffers,
    is_covered,
    walk_leg,
)
from mmw.kernels.channel.surfaces import (
    LinkEnds,
    Plane,
    Surfaces,
    is_mirror,
    largest,
    mean_plane,
    mirror_point,
    mirrored,
    surface_at,
    triangle_at,
    triangle_plane,
)
from mmw.kernels.core.structs import MISS_ID, Scene

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})


@wp.struct
class Trials:
    """Candidate paths: a link and its interactions, from transmitter to receiver."""

    link: wp.array[int]
    """Link of each candidate, shape [C]."""
    step: wp.array2d[int]
    """Interactions of each: a surface id (or plane id), -2 - wedge id, or -1 behind the end, shape [C, D]."""
    is_plane: wp.bool
    """True if steps are planes, of which the point picks the surface; `step` then takes the surfaces that are found."""
    image: wp.array2d[wp.vec3d]
    """Scratch: image of the end that a step belongs to, before its surface [m], shape [C, D]."""
    normal: wp.array2d[wp.vec3d]
    """Scratch: plane of each step, shape [C, D]."""
    offset: wp.array2d[wp.float64]
    """Scratch: plane of each step, shape [C, D]."""
    point: wp.array2d[wp.vec3d]
    """Scratch: point of each step [m], shape [C, D]."""


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
    met_out: HitBuffers,
):
    """Find the exact points of each candidate and trace its segments, through up to `passes` slabs on the way.

    `order_out` is the number of rows of `met_out` that are filled, -1 where there is no path. `origin` is the world
    position of the scene frame's origin. Launch: dim=C, block_dim=64.
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
    depth = met_out.kind.shape[1]
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
            met_out,
        )
        if filled < 0:
            return
        if k < steps:
            met_out.kind[trial, filled] = wp.where(k == edge, DIFFRACTION, SPECULAR)
            met_out.surface[trial, filled] = wp.where(k == edge, -2 - trials.step[trial, k], trials.step[trial, k])
            met_out.vertex[trial, filled] = end
            met_out.normal[trial, filled] = away
            filled = filled + 1
        begin = end
        start = stop
        own[0] = own[2]
        own[1] = own[3]
    order_out[trial] = filled
