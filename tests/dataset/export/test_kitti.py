"""KITTI: calibrations, points and labels, read by the rules of its development kit, against the dataset's own."""

import csv
from pathlib import Path

import numpy as np
import pytest

from tests.fixtures import export_data as source

OPTICAL = np.array([[0.0, -1, 0, 0], [0, 0, -1, 0], [1, 0, 0, 0], [0, 0, 0, 1]])
"""A sensor's axes (x forward, y left, z up) to optical ones (x right, y down, z forward)."""


def read_calib(path: Path) -> dict[str, np.ndarray]:
    """Return the matrices of a calibration file; those of three rows and four columns get their last row."""
    result = {}
    for line in path.read_text().splitlines():
        name, numbers = line.split(":")
        values = np.array([float(number) for number in numbers.split()])
        result[name] = values.reshape(3, -1)
    assert set(result) == {"P0", "P1", "P2", "P3", "R0_rect", "Tr_velo_to_cam", "Tr_imu_to_velo"}
    return {name: np.vstack([m, [0, 0, 0, 1]]) if m.shape == (3, 4) else m for name, m in result.items()}


def read_labels(path: Path) -> list[dict]:
    """Return the labels of a file."""
    result = []
    for line in path.read_text().splitlines():
        kind, *numbers = line.split()
        values = [float(number) for number in numbers]
        assert len(values) == 14
        result.append(
            {"kind": kind, "truncated": values[0], "occluded": int(numbers[1]), "alpha": values[2],
             "bbox": values[3:7], "hwl": values[7:10], "place": np.array(values[10:13]), "turn": values[13]}
        )  # fmt: skip
    return result


def label_corners(label: dict) -> np.ndarray:
    """Return the corners of a label in the camera's frame [m], shape [8, 3], as the development kit makes them: length
    along x, height up from the place, width along z, turned about y."""
    h, w, length = label["hwl"]
    local = np.array([[x, y, z] for x in (-length / 2, length / 2) for z in (w / 2, -w / 2) for y in (0.0, -h)])
    c, s = np.cos(label["turn"]), np.sin(label["turn"])
    return local @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]).T + label["place"]


@pytest.fixture(scope="module")
def out(exported) -> Path:
    """Frames with an image of the front camera, of every agent."""
    return exported("kitti", {"rate": "100"})


@pytest.fixture(scope="module")
def left(exported) -> Path:
    """Export the level camera to the left, in every frame, without images."""
    return exported("kitti", {"rate": "100", "camera": "left", "images": "none"}, agents=("cav_1", "cav_2", "cav_3"))


def index_of(out: Path) -> list[dict]:
    with (out / "mmw_index.csv").open() as file:
        found = list(csv.DictReader(file))
    return [{**entry, "frame": int(entry["frame"])} for entry in found]


def test_every_number_has_its_files(out: Path, left: Path) -> None:
    endings = {"velodyne": "bin", "calib": "txt", "label_2": "txt", "image_2": "png"}
    for root, count, folders in ((out, 4 * 3, endings), (left, 3 * 6, [*endings][:3])):
        numbers = [f"{number:06d}" for number in range(count)]
        assert (root / "ImageSets" / "trainval.txt").read_text().split() == numbers
        assert [entry["number"] for entry in index_of(root)] == numbers
        assert {path.name for path in (root / "training").iterdir()} == set(folders)
        for name in folders:
            files = sorted(path.name for path in (root / "training" / name).iterdir())
            assert files == [f"{number}.{endings[name]}" for number in numbers]
    assert {(entry["agent"], entry["frame"]) for entry in index_of(out)} == {
        (agent, frame) for agent in ("cav_1", "cav_2", "cav_3", "rsu_1") for frame in source.IMAGE_FRAMES
    }


def test_points_and_images_are_the_datasets(out: Path) -> None:
    for entry in index_of(out):
        key = {name: entry[name] for name in ("weather", "agent", "frame")}
        sweep = source.row("lidar", **key)
        points = np.fromfile(out / "training" / "velodyne" / f"{entry['number']}.bin", "<f4").reshape(-1, 4)
        np.testing.assert_array_equal(
            points, np.column_stack([source.cloud(sweep), sweep["intensity"]]).astype(np.float32)
        )
        stored = source.row("rgb", sensor="front", **key)["image"]["bytes"]
        source.assert_png_of(out / "training" / "image_2" / f"{entry['number']}.png", stored)


@pytest.mark.parametrize("which", ["out", "left"])
def test_calibration_transforms_points_to_the_camera(which: str, request: pytest.FixtureRequest) -> None:
    root, camera = request.getfixturevalue(which), "front" if which == "out" else "left"
    for entry in index_of(root)[::3]:
        calib = read_calib(root / "training" / "calib" / f"{entry['number']}.txt")
        place = (entry["frame"], entry["agent"])
        expected = OPTICAL @ np.linalg.inv(source.sensor_matrix(*place, camera)) @ source.sensor_matrix(*place, "lidar")
        np.testing.assert_allclose(calib["Tr_velo_to_cam"], expected, atol=1e-9)
        mounted = source.row("sensors", agent=entry["agent"], sensor=camera)
        np.testing.assert_array_equal(calib["R0_rect"], np.eye(3))
        np.testing.assert_allclose(
            calib["P2"][:3], [[mounted["fx"], 0, 80, 0], [0, mounted["fy"], 60, 0], [0, 0, 1, 0]], atol=1e-8
        )
        agent_in_lidar = calib["Tr_imu_to_velo"] @ [0.0, 0.0, 0.0, 1.0]
        pose = source.row("poses", frame=entry["frame"], agent=entry["agent"])
        back = source.sensor_matrix(*place, "lidar") @ agent_in_lidar
        np.testing.assert_allclose(back[:3], [pose[axis] for axis in "xyz"], atol=1e-9)


