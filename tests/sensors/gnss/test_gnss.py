"""GNSS: WGS-84 against published values and plain geometry, CARLA's map, both error models, rates, bad input."""

from functools import partial

import numpy as np
import pytest

from mmw.config import MountConfig
from mmw.core.constants import FRAME_DT
from mmw.core.geodesy import (
    E2,
    SEMI_MAJOR_AXIS,
    ecef_from_geodetic,
    geodetic_from_ecef,
    mercator_from_world,
    wgs84_from_world,
    world_from_mercator,
    world_from_wgs84,
)
from mmw.core.kinematics import differentiate
from mmw.core.transforms import pose_from_ypr
from mmw.physics.weather.weather import Weather
from mmw.scene.device_scene import DeviceScene
from mmw.scene.table_rows import sample_columns
from mmw.scene.views import sample_views
from mmw.sensors import Gnss, Imu
from mmw.sensors.gnss.error_models import make_gnss
from mmw.sensors.gnss.rows import to_tables
from mmw.sensors.gnss.simulate import simulate
from mmw.sensors.imu.simulate import make_imu
from mmw.sensors.sensor_input import SensorInput
from mmw.storage.arrow_tables import table_from_columns
from tests.fixtures.driving_agents import assert_batches_do_not_matter, assert_white, driving, rows_of, sampled
from tests.fixtures.scenes import ABSENT, arrays_from_parts, ground_part

REFERENCES = [(49.0, 8.0, 0.0), (0.0, -180.0, 0.0), (-33.9, 151.2, 120.0), (69.6, 18.9, -30.0), (89.0, 179.99, 0.0)]
SILENT = {
    "latitude_noise_std_deg": 0, "longitude_noise_std_deg": 0, "altitude_noise_std_m": 0, "speed_noise_std_m_s": 0,
    "heading_noise_std_deg": 0, "horizontal_drift_std_m": 0, "vertical_drift_std_m": 0, "horizontal_noise_std_m": 0,
    "vertical_noise_std_m": 0, "velocity_noise_std_m_s": 0,
}  # fmt: skip

gnss_samples = partial(sampled, make_gnss)


def points(count: int = 2000, reach: float = 20_000.0) -> np.ndarray:
    rng = np.random.default_rng(3)
    return rng.uniform(-1.0, 1.0, (count, 3)) * [reach, reach, 500.0]


def straight(count: int, speed: float = 10.0, yaw: float = 0.5) -> np.ndarray:
    along = speed * FRAME_DT * np.arange(count)
    return pose_from_ypr(np.stack([along * np.cos(yaw), along * np.sin(yaw), np.full(count, 2.0)], axis=1), yaw)


def still(count: int, yaw: float = 0.5) -> np.ndarray:
    return np.tile(pose_from_ypr((120.0, -340.0, 2.0), yaw), (count, 1))


def test_published_wgs84_values() -> None:
    """Source: examples of GeographicLib's CartConvert(1), given to the centimeter."""
    place = (33.3, 44.4, 6000.0)
    np.testing.assert_allclose(ecef_from_geodetic(place), (3816209.60, 3737108.55, 3485109.57), atol=0.0051)
    local = world_from_wgs84(place, (33.0, 44.0, 20.0))
    np.testing.assert_allclose(local, (37288.97, 33374.29, 5783.64), atol=0.01)  # 5783.6466: printed cut, not rounded
    np.testing.assert_allclose(wgs84_from_world(local, (33.0, 44.0, 20.0)), place, rtol=1e-12)
    # Source: brahe's documentation of geodetic transformations, given to the millimeter.
    found = ecef_from_geodetic((37.7749, -122.4194, 16.0))
    np.testing.assert_allclose(found, (-2706181.627, -4261070.165, 3885735.291), atol=0.00051)


@pytest.mark.parametrize("reference", REFERENCES)
def test_there_and_back(reference: tuple) -> None:
    world = points()
    assert np.abs(world_from_wgs84(wgs84_from_world(world, reference), reference) - world).max() < 1e-7
    assert np.abs(world_from_mercator(mercator_from_world(world, reference), reference) - world).max() < 1e-7


