"""Check rows of some frames of each scenario and weather against physics and against each other."""

from collections.abc import Callable, Iterator
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from mmw.channel.paths import LOSSES
from mmw.channel.tables import LINKS
from mmw.config import Config
from mmw.core.constants import FRAME_DT, SPEED_OF_LIGHT
from mmw.core.transforms import make_pose, quaternion_from_ypr
from mmw.dataset import Frame, open_dataset
from mmw.dataset.camera_geometry import from_world, intrinsics_from_row, pose_from_row
from mmw.storage.codecs.images import decode_depth
from mmw.storage.finding import Finding
from mmw.storage.schemas import TABLES

GAIN_DB = 1e-3
"""Largest difference between a line of sight's transfer and Friis' formula [dB]; weather losses are stored rounded to
single precision. Design value."""

DELAY_S = 1e-12
"""Largest difference between a line of sight's delay and distance over c [s], 0.3 mm. Design value."""

MIRROR_M = 0.35
"""Distance by which parts of a vehicle, such as wing mirrors, and four sigma of a LiDAR's range exceed its box [m]:
0.25 + 0.12, rounded down because both are rarely at their limit. Design value."""

STRAY_SHARE = 0.001
"""Share of LiDAR points that may lie outside the boxes of their objects [-]. Design value."""

PARALLAX_M = 0.5
"""Maximum distance of a depth camera or LiDAR from an antenna whose line of sight it can judge [m]. Design value."""

AROUND, MARGIN_M = 1 / 160, 1.0
"""Share of the image's width around the other antenna that must agree, and meters by which depth must differ from its
distance. Design values: 4 of 640 px, by which a parallax of 0.5 m shifts what is 30 m away at 110 deg."""

NEAREST_RETURNS, WINDOW_DEG = 6, 2.5
"""LiDAR returns next to a line that must agree, and how far from it the last of them may be [deg]. Design values."""

SIGHT_SHARE = 0.1
"""Share of the lines of sight that may contradict depth images and LiDAR [-]: parallax, and poles and twigs
between rays. Design value."""


LINK_KEY = LINKS.key[1:]
"""Columns that name a link at a carrier in a frame."""

ENDS = (("agent", "antenna"), ("peer", "peer_antenna"))
"""Columns that name the ends of a link: receiver, transmitter."""


def _link_name(row: dict[str, Any]) -> str:
    """Return the name of the link of a row, for people."""
    return f"{row['agent']} from {row['peer']} at {row['carrier_hz'] / 1e9:g} GHz"


def speed_of(row: dict[str, Any]) -> float:
    """Return the length of vx, vy, vz of a row [m/s]."""
    return float(np.linalg.norm([row[f"v{axis}"] for axis in "xyz"]))


def check_physics(root: str | Path, config: Config, frames_each: int = 5) -> list[Finding]:
    """Return rows of some evenly spaced frames of a complete dataset that contradict physics or each other.

    Lines of sight are compared with Friis' formula, distance over c, and the depth images and sweeps of sensors near an
    antenna; LiDAR points with the boxes of their objects.

    Raises:
        InputError: If the folder is not a dataset.
    """
    data = open_dataset(root)
    if "frames" not in data.tables:
        return []
    findings: list[Finding] = []
    judged: list[tuple[bool, str]] = []
    for scenario, weather, frame in _choose_frames(config, frames_each):
        here = data.frame(scenario, weather, frame)
        findings += [*check_friis(here), *check_boxes(here)]
        judged += judge_lines_of_sight(here)
    wrong = [text for is_right, text in judged if not is_right]
    if len(wrong) > max(SIGHT_SHARE * len(judged), 1):
        findings.append(Finding("sight", "links", f"{len(wrong)} of {len(judged)} links differ, the first: {wrong[0]}"))
    return findings


def _place(here: Frame, table: str) -> str:
    """Return where rows of a table come from, for people."""
    weather = f"/weather={here.weather}" if TABLES[table].by_weather else ""
    return f"{table}/scenario={here.scenario}{weather} frame {here.frame}"


def _choose_frames(config: Config, frames_each: int) -> Iterator[tuple[str, str, int]]:
    for scenario in config.scenarios:
        frames = config.frames_of(scenario)
        places = sorted({round(i) for i in np.linspace(0, frames.count - 1, frames_each)})
        for weather, place in product(config.weathers, places):
            yield scenario.name, weather, frames.start + place


