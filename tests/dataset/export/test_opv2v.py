"""OPV2V by the rules of OpenCOOD's loader, written here without the exporter: names, frames, boxes, points, images."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from mmw.core.geodesy import mercator_from_world
from mmw.core.transforms import angle_between, pose_from_ypr
from mmw.dataset.export.carla_frames import carla_matrix, carla_pose, pose_from_carla
from mmw.dataset.export.exporter import Selection, export
from tests.fixtures import export_data as source

MIRROR_M = 0.25
"""Reach of wing mirrors beyond a vehicle's box [m]."""


def read_pcd(path: Path) -> np.ndarray:
    """Return a binary PCD file as a structured array."""
    data = path.read_bytes()
    head, body = data.split(b"DATA binary\n", 1)
    header = {line.split()[0]: line.split()[1:] for line in head.decode().splitlines() if not line.startswith("#")}
    assert header["VERSION"] == ["0.7"] and header["COUNT"] == ["1"] * 4 and header["HEIGHT"] == ["1"]
    assert header["VIEWPOINT"] == list("0001000") and header["WIDTH"] == header["POINTS"]
    kinds = [f"<{kind.lower()}{size}" for kind, size in zip(header["TYPE"], header["SIZE"], strict=True)]
    points = np.frombuffer(body, list(zip(header["FIELDS"], kinds, strict=True)))
    assert len(points) == int(header["POINTS"][0])
    return points


def loader_boxes(content: dict) -> dict[int, np.ndarray]:
    """Return the corners [8, 3] in CARLA's world of each vehicle, as the loader makes them: location + center."""
    result = {}
    for number, vehicle in content["vehicles"].items():
        place = [vehicle["location"][i] + vehicle["center"][i] for i in range(3)]
        full = [2.0 * half for half in vehicle["extent"]]
        result[number] = source.move(source.carla_to_world([*place, *vehicle["angle"]]), source.corners(*full))
    return result


@pytest.fixture(scope="module")
def out(exported) -> Path:
    return exported("opv2v", {"rate": "50"})


@pytest.fixture(scope="module")
def folder(out: Path) -> Path:
    (result,) = (out / "train").iterdir()
    return result


@pytest.fixture(scope="module")
def names(folder: Path) -> dict[str, str]:
    """Agent of the dataset -> its folder, by the protocol."""
    protocol = yaml.safe_load((folder / "data_protocol.yaml").read_text())
    return {entry["agent"]: name for name, entry in protocol["mmw"]["agents"].items()}


@pytest.fixture(scope="module")
def contents(folder: Path, names: dict[str, str]) -> dict[tuple[str, int], dict]:
    """YAML of every agent and frame."""
    return {
        (agent, frame): yaml.safe_load((folder / name / f"{frame:06d}.yaml").read_text())
        for agent, name in names.items()
        for frame in source.IMAGE_FRAMES
    }


@pytest.mark.parametrize("seed", range(3))
def test_frame_algebra(seed: int) -> None:
    """F R F of any pose is CARLA's matrix of its angles, and the inverse is exact."""
    rng = np.random.default_rng(seed)
    turns = rng.uniform([-np.pi, -1.5, -np.pi], [np.pi, 1.5, np.pi], (50, 3))
    poses = pose_from_ypr(rng.normal(0, 50, (50, 3)), *turns.T)
    given = carla_pose(poses)
    for pose, values in zip(poses, given, strict=True):
        np.testing.assert_allclose(source.carla_to_world(values), carla_matrix(pose), atol=1e-12)
    back = pose_from_carla(given)
    np.testing.assert_allclose(back[:, :3], poses[:, :3], atol=1e-12)
    assert angle_between(back[:, 3:], poses[:, 3:]).max() < 1e-7


def test_folders_follow_the_rules_of_the_loader(out: Path, folder: Path, names: dict[str, str]) -> None:
    assert sorted(path.name for path in out.iterdir()) == ["LICENSE", "NOTICE", "_done", "_export.json", "train"]
    agents = sorted(path.name for path in folder.iterdir() if path.is_dir())
    assert set(agents) == set(names.values()) and len(agents) == 4
    order = agents[1:] + agents[:1] if int(agents[0]) < 0 else agents
    assert sum(int(name) < 0 for name in agents) == 1 and int(order[0]) >= 0
    assert order[0] == names["cav_1"], "the ego is the first connected vehicle"
    stamps = [
        sorted(path.stem for path in (folder / name).glob("*.yaml") if "additional" not in path.name) for name in agents
    ]
    assert stamps == [[f"{frame:06d}" for frame in source.IMAGE_FRAMES]] * 4
    for name in agents:
        assert sorted(path.stem for path in (folder / name).glob("*.pcd")) == stamps[0]
    objects = {agent["agent"]: str(agent["object_id"]) for agent in source.rows("poses", frame=0)}
    assert {agent: name for agent, name in names.items() if name != "-1"} == {
        agent: number for agent, number in objects.items() if agent != "rsu_1"
    }


