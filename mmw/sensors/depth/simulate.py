"""Simulate a depth camera: distance along the optical axis, and the object, in every pixel."""

from dataclasses import dataclass

from mmw.sensors.camera_group.images import CameraImage, object_images
from mmw.sensors.camera_group.launches import Launch, single_launches, trace_launch
from mmw.sensors.depth.config import DepthCamera
from mmw.sensors.render.appearance_buffers import alpha_cutouts
from mmw.sensors.render.visibility_buffer import depth_images
from mmw.sensors.samples import Array, join, to_output
from mmw.sensors.sensor_input import SensorInput


@dataclass(frozen=True)
class DepthImage(CameraImage):
    """Depth images of A views, or the one of a single view, whose arrays lack the first axis; row 0 is the top."""

    depth_m: Array
    """Depth along the optical axis, not rounded [m], inf for nothing in range, shape [A, H, W], float32."""
    object_id: Array
    """Object in each pixel, -1 for nothing, shape [A, H, W], int32."""


def simulate(data: SensorInput, config: DepthCamera) -> dict[str, DepthImage]:
    """Return the images of all views; they are the same in every weather."""
    launches = single_launches(config, data.views, data.scene.device)
    return dict.fromkeys(data.weathers, join([_images(data, config, launch) for launch in launches]))


def _images(data: SensorInput, config: DepthCamera, launch: Launch) -> DepthImage:
    cutouts = data.cached("alpha cutouts", lambda: alpha_cutouts(data.scene))
    buffer = trace_launch(data.scene, launch, cutouts, with_surfaces=False)
    images = depth_images(buffer, range_m=config.range_m, with_metres=True, with_objects=True)
    return DepthImage(
        to_output(images.depth_m, data.output),
        to_output(images.object_id, data.output),
        intrinsics=launch.intrinsics,
        **object_images(data, config, launch, images.object_id),
    )