def check_friis(here: Frame) -> Iterator[Finding]:
    """Yield lines of sight whose transfer or delay is not that of free space, and links that contradict their paths.

    The singular values of the 2x2 transfer, without the losses of weather and foliage, are lambda / (4 pi d).

    Source: H. T. Friis, "A note on a simple transmission formula", Proc. IRE 34 (1946).
    """
    sights: dict[tuple, dict[str, Any]] = {}
    power: dict[tuple, float] = {}
    for row in here.rows("paths"):
        key = tuple(row[name] for name in LINK_KEY)
        power[key] = power.get(key, 0.0) + row["a_re"] ** 2 + row["a_im"] ** 2
        if row["order"] == 0:
            sights[key] = row
    for row in sights.values():
        ends = [here.agents[row[one]].sensor_pose(row[antenna])[:3] for one, antenna in ENDS]
        distance = float(np.linalg.norm(ends[0] - ends[1]))
        where, carrier = _link_name(row), row["carrier_hz"]
        if not abs(row["tau_s"] - distance / SPEED_OF_LIGHT) <= DELAY_S:  # NaN is wrong too
            text = f"{where}: line of sight of {row['tau_s']:.6e} s; the antennas are {distance:.3f} m apart"
            yield Finding("friis", _place(here, "path_geometry"), text)
        parts = [complex(row[f"t_{name}_re"], row[f"t_{name}_im"]) for name in ("tt", "tp", "pt", "pp")]
        values = np.linalg.svd(np.array(parts).reshape(2, 2), compute_uv=False)
        free = 20.0 * np.log10(SPEED_OF_LIGHT / carrier / (4.0 * np.pi * distance))
        lost = sum(row.get(name, 0.0) for name in LOSSES)  # before schema 3.1 there is no foliage_db
        with np.errstate(divide="ignore"):
            found = 20.0 * np.log10(values) + lost
        if not np.abs(found - free).max() <= GAIN_DB:
            text = f"{where}: line of sight of {found[0]:.3f} and {found[1]:.3f} dB; Friis gives {free:.3f} dB"
            yield Finding("friis", _place(here, "path_gains"), text)
    for link in here.rows("links"):
        key, where = tuple(link[name] for name in LINK_KEY), _link_name(link)
        if link["is_los"] != (key in sights):
            text = (
                f"{where}: is_los is {link['is_los']}, but paths {'have' if key in sights else 'lack'} a line of sight"
            )
            yield Finding("sight", _place(here, "links"), text)
        state = _los_state(sights.get(key))
        if link.get("los_state", state) != state:
            text = f"{where}: los_state is {link['los_state']}; its paths say {state}"
            yield Finding("sight", _place(here, "links"), text)
        total = 10.0 * np.log10(power[key]) if power.get(key) else None
        stored = link["gain_db"]
        if not np.allclose(*np.array([total, stored], float), rtol=0.0, atol=GAIN_DB, equal_nan=True):  # None is NaN
            yield Finding("friis", _place(here, "links"), f"{where}: gain_db is {stored}; its paths sum to {total}")


def _los_state(sight: dict[str, Any] | None) -> str:
    """Return the state of a link from the row of its line of sight, None for no such row."""
    if sight is None:
        return "blocked"
    return "foliage" if sight.get("foliage_db") else "clear"


def check_boxes(here: Frame) -> Iterator[Finding]:
    """Yield boxes that do not contain the LiDAR points of their objects."""
    boxes = {row["object_id"]: row for row in here.rows("boxes")}
    if not boxes:
        return
    sweeps = [(agent, sweep) for agent in here.agents.values() for sweep in agent.sweeps.values()]
    for agent, sweep in sweeps:
        rolls = '"rolling": true' in agent.sensors[sweep.sensor]["params"]
        world, checked, stray = sweep.world, 0, dict[int, int]()
        for object_id in np.intersect1d(sweep["object_id"], list(boxes)):
            box = boxes[int(object_id)]
            turn = quaternion_from_ypr(box["yaw"], box["pitch"], box["roll"])
            middle = make_pose([box[axis] for axis in "xyz"], turn)
            on_it = np.abs(from_world(middle, world[sweep["object_id"] == object_id]))
            reach = 0.5 * np.array([box["length"], box["width"], box["height"]]) + MIRROR_M
            if rolls:  # a point of a sweep is where its object was up to a frame before
                reach = reach + FRAME_DT * (speed_of(box) + speed_of(agent.row))
            outside = int((~(on_it <= reach)).any(axis=1).sum())
            checked += len(on_it)
            if outside:
                stray[int(object_id)] = outside
        if sum(stray.values()) > STRAY_SHARE * checked:
            worst = max(stray, key=lambda name: stray[name])
            text = f"{sum(stray.values())} of {checked} points of {agent.name} {sweep.sensor} lie outside"
            yield Finding("box", _place(here, "lidar"), f"{text} the boxes of their objects, most of object {worst}")


