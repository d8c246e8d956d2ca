"""LiDAR: the pattern, every hit against a float64 brute-force oracle, sameness over batches and weathers."""

import numpy as np
import pytest

from mmw.config import MountConfig
from mmw.physics.weather.weather import PRESETS, Weather
from mmw.scene.scene_data import SceneData
from mmw.scene.views import make_views, view_keys
from mmw.sensors import Lidar
from mmw.sensors.lidar.rows import LISTS
from mmw.sensors.lidar.scan_pattern import lidar_azimuths, lidar_elevations, lidar_order, lidar_pattern
from mmw.sensors.lidar.simulate import PointCloud, find_lidar_returns, trace_lidar_hits
from tests.fixtures.depth_cameras import views_at
from tests.fixtures.lidar_sweeps import TUMBLING, sweeps
from tests.fixtures.scenes import (
    ABSENT,
    arrays_from_parts,
    closed_box,
    ground_part,
    random_triangles,
    two_cars,
    wall_part,
)
from tests.fixtures.sensor_runs import all_carriers, loaded
from tests.oracles.tracing import agreeing_rays, cast_rays, sensor_rays

SMALL = Lidar(channels=16, points_per_channel=90)


def test_pattern_is_the_papers() -> None:
    pattern = lidar_pattern(Lidar()).reshape(64, 469, 3)
    assert pattern.shape[0] * pattern.shape[1] == 30_016
    np.testing.assert_allclose(np.linalg.norm(pattern, axis=-1), 1.0, atol=1e-15)
    elevation = np.degrees(np.arcsin(pattern[..., 2]))
    wanted = np.broadcast_to((2.0 - np.arange(64) * 27.0 / 63.0)[:, None], (64, 469))
    np.testing.assert_allclose(elevation, wanted, rtol=0, atol=1e-6)
    yaw = np.degrees(np.arctan2(-pattern[..., 1], pattern[..., 0]))  # CARLA's, clockwise
    wanted = np.broadcast_to(np.arange(469) * 360.0 / 469.0 - 180.0, (64, 469))
    np.testing.assert_allclose((yaw - wanted + 180.0) % 360.0 - 180.0, 0.0, atol=1e-6)


def test_turn_starts_backwards_and_goes_by_the_left() -> None:
    azimuth = lidar_azimuths(4)
    np.testing.assert_allclose(azimuth, [np.pi, np.pi / 2, 0.0, -np.pi / 2], atol=1e-15)
    assert len(set(np.round(lidar_azimuths(469) % (2 * np.pi), 9))) == 469
    np.testing.assert_allclose(np.degrees(lidar_azimuths(3, 90.0)), [45.0, 15.0, -15.0], atol=1e-12)
    np.testing.assert_allclose(np.degrees(lidar_elevations(1, 3.0, -20.0)), [3.0])
    np.testing.assert_allclose(np.degrees(lidar_elevations(2, 3.0, -20.0)), [3.0, -20.0])


STREET = (two_cars(3), SMALL, [0, 2])
FULL = (two_cars(1), Lidar(on=("cav",)), [0])
SOUPS = [(all_carriers(random_triangles(seed, 200, vehicles=4, frames=2)), TUMBLING, [0, 1]) for seed in (0, 1)]


@pytest.mark.parametrize(
    ("arrays", "config", "frames"), [STREET, FULL, *SOUPS], ids=["street", "full pattern", "soup 0", "soup 1"]
)
def test_every_ray_equals_the_oracle(device: str, arrays: SceneData, config: Lidar, frames: list[int]) -> None:
    views, pattern = make_views(arrays, frames, config), lidar_pattern(config)
    hits = trace_lidar_hits(loaded(arrays, device, frames), views, config)
    ranges, objects = hits.rays.range.numpy(), hits.rays.object_id.numpy()
    cosines, materials = hits.rays.cos_incidence.numpy(), hits.rays.material_id.numpy()
    ambiguous = 0
    for view in range(len(views)):
        frame = int(views.frame[view])
        origin, direction = sensor_rays(views.pose[view], pattern)
        expected = cast_rays(arrays, frame, origin, direction, config.range_m)
        found, wanted = (ranges[view], objects[view]), (expected.t, expected.object_id)
        is_same = agreeing_rays(arrays, frame, (origin, direction), found, wanted, config.range_m, config.range_m)
        ambiguous += (~is_same).sum()
        here = np.flatnonzero(is_same & (objects[view] >= 0))
        cosine = -np.einsum("rx,rx->r", expected.normal, direction)[here]
        np.testing.assert_allclose(cosines[view][here], cosine, atol=1e-5)
        np.testing.assert_array_equal(materials[view][here], expected.material[here])
    assert ambiguous <= 2e-3 * len(views) * len(pattern), ambiguous


