"""Trace one-bounce multipath of radar rays: over the ground to what a ray hits, and over what a ray hits to a target.

A leg is a way between the radar and a target: the direct one, or the one over a mirror. A wave goes out on one leg and
comes back on one, so a mirror gives three paths beside the direct one. Mirrors are faces, taken as planes; lengths and
reflection points are float64, by the image method.
"""

import warp as wp

from mmw.kernels.core.compiler import DOUBLE_PRECISION
from mmw.kernels.core.faces import face_corners
from mmw.kernels.core.geometry import double, reflection_point, single
from mmw.kernels.core.rigid_motion import surface_velocity
from mmw.kernels.core.structs import Hit, Scene, Views
from mmw.kernels.core.trace import TRACE_REGISTERS, closest_hit, nearest_in_town, occluded
from mmw.kernels.radar.trace import RadarGrid, grid_direction

wp.set_module_options(DOUBLE_PRECISION)

MIN_UP = wp.constant(0.94)
"""Least upward part of the normal of ground: surfaces of the town that are less than 20 deg from level."""

DROP_M = wp.constant(200.0)
"""Height above ground up to which a radar finds it [m]."""

CLEARANCE_M = wp.constant(0.005)
"""Distance above the ground that its reflection points are lifted to where legs are tested for obstacles [m]: more than
float32 and the steps between faces of a road, less than curbs."""

OFFSET_M = wp.constant(0.001)
"""Distance from other surfaces that legs begin and end at [m]."""

SAME_PLANE_M = wp.constant(wp.float64(0.001))
"""Distance from a face up to which a reflection point lies on it [m]."""

SAME_PLANE_COSINE = wp.constant(wp.float64(0.9999))
"""Least cosine between the normals of faces of one plane: 0.8 deg."""

MAX_FACES = wp.constant(5)
"""Faces of the ground that are tried one after the other for a reflection point."""

EXACT_COSINE = wp.constant(wp.float64(1.0e-4))
"""Cosine of incidence below which the tracer's distance is kept: rays along a face do not meet its plane anywhere."""


@wp.struct
class BouncePaths:
    """A target, and its direct leg and its leg over a mirror, for every ray of every view, shape [A, R].

    Geometry and motion only, the same in every weather.
    """

    object_id: wp.array2d[int]
    """Object of the target, -1 for none."""
    material_id: wp.array2d[int]
    """Material of the target."""
    mirror_id: wp.array2d[int]
    """Material of the mirror, -1 for none."""
    direct: wp.array2d[wp.vec4]
    """Direct leg: length [m], 0 where it is blocked, azimuth and elevation at the radar [rad], rate of the length
    [m/s]."""
    bounced: wp.array2d[wp.vec4]
    """The same of the leg over the mirror; its direction is that of the mirror."""
    turns: wp.array2d[wp.vec2]
    """Length of the direct and of the bounced leg in wavelengths, without whole ones."""
    cosines: wp.array2d[wp.vec3]
    """Cosines between the target's normal and the direct leg, the bounced leg, and the bisector of both."""
    mirror: wp.array2d[wp.vec3]
    """Cosine of incidence at the mirror, and the shares of its TE and TM reflection in the vertical polarization."""


@wp.struct
class Plane:
    """A plane in float64."""

    point: wp.vec3d
    """One of its points, scene frame [m]."""
    normal: wp.vec3d
    """Unit normal, scene frame."""


@wp.func
def plane_of(scene: Scene, batch_index: int, face: int, instance: int, towards: wp.vec3d) -> Plane:
    """Return the plane of a face, its normal on the side of `towards` - point."""
    corners = face_corners(scene, face, instance)
    a, b, c = double(corners[0]), double(corners[1]), double(corners[2])
    plane = Plane()
    plane.point = a
    plane.normal = wp.normalize(wp.cross(b - a, c - a))
    if instance >= 0:
        pose = scene.instance_pose[batch_index, instance]
        turn = wp.transform_get_rotation(pose)
        turn_64 = wp.normalize(
            wp.quatd(wp.float64(turn[0]), wp.float64(turn[1]), wp.float64(turn[2]), wp.float64(turn[3]))
        )
        plane.point = wp.quat_rotate(turn_64, a) + double(wp.transform_get_translation(pose))
        plane.normal = wp.quat_rotate(turn_64, plane.normal)
    if wp.dot(plane.normal, towards - plane.point) < wp.float64(0.0):
        plane.normal = -plane.normal
    return plane


