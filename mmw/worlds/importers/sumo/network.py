"""Read a SUMO network (.net.xml): edges, lanes, junctions, connections.

Source of the format: SUMO documentation, Networks/SUMO Road Networks.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mmw.core.errors import InputError
from mmw.worlds.importers.xml_nodes import parse_xml

CURE = "convert the network again"
DEFAULT_WIDTH = 3.2
"""Width of a lane that gives none [m]. Source: SUMO documentation, lane attribute width."""


@dataclass(frozen=True)
class NetworkLane:
    """One lane of an edge, a crossing or a walking area."""

    id: str
    index: int
    """0 is the lane farthest from the opposite direction."""
    points: np.ndarray
    """Center line in the direction of travel [m], shape [N, 2]; of a walking area, its outline."""
    width: float
    speed: float
    """Speed limit [m/s]."""
    is_driven: bool
    """Whether passenger cars may use it."""
    is_walked: bool
    """Whether it is for pedestrians only."""


@dataclass(frozen=True)
class Edge:
    """One direction of a road; an edge inside a junction."""

    id: str
    function: str
    """Empty for a road; `internal`, `crossing` or `walkingarea` inside a junction."""
    kind: str
    """Type of the road, such as `highway.residential`."""
    start: str
    """Junction where it begins; empty inside a junction."""
    end: str
    lanes: tuple[NetworkLane, ...]


@dataclass(frozen=True)
class Connection:
    """A way from the end of a lane to the start of another."""

    first: str
    """Id of the lane where it begins."""
    last: str
    via: str
    """Id of the first lane inside the junction; empty if there is none."""
    direction: str
    """`s` straight, `r`, `R`, `l`, `L` to a side, `t` back."""
    state: str
    """`M` major, `m` minor, `=` equal, `o`, `O` with a light, `s` stop, `w` all-way stop."""
    light: str
    """Id of the traffic light; empty without one."""


@dataclass(frozen=True)
class Junction:
    """A junction, or the end of a road."""

    id: str
    kind: str
    """`priority`, `traffic_light`, `dead_end`, ..."""
    outline: np.ndarray
    """Area that it covers [m], shape [N, 2]; fewer than three points enclose nothing."""


@dataclass
class Network:
    """A whole network."""

    path: Path
    is_left_hand: bool = False
    edges: dict[str, Edge] = field(default_factory=dict)
    junctions: dict[str, Junction] = field(default_factory=dict)
    connections: list[Connection] = field(default_factory=list)

    @property
    def lanes(self) -> dict[str, NetworkLane]:
        """All lanes by id."""
        return {lane.id: lane for edge in self.edges.values() for lane in edge.lanes}

    @property
    def roads(self) -> list[Edge]:
        """Edges outside junctions that cars may use."""
        return [e for e in self.edges.values() if not e.function and any(lane.is_driven for lane in e.lanes)]


def read_network(path: Path) -> Network:
    """Read a network.

    Raises:
        InputError: If it is no SUMO network, or a value is not what the format says.
    """
    root = parse_xml(path, "net", CURE)
    network = Network(path, root.get("lefthand") in ("true", "1"))
    for element in root.findall("edge"):
        key = element.get("id", "")
        function, kind = element.get("function", ""), element.get("type", "")
        least = 1 if function == "internal" else 2  # a connection may lie in one point
        lanes = tuple(_lane(lane, path, least) for lane in element.findall("lane"))
        network.edges[key] = Edge(
            key, "" if function == "normal" else function, kind, element.get("from", ""), element.get("to", ""), lanes
        )
    for element in root.findall("junction"):
        key = element.get("id", "")
        outline = _points(element.get("shape", ""), f"{path}: junction {key!r}", 0)
        network.junctions[key] = Junction(key, element.get("type", ""), outline)
    for element in root.findall("connection"):
        first, last = (f"{element.get(side)}_{element.get(f'{side}Lane')}" for side in ("from", "to"))
        words = (element.get(name, "") for name in ("via", "dir", "state", "tl"))
        network.connections.append(Connection(first, last, *words))
    return network


def _lane(element: ElementTree.Element, path: Path, least: int) -> NetworkLane:
    key = element.get("id", "")
    where = f"{path}: lane {key!r}"
    width = _number(element.attrib, "width", where, DEFAULT_WIDTH)
    speed = _number(element.attrib, "speed", where, 0.0)
    is_driven, is_walked = _allows(element, "passenger"), element.get("allow") == "pedestrian"
    index = int(_number(element.attrib, "index", where, 0.0))
    return NetworkLane(key, index, _points(element.get("shape", ""), where, least), width, speed, is_driven, is_walked)


def _allows(element: ElementTree.Element, who: str) -> bool:
    allow, disallow = element.get("allow"), element.get("disallow")
    if allow is not None:
        return bool({who, "all"} & set(allow.split()))
    return disallow is None or not {who, "all"} & set(disallow.split())


def _number(attributes: Mapping[str, str], name: str, where: str, default: float) -> float:
    text = attributes.get(name)
    try:
        value = default if text is None else float(text)
    except ValueError:
        value = np.nan
    if not 0.0 <= value <= 1e3:
        raise InputError(f"{where}: {name} = {text!r}; a number from 0 to 1000 is needed; {CURE}")
    return value


def _points(text: str, where: str, least: int) -> np.ndarray:
    """Return the points of a shape in plan [m], shape [N, 2], `least` or more, without repeated ones."""
    try:
        points = np.array([[float(value) for value in pair.split(",")[:2]] for pair in text.split()]).reshape(-1, 2)
    except ValueError:
        raise InputError(f"{where}: shape {text[:40]!r}; pairs of numbers are needed; {CURE}") from None
    if not (np.abs(points) < 1e8).all():
        raise InputError(f"{where}: shape {text[:40]!r}; coordinates below 1e8 m are needed; {CURE}")
    if len(points) > 1:
        points = points[np.append(True, np.linalg.norm(np.diff(points, axis=0), axis=1) > 1e-4)]
    if len(points) < least:
        raise InputError(f"{where}: shape {text[:40]!r}; {least} different points are needed; {CURE}")
    return points
