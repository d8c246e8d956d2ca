"""Read recorded motion from XML as a table: SUMO's floating-car data, and obstacles of CommonRoad scenarios."""

import gzip
import io
import xml.etree.ElementTree as ElementTree
from pathlib import Path

import numpy as np
import pyarrow as pa

from mmw.core.errors import InputError

MAX_OFFSET = 10e3
"""A scenario farther than this from the origin of its file gets an origin of its own [m]; as OpenDRIVE."""

ROOTS = {"fcd-export": "SUMO's floating-car data", "commonRoad": "a CommonRoad scenario"}
"""Root element -> format."""

CURE = "correct it, or remove the obstacle"

LANELET_CURE = "correct it, or remove the lanelet"


def open_packed(path: Path) -> gzip.GzipFile | io.BufferedReader:
    """Open a file that may be compressed by gzip."""
    return gzip.open(path) if path.suffix.lower() == ".gz" else path.open("rb")


def read_xml_table(path: Path) -> tuple[pa.Table, list[str]]:
    """Return the samples of an XML file as columns of `mmw.traffic.replay.trajectory_table.ALIASES`, and notes.

    Raises:
        InputError: If the root element is none of `ROOTS`, a number is none, or no obstacle has places.
        ElementTree.ParseError: If the file is no well-formed XML.
        OSError: If it cannot be read.
    """
    with open_packed(path) as file:
        _, root = next(ElementTree.iterparse(file, events=("start",)))
    tag = root.tag.rpartition("}")[2]
    if tag not in ROOTS:
        raise InputError(
            f"{path}: root element <{tag[:60]}>; {' or '.join(f'<{name}> ({what})' for name, what in ROOTS.items())} "
            "is needed; give such a file"
        )
    return (_read_fcd(path), []) if tag == "fcd-export" else _read_commonroad(path)


def _read_fcd(path: Path) -> pa.Table:
    """Return SUMO's floating-car data as its own columns; people and containers are left out."""
    names = ("id", "x", "y", "z", "angle", "type")
    rows: dict[str, list] = {name: [] for name in ("timestep_time", *(f"vehicle_{name}" for name in names))}
    with open_packed(path) as file:
        now = None
        for event, element in ElementTree.iterparse(file, events=("start", "end")):
            if event == "start" and element.tag == "timestep":
                now = element.get("time")
            elif event == "end" and element.tag == "vehicle":
                rows["timestep_time"].append(now)
                for name in names:
                    rows[f"vehicle_{name}"].append(element.get(name))
            elif event == "end" and element.tag == "timestep":
                element.clear()
    return _table(rows)


def _read_commonroad(path: Path) -> tuple[pa.Table, list[str]]:
    """Return the states of all dynamic obstacles, and notes; those of 2018b are `obstacle` elements with a role.

    Obstacles whose places are areas are left out. A state without an orientation has NaN.

    Source: CommonRoad, Documentation of the XML format, versions 2018b and 2020a: states are those of the middle of
    the obstacle's shape, orientations count counter-clockwise from x, times are numbers of time steps.
    """
    rows: dict[str, list] = {name: [] for name in ("t", "id", "x", "y", "heading", "type", "length", "width")}
    with open_packed(path) as file:
        root = ElementTree.parse(file).getroot()
    for element in root.iter():
        element.tag = element.tag.rpartition("}")[2]
    step = read_number(root.get("timeStepSize"), f"{path}: <commonRoad> timeStepSize")
    vague, (x0, y0) = 0, lanelet_origin(root, path).tolist()
    for obstacle in (*root.findall("dynamicObstacle"), *root.findall("obstacle")):
        if obstacle.findtext("role", "dynamic").strip() != "dynamic":
            continue
        states = [*obstacle.findall("initialState"), *obstacle.findall("trajectory/state")]
        if len(states) < 2 or any(state.find("position/point") is None for state in states):
            vague += 1
            continue
        name = obstacle.get("id", "")
        where = f"{path}: <{obstacle.tag} id={name[:40]!r}>"
        size = [obstacle.findtext(f"shape/rectangle/{key}") for key in ("length", "width")]
        for state in states:
            at = f"{where} <{state.tag}>"
            rows["t"].append(step * _exact(state, "time", at))
            rows["x"].append(-x0 + read_number(state.findtext("position/point/x"), f"{at} position/point/x"))
            rows["y"].append(-y0 + read_number(state.findtext("position/point/y"), f"{at} position/point/y"))
            is_turned = state.find("orientation") is not None
            rows["heading"].append(_exact(state, "orientation", at) if is_turned else np.nan)
            rows["id"].append(name)
            rows["type"].append(obstacle.findtext("type", "").strip())
            for key, text in zip(("length", "width"), size, strict=True):
                rows[key].append(0.0 if text is None else read_number(text, f"{where} shape/rectangle/{key}"))
    if not rows["t"]:
        raise InputError(
            f"{path}: <commonRoad> has no dynamic obstacle with points as places ({vague} have areas or no trajectory);"
            " at least one is needed; choose a scenario of interaction type T"
        )
    notes = [f"{path.name}: {vague} obstacles with areas as places, or no trajectory, were left out"] if vague else []
    return _table(rows), notes


def lanelet_origin(root: ElementTree.Element, path: Path) -> np.ndarray:
    """Return the point of a CommonRoad file that becomes the origin of its world and its trajectories [m], shape [2].

    It is (0, 0), unless the lanelets lie farther than `MAX_OFFSET` from there.

    Raises:
        InputError: If a coordinate is no number.
    """
    points = []
    for lanelet in root.iterfind("lanelet"):
        where = f"{path}: <lanelet id={lanelet.get('id', '')[:40]!r}> leftBound point"
        for number, point in enumerate(lanelet.iterfind("leftBound/point")):
            points.append(
                [read_number(point.findtext(axis), f"{where} {number} {axis}", LANELET_CURE) for axis in "xy"]
            )
    if not points:
        return np.zeros(2)
    xy = np.array(points)
    middle = 0.5 * (xy.min(axis=0) + xy.max(axis=0))
    return np.zeros(2) if np.abs(middle).max() < MAX_OFFSET else np.round(middle, -2)


def _exact(state: ElementTree.Element, name: str, where: str) -> float:
    """Return an exact value, or the middle of an interval."""
    ends = [state.findtext(f"{name}/{key}") for key in ("intervalStart", "intervalEnd")]
    if None not in ends:
        return sum(0.5 * read_number(end, f"{where} {name}") for end in ends)
    return read_number(state.findtext(f"{name}/exact"), f"{where} {name}/exact")


def read_number(text: str | None, where: str, cure: str = CURE) -> float:
    """Return the number in an element.

    Raises:
        InputError: If there is no element (None), or its text is no number below 1e9 in size.
    """
    try:
        value = float(text or "")
    except ValueError:
        value = np.nan
    if not abs(value) < 1e9:
        found = "is missing" if text is None else f"is {text.strip()[:40]!r}"
        raise InputError(f"{where} {found}; a number is needed; {cure}")
    return value


def _table(rows: dict[str, list]) -> pa.Table:
    return pa.table({name: pa.array(values) if values else pa.array([], pa.string()) for name, values in rows.items()})
