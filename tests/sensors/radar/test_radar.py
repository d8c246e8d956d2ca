"""Radar rays: CARLA's pattern and velocity, the radar equation, motion, sameness over batches, bad input."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from mmw.config import MountConfig
from mmw.core.planar_surfaces import find_surfaces
from mmw.dataset.sql import point_views
from mmw.kernels.radar.trace import RadarHits
from mmw.physics.weather.weather import PRESETS, Weather
from mmw.scene.scene_data import Prototype, SceneData
from mmw.scene.views import make_views
from mmw.sensors import Radar
from mmw.sensors.radar.points import RadarPoints
from mmw.sensors.radar.reflectivity import reflectivity_table
from mmw.sensors.radar.rows import radar_rows
from mmw.sensors.radar.trace import air_loss_db_per_km, carla_points, dense_points, shade_radar, trace_radar
from mmw.storage.arrow_tables import table_from_columns
from mmw.worlds.towns.mesh_part import MeshPart
from tests.fixtures.device_rays import loaded
from tests.fixtures.radar_scenes import AT_ORIGIN, CARLA, CLEAR, dense, traced, wall_ahead, watched, xyz
from tests.fixtures.scenes import arrays_from_parts, box_mesh, box_model, material, pose, quad_part, two_cars, wall_part

VACUUM_AIR = Weather(relative_humidity=0.0, pressure_hpa=300.0)


# CARLA's radar


def test_carla_rays_fill_carlas_ellipse(device: str) -> None:
    """A wall far behind the plane would be missed, one in the plane is met by all: range / cos(angle) up to 174 m."""
    arrays = watched([wall_ahead(99.999, 500.0)])
    _, hits = traced(arrays, device, CARLA)
    points = carla_points(hits)
    assert points.offsets.tolist() == [0, 2000]
    at = xyz(points)
    np.testing.assert_allclose(at[:, 0], 99.999, rtol=1e-5)
    radius = np.hypot(at[:, 1] / np.tan(np.radians(55)), at[:, 2] / np.tan(np.radians(15))) / 99.999
    assert radius.max() <= 1.0 + 1e-5
    # Uniform radius and angle: Kolmogorov-Smirnov, critical value at 1e-4 is 2.23 / sqrt(N).
    angle = np.arctan2(at[:, 2] / np.tan(np.radians(15)), at[:, 1] / np.tan(np.radians(55))) / (2 * np.pi) % 1.0
    for values in (radius, angle):
        expected = (np.arange(2000) + 0.5) / 2000
        assert np.abs(np.sort(values) - expected).max() < 2.23 / np.sqrt(2000)
    rim = 100.0 / np.cos(np.radians(55.0))
    assert rim == pytest.approx(174.34, abs=0.01) and 165.0 < points.range.max() < rim
    assert points.power_db is None and points.snr_db is None and points.rcs_dbsm is None


def test_carla_rays_end_at_the_plane(device: str) -> None:
    _, hits = traced(watched([wall_ahead(100.01, 500.0)]), device, CARLA)
    assert carla_points(hits).offsets.tolist() == [0, 0]


def test_carla_velocity_is_that_of_the_origin_and_positive_while_receding(device: str) -> None:
    """A car 30 m ahead that drives at 20 m/s and turns at 1 rad/s, seen from a radar that drives at 5 m/s."""
    frames, dt = 5, 0.01
    t = dt * (np.arange(frames) - 2)
    for sign in (1.0, -1.0):
        car = [pose(30.0 + sign * 20.0 * k, 0.0, -0.75, yaw=k) for k in t]
        radar = [pose(5.0 * k, 0.0) for k in t]
        arrays = arrays_from_parts(
            [], [box_model("sedan")], [("cav_1", "cav", -1), ("veh_001", "vehicle", 0)],
            np.array([[a, b] for a, b in zip(radar, car, strict=True)]),
        )  # fmt: skip
        config = CARLA.model_copy(update={"on": ("cav",)})
        _, hits = traced(arrays, device, config, [2])
        points = carla_points(hits)
        assert points.offsets[1] > 20 and set(points.object_id) == {arrays.actors[1].object_id}
        expected = (sign * 20.0 - 5.0) * xyz(points)[:, 0] / points.range
        np.testing.assert_allclose(points.velocity, expected, rtol=1e-5)
        assert np.all(np.sign(points.velocity) == sign)


def test_carla_keeps_the_town_at_rest_and_is_mirrored(device: str) -> None:
    """A wall on the left has positive azimuth; the radar drives away from it."""
    arrays = arrays_from_parts(
        [quad_part("Buildings/left", [(20, 1, -5), (60, 1, -5), (60, 1, 5), (20, 1, 5)], "wood", "building")],
        [], [("cav_1", "cav", -1)], np.array([[pose(-0.1 * (k - 1), 0.0)] for k in range(3)]),
    )  # fmt: skip
    _, hits = traced(arrays, device, CARLA.model_copy(update={"on": ("cav",)}), [1])
    points = carla_points(hits)
    assert points.offsets[1] > 10 and np.all(points.azimuth > 0.0)
    np.testing.assert_allclose(points.velocity, 10.0 * xyz(points)[:, 0] / points.range, rtol=1e-5)


# The grid of rays


def test_grid_has_one_ray_in_every_cell_anew_each_frame(device: str) -> None:
    config = Radar(azimuth_rays=40, elevation_rays=12, mount=AT_ORIGIN, range_m=1000.0)
    room, faces = box_mesh((100.0,) * 3)
    arrays = watched(
        [MeshPart("Buildings/room", room, faces, "concrete_facade", "building")], poses=np.zeros((2, 0, 7))
    )
    _, hits = traced(arrays, device, config)
    azimuth, elevation = hits.azimuth.numpy(), hits.elevation.numpy()
    column = (0.5 - np.degrees(azimuth) / 110.0) * 40
    row = (0.5 + 0.5 * np.sin(elevation) / np.sin(np.radians(15.0))) * 12
    np.testing.assert_array_equal(np.floor(column), np.broadcast_to(np.arange(480) % 40, (2, 480)))
    np.testing.assert_array_equal(np.floor(row), np.broadcast_to(np.arange(480) // 40, (2, 480)))
    assert np.all(column[0] != column[1])
    # Solid angle of a band between two elevations: azimuth x difference of sines.
    assert config.solid_angle * 480 == pytest.approx(np.radians(110.0) * 2.0 * np.sin(np.radians(15.0)))


def test_reference_target_has_the_reference_snr(device: str) -> None:
    """A small Lambert plate of known RCS at 100 m: its power is that of the radar equation, worked out by hand."""
    foliage = material("leaves")
    foliage = replace(foliage, nonvisual_base="leaf_grass")
    config = Radar(
        mount=AT_ORIGIN, range_m=150.0, horizontal_fov_deg=2.0, vertical_fov_deg=2.0, horizontal_beam_deg=110.0,
        vertical_beam_deg=30.0, azimuth_rays=200, elevation_rays=200,
    )  # fmt: skip
    arrays = watched([wall_ahead(100.0, 1.0, "leaves")], materials={"leaves": foliage})
    points = dense(arrays, device, config, weather=VACUUM_AIR)
    # Lambert: RCS = 4 albedo area at normal incidence; leaves scatter |0.22|^2.
    rcs = 4.0 * 0.22**2 * 4.0
    assert np.sum(10 ** (points.rcs_dbsm / 10)) == pytest.approx(rcs, rel=0.01)
    snr = 10.0 * np.log10(np.sum(10 ** (points.snr_db.astype(float) / 10)))
    assert snr == pytest.approx(15.0 + 10.0 * np.log10(rcs / 10.0), abs=0.05)
    gain, wavelength = 10.0 ** (10.0 / 10.0), 299_792_458.0 / 76.5e9
    watts = 10.0 ** (12.0 / 10.0) / 1000.0 * gain**2 * wavelength**2 * rcs / ((4 * np.pi) ** 3 * 100.0**4)
    assert np.sum(10 ** (points.power_db.astype(float) / 10)) == pytest.approx(watts * 1000.0, rel=0.01)


def test_beams_lose_three_decibels_each_at_half_their_width(device: str) -> None:
    config = Radar(mount=AT_ORIGIN, azimuth_rays=110, elevation_rays=30, range_m=1000.0)
    room, faces = box_mesh((100.0,) * 3)
    points = dense(watched([MeshPart("Buildings/room", room, faces, "wood", "building")]), device, config)
    # What is left of the power without RCS and distance.
    gains = points.power_db - points.rcs_dbsm + 40.0 * np.log10(points.range)
    gains -= 10.0 * np.log10(config.link_constant) + 30.0
    expected = (
        -2
        * 10
        * np.log10(2.0)
        * ((np.degrees(points.azimuth) / 55.0) ** 2 + (np.degrees(points.elevation) / 15.0) ** 2)
    )
    air = 2.0 * air_loss_db_per_km(CLEAR, config.carrier_hz) * points.range / 1000.0
    np.testing.assert_allclose(gains, expected - air, atol=1e-3)


# Motion


def test_turning_vehicle_spreads_the_velocities(device: str) -> None:
    config = Radar(mount=AT_ORIGIN, horizontal_fov_deg=40.0, vertical_fov_deg=20.0)
    model = box_model("bus", (12.0, 2.5, 3.0), (0.0, 0.0, 0.0))
    t = 0.01 * (np.arange(5) - 2)
    poses = np.array([[pose(25.0, 3.0 * k, 0.0, yaw=np.pi / 2 + 0.5 * k)] for k in t])  # broadside, drives to its nose
    arrays = watched([], [model], [("veh_001", "vehicle", 0)], poses)
    points = dense(arrays, device, config, [2])
    at = xyz(points)
    moving = np.array([0.0, 3.0, 0.0]) + np.cross([0.0, 0.0, 0.5], at - [25.0, 0.0, 0.0])
    expected = np.einsum("nx,nx->n", moving, at) / points.range
    np.testing.assert_allclose(points.velocity, expected, atol=2e-3)
    # The near side is 23.75 m away; its ends are 6 m left and right: w x r along x is -+3 m/s.
    assert points.velocity.max() - points.velocity.min() > 4.0


def test_wheel_spreads_the_velocities(device: str) -> None:
    """A wheel that rolls across the view at v: its rim has from 0 below to 2 v above, along its way."""
    radius, speed = 0.4, 10.0
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=radius)
    points, faces = np.array(mesh.vertices) + np.array([0.0, 0.0, radius]), np.array(mesh.faces, dtype=np.int32)
    ids = np.zeros(len(faces), dtype=np.int32)
    wheel = Prototype("wheel", points, faces, ids, find_surfaces(points, faces, np.zeros_like(ids), ids),
                  wheels=np.array([[0.0, 0.0, radius, radius]]), wheel=np.zeros_like(ids))  # fmt: skip
    t = 0.01 * (np.arange(5) - 2)
    poses = np.array([[pose(10.0 + speed * k, 0.0)] for k in t])  # rolls away from the radar
    arrays = watched([], [wheel], [("veh_001", "vehicle", 0)], poses, mount=(0.0, 0.0, radius))
    config = Radar(mount=AT_ORIGIN, horizontal_fov_deg=6.0, vertical_fov_deg=6.0, azimuth_rays=60, elevation_rays=60)
    seen = dense(arrays, device, config, [2])
    at = xyz(seen)
    arm = at - [10.0, 0.0, 0.0]
    moving = np.array([speed, 0.0, 0.0]) + np.cross([0.0, speed / radius, 0.0], arm)
    np.testing.assert_allclose(seen.velocity, np.einsum("nx,nx->n", moving, at) / seen.range, atol=2e-2)
    assert seen.velocity.min() < 0.1 * speed and seen.velocity.max() > 1.9 * speed


def test_turning_radar_sees_the_world_turn(device: str) -> None:
    """A radar 3 m ahead of the axle of a car that turns in place moves sideways at 3 w."""
    t = 0.01 * (np.arange(5) - 2)
    arrays = arrays_from_parts(
        [wall_part("wall", (20.0, 50.0), (20.0, -50.0), 10.0)], [], [("cav_1", "cav", -1)],
        np.array([[pose(0.0, 0.0, 1.0, yaw=0.4 * k)] for k in t]),
    )  # fmt: skip
    config = Radar(on=("cav",), mount={"cav": MountConfig(position_m=(3.0, 0.0, 0.0))})
    points = dense(arrays, device, config, [2])
    np.testing.assert_allclose(points.velocity, -1.2 * xyz(points)[:, 1] / points.range, atol=1e-4)


# Sameness, rows, bad input


def reported(hits: RadarHits, arrays: SceneData, config: Radar, weather: Weather) -> RadarPoints:
    """Return the points of traced rays in one weather, by the mode of the radar."""
    if config.mode == "carla":
        return carla_points(hits)
    return dense_points(shade_radar(hits, arrays.materials["sunny"], weather, config), config)


@pytest.mark.parametrize("mode", ["carla", "physical"])
def test_batches_do_not_change_a_byte(device: str, mode: str) -> None:
    arrays = two_cars(4)
    config = Radar(mode=mode, on=("cav", "rsu"), azimuth_rays=60, elevation_rays=20, points=500)

    def points(frames: list[int]) -> RadarPoints:
        return reported(traced(arrays, device, config, frames)[1], arrays, config, PRESETS["rainy"])

    whole, single = points([0, 1, 2, 3]), [points([frame]) for frame in (3, 1, 0, 2)]
    single = [single[i] for i in (2, 1, 3, 0)]
    for name in ("range", "azimuth", "elevation", "velocity", "power_db", "snr_db", "rcs_dbsm", "object_id", "label"):
        values = getattr(whole, name)
        if values is not None:
            assert values.tobytes() == b"".join(getattr(part, name).tobytes() for part in single), name
    assert len(whole.range) == whole.offsets[-1] > 100


def test_weathers_share_the_rays(device: str) -> None:
    arrays, config = two_cars(1), Radar(azimuth_rays=60, elevation_rays=20)
    _, hits = traced(arrays, device, config)
    sunny, rainy, again = (reported(hits, arrays, config, PRESETS[name]) for name in ("sunny", "rainy", "sunny"))
    np.testing.assert_array_equal(sunny.range, rainy.range)
    assert np.all(rainy.power_db < sunny.power_db + 3.0) and np.any(rainy.power_db < sunny.power_db)
    assert again.power_db.tobytes() == sunny.power_db.tobytes()


@pytest.mark.parametrize("mode", ["carla", "physical"])
def test_rows_fit_the_table(device: str, mode: str) -> None:
    arrays = two_cars(2)
    config = Radar(mode=mode, azimuth_rays=60, elevation_rays=20, points=500)
    views, hits = traced(arrays, device, config)
    points = reported(hits, arrays, config, CLEAR)
    table = table_from_columns("radar", {"scenario": "a", "weather": "b", **radar_rows(arrays, "radar", views, points)})
    assert table.num_rows == 2 and table["point_count"].to_pylist() == np.diff(points.offsets).tolist()
    assert table["power_db"].null_count == (2 if mode == "carla" else 0)
    np.testing.assert_array_equal(table["range"].combine_chunks().flatten().to_numpy(), points.range)
    duckdb = pytest.importorskip("duckdb")  # GPU machines may lack it; what is above ran there
    connection = duckdb.connect()
    connection.register("radar", table)
    connection.execute(point_views()["radar_points"][1])
    rows = connection.execute(
        "SELECT count(*), count(power_db), sum(range), max(object_id) FROM radar_points"
    ).fetchone()
    assert rows is not None and rows[0] == len(points.range) and rows[1] == (0 if mode == "carla" else rows[0])
    assert rows[2] == pytest.approx(points.range.sum(dtype=float)) and rows[3] == points.object_id.max()


def test_derived_values_are_those_of_the_textbook() -> None:
    config = Radar()
    assert config.range_resolution == pytest.approx(0.49965, abs=1e-4)
    assert config.range_cells == 201 and config.chirps == 500
    assert config.velocity_resolution == pytest.approx(0.19594, abs=1e-4)
    assert config.max_velocity == pytest.approx(48.99, abs=0.01)
    assert np.degrees(config.azimuth_resolution) == pytest.approx(1.332, abs=1e-3)


def test_bad_arguments_are_refused(device: str) -> None:
    arrays = two_cars(1)
    scene = loaded(arrays, device, [0])
    views = make_views(arrays, [0], CARLA)
    with pytest.raises(ValueError, match="keys has shape"):
        trace_radar(scene, views, np.zeros((1, 3)), CARLA, np.zeros((2, 2), dtype=np.uint32))
    with pytest.raises(ValueError, match="velocity has shape"):
        trace_radar(scene, views, np.zeros((2, 3)), CARLA, np.zeros((1, 2), dtype=np.uint32))
    with pytest.raises(ValueError, match="no materials"):
        reflectivity_table((), Weather(), 76.5e9)
    with pytest.raises(ValueError, match="has no radar row"):
        reflectivity_table((replace(material("asphalt"), nonvisual_base="cheese"),), Weather(), 76.5e9)
