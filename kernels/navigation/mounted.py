"""Sensors on agents at the instants of their samples: what the kernels of this folder have in common."""

import warp as wp

from mmw.kernels.core.body_motion import Track
from mmw.kernels.core.compiler import AS_NUMPY

wp.set_module_options(AS_NUMPY)


@wp.struct
class Samples:
    """Instants of N samples of a sensor, and the poses around them."""

    poses: wp.array3d[wp.float64]
    """Actors to world (x, y, z, qx, qy, qz, qw) in consecutive rows, shape [P, V, 7]; NaN where absent."""
    row: wp.array[int]
    """Row of each sample, shape [N]."""
    frame: wp.array[int]
    """Frame of 100 Hz at or before each sample, shape [N]."""
    part: wp.array[int]
    """Milliseconds since then, shape [N]."""


@wp.struct
class Mounted:
    """The agent and the mount of each sample."""

    actor: wp.array[int]
    """Actor that carries the sensor, shape [N]."""
    position: wp.array[wp.vec3d]
    """Position of the sensor on it [m], shape [N]."""
    attitude: wp.array[wp.vec4d]
    """Attitude of the sensor on it, shape [N]."""
    key: wp.array[wp.vec2ui]
    """Key of its white noise, shape [N]."""
    dt: wp.float64
    """Time between rows of poses [s]."""


@wp.func
def mounted_track(samples: Samples, mounted: Mounted, index: int) -> Track:
    """Return the way of the sensor of a sample."""
    track = Track()
    track.poses = samples.poses
    track.body = mounted.actor[index]
    track.is_mounted = True
    track.position = mounted.position[index]
    track.attitude = mounted.attitude[index]
    track.dt = mounted.dt
    return track