@pytest.mark.parametrize("reference", REFERENCES)
def test_wgs84_against_the_ellipsoid_itself(reference: tuple) -> None:
    """Latitude, longitude and height by definition: a point of the ellipsoid plus height along its normal."""
    latitude, longitude, height = wgs84_from_world(points(), reference).T
    phi, lam = np.radians(latitude), np.radians(longitude)
    normal = np.stack([np.cos(phi) * np.cos(lam), np.cos(phi) * np.sin(lam), np.sin(phi)], axis=1)
    # The surface point with this outward normal: gradient of x^2/a^2 + y^2/a^2 + z^2/b^2 parallel to it.
    square = np.array([1.0, 1.0, 1.0 - E2]) * SEMI_MAJOR_AXIS**2
    foot = normal * square / np.sqrt((normal**2 * square).sum(axis=1, keepdims=True))
    place = foot + height[:, None] * normal
    # The world frame by rotations: z turned from the pole down to the reference's latitude, about its longitude.
    colatitude, turn = np.radians(90.0 - reference[0]), np.radians(reference[1] + 90.0)
    about_x = np.array(
        [[1, 0, 0], [0, np.cos(colatitude), -np.sin(colatitude)], [0, np.sin(colatitude), np.cos(colatitude)]]
    )
    about_z = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    origin = ecef_from_geodetic(reference)
    np.testing.assert_allclose((place - origin) @ (about_z @ about_x), points(), atol=1e-6)


def test_ecef_back_to_geodetic_everywhere() -> None:
    rng = np.random.default_rng(0)
    geodetic = np.stack(
        [rng.uniform(-90, 90, 5000), rng.uniform(-180, 180, 5000), rng.uniform(-1e4, 1e6, 5000)], axis=1
    )
    geodetic[:4, 0] = 90.0, -90.0, 0.0, 1e-9
    found = geodetic_from_ecef(ecef_from_geodetic(geodetic))
    np.testing.assert_allclose(found[:, [0, 2]], geodetic[:, [0, 2]], atol=1e-8)
    np.testing.assert_allclose(found[2:, 1], geodetic[2:, 1], atol=1e-8)


def test_world_axes_point_east_north_and_up() -> None:
    for convert in (wgs84_from_world, mercator_from_world):
        home, east, north, up = convert(np.vstack([np.zeros(3), 100.0 * np.eye(3)]), REFERENCES[0])
        np.testing.assert_allclose(home, REFERENCES[0], atol=1e-8)
        assert east[1] > 8.001 and north[0] > 49.0008
        np.testing.assert_allclose(up, (49.0, 8.0, 100.0), atol=1e-8)


def test_carlas_map_is_mercator_with_true_scale_at_the_reference() -> None:
    """The map by its definition: meters on the map per radian of latitude are a cos(reference) / cos(latitude)."""
    latitude = np.radians(np.linspace(49.0, 49.3, 30_001))
    metres = SEMI_MAJOR_AXIS * np.cos(np.radians(49.0)) / np.cos(latitude)
    north = np.concatenate([[0.0], np.cumsum(0.5 * (metres[1:] + metres[:-1]) * np.diff(latitude))])
    pick = slice(None, None, 3000)
    geodetic = np.stack([np.degrees(latitude), np.full(30_001, 8.25), np.full(30_001, 3.0)], axis=1)[pick]
    world = world_from_mercator(geodetic, (49.0, 8.0, 0.0))
    np.testing.assert_allclose(world[:, 1], north[pick], atol=1e-3)
    np.testing.assert_allclose(world[:, 0], SEMI_MAJOR_AXIS * np.cos(np.radians(49.0)) * np.radians(0.25), atol=1e-6)
    np.testing.assert_allclose(mercator_from_world(world, (49.0, 8.0, 0.0)), geodetic, atol=1e-11)


def test_mercator_against_wgs84() -> None:
    world = np.array([[10.0, 0.0, 0.0], [0.0, 10.0, 0.0], [0.0, 0.0, 10.0], [1000.0, 0.0, 0.0]])
    reference = (49.0, 8.0, 0.0)
    east, north, up, far = world_from_wgs84(mercator_from_world(world, reference), reference)
    # Radii of curvature of the ellipsoid over the sphere's radius, east-west and north-south.
    sine = np.sin(np.radians(49.0)) ** 2
    across, along = 1.0 / np.sqrt(1 - E2 * sine), (1 - E2) / (1 - E2 * sine) ** 1.5
    assert (across, along) == (pytest.approx(1.0019, abs=5e-5), pytest.approx(0.9990, abs=5e-5))
    np.testing.assert_allclose(east[:2], (10.0 * across, 0.0), atol=1e-4)
    np.testing.assert_allclose(north[:2], (0.0, 10.0 * along), atol=1e-4)
    np.testing.assert_allclose(up, (0.0, 0.0, 10.0), atol=1e-6)
    # Level ground drops below the tangent plane by d^2 / 2 R, 8 cm at 1 km.
    assert far[2] == pytest.approx(-(1000.0**2) / (2 * 6.38e6), rel=0.02)


