"""Compute optical flow of camera images, for the flow image and for motion blur."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

import numpy as np
import warp as wp

from mmw.core.constants import FRAME_DT
from mmw.kernels.camera import optical_flow as kernels
from mmw.sensors.render.camera import BLOCK_DIM
from mmw.sensors.render.visibility_buffer import SampleBuffer


def device_twists(twists: tuple[np.ndarray, np.ndarray], device: str) -> tuple[wp.array, wp.array]:
    """Return velocity [m/s] and angular velocity [rad/s] of each view on a device, shape [A] each, vec3.

    Args:
        twists: From `mmw.scene.views.view_twists`, world axes, shape [A, 3] each.
        device: Warp device name.
    """
    velocity, rate = (wp.array(part.astype(np.float32), dtype=wp.vec3, device=device) for part in twists)
    return velocity, rate


def image_motion(buffer: SampleBuffer, twists: tuple[wp.array, wp.array], time_s: float = FRAME_DT) -> wp.array:
    """Return how far what each pixel's center shows moves in the image, shape [A, H, W], vec2: right and down [px].

    Surface points move with their rigid bodies, at constant velocity and angular velocity; wheels as their bodies do,
    because their meshes do not turn. The camera moves by its twist. The sky turns with the camera alone. A point that
    leaves the image has its place outside it. Between still cameras and still objects it is exactly 0.

    Args:
        buffer: What the pixels show.
        twists: Velocity and angular velocity of each view; see `device_twists`.
        time_s: Time from the frame on [s]; one frame for the flow image.
    """
    device = buffer.scene.device
    motion = buffer.arrays.empty(buffer.shape, wp.vec2)
    if motion.size:
        inputs = [buffer.scene.struct, buffer.on_device, *twists, buffer.camera, buffer.samples, time_s]
        wp.launch(kernels.image_motion_kernel, buffer.launch, inputs, [motion], device=device, block_dim=BLOCK_DIM)
    return motion
