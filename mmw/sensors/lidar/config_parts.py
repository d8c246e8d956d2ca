"""Define sub-sections of a LiDAR: its laser and receiver (`optics`), and CARLA's attributes (`carla`)."""

from dataclasses import replace
from typing import Literal

from pydantic import Field

from mmw.config.section import Section
from mmw.sensors.lidar.optics import PRESETS, LidarOptics

LidarPreset = Literal["hdl64", "modern64", "nir1550", "lisa"]


class LidarOpticsConfig(Section):
    """Laser and receiver, the fields of `LidarOptics`. What is left out comes from the sensor's `preset`."""

    wavelength_nm: int | None = Field(default=None, description="wavelength of the laser, 905 or 1550 [nm]")
    aperture_m: float | None = Field(default=None, description="diameter of the beam at the sensor [m]")
    divergence: float | None = Field(default=None, description="full angle by which the beam widens [rad]")
    min_power: float | None = Field(
        default=None, description="weakest return: reflectance over squared range, such as 0.1 / 50^2 [1/m2]"
    )
    overlap_start_m: float | None = Field(
        default=None, description="range where the receiver begins to see the beam [m]"
    )
    overlap_full_m: float | None = Field(default=None, description="range from which it sees all of the beam [m]")
    overlap_exponent: float | None = Field(
        default=None, description="power with which the share it sees grows between the two, 1 to 4 [-]"
    )
    threshold_snr: float | None = Field(
        default=None, description="min_power over the standard deviation of the receiver's noise, 4 or more [-]"
    )
    pulse_s: float | None = Field(default=None, description="half-power length of the pulse; 0: fog has no echo [s]")
    nearest_m: float | None = Field(default=None, description="nearest range of an echo of rain or fog [m]")
    range_resolution_m: float | None = Field(
        default=None, description="range resolution: the noise is this over sqrt(2 SNR); 0 for no noise [m]"
    )
    drop_backscatter: float | None = Field(
        default=None, description="backscatter efficiency of a rain drop; left out, that of the wavelength [-]"
    )

    def over(self, preset: LidarPreset) -> LidarOptics:
        """Return a preset with the values that are given here.

        Raises:
            InputError: If a value is out of bounds, or two do not fit each other.
        """
        return replace(PRESETS[preset], **self.model_dump(exclude_none=True))


class CarlaLidarConfig(Section):
    """Attributes of CARLA 0.9.15's `sensor.lidar.ray_cast`; the defaults are the paper's."""

    atmosphere_attenuation_rate: float = Field(default=0.004, ge=0, le=10, description="decay of the intensity [1/m]")
    dropoff_general_rate: float = Field(default=0.0, ge=0, le=1, description="share of rays that are lost anyway [-]")
    dropoff_intensity_limit: float = Field(
        default=1.0, ge=0, le=1, description="intensity above which nothing is lost [-]"
    )
    dropoff_zero_intensity: float = Field(default=0.4, ge=0, le=1, description="share lost at intensity 0 [-]")
    noise_stddev: float = Field(default=0.0, ge=0, le=10, description="standard deviation of the range [m]")