def test_longitudes_wrap() -> None:
    for convert, back in ((wgs84_from_world, world_from_wgs84), (mercator_from_world, world_from_mercator)):
        place = convert((500.0, 0.0, 0.0), (10.0, 179.999, 0.0))
        assert -180.0 <= place[1] < -179.99
        np.testing.assert_allclose(back(place, (10.0, 179.999, 0.0)), (500.0, 0.0, 0.0), atol=1e-6)


def test_bad_latitudes_are_refused() -> None:
    with pytest.raises(ValueError, match=r"reference: latitude 95\.0 deg"):
        wgs84_from_world((0, 0, 0), (95.0, 8.0, 0.0))
    with pytest.raises(ValueError, match=r"points: latitude -120\.0 deg"):
        world_from_wgs84([(1.0, 2.0, 0.0), (-120.0, 8.0, 0.0)], (49.0, 8.0, 0.0))
    with pytest.raises(ValueError, match="poles excluded"):
        mercator_from_world((0, 0, 0), (90.0, 8.0, 0.0))
    with pytest.raises(ValueError, match="latitude nan"):
        world_from_mercator((np.nan, 8.0, 0.0), (49.0, 8.0, 0.0))


@pytest.mark.parametrize("yaw_deg", [0.0, 90.0, -179.0, 45.0, 90.0 + 1e-7])
def test_heading_is_clockwise_from_north(yaw_deg: float) -> None:
    config = Gnss(heading_noise_std_deg=0.0)
    heading = gnss_samples(driving(still(3, np.radians(yaw_deg))), [1], config, 1, "s").heading
    np.testing.assert_allclose(heading, np.mod(np.radians(90.0 - yaw_deg), 2 * np.pi), atol=1e-14)
    assert 0.0 <= heading[0] < 2 * np.pi


@pytest.mark.parametrize("mode", ["carla", "physical"])
def test_without_errors_the_reading_is_the_truth(mode: str) -> None:
    config = Gnss(mode=mode, mount={"cav": MountConfig(position_m=(0, 1.5, 1.0), yaw_deg=90.0)}, **SILENT)
    arrays = driving(straight(20), still(20))
    batch = gnss_samples(arrays, range(20), config, 1, "s")
    np.testing.assert_array_equal(batch.geodetic, batch.geodetic_true)
    back = world_from_mercator if mode == "carla" else world_from_wgs84
    along = straight(20)[:, :3] + 1.5 * np.array([-np.sin(0.5), np.cos(0.5), 0.0]) + [0, 0, 1]
    np.testing.assert_allclose(back(batch.geodetic, config.reference)[::2], along, atol=1e-7)
    moves = np.array([10 * np.cos(0.5), 10 * np.sin(0.5), 0.0])
    np.testing.assert_allclose(batch.velocity[::2], np.tile(moves, (20, 1)), atol=1e-9)
    np.testing.assert_allclose(batch.velocity[1::2], 0.0, atol=1e-9)
    np.testing.assert_allclose(batch.speed, np.tile([10.0, 0.0], 20), atol=1e-9)
    np.testing.assert_allclose(batch.heading, np.mod(-0.5, 2 * np.pi), atol=1e-9)  # yaw 0.5 + 90 deg, from north


def test_a_turning_vehicle_gives_its_antenna_a_speed_of_its_own() -> None:
    yaw = 0.4 * FRAME_DT * np.arange(50)
    config = Gnss(mode="physical", mount={"cav": MountConfig(position_m=(3.0, 0, 0))}, **SILENT)
    batch = gnss_samples(driving(pose_from_ypr(np.zeros((50, 3)), yaw)), range(2, 48), config, 1, "s")
    np.testing.assert_allclose(batch.speed, 1.2, rtol=1e-5)


def test_the_published_noise() -> None:
    count = 20_000
    batch = gnss_samples(driving(straight(count), still(count)), range(count), Gnss(), 5, "s")
    for car, speed in ((0, 10.0), (1, 0.0)):
        error = (batch.geodetic - batch.geodetic_true)[car::2]
        turn = batch.heading[car::2] - (np.pi / 2 - 0.5)
        speed_error = (batch.speed[car::2] - speed) / 0.2
        assert_white(np.column_stack([error / [1e-5, 1e-5, 0.005], turn / np.radians(0.1), speed_error]))
        # The speed's error lies along the motion, at rest along the heading.
        forward = np.array([np.cos(0.5), np.sin(0.5), 0.0])
        np.testing.assert_allclose(batch.velocity[car::2], batch.speed[car::2, None] * forward, atol=1e-7)
    assert batch.speed[1::2].min() < 0


