"""`sensors`: what every agent carries. Defaults are the values of the paper's sensor table."""

from typing import Annotated, Literal

from pydantic import Field, field_validator, model_validator

from mmw.config.section import Name, Section, Vec3

Role = Literal["cav", "rsu"]


class MountConfig(Section):
    """Where a sensor sits on its agent: x forward, y left, z up from the agent's origin on the ground."""

    position_m: Vec3 = Field((0.0, 0.0, 0.0), description="offset in the agent's frame, x forward, y left, z up [m]")
    yaw_deg: float = Field(0.0, ge=-360, le=360, description="turn about z, counter-clockwise seen from above [deg]")
    pitch_deg: float = Field(0.0, ge=-90, le=90, description="turn about y after yaw, nose down positive [deg]")
    roll_deg: float = Field(0.0, ge=-180, le=180, description="turn about x after pitch [deg]")


class _Sensor(Section):
    name: Name = Field(description="unique among the sensors; the `sensor` or `camera` key of its rows (name)")
    on: tuple[Role, ...] = Field(description="agents that carry it: `cav`, `rsu` (list)")
    mount: dict[Role, MountConfig] = Field(
        default_factory=dict, description="mount for each role; a role that is left out keeps its default (map)"
    )

    @field_validator("mount")
    @classmethod
    def _every_role(cls, value: dict[Role, MountConfig]) -> dict[Role, MountConfig]:
        return {**cls.model_fields["mount"].get_default(call_default_factory=True), **value}

    def mount_on(self, role: Role) -> MountConfig:
        """Return the mount for a role; the agent's origin where the file gives none."""
        return self.mount.get(role, MountConfig())


class LidarConfig(_Sensor):
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


class DepthConfig(_Sensor):
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


class ImuConfig(_Sensor):
    """An inertial measurement unit: specific force and angular rate with white noise and a constant gyroscope bias."""

    type: Literal["imu"] = "imu"
    name: Name = Field("imu", description="sensor name (name)")
    on: tuple[Role, ...] = Field(("cav",), description="agents that carry it (list)")
    accel_noise_std: float = Field(0.1, ge=0, description="standard deviation of one accelerometer sample [m/s^2]")
    gyro_noise_std: float = Field(0.002, ge=0, description="standard deviation of one gyroscope sample [rad/s]")
    gyro_bias: float = Field(0.001, description="constant added to every gyroscope axis [rad/s]")


SensorConfig = Annotated[LidarConfig | DepthConfig | ImuConfig, Field(discriminator="type")]


def default_sensors() -> tuple[LidarConfig | DepthConfig | ImuConfig, ...]:
    """Return the paper's suite, as far as this version traces it."""
    return (LidarConfig(), DepthConfig(), ImuConfig())
