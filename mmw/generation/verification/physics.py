"""Check rows of some frames of each scenario and weather against physics and against each other."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np

from mmw.core.constants import FRAME_DT, SPEED_OF_LIGHT
from mmw.core.transforms import compose, invert, make_pose, quaternion_from_ypr, transform_points
from mmw.dataset import Dataset, open_dataset
from mmw.storage.codecs.images import decode_depth
from mmw.storage.file_checks import Finding

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
"""Share of the image's width around the other antenna that must agree, and metres by which depth must differ from its
distance. Design values: 4 of 640 px, by which a parallax of 0.5 m shifts what is 30 m away at 110 deg."""

NEAREST_RETURNS, WINDOW_DEG = 6, 2.5
"""LiDAR returns next to a line that must agree, and how far from it the last of them may be [deg]. Design values."""

SIGHT_SHARE = 0.1
"""Share of the lines of sight that may contradict depth images and LiDAR [-]: parallax, and poles and twigs
between rays. Design value."""


@dataclass(frozen=True)
class Slice:
    """The rows of one frame of one scenario in one weather."""

    data: Dataset
    scenario: str
    weather: str
    frame: int

    def rows(self, table: str, columns: Sequence[str] | None = None) -> list[dict[str, Any]]:
        """Return the rows of a table; none if it has no file."""
        if table not in self.data.tables:
            return []
        frames = range(self.frame, self.frame + 1)
        found = self.data.read(table, scenario=self.scenario, weather=self.weather, frames=frames, columns=columns)
        return found.to_pylist()

    @cached_property
    def agents(self) -> dict[str, dict[str, Any]]:
        """Agent -> row of `poses`."""
        return {row["agent"]: row for row in self.rows("poses")}

    @cached_property
    def mounts(self) -> dict[tuple[str, str], dict[str, Any]]:
        """Agent and sensor -> row of `sensors`."""
        rows = self.data.read("sensors", scenario=self.scenario).to_pylist()
        return {(row["agent"], row["sensor"]): row for row in rows}

    def sensor(self, agent: str, sensor: str) -> np.ndarray:
        """Return the pose of a sensor in the world, shape [7]."""
        return compose(pose_of(self.agents[agent]), pose_of(self.mounts[agent, sensor]))

    def path(self, table: str) -> str:
        """Return where rows of a table come from, for people."""
        return f"{table}/scenario={self.scenario}/weather={self.weather} frame {self.frame}"


def pose_of(row: dict[str, Any]) -> np.ndarray:
    """Return x, y, z, qx, qy, qz, qw of a row, shape [7]."""
    return np.array([row[name] for name in ("x", "y", "z", "qx", "qy", "qz", "qw")])


def speed_of(row: dict[str, Any]) -> float:
    """Return the length of vx, vy, vz of a row [m/s]."""
    return float(np.linalg.norm([row[f"v{axis}"] for axis in "xyz"]))


def check_physics(root: str | Path, frames_each: int = 5) -> list[Finding]:
    """Return rows of some evenly spaced frames that contradict physics or each other.

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
    for scenario, weather, frame in _choose_frames(data, frames_each):
        here = Slice(data, scenario, weather, frame)
        findings += [*check_friis(here), *check_boxes(here)]
        judged += judge_lines_of_sight(here)
    wrong = [text for is_right, text in judged if not is_right]
    if len(wrong) > max(SIGHT_SHARE * len(judged), 1):
        findings.append(Finding("sight", "links", f"{len(wrong)} of {len(judged)} links differ, the first: {wrong[0]}"))
    return findings


def _choose_frames(data: Dataset, frames_each: int) -> Iterator[tuple[str, str, int]]:
    rows = data.read("frames", columns=["scenario", "weather", "frame"])
    frames: dict[tuple[str, str], list[int]] = {}
    columns = [rows.column(name).to_pylist() for name in ("scenario", "weather", "frame")]
    for scenario, weather, frame in zip(*columns, strict=True):
        frames.setdefault((scenario, weather), []).append(frame)
    for key, numbers in frames.items():
        numbers.sort()
        for place in sorted({round(i) for i in np.linspace(0, len(numbers) - 1, frames_each)}):
            yield *key, numbers[place]