def test_drift_of_the_physical_mode() -> None:
    """250 receivers at rest: spread and correlation of the error in meters; the standard error is about 4.5 %."""
    config = Gnss(
        mode="physical", horizontal_drift_std_m=1.5, vertical_drift_std_m=3.0, drift_correlation_s=2.0,
        horizontal_noise_std_m=0.5, vertical_noise_std_m=0.8, velocity_noise_std_m_s=0.07,
    )  # fmt: skip
    arrays = driving(*[still(801)] * 250)
    batch = gnss_samples(arrays, [0, 1, 200, 800], config, 5, "s")
    world = world_from_wgs84(batch.geodetic, config.reference).reshape(4, 250, 3) - (120.0, -340.0, 2.0)
    np.testing.assert_allclose(world.std(axis=(0, 1)), np.hypot([1.5, 1.5, 3.0], [0.5, 0.5, 0.8]), rtol=0.1)
    # Neighboring samples share the drift and not the white noise; the drift forgets with its correlation time.
    for frame, share in ((1, 1.0), (2, np.exp(-1.0)), (3, np.exp(-4.0))):
        product = (world[0] * world[frame]).mean(axis=0) / [1.5**2, 1.5**2, 3.0**2]
        np.testing.assert_allclose(product, share, atol=0.3)
    np.testing.assert_allclose(batch.velocity.std(axis=0), 0.07, rtol=0.1)
    np.testing.assert_allclose(batch.speed, np.hypot(*batch.velocity[:, :2].T), rtol=1e-12)


@pytest.mark.parametrize("mode", ["carla", "physical"])
def test_rows_do_not_depend_on_the_batch_or_the_rate(mode: str) -> None:
    arrays = driving(straight(60), still(60))
    arrays.poses[20:23, 1] = ABSENT
    whole = assert_batches_do_not_matter(make_gnss, arrays, 60, Gnss(mode=mode))
    assert len(whole) == 117
    slow = rows_of(make_gnss, arrays, range(60), Gnss(mode=mode, rate_hz=10), 1, "s")
    assert sorted({frame for frame, _ in slow}) == [0, 10, 20, 30, 40, 50]
    for key, row in slow.items():
        np.testing.assert_array_equal(whole[key], row)


def test_errors_differ_between_streams() -> None:
    arrays = driving(still(2), still(2))

    def errors(config: Gnss, seed: int = 1, scenario: str = "s", agent: int = 0) -> np.ndarray:
        return rows_of(make_gnss, arrays, [1], config, seed, scenario)[1, agent]

    for mode in ("carla", "physical"):
        config = Gnss(mode=mode)
        other = config.model_copy(update={"name": "gnss_2"})
        rows = [errors(config), errors(config, seed=2), errors(config, scenario="t"), errors(config, agent=1)]
        rows.append(errors(other))
        assert len({row[0] for row in rows}) == len({row[-1] for row in rows}) == 5


def test_rows_fill_the_table() -> None:
    arrays, config = driving(straight(20), still(20)), Gnss(rate_hz=10)
    scene, motion = DeviceScene(arrays, "cpu", 1), differentiate(arrays.poses)
    for frames, count in ((range(20), 4), (range(1, 9), 0)):
        views = sample_views(arrays, frames, config)
        data = SensorInput(scene, motion, views, {"sunny": Weather()}, 1, "s")
        rows = to_tables(data, config, simulate(data, config)["sunny"])["gnss"]
        key = {"scenario": "s", "weather": "sunny", **sample_columns(arrays, "gnss", views.frame, views.actor)}
        table = table_from_columns("gnss", {**key, **rows})
        assert table.num_rows == count
        for row in table.to_pylist()[:1]:
            assert row["agent"] == "cav_1" and 48.99 < row["latitude_deg"] < 49.01
            assert 7.99 < row["longitude_true_deg"] < 8.01


def test_without_agents_there_are_no_rows() -> None:
    arrays = arrays_from_parts([ground_part()], (), [("car", "vehicle", -1)], still(3)[:, None])
    for mode in ("carla", "physical"):
        assert gnss_samples(arrays, range(3), Gnss(mode=mode), 1, "s").geodetic.shape == (0, 3)
        assert sampled(make_imu, arrays, range(3), Imu(mode=mode), 1, "s").accel.shape == (0, 3)
