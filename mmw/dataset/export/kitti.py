"""KITTI's object detection benchmark: point clouds, images, calibrations and labels by one running number.

    OUT/training/velodyne/000000.bin    float32 x, y, z, intensity; x forward, y left, z up
    OUT/training/image_2/000000.png     image of the camera
    OUT/training/calib/000000.txt       P0 ... P3 (all the same camera), R0_rect = 1, Tr_velo_to_cam, Tr_imu_to_velo
    OUT/training/label_2/000000.txt     one line a vehicle or person that the camera frames
    OUT/ImageSets/trainval.txt          the numbers
    OUT/mmw_index.csv                   number -> scenario, weather, agent, frame

Camera frames are optical: x right, y down, z forward. Tr_imu_to_velo transforms points of the agent's frame to the
LiDAR's, as KITTI's transforms those of its GPS/IMU. A label's place is the center of the dataset's box moved half a
height along the camera's y, so that readers, which move it back, get the center exactly.

Objects that show in the image (`boxes_2d`) have a label; where there is no image, those that returned LiDAR pulses.
`truncated` is the share of the rectangle around the box outside the image; `occluded` compares the rectangle of the
visible pixels with the one that the image frames: 0 from FULLY of its area, 1 from PARTLY, 2 below, 3 unknown.

Losses: see `LOSSES`.

Source: A. Geiger, P. Lenz, R. Urtasun, "Are we ready for autonomous driving? The KITTI vision benchmark suite", CVPR
2012, and the development kit's readme.
"""

import csv
import io
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from mmw.core.errors import InputError
from mmw.core.transforms import compose, invert, pose_to_matrix, transform_points
from mmw.dataset import Dataset
from mmw.dataset.export.exporter import Format, Option, Options, Selection, Task, frame_steps, parts, require
from mmw.dataset.export.pinhole import OPTICAL_POSE, area, box_rectangle, clipped
from mmw.dataset.export.read_sensors import (
    Block,
    Row,
    Sensor,
    box_corners,
    box_pose,
    pick_sensor,
    pose_of,
    sensor_to_world,
    sensors_of,
)
from mmw.dataset.export.write_files import png_of

LOSSES = (
    "no radio, radar, depth, IMU, GNSS, segmentation, normals and flow",
    "one LiDAR and one camera an agent; agents and frames are separate: no ego pose, no time, no track",
    "ring, object, label, time and number of a LiDAR return are dropped",
    "boxes turn about the camera's y axis alone: pitch and roll against the camera are dropped",
    "velocities and object numbers are dropped; classes are KITTI's: buses and motorcycles become Misc",
    "only what the camera frames has a label; VRUs, drones and base stations without LiDAR and camera are left out",
    "PNG copies of JPEG images are no sharper than those",
)
"""Losses of the format."""

OPTIONS = (
    Option("rate", "10", "frames a second [Hz]; a divisor of 100"),
    Option("camera", "front", "RGB camera that becomes image_2"),
    Option("images", "png", "png: frames with an image alone; none: every frame, without image", ("png", "none")),
    Option("lidar", "", "LiDAR, where an agent has several"),
)

CLASSES = {
    "car": "Car", "truck": "Truck", "pedestrian": "Pedestrian", "bicycle": "Cyclist", "rider": "Cyclist",
    "train": "Tram",
}  # fmt: skip
"""Category of a box -> KITTI's type; others are Misc."""

FULLY, PARTLY = 0.8, 0.4
"""Shares of the framed rectangle from which a box counts as fully and as partly visible; design values."""

MAX_FRAMES = 1_000_000
"""Frames that six digits can number."""

Item = tuple[int, str, str, str, int]
"""Number, scenario, weather, agent, frame."""


