"""Extinction and backscatter of rain and fog against Mie theory, and Koschmieder's law."""

import csv
import math
from dataclasses import replace
from pathlib import Path

import pytest

from mmw.physics.weather.optics import (
    DROP_BACKSCATTER,
    FOG_EXTINCTION_RATIO,
    FOG_LIDAR_RATIO_SR,
    extinction,
    fog_backscatter,
    fog_extinction,
    marshall_palmer,
    rain_extinction,
)
from mmw.physics.weather.weather import FOG_WATER_G_M2, Weather
from mmw.sensors.lidar.optics import PRESETS

WEATHER = Path(__file__).parents[2] / "reference" / "weather"
WAVELENGTHS_NM = (550, 905, 1550)


def table(name: str) -> list[dict[str, str]]:
    return list(csv.DictReader((WEATHER / name).read_text().splitlines()))


@pytest.mark.parametrize("wavelength_nm", WAVELENGTHS_NM)
def test_extinction_of_rain_equals_mie_theory(wavelength_nm: int) -> None:
    rows = [row for row in table("mie_rain_optical.csv") if row["dsd"] == "marshall_palmer"]
    rates = [float(row["rain_mm_h"]) for row in rows]
    assert len(rows) >= 15 and min(rates) < 1.0 and max(rates) == 150.0
    for rate, row in zip(rates, rows, strict=True):
        reference = float(row[f"alpha_1/m_{wavelength_nm}"])
        assert rain_extinction(rate, wavelength_nm) == pytest.approx(reference, rel=1e-3 if rate >= 1.0 else 2e-3)
    assert rain_extinction(0.0, wavelength_nm) == 0.0


def test_drops_are_marshall_and_palmers() -> None:
    """The drops above 0.05 mm, the integral of the distribution, are as many as in the table (grid good to 0.3 %)."""
    for row in table("mie_rain_optical.csv"):
        if row["dsd"] == "marshall_palmer":
            n0, slope = marshall_palmer(float(row["rain_mm_h"]))
            count = n0 / slope * (math.exp(-slope * 0.05) - math.exp(-slope * 8.0))
            assert count == pytest.approx(float(row["N_total_m3(D>0.05mm)"]), rel=3e-3)


def test_backscatter_of_a_drop_is_that_of_rain() -> None:
    """Rain scatters 8 pi / S of its geometric cross section back; large drops, which a LiDAR sees, somewhat less."""
    for row in table("mie_rain_optical.csv"):
        if row["dsd"] == "marshall_palmer" and float(row["rain_mm_h"]) >= 25.0:
            assert DROP_BACKSCATTER[905] == pytest.approx(8 * math.pi / float(row["S_offaxis_sr_905"]), rel=0.1)
            assert 0.65 < DROP_BACKSCATTER[1550] / (8 * math.pi / float(row["S_offaxis_sr_1550"])) < 1.0


@pytest.mark.parametrize("wavelength_nm", WAVELENGTHS_NM)
def test_fog_equals_mie_theory(wavelength_nm: int) -> None:
    seen = set()
    for row in table("mie_fog_optical.csv"):
        fog = {"moderate_spray_radiation": "radiation"}.get(row["fog_type"], row["fog_type"])
        weather = Weather(visibility_m=float(row["MOR_m"]), fog_type=fog)
        assert fog_extinction(weather, wavelength_nm) == pytest.approx(
            float(row[f"alpha_1/m_{wavelength_nm}"]), rel=2e-4
        )
        assert fog_backscatter(weather, wavelength_nm) == pytest.approx(
            float(row[f"beta_1/m/sr_{wavelength_nm}"]), rel=2e-4
        )
        seen.add(fog)
    assert seen == set(FOG_WATER_G_M2) == set(FOG_EXTINCTION_RATIO) == set(FOG_LIDAR_RATIO_SR)


def test_extinctions_of_rain_and_fog_add() -> None:
    weather = Weather(rain_mm_h=10.0, visibility_m=100.0)
    alone = Weather(rain_mm_h=10.0, visibility_m=100_000.0)
    for wavelength_nm in WAVELENGTHS_NM:
        both = rain_extinction(10.0, wavelength_nm) + fog_extinction(weather, wavelength_nm)
        assert extinction(weather, wavelength_nm) == pytest.approx(both)
        assert extinction(alone, wavelength_nm) == pytest.approx(rain_extinction(10.0, wavelength_nm), rel=0.03)


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"wavelength_nm": 532}, "905 or 1550"),
        ({"min_power": 0.0}, "min_power"),
        ({"overlap_full_m": 0.5}, "overlap_start_m or more"),
        ({"overlap_start_m": 0.0}, "pulse_s"),
        ({"aperture_m": 0.0, "divergence": 0.0}, "diameter"),
        ({"drop_backscatter": -1.0}, "drop_backscatter"),
        ({"nearest_m": 0.0}, "nearest_m"),
        ({"overlap_exponent": 0.5}, "overlap_exponent"),
        ({"threshold_snr": 3.0}, "threshold_snr"),
    ],
)
def test_wrong_optics_are_refused(changes: dict[str, float], word: str) -> None:
    with pytest.raises(ValueError, match=word):
        replace(PRESETS["hdl64"], **changes)