def test_fields_are_those_of_the_loader(contents: dict) -> None:
    for (agent, _), content in contents.items():
        for key in ("lidar_pose", "true_ego_pos", "predicted_ego_pos"):
            assert len(content[key]) == 6 and all(isinstance(value, float) for value in content[key])
        assert content["plan_trajectory"] == [] and isinstance(content["vehicles"], dict)
        count = 1 if agent == "rsu_1" else 2
        assert [key for key in content if key.startswith("camera")] == [f"camera{i}" for i in range(count)]
        for number, vehicle in content["vehicles"].items():
            assert isinstance(number, int) and set(vehicle) >= {"angle", "center", "extent", "location", "speed"}
            assert vehicle["center"][:2] == [0.0, 0.0] and vehicle["center"][2] == vehicle["extent"][2] > 0.3


def test_poses_are_mirrored(contents: dict) -> None:
    for (agent, frame), content in contents.items():
        expected = source.FLIP @ source.sensor_matrix(frame, agent, "lidar") @ source.FLIP
        np.testing.assert_allclose(source.carla_to_world(content["lidar_pose"]), expected, atol=2e-6)
        pose = source.row("poses", frame=frame, agent=agent)
        assert content["true_ego_pos"][:2] == pytest.approx([pose["x"], -pose["y"]], abs=1e-6)
        assert content["ego_speed"] == pytest.approx(3.6 * source.speed(pose), abs=1e-5)


def test_vehicles_are_those_that_the_lidar_hits_and_their_boxes_are_the_datasets(contents: dict) -> None:
    total = 0
    for (agent, frame), content in contents.items():
        sweep = source.row("lidar", frame=frame, agent=agent)
        own = source.row("poses", frame=frame, agent=agent)["object_id"]
        boxes = {box["object_id"]: box for box in source.rows("boxes", frame=frame)}
        cars = {number for number, box in boxes.items() if box["category"] != "pedestrian" and number != own}
        assert set(content["vehicles"]) == set(sweep["object_id"]) & cars
        for number, found in loader_boxes(content).items():
            box = boxes[number]
            expected = source.box_corners(box)
            # The mirror image has left and right corners swapped.
            np.testing.assert_allclose(np.sort(found, axis=0), np.sort(expected * [1, -1, 1], axis=0), atol=1e-5)
            assert content["vehicles"][number]["lidar_points"] == sweep["object_id"].count(number)
            total += 1
    assert total > 50


def test_points_lie_in_the_boxes_of_their_vehicles(folder: Path, names: dict[str, str], contents: dict) -> None:
    inside = 0
    for (agent, frame), content in contents.items():
        points = read_pcd(folder / names[agent] / f"{frame:06d}.pcd")
        sweep = source.row("lidar", frame=frame, agent=agent)
        xyz = np.stack([points[axis] for axis in "xyz"], axis=-1)
        np.testing.assert_array_equal(xyz, source.cloud(sweep) * [1, -1, 1])
        red = points["rgb"] >> 16
        assert (points["rgb"] == red << 16).all() and red.max() <= 255
        assert np.abs(red / 255.0 - sweep["intensity"]).max() <= 1.0 / 510.0 + 1e-6
        owner = np.array(sweep["object_id"])
        for number, vehicle in content["vehicles"].items():
            place = np.add(vehicle["location"], vehicle["center"])
            to_box = np.linalg.inv(source.carla_to_world([*place, *vehicle["angle"]])) @ source.carla_to_world(
                content["lidar_pose"]
            )
            beyond = np.abs(source.move(to_box, xyz[owner == number])) - vehicle["extent"]
            assert beyond.max() < MIRROR_M
            inside += len(beyond)
    assert inside > 1000


