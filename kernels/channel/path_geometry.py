"""Directions, lengths and polarization bases of paths in float64."""

import warp as wp

from mmw.kernels.channel.complex_numbers import ONE, ZERO
from mmw.kernels.channel.segments import DIFFRACTION
from mmw.kernels.core.compiler import AS_NUMPY

wp.set_module_options(AS_NUMPY)

DIFFUSE = wp.constant(2)
"""Interaction: diffuse reflection."""
AT_POLE = wp.constant(wp.float64(1e-9))
"""The azimuth of a direction this close to the z axis is 0."""
AT_NORMAL = wp.constant(wp.float64(1e-12))
"""Square of the sine of incidence below which the plane of incidence is not known."""


@wp.func
def direction_angles(direction: wp.vec3d) -> wp.vec2d:
    """Return zenith and azimuth of a direction [rad]; the azimuth at the poles is 0."""
    across = wp.sqrt(direction[0] * direction[0] + direction[1] * direction[1])
    azimuth = ZERO
    if across >= AT_POLE:
        azimuth = wp.atan2(direction[1], direction[0])
    return wp.vec2d(wp.atan2(across, direction[2]), azimuth)


@wp.func
def zenith_vector(angles: wp.vec2d) -> wp.vec3d:
    """Return the unit vector of growing zenith."""
    cosine = wp.cos(angles[0])
    return wp.vec3d(cosine * wp.cos(angles[1]), cosine * wp.sin(angles[1]), -wp.sin(angles[0]))


@wp.func
def azimuth_vector(angles: wp.vec2d) -> wp.vec3d:
    """Return the unit vector of growing azimuth."""
    return wp.vec3d(-wp.sin(angles[1]), wp.cos(angles[1]), ZERO)


@wp.func
def perpendicular(direction: wp.vec3d, normal: wp.vec3d) -> wp.vec3d:
    """Return the unit TE axis, direction x normal; any axis across the ray at normal incidence."""
    axis = wp.cross(direction, normal)
    square = wp.dot(axis, axis)
    if square < AT_NORMAL:
        other = wp.vec3d(ONE, ZERO, ZERO)
        if wp.abs(direction[0]) >= wp.float64(0.9):
            other = wp.vec3d(ZERO, ONE, ZERO)
        axis = wp.cross(direction, other)
        square = wp.dot(axis, axis)
    return axis / wp.sqrt(square)


@wp.func
def between(into_0: wp.vec3d, into_1: wp.vec3d, out_0: wp.vec3d, out_1: wp.vec3d) -> wp.mat22d:
    """Return the matrix that turns components along `out` into components along `into`."""
    return wp.mat22d(wp.dot(into_0, out_0), wp.dot(into_0, out_1), wp.dot(into_1, out_0), wp.dot(into_1, out_1))


@wp.kernel
def perpendicular_kernel(direction: wp.array[wp.vec3d], normal: wp.array[wp.vec3d], axis_out: wp.array[wp.vec3d]):
    """Write `perpendicular` of each row. Launch: dim=(N,)."""
    row = wp.tid()
    axis_out[row] = perpendicular(direction[row], normal[row])


@wp.struct
class PathPoints:
    """Links and points of P paths."""

    link: wp.array[int]
    """Link of each path, shape [P]."""
    tx: wp.array[wp.vec3d]
    """Transmitter of each link [m], shape [L]."""
    rx: wp.array[wp.vec3d]
    """Receiver [m], shape [L]."""
    tx_velocity: wp.array[wp.vec3d]
    """Velocity of the transmitter [m/s], shape [L]."""
    rx_velocity: wp.array[wp.vec3d]
    """Velocity of the receiver [m/s], shape [L]."""
    kind: wp.array2d[int]
    """Kind of each interaction, 0 behind the last, shape [P, D]."""
    vertex: wp.array2d[wp.vec3d]
    """Point of each interaction [m], shape [P, D]."""
    normal: wp.array2d[wp.vec3d]
    """Unit normal there, shape [P, D]."""
    edge: wp.array2d[wp.vec3d]
    """Unit vector along the edge of each diffraction, shape [P, D]; empty without any."""
    body: wp.array2d[int]
    """Body that carries each interaction, -1 for none, shape [P, D]; empty where nothing that paths meet moves."""
    pose: wp.array[wp.transformd]
    """Pose of each body, shape [B]."""
    body_velocity: wp.array[wp.vec3d]
    """Velocity of each body [m/s], shape [B]."""
    body_rate: wp.array[wp.vec3d]
    """Angular velocity of each body [rad/s], shape [B]."""


