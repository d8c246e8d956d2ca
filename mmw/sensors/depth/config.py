"""Define the section `type: depth`, a depth camera."""

from typing import ClassVar, Literal

from pydantic import Field, model_validator

from mmw.config.agent_keys import AgentKey
from mmw.config.lens import LensConfig
from mmw.config.section import Name
from mmw.core.errors import InputError
from mmw.sensors.camera_group.camera_config import CameraConfig

PNG16_RANGE_M = 655.35
"""Longest depth that 16-bit centimeters can store [m]."""


class DepthCamera(CameraConfig):
    """A pinhole depth camera; depth is measured along the optical axis."""

    lens: ClassVar[LensConfig] = LensConfig()
    """Lens of every depth camera: a pinhole."""

    type: Literal["depth"] = "depth"
    name: Name = Field(default="depth", description="sensor name (name)")
    on: tuple[AgentKey, ...] = Field(default=("rsu",), description="agents that carry it (list)")
    fov_deg: float = Field(default=110.0, gt=0, lt=180, description="horizontal field of view [deg]")
    range_m: float = Field(
        default=655.0, gt=0, le=10_000, description="longest depth; at most 655.35 with `format: png16` [m]"
    )
    format: Literal["png16", "float32"] = Field(
        default="png16", description="`png16`: 16-bit centimeters; `float32`: these, and meters before rounding (name)"
    )

    @model_validator(mode="after")
    def _range(self) -> "DepthCamera":
        if self.format == "png16" and self.range_m > PNG16_RANGE_M:
            raise InputError(
                f"range_m = {self.range_m}: 16-bit centimeters end at {PNG16_RANGE_M} m; lower it, "
                "or use format: float32"
            )
        return self
