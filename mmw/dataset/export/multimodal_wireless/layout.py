"""The layout of the published Multimodal-Wireless dataset (version 1), for code that was written for it.

    OUT/{weather}/{Town}/{Town}_{scenario}_seed{seed}/
        cav_1/000000.yaml .pcd _camera0.png ... _camera3.png    cameras: 0 front, 1 rear, 2 left, 3 right
        rsu_1/000000.yaml .pcd _camera0.png _depth_camera0.png .json (radar)
        scenes/000000.yaml                                      every vehicle
        Nt_64_Nr_16_fc_28GHz/cav_1/000000_paths.npz             from rsu_1; see
        `mmw.dataset.export.multimodal_wireless.path_files`
        Nt_64_Nr_16_fc_28GHz/cav_1/cav_2/000000_paths.npz       V2V, cav_1 transmits

Frames are numbered as in the dataset. Coordinates are CARLA's: left-handed, y to the right, degrees. Point clouds are
in the LiDAR's frame, intensity in the red channel. Points of radar JSON are CARLA's: azimuth to the right, altitude
upwards, velocity positive while receding. `vehicles` of a CAV lists those within 50 m, without itself; `location`
is the center of the box's floor and `center` the offset from there to the box's center, along the world's axes.

Losses: those of `FORMAT` below.

Source: Multimodal-Wireless, `CARLA_sensor_storage/data_utils/sim_utils.py` and `carla_main.py`; its publication.
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from mmw.core.file_names import check_file_name
from mmw.core.transforms import quaternion_to_ypr, transform_points
from mmw.dataset import Dataset
from mmw.dataset.export.carla_frames import carla_point, carla_pose
from mmw.dataset.export.exporter import VEHICLE_ROLES, Format, Option, Options, Part, Selection, Task, parts, require
from mmw.dataset.export.multimodal_wireless.path_files import array_pairs, write_channels
from mmw.dataset.export.pcd import intensity_pcd
from mmw.dataset.export.read_sensors import (
    Block,
    Row,
    Sensor,
    box_pose,
    gnss_position,
    pick_sensor,
    pose_of,
    sensor_to_world,
    sensors_of,
)
from mmw.dataset.export.write_files import png_of, write_yaml
from mmw.storage.codecs.carla_depth import encode_bgra, encode_log_grey
from mmw.storage.codecs.images import decode_metres

CAMERA_YAW = (0.0, np.pi, np.pi / 2, -np.pi / 2)
"""Yaw of the published cameras 0 to 3 of a CAV [rad]: front, rear, left, right."""
PERCEPTION_M = 50.0
"""Largest distance of an entry of `vehicles` from its CAV [m]."""
NO_COLOR = "255,255,255"
"""Value of the published script for a vehicle without a color."""
NO_IMU = {"accelerometer": dict.fromkeys("xyz", 0.0), "gyroscope": dict.fromkeys("xyz", 0.0), "compass": 0.0}


def tasks(dataset: Dataset, selection: Selection, options: Options) -> list[Task]:
    """Return tasks of 1 s of one scenario in one weather: one for sensors, and one for channels if there are links.

    Raises:
        InputError: If the dataset lacks a table, or an option cannot be used.
    """
    require(dataset, "v1", "poses", "boxes", "sensors")
    array_pairs(options)
    planned = []
    for part in parts(dataset, selection, roles=VEHICLE_ROLES):
        folder = scenario_folder(dataset, part)
        for block in Block(dataset, part.scenario, part.weather, part.frames).split():
            some = Part(part.scenario, part.weather, tuple(block.frames), part.agents)
            name = f"{part.scenario}.{part.weather}.{some.frames[0]:06d}"
            planned.append(Task(f"{name}.sensors", partial(write_sensors, block, part.agents, folder, dict(options))))
            if "links" in dataset.tables and "paths" in dataset.views:
                planned.append(Task(f"{name}.channels", partial(write_channels, dataset, some, folder, dict(options))))
    return planned


def scenario_folder(dataset: Dataset, part: Part) -> str:
    """Return the folder of a scenario: `sunny/Town03/Town03_roundabout_seed42` for `town03_roundabout`.

    Raises:
        InputError: If the name of the town cannot be that of a folder.
    """
    config = dataset.info["config"]
    found = next(entry for entry in config["scenarios"] if entry["name"] == part.scenario)
    town = Path(found["town"] or "stage").stem.capitalize()  # a town may be a file of the user's
    check_file_name(town, "town", dataset.root)
    rest = part.scenario[len(town) :].lstrip("_") if part.scenario.lower().startswith(town.lower()) else part.scenario
    return f"{part.weather}/{town}/{'_'.join(filter(None, (town, rest)))}_seed{int(config['seed'])}"


def write_sensors(block: Block, agents: Sequence[str], folder: str, options: Options, out: Path) -> None:
    """Write everything but the channels of a block of frames."""
    root = out / folder
    sensors = sensors_of(block.dataset, block.scenario)
    poses, imu, gnss = (
        {(row["frame"], row["agent"]): row for row in block.rows(table)} for table in ("poses", "imu", "gnss")
    )
    boxes = block.vehicles()
    (root / "scenes").mkdir(parents=True)
    for frame in block.frames:
        write_yaml(
            root / "scenes" / f"{frame:06d}.yaml", {"frame": frame, "vehicles": _scene(boxes.get(frame, []), True)}
        )
    for agent in agents:
        (root / agent).mkdir()
        own = sensors[agent]
        cameras = camera_numbers(own)
        depths = {sensor.name: k for k, sensor in enumerate(s for s in own.values() if s.type == "depth")}
        units = [(frame, row) for (frame, name), row in poses.items() if name == agent]
        for frame, row in units:
            seen = boxes.get(frame, [])
            head = {"actor": agent, "frame": frame}
            if row["role"] == "cav":
                extra = {"imu": imu.get((frame, agent)), "gnss": gnss.get((frame, agent))}
                content = head | _cav(row, own, cameras, options, **extra)
                rsus = [pose for (at, _), pose in poses.items() if at == frame and pose["role"] == "rsu"]
                content["vehicles"] = _near(row, seen, rsus)
            else:
                content = head | _rsu(row, own, cameras, depths, options) | {"vehicles": _scene(seen, False)}
            write_yaml(root / agent / f"{frame:06d}.yaml", content)
        is_rsu = bool(units) and units[0][1]["role"] == "rsu"
        own_rows = replace(block, agent=agent)
        _write_files(own_rows, own, cameras, depths if is_rsu else {}, is_rsu, options, root / agent)


def camera_numbers(own: dict[str, Sensor]) -> dict[str, int]:
    """Return the published number of each camera of an agent: by where it looks, then by name."""
    found = sorted((sensor for sensor in own.values() if sensor.type == "rgb"), key=lambda sensor: sensor.name)
    free = list(range(max(len(found), len(CAMERA_YAW))))
    numbers = {}
    if len(found) == 1:
        return {found[0].name: 0}
    for sensor in found:
        turn = np.asarray(CAMERA_YAW) - quaternion_to_ypr(sensor.mount[3:])[0]
        wanted = int(np.argmin(np.abs(np.angle(np.exp(1j * turn)))))
        numbers[sensor.name] = wanted if wanted in free else free[-1]
        free.remove(numbers[sensor.name])
    return numbers


def _write_files(
    block: Block, own: dict[str, Sensor], cameras: dict[str, int], depths: dict[str, int], is_rsu: bool,
    options: Options, out: Path,
) -> None:  # fmt: skip
    """Write the point clouds, images and radar samples of one agent."""
    tables, agent = block.dataset.tables, str(block.agent)
    if "lidar" in tables and any(sensor.type == "lidar" for sensor in own.values()):
        lidar = pick_sensor(own, agent, "lidar", options["lidar"], "v1: lidar=")
        for frame, sweep in block.sweeps(lidar):
            points = np.stack([sweep["x"], -sweep["y"], sweep["z"]], axis=-1)
            (out / f"{frame:06d}.pcd").write_bytes(intensity_pcd(points, sweep["intensity"]))
    for row in block.rows("rgb", ["sensor", "image"]):
        path = out / f"{row['frame']:06d}_camera{cameras[row['sensor']]}.png"
        path.write_bytes(png_of(row["image"]["bytes"]))
    for row in block.rows("depth", ["sensor", "image", "depth_m"]) if depths else []:
        path = out / f"{row['frame']:06d}_depth_camera{depths[row['sensor']]}.png"
        depth = decode_metres(row["image"]["bytes"], row["depth_m"])
        code = encode_log_grey(depth) if options["depth"] == "log8" else encode_bgra(depth)[..., 2::-1].copy()
        Image.fromarray(code).save(path)
    if is_rsu and "radar" in tables and any(sensor.type == "radar" for sensor in own.values()):
        radar = pick_sensor(own, agent, "radar", options["radar"], "v1: radar=")
        for row in block.rows("radar", ["sensor", "range", "azimuth", "elevation", "velocity"]):
            if row["sensor"] == radar.name:
                points = zip(row["velocity"], row["azimuth"], row["elevation"], row["range"], strict=True)
                points = [{"velocity": v, "azimuth": -az, "altitude": el, "depth": d} for v, az, el, d in points]
                (out / f"{row['frame']:06d}.json").write_text(json.dumps(points, indent=4) + "\n", encoding="utf-8")


def _cav(
    row: Row, own: dict[str, Sensor], cameras: dict[str, int], options: Options, imu: Row | None, gnss: Row | None
) -> dict[str, Any]:
    """Return `sensors` of a CAV."""
    pose = pose_of(row)
    sensors: dict[str, Any] = {"cameras": _cameras(pose, own, cameras, "camera")}
    sensors["vehicle_speed"] = {"speed": _xyz(carla_point([row["vx"], row["vy"], row["vz"]]))}
    sensors["vehicle_pose"] = _transform(pose)
    sensors["lidar_pose"] = _transform(_lidar_pose(pose, own, options))
    for sensor in own.values():
        if sensor.type == "imu":
            sensors["imu_pose"] = _transform(sensor_to_world(pose, sensor))
    sensors["imu_measurement"] = _imu(imu)
    if gnss is not None:
        place = carla_point(gnss_position(gnss, own[gnss["sensor"]]))
        yaw = float(np.degrees(np.angle(np.exp(1j * (gnss["heading"] - np.pi / 2)))))
        sensors["GPS"] = {"location": _xyz(place)}
        sensors["predicted_ego_pos"] = {"location": _xyz(place), "rotation": {"pitch": 0.0, "roll": 0.0, "yaw": yaw}}
        sensors["true_ego_pos"] = _transform(pose)
    return {"sensors": sensors}


def _rsu(
    row: Row, own: dict[str, Sensor], cameras: dict[str, int], depths: dict[str, int], options: Options
) -> dict[str, Any]:
    """Return `sensors` of a roadside unit."""
    pose = pose_of(row)
    sensors: dict[str, Any] = {
        "cameras": _cameras(pose, own, cameras, "camera"),
        "depth_cameras": _cameras(pose, own, depths, "depth_camera"),
        "rsu_pose": _transform(pose),
        "lidar_pose": _transform(_lidar_pose(pose, own, options)),
    }
    for sensor in own.values():
        if sensor.type == "radar" and options["radar"] in ("", sensor.name):
            sensors["radar_pose"] = _transform(sensor_to_world(pose, sensor))
    return {"sensors": sensors}


def _lidar_pose(pose: np.ndarray, own: dict[str, Sensor], options: Options) -> np.ndarray:
    """Return the pose of the LiDAR in the world; without one, the antenna, which the published arrays share."""
    agents = {sensor.type: sensor.agent for sensor in own.values()}
    for kind, name in (("lidar", options["lidar"]), ("antenna", "")):
        if kind in agents:
            return sensor_to_world(pose, pick_sensor(own, agents[kind], kind, name, f"v1: {kind}="))
    return pose


def _imu(row: Row | None) -> dict[str, Any]:
    """Return an IMU sample in CARLA's axes: y to the right, rates by the left hand."""
    if row is None:
        return NO_IMU | {"data_missing": True}
    mirror = np.array([1.0, -1.0, 1.0]) if row["handedness"] == "right" else np.ones(3)
    force = np.array([row["ax"], row["ay"], row["az"]]) * mirror
    rate = np.array([row["gx"], row["gy"], row["gz"]]) * (-mirror if row["handedness"] == "right" else mirror)
    return {"accelerometer": _xyz(force), "gyroscope": _xyz(rate), "compass": row["compass"]}


