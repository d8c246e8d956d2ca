"""Compare traced satellites with measured errors under open sky, and with a simulated canyon of Hong Kong."""

from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np

from mmw.core.geodesy import world_from_ecef, world_from_wgs84
from mmw.physics.weather.weather import PRESETS
from mmw.scene.scene import Scene
from mmw.sensors.gnss.config import Gnss
from mmw.sensors.gnss.constellation import SLOT_NAMES, satellite_positions, seconds_since_slots
from mmw.sensors.gnss.position_fix import dilution
from mmw.validation.canyon import open_ground, urban_canyon
from mmw.validation.check import Check, Measurement, Reference, Source

ICKING = Source(
    "Icking, Zhang, Hsu and Schön, Quantification of GNSS NLOS spatial correlation: a case study in Hong Kong's urban "
    "canyon, ION ITM 2022", "abstract", "https://doi.org/10.33012/2022.18165", "abstract",
)  # fmt: skip
MILBERT = Source(
    "Milbert, Dilution of precision revisited, NAVIGATION 55, 2008", "abstract: mean VDOP / HDOP of the almanac",
    "https://pdfslide.us/documents/dilution-of-precision-revisited-of-precision-revisited-dennis-milbert-rockville.html",
    "abstract",
)  # fmt: skip
SPS = Source(
    "GPS.gov, GPS accuracy", "accuracy of users: FAA reference receivers, and telephones under open sky",
    "https://www.gps.gov/systems/gps/performance/accuracy/", "citation",
)  # fmt: skip

HONG_KONG = {"reference_latitude_deg": 22.3, "reference_longitude_deg": 114.17}

SEEDS, EPOCHS = 3, 8
"""Canyons, and times of a day, of the pairs."""

ALONG_M, ACROSS_M, STEP_M, ANTENNA_M = 120.0, 5.0, 20.0, 1.8
"""Places of receivers: on both sides of the street, up to this far from the middle, this far apart, this high."""

MAX_PDOP = 6.0
"""Largest dilution of precision of a pair's common satellites; the GPS standard promises it for 98 % of a day."""

SHARE = 0.2
"""Share of the pairs that counts as those of low or of high correlation."""


@dataclass(frozen=True)
class Pairs:
    """Pairs of receivers in canyons."""

    correlation: np.ndarray
    """Correlation of the multipath errors of common satellites over a day, sorted, shape [N]."""
    error: np.ndarray
    """Mean error of the relative position by common satellites [m], shape [N]."""

    def of(self, *, is_high: bool) -> tuple[float, float]:
        """Return the mean correlation and error [m] of the pairs at one end."""
        count = max(1, round(SHARE * len(self.error)))
        part = slice(-count, None) if is_high else slice(count)
        return float(self.correlation[part].mean()), float(self.error[part].mean())


def _captured(scene: Scene, places: np.ndarray, config: Gnss) -> list[Any]:
    """Return the samples of receivers that drive along x at 10 m/s."""
    poses = np.column_stack([places, np.zeros((len(places), 3)), np.ones(len(places))])
    return scene.capture(config, pose=poses, velocity=(10.0, 0.0, 0.0))


def _epoch(hour: float) -> str:
    return f"2026-06-21T{int(hour):02d}:{int(hour % 1 * 60):02d}:00Z"


@cache
def _pairs(device: str) -> Pairs:
    """Return all pairs of receivers of one canyon, for some canyons."""
    along = np.arange(-ALONG_M, ALONG_M + 1.0, STEP_M)
    places = np.array([(x, y, ANTENNA_M) for x in along for y in (-ACROSS_M, ACROSS_M)])
    found: list[tuple[float, float]] = []
    for seed in range(SEEDS):
        scene = Scene(urban_canyon(seed), {"sunny": PRESETS["sunny"]}, device=device, name="canyon")
        shape = len(places), EPOCHS, len(SLOT_NAMES)
        multipath, error, direction = np.full(shape, np.nan), np.full(shape, np.nan), np.zeros((*shape[1:], 3))
        for k in range(EPOCHS):
            config = Gnss(mode="ray_traced", residual_range_std_m=0.0, epoch=_epoch(24.0 * k / EPOCHS), **HONG_KONG)
            for row, sample in enumerate(_captured(scene, places, config)):
                own = sample.satellites
                number = [SLOT_NAMES.index(name) for name in own.satellite]
                multipath[row, k, number], error[row, k, number] = own.multipath_error, own.pseudorange_error
                across = np.cos(own.elevation)
                east, north = across * np.sin(own.azimuth), across * np.cos(own.azimuth)
                direction[k, number] = np.stack([east, north, np.sin(own.elevation)], axis=1)
        for one in range(len(places)):
            for other in range(one):
                pair = _pair(multipath[[one, other]], error[[one, other]], direction)
                found += [] if pair is None else [pair]
    correlation, relative = np.array(sorted(found)).T
    return Pairs(correlation, relative)


