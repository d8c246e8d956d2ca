"""Trace one ray per thread and store distance and object: a sensor without its physics."""

import warp as wp

from mmw.kernels.core.geometry import fibonacci_direction
from mmw.kernels.core.structs import Scene, Views
from mmw.kernels.core.trace import TRACE_REGISTERS, closest_hit_raw, object_of

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})

T_MAX = wp.constant(1000.0)
TILE = wp.constant(8)


@wp.kernel(cuda_max_registers=TRACE_REGISTERS)
def sphere_kernel(
    scene: Scene,
    views: Views,
    ray_count: int,
    arm: int,
    # out
    t_out: wp.array2d[float],
    object_out: wp.array2d[int],
):
    """Trace a Fibonacci lattice around each view's position.

    With `arm` 1, neighboring threads take neighboring indices, which lie 137.5 deg apart. With `arm` a Fibonacci
    number they take every `arm`-th index, which lie side by side along a spiral. Launch: dim=(A, R).
    """
    view, thread = wp.tid()
    full = ray_count // arm
    left = ray_count - full * arm  # the first `left` spirals have one ray more
    spiral = wp.int32(0)
    step = wp.int32(0)
    if thread < left * (full + 1):
        spiral = thread // (full + 1)
        step = thread - spiral * (full + 1)
    else:
        behind = thread - left * (full + 1)
        spiral = left + behind // full
        step = behind % full
    ray = step * arm + spiral
    direction = fibonacci_direction(ray, ray_count)
    origin = wp.transform_get_translation(views.pose[view])
    near = closest_hit_raw(scene, views.batch_index[view], origin, direction, T_MAX, views.ignore[view])
    t_out[view, ray] = near.t
    object_out[view, ray] = object_of(scene, near)


@wp.kernel(cuda_max_registers=TRACE_REGISTERS)
def camera_kernel(
    scene: Scene,
    views: Views,
    width: int,
    focal: float,
    # out
    t_out: wp.array2d[float],
    object_out: wp.array2d[int],
):
    """Trace the pixel centers of a pinhole camera in 8 x 8 tiles. Launch: dim=(A, H * W), H and W multiples of 8."""
    view, thread = wp.tid()
    tile = thread // (TILE * TILE)
    lane = thread % (TILE * TILE)
    columns = width // TILE
    v = (tile // columns) * TILE + lane // TILE
    u = (tile % columns) * TILE + lane % TILE
    height = t_out.shape[1] // width
    pose = views.pose[view]
    through = wp.vec3(
        1.0, (0.5 * float(width) - float(u) - 0.5) / focal, (0.5 * float(height) - float(v) - 0.5) / focal
    )
    direction = wp.transform_vector(pose, wp.normalize(through))
    origin = wp.transform_get_translation(pose)
    near = closest_hit_raw(scene, views.batch_index[view], origin, direction, T_MAX, views.ignore[view])
    pixel = v * width + u
    t_out[view, pixel] = near.t
    object_out[view, pixel] = object_of(scene, near)


@wp.kernel(cuda_max_registers=TRACE_REGISTERS)
def lidar_kernel(
    scene: Scene,
    views: Views,
    direction_s: wp.array[wp.vec3],
    order: wp.array[int],
    # out
    t_out: wp.array2d[float],
    object_out: wp.array2d[int],
):
    """Trace a table of directions; thread i takes ray `order[i]`. Launch: dim=(A, R)."""
    view, thread = wp.tid()
    ray = order[thread]
    pose = views.pose[view]
    direction = wp.transform_vector(pose, direction_s[ray])
    origin = wp.transform_get_translation(pose)
    near = closest_hit_raw(scene, views.batch_index[view], origin, direction, T_MAX, views.ignore[view])
    t_out[view, ray] = near.t
    object_out[view, ray] = object_of(scene, near)