def _near(row: Row, boxes: list[Row], rsus: list[Row]) -> dict[int, Any]:
    """Return the vehicles and roadside units around a CAV; roadside units are 0, -1, ..."""
    place, found = np.array([row[axis] for axis in "xyz"]), {}
    for number, rsu in enumerate(rsus):
        pose = pose_of(rsu)
        if np.linalg.norm(pose[:3] - place) <= PERCEPTION_M:
            found[-number] = _actor("mmw.rsu", "0,0,0", pose, pose[:3], (0.0, 0.0, 0.0), 0.0)
    for box in boxes:
        pose, size = box_pose(box), (box["length"], box["width"], box["height"])
        floor = _floor(box)
        if box["agent"] != row["agent"] and np.linalg.norm(floor - place) <= PERCEPTION_M:
            at_floor = np.concatenate([floor, pose[3:]])
            found[box["object_id"]] = _actor(
                f"mmw.{box['category']}", NO_COLOR, at_floor, pose[:3], np.array(size) / 2, _speed(box)
            )
    return found


def _actor(kind: str, color: str, pose: np.ndarray, center: np.ndarray, extent: Any, speed: float) -> dict[str, Any]:
    place = carla_pose(pose).tolist()
    return {
        "bp_id": kind,
        "color": color,
        "location": place[:3],
        "center": carla_point(center - pose[:3]).tolist(),
        "angle": place[3:],
        "extent": [float(half) for half in extent],
        "speed": speed,
    }


