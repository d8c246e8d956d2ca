"""Receivers whose satellites are traced: open sky as the cheap model, errors along a street, outages, batches."""

from dataclasses import fields, replace

import numpy as np
import pytest

from mmw.config import MountConfig
from mmw.core.errors import InputError
from mmw.core.geodesy import world_from_wgs84
from mmw.core.kinematics import differentiate
from mmw.physics.weather.weather import PRESETS
from mmw.scene import Scene
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData
from mmw.scene.table_rows import sample_columns
from mmw.scene.views import sample_views
from mmw.sensors import Gnss, RayTracedGnssSample
from mmw.sensors.gnss.position_fix import dilution
from mmw.sensors.gnss.rows import to_tables
from mmw.sensors.gnss.simulate import simulate
from mmw.sensors.sensor_input import SensorInput
from mmw.storage.arrow_tables import table_from_columns
from mmw.validation.canyon import urban_canyon
from tests.fixtures.scenes import arrays_from_parts, box_model, box_part, ground_part, pose

FEW = 20_000
"""Rays of the small scenes."""


def receiver(**keys) -> Gnss:
    """Return a traced receiver 1.8 m above its agent."""
    mount = {"cav": MountConfig(position_m=(0.0, 0.0, 1.8))}
    return Gnss(**{"mode": "ray_traced", "mount": mount, "samples_per_tx": FEW, **keys})


def street(arrays: SceneData) -> Scene:
    return Scene(arrays, {"sunny": PRESETS["sunny"]}, device="cpu", name="street")


def captured(scene: Scene, places: np.ndarray, config: Gnss, seed: int = 42) -> list[RayTracedGnssSample]:
    """Return the samples of free receivers that drive east at 10 m/s."""
    poses = np.column_stack([places, np.zeros((len(places), 3)), np.ones(len(places))])
    scene.seed = seed
    return scene.capture(config, pose=poses, velocity=(10.0, 0.0, 0.0))


def errors(samples: list[RayTracedGnssSample], places: np.ndarray, config: Gnss) -> np.ndarray:
    """Return the errors of positions [m], NaN without a fix, shape [A, 3]."""
    found = [np.full(3, np.nan) if not s.has_fix else world_from_wgs84(s.geodetic, config.reference) for s in samples]
    return np.array(found) - places


def simulated(arrays: SceneData, frames: range, config: Gnss, seed: int = 1) -> tuple[SensorInput, RayTracedGnssSample]:
    """Return the input and the samples of a batch of frames, in fair weather."""
    scene = DeviceScene(arrays, "cpu", max(1, len(frames)))
    scene.load_batch(list(frames) or [0])
    views = sample_views(arrays, frames, config)
    weathers = {"sunny": PRESETS["sunny"]}
    data = SensorInput(scene, differentiate(arrays.poses, arrays.pose_dt), views, weathers, seed, "s")
    samples = simulate(data, config)["sunny"]
    assert isinstance(samples, RayTracedGnssSample)
    return data, samples


def drive(frames: int, count: int = 1) -> SceneData:
    """Return a street between two rows of houses, on which cars with bodies drive to the east."""
    parts = [ground_part(120.0)]
    for y, height in ((16.0, 30.0), (-16.0, 12.0)):
        parts.append(
            box_part(f"Buildings/row{y:g}", (200.0, 10.0, height), (0.0, y, height / 2), "brick_facade", "building")
        )
    actors = [(f"cav_{k + 1}", "cav", 0) for k in range(count)]
    poses = [[pose(-20.0 + 0.1 * frame + 12.0 * k, -3.0) for k in range(count)] for frame in range(frames)]
    return arrays_from_parts(parts, (box_model("sedan"),), actors, np.array(poses))


def test_open_sky_has_the_errors_of_the_cheap_model() -> None:
    """Over a day the spread on each axis is that of `physical` by its defaults, within a quarter, and the mean is none.

    144 skies with drift and noise of their own; a standard deviation of 144 numbers is known to 6 %.
    """
    scene, place = street(arrays_from_parts([ground_part(100.0)])), np.array([[0.0, 0.0, 1.8]])
    found = []
    for hour in range(24):
        config = receiver(epoch=f"2026-06-21T{hour:02d}:00:00Z", samples_per_tx=1000, max_depth=1)
        for seed in range(6):
            found.append(errors(captured(scene, place, config, seed), place, config)[0])
    error, cheap = np.array(found), Gnss()
    assert np.isfinite(error).all()
    spread = np.array([cheap.horizontal_drift_std_m] * 2 + [cheap.vertical_drift_std_m])
    np.testing.assert_allclose(error.std(axis=0), spread, rtol=0.25)
    assert (np.abs(error.mean(axis=0)) < 3.0 * spread / np.sqrt(len(error))).all()


