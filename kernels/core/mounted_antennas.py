"""Place antennas on moving bodies, on the host in float64."""

import warp as wp

from mmw.kernels.core.compiler import AS_NUMPY
from mmw.kernels.core.quaternions import normalized

wp.set_module_options(AS_NUMPY)


@wp.struct
class MountedAntennas:
    """Antennas, an entry each."""

    pose: wp.array[wp.transformd]
    """Pose of the body in the world; the quaternion need not be a unit one."""
    velocity: wp.array[wp.vec3d]
    """Velocity of the body's origin [m/s]."""
    rate: wp.array[wp.vec3d]
    """Angular velocity of the body in the world frame [rad/s]."""
    place: wp.array[wp.vec3d]
    """Place in the frame of the body [m]."""


@wp.struct
class AntennaStates:
    """Antennas in the world, an entry each."""

    position: wp.array[wp.vec3d]
    """Place [m]."""
    rotation: wp.array[wp.mat33d]
    """Body-to-world rotation."""
    velocity: wp.array[wp.vec3d]
    """Velocity [m/s]."""


@wp.kernel
def mounted_antennas_kernel(antennas: MountedAntennas, states_out: AntennaStates):
    """Compute place, rotation and velocity: those of a rigid body, v + w x r. Launch: dim=N."""
    row = wp.tid()
    one = wp.float64(1.0)
    two = wp.float64(2.0)
    pose = antennas.pose[row]
    unit = normalized(wp.vec4d(pose[3], pose[4], pose[5], pose[6]))
    x = unit[0]
    y = unit[1]
    z = unit[2]
    w = unit[3]
    turn = wp.mat33d(
        one - two * (y * y + z * z),
        two * (x * y - z * w),
        two * (x * z + y * w),
        two * (x * y + z * w),
        one - two * (x * x + z * z),
        two * (y * z - x * w),
        two * (x * z - y * w),
        two * (y * z + x * w),
        one - two * (x * x + y * y),
    )
    at = antennas.place[row]
    lever = wp.vec3d(
        turn[0, 0] * at[0] + turn[0, 1] * at[1] + turn[0, 2] * at[2],
        turn[1, 0] * at[0] + turn[1, 1] * at[1] + turn[1, 2] * at[2],
        turn[2, 0] * at[0] + turn[2, 1] * at[1] + turn[2, 2] * at[2],
    )
    states_out.position[row] = wp.vec3d(pose[0] + lever[0], pose[1] + lever[1], pose[2] + lever[2])
    states_out.rotation[row] = turn
    states_out.velocity[row] = antennas.velocity[row] + wp.cross(antennas.rate[row], lever)
