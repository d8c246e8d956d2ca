"""Depth camera: pinhole, planar depth, centimetres, and every pixel against a float64 brute-force oracle."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mmw.config import MountConfig, load_config
from mmw.scene.scene_data import SceneData
from mmw.scene.views import make_views
from mmw.sensors import DepthCamera
from mmw.sensors.camera_group.capture import capture_cameras
from mmw.sensors.lidar.scan_pattern import pinhole, pinhole_directions
from mmw.storage.codecs.images import decode_depth, decode_instance, decode_semantic
from tests.fixtures.depth_cameras import camera
from tests.fixtures.scenes import (
    ABSENT,
    arrays_from_parts,
    closed_box,
    ground_part,
    random_triangles,
    two_cars,
    wall_part,
)
from tests.fixtures.sensor_runs import captured
from tests.fixtures.traced_depth import traced_depth
from tests.oracles.tracing import agreeing_rays, cast_rays, sensor_rays


def depth_to_metres(depth: np.ndarray) -> np.ndarray:
    return np.where(depth == 0, np.inf, depth * 0.01).astype(np.float32)


def with_rsu(arrays: SceneData, pose) -> SceneData:
    """Return the town of a scene with one roadside unit at a pose."""
    unit = arrays_from_parts([], actors=[("rsu_1", "rsu", -1)])
    actor = replace(unit.actors[0], object_id=len(arrays.objects))
    return replace(arrays, actors=(actor,), poses=np.array(pose, dtype=float).reshape(1, 1, 7))


def test_paper_camera() -> None:
    intrinsics = pinhole(640, 480, 110.0)
    assert intrinsics.fx == pytest.approx(224.0664, abs=1e-4)
    assert (intrinsics.cx, intrinsics.cy) == (320.0, 240.0)
    directions = pinhole_directions(intrinsics)
    assert directions.shape == (480, 640, 3)
    np.testing.assert_array_equal(directions[..., 0], 1.0)
    # Top left looks left (+y) and up (+z); the image is symmetric about its middle.
    assert directions[0, 0, 1] > 0 and directions[0, 0, 2] > 0
    np.testing.assert_allclose(directions[::-1, ::-1, 1:], -directions[..., 1:], atol=1e-15)
    # Edges of the image, half a pixel outside the outer centres, span the field of view.
    edge = directions[0, 0, 1] + 0.5 / intrinsics.fx
    assert 2 * np.degrees(np.arctan(edge)) == pytest.approx(110.0)


def test_depth_is_planar_not_radial(device: str) -> None:
    arrays = with_rsu(closed_box(10.0), (0, 0, 0, 0, 0, 0, 1))
    config = camera(fov_deg=90.0, height_px=60)
    batch = traced_depth(arrays, device, config)
    # The front wall of the cube fills this image exactly: one depth everywhere, although corner rays are longer.
    np.testing.assert_array_equal(batch.depth, 500)
    np.testing.assert_allclose(batch.depth_m, 5.0, atol=1e-5)
    assert batch.depth.dtype == np.uint16


def test_rows_run_down_and_columns_to_the_right(device: str) -> None:
    parts = [ground_part(), wall_part("left", (20.0, 1.0), (20.0, 30.0), 30.0)]
    arrays = arrays_from_parts(parts, actors=[("rsu_1", "rsu", -1)])
    config = camera(mount={"rsu": MountConfig(position_m=(0, 0, 2.0))})
    image = traced_depth(arrays, device, config).depth[0]
    assert image[-1, 30] > 0 and image[0, -1] == 0  # ground below, sky above on the right
    assert image[21, 0] == 2000 and image[21, -1] == 0  # wall on the left only


def check_against_oracle(arrays: SceneData, device: str, config: DepthCamera, frames: list[int]) -> None:
    views = make_views(arrays, frames, config)
    batch = traced_depth(arrays, device, config, frames)
    through = pinhole_directions(pinhole(config.width_px, config.height_px, config.fov_deg)).reshape(-1, 3)
    stretch = np.linalg.norm(through, axis=1)
    ambiguous = 0
    for view in range(len(views)):
        frame = int(views.frame[view])
        origin, direction = sensor_rays(views.pose[view], through / stretch[:, None])
        hits = cast_rays(arrays, frame, origin, direction)
        found = batch.depth_m[view].ravel(), batch.object_id[view].ravel()
        wanted = hits.t / stretch, hits.object_id
        is_same = agreeing_rays(arrays, frame, (origin, direction), found, wanted, config.range_m)
        ambiguous += (~is_same).sum()
        depth = np.where(wanted[0] < config.range_m, wanted[0], np.inf)
        stored = depth_to_metres(batch.depth[view].ravel()).astype(float)
        with np.errstate(invalid="ignore"):
            assert np.all((np.isinf(stored) & np.isinf(depth)) | (np.abs(stored - depth) < 0.006) | ~is_same)
    assert ambiguous <= 2e-3 * batch.depth.size, ambiguous


def test_street_with_cars_equals_the_oracle(device: str) -> None:
    arrays = two_cars(3)
    mount = {
        "rsu": MountConfig(position_m=(0, 0, -1.0), pitch_deg=8),
        "cav": MountConfig(position_m=(2.31, 0.02, 1.23)),
    }
    check_against_oracle(arrays, device, camera(on=("cav", "rsu"), mount=mount), [0, 2])


def test_triangle_soup_equals_the_oracle(device: str) -> None:
    arrays = random_triangles(3, 200, vehicles=3, frames=2)
    arrays = replace(arrays, actors=tuple(replace(actor, role="cav") for actor in arrays.actors))
    check_against_oracle(arrays, device, camera(on=("cav",), range_m=25.0), [1, 0])


def test_centimetres_round_to_nearest(device: str) -> None:
    for distance, expected in ((7.004, 700), (7.006, 701), (0.008, 1), (0.002, 1), (655.34, 65534), (656.0, 0)):
        half = 3.0 * max(distance, 1.0)
        wall = wall_part("wall", (distance, half), (distance, -half), half)
        below = replace(wall, points=wall.points - [0, 0, half / 2])
        arrays = arrays_from_parts([below], actors=[("rsu_1", "rsu", -1)])
        config = camera(width_px=8, height_px=8, fov_deg=20.0, range_m=655.35)
        image = traced_depth(arrays, device, config).depth
        np.testing.assert_array_equal(image, expected)


def test_frame_without_vehicles_and_no_views(device: str) -> None:
    arrays = two_cars(2)
    arrays.poses[1, :2] = ABSENT
    config = camera(mount={"rsu": MountConfig(pitch_deg=20)})
    batch = traced_depth(arrays, device, config, [0, 1])
    vehicles = [actor.object_id for actor in arrays.actors[:2]]
    assert np.isin(batch.object_id[0], vehicles).sum() == 0 or not np.isin(batch.object_id[1], vehicles).any()
    assert not np.isin(batch.object_id[1], vehicles).any()
    nobody = camera(on=())
    assert traced_depth(arrays, device, nobody).depth.shape == (0, 44, 60)


def test_float_format_reaches_beyond_the_image(device: str) -> None:
    wall = wall_part("wall", (800.0, 3000.0), (800.0, -3000.0), 3000.0)
    below = replace(wall, points=wall.points - [0, 0, 1500.0])
    arrays = arrays_from_parts([below], actors=[("rsu_1", "rsu", -1)])
    config = camera(width_px=8, height_px=8, fov_deg=20.0, range_m=2000.0, format="float32")
    batch = traced_depth(arrays, device, config)
    np.testing.assert_allclose(batch.depth_m, 800.0, rtol=1e-6)
    np.testing.assert_array_equal(batch.depth, 0)  # 16 bits end at 655.35 m


def test_defaults_are_the_papers() -> None:
    config = DepthCamera()
    assert (config.on, config.format, config.range_m) == (("rsu",), "png16", 655.0)
    assert (config.segmentation, config.boxes_2d) == (False, True)


CAV_CAMERA = """
scenarios: [{name: street, town: town03, traffic: {vehicle_count: 3, spawn_center_m: [0, 0, 0], cav_ranks: [1]}}]
weathers: [sunny, rainy]
channel: {enabled: false}
sensors:
  - {type: depth, name: front, on: [cav], width_px: 64, height_px: 40, format: float32, segmentation: true,
     mount: {cav: {position_m: [2.31, 0.02, 1.23]}}}
