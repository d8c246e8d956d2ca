"""Small made-up shards, with every table, for the tests of tables, writer and dataset."""

import zlib

import numpy as np

from mmw.tables.encode import encode_depth
from mmw.tables.writer import ShardKey

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
        "box_visibility": {
            **agents,
            "sensor": "lidar",
            "object_id": 14,
            "lidar_points": rng.integers(1, 9, rows),
        },
        "imu": {
            **cavs,
            "sensor": "imu",
            **normal(rng, 3 * count, "ax ay az gx gy gz ax_true ay_true az_true gx_true gy_true gz_true"),
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
        },
        "depth": {
            **rsus,
            "sensor": "depth",
            "image": [
                (encode_depth(np.uint16(depth * 100)), f"rsu_1_{frame:06d}.png")
                for frame, depth in zip(frames, depths, strict=True)
            ],
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
