"""What sensors and channel return, as columns of the tables. One function a table; rows of one batch of frames."""

import json
from collections.abc import Sequence
from concurrent.futures import Future
from typing import Any

import numpy as np
import pyarrow as pa

from mmw.channel.links import LINK_KINDS, Links
from mmw.channel.paths import PATH_KINDS, PATH_LOS, Paths
from mmw.config import Config, DepthConfig, ScenarioConfig
from mmw.constants import FRAME_RATE_HZ
from mmw.patterns import pinhole
from mmw.poses import normalize
from mmw.scene_arrays import SceneArrays
from mmw.sensors.boxes import BOX_ROLES, Boxes, count_returns
from mmw.sensors.imu import ImuBatch
from mmw.sensors.kinematics import Motion
from mmw.sensors.lidar import LidarBatch, LidarHits
from mmw.tables.schemas import table_spec
from mmw.views import Views, mount_pose

Columns = dict[str, Any]
AGENT_ROLES = ("cav", "rsu")


def _names(arrays: SceneArrays, actor: np.ndarray) -> np.ndarray:
    return np.array([a.name for a in arrays.actors], dtype=object)[actor]


def _split(columns: Sequence[str], values: np.ndarray) -> Columns:
    """Return the columns of a matrix by name, contiguous."""
    return {name: np.ascontiguousarray(values[:, i]) for i, name in enumerate(columns)}


def frame_rows(arrays: SceneArrays, frames: Sequence[int], seed: int) -> Columns:
    """Return the `frames` table: one row a frame."""
    rows = [arrays.frame_row(frame) for frame in frames]
    is_present = np.all(np.isfinite(arrays.poses[rows]), axis=2)
    role = np.array([actor.role for actor in arrays.actors])
    frame = np.asarray(frames, dtype=np.int32)
    return {
        "frame": frame,
        "time_s": frame / FRAME_RATE_HZ,
        "cav_count": is_present[:, role == "cav"].sum(axis=1),
        "rsu_count": is_present[:, role == "rsu"].sum(axis=1),
        "vehicle_count": is_present[:, (role == "cav") | (role == "vehicle")].sum(axis=1),
        "pedestrian_count": is_present[:, role == "pedestrian"].sum(axis=1),
        "seed": np.full(len(frame), seed),
    }


def pose_rows(arrays: SceneArrays, frames: Sequence[int], motion: Motion) -> Columns:
    """Return the `poses` table: every agent that is present."""
    rows = np.array([arrays.frame_row(frame) for frame in frames])
    agents = np.array([i for i, actor in enumerate(arrays.actors) if actor.role in AGENT_ROLES], dtype=np.int32)
    row, actor = np.repeat(rows, len(agents)), np.tile(agents, len(rows))
    frame = np.repeat(np.asarray(frames, dtype=np.int32), len(agents))
    keep = np.isfinite(arrays.poses[row, actor]).all(axis=1)
    row, actor, frame = row[keep], actor[keep], frame[keep]
    pose = arrays.poses[row, actor]
    return {
        "frame": frame,
        "agent": _names(arrays, actor),
        "role": np.array([a.role for a in arrays.actors], dtype=object)[actor],
        "object_id": np.array([a.object_id for a in arrays.actors], dtype=np.int32)[actor],
        **_split(("x", "y", "z"), pose[:, :3]),
        **_split(("qx", "qy", "qz", "qw"), normalize(pose[:, 3:])),
        **_split(("vx", "vy", "vz"), motion.velocity[row, actor]),
        **_split(("wx", "wy", "wz"), motion.body_rate[row, actor]),
    }


def box_rows(arrays: SceneArrays, boxes: Boxes) -> Columns:
    """Return the `boxes` table: every vehicle that is present."""
    label = np.array([a.label for a in arrays.actors], dtype=object)
    agent = np.array([a.name if a.role in AGENT_ROLES else None for a in arrays.actors], dtype=object)
    return {
        "frame": boxes.frame.astype(np.int32),
        "object_id": boxes.object_id,
        "category": label[boxes.actor],
        "agent": agent[boxes.actor],
        **_split(("x", "y", "z"), boxes.pose[:, :3]),
        **_split(("yaw", "pitch", "roll"), boxes.ypr),
        **_split(("length", "width", "height"), boxes.size),
        **_split(("vx", "vy", "vz"), boxes.velocity),
    }


def imu_rows(arrays: SceneArrays, sensor: str, imu: ImuBatch) -> Columns:
    """Return rows of the `imu` table for one sensor."""
    return {
        "frame": imu.frame.astype(np.int32),
        "agent": _names(arrays, imu.actor),
        "sensor": sensor,
        **_split(("ax", "ay", "az"), imu.accel.astype(np.float32)),
        **_split(("gx", "gy", "gz"), imu.gyro.astype(np.float32)),
        **_split(("ax_true", "ay_true", "az_true"), imu.accel_true),
        **_split(("gx_true", "gy_true", "gz_true"), imu.gyro_true),
    }