def matched(root: Path, camera: str) -> list[tuple[dict, dict, dict, np.ndarray]]:
    """Return index entry, label, box and transform box to camera of every label: the box whose middle is nearest."""
    result = []
    for entry in index_of(root):
        to_camera = OPTICAL @ np.linalg.inv(source.sensor_matrix(entry["frame"], entry["agent"], camera))
        boxes = source.rows("boxes", frame=entry["frame"])
        poses = [to_camera @ source.box_matrix(box) for box in boxes]
        for label in read_labels(root / "training" / "label_2" / f"{entry['number']}.txt"):
            middle = label["place"] - [0, label["hwl"][0] / 2, 0]
            off = [np.linalg.norm(pose[:3, 3] - middle) for pose in poses]
            best = int(np.argmin(off))
            assert off[best] < 1e-3
            result.append((entry, label, boxes[best], poses[best]))
    return result


def test_labels_are_the_boxes_that_the_image_shows(out: Path) -> None:
    found = matched(out, "front")
    labelled = {(entry["agent"], entry["frame"], box["object_id"]) for entry, _, box, _ in found}
    shown = {
        (box["agent"], box["frame"], box["object_id"])
        for box in source.rows("boxes_2d", sensor="front")
        if box["pixels"]
    }
    assert labelled == shown - source.own_objects() and len(labelled) > 20
    kinds = {"car": "Car", "truck": "Truck", "pedestrian": "Pedestrian"}
    for entry, label, box, pose in found:
        assert label["kind"] == kinds[box["category"]]
        assert label["hwl"] == pytest.approx([box["height"], box["width"], box["length"]], abs=1e-4)
        heading = pose[:3, 0]
        assert np.cos(label["turn"]) * heading[2] == pytest.approx(-np.sin(label["turn"]) * heading[0], abs=1e-3)
        assert np.cos(label["turn"]) * heading[0] - np.sin(label["turn"]) * heading[2] > 0.9
        ray = np.arctan2(label["place"][0], label["place"][2])
        assert np.cos(label["alpha"] + ray - label["turn"]) == pytest.approx(1.0, abs=1e-6)
        framed = source.row(
            "boxes_2d", sensor="front", agent=entry["agent"], frame=entry["frame"],
            object_id=box["object_id"],
        )  # fmt: skip
        assert abs(label["truncated"] - framed["truncation"]) < 0.2
        if framed["truncation"] == 0.0:
            edges = source.framed_rectangle(framed)
            np.testing.assert_allclose(label["bbox"], edges, atol=0.01)
            assert label["truncated"] == 0.0
            share = source.seen_area(framed) / ((edges[2] - edges[0]) * (edges[3] - edges[1]))
            assert label["occluded"] == (0 if share >= 0.8 else 1 if share >= 0.4 else 2)


def test_boxes_of_a_level_camera_hold_the_points_of_their_objects(left: Path) -> None:
    """The label's corners, the dataset's and the LiDAR's points agree in the camera's frame."""
    inside = 0
    for entry, label, box, pose in matched(left, "left"):
        assert label["occluded"] == 3
        own = source.corners(box["length"], box["width"], box["height"])
        np.testing.assert_allclose(
            np.sort(label_corners(label), axis=0), np.sort(source.move(pose, own), axis=0), atol=0.05
        )  # vehicles on this road pitch and roll by less than half a degree
        calib = read_calib(left / "training" / "calib" / f"{entry['number']}.txt")
        points = np.fromfile(left / "training" / "velodyne" / f"{entry['number']}.bin", "<f4").reshape(-1, 4)[:, :3]
        sweep = source.row("lidar", agent=entry["agent"], frame=entry["frame"])
        points = points[np.array(sweep["object_id"]) == box["object_id"]]
        local = source.move(calib["Tr_velo_to_cam"], points) - label["place"]
        c, s = np.cos(label["turn"]), np.sin(label["turn"])
        local = local @ np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]])
        h, w, length = label["hwl"]
        beyond = np.abs(local - [0, -h / 2, 0]) - [length / 2, h / 2, w / 2]
        assert len(points) and beyond.max() < 0.3
        inside += len(points)
    assert inside > 200


@pytest.mark.parametrize(
    ("options", "frames", "words"),
    [
        ({"camera": "back"}, None, "camera=back: agent cav_1 has front, left of type rgb"),
        ({"rate": "100"}, range(1, 2), "no frame that is picked has an image"),
        ({"rate": "30"}, None, "rate=30: a rate that divides 100 Hz is needed"),
    ],
)
def test_errors(exported, options: dict, frames: range | None, words: str) -> None:
    with pytest.raises(ValueError, match=words):
        exported("kitti", options, frames=frames)
