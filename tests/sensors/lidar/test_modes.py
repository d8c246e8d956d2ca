"""LiDAR returns: CARLA's statistics, reflectance, wetness, detection, range noise, strongest, last and dual returns."""

import csv
import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from mmw.core.constants import SPEED_OF_LIGHT
from mmw.physics.materials.material import Material, RadioMaterial, wet_reflectance
from mmw.physics.weather.optics import extinction
from mmw.physics.weather.weather import PRESETS, Weather
from mmw.scene.scene_data import SceneData
from mmw.scene.views import make_views, view_keys
from mmw.sensors import Lidar
from mmw.sensors.lidar import returns as lidar_returns
from mmw.sensors.lidar.optics import PRESETS as OPTICS
from mmw.sensors.lidar.precipitation import RainTable, air_from_tables
from mmw.sensors.lidar.simulate import trace_lidar_hits
from tests.fixtures.scenes import arrays_from_parts, ground_part, two_cars, wall_part
from tests.fixtures.sensor_runs import loaded

SOFT_ECHO = Path(__file__).parents[2] / "reference" / "weather" / "lidar_fog_soft_echo.csv"
FREE = {"range_resolution_m": 0}
"""Optics without range noise."""
HAZE = Weather(visibility_m=2_000.0)
"""Extinction and no echo."""


def found(arrays: SceneData, device: str, config: Lidar, weather: Weather, seed: int = 1):
    """Hits and returns of every view in frame 0, in slots: hits, returns [A, R, K], counts [A, R]."""
    views = make_views(arrays, [0], config)
    hits = trace_lidar_hits(loaded(arrays, device, [0]), views, config)
    keys = view_keys(arrays, views, seed, "test", "special", config.name)
    returns, count = lidar_returns.find_returns(hits, arrays.materials["sunny"], weather, keys, (0, 0))
    return hits, returns.numpy(), count.numpy()


def plain(arrays: SceneData, lidar_reflectance: float) -> SceneData:
    """Return the scene with one reflectance everywhere."""
    materials = tuple(dataclasses.replace(m, lidar_reflectance=lidar_reflectance) for m in arrays.materials["sunny"])
    return dataclasses.replace(arrays, materials={"sunny": materials})


def field() -> SceneData:
    """Level ground of asphalt and a concrete wall at 20 m, seen from a mast."""
    parts = [ground_part(200.0), wall_part("wall", (-30.0, 20.0), (30.0, 20.0), 10.0)]
    return arrays_from_parts(parts, actors=[("rsu_1", "rsu", -1)])


def test_carla_intensity_is_carlas(device: str) -> None:
    config = Lidar(mode="carla", carla={"atmosphere_attenuation_rate": 0.01, "dropoff_zero_intensity": 0})
    hits, returns, count = found(field(), device, config, PRESETS["foggy"])
    ranges = hits.rays.range.numpy()
    is_hit = np.isfinite(ranges)
    np.testing.assert_array_equal(count, is_hit.astype(int))  # nothing is dropped, in any weather
    expected = np.exp(-0.01 * ranges[is_hit].astype(float))
    assert np.abs(returns["intensity"][is_hit][:, 0] - expected).max() <= 0.5 / 256 + 1e-6
    np.testing.assert_array_equal(returns["range"][is_hit][:, 0], ranges[is_hit])
    assert not returns["label"][is_hit].any()


@pytest.mark.parametrize(("limit", "zero", "general"), [(1.0, 0.4, 0.0), (0.8, 0.4, 0.45), (0.9, 1.0, 0.0)])
def test_carla_keeps_carlas_share(device: str, limit: float, zero: float, general: float) -> None:
    carla = {"dropoff_intensity_limit": limit, "dropoff_zero_intensity": zero, "dropoff_general_rate": general}
    config = Lidar(mode="carla", carla=carla)
    kept, ranges = [], []
    for seed in range(4):
        hits, _, count = found(field(), device, config, PRESETS["sunny"], seed)
        is_hit = np.isfinite(hits.rays.range.numpy())
        kept.append(count[is_hit])
        ranges.append(hits.rays.range.numpy()[is_hit])
    kept, intensity = np.concatenate(kept), np.exp(-0.004 * np.concatenate(ranges))
    keep = (1.0 - general) * np.where(intensity > limit, 1.0, zero / limit * intensity + 1.0 - zero)
    for low, high in ((0.0, 0.75), (0.75, 0.85), (0.85, 0.95), (0.95, 1.0)):
        part = (intensity > low) & (intensity <= high)
        spread = math.sqrt((keep[part] * (1 - keep[part])).sum())
        assert part.sum() > 1000
        assert abs(kept[part].sum() - keep[part].sum()) <= 4.0 * spread


