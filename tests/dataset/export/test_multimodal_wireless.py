"""The published layout: keys, shapes and types of every file, and its numbers against the tables by other means."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from PIL import Image

from mmw.channel import CarrierPaths, PlanarArray, apply_arrays, frequency_response, rotations_from_poses, ula, upa
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.transforms import pose_from_ypr, quaternion_from_ypr, quaternion_to_matrix
from mmw.dataset import open_dataset
from mmw.dataset.export.exporter import Selection, export
from mmw.dataset.export.multimodal_wireless.layout import camera_numbers
from mmw.dataset.export.read_sensors import Sensor
from mmw.storage.codecs.carla_depth import decode_bgra, decode_log_grey
from mmw.storage.codecs.images import decode_depth, decode_metres
from tests.fixtures.export_data import assert_png_of, carla_to_world
from tests.fixtures.export_radio import BLOCKED, CAVS, WEATHER, antenna, attitude, generate_dataset

FRAMES, PATHS, CARRIER = 3, 5, 28e9
FLIP = np.diag([1.0, -1.0, 1.0])
ANGLES = [f"{glob}{angle}_{end}" for glob in ("", "glob_") for angle in ("theta", "phi") for end in "tr"]
LINK = "Nt_64_Nr_16_fc_28GHz/cav_1"


@pytest.fixture(scope="module")
def root(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return generate_dataset(tmp_path_factory.mktemp("made") / "data", FRAMES, PATHS)


@pytest.fixture(scope="module")
def out(root: Path, exported) -> Path:
    return exported("v1", {"arrays": "1x64-1x16,8x8-2x2"}, root) / WEATHER / "Town03" / "Town03_made_up_seed42"


@pytest.fixture(scope="module")
def published(root: Path, exported) -> Path:
    """Export with the published delays."""
    out = exported("v1", {"delays": "normalized"}, root, agents=("cav_1",))
    return out / WEATHER / "Town03" / "Town03_made_up_seed42"


def our_link(root: Path, frame: int, agent: str, *arrays: PlanarArray) -> tuple[CarrierPaths, np.ndarray]:
    """Return the paths of a link from the roadside unit, and their coefficients between a pair of arrays."""
    data = open_dataset(root)
    paths = data.paths(CARRIER, frames=range(frame, frame + 1))
    paths = paths.take((paths.keys["agent"] == agent) & (paths.keys["peer"] == "rsu_1"))
    turns = (rotations_from_poses(data.read("poses"), paths, end) for end in ("tx", "rx"))
    return paths, apply_arrays(paths, *arrays, CARRIER, *turns)


def rotation(roll: float, yaw: float, pitch: float) -> np.ndarray:
    """Return the rotation of CARLA's angles [deg] between left-handed frames."""
    return carla_to_world([0.0, 0.0, 0.0, roll, yaw, pitch])[:3, :3]


def test_files_of_a_frame(out):
    """Every name is the published one."""
    names = {path.relative_to(out).as_posix() for path in out.rglob("*000001*")}
    cavs = {f"{cav}/000001{end}" for cav in CAVS for end in (".yaml", ".pcd", "_camera0.png")}
    rsu = {f"rsu_1/000001{end}" for end in (".yaml", ".pcd", "_camera0.png", "_depth_camera0.png", ".json")}
    links = [*CAVS, "cav_1/cav_2", "cav_2/cav_1"]
    folders = [f"{sizes}_fc_{band}GHz" for sizes in ("Nt_64_Nr_16", "Nt_8x8_Nr_2x2") for band in ("28", "4.9")]
    channels = {f"{folder}/{link}/000001_paths.npz" for folder in folders for link in links}
    assert names == {"scenes/000001.yaml"} | cavs | rsu | channels