def test_cameras_project_the_boxes_to_where_the_dataset_frames_them(folder: Path, contents: dict) -> None:
    """LiDAR -> camera by `extrinsic` in CARLA's axes, then (y, -z, x) and K: the rectangles of `boxes_2d`."""
    protocol = yaml.safe_load((folder / "data_protocol.yaml").read_text())["mmw"]["agents"]
    checked = 0
    for (agent, frame), content in contents.items():
        to_lidar = np.linalg.inv(source.carla_to_world(content["lidar_pose"]))
        entry = next(value for value in protocol.values() if value["agent"] == agent)
        for camera, about in entry["cameras"].items():
            extrinsic = np.array(content[camera]["extrinsic"])
            by_pose = np.linalg.inv(source.carla_to_world(content[camera]["cords"])) @ np.linalg.inv(to_lidar)
            np.testing.assert_allclose(extrinsic, by_pose, atol=1e-5)
            shown = source.rows("boxes_2d", frame=frame, agent=agent, sensor=about["sensor"])
            framed = {box["object_id"]: box for box in shown}
            for number, world in loader_boxes(content).items():
                local = source.move(extrinsic @ to_lidar, world)
                optical = np.stack([local[:, 1], -local[:, 2], local[:, 0]], axis=-1)
                found = source.rectangle(optical, np.array(content[camera]["intrinsic"]))
                # Of a box that the image cuts, the dataset frames the part inside alone.
                if local[:, 0].min() < 0.1 or found.min() < 0 or (found[2:] > source.SIZE).any():
                    continue
                np.testing.assert_allclose(found, source.framed_rectangle(framed[number]), atol=0.05)
                checked += 1
    assert checked > 10


def test_images_are_the_pixels_of_the_stored_files(folder: Path, names: dict[str, str]) -> None:
    for sensor, index in (("front", 0), ("left", 1)):
        for frame in source.IMAGE_FRAMES:
            stored = source.row("rgb", frame=frame, agent="cav_2", sensor=sensor)["image"]["bytes"]
            source.assert_png_of(folder / names["cav_2"] / f"{frame:06d}_camera{index}.png", stored)


def test_predicted_pose_is_the_gnss_fix(contents: dict) -> None:
    """The GNSS sensor's place on the predicted pose is the measured latitude and longitude."""
    for (agent, frame), content in contents.items():
        if agent == "rsu_1":
            assert content["predicted_ego_pos"] == content["true_ego_pos"]
            continue
        fix = source.row("gnss", frame=frame, agent=agent)
        turn = source.carla_to_world(content["predicted_ego_pos"])
        place = (turn @ [0.5, -0.2, 1.5, 1.0])[:3] * [1, -1, 1]  # the mount of tests/fixtures/export_data.py
        expected = [fix["latitude_deg"], fix["longitude_deg"], fix["altitude_m"]]
        np.testing.assert_allclose(mercator_from_world(place, [49.0, 8.0, 0.0]), expected, atol=2e-6)
        heading = np.degrees(fix["heading"]) - 90.0 + 10.0  # clockwise from x, of a sensor turned 10 deg to the left
        off = (content["predicted_ego_pos"][4] - heading + 180.0) % 360.0 - 180.0
        assert abs(off) < 1e-3


def test_rate_and_images_are_options(tmp_path: Path) -> None:
    export(source.dataset().root, "opv2v", tmp_path / "a", Selection(agents=("cav_1",)), {"images": "source"})
    (agent,) = (tmp_path / "a" / "train").glob("*_rainy/*/")
    assert sorted(path.name for path in agent.iterdir()) == [
        "000000.pcd", "000000.yaml", "000000_camera0.jpeg", "000000_camera1.png",
    ]  # fmt: skip
    export(
        source.dataset().root, "opv2v", tmp_path / "b", Selection(agents=("cav_1",), frames=range(1, 4)),
        {"images": "none", "rate": "100", "split": "test", "vehicles": "all"},
    )  # fmt: skip
    (agent,) = (tmp_path / "b" / "test").glob("*_rainy/*/")
    assert sorted(path.stem for path in agent.glob("*.yaml")) == ["000001", "000002", "000003"]
    assert not list(agent.glob("*.png"))
    vehicles = yaml.safe_load((agent / "000001.yaml").read_text())["vehicles"]
    assert len(vehicles) == 19 and len(source.FRAMES) > 3


def test_errors(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="no connected vehicle is picked"):
        export(source.dataset().root, "opv2v", tmp_path / "a", Selection(agents=("rsu_1",)))
    with pytest.raises(ValueError, match="lidar=roof: agent cav_1 has lidar of type lidar; exactly one"):
        export(source.dataset().root, "opv2v", tmp_path / "a", Selection(), {"lidar": "roof"})
    assert not (tmp_path / "a").exists()
