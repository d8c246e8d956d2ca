"""LiDAR: rolling sweeps of moving sensors and vehicles, scene flow, and the rows of the table."""

import dataclasses

import numpy as np
import pyarrow as pa
import pytest

from mmw.config import MountConfig
from mmw.core.kinematics import differentiate
from mmw.core.transforms import compose, invert, quaternion_exp, rotate, transform_points
from mmw.scene.scene_data import SceneData
from mmw.scene.views import make_views, view_twists
from mmw.sensors import Lidar
from mmw.sensors.ground_truth.visibility_rows import point_rows
from mmw.sensors.lidar.rows import lidar_rows
from mmw.sensors.lidar.scan_pattern import lidar_pattern
from mmw.sensors.lidar.scene_flow import scene_flow
from mmw.sensors.lidar.simulate import PointCloud
from mmw.storage.arrow_tables import table_from_columns
from tests.fixtures.lidar_sweeps import sweeps
from tests.fixtures.scenes import arrays_from_parts, box_model, ground_part, pose, two_cars, wall_part

EXACT = {"optics": {"range_resolution_m": 0}, "channels": 24, "points_per_channel": 240}
"""Few rays without range noise."""


def turning_car(frames: int = 5) -> SceneData:
    """Return a car at 30 m/s that turns at 1 rad/s between ground and two walls; another drives ahead of it."""
    parts = [
        ground_part(100.0), wall_part("north", (-90.0, 12.0), (90.0, 12.0), 8.0),
        wall_part("south", (90.0, -12.0), (-90.0, -12.0), 8.0, "marble_facade"),
    ]  # fmt: skip
    rows = []
    for k in range(frames):
        yaw = 0.01 * k
        rows.append([pose(30.0 * np.sin(yaw), 30.0 * (1.0 - np.cos(yaw)), yaw=yaw), pose(15.0 + 0.2 * k, 2.0)])
    actors = [("cav_1", "cav", 0), ("veh_001", "vehicle", 0)]
    return arrays_from_parts(parts, [box_model("sedan")], actors, np.array(rows), materials=["car_paint_red"])


def points_of(batch: PointCloud) -> np.ndarray:
    return np.stack([batch.x, batch.y, batch.z], axis=1).astype(np.float64)


def test_sweep_ends_at_the_frame(device: str) -> None:
    arrays = turning_car()
    config = Lidar(rolling=True, **EXACT)
    batch = sweeps(arrays, device, [2], config)
    direction = points_of(batch) / np.linalg.norm(points_of(batch), axis=1, keepdims=True)
    pattern = lidar_pattern(config)[:240]  # the firings of one channel
    flat = direction[:, :2] / np.linalg.norm(direction[:, :2], axis=1, keepdims=True)
    flat_pattern = pattern[:, :2] / np.linalg.norm(pattern[:, :2], axis=1, keepdims=True)
    firing = np.argmax(flat @ flat_pattern.T, axis=1)
    np.testing.assert_allclose(batch.time_offset, -0.01 * (1.0 - firing / 240.0), atol=1e-8)
    assert batch.time_offset.min() == pytest.approx(-0.01) and batch.time_offset.max() < 0.0
    still = sweeps(arrays, device, [2], Lidar(**EXACT))
    assert not still.time_offset.any()


def test_deskewed_points_lie_on_the_town(device: str) -> None:
    arrays = turning_car()
    away = {}
    for deskew in (True, False):
        config = Lidar(rolling=True, deskew=deskew, **EXACT)
        batch = sweeps(arrays, device, [2], config)
        views = make_views(arrays, [2], config)
        world = transform_points(views.pose[0], points_of(batch))
        is_wall = np.isin(batch.object_id, [0, 1]) & (world[:, 2] > 0.05)
        assert is_wall.sum() > 300
        away[deskew] = np.abs(np.abs(world[is_wall, 1]) - 12.0).max()
    assert away[True] < 2e-3  # the grid, and float32
    assert away[False] > 0.05  # raw: 30 cm of way and 0.6 deg of turn are in the points


def test_raw_points_are_in_the_frame_of_their_firing(device: str) -> None:
    """Float64: the sensor is moved back along its twist, and each point must then lie on what it hit."""
    arrays = turning_car()
    config = Lidar(rolling=True, mount={"cav": MountConfig(position_m=(0.5, 0.2, 2.5), yaw_deg=30)}, **EXACT)
    views = make_views(arrays, [2], config)
    batch = sweeps(arrays, device, [2], config)
    motion = differentiate(arrays.poses)
    velocity, rate = view_twists(arrays, motion, views)
    t = batch.time_offset[:, None].astype(np.float64)
    turn = quaternion_exp(rate[0] * t)
    fired = np.concatenate([
        views.pose[0, :3] + velocity[0] * t,
        compose(
            np.concatenate([np.zeros((len(t), 3)), turn], axis=1),
            np.concatenate([np.zeros(3), views.pose[0, 3:]]),
        )[:, 3:],
    ], axis=1)  # fmt: skip
    world = transform_points(fired, points_of(batch))
    target = arrays.actors[1].object_id
    on_car = batch.object_id == target
    assert on_car.sum() > 20
    moved = np.repeat(arrays.poses[2, 1:2], on_car.sum(), axis=0)
    moved[:, :3] += motion.velocity[2, 1] * t[on_car]
    local = transform_points(invert(moved), world[on_car]) - np.array(arrays.actors[1].center)
    depth = np.abs(local) - np.array(arrays.actors[1].size) / 2.0
    assert np.abs(depth.max(axis=1)).max() < 2e-3
    town = world[~np.isin(batch.object_id, [a.object_id for a in arrays.actors])]
    off = np.minimum(np.abs(np.abs(town[:, 1]) - 12.0), np.abs(town[:, 2]))
    assert off.max() < 2e-3


