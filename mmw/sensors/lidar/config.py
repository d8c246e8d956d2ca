"""Define the section `type: lidar`, a spinning LiDAR."""

import itertools
from typing import Literal

from pydantic import Field, field_validator, model_validator

from mmw.config.agent_keys import AgentKey
from mmw.config.section import Name
from mmw.config.sensor import ON_ROOF, MountConfig, SensorConfig, mounts_at
from mmw.core.constants import FRAME_DT
from mmw.core.errors import InputError
from mmw.sensors.lidar.config_parts import CarlaLidarConfig, LidarOpticsConfig, LidarPreset
from mmw.sensors.lidar.optics import LidarOptics

CHANNELS = 64
"""Laser channels of the paper's LiDAR."""


class Lidar(SensorConfig):
    """A spinning LiDAR; one whole turn a frame."""

    type: Literal["lidar"] = "lidar"
    name: Name = Field(default="lidar", description="sensor name (name)")
    on: tuple[AgentKey, ...] = Field(default=("cav", "rsu"), description="agents that carry it (list)")
    mount: dict[AgentKey, MountConfig] = mounts_at(ON_ROOF, cav=(0, 0, 2.5), rsu=(0, 0, 4.0))
    mode: Literal["carla", "physical"] = Field(
        default="physical", description="CARLA's LiDAR, or materials, weather and a link budget (name)"
    )
    channels: int = Field(default=CHANNELS, ge=1, le=256, description="laser channels, index 0 the highest (count)")
    points_per_channel: int = Field(default=469, ge=1, le=8192, description="azimuth steps of a turn (count)")
    range_m: float = Field(default=120.0, gt=0, le=1000, description="longest range [m]")
    upper_fov_deg: float = Field(default=2.0, ge=-90, le=90, description="elevation of channel 0 [deg]")
    lower_fov_deg: float = Field(default=-25.0, ge=-90, le=90, description="elevation of the last channel [deg]")
    elevations_deg: tuple[float, ...] | None = Field(
        default=None,
        max_length=256,
        description="elevation of each channel from top to bottom; none: evenly between the two limits [deg]",
    )
    horizontal_fov_deg: float = Field(
        default=360.0, gt=0, le=360, description="sector that is swept, about forward [deg]"
    )

    returns: Literal["strongest", "last", "dual"] = Field(
        default="strongest", description="which returns a ray gives (name)"
    )
    preset: LidarPreset = Field(default="hdl64", description="laser and receiver of `physical` (name)")
    optics: LidarOpticsConfig = Field(
        default_factory=LidarOpticsConfig, description="values of the laser and receiver other than the preset's (map)"
    )
    detection: Literal["relative", "absolute"] = Field(
        default="relative",
        description="relative: nothing is lost in clear dry air; absolute: the link budget decides (name)",
    )
    detection_margin_db: float = Field(
        default=3.0,
        ge=0,
        le=60,
        description="what weather may take from a weak surface in `relative` before it is lost [dB]",
    )
    carla: CarlaLidarConfig = Field(
        default_factory=CarlaLidarConfig, description="CARLA's attributes, for `carla` (map)"
    )
    rolling: bool = Field(
        default=False, description="fire through the 10 ms before the frame instead of at once (true/false)"
    )
    deskew: bool = Field(
        default=False,
        description="with `rolling`: store points in the sensor's frame at the frame's instant (true/false)",
    )
    scene_flow: bool = Field(
        default=False, description="store how far each point moves until the next frame (true/false)"
    )

    @field_validator("elevations_deg")
    @classmethod
    def _table(cls, value: tuple[float, ...] | None) -> tuple[float, ...] | None:
        if value is None:
            return None
        if not value:
            raise InputError("elevations_deg is empty; give one elevation a channel, or leave the key out")
        for angle in value:
            if not -90 <= angle <= 90:
                raise InputError(f"elevations_deg holds {angle:g}; -90 to 90 is needed; correct it")
        for above, below in itertools.pairwise(value):
            if below > above:
                raise InputError(
                    f"elevations_deg goes up from {above:g} to {below:g}; channel 0 is the highest; sort the table "
                    "from top to bottom"
                )
        return value

    @model_validator(mode="after")
    def _fan(self) -> "Lidar":
        table = self.elevations_deg
        if table is not None:  # it says the channels and limits that are not given
            implied = {"channels": len(table), "upper_fov_deg": table[0], "lower_fov_deg": table[-1]}
            self.__dict__.update({key: value for key, value in implied.items() if key not in self.model_fields_set})
        if table is None and self.channels > 1 and self.lower_fov_deg == self.upper_fov_deg:
            raise InputError(
                f"upper_fov_deg = lower_fov_deg = {self.upper_fov_deg:g} with channels = {self.channels}; that is no "
                "field of view; set them apart, or use channels: 1"
            )
        if self.lower_fov_deg > self.upper_fov_deg:
            raise InputError(
                f"lower_fov_deg = {self.lower_fov_deg} lies above upper_fov_deg = {self.upper_fov_deg}; swap them"
            )
        if table is not None and len(table) != self.channels:
            raise InputError(
                f"elevations_deg holds {len(table)} elevations and channels = {self.channels}; they must agree; leave "
                "channels out, or correct the table"
            )
        if table is not None and (self.upper_fov_deg, self.lower_fov_deg) != (table[0], table[-1]):
            raise InputError(
                f"elevations_deg runs from {table[0]:g} to {table[-1]:g}, upper_fov_deg = {self.upper_fov_deg:g} and "
                f"lower_fov_deg = {self.lower_fov_deg:g} say otherwise; leave the two limits out"
            )
        if self.deskew and not self.rolling:
            raise InputError("deskew = true without rolling; a still picture has no skew; set rolling, or drop deskew")
        if self.scene_flow and self.rolling and not self.deskew:
            raise InputError(
                "scene_flow with rolling needs deskew: true, because the flow starts at the frame's instant; set it"
            )
        if self.mode == "carla" and self.returns != "strongest":
            raise InputError(
                f"returns = {self.returns!r} in mode carla; CARLA's LiDAR has one return a ray; leave returns out, or "
                "use mode: physical"
            )
        nearest = self.lidar_optics().nearest_m
        if self.mode == "physical" and self.range_m <= nearest:
            raise InputError(
                f"range_m = {self.range_m:g} is no more than the nearest echo, optics.nearest_m = {nearest:g}; raise it"
            )
        return self

    def lidar_optics(self) -> LidarOptics:
        """Return the laser and receiver: the preset's values with those of `optics`."""
        return self.optics.over(self.preset)


def sweep_duration(config: Lidar) -> float:
    """Return the time that a rolling sweep takes [s]: 10 ms, or less if there are more than 100 sweeps a second."""
    return min(FRAME_DT, 1.0 / config.rate_hz) if config.rate_hz else FRAME_DT
