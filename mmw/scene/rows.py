"""Make the rows of the tables of the world: frames, poses, boxes, and what no frame changes."""

import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from mmw.config import Config, SensorConfig
from mmw.config.agent_keys import AGENT_ROLES
from mmw.config.lens import USED
from mmw.config.sampling import UNSET
from mmw.config.sensor_spec import spec_of
from mmw.core.kinematics import Motion
from mmw.core.remember import remembered
from mmw.core.transforms import normalize
from mmw.physics.materials.material import FILE_FIELDS, file_values
from mmw.scene.actor_counts import COUNTED, counted_in
from mmw.scene.mounted_antennas import antenna_pose
from mmw.scene.scene_data import Actor, SceneData
from mmw.scene.table_rows import Columns, actor_texts, names, split
from mmw.scene.views import mount_pose
from mmw.storage.schemas import table_spec
from mmw.storage.table_spec import F64, list_of


def frame_rows(arrays: SceneData, frames: Sequence[int], seed: int) -> Columns:
    """Return the `frames` table: one row a frame."""
    rows = arrays.frame_rows(frames)
    is_present = np.isfinite(arrays.poses[rows]).all(axis=2)
    return {
        "frame": np.asarray(frames, dtype=np.int32),
        "time_s": arrays.numbers(frames) / arrays.rate_hz,
        **split(COUNTED, is_present @ _counted(arrays.actors)),
        "seed": np.array(arrays.seeds(frames, seed)),
    }


@remembered()
def _counted(actors: tuple[Actor, ...]) -> np.ndarray:
    """Return 1 where a column of `COUNTED` counts an actor, else 0, shape [V, C], int64."""
    columns = [counted_in(actor.role, actor.label) for actor in actors]
    return np.array([[name in own for name in COUNTED] for own in columns], dtype=np.int64).reshape(-1, len(COUNTED))


@remembered()
def _agents(actors: tuple[Actor, ...]) -> np.ndarray:
    """Return the indices of the agents, shape [n], int32."""
    return np.array([i for i, actor in enumerate(actors) if actor.role in AGENT_ROLES], dtype=np.int32)


def pose_rows(arrays: SceneData, frames: Sequence[int], motion: Motion) -> Columns:
    """Return the `poses` table: every agent that is present."""
    rows, agents = arrays.frame_rows(frames), _agents(arrays.actors)
    row, actor = np.repeat(rows, len(agents)), np.tile(agents, len(rows))
    frame, pose = np.repeat(np.asarray(frames, dtype=np.int32), len(agents)), arrays.poses[row, actor]
    keep = np.isfinite(pose).all(axis=1)
    if not keep.all():
        row, actor, frame, pose = row[keep], actor[keep], frame[keep], pose[keep]
    return {
        "frame": frame,
        "agent": names(arrays, actor),
        "role": actor_texts(arrays.actors, "role")[actor],
        "object_id": np.array([arrays.actors[i].object_id for i in actor.tolist()], dtype=np.int32),
        **split(("x", "y", "z"), pose[:, :3]),
        **split(("qx", "qy", "qz", "qw"), normalize(pose[:, 3:])),
        **split(("vx", "vy", "vz"), motion.velocity[row, actor]),
        **split(("wx", "wy", "wz"), motion.body_rate[row, actor]),
    }


def actor_presence(arrays: SceneData, frames: range) -> dict[str, dict[str, Any]]:
    """Return role, model, class and frames of each actor: first frame and one past the last of stretches with it."""
    rows = arrays.frame_rows(frames)
    found = {}
    for column, actor in enumerate(arrays.actors):
        is_there = np.isfinite(arrays.poses[rows, column]).all(axis=1)
        ends = np.flatnonzero(np.diff(np.concatenate([[False], is_there, [False]]).astype(np.int8))) + frames.start
        kind = {"role": actor.role, "model": actor.model_name, "label": actor.label}
        found[actor.name] = {**kind, "frames": ends.reshape(-1, 2).tolist()}
    return found


def static_rows(arrays: SceneData, config: Config) -> dict[str, Columns]:
    """Return the tables of a scenario that no frame changes: `objects`, `sensors`, `materials`."""
    objects = arrays.objects
    materials = [(w, i, m) for w in config.weathers for i, m in enumerate(arrays.materials[w])]
    radio = [file_values(m.radio) for _, _, m in materials]
    return {
        "objects": {
            "object_id": np.array([o.object_id for o in objects], dtype=np.int32),
            "prim_path": [o.prim_path for o in objects],
            "label": [o.label for o in objects],
            "tag": np.array([o.tag for o in objects], dtype=np.uint8),
            "actor": [o.actor or None for o in objects],
            "materials": [list(o.materials) for o in objects],
        },
        "sensors": _sensor_rows(arrays, config),
        "materials": {
            "weather": [w for w, _, _ in materials],
            "material_id": np.array([i for _, i, _ in materials], dtype=np.int32),
            "name": [m.name for _, _, m in materials],
            **{name: [values[name] for values in radio] for name in FILE_FIELDS},
            "itu": [values["itu"] or None for values in radio],
            "nonvisual_base": [m.nonvisual_base for _, _, m in materials],
            "lidar_reflectance": np.array([m.lidar_reflectance for _, _, m in materials]),
            "color": [np.array(m.color, dtype=np.float32) for _, _, m in materials],
        },
    }


def _sensor_rows(arrays: SceneData, config: Config) -> Columns:
    rows: list[Columns] = []
    for actor in arrays.actors:
        if actor.role not in AGENT_ROLES:
            continue
        for sensor in config.sensors:
            if sensor.is_on(*actor.identity):
                pose = mount_pose(sensor, *actor.identity)
                params = json.dumps(sensor.with_rate(arrays.rate_hz).model_dump(mode="json"), sort_keys=True)
                rows.append(_sensor_row(actor.name, sensor.name, sensor.type, pose, params, _camera(sensor)))
        if config.channel.enabled:
            own = {key: value for key, value in config.channel.model_dump(mode="json").items() if key in UNSET}
            for antenna in config.channel.antennas:
                if antenna.is_on(*actor.identity):
                    pose = antenna_pose(antenna, *actor.identity)
                    params = json.dumps({**antenna.model_dump(mode="json", exclude={"name", "on", "mount"}), **own})
                    rows.append(_sensor_row(actor.name, antenna.name, "antenna", pose, params, {}))
    keys = [column.name for column in table_spec("sensors").columns if column.name != "scenario"]
    columns: Columns = {key: [row.get(key) for row in rows] for key in keys}  # those of cameras are null for others
    return {**columns, "coefficients": pa.array(columns["coefficients"], list_of(F64))}


def _camera(sensor: SensorConfig) -> Columns:
    """Return the columns that only cameras have; none for other sensors."""
    projection = spec_of(sensor).camera
    if projection is None:
        return {}
    camera = projection(sensor)
    numbers = {name: getattr(camera.intrinsics, name) for name in ("fx", "fy", "cx", "cy", "width", "height")}
    lens = camera.lens
    return {**numbers, "lens": lens.model, "coefficients": [getattr(lens, name) for name in USED[lens.model]]}


def _sensor_row(agent: str, sensor: str, type_: str, pose: np.ndarray, params: str, camera: Columns) -> Columns:
    place = dict(zip(("x", "y", "z", "qx", "qy", "qz", "qw"), map(float, pose), strict=True))
    return {"agent": agent, "sensor": sensor, "type": type_, **place, **camera, "params": params}