@wp.func
def exact_distance(plane: Plane, origin: wp.vec3d, direction: wp.vec3d, traced: float) -> wp.float64:
    """Return where a ray meets the plane of the face that the tracer found [m]."""
    cosine = wp.dot(plane.normal, direction)
    distance = wp.float64(traced)
    if wp.abs(cosine) > EXACT_COSINE:
        distance = wp.dot(plane.normal, plane.point - origin) / cosine
    return distance


@wp.func
def is_ground(instance: int, normal: wp.vec3) -> bool:
    """Return whether a surface is ground: of the town and nearly level, seen from above."""
    return instance < 0 and normal[2] >= MIN_UP


@wp.func
def part_of_turn(length: wp.float64, turns_per_m: wp.float64) -> float:
    """Return a length in wavelengths without whole ones, 0 to 1."""
    turns = length * turns_per_m
    return wp.float32(turns - wp.floor(turns))


@wp.func
def leg_of(pose: wp.transformf, direction: wp.vec3, length: wp.float64, rate: float) -> wp.vec4:
    """Return a leg as `BouncePaths` holds it; `direction` is where it leaves the radar, scene frame."""
    d = wp.quat_rotate_inv(wp.transform_get_rotation(pose), direction)
    return wp.vec4(wp.float32(length), wp.atan2(d[1], d[0]), wp.asin(wp.clamp(d[2], -1.0, 1.0)), rate)


@wp.func
def is_ahead(pose: wp.transformf, direction: wp.vec3) -> bool:
    """Return whether a direction is in the half space that the antennas face."""
    return wp.dot(wp.transform_vector(pose, wp.vec3(1.0, 0.0, 0.0)), direction) > 0.0


@wp.func
def across(direction: wp.vec3, axis: wp.vec3) -> wp.vec3:
    """Return the unit part of an axis across a direction."""
    return wp.normalize(axis - wp.dot(axis, direction) * direction)


@wp.func
def mirror_of(pose: wp.transformf, k_in: wp.vec3, k_out: wp.vec3, normal: wp.vec3) -> wp.vec3:
    """Return the cosine of incidence at a mirror, and how its TE and TM reflection keep the vertical polarization.

    The radar's z axis, across a ray, is its polarization before and behind the mirror; what turns away from it is lost.
    The axes are those of `mmw.physics.em.field`: TE along k x n, TM along k x TE, on either side of the mirror.
    """
    axis = wp.transform_vector(pose, wp.vec3(0.0, 0.0, 1.0))
    before = across(k_in, axis)
    behind = across(k_out, axis)
    te = wp.cross(k_in, normal)
    if wp.length_sq(te) < 1.0e-10:
        te = wp.cross(k_in, before)
    te = wp.normalize(te)
    te_share = wp.dot(before, te) * wp.dot(behind, te)
    tm_share = wp.dot(before, wp.cross(k_in, te)) * wp.dot(behind, wp.cross(k_out, te))
    return wp.vec3(wp.min(wp.abs(wp.dot(k_in, normal)), 1.0), te_share, tm_share)


@wp.func
def ground_point(scene: Scene, sensor: wp.vec3d, target: wp.vec3d) -> tuple[bool, int, Plane, wp.vec3d]:
    """Return whether the ground mirrors the radar to a target, and the face, its plane and the point that does.

    The search begins with the plane below the radar and goes on with the one that the way to its reflection point
    meets, until the point lies on the face.
    """
    is_found = wp.bool(False)
    is_open = wp.bool(True)
    face = wp.int32(-1)
    plane = Plane()
    plane.normal = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(1.0))
    point = wp.vec3d()
    down = wp.vec3(0.0, 0.0, -1.0)
    near = nearest_in_town(scene, single(sensor), down, DROP_M)
    if near.face < 0:
        is_open = False
    else:
        plane.point = sensor + wp.float64(near.t) * double(down)
    tried = wp.int32(0)
    while is_open and not is_found and tried < MAX_FACES:
        tried += 1
        offset = wp.dot(plane.normal, plane.point)
        if wp.dot(plane.normal, sensor) <= offset or wp.dot(plane.normal, target) <= offset:
            is_open = False
        else:
            point = reflection_point(sensor, target, plane.normal, offset)
            way = single(point - sensor)
            length = wp.length(way)
            near = nearest_in_town(scene, single(sensor), way / length, 2.0 * length + 1.0)
            if near.face < 0:
                is_open = False
            else:
                next_plane = plane_of(scene, 0, near.face, -1, sensor)
                distance = wp.abs(wp.dot(next_plane.normal, point - next_plane.point))
                is_same = wp.dot(next_plane.normal, plane.normal) > SAME_PLANE_COSINE and distance < SAME_PLANE_M
                plane = next_plane
                face = near.face
                if wp.float32(plane.normal[2]) < MIN_UP:
                    is_open = False
                elif is_same:
                    is_found = True
                    point = reflection_point(sensor, target, plane.normal, wp.dot(plane.normal, plane.point))
    return is_found, face, plane, point


