"""Define the section `type: imu`, an inertial measurement unit."""

from typing import Literal

from pydantic import Field

from mmw.config.agent_keys import AgentKey
from mmw.config.section import Name
from mmw.config.sensor import SensorConfig


class Imu(SensorConfig):
    """An inertial measurement unit: specific force and angular rate with the errors of `carla` or of `physical`."""

    type: Literal["imu"] = "imu"
    name: Name = Field(default="imu", description="sensor name (name)")
    on: tuple[AgentKey, ...] = Field(default=("cav",), description="agents that carry it (list)")
    mode: Literal["carla", "physical"] = Field(
        default="carla", description="CARLA's white noise a sample, or noise densities with wandering biases (name)"
    )
    handedness: Literal["right", "left"] = Field(
        default="right", description="axes of the readings: y left (right), or CARLA's y right (left) (name)"
    )
    accel_lag_frames: int = Field(
        default=0, ge=0, le=1, description="delay of the accelerometer; CARLA's is 1 (frames)"
    )
    gyro_bias: float = Field(
        default=0.001, ge=-100, le=100, description="constant added to every gyroscope axis, in both modes [rad/s]"
    )
    # carla
    accel_noise_std: float = Field(
        default=0.1, ge=0, le=1000, description="carla: standard deviation of an accelerometer axis [m/s^2]"
    )
    gyro_noise_std: float = Field(
        default=0.002, ge=0, le=100, description="carla: standard deviation of a gyroscope axis [rad/s]"
    )
    # physical; "per root hertz" densities as in Allan deviation plots
    accel_noise_density: float = Field(
        default=0.01, ge=0, le=1000, description="physical: white noise of an axis [m/s^2/Hz^0.5]"
    )
    gyro_noise_density: float = Field(
        default=2e-4, ge=0, le=100, description="physical: white noise of an axis [rad/s/Hz^0.5]"
    )
    accel_random_walk: float = Field(
        default=1e-4, ge=0, le=1000, description="physical: random walk of the bias [m/s^3/Hz^0.5]"
    )
    gyro_random_walk: float = Field(
        default=1e-5, ge=0, le=100, description="physical: random walk of the bias [rad/s^2/Hz^0.5]"
    )
    bias_correlation_s: float | None = Field(
        default=None,
        gt=0,
        description="physical: correlation time of the wandering biases; null: they walk without bound [s]",
    )
    accel_turn_on_std: float = Field(
        default=0.0, ge=0, le=1000, description="physical: spread of an axis' constant bias [m/s^2]"
    )
    gyro_turn_on_std: float = Field(
        default=0.0, ge=0, le=100, description="physical: spread of an axis' constant bias [rad/s]"
    )
    accel_scale_std: float = Field(
        default=0.0, ge=0, le=0.1, description="physical: spread of an axis' scale error (ratio)"
    )
    gyro_scale_std: float = Field(
        default=0.0, ge=0, le=0.1, description="physical: spread of an axis' scale error (ratio)"
    )
    misalignment_std_deg: float = Field(
        default=0.0,
        ge=0,
        le=10,
        description="physical: spread of the turn of each of the two triads, about each axis [deg]",
    )

    @property
    def late_frames(self) -> int:
        """Frames by which the accelerometer is late."""
        return self.accel_lag_frames
