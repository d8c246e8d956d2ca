"""Trace the first hits of all LiDAR rays. Geometry only, so it serves every weather."""

import warp as wp

from mmw.kernels.core.compiler import FINITE
from mmw.kernels.core.first_hits import store_hit
from mmw.kernels.core.rigid_motion import moved_pose
from mmw.kernels.core.structs import Scene, Views
from mmw.kernels.core.trace import TRACE_REGISTERS, closest_hit, closest_hit_at

wp.set_module_options(
    {
        "enable_backward": False,
        "default_grid_stride": False,
        "fast_math": False,
        "fuse_fp": False,  # poses turn rays to the same bits on CUDA and on a CPU, where Warp's compiler fuses nothing
        "cpu_compiler_flags": FINITE,
    }
)


@wp.struct
class LidarRays:
    """First hits of every ray of every view, shape [A, R]."""

    range: wp.array2d[float]
    """Distance [m], inf for none."""
    cos_incidence: wp.array2d[float]
    """Cosine of the angle between ray and surface normal, 0 to 1."""
    object_id: wp.array2d[int]
    """Object that is hit, -1 for none."""
    material_id: wp.array2d[int]
    """Its material, -1 for none."""


@wp.struct
class Sweep:
    """Firing times of the rays of a turn, and the motion of the sensors meanwhile."""

    duration_s: float
    """Length of the turn, which ends at the frame's instant [s]; 0 for a still picture, all rays at that instant."""
    points_per_channel: int
    """Firings of the turn."""
    velocity: wp.array[wp.vec3]
    """Velocity of each view's sensor, scene frame [m/s], shape [A]; empty for a still picture."""
    rate: wp.array[wp.vec3]
    """Angular velocity of each view's sensor about the axes of the scene frame [rad/s], shape [A]; empty likewise."""


@wp.func
def firing_offset(sweep: Sweep, ray: int) -> float:
    """Return when a ray fires after its frame's instant [s]: firing j of n at -duration (1 - j / n)."""
    return sweep.duration_s * (float(ray % sweep.points_per_channel) / float(sweep.points_per_channel) - 1.0)


@wp.func
def firing_pose(views: Views, sweep: Sweep, view: int, ray: int) -> wp.transformf:
    """Return where a view's sensor is when a ray fires: sensor to scene frame."""
    pose = views.pose[view]
    if sweep.duration_s > 0.0:
        pose = moved_pose(pose, sweep.velocity[view], sweep.rate[view], firing_offset(sweep, ray))
    return pose


@wp.kernel(cuda_max_registers=TRACE_REGISTERS)
def lidar_kernel(
    scene: Scene,
    views: Views,
    direction_s: wp.array[wp.vec3],
    order: wp.array[int],
    t_max: float,
    # out
    rays_out: LidarRays,
):
    """Find the first surface on every ray; thread i traces ray `order[i]`. Launch: dim=(A, R), block_dim=64."""
    view, thread = wp.tid()
    ray = order[thread]
    pose = views.pose[view]
    direction = wp.transform_vector(pose, direction_s[ray])
    hit = closest_hit(
        scene, views.batch_index[view], wp.transform_get_translation(pose), direction, t_max, views.ignore[view]
    )
    store_hit(rays_out, view, ray, hit, direction)


@wp.kernel(cuda_max_registers=TRACE_REGISTERS)
def rolling_kernel(
    scene: Scene,
    views: Views,
    sweep: Sweep,
    direction_s: wp.array[wp.vec3],
    order: wp.array[int],
    t_max: float,
    # out
    rays_out: LidarRays,
):
    """Find the first surface on every ray at the instant of its firing. Launch: dim=(A, R), block_dim=64."""
    view, thread = wp.tid()
    ray = order[thread]
    pose = firing_pose(views, sweep, view, ray)
    origin = wp.transform_get_translation(pose)
    direction = wp.transform_vector(pose, direction_s[ray])
    offset = firing_offset(sweep, ray)
    hit = closest_hit_at(scene, views.batch_index[view], origin, direction, t_max, views.ignore[view], offset)
    store_hit(rays_out, view, ray, hit, direction)