@wp.struct
class PathBases:
    """Geometry of P paths, as the fields of `mmw.physics.em.field.PathGeometry`."""

    direction: wp.array2d[wp.vec3d]
    segment_length: wp.array2d[wp.float64]
    cosine: wp.array2d[wp.float64]
    incoming: wp.array3d[wp.vec3d]
    turn: wp.array2d[wp.mat22d]
    ends: wp.array2d[wp.vec3d]
    angles: wp.array2d[wp.vec2d]
    rate: wp.array[wp.float64]
    length: wp.array[wp.float64]


@wp.func
def range_rate(points: PathPoints, geometry: PathBases, path: int) -> wp.float64:
    """Return d(length)/dt of a path [m/s]: a point of a rigid body has the velocity v + w x r.

    Source: first-order Doppler, Sionna RT 2.2 technical report.
    """
    link = points.link[path]
    rate = -wp.dot(points.tx_velocity[link], geometry.ends[path, 0])
    rate = rate - wp.dot(points.rx_velocity[link], geometry.ends[path, 1])
    for step in range(points.body.shape[1]):
        own = points.body[path, step]
        if own >= 0:
            arm = points.vertex[path, step] - wp.transform_get_translation(points.pose[own])
            moving = points.body_velocity[own] + wp.cross(points.body_rate[own], arm)
            rate = rate + wp.dot(moving, geometry.direction[path, step] - geometry.direction[path, step + 1])
    return rate


@wp.kernel
def path_geometry_kernel(points: PathPoints, geometry_out: PathBases):
    """Write the geometry of each path. Launch: dim=(P,)."""
    path = wp.tid()
    depth = points.kind.shape[1]
    order = wp.int32(0)
    for step in range(depth):
        if points.kind[path, step] != 0:
            order = order + 1
    point = points.tx[points.link[path]]
    direction = wp.vec3d(ZERO, ZERO, ZERO)
    total = ZERO
    for step in range(depth + 1):
        target = points.rx[points.link[path]]
        if step < order:
            target = points.vertex[path, step]
        span = target - point
        point = target
        length = wp.length(span)
        geometry_out.segment_length[path, step] = length
        total = total + length
        if step <= order:
            direction = span
            if length > ZERO:
                direction = span / length
        geometry_out.direction[path, step] = direction
    geometry_out.length[path] = total
    geometry_out.ends[path, 0] = geometry_out.direction[path, 0]
    geometry_out.ends[path, 1] = -direction
    geometry_out.rate[path] = range_rate(points, geometry_out, path)
    leaving, arriving = direction_angles(geometry_out.direction[path, 0]), direction_angles(-direction)
    geometry_out.angles[path, 0] = leaving
    geometry_out.angles[path, 1] = arriving
    last_0, last_1 = zenith_vector(arriving), azimuth_vector(arriving)
    out_0, out_1 = zenith_vector(leaving), azimuth_vector(leaving)
    for step in range(depth):
        into_0, into_1 = last_0, last_1
        next_0, next_1 = last_0, last_1
        cosine = ONE
        if step < order:
            k_in, k_out = geometry_out.direction[path, step], geometry_out.direction[path, step + 1]
            if points.kind[path, step] == DIFFRACTION:
                into_0 = perpendicular(k_in, points.edge[path, step])
                next_0 = -perpendicular(k_out, points.edge[path, step])
            else:
                facing = points.normal[path, step]
                into_0 = perpendicular(k_in, facing)
                next_0 = into_0
                cosine = wp.min(wp.abs(wp.dot(k_in, facing)), ONE)
            into_1, next_1 = wp.cross(k_in, into_0), wp.cross(k_out, next_0)
            if points.kind[path, step] == DIFFUSE:
                before, behind = direction_angles(k_in), direction_angles(k_out)
                into_0, into_1 = zenith_vector(before), azimuth_vector(before)
                next_0, next_1 = zenith_vector(behind), azimuth_vector(behind)
        geometry_out.cosine[path, step] = cosine
        geometry_out.incoming[path, step, 0] = into_0
        geometry_out.incoming[path, step, 1] = into_1
        turn = wp.mat22d(ONE, ZERO, ZERO, ONE)
        if step <= order:
            turn = between(into_0, into_1, out_0, out_1)
        geometry_out.turn[path, step] = turn
        out_0, out_1 = next_0, next_1
    turn = wp.mat22d(ONE, ZERO, ZERO, ONE)
    if order == depth:
        turn = between(last_0, last_1, out_0, out_1)
    geometry_out.turn[path, depth] = turn
