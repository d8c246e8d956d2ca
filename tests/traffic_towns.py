"""Small towns in code for traffic tests: lanes, connections and a drivable mesh."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from mmw.config import TrafficConfig
from mmw.town.lanes import Lane, LaneGraph


@dataclass(frozen=True)
class TestModel:
    """Stands in for a catalogue entry: the attributes that traffic reads."""

    __test__ = False

    name: str
    label: str
    paints: tuple[str, ...]
    wheelbase: float
    track: float
    wheel_radius: float
    length: float
    width: float
    height: float
    center: tuple[float, float, float]


CATALOG = {
    model.name: model
    for model in (
        TestModel("sedan", "car", ("red", "blue", "white"), 2.8, 1.58, 0.33, 4.75, 1.85, 1.45, (0.05, 0.0, 0.72)),
        TestModel("hatchback", "car", ("red", "green"), 2.6, 1.53, 0.32, 4.2, 1.78, 1.5, (0.0, 0.0, 0.75)),
        TestModel("suv", "car", ("black", "silver"), 2.75, 1.62, 0.36, 4.7, 1.9, 1.75, (0.05, 0.0, 0.87)),
        TestModel("van", "car", ("white",), 3.4, 1.7, 0.35, 5.5, 2.0, 2.4, (0.0, 0.0, 1.2)),
        TestModel("box_truck", "truck", ("white",), 4.2, 1.9, 0.45, 7.4, 2.4, 3.2, (-0.2, 0.0, 1.6)),
    )
}

WIDTH = 3.5

Height = Callable[[np.ndarray, np.ndarray], np.ndarray]


def flat(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return a level surface."""
    return np.zeros(np.broadcast(x, y).shape)


