"""Small made-up shards, with every table, for the tests of tables, writer and dataset."""

import zlib
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pyarrow as pa

from mmw.tables.encode import (
    encode_depth,
    encode_flow,
    encode_instance,
    encode_normals,
    encode_rgb,
    encode_semantic,
)
from mmw.tables.manifest import finalize, prepare_root
from mmw.tables.schema.columns import F32, F64, list_of
from mmw.tables.writer import ShardKey, write_scenario, write_shard

AGENTS = ("cav_1", "cav_2", "cav_3", "rsu_1")
META = {"config_sha256": "c" * 64, "mmw_version": "0.1.0", "git_sha": "abc", "device": "cpu", "seconds": 1.5}
IDENTITY = {"seed": 42, "frames": {"start": 0, "count": 20}, "weathers": ["sunny"]}


def random(key: ShardKey, name: str) -> np.random.Generator:
    return np.random.default_rng([zlib.crc32(f"{key}{name}".encode())])


def owned(key: ShardKey, agents=AGENTS) -> dict:
    frames = np.arange(key.frame_begin, key.frame_end)
    return {"frame": np.repeat(frames, len(agents)), "agent": np.tile(agents, len(frames))}


def normal(rng: np.random.Generator, rows: int, names: str) -> dict:
    """Return one column of normal numbers for each of the space-separated names."""
    return {name: rng.normal(size=rows) for name in names.split()}


def point_lists(rng: np.random.Generator, sizes: list[int], names: str) -> dict:
    """Return one float list column for each of the space-separated names; row k holds `sizes[k]` numbers."""
    return {name: [np.float32(rng.normal(size=size)) for size in sizes] for name in names.split()}


def lists_or_null(rows: list) -> pa.Array:
    """Return a float list column whose None rows are null."""
    return pa.array(rows, list_of(F32))


def visibility_columns(rng: np.random.Generator, agents: dict) -> dict:
    """Return what each agent's LiDAR, radar, camera and antenna have of vehicle 14, at most one row a sensor and agent:
    a sensor knows its own column alone, and the antenna's line is free or blocked by the town."""
    known = {"lidar": "lidar_points", "radar": "radar_points", "depth": "pixels"}
    sensors = [*known, "antenna"]
    rows = len(agents["frame"])
    each = np.tile(sensors, rows)
    counts = rng.integers(1, 9, len(each)).tolist()
    is_free = [bool(count % 2) if sensor == "antenna" else None for sensor, count in zip(each, counts, strict=True)]
    return {
        **{name: np.repeat(values, len(sensors)) for name, values in agents.items()},
        "sensor": each,
        "object_id": 14,
        **{
            column: [count if by == sensor else None for by, count in zip(each, counts, strict=True)]
            for sensor, column in known.items()
        },
        "is_los": is_free,
        "blocker_id": [0 if free is False else None for free in is_free],
    }


def radar_columns(rng: np.random.Generator, agents: dict, points: int) -> dict:
    """Return samples of two radars an agent: `radar`, and CARLA's `radar_2`, which knows no power."""
    sensors = ("radar", "radar_2")
    sizes = rng.integers(0, points + 1, len(sensors) * len(agents["frame"])).tolist()
    is_known = np.tile([True, False], len(agents["frame"]))
    powers = point_lists(rng, sizes, "power_db snr_db rcs_dbsm")
    return {
        **{name: np.repeat(values, len(sensors)) for name, values in agents.items()},
        "sensor": np.tile(sensors, len(agents["frame"])),
        "point_count": sizes,
        **point_lists(rng, sizes, "range azimuth elevation velocity"),
        **{
            name: lists_or_null([row if known else None for row, known in zip(rows, is_known, strict=True)])
            for name, rows in powers.items()
        },
        "object_id": [rng.integers(-1, 15, size) for size in sizes],
        "label": [rng.integers(0, 3, size) for size in sizes],
    }