def test_sweep_of_things_at_rest_is_a_still_picture(device: str) -> None:
    arrays = turning_car(1)  # one frame: nothing is known to move
    still = sweeps(arrays, device, [0], Lidar(**EXACT))
    for deskew in (False, True):
        swept = sweeps(arrays, device, [0], Lidar(rolling=True, deskew=deskew, **EXACT))
        np.testing.assert_array_equal(swept.object_id, still.object_id)
        assert np.abs(points_of(swept) - points_of(still)).max() <= 1.0 / 1024


def test_flow_moves_points_with_their_object(device: str) -> None:
    arrays = turning_car(4)
    config = Lidar(scene_flow=True, **EXACT)
    views = make_views(arrays, [1, 2, 3], config)
    batch = sweeps(arrays, device, [1, 2, 3], config)
    flow = scene_flow(arrays, views, batch)
    assert flow.shape == (batch.offsets[-1], 3) and flow.dtype == np.float32
    target = arrays.actors[1]
    for view in range(3):
        part = slice(batch.offsets[view], batch.offsets[view + 1])
        on_car = batch.object_id[part] == target.object_id
        assert on_car.sum() > 20
        # 0.2 m a frame along x of the world, in the last frame too, where the step before is repeated.
        wanted = rotate(views.pose[view, 3:] * [-1, -1, -1, 1], np.array([0.2, 0.0, 0.0]))
        np.testing.assert_allclose(flow[part][on_car], np.broadcast_to(wanted, (on_car.sum(), 3)), atol=1e-5)
        is_town = ~np.isin(batch.object_id[part], [a.object_id for a in arrays.actors])
        assert is_town.sum() > 500 and not flow[part][is_town].any()


def test_flow_turns_with_a_turning_object(device: str) -> None:
    arrays = turning_car(3)
    poses = arrays.poses[:, ::-1].copy()  # the mast car is now the straight one, and looks at the turning one
    arrays = dataclasses.replace(arrays, poses=poses)
    config = Lidar(scene_flow=True, **EXACT)
    views = make_views(arrays, [1], config)
    batch = sweeps(arrays, device, [1], config)
    flow = scene_flow(arrays, views, batch)
    on_car = batch.object_id == arrays.actors[1].object_id
    world = transform_points(views.pose[0], points_of(batch)[on_car])
    local = transform_points(invert(poses[1, 1]), world)
    arrived = transform_points(poses[2, 1], local)
    ends = transform_points(views.pose[0], points_of(batch)[on_car] + flow[on_car])
    np.testing.assert_allclose(ends, arrived, atol=2e-5)
    step = arrived - world
    assert on_car.sum() > 20 and np.ptp(np.linalg.norm(step, axis=1)) > 0.005


def test_flow_of_what_is_there_once_is_zero(device: str) -> None:
    arrays = turning_car(3)
    arrays.poses[0, 1] = arrays.poses[2, 1] = np.nan
    config = Lidar(scene_flow=True, **EXACT)
    batch = sweeps(arrays, device, [1], config, "rainy")
    flow = scene_flow(arrays, make_views(arrays, [1], config), batch)
    assert (batch.object_id == arrays.actors[1].object_id).sum() > 20 and (batch.label == 1).sum() > 0
    assert not flow[batch.object_id != arrays.actors[0].object_id].any()


def test_rows_hold_every_column(device: str) -> None:
    arrays = two_cars(2)
    config = Lidar(returns="dual", scene_flow=True, **EXACT)
    views = make_views(arrays, [0, 1], config)
    batch = sweeps(arrays, device, [0, 1], config, "foggy")
    fixed = {"scenario": "s", "weather": "foggy"}
    flow = scene_flow(arrays, views, batch)
    with_flow = lidar_rows(arrays, "lidar", views, dataclasses.replace(batch, scene_flow=flow))
    without = lidar_rows(arrays, "lidar", views, batch)
    for rows, nulls in ((with_flow, 0), (without, len(views))):
        table = table_from_columns("lidar", {**fixed, **rows})
        assert table.column("flow_x").null_count == nulls
        assert table.column("label").type == pa.list_(pa.field("element", pa.uint8(), nullable=False))
        np.testing.assert_array_equal(table.column("return_number").combine_chunks().flatten(), batch.return_number)
        assert table.column("point_count").to_pylist() == np.diff(batch.offsets).tolist()
    assert set(np.unique(batch.label)) == {0, 2} and set(np.unique(batch.return_number)) == {0, 1}
    assert np.all(batch.object_id[batch.label == 2] == -1)


def test_only_surfaces_count_as_seen(device: str) -> None:
    arrays = two_cars(2)
    config = Lidar()
    views = make_views(arrays, [0, 1], config)
    batch = sweeps(arrays, device, [0, 1], config, "foggy")
    assert 0 < (batch.label > 0).sum() == (batch.object_id == -1).sum()
    found = point_rows(arrays, "lidar", views, "lidar_points", batch.offsets, batch.object_id)
    view = np.repeat(np.arange(len(views)), np.diff(batch.offsets))
    ids = [actor.object_id for actor in arrays.actors]
    counts = [((view == v) & (batch.label == 0) & (batch.object_id == i)).sum() for v in range(len(views)) for i in ids]
    assert found["lidar_points"].tolist() == [count for count in counts if count] and sum(counts) > 0
