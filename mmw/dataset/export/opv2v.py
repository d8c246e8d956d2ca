"""OPV2V: the folders that OpenCOOD's loaders read, in CARLA's left-handed frames.

    OUT/SPLIT/SCENARIO_WEATHER/data_protocol.yaml     names of agents and cameras; loaders skip it
    OUT/SPLIT/SCENARIO_WEATHER/AGENT/000070.yaml      poses, cameras, and the vehicles that the LiDAR hits
    OUT/SPLIT/SCENARIO_WEATHER/AGENT/000070.pcd       points x, y, z and intensity in red, in the LiDAR's frame
    OUT/SPLIT/SCENARIO_WEATHER/AGENT/000070_camera0.png

AGENT is the `object_id` of a connected vehicle, filled up with zeros so that the names of a scenario sort as the
numbers do, and -1 for the roadside unit. Vehicles have the same number in every file. To the loader the first agent
is the ego, so it is the connected vehicle with the smallest `object_id`, cav_1 in generated traffic.

A vehicle's box is `location` + `center`, which the loader adds without turning them: `location` is the point half a
height below the center of the box, `center` is (0, 0, height / 2), and their sum is the center of the dataset's box on
any slope. `extent` holds half sizes.

Losses: see `LOSSES`.

Source: layout and fields of OPV2V, R. Xu et al., "OPV2V: An open benchmark dataset and fusion pipeline for perception
with vehicle-to-vehicle communication", ICRA 2022, and what OpenCOOD's loader expects of them.
"""

from collections.abc import Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mmw.core.errors import InputError
from mmw.core.transforms import compose, invert, multiply, quaternion_from_ypr, quaternion_to_ypr, rotate
from mmw.dataset import Dataset
from mmw.dataset.export.carla_frames import carla_angles, carla_matrix, carla_point, carla_pose
from mmw.dataset.export.exporter import (
    VEHICLE_ROLES,
    Format,
    Option,
    Options,
    Part,
    Selection,
    Task,
    frame_steps,
    parts,
    require,
)
from mmw.dataset.export.pcd import intensity_pcd
from mmw.dataset.export.read_sensors import (
    Block,
    Row,
    Sensor,
    gnss_position,
    pick_sensor,
    pose_of,
    sensor_to_world,
    sensors_of,
)
from mmw.dataset.export.write_files import png_of, write_yaml

LOSSES = (
    "no radio: links, paths and materials",
    "no radar, depth, IMU, segmentation, normals, flow and 2-D boxes",
    "LiDAR intensity has 8 bits; ring, object, label, time and number of a return are dropped",
    "frames at `rate`, 10 Hz by default, as OpenCOOD counts its delays in tenths of a second",
    "one roadside unit a scenario: OpenCOOD would treat the second as the ego vehicle",
    "vehicles only, no people and drones; agents are CAVs and a roadside unit; no velocity vector, only speed",
    "plan_trajectory is empty; predicted_ego_pos is the true pose in frames without a GNSS fix and for roadside units",
    "a camera is a pinhole: lens distortion stays in the image, its coefficients are in data_protocol.yaml alone",
    "PNG copies of JPEG images are no sharper than those",
)
"""Losses of the format."""

OPTIONS = (
    Option("rate", "10", "frames a second [Hz]; a divisor of 100"),
    Option("split", "train", "folder above the scenarios", ("train", "validate", "test")),
    Option("vehicles", "hit", "vehicles with a LiDAR return of the agent, or all", ("hit", "all")),
    Option("images", "png", "png for the loaders, source: the files as they are", ("png", "source", "none")),
    Option("cameras", "front,right,left,back", "RGB cameras that become camera0, camera1, ...; others follow by name"),
    Option("lidar", "", "LiDAR, where an agent has several"),
)

KM_H = 3.6
"""Kilometers per hour in a meter per second."""

DECIMALS = 6
"""Digits after the point in YAML: a micrometer, a microdegree."""


