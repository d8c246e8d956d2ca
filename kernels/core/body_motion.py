"""Motion of bodies on the host in float64: derivatives by differences of poses, and what a device takes of both.

The formulas are those of `mmw.core.kinematics`.
"""

import warp as wp

from mmw.kernels.core.compiler import AS_NUMPY

wp.set_module_options(AS_NUMPY)

REACH_ROWS = wp.constant(4)
"""Poses of the polynomial that extrapolates a missing one."""


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
def presence_about(poses: wp.array3d[wp.float64], row: int, body: int) -> int:
    """Return bit `REACH_ROWS` + k for every k from -`REACH_ROWS` to `REACH_ROWS` where row + k has a pose."""
    found = wp.int32(0)
    bit = wp.int32(0)
    while bit <= 2 * REACH_ROWS:
        if has_pose(poses, row + bit - REACH_ROWS, body):
            found = found | (1 << bit)
        bit = bit + 1
    return found


@wp.func
def is_there(presence: int, k: int) -> bool:
    """Return whether there is a pose k rows after the one that `presence_about` was told of."""
    return (presence >> (k + REACH_ROWS)) & 1 == 1


@wp.func
def position_of(poses: wp.array3d[wp.float64], row: int, body: int) -> wp.vec3d:
    """Return where a body is [m]."""
    return wp.vec3d(poses[row, body, 0], poses[row, body, 1], poses[row, body, 2])


@wp.func
def attitude_of(poses: wp.array3d[wp.float64], row: int, body: int) -> wp.vec4d:
    """Return the unit quaternion of a body; NaN where it has none."""
    x = poses[row, body, 3]
    y = poses[row, body, 4]
    z = poses[row, body, 5]
    w = poses[row, body, 6]
    length = wp.sqrt(x * x + y * y + z * z + w * w)
    return wp.vec4d(x / length, y / length, z / length, w / length)


@wp.func
def cross_of(ax: wp.float64, ay: wp.float64, az: wp.float64, b: wp.vec3d) -> wp.vec3d:
    """Return the vector product."""
    return wp.vec3d(ay * b[2] - az * b[1], az * b[0] - ax * b[2], ax * b[1] - ay * b[0])


@wp.func
def mean_rate(a: wp.vec4d, b: wp.vec4d, dt: wp.float64) -> wp.vec3d:
    """Return the mean body rate between two attitudes [rad/s]: log(a^-1 b) / dt."""
    x = (a[3] * b[0] + b[3] * -a[0]) + (-a[1] * b[2] - -a[2] * b[1])
    y = (a[3] * b[1] + b[3] * -a[1]) + (-a[2] * b[0] - -a[0] * b[2])
    z = (a[3] * b[2] + b[3] * -a[2]) + (-a[0] * b[1] - -a[1] * b[0])
    w = a[3] * b[3] - (-a[0] * b[0] + -a[1] * b[1] + -a[2] * b[2])
    if w < wp.float64(0.0):
        x = -x
        y = -y
        z = -z
        w = -w
    sine = wp.sqrt(x * x + y * y + z * z)
    scale = wp.float64(2.0)  # near zero, angle / sine to double precision
    if sine > wp.float64(1.0e-12):
        scale = wp.float64(2.0) * wp.atan2(sine, w) / sine
    return wp.vec3d(x * scale / dt, y * scale / dt, z * scale / dt)


@wp.func
def rate_between(poses: wp.array3d[wp.float64], row: int, body: int, dt: wp.float64) -> wp.vec3d:
    """Return the mean body rate from a row to the next one [rad/s]."""
    return mean_rate(attitude_of(poses, row, body), attitude_of(poses, row + 1, body), dt)


