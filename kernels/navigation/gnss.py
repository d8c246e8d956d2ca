"""Readings of satellite navigation receivers, see `mmw.sensors.gnss.error_models`: a thread makes one sample."""

import warp as wp

from mmw.kernels.core.body_motion import pose_at, velocity_at
from mmw.kernels.core.compiler import AS_NUMPY
from mmw.kernels.core.geodesy import MERCATOR, EarthMap, full_circle, heading_of, to_geodetic
from mmw.kernels.core.random_series import white4
from mmw.kernels.navigation.mounted import Mounted, Samples, mounted_track

wp.set_module_options(AS_NUMPY)


@wp.struct
class GnssModel:
    """Errors of a receiver: those of CARLA, of which the earth is `MERCATOR`, or a physical model."""

    noise_std: wp.vec3d
    """White noise of the position: latitude, longitude [deg], altitude [m], or along the world's axes [m]."""
    drift_std: wp.vec3d
    """Spread of the drift along the world's axes [m]; physical alone."""
    speed_std: wp.float64
    """White noise of the speed, along the motion, or of each axis of the velocity [m/s]."""
    heading_std: wp.float64
    """White noise of the heading [rad]."""
    slowest: wp.float64
    """Speed from which motion has a direction [m/s]."""


@wp.kernel
def gnss_kernel(
    samples: Samples,
    mounted: Mounted,
    drift: wp.array[wp.vec3d],
    model: GnssModel,
    earth: EarthMap,
    # out
    values_out: wp.array2d[wp.float64],
):
    """Make samples.

    Launch: dim=(samples)

    Args:
        samples: Poses, and instants of the samples.
        mounted: The sensor of each sample.
        drift: Drift of each sample, of spread 1, shape [N]; not read with `MERCATOR`.
        model: The errors.
        earth: How the world lies on the earth.
        values_out: Measured latitude [deg], longitude [deg] and altitude [m], the true ones, velocity [m/s], speed
            [m/s] and heading [rad], shape [11, N].
    """
    index = wp.tid()
    row = samples.row[index]
    track = mounted_track(samples, mounted, index)
    pose = pose_at(track, row)
    velocity = velocity_at(track, row)
    heading = heading_of(pose.attitude)
    one = white4(mounted.key[index], samples.frame[index], samples.part[index], 0)
    two = white4(mounted.key[index], samples.frame[index], samples.part[index], 1)
    noise = wp.cw_mul(model.noise_std, wp.vec3d(one[0], one[1], one[2]))
    true = to_geodetic(earth, pose.position)
    measured = true
    speed = wp.float64(0.0)
    if earth.kind == MERCATOR:
        measured = true + noise
        true_speed = wp.sqrt(velocity[0] * velocity[0] + velocity[1] * velocity[1])
        error = model.speed_std * one[3]
        along = wp.vec3d(wp.sin(heading), wp.cos(heading), wp.float64(0.0))
        if true_speed >= model.slowest:
            along = wp.vec3d(velocity[0] / true_speed, velocity[1] / true_speed, wp.float64(0.0))
        velocity = velocity + error * along
        speed = true_speed + error
    else:
        measured = to_geodetic(earth, pose.position + wp.cw_mul(model.drift_std, drift[index]) + noise)
        velocity = velocity + model.speed_std * wp.vec3d(one[3], two[0], two[1])
        speed = wp.sqrt(velocity[0] * velocity[0] + velocity[1] * velocity[1])
    for axis in range(3):
        values_out[axis, index] = measured[axis]
        values_out[3 + axis, index] = true[axis]
        values_out[6 + axis, index] = velocity[axis]
    values_out[9, index] = speed
    values_out[10, index] = full_circle(heading + model.heading_std * two[2])