def plan(dataset: Dataset, selection: Selection, options: Options) -> list[Task]:
    """Return one task a scenario, weather, agent and second, and one for the index.

    Raises:
        InputError: If a table, a LiDAR, the camera or every image is missing, the lens distorts, or there are too many
            frames.
    """
    require(dataset, "kitti", "lidar", "boxes", "sensors")
    has_images = options["images"] == "png"
    if has_images:
        require(dataset, "kitti", "rgb", hint="record RGB cameras, or give images=none")
    if not has_images or "boxes_2d" not in dataset.tables:
        require(dataset, "kitti", "box_visibility", hint="record it, or record cameras with boxes_2d: true")
    tasks: list[Task] = []
    index: list[Item] = []
    for part in parts(dataset, selection, frame_steps(dataset, "kitti", "rate", options), carrying=("lidar", "rgb")):
        sensors = sensors_of(dataset, part.scenario)
        for agent in part.agents:
            lidar = pick_sensor(sensors[agent], agent, "lidar", options["lidar"], "kitti: lidar=")
            camera = pick_sensor(sensors[agent], agent, "rgb", options["camera"], "kitti: camera=")
            if camera.lens != "pinhole":
                raise InputError(
                    f"kitti: camera={camera.name}: agent {agent} has the lens {camera.lens}; calib holds a pinhole "
                    "only; name another camera"
                )
            block = Block(dataset, part.scenario, part.weather, part.frames, agent)
            if has_images:
                block = replace(block, frames=sorted(block.recorded("rgb").get(camera.name, ())))
            for some in block.split():
                first, frames = len(index), some.frames
                index += [(first + i, part.scenario, part.weather, agent, frame) for i, frame in enumerate(frames)]
                name = f"{part.scenario}_{part.weather}_{agent}_{frames[0]:06d}"
                tasks.append(Task(name, partial(_write, some, first, lidar, camera, has_images)))
    if not index:
        raise InputError(f"{dataset.root}: no frame that is picked has an image; pick other frames, or images=none")
    if len(index) > MAX_FRAMES:
        raise InputError(f"kitti: {len(index):,} frames are more than six digits can number; pick fewer")
    return [*tasks, Task("index", partial(_write_index, index))]


def _write_index(index: Sequence[Item], out: Path) -> None:
    (out / "ImageSets").mkdir()
    (out / "ImageSets" / "trainval.txt").write_text("".join(f"{item[0]:06d}\n" for item in index))
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(("number", "scenario", "weather", "agent", "frame"))
    writer.writerows((f"{number:06d}", *rest) for number, *rest in index)
    (out / "mmw_index.csv").write_text(stream.getvalue())


def _write(block: Block, first: int, lidar: Sensor, camera: Sensor, has_images: bool, out: Path) -> None:
    """Write the files of one agent in some frames, numbered from `first`."""
    folders = {name: out / "training" / name for name in ("velodyne", "calib", "label_2", "image_2")}
    for name, folder in folders.items():
        if has_images or name != "image_2":
            folder.mkdir(parents=True)
    poses = {row["frame"]: row for row in block.rows("poses")}
    boxes = block.boxes()
    visible = _visible_rectangles(block, lidar, camera, has_images)
    number = {frame: f"{first + i:06d}" for i, frame in enumerate(block.frames)}
    calibration = calib_text(lidar, camera)
    for frame in block.frames:
        (folders["calib"] / f"{number[frame]}.txt").write_text(calibration)
        own = poses[frame]["object_id"]
        to_camera = invert(compose(sensor_to_world(pose_of(poses[frame]), camera), OPTICAL_POSE))
        lines = [
            label_line(box, to_camera, camera, visible[frame, box["object_id"]])
            for box in boxes.get(frame, [])
            if box["object_id"] != own and (frame, box["object_id"]) in visible
        ]
        text = "".join(f"{line}\n" for line in lines if line)
        (folders["label_2"] / f"{number[frame]}.txt").write_text(text)
    for frame, cloud in block.sweep_of_each(lidar).items():
        points = np.stack([cloud[name] for name in ("x", "y", "z", "intensity")], axis=-1)
        (folders["velodyne"] / f"{number[frame]}.bin").write_bytes(points.astype("<f4").tobytes())
    for row in block.rows("rgb", ["sensor", "image", "format"]) if has_images else ():
        if row["sensor"] == camera.name:
            data = row["image"]["bytes"]
            png = data if row["format"] == "png" else png_of(data)
            (folders["image_2"] / f"{number[row['frame']]}.png").write_bytes(png)


