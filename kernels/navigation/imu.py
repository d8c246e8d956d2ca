"""Readings of inertial measurement units, see `mmw.sensors.imu.simulate`: a thread makes one sample."""

import warp as wp

from mmw.kernels.core.body_motion import acceleration_at, body_rate_at, is_present, pose_at, unit_attitude
from mmw.kernels.core.compiler import AS_NUMPY
from mmw.kernels.core.geodesy import heading_of
from mmw.kernels.core.quaternions import conjugated, rotated
from mmw.kernels.core.random_series import white4
from mmw.kernels.navigation.mounted import Mounted, Samples, mounted_track

wp.set_module_options(AS_NUMPY)


@wp.struct
class ImuModel:
    """Errors and habits of an inertial measurement unit."""

    accel_std: wp.float64
    """White noise of a sample [m/s^2]."""
    gyro_std: wp.float64
    """White noise of a sample [rad/s]."""
    gravity: wp.float64
    """Specific force at rest [m/s^2]."""
    is_left_handed: bool
    """True if axes are x forward, y right, z up."""
    lag: int
    """Rows of poses by which the acceleration is late."""


@wp.func
def late_acceleration(samples: Samples, mounted: Mounted, index: int, row: int, lag: int) -> wp.vec3d:
    """Return the acceleration that counts in a frame if it is late by some rows, world frame [m/s^2].

    That of an earlier row counts where it has both neighbors: an extrapolated one would bring later frames into it.
    """
    track = mounted_track(samples, mounted, index)
    at = row
    if is_present(track, row - lag - 1) and is_present(track, row - lag) and is_present(track, row - lag + 1):
        at = row - lag
    return acceleration_at(track, at)


@wp.func
def put(values: wp.array2d[wp.float64], first: int, index: int, vector: wp.vec3d):
    """Write a vector to three columns."""
    values[first, index] = vector[0]
    values[first + 1, index] = vector[1]
    values[first + 2, index] = vector[2]


@wp.kernel
def imu_kernel(
    samples: Samples,
    mounted: Mounted,
    distortion: wp.array2d[wp.mat33d],
    bias: wp.array2d[wp.vec3d],
    model: ImuModel,
    # out
    values_out: wp.array2d[wp.float64],
):
    """Make samples.

    Launch: dim=(samples)

    Args:
        samples: Poses, and instants of the samples.
        mounted: The sensor of each sample.
        distortion: True to read axes of accelerometer and gyroscope of each sample, or of all, shape [N, 2] or [1, 2].
        bias: Bias of both, shape [N, 2] or [1, 2] [m/s^2, rad/s].
        model: The errors.
        values_out: Measured and true force and rate, both biases, three columns each, and compass, shape [19, N].
    """
    index = wp.tid()
    row = samples.row[index]
    track = mounted_track(samples, mounted, index)
    pose = pose_at(track, row)
    to_sensor = conjugated(pose.attitude)
    upward = wp.vec3d(wp.float64(0.0), wp.float64(0.0), model.gravity)
    force = rotated(to_sensor, acceleration_at(track, row) + upward)
    rate = body_rate_at(track, row, unit_attitude(track, row))
    late = force
    if model.lag > 0:
        late = rotated(to_sensor, late_acceleration(samples, mounted, index, row, model.lag) + upward)
    if model.is_left_handed:  # mirrored polar and axial vectors
        force = wp.vec3d(force[0], -force[1], force[2])
        late = wp.vec3d(late[0], -late[1], late[2])
        rate = wp.vec3d(-rate[0], rate[1], -rate[2])
    own = wp.where(distortion.shape[0] > 1, index, 0)
    at = wp.where(bias.shape[0] > 1, index, 0)
    one = white4(mounted.key[index], samples.frame[index], samples.part[index], 0)
    two = white4(mounted.key[index], samples.frame[index], samples.part[index], 1)
    force_noise = model.accel_std * wp.vec3d(one[0], one[1], one[2])
    rate_noise = model.gyro_std * wp.vec3d(one[3], two[0], two[1])
    put(values_out, 0, index, distortion[own, 0] * late + bias[at, 0] + force_noise)
    put(values_out, 3, index, distortion[own, 1] * rate + bias[at, 1] + rate_noise)
    put(values_out, 6, index, force)
    put(values_out, 9, index, rate)
    put(values_out, 12, index, bias[at, 0])
    put(values_out, 15, index, bias[at, 1])
    values_out[18, index] = heading_of(pose.attitude)
