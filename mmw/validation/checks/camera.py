"""Compare the light that cameras see with the daylight of the IES and the CIE."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np

from mmw.physics.weather.weather import Weather
from mmw.sensors.render.sky.sky import LUMINANCE, bake
from mmw.validation.check import Check, Measurement, Reference, Source

IES = Source(
    "IES, Recommended practice for the calculation of daylight availability, J. Illum. Eng. Soc. 13, 1984",
    "clear and cloudy sky: extinction 0.21, sky 0.8 + 15.5 sin^0.5 and 0.3 + 21 sin klx",
    "https://doi.org/10.1080/00994480.1984.10748791", "citation",
)  # fmt: skip
SPREAD = Source(
    "Asian Institute of Technology, Daylighting availability",
    "section 3.3: the models of CIE and IESNA are means, and values at one instant may be half or twice as large",
    "http://www.serd.ait.ac.th/ep/mtec/selfstudy/Chapter3/daylighting_availability.html", "document",
)  # fmt: skip

ALTITUDE_DEG = 45.0
"""Altitude of the sun [deg]."""

ALTITUDES_DEG = np.array([10.0, 20.0, 30.0, 45.0, 60.0, 75.0])


@cache
def _daylight_klux(altitude_deg: float, cloudiness: float) -> tuple[float, float]:
    """Return the illuminance of a plane that faces the sun, by the sun alone, and of level ground, by sun and sky."""
    sky = bake(Weather(sun_altitude_deg=altitude_deg, cloudiness=cloudiness))
    return float(sky.sun_illuminance @ LUMINANCE), sky.horizontal_klux


def beam_klux(altitude_deg: np.ndarray) -> np.ndarray:
    """Return the illuminance by the sun of a plane that faces it under a clear sky [klux], IES 1984, equation 4."""
    return 127.5 * np.exp(-0.21 / np.sin(np.radians(altitude_deg)))


def clear_sky_klux(altitude_deg: np.ndarray) -> np.ndarray:
    """Return the illuminance of level ground by a clear sky without the sun [klux], IES 1984."""
    return 0.8 + 15.5 * np.sqrt(np.sin(np.radians(altitude_deg)))


def cloudy_sky_klux(altitude_deg: np.ndarray) -> np.ndarray:
    """Return the illuminance of level ground by a cloudy sky [klux], IES 1984."""
    return 0.3 + 21.0 * np.sin(np.radians(altitude_deg))


def _sun_to_shade(altitude_deg: float) -> float:
    """Return the illuminance of level ground in the sun over that in the shade of something small, clear sky."""
    beam, level = _daylight_klux(altitude_deg, 0.0)
    return level / (level - beam * float(np.sin(np.radians(altitude_deg))))


def _curve(
    value: Callable[[float], float], model: Callable[[np.ndarray], np.ndarray], label: str
) -> Callable[[str], Measurement]:
    """Return the measurement of a value at `ALTITUDE_DEG`, drawn over the altitude of the sun."""

    def measure(device: str) -> Measurement:
        def draw(axes: Any) -> None:
            axes.plot(ALTITUDES_DEG, [value(own) for own in ALTITUDES_DEG.tolist()], "o-", ms=4, label="simulated")
            axes.plot(ALTITUDES_DEG, model(ALTITUDES_DEG), "k--", lw=1, label="IES")
            axes.set_xlabel("altitude of the sun [deg]")
            axes.set_ylabel(label)
            axes.set_ylim(bottom=0.0)
            axes.legend(fontsize=8)

        return Measurement(value(ALTITUDE_DEG), draw=draw)

    return measure


def _ratio_model(altitude_deg: np.ndarray) -> np.ndarray:
    sky = clear_sky_klux(altitude_deg)
    return (beam_klux(altitude_deg) * np.sin(np.radians(altitude_deg)) + sky) / sky


def _at(model: Callable[[np.ndarray], np.ndarray]) -> float:
    return float(model(np.array(ALTITUDE_DEG)))


CHECKS = (
    Check(
        name="camera.beam_illuminance",
        title="Illuminance by the sun at 45 degrees under a clear sky",
        computed="baked sky of the camera, visibility 20 km, no clouds; plane that faces the sun",
        unit="klx",
        reference=Reference.within_share(_at(beam_klux), 0.2),
        tolerance="20 %: haze of clear days",
        sources=(IES,),
        measure=_curve(lambda own: _daylight_klux(own, 0.0)[0], beam_klux, "sun, facing plane [klx]"),
    ),
    Check(
        name="camera.sun_to_shade",
        title="Sun to shade: level ground in the sun over level ground in the shade, sun at 45 degrees",
        computed="baked sky of the camera, visibility 20 km, no clouds; sun and sky over sky alone",
        unit="",
        reference=Reference.within_factor(_at(_ratio_model), 2.0),
        tolerance="a factor 2, by which skies of one instant differ from the mean",
        sources=(IES, SPREAD),
        measure=_curve(_sun_to_shade, _ratio_model, "sun to shade"),
    ),
    Check(
        name="camera.cloudy_illuminance",
        title="Illuminance of level ground under a closed cover of clouds, sun at 45 degrees",
        computed="baked sky of the camera at cloudiness 1, without rain",
        unit="klx",
        reference=Reference.within_factor(_at(cloudy_sky_klux), 2.0),
        tolerance="a factor 2, by which skies of one instant differ from the mean",
        sources=(IES, SPREAD),
        measure=_curve(lambda own: _daylight_klux(own, 1.0)[1], cloudy_sky_klux, "level ground [klx]"),
    ),
)
"""Rows of this topic."""
