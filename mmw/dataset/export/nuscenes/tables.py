"""The thirteen tables of nuScenes, filled from a dataset."""

import hashlib
import io
import json
from bisect import bisect_left
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from mmw.core.errors import InputError
from mmw.core.transforms import compose, quaternion_from_ypr
from mmw.dataset import Dataset
from mmw.dataset.export.pinhole import OPTICAL_POSE
from mmw.dataset.export.read_sensors import Block, Row, Sensor
from mmw.dataset.export.write_files import write_file

VERSION = "v1.0-mmw"
LIDAR = "LIDAR_TOP"

CATEGORIES = {
    "car": "vehicle.car", "truck": "vehicle.truck", "bus": "vehicle.bus.rigid", "motorcycle": "vehicle.motorcycle",
    "bicycle": "vehicle.bicycle", "rider": "human.pedestrian.personal_mobility", "pedestrian": "human.pedestrian.adult",
}  # fmt: skip
"""Category of a box -> nuScenes' name; another NAME is movable_object.NAME."""

MOVING_M_S = 0.2
"""Speed from which something moves [m/s]; design value."""

VISIBILITY = (("1", "v0-40", 0.0), ("2", "v40-60", 0.4), ("3", "v60-80", 0.6), ("4", "v80-100", 0.8))
"""Token, level and the share from which it holds."""
UNKNOWN = "0"

Tables = dict[str, dict[str, dict[str, Any]]]
"""Table -> token -> row."""


