"""Define the section `type: rgb`, a color camera."""

from typing import Literal

from pydantic import Field, model_validator

from mmw.config.agent_keys import AgentKey
from mmw.config.lens import WIDEST_DEG, LensConfig, check_lens
from mmw.config.section import Name
from mmw.config.sensor import LARGE_VEHICLES, MountConfig, at_side
from mmw.sensors.camera_group.camera_config import CameraConfig
from mmw.sensors.render.image_config import ImageConfig


class RgbCamera(CameraConfig):
    """A color camera, and what the same rays show."""

    type: Literal["rgb"] = "rgb"
    name: Name = Field(default="front", description="sensor name (name)")
    on: tuple[AgentKey, ...] = Field(default=("cav", "rsu"), description="agents that carry it (list)")
    fov_deg: float = Field(
        default=110.0, gt=0, le=WIDEST_DEG, description="horizontal field of view; below 180 but for a fisheye [deg]"
    )
    range_m: float = Field(default=5_000.0, gt=0, le=100_000, description="longest depth; beyond is sky [m]")
    lens: LensConfig = Field(default_factory=LensConfig, description="lens model and calibration (map)")
    image: ImageConfig = Field(default_factory=ImageConfig, description="exposure, noise, motion blur, rain (map)")
    samples: Literal[1, 4, 9] = Field(
        default=4,
        description="rays in a pixel on an edge; 1 leaves edges jagged; inside surfaces one is enough (count)",
    )
    shadows: bool = Field(default=True, description="shadows of the sun (true or false)")
    sky_light: bool = Field(
        default=True,
        description="rays that find how much sky each point sees; false: all of it everywhere (true or false)",
    )
    reflections: bool = Field(
        default=True,
        description="rays that find what glass, car paint and puddles reflect; false: sky alone (true or false)",
    )
    format: Literal["jpeg", "png"] = Field(
        default="jpeg", description="`jpeg`, or `png`, without loss: 5 times the bytes, 20 to 30 times the time (name)"
    )
    jpeg_quality: int = Field(default=95, ge=1, le=100, description="quality of `format: jpeg` (number)")
    jpeg_subsampling: Literal["4:2:0", "4:4:4"] = Field(
        default="4:2:0",
        description="chroma of `format: jpeg`: a color for four pixels, or for each, +20 % bytes (name)",
    )
    normals: bool = Field(default=False, description="normals from the same rays, table `normals` (true or false)")
    flow: bool = Field(
        default=False,
        description="optical flow to the next frame, 10 ms, from the same rays, table `flow` (true or false)",
    )
    debug: bool = Field(
        default=False, description="magenta where a texture is missing; otherwise its fallback (true or false)"
    )

    @model_validator(mode="after")
    def _lens(self) -> "RgbCamera":
        check_lens(self.lens, self.width_px, self.height_px, self.fov_deg)
        return self


def paper_cameras() -> tuple[RgbCamera, ...]:
    """Return the four cameras of the paper: to the front, on CAVs and roadside units, and to the other sides of CAVs.

    Source: Multimodal-Wireless generator, `config.yaml`, with y to the left and yaw counter-clockwise.
    """
    others = (
        ("back", (-1.5, 0, 2.4), 180, at_side("rear", 2.4)),
        ("left", (0, 0.7, 2.4), 90, at_side("left", 2.4)),
        ("right", (0, -0.7, 2.4), -90, at_side("right", 2.4)),
    )
    cameras = [RgbCamera()]
    for name, place, yaw, large in others:
        own = {"cav": MountConfig(position_m=place, yaw_deg=yaw), **dict.fromkeys(LARGE_VEHICLES, large)}
        cameras.append(RgbCamera(name=name, on=("cav",), mount=own))
    return tuple(cameras)
