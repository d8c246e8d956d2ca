"""Cull instances that the rays of a part of an image, or those to the sun, cannot hit.

Rays of a camera's tile lie in a cone; they cannot hit an instance whose box the cone misses. Rays to the sun are
parallel: along them, an instance covers a disc, and a grid square to them tells which discs lie where.
"""

import warp as wp

from mmw.kernels.camera.camera import TILE, Camera, camera_ray
from mmw.kernels.core.compiler import FINITE
from mmw.kernels.core.structs import Candidates, Scene, Views

wp.set_module_options(
    {"enable_backward": False, "default_grid_stride": False, "fast_math": False, "cpu_compiler_flags": FINITE}
)

SLACK = wp.constant(0.002)
"""Half angle that cones are wider than they are [rad], for rounding; design value, 100 steps of float32 and more."""


@wp.func
def is_in_cone(
    scene: Scene, batch_index: int, instance: int, eye: wp.vec3, axis: wp.vec3, half_angle: float
) -> wp.bool:
    """Return whether a cone may intersect the box around an instance.

    A point of the box in the cone lies within its distance times the sine of the half angle of the axis. So the axis
    then intersects the box that is wider by this on every side.

    Args:
        scene: Town and vehicles.
        batch_index: Position of the frame in the batch.
        instance: The instance.
        eye: Tip of the cone, scene frame [m].
        axis: Unit direction of the cone, scene frame.
        half_angle: Its half angle [rad]; one of 86 deg and more intersects everything.
    """
    if half_angle > 1.5:
        return True
    to_local = wp.transform_inverse(scene.instance_pose[batch_index, instance])
    from_middle = wp.transform_point(to_local, eye) - scene.instance_aabb_center[instance]
    along = wp.transform_vector(to_local, axis)
    half = scene.instance_aabb_half_extent[instance]
    wider = (wp.length(from_middle) + wp.length(half)) * wp.sin(half_angle)
    enter = wp.float32(0.0)
    leave = float(wp.inf)
    for k in range(3):
        side = half[k] + wider
        if wp.abs(along[k]) < 1.0e-6:
            if wp.abs(from_middle[k]) > side:
                leave = wp.float32(-1.0)
        else:
            near = (-side - from_middle[k]) / along[k]
            far = (side - from_middle[k]) / along[k]
            enter = wp.max(enter, wp.min(near, far))
            leave = wp.min(leave, wp.max(near, far))
    return enter <= leave


@wp.kernel
def tile_candidates_kernel(
    scene: Scene,
    views: Views,
    camera: Camera,
    # out
    candidates_out: Candidates,
):
    """List the instances that rays of each tile can hit.

    Launch: dim=(A, tile rows, tile columns); group (view * rows + row) * columns + column.
    """
    view, down, across = wp.tid()
    rows = (camera.height + TILE - 1) // TILE
    columns = (camera.width + TILE - 1) // TILE
    group = (view * rows + down) * columns + across
    u = float(across * TILE)
    v = float(down * TILE)
    side = float(TILE)
    axis = camera_ray(camera, u + 0.5 * side, v + 0.5 * side)
    cosine = wp.min(
        wp.min(wp.dot(axis, camera_ray(camera, u, v)), wp.dot(axis, camera_ray(camera, u + side, v))),
        wp.min(wp.dot(axis, camera_ray(camera, u, v + side)), wp.dot(axis, camera_ray(camera, u + side, v + side))),
    )
    # The corners are the farthest points of a tile: lines stay nearly straight over 8 pixels.
    half = 1.05 * wp.acos(wp.clamp(cosine, -1.0, 1.0)) + SLACK
    pose = views.pose[view]
    batch_index = views.batch_index[view]
    eye = wp.transform_get_translation(pose)
    axis = wp.transform_vector(pose, axis)
    count = wp.int32(0)
    for instance in range(scene.instance_count):
        if scene.instance_present[batch_index, instance] and is_in_cone(scene, batch_index, instance, eye, axis, half):
            candidates_out.instance[group, count] = wp.int16(instance)
            count += 1
    candidates_out.count[group] = count


@wp.struct
class SunGrid:
    """A grid square to the sun's direction, one layer a frame: cells hold the instances that shade points there."""

    across: wp.vec3
    """Unit vector along columns, square to the sun."""
    along: wp.vec3
    """Unit vector along rows, square to both."""
    low: wp.array[wp.vec2]
    """Corner of the first cell [m], shape [1]."""
    size: wp.array[wp.vec2i]
    """Columns and rows, shape [1]; both are in memory as they change with the batch."""
    cell: float
    """Side of a cell [m]."""
    margin: float
    """Margin of the discs around the instances [m]: rays go to all of the sun's disc."""


@wp.struct
class Sun:
    """The sun of a weather, and which instances shade what from it."""

    direction: wp.vec3
    """Unit direction to the middle of its disc."""
    radius: float
    """Angular radius of the disc [rad]."""
    grid: SunGrid
    candidates: Candidates
    """Instances that shade points of each cell of the grid."""


@wp.func
def sun_group(grid: SunGrid, batch_index: int, point: wp.vec3) -> int:
    """Return the cell of a point as a group of `Candidates`, -1 outside of the grid, where nothing is shaded."""
    low = grid.low[0]
    size = grid.size[0]
    column = int(wp.floor((wp.dot(grid.across, point) - low[0]) / grid.cell))
    row = int(wp.floor((wp.dot(grid.along, point) - low[1]) / grid.cell))
    if column < 0 or row < 0 or column >= size[0] or row >= size[1]:
        return -1
    return (batch_index * size[1] + row) * size[0] + column


@wp.kernel
def sun_candidates_kernel(
    scene: Scene,
    grid: SunGrid,
    batch_size: int,
    # out
    candidates_out: Candidates,
):
    """List the instances that can shade points of each cell.

    Launch: dim=room for the cells of all slots, of which there are `batch_size`.
    """
    group = wp.tid()
    size = grid.size[0]
    cells = size[0] * size[1]
    if group >= batch_size * cells:
        return
    batch_index = group // cells
    row = (group - batch_index * cells) // size[0]
    column = group % size[0]
    low = grid.low[0]
    x = low[0] + (float(column) + 0.5) * grid.cell
    y = low[1] + (float(row) + 0.5) * grid.cell
    half = 0.5 * grid.cell
    count = wp.int32(0)
    for instance in range(scene.instance_count):
        if scene.instance_present[batch_index, instance]:
            middle = wp.transform_point(
                scene.instance_pose[batch_index, instance], scene.instance_aabb_center[instance]
            )
            apart_x = wp.max(wp.abs(wp.dot(grid.across, middle) - x) - half, 0.0)
            apart_y = wp.max(wp.abs(wp.dot(grid.along, middle) - y) - half, 0.0)
            reach = wp.length(scene.instance_aabb_half_extent[instance]) + grid.margin
            if apart_x * apart_x + apart_y * apart_y <= reach * reach:
                candidates_out.instance[group, count] = wp.int16(instance)
                count += 1
    candidates_out.count[group] = count
