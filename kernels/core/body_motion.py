"""Motion of bodies on the host in float64: derivatives by differences of poses, and what a device takes of both.

The formulas are those of `mmw.core.kinematics`. A thread looks at one body, or at one sensor on a body, in one frame:
its neighbors, and at an open end the nearest four frames.
"""

import warp as wp

from mmw.kernels.core.compiler import AS_NUMPY
from mmw.kernels.core.quaternions import conjugated, normalized, product, rotated, rotation_vector

wp.set_module_options(AS_NUMPY)


@wp.struct
class Track:
    """Poses of bodies in consecutive frames, and of one sensor on one of them."""

    poses: wp.array3d[wp.float64]
    """Body to world (x, y, z, qx, qy, qz, qw), shape [F, N, 7]; NaN where absent."""
    body: int
    """The body."""
    is_mounted: bool
    """True if the pose of a sensor on the body counts, false for the body's own."""
    position: wp.vec3d
    """Position of the sensor on the body [m]."""
    attitude: wp.vec4d
    """Attitude of the sensor on the body."""
    dt: wp.float64
    """Time between frames [s]."""


@wp.struct
class RigidPose:
    """Body or sensor to world."""

    position: wp.vec3d
    """Position [m]."""
    attitude: wp.vec4d
    """Attitude, (x, y, z, w)."""


@wp.struct
class Derivatives:
    """Derivatives of a series of poses at one frame."""

    velocity: wp.vec3d
    """World frame [m/s]."""
    acceleration: wp.vec3d
    """World frame [m/s^2]."""
    body_rate: wp.vec3d
    """Angular velocity in the body's frame [rad/s]."""
    world_rate: wp.vec3d
    """Angular velocity in the world frame [rad/s]."""


@wp.func
def has_pose(poses: wp.array3d[wp.float64], row: int, body: int) -> bool:
    """Return whether there is a pose in a row, which may be none of the array: all its numbers are finite."""
    if row < 0 or row >= poses.shape[0]:
        return False
    total = wp.float64(0.0)  # of zeros, NaN with a number that is not finite
    for axis in range(7):
        total = total + wp.float64(0.0) * poses[row, body, axis]
    return total == wp.float64(0.0)


@wp.func
def position_of(poses: wp.array3d[wp.float64], row: int, body: int) -> wp.vec3d:
    """Return where a body is [m]."""
    return wp.vec3d(poses[row, body, 0], poses[row, body, 1], poses[row, body, 2])


@wp.func
def attitude_of(poses: wp.array3d[wp.float64], row: int, body: int) -> wp.vec4d:
    """Return the unit quaternion of a body; NaN where it has none."""
    return normalized(wp.vec4d(poses[row, body, 3], poses[row, body, 4], poses[row, body, 5], poses[row, body, 6]))


@wp.func
def is_present(track: Track, row: int) -> bool:
    """Return whether a body is there in a row, which may be none of the array."""
    return has_pose(track.poses, row, track.body)


@wp.func
def position_at(track: Track, row: int) -> wp.vec3d:
    """Return the position of a body or of the sensor on it in a frame [m], world frame."""
    origin = position_of(track.poses, row, track.body)
    if track.is_mounted:
        origin = rotated(attitude_of(track.poses, row, track.body), track.position) + origin
    return origin


@wp.func
def pose_at(track: Track, row: int) -> RigidPose:
    """Return the pose of a body or of the sensor on it in a frame."""
    pose = RigidPose()
    pose.position = position_at(track, row)
    pose.attitude = attitude_of(track.poses, row, track.body)
    if track.is_mounted:
        pose.attitude = product(pose.attitude, track.attitude)
    return pose


@wp.func
def unit_attitude(track: Track, row: int) -> wp.vec4d:
    """Return the attitude of a body or of the sensor on it in a frame, unit."""
    result = attitude_of(track.poses, row, track.body)
    if track.is_mounted:
        result = normalized(product(result, track.attitude))
    return result


@wp.func
def position_beyond(track: Track, row: int, step: int) -> wp.vec3d:
    """Return the position one frame beyond an open end, by the cubic through the nearest four (lower for fewer) [m].

    With differences to the end itself a body at rest is exactly at rest.

    Args:
        track: The body.
        row: The end, where it is present.
        step: 1 for the frame after it, -1 for the frame before it.
    """
    first = position_at(track, row)
    result = first
    if is_present(track, row - step):
        one = position_at(track, row - step) - first
        if is_present(track, row - 2 * step):
            two = position_at(track, row - 2 * step) - first
            if is_present(track, row - 3 * step):
                three = position_at(track, row - 3 * step) - first
                result = first + (wp.float64(-6.0) * one + wp.float64(4.0) * two - three)
            else:
                result = first + (wp.float64(-3.0) * one + two)
        else:
            result = first - one
    return result


@wp.func
def position_beside(track: Track, row: int, step: int) -> wp.vec3d:
    """Return the position in the next (1) or the last frame (-1), extrapolated where the body is absent [m]."""
    if is_present(track, row + step):
        return position_at(track, row + step)
    return position_beyond(track, row, step)


@wp.func
def velocity_at(track: Track, row: int) -> wp.vec3d:
    """Return the velocity of a body or of the sensor on it in a frame, world frame [m/s]."""
    return (position_beside(track, row, 1) - position_beside(track, row, -1)) / (wp.float64(2.0) * track.dt)


@wp.func
def acceleration_at(track: Track, row: int) -> wp.vec3d:
    """Return the acceleration of a body or of the sensor on it in a frame, world frame [m/s^2]."""
    twice = wp.float64(2.0) * position_at(track, row)
    return (position_beside(track, row, 1) - twice + position_beside(track, row, -1)) / (track.dt * track.dt)