def _pair(multipath: np.ndarray, error: np.ndarray, direction: np.ndarray) -> tuple[float, float] | None:
    """Return correlation, and mean error of the relative position [m], of two receivers; None with few satellites.

    Args:
        multipath: Multipath errors [m], NaN where not tracked, shape [2, E, S].
        error: Errors of pseudo-ranges [m], shape [2, E, S].
        direction: Unit vectors to the satellites, shape [E, S, 3].
    """
    is_common = np.isfinite(multipath).all(axis=0)
    if is_common.sum() < 10:
        return None
    relative = []
    for k, common in enumerate(is_common):
        if common.sum() >= 4 and np.hypot(*dilution(direction[k, common])) < MAX_PDOP:
            design = np.column_stack([-direction[k, common], np.ones(common.sum())])
            single_difference = error[0, k, common] - error[1, k, common]
            relative.append(np.linalg.norm(np.linalg.lstsq(design, single_difference, rcond=None)[0][:3]))
    if len(relative) < 2:
        return None
    return float(np.corrcoef(multipath[0][is_common], multipath[1][is_common])[0, 1]), float(np.mean(relative))


def _measure_pairs(device: str, *, is_high: bool) -> Measurement:
    pairs = _pairs(device)
    correlation, error = pairs.of(is_high=is_high)

    def draw(axes: Any) -> None:
        axes.plot(pairs.correlation, pairs.error, ".", ms=3, color="#7a8794", label="pairs of receivers")
        for high, published in ((False, 42.4), (True, 12.7)):
            at, mean = pairs.of(is_high=high)
            axes.plot(at, mean, "o", color="#c0392b", label=None if high else f"mean of {SHARE:.0%} of the pairs")
            axes.axhline(published, ls="--", lw=0.8, color="#1f4e79", label=None if high else "published, low and high")
        axes.set(xlabel="correlation of multipath errors", ylabel="relative position error [m]", ylim=(0.0, 110.0))
        axes.legend(fontsize=7)

    ranks = np.argsort(np.argsort(pairs.error))
    agreement = np.corrcoef(np.arange(len(ranks)), ranks)[0, 1]
    detail = f"{len(ranks)} pairs, these with a correlation of {correlation:.2f}; rank correlation {agreement:.2f}"
    return Measurement(error, detail, None if is_high else draw)


@cache
def _open_sky(device: str) -> np.ndarray:
    """Return errors of positions under open sky at 144 times of a day, with drift and noise of their own [m]."""
    scene = Scene(open_ground(), {"sunny": PRESETS["sunny"]}, device=device, name="open")
    place, errors = np.array([[0.0, 0.0, ANTENNA_M]]), []
    for number in range(144):
        config, scene.seed = Gnss(mode="ray_traced", samples_per_tx=1000, epoch=_epoch(number / 6.0)), number
        errors.append(world_from_wgs84(_captured(scene, place, config)[0].geodetic, config.reference) - place[0])
    return np.array(errors)


def _measure_open_sky(device: str) -> Measurement:
    error = _open_sky(device)
    across, spread = np.hypot(error[:, 0], error[:, 1]), error.std(axis=0)
    detail = (
        f"spread {spread[0]:.2f} m east, {spread[1]:.2f} m north, {spread[2]:.2f} m up; `mode: physical` has 1, 1, 2"
    )
    return Measurement(float(np.percentile(across, 95)), detail)


def _measure_dop_ratio(device: str) -> Measurement:
    times = seconds_since_slots(_epoch(0.0)) + np.arange(0.0, 86_400.0, 900.0)
    ratios = []
    for latitude in (22.3, 35.0, 49.0):
        satellites = world_from_ecef(satellite_positions(times), (latitude, 8.0, 0.0))
        direction = satellites / np.linalg.norm(satellites, axis=-1, keepdims=True)
        for sky in direction:
            hdop, vdop = dilution(sky[sky[:, 2] > np.sin(np.radians(5.0))])
            ratios.append(vdop / hdop)
    return Measurement(float(np.mean(ratios)), f"{len(ratios)} skies at 22, 35 and 49 degrees north")


def _canyon_row(name: str, title: str, reference: float, *, is_high: bool) -> Check:
    return Check(
        name=f"gnss.canyon_pairs_{name}",
        title=title,
        computed="`mode: ray_traced` at pairs of 26 places in 3 canyons, 24 m between houses of 15 to 50 m, at eight "
        "times of a day in Hong Kong; relative position by single differences of common satellites; the "
        f"{SHARE:.0%} of the pairs with the {name}est correlation",
        unit="m",
        reference=Reference.within_factor(reference, 2.0),
        tolerance="a factor 2: another street, GPS alone, and pairs by ranks where they chose two by hand",
        sources=(ICKING,),
        measure=lambda device: _measure_pairs(device, is_high=is_high),
    )


CHECKS = (
    _canyon_row("low", "Relative position of receivers with unlike multipath in a canyon", 42.4, is_high=False),
    _canyon_row("high", "Relative position of receivers with like multipath in a canyon", 12.7, is_high=True),
    Check(
        name="gnss.open_sky",
        title="Horizontal error under open sky, 95 % of a day",
        computed="`mode: ray_traced` on level ground at 49 degrees north, 144 times of a day",
        unit="m",
        reference=Reference(3.5, 1.75, 4.9),
        tolerance="from half of what receivers of good quality stay below, 3.5 m, to telephones, 4.9 m",
        sources=(SPS,),
        measure=_measure_open_sky,
    ),
    Check(
        name="gnss.dop_ratio",
        title="Vertical over horizontal dilution of precision, mean of a day",
        computed="the nominal constellation of 24 satellites above 5 degrees",
        unit="",
        reference=Reference(1.474, 1.3, 1.65),
        tolerance="12 %: 24 nominal slots beside the satellites of 2008",
        sources=(MILBERT,),
        measure=_measure_dop_ratio,
    ),
)
"""Rows of this topic."""
