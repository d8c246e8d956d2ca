"""`type: depth`: a depth camera."""

from typing import Literal

from pydantic import Field

from mmw.config.section import Name
from mmw.config.sensor import MountConfig, Role, SensorSection


class DepthConfig(SensorSection):
    """A pinhole depth camera; depth is measured along the optical axis."""

    type: Literal["depth"] = "depth"
    name: Name = Field("depth", description="sensor name (name)")
    on: tuple[Role, ...] = Field(("rsu",), description="agents that carry it (list)")
    mount: dict[Role, MountConfig] = Field(
        default_factory=lambda: {
            "rsu": MountConfig(position_m=(0, 0, 3.9)),
            "cav": MountConfig(position_m=(1.5, 0, 2.4)),
        },
        description="mount for each role; a role that is left out keeps its default (map)",
    )
    width_px: int = Field(640, ge=8, le=8192, description="image width [px]")
    height_px: int = Field(480, ge=8, le=8192, description="image height [px]")
    fov_deg: float = Field(110.0, gt=0, lt=180, description="horizontal field of view [deg]")
    range_m: float = Field(655.0, gt=0, le=655.35, description="longest depth; 16-bit centimetres end at 655.35 [m]")
