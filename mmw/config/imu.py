"""`type: imu`: an inertial measurement unit."""

from typing import Literal

from pydantic import Field

from mmw.config.section import Name
from mmw.config.sensor import Role, SensorSection


class ImuConfig(SensorSection):
    """An inertial measurement unit: specific force and angular rate with white noise and a constant gyroscope bias."""

    type: Literal["imu"] = "imu"
    name: Name = Field("imu", description="sensor name (name)")
    on: tuple[Role, ...] = Field(("cav",), description="agents that carry it (list)")
    accel_noise_std: float = Field(0.1, ge=0, description="standard deviation of one accelerometer sample [m/s^2]")
    gyro_noise_std: float = Field(0.002, ge=0, description="standard deviation of one gyroscope sample [rad/s]")
    gyro_bias: float = Field(0.001, description="constant added to every gyroscope axis [rad/s]")