def test_errors_belong_to_places() -> None:
    """In a canyon errors are tens of meters, and receivers a meter apart have like ones; 60 m apart they do not."""
    scene, config = street(urban_canyon()), receiver(residual_range_std_m=0.0, loop_bandwidth_hz=0.05)
    along = np.arange(-60.0, 60.0, 1.0)
    places = np.column_stack([along, np.full(len(along), -3.0), np.full(len(along), 1.8)])
    samples = captured(scene, places, config)
    error = errors(samples, places, config)[:, :2]
    is_fix = np.isfinite(error).all(axis=1)
    assert 0.3 < is_fix.mean() < 1.0
    assert 10.0 < np.sqrt(np.mean(np.sum(error[is_fix] ** 2, axis=1))) < 100.0

    def apart(step: int) -> float:
        return float(np.nanmedian(np.linalg.norm(error[step:] - error[:-step], axis=1)))

    assert apart(1) < 0.35 * apart(60)
    los = np.concatenate([s.satellites.is_los[s.satellites.is_tracked] for s in samples])
    multipath = np.concatenate([s.satellites.multipath_error[s.satellites.is_tracked] for s in samples])
    assert 0.1 < np.mean(~los) < 0.9
    assert np.median(multipath[~los]) > 5.0 and np.median(np.abs(multipath[los])) < 2.0


def test_the_fix_is_that_of_the_tracked_satellites() -> None:
    arrays, config = drive(3), receiver(max_depth=1)
    _, samples = simulated(arrays, range(3), config)
    found = samples.satellites
    place = arrays.poses[:, 0, :3] + (0.0, 0.0, 1.8)
    for frame in range(3):
        rows = np.arange(found.offsets[frame], found.offsets[frame + 1])
        own = rows[found.is_tracked[rows]]
        across = np.cos(found.elevation[own])
        direction = np.column_stack(
            [across * np.sin(found.azimuth[own]), across * np.cos(found.azimuth[own]), np.sin(found.elevation[own])]
        )
        assert (samples.hdop[frame], samples.vdop[frame]) == pytest.approx(dilution(direction), rel=1e-3)
        # The error of the fix by the linearized weighted normal equations.
        variance = config.residual_range_std_m**2 + 1.1e4 * 10.0 ** (-found.cn0_db_hz[own] / 10.0)
        design = np.column_stack([-direction, np.ones(len(own))]) / np.sqrt(variance)[:, None]
        linear = np.linalg.lstsq(design, found.pseudorange_error[own] / np.sqrt(variance), rcond=None)[0]
        error = world_from_wgs84(samples.geodetic[frame], config.reference) - place[frame]
        np.testing.assert_allclose(error, linear[:3], atol=1e-3)
    assert (found.cn0_db_hz[found.is_tracked] >= config.tracking_threshold_db).all()
    assert np.isnan(found.pseudorange[~found.is_tracked]).all()


def test_a_car_roof_takes_little() -> None:
    """The own roof, 0.3 m below the antenna, moves no code by more than its detour, and leaves the sky open."""
    bare = arrays_from_parts([ground_part(50.0)], (), [("cav_1", "cav", -1)], np.array([[pose(0.0, 0.0)]]))
    car = arrays_from_parts([ground_part(50.0)], (box_model("sedan"),), [("cav_1", "cav", 0)], np.array([[pose(0, 0)]]))
    config = receiver(max_depth=1)
    sky, roof = (simulated(arrays, range(1), config)[1].satellites for arrays in (bare, car))
    assert sky.is_los.all() and roof.is_los.all() and roof.is_tracked.all()
    assert np.abs(roof.multipath_error).max() < 0.6
    assert np.abs(roof.cn0_db_hz - sky.cn0_db_hz).max() < 6.0


def test_rows_do_not_depend_on_the_batch() -> None:
    arrays, config = drive(12, 2), receiver(rate_hz=50)
    _, whole = simulated(arrays, range(12), config)
    for frames in (range(4), range(4, 12)):
        _, part = simulated(arrays, frames, config)
        views = slice(frames.start, frames.stop)  # two agents in every second frame
        np.testing.assert_array_equal(part.geodetic, whole.geodetic[views])
        rows = slice(*whole.satellites.offsets[[views.start, views.stop]])
        for field in fields(part.satellites):
            if field.name != "offsets":
                expected = getattr(whole.satellites, field.name)[rows]
                np.testing.assert_array_equal(getattr(part.satellites, field.name), expected)


