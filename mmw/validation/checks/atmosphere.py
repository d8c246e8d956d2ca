"""Compare the attenuation by air, rain and fog with the validation examples of the ITU-R Recommendations."""

from typing import Any

import numpy as np

from mmw.physics.em.attenuation import path_loss_db
from mmw.physics.weather.weather import Weather
from mmw.validation.check import Check, Measurement, Reference, Source

P676 = Source(
    "ITU-R P.676-13, validation examples CG-3M3J-13", "annex 1, 15 C, 7.5 g/m3, as in the test data of ITU-Rpy",
    "https://www.itu.int/rec/R-REC-P.676", "other code",
)  # fmt: skip
P838 = Source(
    "ITU-R P.838-3", "equations 1 to 3 at 28 GHz, as itur 0.4.0 computes them", "https://www.itu.int/rec/R-REC-P.838",
    "other code",
)  # fmt: skip
P840 = Source(
    "ITU-R P.840-9", "section 2: K_l at 60 GHz and 10 C, as itur 0.4.0 computes it",
    "https://www.itu.int/rec/R-REC-P.840", "other code",
)  # fmt: skip

GHZ = np.geomspace(1.0, 100.0, 200)


def loss_db_per_km(weather: Weather, ghz: np.ndarray) -> np.ndarray:
    """Return what a level, vertically polarized path of 1 km loses in a weather [dB], shape [C]."""
    losses = path_loss_db(weather, 1e9 * ghz, np.array([1000.0]), np.array([0.0]))
    return np.sum([loss[0] for loss in losses.values()], axis=0)


def _row(
    name: str, title: str, ghz: float, weather: Weather, without: Weather, reference: float, share: float,
    tolerance: str, source: Source, computed: str,
) -> Check:  # fmt: skip
    """Return a row of the loss in a weather, less that in another one."""

    def measure(device: str) -> Measurement:
        def loss(at: np.ndarray) -> np.ndarray:
            dry = loss_db_per_km(without, at) if without is not weather else np.zeros(len(at))
            return loss_db_per_km(weather, at) - dry

        def draw(axes: Any) -> None:
            axes.plot(GHZ, loss(GHZ), label="simulated")
            axes.plot([ghz], [reference], "ks", ms=5, label="published")
            axes.set_xscale("log")
            axes.set_yscale("log")
            axes.set_xlabel("frequency [GHz]")
            axes.set_ylabel("dB/km")
            axes.legend(fontsize=8)

        return Measurement(float(loss(np.array([ghz]))[0]), draw=draw)

    return Check(
        name=f"atmosphere.{name}",
        title=title,
        computed=computed,
        unit="dB/km",
        reference=Reference.within_share(reference, share),
        tolerance=tolerance,
        sources=(source,),
        measure=measure,
    )


CLEAR, RAIN = Weather(), Weather(rain_mm_h=25.0)
FOG = Weather(visibility_m=60.0, lwc_g_m3=0.5, temperature_c=10.0)
FOG_AIR = Weather(temperature_c=10.0)

CHECKS = (
    _row(
        "gas_60ghz", "Attenuation by the air at 60 GHz", 60.0, CLEAR, CLEAR, 14.778, 0.02,
        "2 %: the weather's pressure includes the vapor, that of the example does not (1 %)", P676,
        "air losses of a path of 1 km in the default weather",
    ),
    _row(
        "rain_28ghz", "Attenuation by rain of 25 mm/h at 28 GHz, vertical polarization", 28.0, RAIN, CLEAR, 3.891, 0.01,
        "1 %: rounding", P838, "air losses of a path of 1 km in rain, less those without",
    ),
    _row(
        "fog_60ghz", "Attenuation by fog of 0.5 g/m3 at 60 GHz", 60.0, FOG, FOG_AIR, 1.048, 0.01,
        "1 %: rounding", P840, "air losses of a path of 1 km in fog of 10 C, less those without",
    ),
)  # fmt: skip
"""Rows of this topic."""