def lidar_rows(arrays: SceneArrays, sensor: str, views: Views, points: LidarBatch) -> Columns:
    """Return rows of the `lidar` table for one sensor: one sweep a row."""
    offsets = pa.array(points.offsets)

    def lists(values: np.ndarray) -> pa.Array:
        flat = pa.array(np.ascontiguousarray(values))
        return pa.ListArray.from_arrays(offsets, flat, type=pa.list_(pa.field("element", flat.type, nullable=False)))

    return {
        "frame": views.frame.astype(np.int32),
        "agent": _names(arrays, views.actor),
        "sensor": sensor,
        "point_count": np.diff(points.offsets).astype(np.int32),
        **{name: lists(getattr(points, name)) for name in ("x", "y", "z", "intensity", "ring", "object_id")},
    }


def visibility_rows(arrays: SceneArrays, sensor: str, views: Views, hits: LidarHits) -> Columns:
    """Return rows of the `box_visibility` table for one LiDAR: every vehicle that a sweep has a return from."""
    vehicles = np.array([i for i, actor in enumerate(arrays.actors) if actor.role in BOX_ROLES], dtype=np.int32)
    object_id = np.array([arrays.actors[i].object_id for i in vehicles], dtype=np.int32)
    counts = count_returns(hits.offsets, hits.object_id, object_id)
    view, column = np.nonzero(counts)
    return {
        "frame": views.frame[view].astype(np.int32),
        "agent": _names(arrays, views.actor[view]),
        "sensor": sensor,
        "object_id": object_id[column],
        "lidar_points": counts[view, column],
    }


def depth_rows(
    arrays: SceneArrays, sensor: str, views: Views, images: Sequence[Future[bytes]], scenario: str, weather: str
) -> Columns:
    """Return rows of the `depth` table for one sensor: one image a row, which a thread may still be encoding."""
    agents = _names(arrays, views.actor)
    paths = [
        f"{scenario}/{weather}/{agent}/{frame:06d}_{sensor}.png"
        for agent, frame in zip(agents, views.frame, strict=True)
    ]
    return {
        "frame": views.frame.astype(np.int32),
        "agent": agents,
        "sensor": sensor,
        "image": list(zip(images, paths, strict=True)),
    }


def resolved(columns: Columns) -> Columns:
    """Return columns with every image that a thread was encoding."""
    if "image" not in columns:
        return columns
    return {**columns, "image": [(image.result(), path) for image, path in columns["image"]]}


