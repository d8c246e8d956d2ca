"""Define the section `type: depth`, a depth camera."""

from typing import Literal

from pydantic import Field, model_validator

from mmw.config.section import Name
from mmw.config.sensor import MountConfig, Role, SensorConfig
from mmw.core.errors import InputError

PNG16_RANGE_M = 655.35
"""Longest depth that 16-bit centimeters can store [m]."""


class DepthCamera(SensorConfig):
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
    range_m: float = Field(655.0, gt=0, le=10_000, description="longest depth; at most 655.35 with `format: png16` [m]")
    format: Literal["png16", "float32"] = Field(
        "png16", description="`png16`: 16-bit centimetres; `float32`: these, and metres before rounding (name)"
    )
    segmentation: bool = Field(
        False, description="instance and semantic images from the same rays, table `segmentation` (true or false)"
    )
    boxes_2d: bool = Field(
        True, description="2-D boxes of vehicles and people, table `boxes_2d`, and their visible pixels (true or false)"
    )

    @model_validator(mode="after")
    def _range(self) -> "DepthCamera":
        if self.format == "png16" and self.range_m > PNG16_RANGE_M:
            raise InputError(
                f"range_m = {self.range_m}: 16-bit centimetres end at {PNG16_RANGE_M} m; lower it, "
                "or use format: float32"
            )
        return self