def plan(dataset: Dataset, selection: Selection, options: Options) -> list[Task]:
    """Return one task a scenario, weather, agent and second, and one a scenario and weather for its protocol.

    Raises:
        InputError: If a table, a LiDAR or a connected vehicle is missing, or a scenario has two roadside units.
    """
    require(dataset, "opv2v", "lidar", "boxes", "sensors")
    if options["vehicles"] == "hit":
        require(dataset, "opv2v", "box_visibility", hint="record it, or give vehicles=all")
    if options["images"] != "none":
        require(dataset, "opv2v", "rgb", hint="record RGB cameras, or give images=none")
    tasks = []
    for part in parts(dataset, selection, frame_steps(dataset, "opv2v", "rate", options), roles=VEHICLE_ROLES):
        sensors = sensors_of(dataset, part.scenario)
        folder = f"{options['split']}/{part.scenario}_{part.weather}"
        ids = agent_folders(dataset, part)
        lidars = {
            one: pick_sensor(sensors[one], one, "lidar", options["lidar"], "opv2v: lidar=") for one in part.agents
        }
        cameras = {agent: cameras_of(sensors[agent], options) for agent in part.agents}
        name = f"{part.scenario}_{part.weather}"
        protocol = _protocol(dataset, part, ids, lidars, cameras, options)
        tasks.append(Task(f"{name}_protocol", partial(_write_protocol, protocol, folder)))
        for agent in part.agents:
            for block in Block(dataset, part.scenario, part.weather, part.frames, agent).split():
                work = partial(_write, block, lidars[agent], cameras[agent], f"{folder}/{ids[agent]}", options)
                tasks.append(Task(f"{name}_{agent}_{block.frames[0]:06d}", work))
    return tasks


def agent_folders(dataset: Dataset, part: Part) -> dict[str, str]:
    """Return the folder of each agent: the loader turns the names into numbers and sorts them as text.

    Raises:
        InputError: If there is no connected vehicle, or more than one roadside unit.
    """
    block = Block(dataset, part.scenario, part.weather, part.frames[:1])
    rows = [row for row in block.rows("poses", ["agent", "role", "object_id"]) if row["agent"] in part.agents]
    cavs = {row["agent"]: str(row["object_id"]) for row in rows if row["role"] == "cav"}
    rsus = [row["agent"] for row in rows if row["role"] != "cav"]
    if not cavs:
        raise InputError(f"opv2v: {part.scenario}: no connected vehicle is picked; the loader needs one; pick it")
    if len(rsus) > 1:
        raise InputError(
            f"opv2v: {part.scenario}: has the roadside units {', '.join(rsus)}; the format has one; "
            f"pick it with agent={','.join([*cavs, rsus[0]])}"
        )
    digits = max(len(number) for number in cavs.values())
    return {**{agent: number.zfill(digits) for agent, number in cavs.items()}, **dict.fromkeys(rsus, "-1")}


def cameras_of(sensors: Mapping[str, Sensor], options: Options) -> list[Sensor]:
    """Return the RGB cameras among an agent's sensors in the order of their numbers."""
    first = options["cameras"].split(",")
    found = [sensor for sensor in sensors.values() if sensor.type == "rgb"]
    return sorted(
        found, key=lambda sensor: (first.index(sensor.name) if sensor.name in first else len(first), sensor.name)
    )


def _protocol(
    dataset: Dataset,
    part: Part,
    ids: Mapping[str, str],
    lidars: Mapping[str, Sensor],
    cameras: Mapping[str, list[Sensor]],
    options: Options,
) -> dict[str, Any]:
    """Return the meaning of the names and numbers in a scenario's folder."""
    agents = {}
    for agent in part.agents:
        numbered = {
            f"camera{index}": {"sensor": camera.name, "lens": camera.lens, "coefficients": list(camera.coefficients)}
            for index, camera in enumerate(cameras[agent])
        }
        agents[ids[agent]] = {"agent": agent, "lidar": lidars[agent].name, "cameras": numbered}
    return {
        "mmw": {
            "config_sha256": dataset.info["config_sha256"],
            "scenario": part.scenario,
            "weather": part.weather,
            "rate_hz": int(options["rate"]),
            "first_frame": part.frames[0],
            "frames": len(part.frames),
            "agents": agents,
        }
    }


def _write_protocol(protocol: dict[str, Any], folder: str, out: Path) -> None:
    write_yaml(out / folder / "data_protocol.yaml", protocol, flow=None)


def _write(block: Block, lidar: Sensor, cameras: Sequence[Sensor], folder: str, options: Options, out: Path) -> None:
    """Write the files of one agent in some frames."""
    target = out / folder
    target.mkdir(parents=True)
    poses = {row["frame"]: row for row in block.rows("poses")}
    boxes = block.vehicles()
    hits: dict[tuple[int, int], int] = {}
    for row in block.rows("box_visibility", ["sensor", "object_id", "lidar_points"]):
        if row["sensor"] == lidar.name and row["lidar_points"]:
            hits[row["frame"], row["object_id"]] = row["lidar_points"]
    fixes = _gnss_poses(block, poses)
    clouds = block.sweep_of_each(lidar)
    for frame in block.frames:
        row = poses[frame]
        vehicles = [
            box
            for box in boxes.get(frame, [])
            if box["object_id"] != row["object_id"]
            and (options["vehicles"] == "all" or (frame, box["object_id"]) in hits)
        ]
        content = {
            **_agent_fields(row, lidar, cameras, fixes.get(frame)),
            "vehicles": {box["object_id"]: _vehicle(box, hits.get((frame, box["object_id"]), 0)) for box in vehicles},
        }
        cloud = clouds[frame]
        xyz = carla_point(np.stack([cloud[axis] for axis in "xyz"], axis=-1))
        (target / f"{frame:06d}.pcd").write_bytes(intensity_pcd(xyz, cloud["intensity"]))
        write_yaml(target / f"{frame:06d}.yaml", content, flow=None)
    if options["images"] != "none":
        _write_images(block, cameras, options["images"], target)


