"""Cells, threshold, local maxima and rain of the radar, against formulas, brute force and statistics."""

import csv
import math
from pathlib import Path

import numpy as np
import pytest

from mmw.core.transforms import pose_from_ypr
from mmw.physics.weather.optics import marshall_palmer
from mmw.physics.weather.weather import PRESETS, Weather
from mmw.sensors import Radar
from mmw.sensors.radar import detection
from mmw.sensors.radar.detection import cell_echoes, detect
from mmw.sensors.radar.points import LABEL_FALSE_ALARM, LABEL_OBJECT, LABEL_RAIN
from mmw.sensors.radar.rain_clutter import cell_volume, fall_speed, rain_backscatter, rain_clutter
from mmw.sensors.radar.resolution_cells import angle_cells, cell_grid, unravel
from mmw.sensors.radar.trace import air_loss_db_per_km, radome_loss_db
from tests.fixtures.radar_points import detections, make_cells, make_keys, target
from tests.oracles import radar_detections

RAIN_TABLE = Path(__file__).parents[2] / "reference" / "weather" / "radar_rain_77ghz.csv"
QUIET = {"false_alarm_probability": 1e-12}
SMALL = Radar(azimuth_antennas=16, elevation_antennas=4, frame_time_s=1e-3, **QUIET)
PLACES = [(r, v, 0.0, 0.0) for r in range(2, 200, 2) for v in range(-24, 24, 2)]
"""Cells ahead that are far apart from each other."""


def objects(batch) -> np.ndarray:
    return batch.label == LABEL_OBJECT


def test_cells_equal_a_brute_force_grouping(device):
    rng = np.random.default_rng(5)
    count = 3000
    place = rng.uniform((0.0, -0.8, -0.2), (20.0, 0.8, 0.2), (count, 3))
    velocity, object_id = rng.choice([0.0, 0.3, 120.0], count), rng.integers(-1, 6, count)
    rays = np.column_stack([place, velocity, rng.exponential(1e-15, count), rng.exponential(1.0, count), object_id])
    cells = make_cells(SMALL, device, [rays[:2000], rays[2000:]])
    grid = cell_grid(SMALL)
    steps = (grid.range_step, grid.velocity_step, grid.y_step, grid.z_step)
    expected: dict[tuple, list] = {}
    for i, (r, azimuth, elevation, v, power, rcs, object_id) in enumerate(np.float32(rays).astype(np.float64)):
        place = np.array([r, v, math.sin(azimuth) * math.cos(elevation), math.sin(elevation)]) / steps
        if object_id >= 0:
            key = (i >= 2000, *(round(p) % n for p, n in zip(place, (10**6, 50, 16, 4), strict=True)))
            expected.setdefault(key, []).append((power, rcs, object_id, r, place[3] * grid.z_step))
    r, v, y, z = unravel(grid, cells.cell)
    keys = list(zip(cells.view > 0, r, v % 50, y % 16, z % 4, strict=True))
    assert keys == sorted(expected)
    assert cells.offsets.tolist() == [0, sum(not key[0] for key in keys), len(keys)]
    for i, key in enumerate(keys):
        power, rcs, object_id, r, z = np.array(expected[key]).T
        shares = {o: power[object_id == o].sum() for o in object_id}
        assert cells.power[i] == pytest.approx(power.sum(), rel=1e-5)
        assert cells.rcs[i] == pytest.approx(rcs.sum(), rel=1e-5)
        assert cells.object_id[i] == max(shares, key=shares.__getitem__)
        assert cells.range[i] == pytest.approx((power * r).sum() / power.sum(), abs=1e-5)
        assert (cells.z[i] - (power * z).sum() / power.sum()) == pytest.approx(0.0, abs=1e-5)