@wp.func
def mean_rate(before: wp.vec4d, after: wp.vec4d, dt: wp.float64) -> wp.vec3d:
    """Return the mean body rate between two attitudes [rad/s]."""
    return rotation_vector(product(conjugated(before), after)) / dt


@wp.func
def body_rate_at(track: Track, row: int, attitude: wp.vec4d) -> wp.vec3d:
    """Return the angular velocity of a body or of the sensor on it in its own frame [rad/s]; NaN where absent.

    Args:
        track: The body.
        row: The frame.
        attitude: `unit_attitude` there.
    """
    if not is_present(track, row):
        return wp.vec3d(wp.float64(wp.NAN))
    has_before = is_present(track, row - 1)
    has_after = is_present(track, row + 1)
    before = wp.vec3d()
    after = wp.vec3d()
    if has_before:
        before = mean_rate(unit_attitude(track, row - 1), attitude, track.dt)
    if has_after:
        after = mean_rate(attitude, unit_attitude(track, row + 1), track.dt)
    if has_before and not has_after:  # constant angular acceleration beyond an open end
        second = before
        if is_present(track, row - 2):
            second = mean_rate(unit_attitude(track, row - 2), unit_attitude(track, row - 1), track.dt)
        after = wp.float64(2.0) * before - second
    if has_after and not has_before:
        second = after
        if is_present(track, row + 2):
            second = mean_rate(unit_attitude(track, row + 1), unit_attitude(track, row + 2), track.dt)
        before = wp.float64(2.0) * after - second
    return wp.float64(0.5) * (before + after)


@wp.func
def derivatives_at(track: Track, row: int) -> Derivatives:
    """Return the derivatives of a body or of the sensor on it in a frame; the body is present there."""
    out = Derivatives()
    before = position_beside(track, row, -1)
    after = position_beside(track, row, 1)
    attitude = unit_attitude(track, row)
    out.velocity = (after - before) / (wp.float64(2.0) * track.dt)
    out.acceleration = (after - wp.float64(2.0) * position_at(track, row) + before) / (track.dt * track.dt)
    out.body_rate = body_rate_at(track, row, attitude)
    out.world_rate = rotated(attitude, out.body_rate)
    return out


@wp.kernel
def differences_kernel(
    poses: wp.array3d[wp.float64],
    first: int,
    dt: wp.float64,
    # out
    derivatives_out: wp.array3d[wp.vec3d],
    zero_out: wp.array[int],
):
    """Differentiate the poses of bodies in the world, shape [F, N, 7], in rows from `first` on; NaN where absent.

    The derivatives are velocity, acceleration, body rate and world rate, shape [4, rows, N]. Where a quaternion of a
    body that is there is zero, 1 is written to `zero_out`. Launch: dim=(rows, N).
    """
    index, body = wp.tid()
    row = first + index
    track = Track()
    track.poses = poses
    track.body = body
    track.dt = dt
    found = Derivatives()
    nowhere = wp.vec3d(wp.float64(wp.NAN))
    found.velocity = nowhere
    found.acceleration = nowhere
    found.body_rate = nowhere
    found.world_rate = nowhere
    if is_present(track, row):
        found = derivatives_at(track, row)
        if wp.isnan(attitude_of(poses, row, body)[0]):
            zero_out[0] = 1
    derivatives_out[0, index, body] = found.velocity
    derivatives_out[1, index, body] = found.acceleration
    derivatives_out[2, index, body] = found.body_rate
    derivatives_out[3, index, body] = found.world_rate


@wp.kernel
def instance_motion_kernel(
    poses: wp.array3d[wp.float64],
    velocity: wp.array2d[wp.vec3d],
    rate: wp.array2d[wp.vec3d],
    actor: wp.array[int],
    origin_x: wp.float64,
    origin_y: wp.float64,
    origin_z: wp.float64,
    # out
    pose_out: wp.array2d[wp.transformf],
    velocity_out: wp.array2d[wp.vec3],
    rate_out: wp.array2d[wp.vec3],
    is_present_out: wp.array2d[wp.bool],
):
    """Write pose and motion of the instances of every frame as a device takes them, in the scene frame and float32.

    Poses of all actors in the world have shape [S, A, 7], their velocities and rates in the world [S, A]; `actor` is
    that of each instance. An instance that is absent, and all after the S frames, are at the origin at rest. Launch:
    dim=(frames, V).
    """
    frame, instance = wp.tid()
    body = actor[instance]
    is_present = has_pose(poses, frame, body)
    is_present_out[frame, instance] = is_present
    if not is_present:
        pose_out[frame, instance] = wp.transform_identity()
        velocity_out[frame, instance] = wp.vec3()
        rate_out[frame, instance] = wp.vec3()
        return
    at = position_of(poses, frame, body)
    q = attitude_of(poses, frame, body)
    pose_out[frame, instance] = wp.transformf(
        wp.vec3(wp.float32(at[0] - origin_x), wp.float32(at[1] - origin_y), wp.float32(at[2] - origin_z)),
        wp.quat(wp.float32(q[0]), wp.float32(q[1]), wp.float32(q[2]), wp.float32(q[3])),
    )
    v = velocity[frame, body]
    w = rate[frame, body]
    velocity_out[frame, instance] = wp.vec3(wp.float32(v[0]), wp.float32(v[1]), wp.float32(v[2]))
    rate_out[frame, instance] = wp.vec3(wp.float32(w[0]), wp.float32(w[1]), wp.float32(w[2]))
