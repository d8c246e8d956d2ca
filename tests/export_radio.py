"""A made-up dataset with radio tables for the tests of exporters: antennas in any attitude, lines of sight in closed
form, reflections with random gains and directions, links without a path."""

import json
from pathlib import Path

import numpy as np
import pyarrow as pa

from mmw.poses import quaternion_from_ypr, rotate
from mmw.tables.manifest import finalize, prepare_root
from mmw.tables.writer import ShardKey, write_scenario, write_shard
from tests.path_tables import sight
from tests.shards import META, make_shard, make_statics, normal

SCENARIO, WEATHER = "Town03_made_up", "rainy"
CARRIERS = (4.9e9, 28e9)
CAVS = ("cav_1", "cav_2", "cav_3")
AGENTS = (*CAVS, "rsu_1")
MOUNT = {"cav": (0.3, -0.2, 2.5), "rsu": (0.0, 0.0, 4.0)}
BLOCKED = (1, "cav_2", "rsu_1")
"""Frame, receiver and transmitter of a link without a path."""
GNSS = {"mode": "compat", "reference_latitude_deg": 49.0, "reference_longitude_deg": 8.0, "reference_altitude_m": 0.0}
CHANNEL = {"max_depth": 2, "specular": True, "diffraction": False, "diffuse": True, "refraction": False, "rays": 1000}


def make_dataset(root: Path, frames: int = 4, paths: int = 5) -> Path:
    """Write a dataset whose links all have `paths` paths or, where blocked, none; every table of `make_shard`."""
    town = {"name": SCENARIO, "town": "town03", "rsus": [{"name": "rsu_1"}]}
    identity = {"seed": 42, "weathers": [WEATHER], "channel": CHANNEL, "scenarios": [town]}
    prepare_root(root, identity, META["config_sha256"], {"mmw": "0.1.0"}, False)
    key = ShardKey(SCENARIO, WEATHER, 0, frames)
    rng = np.random.default_rng(5)
    tables = make_shard(key)
    tables["poses"] = _poses(rng, frames)
    tables["links"], tables["paths"] = _radio(rng, tables["poses"], frames, paths)
    write_scenario(root, SCENARIO, _statics(rng), META)
    write_shard(root, key, tables, META)
    finalize(root)
    return root


def antenna(poses: dict, frame: int, agent: str) -> np.ndarray:
    """Return where the antenna of an agent is [m], shape [3]."""
    row = frame * len(AGENTS) + AGENTS.index(agent)
    q = [poses[name][row] for name in ("qx", "qy", "qz", "qw")]
    return rotate(q, MOUNT[agent[:3]]) + [poses[axis][row] for axis in "xyz"]


def _poses(rng: np.random.Generator, frames: int) -> dict:
    """Return poses: CAVs in any attitude, the roadside unit still."""
    count = frames * len(AGENTS)
    is_rsu = np.tile([name[:3] == "rsu" for name in AGENTS], frames)
    place = rng.uniform(-80, 80, (count, 3)) * [1, 1, 0.05]
    angles = rng.uniform(-1.2, 1.2, (3, count))
    place[is_rsu], angles[:, is_rsu] = (10.0, -20.0, 0.5), np.array([[2.0], [0.1], [-0.2]])
    q = quaternion_from_ypr(*angles)
    still = np.where(is_rsu, 0.0, 1.0)
    return {
        "frame": np.repeat(np.arange(frames), len(AGENTS)),
        "agent": np.tile(AGENTS, frames),
        "role": [name[:3] for name in np.tile(AGENTS, frames)],
        "object_id": np.tile([10, 11, 12, 15], frames),
        **dict(zip("xyz", place.T, strict=True)),
        **dict(zip(("qx", "qy", "qz", "qw"), q.T, strict=True)),
        **{name: values * still for name, values in normal(rng, count, "vx vy vz wx wy wz").items()},
    }