def test_channel_keys_shapes_and_types(out):
    with np.load(out / LINK / "000000_paths.npz") as file:
        assert set(file.files) == {"a", "tau", *ANGLES}
        assert (file["a"].shape, file["a"].dtype) == ((1, 1, 16, 1, 64, PATHS, 1), np.complex64)
        for name in ("tau", *ANGLES):
            assert (file[name].shape, file[name].dtype) == ((1, 1, 1, PATHS), np.float32), name
    frame, agent, _ = BLOCKED
    with np.load(out / f"Nt_8x8_Nr_2x2_fc_28GHz/{agent}/{frame:06d}_paths.npz") as file:
        assert file["a"].shape == (1, 1, 4, 1, 64, 1, 1) and not file["a"].any()
        assert file["tau"].tolist() == [[[[-1.0]]]]


@pytest.mark.parametrize("delays", ["absolute", "normalized"])
def test_files_give_our_channel(root, out, published, delays):
    """H of the published reader, the sum of a exp(-j 2 pi f tau), is ours in both conventions of delay."""
    folder = {"absolute": out, "normalized": published}[delays]
    frequencies = np.linspace(-60e6, 60e6, 33)
    for frame in range(FRAMES):
        with np.load(folder / LINK / f"{frame:06d}_paths.npz") as file:
            a, tau = file["a"].astype(complex)[0, 0, :, 0, :, :, 0], file["tau"][0, 0, 0].astype(float)
        assert (tau.min() == 0.0) == (delays == "normalized")
        h = a @ np.exp(-2j * np.pi * frequencies * tau[:, None])
        paths, coefficients = our_link(root, frame, "cav_1", ula(64), ula(16))
        is_normalized = delays == "normalized"
        (expected,) = frequency_response(coefficients, paths, frequencies, CARRIER, normalize_delays=is_normalized)
        assert np.abs(h - expected).max() < 3e-5 * np.abs(expected).max()


def test_line_of_sight_in_closed_form(root, out):
    """Absolute delay is distance over c; the arrays' angles point from one antenna to the other in their own axes."""
    poses = open_dataset(root).read("poses").to_pydict()
    for frame in range(FRAMES):
        with np.load(out / "Nt_8x8_Nr_2x2_fc_28GHz" / "cav_2" / "cav_1" / f"{frame:06d}_paths.npz") as file:
            values = {name: float(file[name][0, 0, 0, 0]) for name in ("tau", *ANGLES)}
        gap = antenna(poses, frame, "cav_1") - antenna(poses, frame, "cav_2")  # cav_2 transmits
        assert values["tau"] == pytest.approx(np.linalg.norm(gap) / SPEED_OF_LIGHT, rel=1e-6)
        for end, agent, line in (("t", "cav_2", gap), ("r", "cav_1", -gap)):
            turn = attitude(poses, frame, agent)
            for glob, local in (("glob_", line), ("", turn.T @ line)):
                theta, phi = values[f"{glob}theta_{end}"], values[f"{glob}phi_{end}"]
                found = [np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)]
                np.testing.assert_allclose(found, local / np.linalg.norm(local), atol=2e-6)


def test_planar_arrays_are_counted_as_ours(root, out):
    with np.load(out / "Nt_8x8_Nr_2x2_fc_28GHz" / "cav_3" / "000002_paths.npz") as file:
        a, tau = file["a"][0, 0, :, 0, :, :, 0], file["tau"][0, 0, 0]
    paths, expected = our_link(root, 2, "cav_3", upa(8, 8), upa(2, 2))
    np.testing.assert_allclose(np.abs(a), np.abs(np.moveaxis(expected, 0, -1)), rtol=1e-5, atol=1e-12)
    np.testing.assert_allclose(tau, paths.tau, rtol=1e-6)


def test_point_clouds_round_trip(root, out):
    """Points mirrored to CARLA's axes, exactly; intensity to half of one of 255 steps."""
    rows = open_dataset(root).read("lidar").to_pylist()
    for row in rows:
        head, body = (out / row["agent"] / f"{row['frame']:06d}.pcd").read_bytes().split(b"DATA binary\n")
        assert f"POINTS {row['point_count']}\n".encode() in head and b"FIELDS x y z rgb\n" in head
        points = np.frombuffer(body, [("xyz", "<f4", 3), ("rgb", "<u4")])
        expected = np.stack([row["x"], -np.array(row["y"]), row["z"]], axis=-1).reshape(-1, 3)
        np.testing.assert_array_equal(points["xyz"], expected.astype(np.float32))
        assert (points["rgb"] & 0xFFFF == 0).all()
        np.testing.assert_allclose((points["rgb"] >> 16) / 255, row["intensity"], atol=0.5 / 255 + 1e-9)


