"""Define the keys that RGB and depth cameras share."""

from pydantic import Field

from mmw.config.agent_keys import AgentKey
from mmw.config.sensor import MountConfig, SensorConfig, at_side, mounts_at


class CameraConfig(SensorConfig):
    """A camera: the size of its image, and what the same rays show besides."""

    mount: dict[AgentKey, MountConfig] = mounts_at(at_side("front", 2.4), rsu=(0, 0, 3.9), cav=(1.5, 0, 2.4))
    width_px: int = Field(default=640, ge=8, le=8192, description="image width [px]")
    height_px: int = Field(default=480, ge=8, le=8192, description="image height [px]")
    segmentation: bool = Field(
        default=False,
        description="instance and semantic images from the same rays, table `segmentation` (true or false)",
    )
    boxes_2d: bool = Field(
        default=True,
        description="2-D boxes of vehicles and people, table `boxes_2d`, and their visible pixels (true or false)",
    )