def test_carla_range_noise(device: str) -> None:
    config = Lidar(mode="carla", carla={"noise_stddev": 0.05, "dropoff_zero_intensity": 0})
    hits, returns, count = found(field(), device, config, PRESETS["sunny"])
    is_hit = count > 0
    assert_normal((returns["range"][is_hit][:, 0] - hits.rays.range.numpy()[is_hit]) / 0.05)


def assert_normal(values: np.ndarray) -> None:
    """Mean, standard deviation and the Kolmogorov-Smirnov distance of standard normal values, 4 sigma each."""
    count = len(values)
    assert count > 3000
    assert abs(values.mean()) < 4.0 / math.sqrt(count)
    assert abs(values.std() - 1.0) < 4.0 / math.sqrt(2.0 * count)
    cdf = np.array([0.5 * (1.0 + math.erf(v / math.sqrt(2.0))) for v in np.sort(values)])
    assert np.abs(cdf - (np.arange(count) + 0.5) / count).max() < 2.0 / math.sqrt(count)


def test_wet_surfaces_darken_by_angstrom() -> None:
    def of(reflectance: float, base: str = "asphalt", coating: str = "none", retro: bool = False) -> Material:
        return Material("m", RadioMaterial("constant"), base, reflectance, (0.5,) * 3, coating, retro)

    # Angstrom's table for n = 1.33; the film of 0.5 mm takes exp(-2 x 7 / m x 0.5 mm) at 905 nm.
    for dry, wet in ((0.10, 0.0591), (0.20, 0.1238), (0.30, 0.1950), (0.50, 0.3612)):
        assert wet_reflectance(of(dry), 1.0, 905) == pytest.approx(wet * math.exp(-0.007), rel=1e-3)
        assert wet_reflectance(of(dry), 1.0, 1550) == pytest.approx(wet * math.exp(-1.09), rel=1e-3)
        assert wet_reflectance(of(dry), 0.5, 905) == pytest.approx(0.5 * (dry + wet * math.exp(-0.007)), rel=1e-3)
        assert wet_reflectance(of(dry), 0.0, 905) == dry
    for material in (of(0.5, coating="paint"), of(0.5, "marble"), of(0.6, "steel"), of(0.95, retro=True)):
        assert wet_reflectance(material, 1.0, 905) == material.lidar_reflectance


@pytest.mark.parametrize("weather", [Weather(), HAZE, dataclasses.replace(HAZE, wetness=0.7)])
def test_physical_intensity_is_the_link_budget(device: str, weather: Weather) -> None:
    arrays = field()
    hits, returns, count = found(arrays, device, Lidar(optics=FREE, detection_margin_db=60), weather)
    ranges, cosine = hits.rays.range.numpy().astype(float), hits.rays.cos_incidence.numpy().astype(float)
    is_hit = np.isfinite(ranges)
    np.testing.assert_array_equal(count, is_hit.astype(int))
    rho = np.array([wet_reflectance(m, weather.wetness, 905) for m in arrays.materials["sunny"]])
    expected = rho[hits.rays.material_id.numpy()] * cosine * np.exp(-2.0 * extinction(weather, 905) * ranges)
    assert np.abs(returns["intensity"][is_hit][:, 0] - expected[is_hit]).max() < 0.5 / 256 + 1e-5
    assert expected[is_hit].max() > 0.15


def test_retroreflectors_do_not_exceed_one(device: str) -> None:
    _, returns, count = found(plain(field(), 30.0), device, Lidar(optics=FREE), Weather())
    assert returns["intensity"][count > 0].max() == 1.0


@pytest.mark.parametrize("weather", [Weather(), Weather(visibility_m=1_500, wetness=1.0)])
def test_absolute_detection_is_the_threshold(device: str, weather: Weather) -> None:
    arrays = field()
    hits, _, count = found(arrays, device, Lidar(detection="absolute"), weather)
    power, _ = powers(arrays, hits, weather)
    is_clear = np.abs(power / 4e-5 - 1.0) > 1e-4
    np.testing.assert_array_equal((count > 0)[is_clear], (power > 4e-5)[is_clear])
    assert 0.05 < (count > 0).mean() < 0.9 * np.isfinite(hits.rays.range.numpy()).mean()


