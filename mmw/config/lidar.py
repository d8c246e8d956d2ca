"""`type: lidar`: a spinning LiDAR."""

from typing import Literal

from pydantic import Field, model_validator

from mmw.config.section import Name
from mmw.config.sensor import MountConfig, Role, SensorSection


class LidarConfig(SensorSection):
    """A spinning LiDAR; one whole turn a frame."""

    type: Literal["lidar"] = "lidar"
    name: Name = Field("lidar", description="sensor name (name)")
    on: tuple[Role, ...] = Field(("cav", "rsu"), description="agents that carry it (list)")
    mount: dict[Role, MountConfig] = Field(
        default_factory=lambda: {
            "cav": MountConfig(position_m=(0, 0, 2.5)),
            "rsu": MountConfig(position_m=(0, 0, 4.0)),
        },
        description="mount for each role; a role that is left out keeps its default (map)",
    )
    channels: int = Field(64, ge=1, le=256, description="laser channels, index 0 the highest (count)")
    points_per_channel: int = Field(469, ge=1, le=8192, description="azimuth steps of a turn (count)")
    range_m: float = Field(120.0, gt=0, le=1000, description="longest range [m]")
    upper_fov_deg: float = Field(2.0, ge=-90, le=90, description="elevation of channel 0 [deg]")
    lower_fov_deg: float = Field(-25.0, ge=-90, le=90, description="elevation of the last channel [deg]")

    @model_validator(mode="after")
    def _fan(self) -> "LidarConfig":
        if self.lower_fov_deg > self.upper_fov_deg:
            raise ValueError(
                f"lower_fov_deg = {self.lower_fov_deg} lies above upper_fov_deg = {self.upper_fov_deg}; swap them"
            )
        return self