@pytest.mark.parametrize("snr_db", [0.0, 2.5, 5.0, 7.5, 10.0, 12.5, 15.0, 20.0])
def test_probability_of_detection(device, snr_db):
    config = SMALL.model_copy(update={"false_alarm_probability": 1e-4})
    batch = detections(config, device, [np.array([target(config, place, snr_db) for place in PLACES])], f"pd {snr_db}")
    chance = 1e-4 ** (1.0 / (1.0 + 10.0 ** (snr_db / 10.0)))
    sigma = math.sqrt(len(PLACES) * chance * (1.0 - chance))
    assert objects(batch).sum() == pytest.approx(len(PLACES) * chance, abs=4.0 * sigma)


def test_echoes_fluctuate_as_swerlings_first_case(device):
    cells = make_cells(SMALL, device, [np.array([target(SMALL, place, 6.0) for place in PLACES])])
    echo = np.sort(cell_echoes(SMALL, cells, make_keys(1)) / (SMALL.noise_w * (1.0 + 10.0**0.6)))
    steps = np.arange(1, len(echo) + 1) / len(echo)
    distance = np.abs(1.0 - np.exp(-echo) - steps).max()
    assert distance < 1.63 / math.sqrt(len(echo))  # Kolmogorov-Smirnov, 1 %


def test_false_alarm_rate(device):
    config = SMALL.model_copy(update={"false_alarm_probability": 1e-4})
    views = 32
    batch = detections(config, device, [np.zeros((0, 7))] * views)
    directions = len(angle_cells(16, 110.0)) * len(angle_cells(4, 30.0))
    mean = 1e-4 * (config.range_cells + 1) * config.chirps * directions
    counts = np.diff(batch.offsets)
    assert directions == 13 and (batch.label == LABEL_FALSE_ALARM).all() and (batch.object_id == -1).all()
    assert counts.sum() == pytest.approx(views * mean, abs=4.0 * math.sqrt(views * mean))
    assert counts.var() == pytest.approx(mean, rel=4.0 * math.sqrt(2.0 / views))
    assert batch.range.mean() == pytest.approx(50.0, abs=4.0 * 29.0 / math.sqrt(len(batch.range)))
    excess = 10.0 ** (batch.snr_db / 10.0) + 1.0 + math.log(1e-4)  # memoryless: exponential with mean 1
    assert excess.min() > -1e-3
    assert excess.mean() == pytest.approx(1.0, abs=4.0 / math.sqrt(len(excess)))


@pytest.mark.parametrize("axis", range(4), ids=["range", "velocity", "y", "z"])
@pytest.mark.parametrize("at", [0.0, 0.3, 0.45, 0.77])
def test_two_targets_resolve_as_the_formulas_say(device, axis, at):
    """c / 2B, wavelength / 2T and 2 / N: nearer than that two targets are one detection, farther they are two."""
    widths = (
        299_792_458.0 / (2.0 * SMALL.bandwidth_hz),
        299_792_458.0 / SMALL.carrier_hz / (2.0 * SMALL.frame_time_s),
        2.0 / 16,
        2.0 / 4,
    )
    grid = cell_grid(SMALL)
    steps = (grid.range_step, grid.velocity_step, grid.y_step, grid.z_step)
    assert steps == pytest.approx(widths, rel=1e-6)
    for separation, expected in ((0.3, 1), (0.8, 1), (0.98, 1), (1.02, 2), (1.2, 2), (1.9, 2)):
        if axis == 3 and at + separation > 1.95:
            continue  # beyond the zenith
        places = [[40.2, 3.1, 0.2, 0.1], [40.2, 3.1, 0.2, 0.1]]
        places[0][axis] = at
        places[1][axis] = at + separation
        if axis == 0:
            places[0][0], places[1][0] = 40.0 + at, 40.0 + at + separation
        batch = detections(SMALL, device, [np.array([target(SMALL, tuple(place), 70.0) for place in places])])
        assert len(batch.range) == expected, separation