def make_shard(key: ShardKey, points: int = 50, height: int = 6, width: int = 8) -> dict:
    """Return columns of every framed table for four agents; V2I links at two carriers, CAV 3 without any path."""
    frames = np.arange(key.frame_begin, key.frame_end)
    count = len(frames)
    rng = random(key, "rows")
    agents = owned(key)
    rows = len(agents["frame"])
    cavs = owned(key, AGENTS[:3])
    rsus = owned(key, AGENTS[3:])
    clouds = [rng.normal(0, 30, (rng.integers(0, points + 1), 3)) for _ in range(rows)]
    depths = [np.where(rng.random((height, width)) < 0.2, 0.0, rng.uniform(0, 600, (height, width))) for _ in frames]
    seen = [rng.integers(-1, 15, (height, width), dtype=np.int32) for _ in frames]
    links = {name: np.repeat(values, 2) for name, values in cavs.items()}
    carriers = np.tile([4.9e9, 28e9], 3 * count)
    has_path = links["agent"] != "cav_3"
    paths = {name: np.repeat(values[has_path], 2) for name, values in links.items()}
    path_rows = len(paths["frame"])
    path = np.tile([0, 1], path_rows // 2)
    return {
        "frames": {
            "frame": frames,
            "time_s": frames / 100,
            "cav_count": 3,
            "rsu_count": 1,
            "vehicle_count": 5,
            "pedestrian_count": 0,
            "seed": 42,
        },
        "poses": {
            **agents,
            "role": [name[:3] for name in agents["agent"]],
            "object_id": np.tile([10, 11, 12, 15], count),
            **normal(rng, rows, "x y z qx qy qz qw vx vy vz wx wy wz"),
        },
        "boxes": {
            "frame": np.repeat(frames, 5),
            "object_id": np.tile(np.arange(10, 15), count),
            "category": "car",
            "agent": np.tile(np.array(["cav_1", "cav_2", "cav_3", None, None], dtype=object), count),
            **normal(rng, 5 * count, "x y z yaw pitch roll length width height vx vy vz"),
        },
        "box_visibility": visibility_columns(rng, agents),
        "imu": {
            **cavs,
            "sensor": "imu",
            "handedness": "right",
            **normal(rng, 3 * count, "ax ay az gx gy gz ax_true ay_true az_true gx_true gy_true gz_true"),
            **normal(rng, 3 * count, "ax_bias ay_bias az_bias gx_bias gy_bias gz_bias compass"),
        },
        "gnss": {
            **cavs,
            "sensor": "gnss",
            **normal(rng, 3 * count, "latitude_deg longitude_deg altitude_m v_east v_north v_up speed heading"),
            **normal(rng, 3 * count, "latitude_true_deg longitude_true_deg altitude_true_m"),
        },
        "lidar": {
            **agents,
            "sensor": "lidar",
            "point_count": [len(cloud) for cloud in clouds],
            **{
                axis: [np.float32(np.rint(cloud[:, i] * 1024) / 1024) for cloud in clouds]
                for i, axis in enumerate("xyz")
            },
            "intensity": [np.float32(rng.integers(0, 257, len(cloud)) / 256) for cloud in clouds],
            "ring": [np.sort(rng.integers(0, 64, len(cloud))) for cloud in clouds],
            "object_id": [rng.integers(0, 15, len(cloud)) for cloud in clouds],
            "label": [rng.integers(0, 3, len(cloud)) for cloud in clouds],
            "time_offset": [np.float32(rng.uniform(-0.01, 0.0, len(cloud))) for cloud in clouds],
            "return_number": [rng.integers(0, 2, len(cloud)) for cloud in clouds],
            **{
                f"flow_{axis}": lists_or_null(
                    [np.float32(rng.normal(size=len(cloud))) if k % 4 else None for k, cloud in enumerate(clouds)]
                )
                for axis in "xyz"
            },
        },
        "rgb": {
            **agents,
            "sensor": "front",
            "image": [
                (encode_rgb(rng.integers(0, 256, (height, width, 3), dtype=np.uint8), "png", 95), f"{k}.png")
                for k in range(rows)
            ],
            "format": "png",
            **normal(rng, rows, "exposure ev100"),
        },
        "depth": {
            **rsus,
            "sensor": "depth",
            "image": [
                (encode_depth(np.uint16(depth * 100)), f"rsu_1_{frame:06d}.png")
                for frame, depth in zip(frames, depths, strict=True)
            ],
            "depth_m": lists_or_null([np.float32(depth.ravel()) if k % 2 else None for k, depth in enumerate(depths)]),
        },
        "radar": radar_columns(rng, agents, points),
        "radar_maps": {
            **rsus,
            "sensor": "radar",
            "kind": "range_azimuth",
            "rows": 2,
            "columns": 3,
            **normal(rng, count, "row_first row_step column_first column_step"),
            "values": [rng.normal(-120, 5, 6).astype(np.float32) for _ in frames],
        },
        "radar_iq": {
            **rsus,
            "sensor": "radar",
            "antennas": 2,
            "chirps": 1,
            "samples": 3,
            **{name: [rng.normal(size=6).astype(np.float32) for _ in frames] for name in "iq"},
        },
        "segmentation": {
            **rsus,
            "sensor": "depth",
            "instance": [
                (encode_instance(ids), f"rsu_1_{frame:06d}_i.png") for frame, ids in zip(frames, seen, strict=True)
            ],
            "semantic": [
                (encode_semantic(ids, np.arange(17, dtype=np.uint8)), f"rsu_1_{frame:06d}_s.png")
                for frame, ids in zip(frames, seen, strict=True)
            ],
        },
        "normals": {
            **rsus,
            "sensor": "front",
            "image": [
                (encode_normals(np.full((height, width, 3), (0.0, 0.6, 0.8), np.float32)), f"{k}_n.png")
                for k in range(count)
            ],
        },
        "flow": {
            **rsus,
            "sensor": "front",
            "image": [
                (encode_flow(np.float32(rng.normal(size=(height, width, 2)))), f"{k}_f.png") for k in range(count)
            ],
        },
        "boxes_2d": {
            **rsus,
            "sensor": "depth",
            "object_id": 14,
            "pixels": np.arange(count) % 3,
            **{
                name: [value if k % 3 else None for k, value in enumerate(rng.integers(0, 640, count).tolist())]
                for name in ("u_min", "v_min", "u_max", "v_max")
            },
            **normal(rng, count, "amodal_u_min amodal_v_min amodal_u_max amodal_v_max truncation distance"),
        },
        "links": {
            **links,
            "peer": "rsu_1",
            "carrier_hz": carriers,
            "link": "v2i",
            "path_count": np.where(has_path, 2, 0),
            "is_los": has_path,
            **{
                name: [value if has else None for value, has in zip(values.tolist(), has_path, strict=True)]
                for name, values in normal(
                    rng, len(carriers), "gain_db mean_delay_s rms_delay_s doppler_spread_hz"
                ).items()
            },
        },
        "paths": {
            **paths,
            "peer": "rsu_1",
            "carrier_hz": np.repeat(carriers[has_path], 2),
            "path": path,
            "path_id": path + 1000,
            "kind": np.where(path == 0, "los", "specular"),
            "order": path,
            "tau_s": rng.uniform(1e-7, 1e-6, path_rows),
            **normal(
                rng,
                path_rows,
                "a_re a_im t_tt_re t_tt_im t_tp_re t_tp_im t_pt_re t_pt_im t_pp_re t_pp_im "
                "aod_az aod_ze aoa_az aoa_ze doppler_hz",
            ),
            **{name: rng.uniform(0, 1, path_rows).astype(np.float32) for name in ("rain_db", "fog_db", "gas_db")},
            "interactions": [np.ones(order, dtype=np.int8) for order in path],
            "vertices": [rng.normal(size=3 * order) for order in path],
            **{name: [np.arange(order) for order in path] for name in ("objects", "materials", "surfaces")},
        },
    }


def make_statics() -> dict:
    """Return columns of every static table."""
    rng = np.random.default_rng(0)
    return {
        "objects": {
            "object_id": [0, 10],
            "prim_path": ["/World/Town/Roads/r1", "/World/Actors/cav_1"],
            "label": ["road", "car"],
            "tag": [1, 14],
            "actor": [None, "cav_1"],
            "materials": [["asphalt"], ["car_paint_red", "car_glass"]],
        },
        "sensors": {
            "agent": ["cav_1", "rsu_1"],
            "sensor": ["lidar", "depth"],
            "type": ["lidar", "depth"],
            **normal(rng, 2, "x y z qx qy qz"),
            "qw": np.ones(2),
            **{name: [None, 224.0] for name in ("fx", "fy", "cx", "cy")},
            "width": [None, 640],
            "height": [None, 480],
            "lens": [None, "fisheye"],
            "coefficients": pa.array([None, [0.1, -0.02, 0.003, 0.0]], list_of(F64)),
            "params": "{}",
        },
        "materials": {
            "weather": "sunny",
            "material_id": [0, 1],
            "name": ["asphalt", "car_rubber"],
            "model": ["itu", "constant"],
            "itu": ["itu_very_dry_ground", None],
            **normal(rng, 2, "relative_permittivity conductivity thickness scattering xpd"),
            "scattering_pattern": ["lambertian", "directive"],
            "alpha_r": [4, 2],
            "alpha_i": [4, 2],
            "lobe_share": [1.0, 0.5],
            "nonvisual_base": ["asphalt", "rubber"],
            "lidar_reflectance": [0.17, 0.05],
            "color": [[0.1, 0.1, 0.1], [0, 0, 0]],
        },
    }


def write_made_up(root: Path, keys: Sequence[ShardKey]) -> Path:
    """Write a finished dataset of made-up shards and return its folder."""
    prepare_root(root, IDENTITY, META["config_sha256"], {"mmw": "0.1.0", "git": "abc"}, False)
    for name in dict.fromkeys(key.scenario for key in keys):
        write_scenario(root, name, make_statics(), META)
    for key in keys:
        write_shard(root, key, make_shard(key), META)
    finalize(root)
    return root