"""


def test_vehicle_carries_a_depth_camera_by_configuration(device: str, tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(CAV_CAMERA)
    config, arrays, frames = load_config(tmp_path / "c.yaml"), two_cars(4), [1, 3]
    found = captured(capture_cameras, config, arrays, device, [frames])
    tables = found["sunny"]
    assert set(tables) == {"depth", "segmentation", "boxes_2d", "box_visibility"}
    sensor = config.sensors[0]
    views = make_views(arrays, frames, sensor)
    expected = traced_depth(arrays, device, sensor, frames)
    depth = tables["depth"].to_pylist()
    assert [(row["frame"], row["agent"], row["sensor"]) for row in depth] == [
        (1, "cav_1", "front"),
        (3, "cav_1", "front"),
    ]
    for view, row in enumerate(depth):
        metres = np.array(row["depth_m"], dtype=np.float32).reshape(40, 64)
        np.testing.assert_array_equal(np.where(metres == 0, np.inf, metres), expected.depth_m[view])
        stored = decode_depth(row["image"]["bytes"])
        np.testing.assert_allclose(stored, depth_to_metres(expected.depth[view]), rtol=2e-7)
        assert row["image"]["path"] == f"street/sunny/cav_1/{views.frame[view]:06d}_front.png"
    for view, row in enumerate(tables["segmentation"].to_pylist()):
        np.testing.assert_array_equal(decode_instance(row["instance"]["bytes"]), expected.object_id[view])
        assert set(np.unique(decode_semantic(row["semantic"]["bytes"]))) <= {o.tag for o in arrays.objects} | {11}
        assert row["semantic"]["path"].endswith("_front_semantic.png")
    # The other car comes towards the camera, and its pixels are counted once for all.
    van = arrays.actors[1].object_id
    pixels = [(expected.object_id[view] == van).sum() for view in range(2)]
    boxes = [row for row in tables["boxes_2d"].to_pylist() if row["object_id"] == van]
    seen = [row for row in tables["box_visibility"].to_pylist() if row["object_id"] == van]
    assert [row["pixels"] for row in boxes] == [row["pixels"] for row in seen] == pixels and min(pixels) > 0
    # Depth does not know the weather: but for the names, every table is the same in rain.
    for name, table in tables.items():
        rainy = found["rainy"][name]
        for column in set(table.column_names) - {"weather"}:
            cells = zip(table.column(column).to_pylist(), rainy.column(column).to_pylist(), strict=True)
            for dry, wet in cells:
                assert (dry["bytes"] == wet["bytes"]) if isinstance(dry, dict) else dry == wet, (name, column)


def test_plain_camera_writes_images_alone(device: str, tmp_path: Path) -> None:
    (tmp_path / "c.yaml").write_text(CAV_CAMERA.replace("format: float32, segmentation: true", "boxes_2d: false"))
    tables = captured(capture_cameras, load_config(tmp_path / "c.yaml"), two_cars(2), device, [[0]])["sunny"]
    assert set(tables) == {"depth"}
    assert tables["depth"].column("depth_m").null_count == 1


def test_floats_that_no_column_holds_are_refused(tmp_path: Path) -> None:
    large = CAV_CAMERA.replace("width_px: 64, height_px: 40", "width_px: 8192, height_px: 8192")
    (tmp_path / "c.yaml").write_text(large)
    config = load_config(tmp_path / "c.yaml")
    with pytest.raises(ValueError, match=r"sensor 'front'.*output.shard_frames: 31 or less"):
        captured(capture_cameras, config, two_cars(2), "cpu", [[0]])