def test_images_round_trip(root, out):
    data = open_dataset(root)
    for row in data.read("rgb").to_pylist():
        assert_png_of(out / row["agent"] / f"{row['frame']:06d}_camera0.png", row["image"]["bytes"])
    for row in data.read("depth").to_pylist():
        depth = decode_metres(row["image"]["bytes"], row["depth_m"])
        grey = np.asarray(Image.open(out / "rsu_1" / f"{row['frame']:06d}_depth_camera0.png"))
        assert (grey.dtype, grey.shape) == (np.uint8, (6, 8))
        near = np.isfinite(depth) & (depth > 4)
        np.testing.assert_allclose(decode_log_grey(grey)[near], depth[near], rtol=0.012)
        assert (grey[np.isinf(depth)] == 255).all()


def test_depth_in_24_bits(root, tmp_path):
    export(root, "v1", tmp_path / "out", Selection(agents=("rsu_1",), frames=range(1)), {"depth": "raw24"})
    (path,) = (tmp_path / "out").rglob("*_depth_camera0.png")
    depth = decode_depth(open_dataset(root).read("depth").to_pylist()[0]["image"]["bytes"])
    found = decode_bgra(np.asarray(Image.open(path))[..., ::-1])
    np.testing.assert_allclose(found, np.minimum(depth, 1000.0), atol=1e-4)


def test_yaml_of_a_cav(root, out):
    data, frame = open_dataset(root), 1
    content = yaml.safe_load((out / "cav_2" / f"{frame:06d}.yaml").read_text())
    assert (content["actor"], content["frame"]) == ("cav_2", frame)
    sensors = content["sensors"]
    assert list(sensors) == [
        "cameras", "vehicle_speed", "vehicle_pose", "lidar_pose", "imu_pose", "imu_measurement", "GPS",
        "predicted_ego_pos", "true_ego_pos",
    ]  # fmt: skip
    (row,) = data.read("poses", frames=range(frame, frame + 1), agent="cav_2").to_pylist()
    turn = quaternion_to_matrix([row[name] for name in ("qx", "qy", "qz", "qw")])
    np.testing.assert_allclose(rotation(**sensors["vehicle_pose"]["rotation"]), FLIP @ turn @ FLIP, atol=1e-9)
    assert list(sensors["vehicle_pose"]["location"].values()) == pytest.approx([row["x"], -row["y"], row["z"]])
    assert list(sensors["vehicle_speed"]["speed"].values()) == pytest.approx([row["vx"], -row["vy"], row["vz"]])
    lidar = turn @ [0.3, -0.2, 2.5] + [row["x"], row["y"], row["z"]]
    assert list(sensors["lidar_pose"]["location"].values()) == pytest.approx(list(FLIP @ lidar))
    (imu,) = data.read("imu", frames=range(frame, frame + 1), agent="cav_2").to_pylist()
    measured = sensors["imu_measurement"]
    assert list(measured["accelerometer"].values()) == pytest.approx([imu["ax"], -imu["ay"], imu["az"]])
    assert list(measured["gyroscope"].values()) == pytest.approx([-imu["gx"], imu["gy"], -imu["gz"]])
    (fix,) = data.read("gnss", frames=range(frame, frame + 1), agent="cav_2").to_pylist()
    radius, scale = 6378137.0, np.cos(np.radians(49.0))  # CARLA's Mercator map, y to the south
    east = scale * radius * np.radians(fix["longitude_deg"] - 8.0)
    north = [np.log(np.tan(np.radians(90 + latitude) / 2)) for latitude in (fix["latitude_deg"], 49.0)]
    south = scale * radius * (north[1] - north[0])
    assert list(sensors["GPS"]["location"].values()) == pytest.approx([east, south, fix["altitude_m"]])
    yaw = np.radians(sensors["predicted_ego_pos"]["rotation"]["yaw"])  # from east to south; headings from north to east
    assert [np.cos(yaw), np.sin(yaw)] == pytest.approx([np.sin(fix["heading"]), -np.cos(fix["heading"])])
    boxes = {box["object_id"]: box for box in data.read("boxes", frames=range(frame, frame + 1)).to_pylist()}
    ego = np.array([row["x"], row["y"], row["z"]])
    assert content["vehicles"].keys() - {0} <= boxes.keys() - {row["object_id"]}
    for number, found in content["vehicles"].items():
        if number:
            box = boxes[number]
            middle = np.array(found["location"]) + found["center"]
            np.testing.assert_allclose(middle, [box["x"], -box["y"], box["z"]], atol=1e-6)
            assert found["extent"] == pytest.approx([box["length"] / 2, box["width"] / 2, box["height"] / 2])
            turn = quaternion_to_matrix(quaternion_from_ypr(box["yaw"], box["pitch"], box["roll"]))
            np.testing.assert_allclose(rotation(*found["angle"]), FLIP @ turn @ FLIP, atol=1e-9)
            assert np.linalg.norm(FLIP @ found["location"] - ego) <= 50
    far = [n for n, box in boxes.items() if np.linalg.norm(ego - [box["x"], box["y"], box["z"]]) < 45]
    assert set(far) - {row["object_id"]} <= content["vehicles"].keys()