def link_rows(arrays: SceneArrays, links: Links, paths: Paths, weather: str) -> Columns:
    """Return the `links` table: every link at every carrier, also those without a path."""
    count, carriers = len(links), len(paths.carriers_hz)
    is_los = np.zeros(count, dtype=bool)
    is_los[paths.link[paths.kind == PATH_LOS]] = True
    power = np.abs(paths.a[weather]) ** 2
    doppler = paths.doppler_hz

    def total(values: np.ndarray) -> np.ndarray:
        out = np.empty((count, carriers))
        for carrier in range(carriers):
            out[:, carrier] = np.bincount(paths.link, weights=values[:, carrier], minlength=count)
        return out

    gain = total(power)
    has = gain > 0
    weight = np.where(has, gain, 1.0)

    def moments(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        mean = total(power * values) / weight
        spread = total(power * (values - mean[paths.link]) ** 2) / weight
        return mean, np.sqrt(spread)

    mean_delay, rms_delay = moments(np.broadcast_to(paths.tau[:, None], power.shape))
    doppler_spread = moments(doppler)[1]
    link, carrier = np.repeat(np.arange(count), carriers), np.tile(np.arange(carriers), count)

    def optional(values: np.ndarray) -> pa.Array:
        return pa.array(values[link, carrier], mask=~has[link, carrier])

    return {
        "frame": links.frame[link],
        "agent": _names(arrays, links.rx_actor[link]),
        "peer": _names(arrays, links.tx_actor[link]),
        "carrier_hz": paths.carriers_hz[carrier],
        "link": np.array(LINK_KINDS, dtype=object)[links.kind[link]],
        "path_count": paths.count[link],
        "is_los": is_los[link],
        "gain_db": optional(10.0 * np.log10(weight)),
        "mean_delay_s": optional(mean_delay),
        "rms_delay_s": optional(rms_delay),
        "doppler_spread_hz": optional(doppler_spread),
    }


def path_rows(arrays: SceneArrays, links: Links, paths: Paths, weather: str) -> Columns:
    """Return the `paths` table: every path at every carrier."""
    count, carriers = len(paths), len(paths.carriers_hz)
    path, carrier = np.repeat(np.arange(count), carriers), np.tile(np.arange(carriers), count)
    link = paths.link[path]
    a, transfer = paths.a[weather][path, carrier], paths.transfer[weather][path, carrier]
    is_there = paths.interaction[path] != 0
    offsets = np.concatenate([[0], np.cumsum(is_there.sum(axis=1))]).astype(np.int32)

    def lists(values: np.ndarray, width: int = 1) -> pa.Array:
        flat = pa.array(np.ascontiguousarray(values[path][is_there]).reshape(-1))
        ends = pa.array(offsets * np.int32(width))
        return pa.ListArray.from_arrays(ends, flat, type=pa.list_(pa.field("element", flat.type, nullable=False)))

    matrix = {
        f"t_{to}{of}_{part}": np.ascontiguousarray(getattr(transfer[:, row, column], word))
        for row, to in enumerate("tp")
        for column, of in enumerate("tp")
        for part, word in (("re", "real"), ("im", "imag"))
    }
    return {
        "frame": links.frame[link],
        "agent": _names(arrays, links.rx_actor[link]),
        "peer": _names(arrays, links.tx_actor[link]),
        "carrier_hz": paths.carriers_hz[carrier],
        "path": paths.index[path],
        "path_id": paths.path_id[path],
        "kind": np.array(PATH_KINDS, dtype=object)[paths.kind[path]],
        "order": paths.order[path],
        "tau_s": paths.tau[path],
        "a_re": np.ascontiguousarray(a.real),
        "a_im": np.ascontiguousarray(a.imag),
        **matrix,
        "aod_az": paths.phi_t[path],
        "aod_ze": paths.theta_t[path],
        "aoa_az": paths.phi_r[path],
        "aoa_ze": paths.theta_r[path],
        "doppler_hz": paths.doppler_hz[path, carrier],
        **{name: values[path, carrier].astype(np.float32) for name, values in paths.loss_db[weather].items()},
        "interactions": lists(paths.interaction),
        "vertices": lists(paths.vertex, 3),
        "objects": lists(paths.object_id),
        "materials": lists(paths.material_id),
        "surfaces": lists(paths.surface),
    }


def static_rows(arrays: SceneArrays, config: Config, scenario: ScenarioConfig) -> dict[str, Columns]:
    """Return the tables of a scenario that no frame changes: `objects`, `sensors`, `materials`."""
    objects = arrays.objects
    materials = [(w, i, m) for w in config.weathers for i, m in enumerate(arrays.materials[w])]
    radio = [m.radio for _, _, m in materials]
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
            "model": [r.model for r in radio],
            "itu": [r.itu or None for r in radio],
            **{
                name: np.array([getattr(r, name) for r in radio], dtype=np.float64)
                for name in ("relative_permittivity", "conductivity", "thickness", "scattering", "xpd")
            },
            "scattering_pattern": [r.scattering_pattern for r in radio],
            "alpha_r": np.array([r.alpha_r for r in radio], dtype=np.int16),
            "alpha_i": np.array([r.alpha_i for r in radio], dtype=np.int16),
            "lobe_share": np.array([r.lobe_share for r in radio], dtype=np.float64),
            "nonvisual_base": [m.nonvisual_base for _, _, m in materials],
            "lidar_reflectance": np.array([m.lidar_reflectance for _, _, m in materials]),
            "color": [np.array(m.color, dtype=np.float32) for _, _, m in materials],
        },
    }


def _sensor_rows(arrays: SceneArrays, config: Config) -> Columns:
    rows: list[Columns] = []
    for actor in arrays.actors:
        if actor.role not in AGENT_ROLES:
            continue
        for sensor in config.sensors:
            if actor.role in sensor.on:
                camera = None
                if isinstance(sensor, DepthConfig):
                    camera = pinhole(sensor.width_px, sensor.height_px, sensor.fov_deg)
                pose = mount_pose(sensor, actor.role)
                params = json.dumps(sensor.model_dump(mode="json"), sort_keys=True)
                rows.append(_sensor_row(actor.name, sensor.name, sensor.type, pose, params, camera))
        if config.channel.enabled:
            position = config.channel.antenna_position_m.get(actor.role, (0.0, 0.0, 0.0))  # type: ignore[call-overload]
            pose = np.array([*position, 0.0, 0.0, 0.0, 1.0])
            params = json.dumps({"pattern": config.channel.pattern, "polarization": config.channel.polarization})
            rows.append(_sensor_row(actor.name, "antenna", "antenna", pose, params, None))
    names = [column.name for column in table_spec("sensors").columns if column.name != "scenario"]
    return {name: [row[name] for row in rows] for name in names}


def _sensor_row(agent: str, sensor: str, type_: str, pose: np.ndarray, params: str, camera: Any) -> Columns:
    place = dict(zip(("x", "y", "z", "qx", "qy", "qz", "qw"), map(float, pose), strict=True))
    names = {"fx": "fx", "fy": "fx", "cx": "cx", "cy": "cy", "width": "width", "height": "height"}  # square pixels
    image = {name: getattr(camera, attribute) if camera else None for name, attribute in names.items()}
    return {"agent": agent, "sensor": sensor, "type": type_, **place, **image, "params": params}