@dataclass(frozen=True)
class Scene:
    """One agent of a scenario in one weather."""

    dataset: Dataset
    scenario: str
    weather: str
    agent: str
    samples: tuple[int, ...]
    """Frames of the samples, ascending."""
    frames: tuple[int, ...]
    """Frames of samples and sweeps, ascending."""
    lidar: Sensor
    cameras: dict[str, Sensor]
    """RGB cameras by name."""
    begin_us: int
    """Time of frame 0 [us]: the development kit sorts scenes by it, so no two have the same."""

    @property
    def name(self) -> str:
        """Name of the scene and its files."""
        return f"{self.scenario}_{self.weather}_{self.agent}"

    def file(self, channel: str, frame: int, suffix: str) -> str:
        """Return the path of a file, relative to the folder of the export."""
        folder = "samples" if frame in self.samples else "sweeps"
        return f"{folder}/{channel}/{self.name}__{channel}__{self.time_us(frame)}.{suffix}"

    def block(self, frames: Sequence[int]) -> Block:
        """Return a reader of the agent's rows in some frames."""
        return Block(self.dataset, self.scenario, self.weather, frames, self.agent)

    def time_us(self, frame: int) -> int:
        """Return the time of a frame [us]."""
        return self.begin_us + frame * (1_000_000 // self.dataset.frame_rate_hz(self.scenario))

    def token(self, kind: str, *keys: Any) -> str:
        """Return the token of a row of the scene."""
        return token(self.dataset, kind, self.name, *keys)


def channel_of(camera: str) -> str:
    """Return nuScenes' channel of a camera."""
    return f"CAM_{camera.upper()}"


def token(dataset: Dataset, *keys: Any) -> str:
    """Return the token of a row: 32 hexadecimal digits of the hash of the dataset and the row's keys."""
    text = json.dumps([dataset.info["config_sha256"], *keys])
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def suffix_of(row: Row) -> str:
    """Return the ending of the image of a row of `rgb`."""
    return {"jpeg": "jpg", "png": "png"}[row["format"]]


def write_tables(scenes: Sequence[Scene], held_out: Sequence[str], out: Path) -> None:
    """Write the JSON tables, the splits and the empty maps; `held_out` names scenarios and weathers of `mmw_val`."""
    tables: Tables = defaultdict(dict)
    for number, level, _ in (*VISIBILITY, (UNKNOWN, "unknown", 0.0)):
        tables["visibility"][number] = {"token": number, "level": level, "description": "share of the framed rectangle"}
    for scene in scenes:
        _add_log(tables, scene)
        _add_samples(tables, scene)
        _add_sensor_data(tables, scene)
        _add_annotations(tables, scene)
    blank = io.BytesIO()
    Image.new("L", (8, 8)).save(blank, "PNG")
    for row in tables["map"].values():
        write_file(out / row["filename"], blank.getvalue())
    for name in TABLES:
        write_file(out / VERSION / f"{name}.json", _json(tables[name].values()))
    write_file(out / VERSION / "splits.json", (json.dumps(splits(scenes, held_out), indent=1) + "\n").encode())


def splits(scenes: Sequence[Scene], held_out: Sequence[str]) -> dict[str, list[str]]:
    """Return the names of the scenes of each split, as the development kit reads custom ones since its version 1.2.0.

    Splits are `all`, one for each scenario and each weather, and with `held_out` `mmw_train` and `mmw_val`. The names
    that the kit has of its own, such as `train` and `mini_val`, are bound to scenes of nuScenes.

    Source: nuscenes-devkit 1.2.0, `utils/splits.py`, `get_scenes_of_custom_split`.
    """
    found: dict[str, list[str]] = {"all": [scene.name for scene in scenes]}
    for scene in scenes:
        part = "mmw_val" if {scene.scenario, scene.weather} & {*held_out} else "mmw_train"
        for name in (f"scenario_{scene.scenario}", f"weather_{scene.weather}", *([part] if held_out else ())):
            found.setdefault(name, []).append(scene.name)
    return found


TABLES = (
    "category", "attribute", "visibility", "instance", "sensor", "calibrated_sensor", "ego_pose", "log", "scene",
    "sample", "sample_data", "sample_annotation", "map",
)  # fmt: skip
"""The thirteen tables."""


def _json(rows: Iterable[Row]) -> bytes:
    """Return rows as a JSON list, one row a line."""
    return ("[\n" + ",\n".join(json.dumps(row) for row in rows) + "\n]\n").encode()


def _add(tables: Tables, table: str, key: str, /, **values: Any) -> dict[str, Any]:
    """Add a row by its token, or return the one that is there."""
    return tables[table].setdefault(key, {"token": key, **values})


def _add_log(tables: Tables, scene: Scene) -> None:
    """Add the log of a scene, and the map of its town."""
    configured = {entry["name"]: entry for entry in scene.dataset.info["config"].get("scenarios", ())}
    entry = configured.get(scene.scenario, {})
    place = entry.get("town") or entry.get("stage") or scene.scenario
    log = scene.token("log")
    _add(
        tables, "log", log, logfile=scene.name, vehicle=scene.agent, location=place,
        date_captured=scene.dataset.info.get("created_utc", "")[:10],
    )  # fmt: skip
    name = token(scene.dataset, "map", place)
    chart = _add(tables, "map", name, category="semantic_prior", filename=f"maps/{name}.png", log_tokens=[])
    chart["log_tokens"].append(log)


def _add_samples(tables: Tables, scene: Scene) -> None:
    """Add a scene and its samples."""
    names = [scene.token("sample", frame) for frame in scene.samples]
    _add(
        tables, "scene", scene.token("scene"), log_token=scene.token("log"),
        nbr_samples=len(names), first_sample_token=names[0], last_sample_token=names[-1], name=scene.name,
        description=f"{scene.scenario}, {scene.weather}, seen by {scene.agent}", mmw_scenario=scene.scenario,
        mmw_weather=scene.weather, mmw_agent=scene.agent,
    )  # fmt: skip
    for index, (frame, name) in enumerate(zip(scene.samples, names, strict=True)):
        _add(
            tables, "sample", name, timestamp=scene.time_us(frame), scene_token=scene.token("scene"),
            **_neighbors(names, index), mmw_frame=frame,
        )  # fmt: skip


def _neighbors(names: Sequence[str], index: int) -> dict[str, str]:
    return {
        "prev": names[index - 1] if index else "",
        "next": names[index + 1] if index + 1 < len(names) else "",
    }


def _nearest(samples: Sequence[int], frame: int) -> int:
    """Return the sample nearest in time, the later one of two."""
    right = min(bisect_left(samples, frame), len(samples) - 1)
    left = max(right - 1, 0)
    return samples[left] if abs(frame - samples[left]) < abs(samples[right] - frame) else samples[right]


def _add_sensor_data(tables: Tables, scene: Scene) -> None:
    """Add the sensors of a scene, the poses of its agent, and one row a file."""
    block = scene.block(scene.frames)
    for row in block.rows("poses"):
        _add(
            tables, "ego_pose", scene.token("ego_pose", row["frame"]),
            timestamp=scene.time_us(row["frame"]), rotation=[row[name] for name in ("qw", "qx", "qy", "qz")],
            translation=[row[name] for name in "xyz"],
        )  # fmt: skip
    files = {LIDAR: dict.fromkeys(_swept(block, scene), "pcd.bin")}
    for row in block.rows("rgb", ["sensor", "format"]):
        files.setdefault(channel_of(row["sensor"]), {})[row["frame"]] = suffix_of(row)
    channels = {LIDAR: scene.lidar, **{channel_of(name): camera for name, camera in scene.cameras.items()}}
    for channel, sensor in channels.items():
        modality = "camera" if sensor.intrinsic is not None else "lidar"
        kind = token(scene.dataset, "sensor", channel)
        _add(tables, "sensor", kind, channel=channel, modality=modality)
        mount = compose(sensor.mount, OPTICAL_POSE) if modality == "camera" else sensor.mount
        calibration = token(scene.dataset, "calibrated_sensor", scene.scenario, scene.agent, sensor.name)
        _add(
            tables, "calibrated_sensor", calibration, sensor_token=kind, translation=mount[:3].tolist(),
            rotation=mount[[6, 3, 4, 5]].tolist(),
            camera_intrinsic=[] if sensor.intrinsic is None else sensor.intrinsic.tolist(),
            mmw_sensor=sensor.name, mmw_lens=sensor.lens, mmw_coefficients=list(sensor.coefficients),
        )  # fmt: skip
        there = sorted(files.get(channel, {}))
        names = [scene.token("sample_data", channel, frame) for frame in there]
        width, height = sensor.size
        for index, (frame, name) in enumerate(zip(there, names, strict=True)):
            suffix = files[channel][frame]
            _add(
                tables, "sample_data", name, sample_token=scene.token("sample", _nearest(scene.samples, frame)),
                ego_pose_token=scene.token("ego_pose", frame), calibrated_sensor_token=calibration,
                timestamp=scene.time_us(frame), fileformat=suffix.split(".")[0], is_key_frame=frame in scene.samples,
                height=height, width=width, filename=scene.file(channel, frame, suffix), **_neighbors(names, index),
            )  # fmt: skip


def _swept(block: Block, scene: Scene) -> set[int]:
    """Return the frames with a sweep; every sample needs one.

    Raises:
        InputError: If one has none.
    """
    frames = block.recorded("lidar").get(scene.lidar.name, set())
    if missing := sorted(set(scene.samples) - frames):
        raise InputError(
            f"{block.dataset.root}: {scene.name}, frame {missing[0]}: there is no sweep of {scene.lidar.name}; every "
            "sample needs one; pick other frames"
        )
    return frames


def _add_annotations(tables: Tables, scene: Scene) -> None:
    """Add what the sensors of a scene's agent have something of in each sample, chained by object."""
    block = scene.block(scene.samples)
    points: dict[tuple[int, int], np.ndarray] = {}
    columns = ("lidar_points", "radar_points", "pixels")
    for row in block.rows("box_visibility", ["object_id", *columns]):
        counts = np.array([row[name] or 0 for name in columns])
        points[row["frame"], row["object_id"]] = points.get((row["frame"], row["object_id"]), 0) + counts
    shares = _visible_shares(block, scene)
    own = {row["object_id"] for row in scene.block(scene.samples[:1]).rows("poses")}
    chains: dict[int, list[str]] = defaultdict(list)
    boxes = block.boxes()
    for frame in scene.samples:
        for box in boxes.get(frame, ()):
            number = box["object_id"]
            lidar, radar, pixels = points.get((frame, number), (0, 0, 0))
            if number in own or lidar + radar + pixels == 0:
                continue
            name = scene.token("sample_annotation", frame, number)
            x, y, z, w = quaternion_from_ypr(box["yaw"], box["pitch"], box["roll"]).tolist()
            _add(
                tables, "sample_annotation", name, sample_token=scene.token("sample", frame),
                instance_token=scene.token("instance", number), visibility_token=_level(shares.get((frame, number))),
                attribute_tokens=_attributes(tables, scene.dataset, box), translation=[box["x"], box["y"], box["z"]],
                size=[box["width"], box["length"], box["height"]], rotation=[w, x, y, z], prev="", next="",
                num_lidar_pts=int(lidar), num_radar_pts=int(radar),
            )  # fmt: skip
            if not chains[number]:
                _add_instance(tables, scene, box)
            chains[number].append(name)
    for number, names in chains.items():
        for index, name in enumerate(names):
            tables["sample_annotation"][name].update(_neighbors(names, index))
        tables["instance"][scene.token("instance", number)].update(
            nbr_annotations=len(names), first_annotation_token=names[0], last_annotation_token=names[-1]
        )


def _add_instance(tables: Tables, scene: Scene, box: Row) -> None:
    """Add an object of a scene, and its category."""
    name = CATEGORIES.get(box["category"], f"movable_object.{box['category']}")
    category = token(scene.dataset, "category", name)
    _add(tables, "category", category, name=name, description=f"label {box['category']} of the dataset")
    _add(
        tables, "instance", scene.token("instance", box["object_id"]), category_token=category, nbr_annotations=0,
        first_annotation_token="", last_annotation_token="", mmw_object_id=box["object_id"],
    )  # fmt: skip


def _attributes(tables: Tables, dataset: Dataset, box: Row) -> list[str]:
    """Return the attribute of a box, one of those that the development kit evaluates: moving, standing, ridden."""
    moves = np.linalg.norm([box["vx"], box["vy"], box["vz"]]) >= MOVING_M_S
    kind = "pedestrian" if box["category"] in ("pedestrian", "rider") else "vehicle"
    name = f"{kind}.{'moving' if moves else 'standing' if kind == 'pedestrian' else 'stopped'}"
    if box["category"] == "bicycle":  # with whoever rides it, as the shipped ones are
        name = "cycle.with_rider"
    key = token(dataset, "attribute", name)
    _add(tables, "attribute", key, name=name, description=f"speed against {MOVING_M_S} m/s")
    return [key]


def _visible_shares(block: Block, scene: Scene) -> dict[tuple[int, int], float]:
    """Return the largest visible share of each (frame, object) over the cameras that frame it."""
    edges = ("u_min", "v_min", "u_max", "v_max")
    columns = ["sensor", "object_id", "pixels", *edges, *(f"amodal_{name}" for name in edges)]
    result: dict[tuple[int, int], float] = {}
    for row in block.rows("boxes_2d", columns):
        if row["sensor"] not in scene.cameras:
            continue
        share = 0.0
        if row["pixels"]:
            seen = (row["u_max"] + 1 - row["u_min"]) * (row["v_max"] + 1 - row["v_min"])
            width, height = (row[f"amodal_{axis}_max"] - row[f"amodal_{axis}_min"] for axis in "uv")
            share = seen / (width * height)
        key = (row["frame"], row["object_id"])
        result[key] = max(result.get(key, 0.0), share)
    return result


def _level(share: float | None) -> str:
    """Return the token of the visibility of a share; of None, the unknown one."""
    if share is None:
        return UNKNOWN
    return next(name for name, _, minimum in reversed(VISIBILITY) if share >= minimum)