def check_friis(here: Slice) -> Iterator[Finding]:
    """Yield lines of sight whose transfer or delay is not that of free space, and links that contradict their paths.

    The singular values of the 2x2 transfer, without the losses of the weather, are lambda / (4 pi d).

    Source: H. T. Friis, "A note on a simple transmission formula", Proc. IRE 34 (1946).
    """
    paths = here.rows("paths")
    sights: dict[tuple[str, str, float], dict[str, Any]] = {}
    power: dict[tuple[str, str, float], float] = {}
    for row in paths:
        key = (row["agent"], row["peer"], row["carrier_hz"])
        power[key] = power.get(key, 0.0) + row["a_re"] ** 2 + row["a_im"] ** 2
        if row["order"] == 0:
            sights[key] = row
    for (agent, peer, carrier), row in sights.items():
        ends = [here.sensor(name, "antenna")[:3] for name in (agent, peer)]
        distance = float(np.linalg.norm(ends[0] - ends[1]))
        where = f"{agent} from {peer} at {carrier / 1e9:g} GHz"
        if abs(row["tau_s"] - distance / SPEED_OF_LIGHT) > DELAY_S:
            text = f"{where}: line of sight of {row['tau_s']:.6e} s; the antennas are {distance:.3f} m apart"
            yield Finding("friis", here.path("paths"), text)
        parts = [complex(row[f"t_{name}_re"], row[f"t_{name}_im"]) for name in ("tt", "tp", "pt", "pp")]
        values = np.linalg.svd(np.array(parts).reshape(2, 2), compute_uv=False)
        free = 20.0 * np.log10(SPEED_OF_LIGHT / carrier / (4.0 * np.pi * distance))
        lost = row["rain_db"] + row["fog_db"] + row["gas_db"]
        with np.errstate(divide="ignore"):
            found = 20.0 * np.log10(values) + lost
        if np.abs(found - free).max() > GAIN_DB:
            text = f"{where}: line of sight of {found[0]:.3f} and {found[1]:.3f} dB; Friis gives {free:.3f} dB"
            yield Finding("friis", here.path("paths"), text)
    for link in here.rows("links"):
        key = (link["agent"], link["peer"], link["carrier_hz"])
        where = f"{key[0]} from {key[1]} at {key[2] / 1e9:g} GHz"
        if link["is_los"] != (key in sights):
            text = (
                f"{where}: is_los is {link['is_los']}, but paths {'have' if key in sights else 'lack'} a line of sight"
            )
            yield Finding("sight", here.path("links"), text)
        total = 10.0 * np.log10(power[key]) if power.get(key) else None
        stored = link["gain_db"]
        if not np.allclose(*np.array([total, stored], float), rtol=0.0, atol=GAIN_DB, equal_nan=True):  # None is NaN
            yield Finding("friis", here.path("links"), f"{where}: gain_db is {stored}; its paths sum to {total}")