def hill(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Return a road bed that falls by 8 m between 20 m and 76 m north of the origin: 18 % on average, smooth."""
    t = np.clip((y - 20.0) / 70.0, 0.0, 1.0)
    return -8.0 * t**3 * (10 - 15 * t + 6 * t**2) + 0.0 * x


def make_town(
    nodes: dict[str, tuple[float, float]],
    roads: list[tuple],
    trim: float = 12.0,
    height: Height = flat,
    speed: float = 12.0,
    width: float = WIDTH,
) -> LaneGraph:
    """Return lanes and connections. A road is (from, to, lanes a direction, is one-way, points between, priority)."""
    lanes: dict[str, Lane] = {}
    into: dict[str, list[tuple[int, int, int, str, int]]] = {name: [] for name in nodes}
    out: dict[str, list[tuple[int, int, int, str, int]]] = {name: [] for name in nodes}
    for number, (start, end, count, oneway, via, priority) in enumerate(roads):
        reference = _resample(np.array([nodes[start], *via, nodes[end]], float), 1.0)
        along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(reference, axis=0), axis=1))])
        reference = reference[(along >= trim) & (along <= along[-1] - trim)]
        for way, points in enumerate((reference,) if oneway else (reference, reference[::-1])):
            tail, head = (start, end) if way == 0 else (end, start)
            for index in range(count):
                aside = (index + 0.5 - (0.5 * count if oneway else 0)) * width
                name = f"r{number}_{'fb'[way]}{index}"
                beside = [f"r{number}_{'fb'[way]}{n}" if 0 <= n < count else "" for n in (index - 1, index + 1)]
                line = _lift(_offset(points, aside), height)
                lanes[name] = Lane(name, line, width, speed, left=beside[0], right=beside[1])
                into[head].append((number, index, count, name, priority))
                out[tail].append((number, index, count, name, priority))
    for node in nodes:
        for road_in, index_in, count_in, name_in, priority in into[node]:
            targets = []
            for road_out, index_out, count_out, name_out, _ in out[node]:
                if road_out == road_in or (count_in == count_out and index_in != index_out):
                    continue
                name = f"{node}:{name_in}>{name_out}"
                curve = _bezier(lanes[name_in].points[-2:, :2], lanes[name_out].points[:2, :2])
                lanes[name] = Lane(name, _lift(curve, height), width, speed, node, priority, (name_out,))
                targets.append(name)
            lanes[name_in] = replace(lanes[name_in], successors=tuple(targets))
    return LaneGraph(lanes)


def _resample(points: np.ndarray, step: float) -> np.ndarray:
    along = np.concatenate([[0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    at = np.linspace(0, along[-1], int(along[-1] / step) + 2)
    return np.stack([np.interp(at, along, points[:, axis]) for axis in range(2)], axis=1)


def _offset(points: np.ndarray, right: float) -> np.ndarray:
    tangent = np.gradient(points, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    return points + right * np.stack([tangent[:, 1], -tangent[:, 0]], axis=1)


def _lift(points: np.ndarray, height: Height) -> np.ndarray:
    return np.column_stack([points, height(points[:, 0], points[:, 1])])


def _bezier(end: np.ndarray, start: np.ndarray) -> np.ndarray:
    before, after = end[1] - end[0], start[1] - start[0]
    reach = 0.39 * np.linalg.norm(start[0] - end[1])
    one = end[1] + reach * before / np.linalg.norm(before)
    two = start[0] - reach * after / np.linalg.norm(after)
    t = np.linspace(0, 1, 25)[:, None]
    return (1 - t) ** 3 * end[1] + 3 * t * (1 - t) ** 2 * one + 3 * t**2 * (1 - t) * two + t**3 * start[0]


def arc(center: tuple[float, float], radius: float, first_deg: float, last_deg: float) -> list[tuple[float, float]]:
    """Return points of an arc without its ends, every degree."""
    angle = np.radians(np.linspace(first_deg, last_deg, int(abs(last_deg - first_deg)) + 1)[1:-1])
    return [(center[0] + radius * np.cos(a), center[1] + radius * np.sin(a)) for a in angle]


def crossroad(height: Height = flat) -> LaneGraph:
    """Return a crossroad whose four arms are joined by a ring road of 90 m radius."""
    nodes = {"X": (0.0, 0.0), "E": (90.0, 0.0), "N": (0.0, 90.0), "W": (-90.0, 0.0), "S": (0.0, -90.0)}
    roads = [("X", name, 1, False, [], 0) for name in "ENWS"]
    corners = ["E", "N", "W", "S", "E"]
    for index in range(4):
        via = arc((0, 0), 90.0, 90 * index, 90 * index + 90)
        roads.append((corners[index], corners[index + 1], 1, False, via, 1))
    return make_town(nodes, roads, height=height)


def with_lights(graph: LaneGraph, node: str, phases: dict[str, str]) -> LaneGraph:
    """Return a town with traffic lights at a node; `phases` maps the roads that lead to it to their phases."""
    lanes = {}
    for name, lane in graph.lanes.items():
        is_lit = lane.junction == node
        lanes[name] = replace(lane, signal=phases[name.split(":")[1].split("_")[0]]) if is_lit else lane
    return LaneGraph(lanes)


def oval(length: float = 300.0, count: int = 2, speed: float = 14.0) -> LaneGraph:
    """Return a one-way circuit of two straights and two bends of 40 m radius, lanes side by side all the way."""
    nodes = {"A": (0.0, 0.0), "B": (length, 0.0), "C": (length, 80.0), "D": (0.0, 80.0)}
    roads = [
        ("A", "B", count, True, [], 0),
        ("B", "C", count, True, arc((length, 40.0), 40.0, -90, 90), 0),
        ("C", "D", count, True, [], 0),
        ("D", "A", count, True, arc((0.0, 40.0), 40.0, 90, 270), 0),
    ]
    return make_town(nodes, roads, trim=5.0, speed=speed)


def roundabout() -> LaneGraph:
    """Return a two-lane one-way ring of 27.75 m radius with four arms, joined by an outer road."""
    nodes = {}
    roads = []
    for index, name in enumerate("ENWS"):
        a = np.radians(90 * index)
        nodes[f"r{name}"] = (27.75 * np.cos(a), 27.75 * np.sin(a))
        nodes[name] = (110 * np.cos(a), 110 * np.sin(a))
    for index, name in enumerate("ENWS"):
        after = "ENWS"[(index + 1) % 4]
        inner = arc((0, 0), 27.75, 90 * index, 90 * index + 90)
        outer = arc((0, 0), 110.0, 90 * index, 90 * index + 90)
        roads.append((f"r{name}", f"r{after}", 2, True, inner, 2))
        roads.append((f"r{name}", name, 1, False, [], 0))
        roads.append((name, after, 1, False, outer, 1))
    return make_town(nodes, roads, trim=14.0)


def grid(count: int = 4, spacing: float = 90.0, height: Height = flat) -> LaneGraph:
    """Return count x count crossroads, the southern edge through the origin."""
    nodes = {f"n{i}{j}": (spacing * i, spacing * j) for i in range(count) for j in range(count)}
    roads = []
    for i in range(count):
        for j in range(count):
            if i + 1 < count:
                roads.append((f"n{i}{j}", f"n{i + 1}{j}", 1, False, [], 1))
            if j + 1 < count:
                roads.append((f"n{i}{j}", f"n{i}{j + 1}", 1, False, [], 0))
    return make_town(nodes, roads, height=height)


def surface(graph: LaneGraph, height: Height = flat, step: float = 1.5) -> tuple[np.ndarray, np.ndarray]:
    """Return a height field under all lanes as a triangle mesh."""
    points = np.concatenate([lane.points for lane in graph.lanes.values()])
    low, high = points.min(axis=0) - 15, points.max(axis=0) + 15
    x, y = np.arange(low[0], high[0], step), np.arange(low[1], high[1], step)
    xx, yy = np.meshgrid(x, y, indexing="ij")
    vertices = np.column_stack([xx.ravel(), yy.ravel(), height(xx, yy).ravel()])
    corner = (np.arange(len(x) - 1)[:, None] * len(y) + np.arange(len(y) - 1)).ravel()
    a, b, c, d = corner, corner + len(y), corner + len(y) + 1, corner + 1
    return vertices, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]).astype(np.int32)


def demand(**options: Any) -> dict[str, Any]:
    """Return the arguments of an engine: `traffic` of the keys of a `TrafficConfig`, and the others as they are."""
    own = {key: value for key, value in options.items() if key in TrafficConfig.model_fields}
    return {"traffic": TrafficConfig(**own), **{key: value for key, value in options.items() if key not in own}}
