"""Define the section `type: gnss`, a satellite navigation receiver."""

from datetime import datetime
from typing import Literal

from pydantic import Field, field_validator

from mmw.config.agent_keys import AgentKey
from mmw.config.section import Name
from mmw.config.sensor import SensorConfig
from mmw.core.errors import InputError


class Gnss(SensorConfig):
    """A satellite navigation receiver: position, velocity and heading with the errors of one of three models.

    The reference point is that of CARLA's first towns, 49 deg north and 8 deg east.

    Source: geoReference of Town01 (carla-simulator/carla pull request 1167) and of Town07; the files of Town10HD give
    0, 0 (opendilab/LMDrive issue 19). Values of `carla`: the published dataset's configuration. Values of `physical`:
    design values for a single-frequency receiver under open sky, and so is `residual_range_std_m`, which gives the same
    errors there. Values of `ray_traced` otherwise: C/N0 by the link budget of GPS L1 C/A at 0 to 4 dBi, 43 to 46 dB Hz;
    integration over a bit of data, 20 ms (IS-GPS-200); design values of a receiver with a patch antenna.
    """

    type: Literal["gnss"] = "gnss"
    name: Name = Field(default="gnss", description="sensor name (name)")
    on: tuple[AgentKey, ...] = Field(default=("cav",), description="agents that carry it (list)")
    mode: Literal["carla", "physical", "ray_traced"] = Field(
        default="carla",
        description="CARLA's map and white noise; WGS-84 and errors that drift; or the same, and errors by what the "
        "signals of satellites meet in the scene (name)",
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
        default=0.1, ge=0, le=180, description="white noise of the heading, in every mode [deg]"
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
    drift_correlation_s: float = Field(
        default=100.0, gt=0, description="physical, ray_traced: correlation time of the drift [s]"
    )
    horizontal_noise_std_m: float = Field(
        default=0.1, ge=0, le=10_000, description="physical: white noise of x and of y [m]"
    )
    vertical_noise_std_m: float = Field(default=0.2, ge=0, le=10_000, description="physical: white noise of z [m]")
    velocity_noise_std_m_s: float = Field(
        default=0.05, ge=0, le=1000, description="physical, ray_traced: white noise of each velocity axis [m/s]"
    )
    # ray_traced
    epoch: str = Field(
        default="2026-06-21T16:00:00Z",
        description="ray_traced: date and time of frame 0, by which the satellites stand where they do (ISO 8601)",
    )
    elevation_mask_deg: float = Field(
        default=5.0, ge=0, le=60, description="ray_traced: satellites below this elevation are not used [deg]"
    )
    physics: Literal["paper", "standard"] = Field(
        default="standard",
        description="ray_traced: preset of the path solver as in `channel.physics`; `standard` has finite surfaces, "
        "diffraction, slabs and foliage, `paper` mirrors alone (name)",
    )
    max_depth: int = Field(default=1, ge=0, le=3, description="ray_traced: most interactions on a path (count)")
    samples_per_tx: int = Field(
        default=100_000,
        ge=1000,
        le=2**24,
        description="ray_traced: rays from each antenna that look for reflecting surfaces (count)",
    )
    residual_range_std_m: float = Field(
        default=1.2,
        ge=0,
        le=1000,
        description="ray_traced: drift of each satellite's range by orbits, clocks and what is left of the atmosphere, "
        "the same for all receivers [m]",
    )
    cn0_zenith_db: float = Field(
        default=45.0,
        ge=20,
        le=70,
        description="ray_traced: carrier to noise density of a free satellite at zenith [dB Hz]",
    )
    tracking_threshold_db: float = Field(
        default=25.0,
        ge=0,
        le=70,
        description="ray_traced: carrier to noise density below which a satellite is lost [dB Hz]",
    )
    axial_ratio_db: float = Field(
        default=6.0,
        ge=0,
        le=40,
        description="ray_traced: axial ratio of the antenna; 6 dB takes 9.6 dB from left-handed waves [dB]",
    )
    correlator_spacing_chips: float = Field(
        default=0.5, ge=0.05, le=1.0, description="ray_traced: spacing of early and late correlators (chips of 293 m)"
    )
    loop_bandwidth_hz: float = Field(
        default=0.5, gt=0, le=100, description="ray_traced: noise bandwidth of the delay lock loop [Hz]"
    )
    integration_time_s: float = Field(
        default=0.02, gt=0, le=1, description="ray_traced: time over which correlators integrate coherently [s]"
    )

    @field_validator("epoch")
    @classmethod
    def _a_time(cls, value: str) -> str:
        try:
            datetime.fromisoformat(value)
        except ValueError:
            raise InputError(f"{value!r} is no date and time of ISO 8601; write it as 2026-06-21T12:00:00Z") from None
        return value

    @property
    def reference(self) -> tuple[float, float, float]:
        """Latitude [deg], longitude [deg] and height [m] of the world's origin."""
        return self.reference_latitude_deg, self.reference_longitude_deg, self.reference_altitude_m
