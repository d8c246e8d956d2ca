"""Describe what the specs of RGB and depth cameras share: projection, kernels and cost of an image."""

from mmw.config.sensor_spec import Camera, Estimate
from mmw.sensors.camera_group.camera_config import CameraConfig
from mmw.sensors.render.projection import CameraSection, intrinsics_of

SEGMENTATION_BYTES_PER_PIXEL = 0.06
"""Size of one pixel in both segmentation images [bytes]: 17 to 20 kB for 640 x 480 on town03."""

BOXES_2D_PER_VIEW = 0.2
"""Share of the boxed actors that one camera frames, measured on town03."""

BOX_2D_BYTES = 20.0
"""Size of one row of `boxes_2d`, measured on town03 [bytes]."""

KERNELS = {"camera.visibility": 7, "camera.instance_culling": 1, "camera.depth": 1, "camera.boxes_2d": 0}
"""Modules of `mmw.kernels` that every camera needs, and the seconds that a CPU needs to compile each."""


def camera_estimate(config: CameraConfig, bytes_per_pixel: float) -> Estimate:
    """Return the cost of one image and of what the same rays show.

    Args:
        config: The camera.
        bytes_per_pixel: Size of a pixel in all images but the segmentation [bytes].
    """
    rays = config.width_px * config.height_px
    size = rays * (bytes_per_pixel + config.segmentation * SEGMENTATION_BYTES_PER_PIXEL)
    return Estimate(rays, size, config.boxes_2d * BOXES_2D_PER_VIEW * BOX_2D_BYTES)


def camera_projection(config: CameraSection) -> Camera:
    """Return the projection of a configured camera."""
    return Camera(intrinsics_of(config), config.lens, config.range_m)