def test_signs_and_estimates(device):
    """Receding is positive, left is positive, up is positive, and the errors are those of the estimator."""
    place = (60.0, 4.0, 3.0, 0.2)
    views = [np.array([target(SMALL, place, 25.0, 7)])] * 2000
    batch = detections(SMALL, device, views)
    assert (batch.object_id == 7).all() and len(batch.range) > 1750
    error = 1.0 / (1.6 * np.sqrt(2.0 * 10.0 ** (batch.snr_db / 10.0)))  # steps
    grid = cell_grid(SMALL)
    y = np.sin(batch.azimuth) * np.cos(batch.elevation)
    for value, step, truth in (
        (batch.range, grid.range_step, place[0]),
        (batch.velocity, grid.velocity_step, place[1]),
        (y, grid.y_step, place[2]),
        (np.sin(batch.elevation), grid.z_step, place[3]),
    ):
        normal = (value / step - truth) / error
        assert normal.mean() == pytest.approx(0.0, abs=4.0 / math.sqrt(len(normal)))
        assert normal.std() == pytest.approx(1.0, abs=4.0 / math.sqrt(2.0 * len(normal)))
        assert np.abs(value / step - truth).max() <= 0.5 + 1e-3
    assert batch.velocity.min() > 0.0 and batch.azimuth.min() > 0.0
    power = 10.0 ** (batch.power_db / 10.0) / 1000.0
    assert np.allclose(power / SMALL.noise_w, 10.0 ** (batch.snr_db / 10.0), rtol=1e-4)
    assert np.allclose(10.0 ** (batch.rcs_dbsm / 10.0), 10.0 * power / (SMALL.noise_w * 10.0**2.5), rtol=1e-4)


def test_velocity_folds_and_angles_wrap(device):
    config = SMALL.model_copy(update={"horizontal_fov_deg": 175.0})
    ray = target(config, (60.0, 0.0, 0.0, 0.0), 70.0)
    ray[3] = config.max_velocity + 3.0
    batch = detections(config, device, [np.array([ray])])
    assert batch.velocity == pytest.approx([3.0 - config.max_velocity], abs=0.05)
    for y in (0.99, -0.99):
        ray = target(config, (60.0, 0.0, y * 8.0, 0.0), 70.0)
        batch = detections(config, device, [np.array([ray])])
        assert np.sin(batch.azimuth) == pytest.approx([y], abs=0.002)
    both = [target(config, (60.0, 0.0, y, 0.0), 70.0) for y in (7.8, -7.8)]  # 0.4 cells apart around the ring
    assert len(detections(config, device, [np.array(both)]).range) == 1


def test_one_antenna_measures_no_angle(device):
    config = SMALL.model_copy(update={"elevation_antennas": 1})
    ray = target(SMALL, (60.0, 0.0, 1.0, 0.4), 60.0)
    batch = detections(config, device, [np.array([ray])])
    assert batch.elevation.tolist() == [0.0]
    assert np.sin(batch.azimuth) == pytest.approx([0.125], abs=0.01)


def test_batches_do_not_matter(device):
    rng = np.random.default_rng(2)
    config = SMALL.model_copy(update={"false_alarm_probability": 1e-4})
    grid = cell_grid(config)
    views = [
        np.array([target(config, (r, v, y, 0.0), s, i) for i, (r, v, y, s) in enumerate(rows)])
        for rows in rng.uniform([2, -20, -5, 0], [190, 20, 5, 40], (3, 300, 4))
    ]
    pose, velocity, keys = np.tile(pose_from_ypr([0, 0, 4], 0.3, 0.1, 0.0), (3, 1)), np.zeros((3, 3)), make_keys(3)

    def run(rows: slice):
        clutter = rain_clutter(config, PRESETS["heavy_rain"], pose[rows], velocity[rows], keys[rows], device)
        return detect(config, make_cells(config, device, views[rows]), clutter, keys[rows], device)

    together = run(slice(None))
    assert set(together.label) == {LABEL_OBJECT, LABEL_RAIN, LABEL_FALSE_ALARM}
    for name in ("range", "azimuth", "elevation", "velocity", "power_db", "snr_db", "rcs_dbsm", "object_id", "label"):
        alone = [getattr(run(slice(i, i + 1)), name) for i in range(3)]
        assert np.concatenate(alone).tobytes() == getattr(together, name).tobytes(), name
    assert np.all(np.diff(together.range)[np.diff(np.repeat(np.arange(3), np.diff(together.offsets))) == 0] > -0.6)
    assert np.abs(together.velocity).max() <= grid.velocity_step * grid.velocities / 2.0


