"""Depth camera: pinhole, planar depth, centimeters, and every pixel against a float64 brute-force oracle."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mmw.config import MountConfig, load_config
from mmw.scene.scene_data import SceneData
from mmw.scene.views import make_views
from mmw.sensors import DepthCamera
from mmw.sensors.render.projection import intrinsics_of
from mmw.storage.codecs.images import decode_depth, decode_instance, decode_semantic
from mmw.worlds.towns.mesh_part import MeshPart
from tests.fixtures.depth_cameras import STREET, camera
from tests.fixtures.scenes import (
    ABSENT,
    arrays_from_parts,
    box_part,
    ground_part,
    random_triangles,
    two_cars,
    wall_part,
)
from tests.fixtures.sensor_runs import all_carriers, capture_cameras, captured
from tests.fixtures.traced_depth import pixel_rays, traced_depth
from tests.oracles.tracing import agreeing_rays, cast_rays, sensor_rays


def depth_to_metres(depth: np.ndarray) -> np.ndarray:
    return np.where(depth == 0, np.inf, depth * 0.01).astype(np.float32)


def mast(*parts: MeshPart) -> SceneData:
    """Return parts of a town and a roadside unit at the origin."""
    return arrays_from_parts(parts, actors=[("rsu_1", "rsu", -1)])


def wall_ahead(distance: float, half: float) -> MeshPart:
    """Return a square wall that faces the origin along the x axis."""
    wall = wall_part("wall", (distance, half), (distance, -half), half)
    return replace(wall, points=wall.points - [0, 0, half / 2])


def test_depth_is_planar_not_radial(device: str) -> None:
    room = box_part("Buildings/room", (10.0,) * 3, (0.0, 0.0, 0.0), "concrete_facade", "building")
    batch = traced_depth(mast(room), device, camera(fov_deg=90.0, height_px=60))
    # The front wall of the cube fills this image exactly: one depth everywhere, although corner rays are longer.
    np.testing.assert_array_equal(batch.depth, 500)
    np.testing.assert_allclose(batch.depth_m, 5.0, atol=1e-5)
    assert batch.depth.dtype == np.uint16


def test_rows_run_down_and_columns_to_the_right(device: str) -> None:
    arrays = mast(ground_part(), wall_part("left", (20.0, 1.0), (20.0, 30.0), 30.0))
    config = camera(mount={"rsu": MountConfig(position_m=(0, 0, 2.0))})
    image = traced_depth(arrays, device, config).depth[0]
    assert image[-1, 30] > 0 and image[0, -1] == 0  # ground below, sky above on the right
    assert image[21, 0] == 2000 and image[21, -1] == 0  # wall on the left only


@pytest.mark.parametrize("size", [(60, 44), (33, 17)])
@pytest.mark.parametrize("kind", ["street", "soup"])
def test_every_pixel_equals_the_oracle(device: str, kind: str, size: tuple[int, int]) -> None:
    keys = {"width_px": size[0], "height_px": size[1]}
    arrays, config, frames = two_cars(3), camera(on=("cav", "rsu"), mount=STREET, **keys), [0, 2]
    if kind == "soup":
        arrays = all_carriers(random_triangles(3, 200, vehicles=3, frames=2))
        config, frames = camera(on=("cav",), range_m=25.0, **keys), [1, 0]
    views, batch = make_views(arrays, frames, config), traced_depth(arrays, device, config, frames)
    rays = pixel_rays(intrinsics_of(config))
    ambiguous = 0
    for view in range(len(views)):
        frame = int(views.frame[view])
        origin, direction = sensor_rays(views.pose[view], rays)
        hits = cast_rays(arrays, frame, origin, direction)
        found = batch.depth_m[view].ravel(), batch.object_id[view].ravel()
        wanted = hits.t * rays[:, 0], hits.object_id
        is_same = agreeing_rays(arrays, frame, (origin, direction), found, wanted, config.range_m)
        ambiguous += (~is_same).sum()
        depth = np.where(wanted[0] < config.range_m, wanted[0], np.inf)
        stored = depth_to_metres(batch.depth[view].ravel()).astype(float)
        with np.errstate(invalid="ignore"):
            assert np.all((np.isinf(stored) & np.isinf(depth)) | (np.abs(stored - depth) < 0.006) | ~is_same)
    assert ambiguous <= 2e-3 * batch.depth.size, ambiguous


def test_centimetres_round_to_nearest(device: str) -> None:
    for distance, expected in ((7.004, 700), (7.006, 701), (0.008, 1), (0.002, 1), (655.34, 65534), (656.0, 0)):
        config = camera(width_px=8, height_px=8, fov_deg=20.0, range_m=655.35)
        image = traced_depth(mast(wall_ahead(distance, 3.0 * max(distance, 1.0))), device, config).depth
        np.testing.assert_array_equal(image, expected)


def test_frame_without_vehicles_and_no_views(device: str) -> None:
    arrays = two_cars(2)
    arrays.poses[1, :2] = ABSENT
    config = camera(mount={"rsu": MountConfig(pitch_deg=20)})
    batch = traced_depth(arrays, device, config, [0, 1])
    vehicles = [actor.object_id for actor in arrays.actors[:2]]
    assert not np.isin(batch.object_id[1], vehicles).any()
    nobody = camera(on=())
    assert traced_depth(arrays, device, nobody).depth.shape == (0, 44, 60)


def test_float_format_reaches_beyond_the_image(device: str) -> None:
    config = camera(width_px=8, height_px=8, fov_deg=20.0, range_m=2000.0, format="float32")
    batch = traced_depth(mast(wall_ahead(800.0, 3000.0)), device, config)
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
    assert [(row["frame"], row["agent"], row["sensor"]) for row in depth] == [(k, "cav_1", "front") for k in (1, 3)]
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