def _agent_fields(row: Row, lidar: Sensor, cameras: Sequence[Sensor], fix: np.ndarray | None) -> dict[str, Any]:
    """Return an agent's own fields of one frame."""
    pose = pose_of(row)
    true = numbers(carla_pose(pose))
    fields = {
        "lidar_pose": numbers(carla_pose(sensor_to_world(pose, lidar))),
        "true_ego_pos": true,
        "predicted_ego_pos": list(true) if fix is None else numbers(carla_pose(fix)),
        "ego_speed": numbers(KM_H * np.linalg.norm([row["vx"], row["vy"], row["vz"]])),
        "plan_trajectory": [],
    }
    for index, camera in enumerate(cameras):
        fields[f"camera{index}"] = {
            "cords": numbers(carla_pose(sensor_to_world(pose, camera))),
            # LiDAR to camera, both with CARLA's axes (x forward, y right, z up).
            "extrinsic": numbers(carla_matrix(compose(invert(camera.mount), lidar.mount))),
            "intrinsic": numbers(camera.intrinsic),
        }
    return fields


def _vehicle(box: Row, points: int) -> dict[str, Any]:
    """Return the fields of one vehicle; `category` and `lidar_points` are ours."""
    half = np.array([box["length"], box["width"], box["height"]]) / 2.0
    middle = carla_point([box["x"], box["y"], box["z"]])
    return {
        "angle": numbers(carla_angles([box["yaw"], box["pitch"], box["roll"]])),
        "center": numbers([0.0, 0.0, half[2]]),
        "extent": numbers(half),
        "location": numbers(middle - [0.0, 0.0, half[2]]),
        "speed": numbers(KM_H * np.linalg.norm([box["vx"], box["vy"], box["vz"]])),
        "category": box["category"],
        "lidar_points": points,
    }


def _gnss_poses(block: Block, poses: dict[int, Row]) -> dict[int, np.ndarray]:
    """Return the pose [7] of an agent by its GNSS in each frame that has a fix: place and heading are measured, pitch
    and roll true."""
    rows, result = block.rows("gnss"), {}
    sensors = sensors_of(block.dataset, block.scenario)[str(block.agent)] if rows else {}
    for row in rows:
        sensor = sensors[row["sensor"]]
        place = gnss_position(row, sensor)
        true = pose_of(poses[row["frame"]])
        yaw, pitch, roll = quaternion_to_ypr(multiply(true[3:], sensor.mount[3:]))
        yaw = np.pi / 2.0 - row["heading"]
        turn = multiply(quaternion_from_ypr(yaw, pitch, roll), invert(sensor.mount)[3:])
        result[row["frame"]] = np.concatenate([place - rotate(turn, sensor.mount[:3]), turn])
    return result


def _write_images(block: Block, cameras: Sequence[Sensor], kind: str, target: Path) -> None:
    """Write the images of the frames that have one: cameras may be slower than the frames."""
    number = {camera.name: index for index, camera in enumerate(cameras)}
    for row in block.rows("rgb", ["sensor", "image", "format"]):
        path, data = target / f"{row['frame']:06d}_camera{number[row['sensor']]}", row["image"]["bytes"]
        if kind == "source" or row["format"] == "png":
            path.with_suffix(f".{row['format']}").write_bytes(data)
        else:
            path.with_suffix(".png").write_bytes(png_of(data))


def numbers(values: Any) -> Any:
    """Return an array as nested lists of plain floats, a scalar as a float, rounded; -0 becomes 0."""
    return (np.round(np.asarray(values, dtype=np.float64), DECIMALS) + 0.0).tolist()


FORMAT = Format(
    "opv2v",
    "OPV2V and V2XSet: YAML, PCD and PNG for OpenCOOD's loaders",
    LOSSES,
    plan,
    options=OPTIONS,
)