def judge_lines_of_sight(here: Frame) -> Iterator[tuple[bool, str]]:
    """Yield, for each link that a depth image or LiDAR of one of its ends can judge, whether `is_los` agrees.

    Lines through foliage are not judged: light and radio waves do not pass it alike.
    """
    rows = [row for row in here.rows("links") if row.get("los_state") != "foliage"]
    links = {tuple(row[name] for pair in ENDS for name in pair): row["is_los"] for row in rows}
    if not links:
        return
    for name, sensor, is_free_in in (*_depth_observers(here), *_lidar_observers(here)):
        agent = here.agents[name]
        for (rx, rx_antenna, tx, tx_antenna), is_los in links.items():
            if name not in (rx, tx):
                continue
            own, other = (rx_antenna, (tx, tx_antenna)) if name == rx else (tx_antenna, (rx, rx_antenna))
            mounts = [pose_from_row(agent.sensors[one])[:3] for one in (sensor, own) if one in agent.sensors]
            if len(mounts) < 2 or np.linalg.norm(mounts[0] - mounts[1]) > PARALLAX_M:
                continue
            other = here.agents[other[0]].sensor_pose(other[1])[:3]
            is_free = is_free_in(from_world(agent.sensor_pose(sensor), other))
            if is_free is not None:
                text = f"{rx} from {tx} in {_place(here, 'links')}: is_los is {is_los}, but {sensor} of {name} sees "
                yield is_free == is_los, text + ("past its antenna" if is_free else "something before it")


Observer = Callable[[np.ndarray], bool | None]
"""Point in the sensor frame [m], shape [3] -> whether the line to it is free; None if that cannot be decided."""


def _depth_observers(here: Frame) -> Iterator[tuple[str, str, Observer]]:
    """Yield agent and name of each depth camera, and its judgement of lines."""
    for row in here.rows("depth"):
        if row["image"]:
            mount = here.agents[row["agent"]].sensors[row["sensor"]]
            yield row["agent"], row["sensor"], partial(_in_depth, decode_depth(row["image"]["bytes"]), mount)


def _in_depth(depth: np.ndarray, mount: dict[str, Any], point: np.ndarray) -> bool | None:
    if point[0] < MARGIN_M:
        return None
    lens = intrinsics_from_row(mount)
    u, v = int(lens.cx - lens.fx * point[1] / point[0]), int(lens.cy - lens.fy * point[2] / point[0])
    around = max(round(AROUND * mount["width"]), 1)
    if not (around <= u < mount["width"] - around and around <= v < mount["height"] - around):
        return None
    return _agree(depth[v - around : v + around + 1, u - around : u + around + 1], point[0])


def _lidar_observers(here: Frame) -> Iterator[tuple[str, str, Observer]]:
    """Yield agent and name of each LiDAR, and the judgement of its returns on surfaces."""
    for agent in here.agents.values():
        for name, sweep in agent.sweeps.items():
            yield agent.name, name, partial(_in_sweep, sweep.points[sweep["label"] == 0].astype(np.float64))


def _in_sweep(points: np.ndarray, point: np.ndarray) -> bool | None:
    reach, distance = np.linalg.norm(points, axis=1), float(np.linalg.norm(point))
    if len(points) < NEAREST_RETURNS or distance < MARGIN_M:
        return None
    cosine = points @ point / np.maximum(reach * distance, MARGIN_M**2 * 1e-6)
    near = np.argpartition(-cosine, NEAREST_RETURNS - 1)[:NEAREST_RETURNS]
    if cosine[near].min() < np.cos(np.radians(WINDOW_DEG)):
        return None
    return _agree(reach[near], distance)


def _agree(seen: np.ndarray, distance: float) -> bool | None:
    """Return whether all of some distances [m] lie beyond a place, None if they disagree or are close to it."""
    if (seen > distance + MARGIN_M).all():
        return True
    return False if (seen < distance - MARGIN_M).all() else None
