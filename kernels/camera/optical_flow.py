"""Compute optical flow: how far each pixel moves in the image, by the motion of its body and of the camera."""

import warp as wp

from mmw.kernels.camera.camera import Camera, camera_ray, project_point, tile_column, tile_row
from mmw.kernels.core.rigid_motion import moved_pose
from mmw.kernels.core.structs import Scene, Views
from mmw.kernels.shading.structs import Samples

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})


@wp.func
def displacement(scene: Scene, batch_index: int, instance: int, point: wp.vec3, time: float) -> wp.vec3:
    """Return how far a surface point moves with its body in some time [s], scene frame [m]; 0 for the town.

    Bodies keep velocity and angular velocity. Wheels move as their bodies do: their meshes do not turn.
    """
    moved = wp.vec3()
    if instance >= 0:
        arm = point - wp.transform_get_translation(scene.instance_pose[batch_index, instance])
        still = wp.transformf(wp.vec3(), wp.quatf(0.0, 0.0, 0.0, 1.0))
        change = moved_pose(
            still, scene.instance_velocity[batch_index, instance], scene.instance_rate[batch_index, instance], time
        )
        moved = wp.transform_point(change, arm) - arm
    return moved


@wp.kernel
def image_motion_kernel(
    scene: Scene,
    views: Views,
    velocity: wp.array[wp.vec3],
    rate: wp.array[wp.vec3],
    camera: Camera,
    samples: Samples,
    time: float,
    # out
    motion_out: wp.array3d[wp.vec2],
):
    """Write how far what each pixel shows moves to the right and downward in some time [px], shape [A, H, W].

    Everything is reckoned from the camera, so that large coordinates cost no precision. The sky is infinitely far away:
    only the camera's turning moves it.

    Args:
        scene: Bodies and their motion.
        views: Camera poses.
        velocity: Velocity of each camera, scene frame [m/s].
        rate: Angular velocity of each camera about the axes of the scene frame [rad/s].
        camera: The camera.
        samples: What each pixel's center shows, row (view * H + v) * W + u.
        time: From the frame on [s].
        motion_out: Image motion.

    Launch: dim=(A, ceil(H / 8), ceil(W / 8), 64), block_dim=64.
    """
    view, down, across, lane = wp.tid()
    v = tile_row(down, lane)
    u = tile_column(across, lane)
    if u >= camera.width or v >= camera.height:
        return
    row = (view * camera.height + v) * camera.width + u
    pose = views.pose[view]
    turned = wp.transform_get_rotation(pose)
    direction = wp.quat_rotate(turned, camera_ray(camera, float(u) + 0.5, float(v) + 0.5))
    now = direction
    then = direction
    if samples.face[row] >= 0:
        now = samples.t[row] * direction
        point = wp.transform_get_translation(pose) + now
        batch_index = views.batch_index[view]
        then = now + displacement(scene, batch_index, samples.instance[row], point, time) - time * velocity[view]
    if then == now and rate[view] == wp.vec3(0.0, 0.0, 0.0):  # exactly, however a device rounds
        motion_out[view, v, u] = wp.vec2(0.0, 0.0)
        return
    turning = moved_pose(wp.transformf(wp.vec3(), turned), wp.vec3(), rate[view], time)
    before = project_point(camera, wp.quat_rotate_inv(turned, now))
    after = project_point(camera, wp.quat_rotate_inv(wp.transform_get_rotation(turning), then))
    motion_out[view, v, u] = after - before