def test_yaml_of_a_roadside_unit_and_scene(root, out):
    content = yaml.safe_load((out / "rsu_1" / "000002.yaml").read_text())
    assert list(content["sensors"]) == ["cameras", "depth_cameras", "rsu_pose", "lidar_pose", "radar_pose"]
    boxes = open_dataset(root).read("boxes", frames=range(2, 3)).to_pylist()
    assert [entry["id"] for entry in content["vehicles"]] == [box["object_id"] for box in boxes]
    assert set(content["vehicles"][0]) == {"id", "name", "pose"}
    scene = yaml.safe_load((out / "scenes" / "000002.yaml").read_text())
    assert (scene["frame"], len(scene["vehicles"])) == (2, 5)
    assert list(scene["vehicles"][0]) == ["id", "bp_id", "speed", "pose"]
    speed = np.linalg.norm([boxes[0][name] for name in ("vx", "vy", "vz")])
    assert scene["vehicles"][0]["speed"] == pytest.approx(speed)


def test_radar_points(root, out):
    (row,) = open_dataset(root).read("radar", frames=range(1), agent="rsu_1", sensor="radar").to_pylist()
    points = json.loads((out / "rsu_1" / "000000.json").read_text())
    assert len(points) == row["point_count"] > 0
    signed = (
        ("velocity", "velocity", 1),
        ("azimuth", "azimuth", -1),
        ("altitude", "elevation", 1),
        ("depth", "range", 1),
    )
    for name, column, sign in signed:
        np.testing.assert_allclose([point[name] for point in points], sign * np.array(row[column]), rtol=1e-6)


def test_cameras_are_numbered_by_where_they_look():
    def camera(name: str, yaw: float) -> Sensor:
        return Sensor("cav_1", name, "rgb", pose_from_ypr([0.0, 0.0, 0.0], yaw), None, (8, 6), "", (), "{}")

    four = {"a": camera("a", -1.5), "b": camera("b", 3.1), "c": camera("c", 0.1), "d": camera("d", 1.6)}
    assert camera_numbers(four) == {"c": 0, "b": 1, "d": 2, "a": 3}
    assert camera_numbers({"only": camera("only", 2.0)}) == {"only": 0}
    both = camera_numbers(four | {"e": camera("e", 0.0)})
    assert both["c"] == 0 and sorted(both.values()) == [0, 1, 2, 3, 4]
    assert camera_numbers({}) == {}


def test_arrays_that_cannot_be_read(root, tmp_path):
    with pytest.raises(ValueError, match="'64x16' is no pair of arrays"):
        export(root, "v1", tmp_path / "out", Selection(), {"arrays": "64x16"})