def test_closed_room_returns_every_ray(device: str) -> None:
    arrays = closed_box(10.0)
    views = views_at(np.array([1.0, 2, 0.5, 0, 0, 0, 1]))
    config = Lidar(optics={"range_resolution_m": 0})
    keys = np.zeros((1, 2), np.uint32)
    hits = trace_lidar_hits(loaded(arrays, device), views, config)
    batch = find_lidar_returns(hits, arrays.materials["sunny"], PRESETS["sunny"], keys)
    np.testing.assert_array_equal(batch.offsets, [0, 64 * 469])
    np.testing.assert_array_equal(batch.ring, np.repeat(np.arange(64), 469))
    world = np.stack([batch.x, batch.y, batch.z], axis=1) + np.array([1.0, 2.0, 0.5])
    assert np.abs(np.abs(world).max(axis=1) - 5.0).max() < 1e-3
    unit = lidar_pattern(config)
    across = np.cross(unit, np.stack([batch.x, batch.y, batch.z], axis=1))
    assert np.linalg.norm(across, axis=1).max() < 1e-3  # ray by ray


def test_points_lie_on_the_grid_in_channel_order(device: str) -> None:
    batch = sweeps(two_cars(1), device, [0], Lidar(returns="dual"), "rainy")
    for values, steps in ((batch.x, 1024), (batch.y, 1024), (batch.z, 1024), (batch.intensity, 256)):
        assert values.dtype == np.float32
        np.testing.assert_array_equal(values * steps, np.round(values * steps))
    assert batch.ring.dtype == batch.label.dtype == batch.return_number.dtype == np.uint8
    for start, stop in zip(batch.offsets[:-1], batch.offsets[1:], strict=True):
        assert np.all(np.diff(batch.ring[start:stop].astype(int)) >= 0)
    for name in LISTS:
        assert len(getattr(batch, name)) == len(batch) == batch.offsets[-1]
    # Ring 0 looks up by 2 deg, ring 63 down by 25 deg.
    assert np.all(batch.z[batch.ring == 0] > 0) and np.all(batch.z[batch.ring == 63] < 0)


def test_own_roof_is_seen(device: str) -> None:
    arrays = two_cars(1)
    low = Lidar(
        on=("cav",), channels=1, points_per_channel=8, upper_fov_deg=-60, lower_fov_deg=-60,
        mount={"cav": MountConfig(position_m=(0, 0, 1.7))},
    )  # fmt: skip
    batch = sweeps(arrays, device, [0], low)
    np.testing.assert_array_equal(batch.object_id, arrays.actors[0].object_id)


@pytest.mark.parametrize("config", [
    SMALL,
    SMALL.model_copy(update={"returns": "dual"}),
    SMALL.model_copy(update={"mode": "carla"}),
    SMALL.model_copy(update={"rolling": True, "deskew": True}),
], ids=["physical", "dual", "carla", "rolling"])  # fmt: skip
@pytest.mark.parametrize("air", [Weather(rain_mm_h=25, wetness=1), PRESETS["foggy"]], ids=["rain", "fog"])
def test_batches_do_not_change_a_byte(device: str, air: Weather, config: Lidar) -> None:
    arrays = two_cars(5)
    whole = sweeps(arrays, device, range(5), config, air)
    for frames in ([3], [4, 0], [1, 2, 3]):
        part = sweeps(arrays, device, frames, config, air)
        for batch_index, frame in enumerate(frames):
            assert cloud(part, 2 * batch_index) == cloud(whole, 2 * frame)
            assert cloud(part, 2 * batch_index + 1) == cloud(whole, 2 * frame + 1)


def test_other_seeds_and_weathers_draw_other_noise(device: str) -> None:
    arrays = two_cars(1)
    one, same, other = (sweeps(arrays, device, [0], SMALL, "rainy", seed) for seed in (1, 1, 2))
    assert cloud(one, 0) == cloud(same, 0) and cloud(one, 0) != cloud(other, 0)