@pytest.mark.parametrize("weather", ["sunny", "heavy_rain"])
@pytest.mark.parametrize("changes", [{}, {"elevation_antennas": 1}, {"coherent": True}], ids=["4x16", "16", "coherent"])
def test_points_equal_the_oracle(device, weather, changes, monkeypatch):
    """Also where there is no room for them at first; float32 holds 7 digits, and a direction near the edge 4."""
    monkeypatch.setattr(detection, "LIKELY_ECHOES", 0)
    config = SMALL.model_copy(update={"false_alarm_probability": 1e-4, **changes})
    rng = np.random.default_rng(7)
    views = [
        np.array([target(config, (r, v, y, 0.0), s, i) for i, (r, v, y, s) in enumerate(rows)])
        for rows in rng.uniform([2, -20, -5, 0], [190, 20, 5, 40], (3, 200, 4))
    ]
    pose, keys = np.tile(pose_from_ypr([0, 0, 4], 0.3, 0.1, 0.0), (3, 1)), make_keys(3)
    clutter = rain_clutter(config, PRESETS[weather], pose, np.zeros((3, 3)), keys, device)
    cells = make_cells(config, device, views)
    found = detect(config, cells, clutter, keys, device)
    wanted = radar_detections.detections(config, cells, clutter, keys)
    np.testing.assert_array_equal(np.diff(found.offsets), np.bincount(wanted.pop("view"), minlength=3))
    assert set(found.label) == (
        {LABEL_OBJECT, LABEL_FALSE_ALARM} | ({LABEL_RAIN} if weather == "heavy_rain" else set())
    )
    for name in ("object_id", "label"):
        np.testing.assert_array_equal(getattr(found, name), wanted.pop(name), name)
    for name, values in wanted.items():
        np.testing.assert_allclose(getattr(found, name), values, rtol=2e-6, atol=5e-6, err_msg=name)


def test_too_many_cells_is_an_error():
    config = Radar(azimuth_antennas=1024, elevation_antennas=1024)
    with pytest.raises(ValueError, match=r"sensor radar: \d+ resolution cells; .* lower bandwidth_hz"):
        cell_grid(config)


def test_rain_backscatter_equals_mie_theory():
    with RAIN_TABLE.open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 40
    for row in rows:
        eta = rain_backscatter(float(row["rain_mm_h"]), float(row["f_GHz"]) * 1e9)
        assert eta == pytest.approx(float(row["eta_m2_per_m3"]), rel=3e-3), row
    assert rain_backscatter(0.0, 77e9) == 0.0
    assert rain_backscatter(0.1, 77e9) < rain_backscatter(1.0, 77e9) < rain_backscatter(200.0, 77e9)
    with pytest.raises(ValueError, match=r"rain clutter at 10 GHz: .* 24 to 81 GHz"):
        rain_backscatter(5.0, 10e9)


def test_rain_clutter_level():
    """A cell of 10 deg x 10 deg x 0.5 m at 50 m in 10 mm/h: -18.6 dBsm."""
    rcs = rain_backscatter(10.0, 76.5e9) * cell_volume(50.0, math.radians(10.0) ** 2, 0.5)
    assert 10.0 * math.log10(rcs) == pytest.approx(-18.6, abs=0.05)


@pytest.mark.parametrize("rain_mm_h", [1.0, 10.0, 50.0])
def test_fall_speed_equals_a_numeric_mean_over_drops(rain_mm_h):
    d = np.linspace(0.0, 20.0, 200_001)
    n0, slope = marshall_palmer(rain_mm_h)
    weight = n0 * np.exp(-slope * d) * d**2
    speed = 9.65 - 10.3 * np.exp(-0.6 * d)
    mean = (weight * speed).sum() / weight.sum()
    assert fall_speed(rain_mm_h) == pytest.approx(
        (mean, math.sqrt((weight * (speed - mean) ** 2).sum() / weight.sum())), rel=1e-5
    )