def powers(arrays: SceneData, hits, weather: Weather) -> tuple[np.ndarray, np.ndarray]:
    """Power of every surface in a weather and in clear dry air [1/m2], shape [A, R]; 0 for a miss."""
    ranges, cosine = hits.rays.range.numpy().astype(float), hits.rays.cos_incidence.numpy().astype(float)
    material = hits.rays.material_id.numpy()
    dry, wet = (
        np.array([wet_reflectance(m, w, 905) for m in arrays.materials["sunny"]])[material] * cosine / ranges**2
        for w in (0.0, weather.wetness)
    )
    with np.errstate(invalid="ignore", under="ignore"):
        wet = np.where(np.isfinite(ranges), wet * np.exp(-2.0 * extinction(weather, 905) * ranges), 0.0)
    return wet, dry


def test_relative_detection_loses_nothing_in_clear_dry_air(device: str) -> None:
    for config in (Lidar(), Lidar(preset="nir1550"), Lidar(preset="lisa", range_m=1000.0)):
        hits, _, count = found(field(), device, config, PRESETS["sunny"])
        np.testing.assert_array_equal(count, np.isfinite(hits.rays.range.numpy()).astype(int))


@pytest.mark.parametrize("margin_db", [0.5, 3.0])
def test_relative_detection_takes_the_lower_threshold(device: str, margin_db: float) -> None:
    weather, arrays = Weather(visibility_m=1_500, wetness=1.0), field()
    hits, _, count = found(arrays, device, Lidar(detection_margin_db=margin_db), weather)
    power, dry = powers(arrays, hits, weather)
    threshold = np.minimum(4e-5, dry * 10 ** (-margin_db / 10))
    is_hit = np.isfinite(hits.rays.range.numpy())
    is_clear = is_hit & (np.abs(power / np.where(is_hit, threshold, 1.0) - 1.0) > 1e-4)
    np.testing.assert_array_equal((count > 0)[is_clear], (power > threshold)[is_clear])
    assert not count[~is_hit].any() and 0 < count.sum() < is_hit.sum()


def test_range_noise_grows_as_the_signal_weakens(device: str) -> None:
    arrays = plain(field(), 0.5)
    scaled, snrs = [], []
    for seed in range(3):
        hits, returns, count = found(arrays, device, Lidar(optics={"range_resolution_m": 0.09}), Weather(), seed)
        snr = np.maximum(powers(arrays, hits, Weather())[0] / 4e-5, 1.0)[count > 0]
        error = returns["range"][count > 0][:, 0] - hits.rays.range.numpy()[count > 0]
        scaled.append(error / (0.09 / np.sqrt(2.0 * snr)))
        snrs.append(snr)
    scaled, snr = np.concatenate(scaled), np.concatenate(snrs)
    for part in (snr == 1.0, (snr > 1.0) & (snr < 20.0), snr > 20.0):
        assert_normal(scaled[part])


@pytest.mark.parametrize("weather", [PRESETS["heavy_rain"], PRESETS["foggy"]], ids=["rain", "fog"])
def test_dual_is_strongest_and_last(device: str, weather: Weather) -> None:
    arrays = two_cars(1)
    results = {
        returns: found(arrays, device, Lidar(optics=FREE, preset="modern64", returns=returns), weather)[1:]
        for returns in ("strongest", "last", "dual")
    }
    (first, has_first), (last, has_last), (both, count) = (results[name] for name in ("strongest", "last", "dual"))
    np.testing.assert_array_equal(has_first, has_last)
    np.testing.assert_array_equal(has_first > 0, count > 0)
    is_there = has_first > 0
    gap = np.zeros(has_first.shape)
    gap[is_there] = last["range"][is_there][:, 0] - first["range"][is_there][:, 0]
    assert gap[is_there].min() >= 0.0
    wanted = np.where(is_there, 1 + (gap > 0.5 * SPEED_OF_LIGHT * 5e-9), 0)
    np.testing.assert_array_equal(count, wanted)
    assert (count == 2).sum() > 100
    np.testing.assert_array_equal(both[..., 0][is_there], first[..., 0][is_there])
    np.testing.assert_array_equal(both[..., 1][count == 2], last[..., 0][count == 2])


SPOT_M = 3.0
"""Range of the one echo of `with_echo`."""


def with_echo(monkeypatch: pytest.MonkeyPatch, power: float, extinction_per_m: float = 0.0) -> None:
    """Let every ray have an echo of rain of one power at 3 m."""

    def make(weather, optics, range_m, device, patch_key):
        table = RainTable(1e9, 0.0, 1.0, np.full(4, math.log(power)), np.full((4, 4), SPOT_M))
        return air_from_tables(extinction_per_m, optics, table, None, (0.0,) * 3, patch_key, device)

    monkeypatch.setattr(lidar_returns, "make_air", make)