def test_weathers_of_one_trace_are_those_of_traces_of_their_own(device: str) -> None:
    arrays = two_cars(2)
    views = make_views(arrays, [0, 1], SMALL)
    hits = trace_lidar_hits(loaded(arrays, device), views, SMALL)
    for name in ("sunny", "rainy", "foggy", "sunny"):
        keys = view_keys(arrays, views, 1, "test", name, SMALL.name)
        batch = find_lidar_returns(hits, arrays.materials["sunny"], PRESETS[name], keys)
        alone = sweeps(arrays, device, [0, 1], SMALL, name)
        assert [cloud(batch, view) for view in range(4)] == [cloud(alone, view) for view in range(4)]


def cloud(batch: PointCloud, view: int) -> list[bytes]:
    part = slice(batch.offsets[view], batch.offsets[view + 1])
    return [np.ascontiguousarray(getattr(batch, name)[part]).tobytes() for name in LISTS]


def test_frame_without_vehicles_sees_none(device: str) -> None:
    arrays = two_cars(3)
    arrays.poses[1, :2] = ABSENT
    batch = sweeps(arrays, device, range(3), SMALL)
    vehicles = [actor.object_id for actor in arrays.actors[:2]]
    # Views: cav and rsu in frame 0, the rsu alone in frame 1, both in frame 2.
    seen = [
        np.isin(batch.object_id[a:b], vehicles).sum() for a, b in zip(batch.offsets, batch.offsets[1:], strict=False)
    ]
    assert len(seen) == 5 and seen[2] == 0 and seen[0] > 0 and seen[3] > 0


def test_nothing_in_range_and_no_views(device: str) -> None:
    arrays = arrays_from_parts([ground_part()], actors=[("rsu_1", "rsu", -1)])
    sky = Lidar(channels=2, points_per_channel=10, upper_fov_deg=30, lower_fov_deg=10)
    batch = sweeps(arrays, device, [0], sky)
    np.testing.assert_array_equal(batch.offsets, [0, 0])
    assert len(batch.x) == 0
    nobody = SMALL.model_copy(update={"on": ("cav",)})
    batch = sweeps(arrays, device, [0], nobody, "foggy")
    np.testing.assert_array_equal(batch.offsets, [0])
    assert len(batch.intensity) == 0


def test_range_ends_where_the_config_says(device: str) -> None:
    arrays = arrays_from_parts([wall_part("wall", (-30.0, 20.0), (30.0, 20.0), 30.0)], actors=[("rsu_1", "rsu", -1)])
    counts = []
    for range_m in (19.9, 20.1, 25.0):
        config = Lidar(channels=1, points_per_channel=360, upper_fov_deg=0, range_m=range_m, lower_fov_deg=0)
        hits = trace_lidar_hits(loaded(arrays, device), make_views(arrays, [0], config), config)
        ranges = hits.rays.range.numpy()
        assert np.all(ranges[np.isfinite(ranges)] < range_m)
        counts.append(int(np.isfinite(ranges).sum()))
    # Half angle acos(20 / range) to both sides of y, in whole degrees, plus the middle.
    assert counts == [0, 2 * 5 + 1, 2 * 36 + 1]


def test_more_rays_than_can_be_counted_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    arrays = two_cars(1)
    views = make_views(arrays, [0], SMALL)
    monkeypatch.setattr("mmw.sensors.ray_batch.MAX_COUNT", 2 * 16 * 90 - 1)
    with pytest.raises(ValueError, match=r"lower compute\.batch_frames"):
        trace_lidar_hits(loaded(arrays, "cpu"), views, SMALL)


def test_shading_needs_materials_and_keys(device: str) -> None:
    arrays = two_cars(1)
    hits = trace_lidar_hits(loaded(arrays, device), make_views(arrays, [0], SMALL), SMALL)
    with pytest.raises(ValueError, match="no materials"):
        find_lidar_returns(hits, (), PRESETS["sunny"], np.zeros((2, 2), np.uint32))
    with pytest.raises(ValueError, match="use view_keys"):
        find_lidar_returns(hits, arrays.materials["sunny"], PRESETS["sunny"], np.zeros((1, 2), np.uint32))


@pytest.mark.parametrize(("channels", "points"), [(64, 469), (8, 64), (1, 1), (3, 5)])
def test_tracing_order_takes_every_ray_once(channels: int, points: int) -> None:
    order = lidar_order(channels, points)
    np.testing.assert_array_equal(np.sort(order), np.arange(channels * points))
    if channels % 8 == 0 and points >= 4:  # a warp of 32 threads is a block of 8 channels x 4 firings
        channel, firing = np.divmod(order[:32], points)
        assert (np.ptp(channel), np.ptp(firing)) == (7, 3)
