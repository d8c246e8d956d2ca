"""LiDAR: trace every ray of every view, gather the returns into one list, and give them an intensity."""

import warp as wp

from mmw.kernels.structs import Scene, Views
from mmw.kernels.trace import TRACE_REGISTERS, closest_hit

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})

STEPS_PER_METRE = wp.constant(1024.0)
"""Grid of stored coordinates [1/m]: a power of two, so that float32 holds every grid point and compresses well."""
INTENSITY_STEPS = wp.constant(256.0)
"""Grid of stored intensities."""


@wp.struct
class LidarRays:
    """What every ray of every view meets, fixed slots [A, R]."""

    is_hit: wp.array2d[int]
    """1 for a return, 0 for none: the input of the scan that places the returns."""
    range: wp.array2d[float]
    """Distance [m], inf for none."""
    cos_incidence: wp.array2d[float]
    """Cosine of the angle between ray and surface normal, 0 to 1."""
    object_id: wp.array2d[int]
    material_id: wp.array2d[int]


@wp.struct
class LidarPoints:
    """The returns only, view by view and ray by ray, shape [N]."""

    xyz: wp.array2d[float]
    """Position in the sensor frame on the stored grid [m], shape [3, N]."""
    range: wp.array[float]
    """Distance before it is put on the grid [m]."""
    cos_incidence: wp.array[float]
    ray: wp.array[int]
    """Index of the ray in the pattern."""
    ring: wp.array[wp.uint8]
    """Channel of the ray."""
    object_id: wp.array[int]
    material_id: wp.array[int]


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
    """Find the first surface on every ray; thread i takes ray `order[i]`. Launch: dim=(A, R), block_dim=64."""
    view, thread = wp.tid()
    ray = order[thread]
    pose = views.pose[view]
    direction = wp.transform_vector(pose, direction_s[ray])
    hit = closest_hit(scene, views.slot[view], wp.transform_get_translation(pose), direction, t_max, views.ignore[view])
    rays_out.is_hit[view, ray] = wp.where(hit.object_id >= 0, 1, 0)
    rays_out.range[view, ray] = hit.t
    rays_out.cos_incidence[view, ray] = wp.clamp(-wp.dot(hit.normal, direction), 0.0, 1.0)
    rays_out.object_id[view, ray] = hit.object_id
    rays_out.material_id[view, ray] = hit.material_id


@wp.kernel
def gather_kernel(
    rays: LidarRays,
    hits_up_to: wp.array2d[int],
    direction_s: wp.array[wp.vec3],
    points_per_channel: int,
    # out
    points_out: LidarPoints,
):
    """Copy each return to its place in the list: the number of returns up to and with it, less one.

    Launch: dim=(A, R).
    """
    view, ray = wp.tid()
    if rays.is_hit[view, ray] == 0:
        return
    point = hits_up_to[view, ray] - 1
    distance = rays.range[view, ray]
    position = direction_s[ray] * distance
    for axis in range(3):
        points_out.xyz[axis, point] = wp.rint(position[axis] * STEPS_PER_METRE) / STEPS_PER_METRE
    points_out.range[point] = distance
    points_out.cos_incidence[point] = rays.cos_incidence[view, ray]
    points_out.ray[point] = ray
    points_out.ring[point] = wp.uint8(ray // points_per_channel)
    points_out.object_id[point] = rays.object_id[view, ray]
    points_out.material_id[point] = rays.material_id[view, ray]


@wp.kernel
def shade_kernel(
    material_id: wp.array[int],
    cos_incidence: wp.array[float],
    reflectance: wp.array[float],
    # out
    intensity_out: wp.array[float],
):
    """Give every return its intensity in clear air, reflectance x cos(incidence). Launch: dim=N."""
    point = wp.tid()
    intensity = wp.clamp(reflectance[material_id[point]] * cos_incidence[point], 0.0, 1.0)
    intensity_out[point] = wp.rint(intensity * INTENSITY_STEPS) / INTENSITY_STEPS