def _visible_rectangles(
    block: Block, lidar: Sensor, camera: Sensor, has_images: bool
) -> dict[tuple[int, int], np.ndarray | None]:
    """Return the rectangle [px] of the visible pixels of each (frame, object) that gets a label.

    Where there are no images, or no `boxes_2d` of the camera, LiDAR returns decide, and the rectangle is None.
    """
    edges = ("u_min", "v_min", "u_max", "v_max")
    if has_images:
        rows = block.rows("boxes_2d", ["sensor", "object_id", "pixels", *edges])
        rows = [row for row in rows if row["sensor"] == camera.name]
        if rows:
            return {
                # The last pixel that shows the object ends one further.
                (row["frame"], row["object_id"]): np.add([row[name] for name in edges], (0.0, 0.0, 1.0, 1.0))
                for row in rows
                if row["pixels"]
            }
    rows = block.rows("box_visibility", ["sensor", "object_id", "lidar_points"])
    return {
        (row["frame"], row["object_id"]): None for row in rows if row["sensor"] == lidar.name and row["lidar_points"]
    }


def calib_text(lidar: Sensor, camera: Sensor) -> str:
    """Return a calibration file."""
    assert camera.intrinsic is not None
    projection = np.column_stack([camera.intrinsic, np.zeros(3)])
    optical = compose(camera.mount, OPTICAL_POSE)
    lines = {f"P{index}": projection for index in range(4)}
    lines["R0_rect"] = np.eye(3)
    lines["Tr_velo_to_cam"] = pose_to_matrix(compose(invert(optical), lidar.mount))[:3]
    lines["Tr_imu_to_velo"] = pose_to_matrix(invert(lidar.mount))[:3]
    return "".join(
        f"{name}: {' '.join(f'{value + 0.0:.12e}' for value in matrix.ravel())}\n" for name, matrix in lines.items()
    )


def label_line(box: Row, to_camera: np.ndarray, camera: Sensor, visible: np.ndarray | None) -> str:
    """Return the label of a row of `boxes`, empty if it is not in the image.

    Args:
        box: The box.
        to_camera: Pose [7], world to the camera's optical frame.
        camera: The camera.
        visible: left, top, right, bottom of its visible pixels [px], shape [4]; None if not known.
    """
    assert camera.intrinsic is not None
    pose = compose(to_camera, box_pose(box))
    whole = box_rectangle(transform_points(pose, box_corners(box)), camera.intrinsic)
    if whole is None:
        return ""
    framed = clipped(whole, camera.size)
    if area(framed) == 0.0:
        return ""
    truncated = 1.0 - area(framed) / area(whole)
    share = np.nan if visible is None else area(visible) / area(framed)
    occluded = 3 if np.isnan(share) else 0 if share >= FULLY else 1 if share >= PARTLY else 2
    x, y, z = np.add(pose[:3], (0.0, box["height"] / 2.0, 0.0))
    forward = pose_to_matrix(pose)[:3, 0]
    turn = np.arctan2(-forward[2], forward[0])
    alpha = _wrapped(turn - np.arctan2(x, z))
    values = [alpha, *framed, box["height"], box["width"], box["length"], x, y, z, turn]
    kind = CLASSES.get(box["category"], "Misc")
    return f"{kind} {truncated:.2f} {occluded} {' '.join(f'{value:.4f}' for value in values)}"


def _wrapped(angle: float) -> float:
    """Return an angle between -pi and pi [rad]."""
    return float((angle + np.pi) % (2.0 * np.pi) - np.pi)


FORMAT = Format("kitti", "KITTI object detection: velodyne, image_2, calib, label_2", LOSSES, plan, options=OPTIONS)