def test_neighbors_share_the_drift_of_satellites() -> None:
    """Two receivers under open sky: residual errors are one, noise of the loops is not."""
    scene = street(arrays_from_parts([ground_part(100.0)]))
    places = np.array([[0.0, 0.0, 1.8], [8.0, 5.0, 1.8]])
    config = receiver(residual_range_std_m=5.0, cn0_zenith_db=65.0, max_depth=1)
    one, other = captured(scene, places, config)
    np.testing.assert_allclose(one.satellites.pseudorange_error, other.satellites.pseudorange_error, atol=0.5)
    assert np.abs(one.satellites.pseudorange_error).max() > 1.0
    assert (one.satellites.pseudorange_error != other.satellites.pseudorange_error).all()
    seeds = [captured(scene, places[:1], config, seed)[0].satellites.pseudorange_error for seed in (1, 2)]
    assert np.abs(seeds[0] - seeds[1]).max() > 1.0


def test_tables_and_outages() -> None:
    """No row of `gnss` without a fix; satellites that nothing comes from have nulls."""
    open_air = drive(2)
    lid = box_part("Buildings/lid", (240.0, 60.0, 1.0), (0.0, 0.0, 40.0), "concrete_facade", "building")
    sides = [
        box_part(f"Buildings/side{y}", (240.0, 4.0, 60.0), (0, y, 30), "concrete_facade", "building") for y in (-31, 31)
    ]
    shut = arrays_from_parts(
        [ground_part(120.0), lid, *sides], (), [("cav_1", "cav", -1)], np.array([[pose(0.0, 0.0)]] * 2)
    )
    for arrays, fixes in ((open_air, 2), (shut, 0)):
        config = receiver(tracking_threshold_db=35.0)
        data, samples = simulated(arrays, range(2), config)
        rows = to_tables(data, config, samples)
        key = sample_columns(arrays, "gnss", data.views.frame, data.views.actor)
        tables = {
            name: table_from_columns(name, {"scenario": "s", "weather": "sunny", **key, **columns})
            for name, columns in rows.items()
        }
        assert tables["gnss"].num_rows == fixes == samples.has_fix.sum()
        satellites = tables["gnss_satellites"].to_pylist()
        assert len(satellites) == len(samples.satellites) > 12
        for row in satellites:
            assert row["is_tracked"] == (row["pseudorange"] is not None) == (row["multipath_error"] is not None)
            assert row["cn0_db_hz"] is not None or not row["is_tracked"]
    assert not samples.has_fix.any() and np.isnan(samples.geodetic).all() and np.isnan(samples.speed).all()
    assert np.isfinite(samples.heading).all()


def test_without_agents_there_are_no_rows() -> None:
    arrays = arrays_from_parts([ground_part()], (), [("car", "vehicle", -1)], np.array([[pose(0, 0)]]))
    data, samples = simulated(arrays, range(1), receiver())
    assert len(data.views) == 0 and samples.geodetic.shape == (0, 3) and len(samples.satellites) == 0
    assert {name: len(rows["frame"]) for name, rows in to_tables(data, receiver(), samples).items()} == {
        "gnss": 0,
        "gnss_satellites": 0,
    }


def test_rates_of_frames_share_instants() -> None:
    """The same samples at 100 and at 50 frames a second: satellites, drift and noise belong to times."""
    arrays = drive(5)
    slow = replace(arrays, rate_hz=50, frames=range(3))
    one, other = simulated(arrays, range(0, 5, 2), receiver())[1], simulated(slow, range(3), receiver())[1]
    np.testing.assert_array_equal(one.geodetic, other.geodetic)
    np.testing.assert_array_equal(one.satellites.pseudorange, other.satellites.pseudorange)


def test_bad_mounts_and_epochs_are_named() -> None:
    arrays = drive(1)
    with pytest.raises(
        InputError,
        match=r"cav_1: gnss at .* on the ground below its own body.*position_m: \[0, 0, 1\], relative_to: roof",
    ):
        simulated(arrays, range(1), Gnss(mode="ray_traced"))
    inside = {"cav": MountConfig(position_m=(0.0, 0.0, 0.7))}
    with pytest.raises(
        InputError, match=r"cav_1: gnss at .* is inside its own body in frame 0.*mount it above the body"
    ):
        simulated(arrays, range(1), receiver(mount=inside))
    with pytest.raises(InputError, match=r"epoch.*'June' is no date and time of ISO 8601; write it as"):
        Gnss(epoch="June")