def _radio(rng: np.random.Generator, poses: dict, frames: int, each: int) -> tuple[dict, dict]:
    """Return links from the roadside unit and between the first two CAVs, and their paths."""
    ends = [*((cav, "rsu_1") for cav in CAVS), ("cav_1", "cav_2"), ("cav_2", "cav_1")]
    keys = [(frame, *pair, carrier) for frame in range(frames) for pair in ends for carrier in CARRIERS]
    has_path = np.array([key[:3] != BLOCKED for key in keys])
    columns = dict(zip(("frame", "agent", "peer", "carrier_hz"), map(list, zip(*keys, strict=True)), strict=True))
    links = {
        **columns,
        "link": ["v2i" if pair[1] == "rsu_1" else "v2v" for _, *pair, _ in keys],
        "path_count": np.where(has_path, each, 0),
        "is_los": has_path,
        **dict.fromkeys(
            ("gain_db", "mean_delay_s", "rms_delay_s", "doppler_spread_hz"), pa.nulls(len(keys), pa.float64())
        ),
    }
    rows: list[dict] = []
    for frame, agent, peer, carrier in (key for key, has in zip(keys, has_path, strict=True) if has):
        line = sight(antenna(poses, frame, peer)[None], antenna(poses, frame, agent)[None], carrier)
        for path in range(each):
            count = 0 if path == 0 else 1 + path % 2
            gain = line.transfer[0] if path == 0 else rng.normal(0, 2e-6, (2, 2)) + 1j * rng.normal(0, 2e-6, (2, 2))
            aod, aoa = ((line.phi_t[0], line.theta_t[0]), (line.phi_r[0], line.theta_r[0])) if path == 0 else (
                (rng.uniform(-np.pi, np.pi), rng.uniform(0.1, 3.0)) for _ in range(2))  # fmt: skip
            rows.append({
                "frame": frame, "agent": agent, "peer": peer, "carrier_hz": carrier, "path": path,
                "path_id": 7_000_000_000_000_000_000 + path, "kind": ("los", "specular", "diffuse")[count],
                "order": count, "tau_s": line.tau[0] + path * rng.uniform(1e-8, 3e-7),
                "a_re": gain[0, 0].real, "a_im": gain[0, 0].imag,
                **{f"t_{'tp'[r]}{'tp'[t]}_{part}": getattr(gain[r, t], kind)
                   for r in range(2) for t in range(2) for part, kind in (("re", "real"), ("im", "imag"))},
                "aod_az": aod[0], "aod_ze": aod[1], "aoa_az": aoa[0], "aoa_ze": aoa[1],
                "doppler_hz": rng.uniform(-800, 800), "rain_db": 0.1, "fog_db": 0.0, "gas_db": 0.0,
                "interactions": [1, 2][:count], "vertices": rng.normal(0, 30, 3 * count).tolist(),
                **{name: [20, 21][:count] for name in ("objects", "materials", "surfaces")},
            })  # fmt: skip
    return links, {name: [row[name] for row in rows] for name in rows[0]}


def _statics(rng: np.random.Generator) -> dict:
    """Return static tables: an antenna and a LiDAR on every agent, a camera on all, depth and radar on the RSU."""
    sensors = [(agent, name, kind) for agent in AGENTS for name, kind in (
        ("antenna", "antenna"), ("lidar", "lidar"), ("front", "rgb"), ("radar", "radar"), ("depth", "depth"),
        ("imu", "imu"), ("gnss", "gnss")) if kind not in ("depth",) or agent == "rsu_1"]  # fmt: skip
    is_camera = [kind in ("rgb", "depth") for _, _, kind in sensors]
    place = np.array(
        [MOUNT[agent[:3]] if kind in ("antenna", "lidar") else (1.5, 0.0, 2.4) for agent, _, kind in sensors]
    )
    statics = make_statics()
    statics["materials"] |= {"weather": WEATHER, "relative_permittivity": 4.5, "conductivity": 0.02}
    return statics | {
        "sensors": {
            "agent": [agent for agent, _, _ in sensors],
            "sensor": [name for _, name, _ in sensors],
            "type": [kind for _, _, kind in sensors],
            **dict(zip("xyz", place.T, strict=True)),
            **dict.fromkeys(("qx", "qy", "qz"), np.zeros(len(sensors))),
            "qw": np.ones(len(sensors)),
            **{name: [4.0 if camera else None for camera in is_camera] for name in ("fx", "fy", "cx", "cy")},
            "width": [8 if camera else None for camera in is_camera],
            "height": [6 if camera else None for camera in is_camera],
            "lens": ["pinhole" if camera else None for camera in is_camera],
            "coefficients": pa.array([[] if camera else None for camera in is_camera], pa.list_(pa.float64())),
            "params": [json.dumps(GNSS) if kind == "gnss" else "{}" for _, _, kind in sensors],
        },
    }  # fmt: skip
