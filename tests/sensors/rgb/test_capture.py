"""RGB cameras in a run: rows, what shares rays, independence of batches, launches and company, points on pixels."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import warp as wp

from mmw.config import Config, MountConfig, load_config
from mmw.config.lens import LensConfig
from mmw.core.transforms import compose, invert, transform_points
from mmw.scene.rows import static_rows
from mmw.scene.scene_data import SceneData
from mmw.scene.views import make_views, sample_views
from mmw.sensors import DepthCamera, RgbCamera
from mmw.sensors.camera_group import capture as cameras
from mmw.sensors.camera_group import launch_images
from mmw.sensors.camera_group.launches import make_launches
from mmw.sensors.image_encoder import MAX_WAITING_BYTES, Encoder
from mmw.sensors.render import row_lists
from mmw.sensors.render.lighting import shade_samples
from mmw.sensors.render.projection import intrinsics_of, project
from mmw.sensors.rgb import simulate as rgb
from mmw.sensors.rgb.config import paper_cameras
from mmw.storage.arrow_tables import table_from_columns
from mmw.storage.codecs.images import (
    decode_depth,
    decode_flow,
    decode_instance,
    decode_normals,
    decode_rgb,
    decode_semantic,
    encode_rgb,
)
from tests.conftest import DEVICES
from tests.fixtures.scenes import two_cars
from tests.fixtures.sensor_runs import capture_cameras, captured

MOUNT = "mount: {cav: {position_m: [2.31, 0.02, 1.23]}}"
HEAD = """
scenarios: [{name: street, town: town03, traffic: {vehicle_count: 3, spawn_center_m: [0, 0, 0], cav_ranks: [1]}}]
weathers: [sunny, rainy]
channel: {enabled: false}
sensors:
"""
FRONT = (
    "  - {type: rgb, name: front, on: [cav], width_px: 64, height_px: 48, format: png, segmentation: true, "
    f"normals: true, flow: true, {MOUNT}}}\n"
)
MAST = FRONT.replace("front", "mast").replace("[cav]", "[rsu]").replace("cav: {position_m: [2.31, 0.02, 1.23]}", "")
LOOKS_DOWN = "mount: {rsu: {position_m: [0, 0, 3.9], pitch_deg: 35}}"
DEPTH = f"  - {{type: depth, on: [cav], width_px: 64, height_px: 48, segmentation: true, {MOUNT}}}\n"


def street(frames: int = 4) -> SceneData:
    arrays = two_cars(frames)
    return replace(arrays, materials=dict.fromkeys(("sunny", "rainy"), arrays.materials["sunny"]))


def configured(folder: Path, sensors: str, *changes: str) -> Config:
    (folder / "c.yaml").write_text(HEAD + sensors)
    return load_config(folder / "c.yaml", changes)


def record(
    config: Config,
    device: str,
    batches: Sequence[Sequence[int]],
    arrays: SceneData | None = None,
    weathers: Sequence[str] | None = None,
    *,
    puts_off: bool = False,
) -> dict[str, dict[str, list[dict]]]:
    """Return the rows of batches of frames by weather and table, in all or some of the weathers; see `captured`."""
    arrays = street() if arrays is None else arrays
    found = captured(capture_cameras, config, arrays, device, batches, weathers, puts_off=puts_off)
    return {weather: {name: table.to_pylist() for name, table in tables.items()} for weather, tables in found.items()}


@pytest.fixture(scope="module", params=DEVICES)
def device(request: pytest.FixtureRequest) -> str:
    """Name of a Warp device, as in `conftest.py`, for all tests of the module in turn."""
    return request.param


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory, device: str) -> dict[str, dict[str, list[dict]]]:
    """Rows of frames 1 and 3 by weather and table: two RGB cameras in one launch, depth in the same."""
    return record(configured(tmp_path_factory.mktemp("c"), FRONT + MAST + DEPTH), device, [[1, 3]])


def test_every_table_has_a_row_for_each_image(made: dict) -> None:
    keys = [(frame, *camera) for frame in (1, 3) for camera in (("cav_1", "front"), ("rsu_1", "mast"))]
    for weather in ("sunny", "rainy"):
        tables = made[weather]
        for name in ("rgb", "normals", "flow"):
            assert [(row["frame"], row["agent"], row["sensor"]) for row in tables[name]] == keys
        assert [(row["frame"], row["sensor"]) for row in tables["depth"]] == [(1, "depth"), (3, "depth")]
        assert len(tables["segmentation"]) == 6
        row = tables["rgb"][0]
        assert row["format"] == "png" and row["image"]["path"] == f"street/{weather}/cav_1/000001_front.png"
        assert decode_rgb(row["image"]["bytes"]).shape == (48, 64, 3)
        assert tables["flow"][0]["image"]["path"].endswith("000001_front_flow.png")


@pytest.mark.parametrize("is_made_there", [True, False])
def test_jpeg_files_are_the_same(
    tmp_path: Path, device: str, made: dict, monkeypatch: pytest.MonkeyPatch, is_made_there: bool
) -> None:
    """Whether the device makes the files, as GPUs do, or threads."""
    monkeypatch.setattr(launch_images, "makes_files", lambda _: is_made_there)
    sensors = (FRONT + MAST).replace("format: png", "format: jpeg")
    tables = record(configured(tmp_path, sensors + DEPTH), device, [[1, 3]])
    for weather in ("sunny", "rainy"):
        for row, exact in zip(tables[weather]["rgb"], made[weather]["rgb"], strict=True):
            assert row["image"]["path"] == exact["image"]["path"].replace(".png", ".jpg")
            assert row["image"]["bytes"] == encode_rgb(decode_rgb(exact["image"]["bytes"]), "jpeg", 95)


def test_weather_changes_colours_and_nothing_else(made: dict) -> None:
    for name, rows in made["sunny"].items():
        for dry, wet in zip(rows, made["rainy"][name], strict=True):
            cells = {key: (dry[key], wet[key]) for key in dry if key != "weather"}
            if name == "rgb":
                images = [decode_rgb(cell["bytes"]).astype(int) for cell in cells.pop("image")]
                assert np.abs(images[0] - images[1]).mean() > 5
                exposures = cells.pop("exposure"), cells.pop("ev100")
                assert exposures[0][1] > exposures[0][0] and exposures[1][1] < exposures[1][0]  # rain is dark
            for key, (one, other) in cells.items():
                assert (one["bytes"] == other["bytes"]) if isinstance(one, dict) else one == other, (name, key)


def test_ev100_and_exposure_are_one_number(made: dict) -> None:
    """A white surface has 1.2 x 2^EV100 cd/m2 (ISO 12232), and one over the exposure in kcd/m2."""
    for row in made["sunny"]["rgb"]:
        assert 1000.0 / row["exposure"] == pytest.approx(1.2 * 2.0 ** row["ev100"], rel=1e-5)
        assert 13 < row["ev100"] < 16  # the rule of sunny sixteen: 15


def test_depth_and_colour_see_the_same(made: dict) -> None:
    tables = made["sunny"]
    for frame in (1, 3):
        front, depth = (
            next(r for r in tables["segmentation"] if r["sensor"] == name and r["frame"] == frame)
            for name in ("front", "depth")
        )
        assert front["instance"]["bytes"] == depth["instance"]["bytes"]
        assert front["semantic"]["bytes"] == depth["semantic"]["bytes"]
        boxes = [[r for r in tables["boxes_2d"] if r["sensor"] == name] for name in ("front", "depth")]
        assert [{**row, "sensor": ""} for row in boxes[0]] == [{**row, "sensor": ""} for row in boxes[1]]
        normals = decode_normals(next(r for r in tables["normals"] if r["frame"] == frame)["image"]["bytes"])
        metres = decode_depth(next(r for r in tables["depth"] if r["frame"] == frame)["image"]["bytes"])
        tags = decode_semantic(front["semantic"]["bytes"])
        np.testing.assert_array_equal(normals.any(axis=2), np.isfinite(metres))
        np.testing.assert_array_equal(tags == 11, np.isinf(metres))
        np.testing.assert_allclose(normals[tags == 1], np.broadcast_to([0, 0, 1], normals[tags == 1].shape), atol=1e-6)


def test_flow_of_the_street_is_that_of_driving(made: dict) -> None:
    """Frame 1 to 2: cav_1 drives 1 m along x; a still point at (x, y, z) of the camera moves to (x - 1, y, z)."""
    tables, config = made["sunny"], RgbCamera(width_px=64, height_px=48)
    flow = decode_flow(tables["flow"][0]["image"]["bytes"])
    depth = decode_depth(tables["depth"][0]["image"]["bytes"])
    tags = decode_semantic(tables["segmentation"][1]["semantic"]["bytes"])
    assert tables["segmentation"][1]["sensor"] == "front" and tables["flow"][0]["sensor"] == "front"
    camera = intrinsics_of(config)
    u, v = np.meshgrid(np.arange(64) + 0.5, np.arange(48) + 0.5)
    before = np.stack([depth, -(u - camera.cx) / camera.fx * depth, -(v - camera.cy) / camera.fy * depth], axis=-1)
    still = np.isin(tags, [1, 3]) & (depth > 3) & np.isfinite(depth)
    after = project(camera, before[still] - [1.0, 0.0, 0.0])
    np.testing.assert_allclose(flow[still], after - np.stack([u, v], -1)[still], atol=0.02, rtol=0.01)
    assert still.sum() > 1000 and np.abs(flow[still]).max() > 3
    mast = decode_flow(tables["flow"][1]["image"]["bytes"])
    ground = decode_semantic(next(r for r in tables["segmentation"] if r["sensor"] == "mast")["semantic"]["bytes"]) == 1
    np.testing.assert_array_equal(mast[ground], 0.0)


@pytest.mark.parametrize("frames", [[[1], [3]], [[3], [1]]])
def test_batches_do_not_change_a_byte(device: str, made: dict, tmp_path: Path, frames: list) -> None:
    assert record(configured(tmp_path, FRONT + MAST + DEPTH), device, frames) == made


def test_launches_of_one_view_do_not_change_a_byte(
    device: str, made: dict, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cameras, "max_pixels", lambda _: 1)
    assert record(configured(tmp_path, FRONT + MAST + DEPTH), device, [[1, 3]]) == made


@pytest.mark.parametrize("is_made_there", [True, False])
def test_recorded_launches_do_not_change_a_byte(
    device: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_made_there: bool
) -> None:
    """As in a live simulation, frame by frame: a car is absent at times, and one camera samples every other frame."""
    monkeypatch.setattr(launch_images, "makes_files", lambda _: is_made_there)
    sensors = FRONT + MAST.replace("rgb,", "rgb, rate_hz: 50,") + DEPTH.replace("depth,", "depth, format: float32,")
    config = configured(tmp_path, sensors.replace("format: png", "format: jpeg"))
    arrays = street(10)
    arrays.poses[[4, 5, 8], 1] = np.nan
    steps = [[k] for k in range(10)]
    launches: list[object] = []
    replay = wp.capture_launch

    def count(graph: object, *stream: object) -> None:
        if stream:  # records of cameras say where they are replayed, that of the scene does not
            launches.append(graph)
        replay(graph, *stream)

    monkeypatch.setattr(wp, "capture_launch", count)
    direct = record(config, device, steps, arrays)
    assert not launches
    assert record(config, device, steps, arrays, puts_off=True) == direct
    assert len(launches) == 9 + 4 and len(set(launches)) == 2  # two launches, whose first calls are no replays


@pytest.mark.parametrize("puts_off", [True, False])
def test_launches_that_are_alike_are_started_together(device: str, tmp_path: Path, puts_off: bool) -> None:
    """Two cameras that differ in their mounts alone have launches of their own, whose records must not be mixed up."""
    back = DEPTH.replace("depth,", "depth, name: back,").replace("cav: {", "cav: {yaw_deg: 180, ")
    config, steps = configured(tmp_path, DEPTH + back), [[k] for k in range(4)]
    apart = [record(configured(tmp_path, one), device, steps)["sunny"]["depth"] for one in (DEPTH, back)]
    together = record(config, device, steps, puts_off=puts_off)["sunny"]["depth"]
    assert (
        apart[0][0]["image"]["bytes"] != apart[1][0]["image"]["bytes"]
        and [row for rows in zip(*apart[::-1], strict=True) for row in rows] == together
    )


@pytest.mark.parametrize("puts_off", [True, False])
def test_lists_without_room_do_not_change_a_byte(
    device: str, made: dict, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, puts_off: bool
) -> None:
    """Images are made again until there is room for what edges, reflections and files of them need."""
    monkeypatch.setattr(launch_images, "makes_files", lambda _: True)
    sensors = (FRONT + MAST).replace("format: png", "format: jpeg")
    exact = record(configured(tmp_path, sensors + DEPTH), device, [[1, 3]])
    monkeypatch.setattr(row_lists, "MIN_ROOM", 1)
    monkeypatch.setattr(row_lists, "SHARES", dict.fromkeys(row_lists.SHARES, 1e-4))
    assert record(configured(tmp_path, sensors + DEPTH), device, [[1, 3]], puts_off=puts_off) == exact


@pytest.mark.parametrize("weather", ["sunny", "rainy"])
def test_a_run_that_goes_on_makes_the_missing_weather_alone(
    device: str, made: dict, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, weather: str
) -> None:
    shaded = []
    monkeypatch.setattr(rgb, "shade_samples", lambda *args, **kw: shaded.append(args[1]) or shade_samples(*args, **kw))
    config = configured(tmp_path, FRONT + MAST + DEPTH)
    assert record(config, device, [[1, 3]], weathers=[weather]) == {weather: made[weather]}
    assert len(shaded) > 0 and all(one.wet.wetness == shaded[0].wet.wetness for one in shaded)
    assert (shaded[0].wet.wetness > 0.0) == (weather == "rainy")


@pytest.mark.parametrize("sensor", [FRONT, MAST, DEPTH])
def test_a_camera_alone_has_the_rows_that_it_has_in_company(
    device: str, made: dict, tmp_path: Path, sensor: str
) -> None:
    config = configured(tmp_path, sensor)
    alone = record(config, device, [[1, 3]])
    for weather, tables in alone.items():
        for name, rows in tables.items():
            own = [row for row in made[weather][name] if row["sensor"] == config.sensors[0].name]
            assert rows == own and (rows or name in ("boxes_2d", "box_visibility")), (weather, name)


def test_noise_is_each_cameras_own_and_each_frames(device: str, tmp_path: Path) -> None:
    """Two cameras of one place and one launch: equal pictures without noise, not with it, and the same every time."""
    twin = FRONT.replace("front", "twin")
    still = street(1)
    arrays = replace(still, frames=range(2), poses=np.repeat(still.poses, 2, axis=0))

    def images(*changes: str) -> list[np.ndarray]:
        config = configured(tmp_path, FRONT + twin, "weathers=[sunny]", *changes)
        rows = record(config, device, [[0, 1]], arrays)["sunny"]["rgb"]
        return [decode_rgb(row["image"]["bytes"]) for row in rows]

    clean = images()
    assert len(clean) == 4 and all(np.array_equal(image, clean[0]) for image in clean)
    noise = [f"sensors.{k}.image.noise={{enabled: true, full_well: 500}}" for k in range(2)]
    noisy = images(*noise)
    different = [np.mean(a != b) for k, a in enumerate(noisy) for b in noisy[:k]]
    assert len(different) == 6 and min(different) > 0.3
    assert all(np.array_equal(a, b) for a, b in zip(noisy, images(*noise), strict=True))


def test_an_image_each_few_frames(device: str, tmp_path: Path) -> None:
    sensors = FRONT.replace("format", "rate_hz: 50, format") + DEPTH
    rows = record(configured(tmp_path, sensors, "weathers=[sunny]"), device, [[0, 1], [2, 3]])["sunny"]
    assert [row["frame"] for row in rows["rgb"]] == [row["frame"] for row in rows["flow"]] == [0, 2]
    assert [row["frame"] for row in rows["depth"]] == [0, 1, 2, 3]
    none = record(configured(tmp_path, sensors, "weathers=[sunny]"), device, [[1]])["sunny"]
    assert none["rgb"] == none["normals"] == none["flow"] == [] and len(none["depth"]) == 1


def test_which_cameras_share_a_launch() -> None:
    arrays, frames = street(), [0, 1, 2, 3]
    depth, views_of = DepthCamera(), partial(sample_views, arrays, frames)
    (shared,) = make_launches([depth, *paper_cameras()], views_of)
    assert [camera.sensor.name for camera in shared.cameras] == ["front", "back", "left", "right", "depth"]
    assert len(shared.views) == 4 * 5 and shared.range_m == 5000.0
    for camera in shared.cameras:
        own = make_views(arrays, frames, camera.sensor)
        np.testing.assert_array_equal(shared.views.pose[camera.rows], own.pose)
        np.testing.assert_array_equal(shared.views.frame[camera.rows], own.frame)
        np.testing.assert_array_equal(shared.views.actor[camera.rows], own.actor)
    assert sorted(np.concatenate([camera.rows for camera in shared.rgb])) == list(range(20))
    np.testing.assert_array_equal(shared.depth[0].rows, np.arange(4))  # in one piece
    front = RgbCamera()
    for other in (DepthCamera(fov_deg=90.0), DepthCamera(mount={"rsu": MountConfig(position_m=(0, 0, 4.1))})):
        assert [len(launch.cameras) for launch in make_launches([front, other], views_of)] == [1, 1]
    others = [RgbCamera(name="b", samples=1), RgbCamera(name="c", lens=LensConfig(model="fisheye"))]
    assert [launch.name for launch in make_launches([front, *others], views_of)] == ["front", "b", "c"]
    # A camera that skips frames does not have every view of the depth camera.
    assert len(make_launches([RgbCamera(rate_hz=50), depth], views_of)) == 2
    assert len(make_launches([RgbCamera(rate_hz=50), depth], partial(sample_views, arrays, [2]))) == 1


def test_pieces_of_a_launch_hold_every_row_once() -> None:
    (launch,) = make_launches([DepthCamera(), *paper_cameras()], partial(sample_views, street(), [0, 1, 2]))
    pieces = list(launch.pieces(4 * 640 * 480))
    assert [len(piece.views) for piece in pieces] == [4, 4, 4, 3]
    for index, camera in enumerate(launch.cameras):
        rows = np.concatenate([4 * k + piece.cameras[index].rows for k, piece in enumerate(pieces)])
        np.testing.assert_array_equal(np.sort(rows), np.sort(camera.rows))
    assert [len(piece.views) for piece in launch.pieces(1)] == [1] * 15


@pytest.mark.parametrize(
    "lens",
    [
        "{}",
        "{model: brown_conrady, k1: -0.08, k2: 0.01, p1: 0.003, cx_px: 84, cy_px: 65}",
        "{model: fisheye, k1: 0.02}",
    ],
)
def test_corners_of_a_box_fall_on_its_pixels(device: str, tmp_path: Path, lens: str) -> None:
    """Points of the world go through pose, mount and lens as the tables give them, and land on the object."""
    sensor = MAST.replace("mount: {}", LOOKS_DOWN).replace("format", f"lens: {lens}, format")
    sensor = sensor.replace("width_px: 64, height_px: 48", "width_px: 160, height_px: 120")
    arrays, frame = street(15), 14  # the cars pass before the mast
    config = configured(tmp_path, sensor, "weathers=[sunny]")
    rows = record(config, device, [[frame]], arrays)["sunny"]
    columns = static_rows(arrays, config)["sensors"]
    (mount,) = table_from_columns("sensors", {"scenario": "street", **columns}).to_pylist()
    assert mount["lens"] == config.sensors[0].lens.model and (mount["width"], mount["height"]) == (160, 120)
    names = {"pinhole": "", "brown_conrady": "k1 k2 p1 p2 k3 k4 k5 k6", "fisheye": "k1 k2 k3 k4"}[mount["lens"]].split()
    stored = LensConfig(
        model=mount["lens"],
        **{f"{name}_px": mount[name] for name in ("fx", "fy", "cx", "cy")},
        **dict(zip(names, mount["coefficients"], strict=True)),
    ).intrinsics(mount["width"], mount["height"], 60.0)
    assert stored == intrinsics_of(config.sensors[0])
    ids = decode_instance(rows["segmentation"][0]["instance"]["bytes"])
    agent = [actor.name for actor in arrays.actors].index("rsu_1")
    keys = ("x", "y", "z", "qx", "qy", "qz", "qw")
    sensor_pose = compose(arrays.poses[frame, agent], np.array([mount[key] for key in keys]))
    for actor in arrays.actors[:2]:
        pose = arrays.poses[frame, arrays.actors.index(actor)]
        signs = np.array([[x, y, z] for x in (-0.5, 0.5) for y in (-0.5, 0.5) for z in (-0.5, 0.5)])
        corners = transform_points(pose, np.array(actor.center) + signs * actor.size)
        image = project(stored, transform_points(invert(sensor_pose), corners))
        v, u = np.nonzero(ids == actor.object_id)
        assert len(u) > 30, actor.name
        edges = np.array([u.min(), v.min(), u.max() + 1, v.max() + 1])
        outline = np.concatenate([image.min(axis=0), image.max(axis=0)])
        assert np.abs(outline - edges).max() <= 1.3, (actor.name, outline, edges)
        (box,) = [row for row in rows["boxes_2d"] if row["object_id"] == actor.object_id]
        amodal = np.array([box[f"amodal_{side}"] for side in ("u_min", "v_min", "u_max", "v_max")])
        assert np.abs(amodal - edges).max() <= 1.3, (actor.name, amodal, edges)
        assert [box[side] for side in ("u_min", "v_min", "u_max", "v_max")] == edges.tolist()
        (seen,) = [row for row in rows["box_visibility"] if row["object_id"] == actor.object_id]
        assert seen["pixels"] == box["pixels"] == len(u) and seen["sensor"] == "mast"


def test_images_wait_for_threads_within_bounds() -> None:
    """With room for two images, a third one is handed over only when the first is done."""
    image = np.zeros(MAX_WAITING_BYTES // 2 - 1, dtype=np.uint8)
    done: list[int] = []

    def encode(_: np.ndarray, number: int) -> bytes:
        done.append(number)
        return bytes([number])

    with ThreadPoolExecutor(1) as pool:
        encoder = Encoder(pool)
        futures = []
        for number in range(6):
            futures.append(encoder.submit(encode, image, number))
            assert len(done) >= number - 1
    assert [future.result() for future in futures] == [bytes([number]) for number in range(6)]
