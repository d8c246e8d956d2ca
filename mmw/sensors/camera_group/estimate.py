"""Estimate what RGB and depth cameras have in common."""

from mmw.config.sensor_spec import Estimate

SEGMENTATION_BYTES_PER_PIXEL = 0.06
"""Size of one pixel in both segmentation images [bytes]: 17 to 20 kB for 640 x 480 on town03."""

BOXES_2D_PER_VIEW = 0.2
"""Share of the boxed actors that one camera frames, measured on town03."""

BOX_2D_BYTES = 20.0
"""Size of one row of `boxes_2d`, measured on town03 [bytes]."""

KERNELS = {"camera.visibility": 7, "camera.instance_culling": 1, "camera.depth": 1, "camera.boxes_2d": 0}
"""Modules of `mmw.kernels` that every camera needs, and the seconds that a CPU needs to compile each."""


def camera_estimate(
    width_px: int, height_px: int, bytes_per_pixel: float, *, segmentation: bool, boxes_2d: bool
) -> Estimate:
    """Return the cost of one image and of what the same rays show.

    Args:
        width_px: Image width [px].
        height_px: Image height [px].
        bytes_per_pixel: Size of a pixel in all images but the segmentation [bytes].
        segmentation: Whether both segmentation images are stored.
        boxes_2d: Whether 2-D boxes are stored.
    """
    rays = width_px * height_px
    size = rays * (bytes_per_pixel + segmentation * SEGMENTATION_BYTES_PER_PIXEL)
    return Estimate(rays, size, boxes_2d * BOXES_2D_PER_VIEW * BOX_2D_BYTES)
