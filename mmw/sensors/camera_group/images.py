"""Hold what images of cameras show of objects, and find it for one camera."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import warp as wp

from mmw.core.camera_models import Intrinsics
from mmw.core.transfer import to_host
from mmw.sensors.camera_group.camera_config import CameraConfig
from mmw.sensors.camera_group.launches import Launch
from mmw.sensors.ground_truth.boxes_2d import Boxes2d, image_boxes, visible_pixels
from mmw.sensors.ground_truth.boxes_3d import make_boxes
from mmw.sensors.ground_truth.segmentation import object_tags
from mmw.sensors.ground_truth.visibility import boxed_actors, object_ids
from mmw.sensors.samples import Array, Samples
from mmw.sensors.sensor_input import SensorInput


@dataclass(frozen=True, kw_only=True)
class CameraImage(Samples):
    """Images of A views, or the one of a single view, whose arrays lack the first axis; row 0 is the top."""

    intrinsics: Intrinsics
    """Size of the image, focal lengths, principal point and lens."""
    semantic: Array | None = None
    """CARLA tag of the object in each pixel, that of the sky for none, shape [A, H, W], uint8; None without
    `segmentation`."""
    boxes_2d: Boxes2d | None = None
    """2-D boxes of the actors, always on the host; None without `boxes_2d`."""


def object_images(data: SensorInput, config: CameraConfig, launch: Launch, object_id: wp.array) -> dict[str, Any]:
    """Return the fields `semantic` and `boxes_2d` of a camera's images, as it is configured.

    Args:
        data: Scene and output.
        config: The camera.
        launch: Its views.
        object_id: Object in each pixel, -1 for nothing, shape [A, H, W], on the device.

    Raises:
        InputError: If the scene has more objects than `semantic` can tell.
    """
    arrays, found = data.scene.arrays, {}
    if config.segmentation:
        found["semantic"] = object_tags(arrays)[to_host([object_id])[0]]
        if data.output == "warp":
            found["semantic"] = wp.array(found["semantic"], dtype=wp.uint8, device=data.scene.device)
    if config.boxes_2d:
        visible = visible_pixels(object_id, object_ids(arrays.actors)[boxed_actors(arrays.actors)])
        boxes = make_boxes(arrays, np.unique(launch.views.frame).tolist(), data.motion)
        found["boxes_2d"] = image_boxes(arrays, launch.views, launch.intrinsics, boxes, visible)
    return found
