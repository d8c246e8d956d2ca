"""Place sensors, points and boxes on bodies by the bodies' poses, on the host in float64.

A pose is body to world, (x, y, z, qx, qy, qz, qw); its quaternion need not be a unit one.
"""

import warp as wp

from mmw.kernels.core.compiler import AS_NUMPY
from mmw.kernels.core.quaternions import normalized, product, rotated

wp.set_module_options(AS_NUMPY)


@wp.func
def position_of(pose: wp.array2d[wp.float64], row: int) -> wp.vec3d:
    """Return the position of a pose."""
    return wp.vec3d(pose[row, 0], pose[row, 1], pose[row, 2])


@wp.func
def attitude_of(pose: wp.array2d[wp.float64], row: int) -> wp.vec4d:
    """Return the attitude of a pose, unit."""
    return normalized(wp.vec4d(pose[row, 3], pose[row, 4], pose[row, 5], pose[row, 6]))


@wp.func
def is_zero(pose: wp.array2d[wp.float64], row: int) -> bool:
    """Return whether the quaternion of a pose is zero, which is no rotation."""
    zero = wp.float64(0.0)
    return pose[row, 3] == zero and pose[row, 4] == zero and pose[row, 5] == zero and pose[row, 6] == zero


@wp.kernel
def mounted_poses_kernel(
    body: wp.array2d[wp.float64],
    mount: wp.array2d[wp.float64],
    # out
    pose_out: wp.array2d[wp.float64],
    is_present_out: wp.array[bool],
    zeros_out: wp.array[int],
):
    """Compose the poses of sensors with those of their bodies.

    Launch: dim=(poses)

    Args:
        body: Bodies to world, NaN where absent, shape [N, 7].
        mount: Sensors to bodies, which come again and again, shape [n, 7].
        pose_out: Sensors to world, shape [N, 7].
        is_present_out: Whether the body is there, shape [N].
        zeros_out: 1 if a quaternion is zero, else as it was, shape [1].
    """
    row = wp.tid()
    own = row % mount.shape[0]
    attitude = attitude_of(body, row)
    place = rotated(attitude, position_of(mount, own)) + position_of(body, row)
    turn = product(attitude, wp.vec4d(mount[own, 3], mount[own, 4], mount[own, 5], mount[own, 6]))
    is_present = True
    for axis in range(7):
        is_present = is_present and wp.isfinite(body[row, axis])
    for axis in range(3):
        pose_out[row, axis] = place[axis]
    for axis in range(4):
        pose_out[row, 3 + axis] = turn[axis]
    is_present_out[row] = is_present
    if is_zero(body, row):
        zeros_out[0] = 1


@wp.kernel
def points_kernel(
    body: wp.array2d[wp.float64],
    local: wp.array[wp.vec3d],
    # out
    point_out: wp.array[wp.vec3d],
):
    """Place points on bodies.

    Launch: dim=(points)

    Args:
        body: Body of each point to world, shape [N, 7].
        local: Points in the frames of the bodies [m], shape [N].
        point_out: Points in the world [m], shape [N].
    """
    row = wp.tid()
    point_out[row] = rotated(attitude_of(body, row), local[row]) + position_of(body, row)


@wp.kernel
def boxes_kernel(
    body: wp.array2d[wp.float64],
    velocity: wp.array[wp.vec3d],
    rate: wp.array[wp.vec3d],
    middle: wp.array[wp.vec3d],
    # out
    values_out: wp.array2d[wp.float64],
):
    """Compute boxes around bodies.

    Launch: dim=(boxes)

    Args:
        body: Bodies to world, shape [N, 7].
        velocity: Velocity of the bodies' origins, world frame [m/s], shape [N].
        rate: Angular velocity of the bodies, world frame [rad/s], shape [N].
        middle: Middles of the boxes in the frames of the bodies [m], shape [N].
        values_out: Position of the middle [m], attitude, yaw, pitch, roll [rad] and velocity of the middle [m/s],
            shape [13, N].
    """
    row = wp.tid()
    attitude = attitude_of(body, row)
    one = wp.float64(1.0)
    two = wp.float64(2.0)
    x = attitude[0]
    y = attitude[1]
    z = attitude[2]
    w = attitude[3]
    lever = rotated(attitude, middle[row])
    place = lever + position_of(body, row)
    moving = velocity[row] + wp.cross(rate[row], lever)
    forward_x = one - two * (y * y + z * z)
    forward_y = two * (x * y + z * w)
    forward_z = two * (x * z - y * w)
    across = wp.sqrt(forward_x * forward_x + forward_y * forward_y)
    for axis in range(3):
        values_out[axis, row] = place[axis]
        values_out[10 + axis, row] = moving[axis]
    for axis in range(4):
        values_out[3 + axis, row] = attitude[axis]
    values_out[7, row] = wp.atan2(forward_y, forward_x)
    # atan2 has full precision near +-90 deg, where an arcsine would lose half of the digits.
    values_out[8, row] = wp.atan2(-forward_z, across)
    values_out[9, row] = wp.atan2(two * (y * z + x * w), one - two * (x * x + y * y))
