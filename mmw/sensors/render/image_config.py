"""Define settings of a camera image: exposure, shutter, noise, tone map, and rain in front of the lens."""

from typing import Literal

from pydantic import Field, model_validator

from mmw.config.section import Section
from mmw.core.errors import InputError


class ExposureConfig(Section):
    """Exposure of an image."""

    mode: Literal["fixed", "auto"] = Field(
        default="fixed",
        description="`fixed`: one exposure for all pictures of a weather, from its light, or `ev100`; `auto`: each "
        "picture by its own mean, without memory of the one before (name)",
    )
    ev_compensation: float = Field(
        default=0.0, ge=-10, le=10, description="brighter (above 0) or darker by powers of 2 [EV]"
    )
    ev100: float | None = Field(
        default=None,
        ge=-10,
        le=24,
        description="exposure value at ISO 100 for `fixed`; none: from the light of the weather [EV]",
    )
    min_ev100: float = Field(default=-2.0, ge=-10, le=24, description="`auto`: exposure of the darkest pictures [EV]")
    max_ev100: float = Field(default=17.0, ge=-10, le=24, description="`auto`: exposure of the brightest pictures [EV]")

    @model_validator(mode="after")
    def _fits(self) -> "ExposureConfig":
        if self.mode == "auto" and self.ev100 is not None:
            raise InputError(
                f"ev100 = {self.ev100:g} with mode: auto, which finds its own; drop ev100, or use mode: fixed"
            )
        if self.min_ev100 > self.max_ev100:
            raise InputError(
                f"min_ev100 = {self.min_ev100:g} lies above max_ev100 = {self.max_ev100:g}; the smaller goes first; "
                "swap them"
            )
        return self


class NoiseConfig(Section):
    """Noise of the sensor: photon noise and read noise of each pixel and channel."""

    enabled: bool = Field(
        default=False,
        description="off, still pictures stay still and compress better; on, pixels get noise (true or false)",
    )
    full_well: float = Field(
        default=10_000.0,
        ge=100,
        le=1e6,
        description="electrons of a pixel that is just white; photon noise is their root [e-]",
    )
    read_noise: float = Field(default=3.0, ge=0, le=1000, description="standard deviation of the read noise [e-]")


class ImageConfig(Section):
    """From light to a picture. The defaults are a clean picture at fixed exposure."""

    exposure: ExposureConfig = Field(default_factory=ExposureConfig, description="brightness (map)")
    shutter_ms: float = Field(
        default=5.0, gt=0, le=40, description="exposure time: length of rain streaks and motion blur [ms]"
    )
    motion_blur: bool = Field(default=False, description="blur by what moves while the shutter is open (true or false)")
    tone_map: Literal["aces", "none"] = Field(
        default="aces", description="`aces`: filmic curve with soft highlights; `none`: clipped at white (name)"
    )
    noise: NoiseConfig = Field(default_factory=NoiseConfig, description="noise of the sensor (map)")
    streaks: bool = Field(default=True, description="falling drops near the camera while it rains (true or false)")