@wp.func
def rate_beside(
    poses: wp.array3d[wp.float64], presence: int, row: int, body: int, side: int, dt: wp.float64
) -> wp.vec3d:
    """Return the mean body rate from a row to the one before it or after it (`side` -1 or 1), which may be missing.

    It is extrapolated by a constant angular acceleration then, from the other side.
    """
    begin = row + (side - 1) // 2
    is_known = is_there(presence, side)
    if not is_known:
        begin = begin - side
        if not is_there(presence, -side):
            return wp.vec3d()
    rate = rate_between(poses, begin, body, dt)
    if is_known or not is_there(presence, -2 * side):
        return rate
    other = rate_between(poses, begin - side, body, dt)
    two = wp.float64(2.0)
    return wp.vec3d(two * rate[0] - other[0], two * rate[1] - other[1], two * rate[2] - other[2])


@wp.func
def extrapolation_weight(count: int, k: int) -> wp.float64:
    """Return the weight of the k-th of `count` samples that extrapolate their polynomial one step backward.

    It is (-1)^k times the binomial coefficient of `count` over k + 1.
    """
    weight = wp.float64(1.0)
    for i in range(k + 1):
        weight = weight * wp.float64(count - i) / wp.float64(i + 1)
    if k % 2 == 1:
        weight = -weight
    return weight


@wp.func
def position_beside(poses: wp.array3d[wp.float64], presence: int, row: int, body: int, side: int) -> wp.vec3d:
    """Return where a body is in the row before or after one (`side` -1 or 1), which may be missing [m].

    It is extrapolated by the cubic through the nearest four then, a lower one for fewer; with differences to the
    nearest, a body at rest is exactly at rest.
    """
    if is_there(presence, side):
        return position_of(poses, row + side, body)
    here = position_of(poses, row, body)
    count = wp.int32(1)
    while count < REACH_ROWS and is_there(presence, -count * side):
        count = count + 1
    x = wp.float64(0.0)
    y = wp.float64(0.0)
    z = wp.float64(0.0)
    for k in range(1, count):
        weight = extrapolation_weight(count, k)
        other = position_of(poses, row - k * side, body)
        x = x + weight * (other[0] - here[0])
        y = y + weight * (other[1] - here[1])
        z = z + weight * (other[2] - here[2])
    return wp.vec3d(here[0] + x, here[1] + y, here[2] + z)


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
    presence = presence_about(poses, row, body)
    if not is_there(presence, 0):
        none = wp.float64(wp.nan)
        for kind in range(4):
            derivatives_out[kind, index, body] = wp.vec3d(none, none, none)
        return
    q = attitude_of(poses, row, body)
    if wp.isnan(q[0]):
        zero_out[0] = 1
    two = wp.float64(2.0)
    here = position_of(poses, row, body)
    velocity = wp.vec3d()
    acceleration = wp.vec3d()
    rate = wp.vec3d()
    side = wp.int32(-1)
    while side <= 1:  # a loop compiles faster than twice the code
        place = position_beside(poses, presence, row, body, side)
        mean = rate_beside(poses, presence, row, body, side, dt)
        if side < 0:
            velocity = place
            rate = mean
        else:
            for axis in range(3):
                acceleration[axis] = (place[axis] - two * here[axis] + velocity[axis]) / (dt * dt)
                velocity[axis] = (place[axis] - velocity[axis]) / (two * dt)
                rate[axis] = wp.float64(0.5) * (rate[axis] + mean[axis])
        side = side + 2
    turned = cross_of(q[0], q[1], q[2], rate)
    twice = wp.vec3d(two * turned[0], two * turned[1], two * turned[2])
    again = cross_of(q[0], q[1], q[2], twice)
    derivatives_out[0, index, body] = velocity
    derivatives_out[1, index, body] = acceleration
    derivatives_out[2, index, body] = rate
    derivatives_out[3, index, body] = wp.vec3d(
        rate[0] + q[3] * twice[0] + again[0],
        rate[1] + q[3] * twice[1] + again[1],
        rate[2] + q[3] * twice[2] + again[2],
    )


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