def _scene(boxes: list[Row], is_scene: bool) -> list[dict[str, Any]]:
    """Return every vehicle as `scenes` lists it, or as a roadside unit does."""
    result = []
    for box in boxes:
        kind = f"mmw.{box['category']}"
        head = {"bp_id": kind, "speed": _speed(box)} if is_scene else {"name": kind}
        pose = _transform(np.concatenate([_floor(box), box_pose(box)[3:]]))
        result.append({"id": box["object_id"], **head, "pose": pose})
    return result


def _floor(box: Row) -> np.ndarray:
    """Return the center of the floor of a box, world frame [m], shape [3]."""
    return transform_points(box_pose(box), [0.0, 0.0, -box["height"] / 2])


def _speed(box: Row) -> float:
    return float(np.linalg.norm([box["vx"], box["vy"], box["vz"]]))


def _cameras(pose: np.ndarray, own: dict[str, Sensor], numbers: dict[str, int], name: str) -> dict[str, Any]:
    order = sorted(numbers, key=lambda camera: numbers[camera])
    return {f"{name}{numbers[camera]}": _transform(sensor_to_world(pose, own[camera])) for camera in order}


def _transform(pose: np.ndarray) -> dict[str, dict[str, float]]:
    values = carla_pose(pose).tolist()
    return {"location": _xyz(values[:3]), "rotation": {"pitch": values[5], "roll": values[3], "yaw": values[4]}}