def square_wall(distance: float) -> tuple[SceneData, dict]:
    """Return a wall at a distance, and the pattern of one ray that meets it squarely, without range noise."""
    half = 10.0 * distance
    parts = [wall_part("wall", (distance, half), (distance, -half), 10.0)]
    arrays = plain(arrays_from_parts(parts, actors=[("rsu_1", "rsu", -1)]), 0.5)
    optics = {**FREE, "overlap_full_m": 1.0}  # the receiver sees all of the wall
    pattern = {"elevations_deg": (0.0,), "points_per_channel": 1, "horizontal_fov_deg": 1e-6, "optics": optics}
    return arrays, pattern


@pytest.mark.parametrize(("distance", "power", "returns", "detection", "expected"), [
    (5.0, 0.03, "strongest", "absolute", [(3.0, 1)]),  # the wall has 0.5 / 25 = 0.02
    (5.0, 0.01, "strongest", "absolute", [(5.0, 0)]),
    (5.0, 0.03, "last", "absolute", [(5.0, 0)]),
    (5.0, 0.03, "dual", "absolute", [(3.0, 1), (5.0, 0)]),
    (5.0, 0.01, "dual", "absolute", [(5.0, 0)]),
    (3.5, 0.09, "dual", "absolute", [(3.0, 1)]),  # nearer than c tau / 2 = 0.75 m
    (2.5, 0.09, "dual", "absolute", [(2.5, 0)]),  # the drop is behind the wall
    (113.0, 5e-5, "strongest", "absolute", [(3.0, 1)]),  # the wall's 3.9e-5 is below the threshold
    (113.0, 5e-5, "last", "absolute", [(3.0, 1)]),
    (113.0, 5e-5, "dual", "absolute", [(3.0, 1)]),
    (113.0, 5e-5, "last", "relative", [(113.0, 0)]),
    (113.0, 5e-5, "strongest", "relative", [(3.0, 1)]),
    (113.0, 5e-5, "dual", "relative", [(3.0, 1), (113.0, 0)]),
])  # fmt: skip
def test_echo_against_a_wall(
    device: str, monkeypatch: pytest.MonkeyPatch, distance: float, power: float, returns: str, detection: str, expected
) -> None:
    with_echo(monkeypatch, power)
    arrays, pattern = square_wall(distance)
    config = Lidar(returns=returns, detection=detection, **pattern)
    _, found_returns, count = found(arrays, device, config, Weather())
    rows = found_returns[0, 0, : count[0, 0]]
    assert [(round(float(row["range"]), 4), int(row["label"])) for row in rows] == expected
    for row in rows:
        wanted = power * SPOT_M**2 if row["label"] else 0.5
        assert row["intensity"] == pytest.approx(min(wanted, 1.0), abs=0.5 / 256 + 1e-5)


def test_echo_of_the_sky(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    with_echo(monkeypatch, 1e-3)
    arrays, pattern = square_wall(500.0)
    for returns in ("strongest", "last", "dual"):
        _, rows, count = found(arrays, device, Lidar(returns=returns, **pattern), Weather())
        assert count[0, 0] == 1 and rows[0, 0, 0]["label"] == 1


def test_a_dark_wall_is_lost_in_fog_where_the_table_says(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    """A wall of 10 % is seen 1 % nearer than its farthest range in the reference table, and lost 1 % beyond it."""
    fog = {float(row["MOR_m"]): row for row in csv.DictReader(SOFT_ECHO.read_text().splitlines())}
    checked = 0
    for row in fog.values():
        alpha = float(row["alpha_1/m"])
        for column, reflectance, reference_m in (
            ("0.9/120^2", 0.9, 120),
            ("0.1/50^2", 0.1, 50),
            ("0.1/120^2", 0.1, 120),
        ):
            power = reflectance / reference_m**2
            optics = dataclasses.replace(OPTICS["hdl64"], min_power=power)
            air = air_from_tables(alpha, optics, None, None, (0.0, 0.0, 0.0), (0, 0), device)
            monkeypatch.setattr(lidar_returns, "make_air", lambda *_, air=air: air)
            farthest = float(row[f"Rmax_10pct_m[Pmin={column}]"])
            for share, seen in ((0.99, 1), (1.01, 0)):
                wall = wall_part("wall", (-30.0, share * farthest), (30.0, share * farthest), 10.0)
                arrays = plain(arrays_from_parts([wall], actors=[("rsu_1", "rsu", -1)]), 0.1)
                fan = {"channels": 1, "points_per_channel": 4, "upper_fov_deg": 0, "lower_fov_deg": 0, "range_m": 200}
                config = Lidar(**fan, detection="absolute", optics={"min_power": power})
                assert found(arrays, device, config, Weather())[2].sum() == seen, (row["MOR_m"], column, share)
                checked += 1
    assert checked == 60