@wp.func
def is_clear(scene: Scene, batch_index: int, start: wp.vec3, end: wp.vec3, ignore: int) -> bool:
    """Return whether nothing lies between two points."""
    way = end - start
    length = wp.length(way)
    return length <= 0.0 or not occluded(scene, batch_index, start, way / length, length, ignore)


@wp.func
def trace_ground(
    scene: Scene, views: Views, velocity: wp.vec3, view: int, ray: int, hit: Hit, direction: wp.vec3,
    distance: wp.float64, turns_per_m: wp.float64, ground_out: BouncePaths,
):  # fmt: skip
    """Store the leg over the ground to the first hit of a ray. `distance` is that of the hit [m]."""
    pose = views.pose[view]
    batch_index = views.batch_index[view]
    ignore = views.ignore[view]
    sensor = double(wp.transform_get_translation(pose))
    target = sensor + distance * wp.normalize(double(direction))
    is_found, face, plane, point = ground_point(scene, sensor, target)
    if not is_found:
        return
    k_in = single(wp.normalize(point - sensor))
    k_out = single(wp.normalize(target - point))
    normal = single(plane.normal)
    cosine = -wp.dot(hit.normal, k_out)
    if cosine <= 0.0 or not is_ahead(pose, k_in):
        return
    above = single(point) + CLEARANCE_M * normal
    end = single(target) + OFFSET_M * hit.normal
    if not is_clear(scene, batch_index, single(sensor), above, ignore):
        return
    if not is_clear(scene, batch_index, above, end, ignore):
        return
    moving = surface_velocity(scene, batch_index, hit.instance, hit.face, single(target))
    length = wp.length(point - sensor) + wp.length(target - point)
    rate = wp.dot(k_out, moving) - wp.dot(k_in, velocity)
    ground_out.object_id[view, ray] = hit.object_id
    ground_out.material_id[view, ray] = hit.material_id
    ground_out.mirror_id[view, ray] = scene.town_material[face]
    ground_out.direct[view, ray] = leg_of(pose, direction, distance, wp.dot(direction, moving - velocity))
    ground_out.bounced[view, ray] = leg_of(pose, k_in, length, rate)
    ground_out.turns[view, ray] = wp.vec2(part_of_turn(distance, turns_per_m), part_of_turn(length, turns_per_m))
    bisector = wp.normalize(-direction - k_out)
    ground_out.cosines[view, ray] = wp.vec3(-wp.dot(hit.normal, direction), cosine, wp.dot(hit.normal, bisector))
    ground_out.mirror[view, ray] = mirror_of(pose, k_in, k_out, normal)