def check_boxes(here: Slice) -> Iterator[Finding]:
    """Yield boxes that do not contain the LiDAR points of their objects."""
    boxes = {row["object_id"]: row for row in here.rows("boxes")}
    if not boxes:
        return
    for sweep in here.rows("lidar", ["agent", "sensor", "x", "y", "z", "object_id"]):
        hit = np.array(sweep["object_id"], dtype=np.int64)
        points = np.array([sweep[axis] for axis in "xyz"], dtype=np.float64).T.reshape(-1, 3)
        world = transform_points(here.sensor(sweep["agent"], sweep["sensor"]), points)
        rolls = '"rolling": true' in here.mounts[sweep["agent"], sweep["sensor"]]["params"]
        checked, stray = 0, dict[int, int]()
        for object_id in np.intersect1d(hit, list(boxes)):
            box = boxes[int(object_id)]
            turn = quaternion_from_ypr(box["yaw"], box["pitch"], box["roll"])
            middle = make_pose([box[axis] for axis in "xyz"], turn)
            on_it = np.abs(transform_points(invert(middle), world[hit == object_id]))
            reach = 0.5 * np.array([box["length"], box["width"], box["height"]]) + MIRROR_M
            if rolls:  # a point of a sweep is where its object was up to a frame before
                reach = reach + FRAME_DT * (speed_of(box) + speed_of(here.agents[sweep["agent"]]))
            outside = int((on_it > reach).any(axis=1).sum())
            checked += len(on_it)
            if outside:
                stray[int(object_id)] = outside
        if sum(stray.values()) > STRAY_SHARE * checked:
            worst = max(stray, key=lambda name: stray[name])
            text = f"{sum(stray.values())} of {checked} points of {sweep['agent']} {sweep['sensor']} lie outside"
            yield Finding("box", here.path("lidar"), f"{text} the boxes of their objects, most of object {worst}")


def judge_lines_of_sight(here: Slice) -> Iterator[tuple[bool, str]]:
    """Yield, for each link that a depth image or LiDAR of one of its ends can judge, whether `is_los` agrees."""
    links = {(row["agent"], row["peer"]): row["is_los"] for row in here.rows("links")}
    if not links:
        return
    observers = [*_depth_observers(here), *_lidar_observers(here)]
    for agent, sensor, is_free_in in observers:
        antenna = here.mounts.get((agent, "antenna"))
        mount = pose_of(here.mounts[agent, sensor])
        if antenna is None or np.linalg.norm(mount[:3] - pose_of(antenna)[:3]) > PARALLAX_M:
            continue
        for (rx, tx), is_los in links.items():
            if agent not in (rx, tx):
                continue
            other = here.sensor(tx if agent == rx else rx, "antenna")[:3]
            is_free = is_free_in(transform_points(invert(here.sensor(agent, sensor)), other))
            if is_free is not None:
                text = f"{rx} from {tx} in {here.path('links')}: is_los is {is_los}, but {sensor} of {agent} sees "
                yield is_free == is_los, text + ("past its antenna" if is_free else "something before it")


Observer = Callable[[np.ndarray], bool | None]
"""Point in the sensor frame [m], shape [3] -> whether the line to it is free; None if that cannot be decided."""


def _depth_observers(here: Slice) -> Iterator[tuple[str, str, Observer]]:
    """Yield agent and name of each depth camera, and its judgement of lines."""
    for row in here.rows("depth", ["agent", "sensor", "image"]):
        if row["image"]:
            mount = here.mounts[row["agent"], row["sensor"]]
            yield row["agent"], row["sensor"], partial(_in_depth, decode_depth(row["image"]["bytes"]), mount)


def _in_depth(depth: np.ndarray, mount: dict[str, Any], point: np.ndarray) -> bool | None:
    if point[0] < MARGIN_M:
        return None
    u, v = (int(mount[c] - mount[f] * point[i] / point[0]) for c, f, i in (("cx", "fx", 1), ("cy", "fy", 2)))
    around = max(round(AROUND * mount["width"]), 1)
    if not (around <= u < mount["width"] - around and around <= v < mount["height"] - around):
        return None
    return _agree(depth[v - around : v + around + 1, u - around : u + around + 1], point[0])


def _lidar_observers(here: Slice) -> Iterator[tuple[str, str, Observer]]:
    """Yield agent and name of each LiDAR, and the judgement of its returns on surfaces."""
    for row in here.rows("lidar", ["agent", "sensor", "x", "y", "z", "label"]):
        points = np.array([row[axis] for axis in "xyz"], dtype=np.float64).T.reshape(-1, 3)
        yield row["agent"], row["sensor"], partial(_in_sweep, points[np.array(row["label"], dtype=np.int64) == 0])


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
