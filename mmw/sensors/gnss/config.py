"""Define the section `type: gnss`, a satellite navigation receiver."""

from typing import Literal

from pydantic import Field

from mmw.config.agent_keys import AgentKey
from mmw.config.section import Name
from mmw.config.sensor import SensorConfig


class Gnss(SensorConfig):
    """A satellite navigation receiver: position, velocity and heading with the errors of `carla` or of `physical`.

    The reference point is that of CARLA's first towns, 49 deg north and 8 deg east.

    Source: geoReference of Town01 (carla-simulator/carla pull request 1167) and of Town07; the files of Town10HD give
    0, 0 (opendilab/LMDrive issue 19). Values of `carla`: the published dataset's configuration. Values of `physical`:
    design values for a single-frequency receiver under open sky.
    """

    type: Literal["gnss"] = "gnss"
    name: Name = Field(default="gnss", description="sensor name (name)")
    on: tuple[AgentKey, ...] = Field(default=("cav",), description="agents that carry it (list)")
    mode: Literal["carla", "physical"] = Field(
        default="carla", description="CARLA's map and white noise, or WGS-84 and errors that drift (name)"
    )
    reference_latitude_deg: float = Field(
        default=49.0, ge=-89, le=89, description="latitude of the world's origin [deg]"
    )
    reference_longitude_deg: float = Field(
        default=8.0, ge=-180, le=180, description="longitude of the world's origin [deg]"
    )
    reference_altitude_m: float = Field(
        default=0.0, ge=-1000, le=10_000, description="height of the world's origin [m]"
    )
    heading_noise_std_deg: float = Field(
        default=0.1, ge=0, le=180, description="white noise of the heading, in both modes [deg]"
    )
    # carla
    latitude_noise_std_deg: float = Field(
        default=1e-5, ge=0, le=0.1, description="carla: white noise, 1.1 m at the default [deg]"
    )
    longitude_noise_std_deg: float = Field(
        default=1e-5, ge=0, le=0.1, description="carla: white noise, 0.7 m at 49 deg north [deg]"
    )
    altitude_noise_std_m: float = Field(default=0.005, ge=0, le=10_000, description="carla: white noise [m]")
    speed_noise_std_m_s: float = Field(default=0.2, ge=0, le=1000, description="carla: white noise of the speed [m/s]")
    # physical
    horizontal_drift_std_m: float = Field(default=1.0, ge=0, le=10_000, description="physical: drift of x and of y [m]")
    vertical_drift_std_m: float = Field(default=2.0, ge=0, le=10_000, description="physical: drift of z [m]")
    drift_correlation_s: float = Field(default=100.0, gt=0, description="physical: correlation time of the drift [s]")
    horizontal_noise_std_m: float = Field(
        default=0.1, ge=0, le=10_000, description="physical: white noise of x and of y [m]"
    )
    vertical_noise_std_m: float = Field(default=0.2, ge=0, le=10_000, description="physical: white noise of z [m]")
    velocity_noise_std_m_s: float = Field(
        default=0.05, ge=0, le=1000, description="physical: white noise of each velocity axis [m/s]"
    )

    @property
    def reference(self) -> tuple[float, float, float]:
        """Latitude [deg], longitude [deg] and height [m] of the world's origin."""
        return self.reference_latitude_deg, self.reference_longitude_deg, self.reference_altitude_m