@pytest.mark.parametrize("time_s", [20e-6, 10e-3])
def test_rain_power_is_the_radar_equation_of_its_volume(device, time_s):
    """With one chirp all rain is in one velocity cell or folds into it: exponential with the mean of noise and rain."""
    config = SMALL.model_copy(update={"frame_time_s": time_s, "chirp_time_s": time_s})
    weather, views = PRESETS["heavy_rain"], 1500
    pose = np.tile(pose_from_ypr([0, 0, 4], 0.0, 0.0, 0.0), (views, 1))
    clutter = rain_clutter(config, weather, pose, np.zeros((views, 3)), make_keys(views), device)
    assert clutter is not None
    direction = np.flatnonzero((clutter.y_cell == 3) & (clutter.z_cell == 0))[0]
    for cell in (10, 40):
        distance, y = cell * config.range_resolution, 3 * 0.125
        volume = cell_volume(distance, 0.125 * 0.5 / math.sqrt(1.0 - y**2), config.range_resolution)
        rcs = rain_backscatter(weather.rain_mm_h, config.carrier_hz) * volume
        beam = math.degrees(math.asin(y)) / config.horizontal_fov_deg
        gain_db = -2.0 * 10.0 * math.log10(math.e) * 4.0 * math.log(2.0) * beam**2
        loss_db = radome_loss_db(weather, config) + 2e-3 * distance * air_loss_db_per_km(weather, config.carrier_hz)
        mean = config.link_constant * rcs / distance**4 * 10.0 ** ((gain_db - loss_db) / 10.0)
        drawn = clutter.power[:, cell, direction]
        assert mean > 0.05 * config.noise_w
        assert drawn.mean() == pytest.approx(config.noise_w + mean, rel=4.0 / math.sqrt(views))
        assert clutter.rcs_per_w[cell, direction] == pytest.approx(rcs / mean, rel=1e-3)


def test_rain_moves_with_wind_and_falls(device):
    weather = Weather(rain_mm_h=50.0, wind_m_s=8.0, wind_from_deg=270.0)  # blows to the east
    east, up = pose_from_ypr([0, 0, 4], 0.0, 0.0, 0.0), pose_from_ypr([0, 0, 4], 0.0, -0.5, 0.0)
    pose = np.stack([east, east, up])
    velocity = np.array([[0.0, 0.0, 0.0], [20.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    clutter = rain_clutter(SMALL, weather, pose, velocity, make_keys(3), device)
    assert clutter is not None
    ahead = np.flatnonzero((clutter.y_cell == 0) & (clutter.z_cell == 0))[0]
    fall, width = fall_speed(50.0)
    assert clutter.mean_velocity[:, ahead] == pytest.approx(
        [8.0, -12.0, 8.0 * math.cos(0.5) - fall * math.sin(0.5)], abs=1e-6
    )
    assert clutter.spread[:, ahead] == pytest.approx([0.5, 0.5, math.hypot(0.5, width * math.sin(0.5))], abs=1e-6)
    strong = clutter.power[:, :, ahead] > 30.0 * SMALL.noise_w
    step = SMALL.velocity_resolution
    for view in range(2):
        seen = clutter.velocity_cell[view, strong[view], ahead] * step
        assert len(seen) > 2 and seen == pytest.approx(clutter.mean_velocity[view, ahead], abs=2.0 + step)


def test_no_rain_no_clutter(device):
    assert rain_clutter(SMALL, PRESETS["foggy"], np.zeros((1, 7)), np.zeros((1, 3)), make_keys(1), device) is None


def test_views_without_a_detection(device):
    """No echo, no rain and hardly ever a false alarm: a live radar that looks at the sky."""
    found = detections(SMALL, device, [np.zeros((0, 7)), np.zeros((0, 7))])
    assert found.offsets.tolist() == [0, 0, 0] and len(found.range) == len(found.label) == 0
