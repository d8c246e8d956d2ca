"""Define the section `type: radar`, an automotive radar at 77 GHz."""

import math
from typing import Literal

from pydantic import Field, model_validator

from mmw.config.agent_keys import AgentKey
from mmw.config.section import Name
from mmw.config.sensor import MountConfig, SensorConfig, at_side, mounts_at
from mmw.core.constants import FRAME_DT, SPEED_OF_LIGHT
from mmw.core.errors import InputError

REFERENCE_RCS_M2 = 10.0
"""Radar cross section of the target that `reference_snr_db` refers to: 10 dBsm, a passenger car [m2]. Design value."""

REFERENCE_RANGE_M = 100.0
"""Distance of that target [m]. Design value."""

MAX_IQ_SAMPLES = 2**24
"""Complex samples that a sweep may have: 128 MiB. Design value."""

MAX_FALSE_ALARMS = 20_000
"""False alarms of a sample: ten times the points of CARLA's. Design value."""


class Radar(SensorConfig):
    """A radar that looks along its x axis, at the instant of the frame.

    `carla` casts CARLA's rays and has no power. `physical` is an FMCW radar: a link budget for every ray of a grid
    over the field of view, then detections of its resolution cells, or the rays themselves (`output: dense`). Its
    virtual antennas transmit at the same time, half a wavelength apart.
    """

    type: Literal["radar"] = "radar"
    name: Name = Field(default="radar", description="sensor name (name)")
    on: tuple[AgentKey, ...] = Field(default=("rsu",), description="agents that carry it (list)")
    mount: dict[AgentKey, MountConfig] = mounts_at(at_side("front", 0.6), rsu=(0, 0, 4.1), cav=(2.5, 0, 0.6))
    mode: Literal["carla", "physical"] = Field(default="physical", description="CARLA's radar, or a link budget (name)")
    output: Literal["detections", "dense"] = Field(
        default="detections", description="in `physical`: what is detected, or every ray that hits something (name)"
    )
    horizontal_fov_deg: float = Field(default=110.0, gt=0, lt=180, description="horizontal field of view [deg]")
    vertical_fov_deg: float = Field(default=30.0, gt=0, lt=180, description="vertical field of view [deg]")
    range_m: float = Field(
        default=100.0,
        gt=0,
        le=1000,
        description="longest distance; in `carla` the distance of CARLA's plane of targets [m]",
    )
    points: int = Field(default=2000, ge=1, le=1_000_000, description="rays of a sample in `carla` (count)")

    azimuth_rays: int = Field(
        default=220, ge=1, le=4096, description="columns of the grid of rays in `physical` (count)"
    )
    elevation_rays: int = Field(default=60, ge=1, le=4096, description="rows of the grid of rays in `physical` (count)")
    carrier_hz: float = Field(default=76.5e9, ge=1e9, le=200e9, description="carrier frequency [Hz]")
    bandwidth_hz: float = Field(
        default=300e6, gt=0, le=10e9, description="sweep of a chirp; 300 MHz resolve 0.5 m [Hz]"
    )
    chirp_time_s: float = Field(
        default=20e-6, gt=0, le=FRAME_DT, description="time from chirp to chirp; 20 us measure 49 m/s either way [s]"
    )
    frame_time_s: float = Field(
        default=FRAME_DT, gt=0, le=FRAME_DT, description="coherent time of a sample; 10 ms resolve 0.2 m/s [s]"
    )
    azimuth_antennas: int = Field(
        default=86, ge=1, le=1024, description="virtual antennas side by side; 86 resolve 1.3 deg (count)"
    )
    elevation_antennas: int = Field(
        default=8, ge=1, le=1024, description="virtual antennas one above the other; 8 resolve 14 deg (count)"
    )
    transmit_power_dbm: float = Field(default=12.0, ge=-50, le=60, description="transmitted power [dBm]")
    antenna_gain_dbi: float = Field(
        default=10.0,
        ge=-20,
        le=60,
        description="gain on boresight of transmitter and of receiver, array included [dBi]",
    )
    horizontal_beam_deg: float | None = Field(
        default=None, gt=0, le=360, description="half-power width of either antenna; left out, the field of view [deg]"
    )
    vertical_beam_deg: float | None = Field(
        default=None, gt=0, le=360, description="half-power width of either antenna; left out, the field of view [deg]"
    )
    reference_snr_db: float = Field(
        default=15.0,
        ge=-50,
        le=100,
        description="SNR of 10 dBsm at 100 m on boresight in clear air: sets the noise [dB]",
    )
    false_alarm_probability: float = Field(
        default=1e-8, gt=0, lt=0.1, description="that a cell without a target is detected; 1e-8 gives 0.2 a sample [-]"
    )
    wet_radome_db: float = Field(
        default=2.0, ge=0, le=40, description="loss of the water film at 10 mm/h, both ways together [dB]"
    )
    multipath: Literal["none", "ground", "full"] = Field(
        default="none",
        description="in `physical`: paths beside the direct one: over the ground, or in `full` over all mirrors (name)",
    )
    coherent: bool = Field(
        default=False,
        description="in `physical`: whether echoes in a cell add up as amplitudes with phases, not as powers (flag)",
    )
    maps: tuple[Literal["range_azimuth", "range_doppler"], ...] = Field(
        default=(), description="power maps to store as well, in `physical` (list)"
    )
    iq: bool = Field(
        default=False, description="whether to store the samples of the receiver too, in `physical` (flag)"
    )

    @model_validator(mode="after")
    def _consistent(self) -> "Radar":
        if self.chirp_time_s > self.frame_time_s:
            raise InputError(
                f"chirp_time_s = {self.chirp_time_s:g} is longer than frame_time_s = {self.frame_time_s:g}; a sample "
                "holds at least one chirp; shorten it"
            )
        if self.bandwidth_hz > self.carrier_hz / 2.0:
            raise InputError(
                f"bandwidth_hz = {self.bandwidth_hz:g} is more than half of carrier_hz = {self.carrier_hz:g}; lower it"
            )
        if self.range_resolution > self.range_m:
            raise InputError(
                f"bandwidth_hz = {self.bandwidth_hz:g} resolves {self.range_resolution:.3g} m, range_m = "
                f"{self.range_m:g}; a cell must be shorter than the range; raise bandwidth_hz"
            )
        if self.mode == "carla" and (self.maps or self.iq or self.output == "dense"):
            raise InputError(
                "mode = carla has no power: output: dense, maps and iq need mode: physical; leave them out"
            )
        if self.mode == "carla" and (self.multipath != "none" or self.coherent):
            raise InputError(
                f"mode = carla has no power: multipath = {self.multipath} and coherent = {self.coherent} need mode: "
                "physical; leave them out"
            )
        if self.coherent and self.output == "dense" and not self.maps:
            raise InputError(
                "coherent: true adds up the echoes of resolution cells, and output = dense has none; leave it out, set "
                "output: detections, or add maps"
            )
        if self.iq and math.prod(self.iq_shape) > MAX_IQ_SAMPLES:
            raise InputError(
                f"iq of {' x '.join(map(str, self.iq_shape))} = {math.prod(self.iq_shape)} samples (antennas, chirps, "
                f"samples of a chirp); a sweep holds at most {MAX_IQ_SAMPLES}; lower azimuth_antennas, "
                "elevation_antennas or frame_time_s, raise chirp_time_s, or set iq: false"
            )
        false_alarms = self.false_alarm_probability * math.prod(self.iq_shape)
        if self.mode == "physical" and self.output == "detections" and false_alarms > MAX_FALSE_ALARMS:
            raise InputError(
                f"false_alarm_probability = {self.false_alarm_probability:g} in {math.prod(self.iq_shape)} cells gives "
                f"{false_alarms:.3g} false alarms a sample; at most {MAX_FALSE_ALARMS} are possible; lower it"
            )
        if len(set(self.maps)) != len(self.maps):
            raise InputError(f"maps = {list(self.maps)} names one twice; name each once")
        return self

    @property
    def needs_paths(self) -> bool:
        """True if rays are traced on, for multipath or for exact phases."""
        return self.multipath != "none" or self.coherent

    @property
    def wavelength(self) -> float:
        """Wavelength of the carrier in vacuum [m]."""
        return SPEED_OF_LIGHT / self.carrier_hz

    @property
    def range_resolution(self) -> float:
        """Length of a range cell, c / 2B [m]. Source: Richards, Fundamentals of Radar Signal Processing."""
        return SPEED_OF_LIGHT / (2.0 * self.bandwidth_hz)

    @property
    def range_cells(self) -> int:
        """Range cells up to `range_m` (count)."""
        return math.ceil(self.range_m / self.range_resolution)

    @property
    def chirps(self) -> int:
        """Whole chirps of a sample (count)."""
        return max(math.floor(self.frame_time_s / self.chirp_time_s + 1e-9), 1)

    @property
    def iq_shape(self) -> tuple[int, int, int]:
        """Virtual antennas, chirps, and samples of a chirp: one for each range cell and one for 0 m, so that no range
        is ambiguous (count)."""
        return self.azimuth_antennas * self.elevation_antennas, self.chirps, self.range_cells + 1

    @property
    def velocity_resolution(self) -> float:
        """Width of a velocity cell, wavelength / 2T with T the whole chirps of a sample [m/s]. Source: as above."""
        return self.wavelength / (2.0 * self.chirps * self.chirp_time_s)

    @property
    def max_velocity(self) -> float:
        """Largest velocity without a fold, wavelength / 4 T_chirp: +-this is measured [m/s]. Source: as above."""
        return self.wavelength / (4.0 * self.chirp_time_s)

    @property
    def azimuth_resolution(self) -> float:
        """Width of an azimuth cell on boresight, 2 / N [rad]: N antennas half a wavelength apart resolve 2 / N in the
        sine of the angle, so it widens as 1 / cos. Source: as above."""
        return 2.0 / self.azimuth_antennas

    @property
    def link_constant(self) -> float:
        """Pt Gt Gr wavelength^2 / (4 pi)^3 on boresight [W m2]: times RCS over R^4 it is the received power [W].

        Source: radar equation, as above.
        """
        decibels = self.transmit_power_dbm - 30.0 + 2.0 * self.antenna_gain_dbi
        return 10.0 ** (decibels / 10.0) * self.wavelength**2 / (4.0 * math.pi) ** 3

    @property
    def noise_w(self) -> float:
        """Noise power of a cell after all processing [W]: what gives the reference target `reference_snr_db`."""
        reference = self.link_constant * REFERENCE_RCS_M2 / REFERENCE_RANGE_M**4
        return reference / 10.0 ** (self.reference_snr_db / 10.0)

    @property
    def solid_angle(self) -> float:
        """Solid angle of one ray of the grid, which is even in azimuth and in the sine of elevation [sr]."""
        azimuth = math.radians(self.horizontal_fov_deg) / self.azimuth_rays
        return azimuth * 2.0 * math.sin(math.radians(self.vertical_fov_deg) / 2.0) / self.elevation_rays

    @property
    def ray_count(self) -> int:
        """Rays of a sample."""
        return self.points if self.mode == "carla" else self.azimuth_rays * self.elevation_rays