def _xyz(values: Any) -> dict[str, float]:
    return {axis: float(value) for axis, value in zip("xyz", values, strict=True)}


FORMAT = Format(
    name="v1",
    summary="files of the published Multimodal-Wireless dataset: npz channels, PCD, PNG, YAML, radar JSON",
    losses=(
        "channels hold one antenna pattern and polarization; kinds, objects, vertices and Doppler of paths are dropped",
        "complex64 and float32; with delays=normalized the time of flight and the phase of a link are lost",
        "LiDAR intensity has 8 bits; ring, object, label, time and number of a return are dropped",
        "depth=log8 has 255 logarithmic steps, 3.4 m to 1000 m; images that were JPEG are no sharper as PNG",
        "radar has no power, object or label; radars and depth cameras of CAVs are omitted",
        "people, drones and base stations are omitted; bp_id is the dataset's category, and colors are unknown",
        "predicted_ego_pos is the GNSS fix with the measured heading: no filter ran",
        "segmentation, normals, flow, 2-D boxes, visibility and the weather's losses are omitted",
    ),
    tasks=tasks,
    options=(
        Option("arrays", "1x64-1x16", "rows x columns of transmitter and receiver, separated by commas"),
        Option(
            "delays",
            "absolute",
            "normalized: the first path of a link at delay 0, as published",
            ("absolute", "normalized"),
        ),
        Option("pattern", "dipole", "element pattern", ("dipole", "hw_dipole", "iso", "tr38901")),
        Option("polarization", "V", "polarization of the elements", ("V", "H")),
        Option(
            "wavefront",
            "auto",
            "waves over the arrays; auto: spherical in their near field; plane: as published",
            ("auto", "plane", "spherical"),
        ),
        Option(
            "depth", "log8", "log8: CARLA's LogarithmicDepth, as published; raw24: CARLA's 24 bits", ("log8", "raw24")
        ),
        Option("lidar", "", "name of the LiDAR, if an agent has several"),
        Option("radar", "", "name of the radar, if a roadside unit has several"),
    ),
)