@wp.func
def trace_ghost(
    scene: Scene, views: Views, velocity: wp.vec3, view: int, ray: int, hit: Hit, plane: Plane, direction: wp.vec3,
    distance: wp.float64, t_max: float, turns_per_m: wp.float64, ghost_out: BouncePaths,
):  # fmt: skip
    """Store the target that a ray meets after a mirror reflection at its first hit, and its legs.

    Two hits on one vehicle or person are left out.

    `plane` and `distance` are those of the hit; the whole leg is at most `t_max` long [m].
    """
    pose = views.pose[view]
    batch_index = views.batch_index[view]
    ignore = views.ignore[view]
    sensor = double(wp.transform_get_translation(pose))
    k_in = wp.normalize(double(direction))
    point = sensor + distance * k_in
    k_out = k_in - wp.float64(2.0) * wp.dot(k_in, plane.normal) * plane.normal
    normal = single(plane.normal)
    out = single(k_out)
    start = single(point) + OFFSET_M * normal
    reach = t_max - wp.float32(distance)
    if reach <= 0.0:
        return
    far = closest_hit(scene, batch_index, start, out, reach, ignore)
    if far.object_id < 0 or is_ground(far.instance, far.normal):
        return
    if far.instance >= 0 and far.instance == hit.instance:
        return  # the roughness of bodywork has it: `BODYWORK` of `mmw.sensors.radar.reflectivity`
    face_plane = plane_of(scene, batch_index, far.face, far.instance, point)
    onward = exact_distance(face_plane, point, k_out, far.t)
    target = point + onward * k_out
    length = distance + onward
    target_normal = far.normal
    cosine = -wp.dot(target_normal, out)
    end = single(target) + OFFSET_M * target_normal
    moving = surface_velocity(scene, batch_index, far.instance, far.face, single(target))
    mirror_moving = surface_velocity(scene, batch_index, hit.instance, hit.face, single(point))
    rate = wp.dot(direction, mirror_moving - velocity) + wp.dot(out, moving - mirror_moving)

    straight = single(wp.normalize(target - sensor))
    straight_length = wp.length(target - sensor)
    straight_cosine = -wp.dot(target_normal, straight)
    bisector = wp.normalize(-straight - out)
    direct = wp.vec4()
    is_seen = straight_cosine > 0.0 and is_ahead(pose, straight)
    if is_seen and is_clear(scene, batch_index, single(sensor), end, ignore):
        direct = leg_of(pose, straight, straight_length, wp.dot(straight, moving - velocity))
    ghost_out.object_id[view, ray] = far.object_id
    ghost_out.material_id[view, ray] = far.material_id
    ghost_out.mirror_id[view, ray] = hit.material_id
    ghost_out.direct[view, ray] = direct
    ghost_out.bounced[view, ray] = leg_of(pose, direction, length, rate)
    ghost_out.turns[view, ray] = wp.vec2(part_of_turn(straight_length, turns_per_m), part_of_turn(length, turns_per_m))
    ghost_out.cosines[view, ray] = wp.vec3(straight_cosine, cosine, wp.dot(target_normal, bisector))
    ghost_out.mirror[view, ray] = mirror_of(pose, direction, out, normal)


@wp.kernel(cuda_max_registers=TRACE_REGISTERS)
def bounce_kernel(
    scene: Scene,
    views: Views,
    velocity: wp.array[wp.vec3],
    key: wp.array[wp.vec2ui],
    grid: RadarGrid,
    t_max: float,
    turns_per_m: wp.float64,
    # out
    turns_out: wp.array2d[float],
    ground_out: BouncePaths,
    ghost_out: BouncePaths,
):
    """Trace the rays of `mmw.kernels.radar.trace.grid_kernel` again, for exact phases, the ground and the mirrors.

    `turns_per_m` is 1 / wavelength. `turns_out` is the phase of the direct echo, both ways. Structs without arrays are
    left out.

    Launch: dim=(A, R), block_dim=64.
    """
    view, ray = wp.tid()
    pose = views.pose[view]
    batch_index = views.batch_index[view]
    has_ground = ground_out.object_id.shape[0] > 0
    has_ghosts = ghost_out.object_id.shape[0] > 0
    turns_out[view, ray] = 0.0
    if has_ground:
        ground_out.object_id[view, ray] = -1
        ground_out.mirror_id[view, ray] = -1
    if has_ghosts:
        ghost_out.object_id[view, ray] = -1
        ghost_out.mirror_id[view, ray] = -1
    direction = wp.transform_vector(pose, grid_direction(key[view], grid, ray))
    origin = wp.transform_get_translation(pose)
    hit = closest_hit(scene, batch_index, origin, direction, t_max, views.ignore[view])
    if hit.object_id < 0:
        return
    sensor = double(origin)
    plane = plane_of(scene, batch_index, hit.face, hit.instance, sensor)
    distance = exact_distance(plane, sensor, wp.normalize(double(direction)), hit.t)
    turns_out[view, ray] = part_of_turn(distance, wp.float64(2.0) * turns_per_m)
    if is_ground(hit.instance, hit.normal):
        return
    if has_ground:
        trace_ground(scene, views, velocity[view], view, ray, hit, direction, distance, turns_per_m, ground_out)
    if has_ghosts:
        trace_ghost(
            scene, views, velocity[view], view, ray, hit, plane, direction, distance, t_max, turns_per_m, ghost_out
        )
