"""The records of an OpenDRIVE file: roads, lane sections, lanes, links and junctions.

Source: ASAM OpenDRIVE 1.4 to 1.8.
"""

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mmw.core.errors import InputError
from mmw.worlds.importers.opendrive import limits
from mmw.worlds.importers.opendrive.limits import check_cubics, number

SPEED_UNIT = {"m/s": 1.0, "km/h": 1 / 3.6, "mph": 0.44704, "": 1.0}
"""Unit of a speed limit -> meters per second."""

Repair = Callable[[str, str, str, str], None]
"""Called with the element, its fault, what is done about it, and how to correct the file."""


@dataclass(frozen=True)
class Cubics:
    """A piecewise cubic a + b ds + c ds^2 + d ds^3 of the station, ds counted from the start of each piece."""

    start: np.ndarray
    """Stations where the pieces begin, ascending [m], shape [K]; empty for a function that is 0 everywhere."""
    coefficients: np.ndarray
    """a, b, c, d of every piece, shape [K, 4]."""

    def at(self, s: np.ndarray) -> np.ndarray:
        """Return the values at stations `s` [m], of the same shape; the first piece also holds before its start."""
        s = np.asarray(s, float)
        if len(self.start) == 0:
            return np.zeros_like(s)
        piece = np.clip(np.searchsorted(self.start, s, side="right") - 1, 0, len(self.start) - 1)
        ds = s - self.start[piece]
        a, b, c, d = np.moveaxis(self.coefficients[piece], -1, 0)
        return a + ds * (b + ds * (c + ds * d))


@dataclass(frozen=True)
class Mark:
    """Paint on the outer border of a lane, from a station on."""

    start: float
    """Begin along the road [m]."""
    kind: str
    """`solid`, `broken`, `none`, or two of these with a space between for a double line."""
    width: float
    """Of one line [m]."""
    color: str
    dash: tuple[float, float]
    """Length of a dash and of the gap after it [m]."""
    change: str
    """Attribute laneChange: `increase`, `decrease`, `both`, `none`; empty if the file does not say."""


@dataclass(frozen=True)
class LaneRecord:
    """One lane of one lane section."""

    number: int
    """Lane id: 0 is the center line, left lanes are positive."""
    kind: str
    width: Cubics | None
    border: Cubics | None
    heights: tuple[tuple[float, float, float], ...]
    """Station [m], inner and outer height above the road surface [m], from that station on."""
    marks: tuple[Mark, ...]
    speeds: tuple[tuple[float, float], ...]
    """Station [m] and speed limit [m/s] from there on."""
    predecessor: int | None
    successor: int | None
    reversed: bool
    """Whether traffic runs against the side's usual direction (attribute direction, 1.8)."""


@dataclass(frozen=True)
class Section:
    """A stretch of road with a constant set of lanes."""

    start: float
    end: float
    lanes: dict[int, LaneRecord]


@dataclass(frozen=True)
class Link:
    """Link at one end of a road."""

    kind: str
    """`road` or `junction`."""
    target: str
    contact: str
    """`start` or `end` of the target road; empty for a junction."""


@dataclass(frozen=True)
class RoadRecord:
    """One road."""

    id: str
    length: float
    junction: str
    """Id of the junction that it crosses; empty on an ordinary road."""
    is_left_hand: bool
    predecessor: Link | None
    successor: Link | None
    geometry: tuple[ElementTree.Element, ...]
    elevation: Cubics
    superelevation: Cubics
    """Angle about the direction of travel, the left side up [rad]."""
    offset: Cubics
    sections: tuple[Section, ...]
    speeds: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Connection:
    """A connection of a junction."""

    incoming: str
    connecting: str
    contact: str
    lanes: tuple[tuple[int, int], ...]


@dataclass(frozen=True)
class JunctionRecord:
    """One junction."""

    id: str
    kind: str
    """`default`, `direct` or `virtual`."""
    connections: tuple[Connection, ...]
    priorities: tuple[tuple[str, str], ...]
    """Ids of roads, the first of which goes before the second."""


def _cubics(
    elements: list[ElementTree.Element], where: str, key: str = "s", shift: float = 0.0, scale: float = 1.0
) -> Cubics:
    rows = [
        [number(e, key, where, 0.0, limits.STATION) + shift, *(scale * number(e, k, where, 0.0) for k in "abcd")]
        for e in elements
    ]
    table = np.array(sorted(rows, key=lambda row: row[0]), float).reshape(-1, 5)
    return Cubics(table[:, 0], table[:, 1:])


def _speeds(
    elements: list[ElementTree.Element], where: str, key: str, shift: float, repair: Repair
) -> tuple[tuple[float, float], ...]:
    found = []
    for element in elements:
        text, unit = element.get("max", ""), element.get("unit", "")
        if text in ("no limit", "undefined"):
            continue
        if unit not in SPEED_UNIT:
            fault = f"speed unit {unit!r}; m/s, km/h or mph is needed"
            repair(where.partition(": ")[2], fault, "the speed limit was left out", "correct the file")
            continue
        value = number(element, "max", where, limits=limits.SPEED) * SPEED_UNIT[unit]
        if value > 0:
            found.append((number(element, key, where, 0.0, limits.STATION) + shift, value))
    return tuple(sorted(found))


def read_road(element: ElementTree.Element, where: str, repair: Repair) -> RoadRecord:
    """Read one road.

    Args:
        element: The road.
        where: File and road, for messages.
        repair: Called with element, fault, what is done and cure for what is mended.

    Raises:
        InputError: If a record lacks an attribute, or has a wrong one, and cannot be mended.
    """
    name = f"road {element.get('id')!r}"
    length = number(element, "length", where, limits=(-limits.MAX_ROAD, limits.MAX_ROAD))
    if element.get("id") is None or length <= 0:
        raise InputError(f"{where}: length {length}; an id and a positive length are needed; correct the file")
    geometry = tuple(element.findall("planView/geometry"))
    if not geometry:
        raise InputError(f"{where}: has no planView geometry; at least one piece is needed; export the file again")
    for piece in geometry:
        for axis in "xy":
            number(piece, axis, where, limits=limits.PLACE)
    drawn = max(sum(number(piece, key, where, limits=limits.STATION) for key in ("s", "length")) for piece in geometry)
    if 0.0 < drawn < length - limits.MAX_GAP:
        repair(
            f"{name} ({length:g} m, drawn to {drawn:g} m)", "its geometry ends before its length",
            "it ends where its geometry does", "correct the length of the geometry or the road",
        )  # fmt: skip
        length = drawn
    starts = [number(section, "s", where, limits=limits.STATION) for section in element.findall("lanes/laneSection")]
    if not starts:
        raise InputError(f"{where}: has no laneSection; at least one is needed; export the file again")
    if starts != sorted(starts):
        raise InputError(f"{where}: lane sections are not in ascending order of s; sort them")
    ends = [*starts[1:], length]
    sections = tuple(
        _section(section, start, min(end, length), where, repair)
        for section, start, end in zip(element.findall("lanes/laneSection"), starts, ends, strict=True)
        if min(end, length) - start > (1e-6 if length >= limits.MIN_ROAD else 0.0)
    )
    if not sections:
        raise InputError(f"{where}: no laneSection begins before its end at {length:g} m; correct s or the length")
    rule = element.get("rule", "RHT")
    if rule not in ("RHT", "LHT"):
        raise InputError(f"{where}: rule {rule!r}; RHT or LHT is needed; correct the file")
    types = element.findall("type")
    speeds = [
        (number(t, "s", where, 0.0, limits.STATION), s)
        for t in types
        for _, s in _speeds(t.findall("speed"), where, "s", 0.0, repair)
    ]
    junction = element.get("junction", "-1")
    road = RoadRecord(
        id=element.get("id", ""),
        length=length,
        junction="" if junction == "-1" else junction,
        is_left_hand=rule == "LHT",
        predecessor=_link(element.find("link/predecessor"), where, repair),
        successor=_link(element.find("link/successor"), where, repair),
        geometry=geometry,
        elevation=_cubics(element.findall("elevationProfile/elevation"), where),
        superelevation=_cubics(element.findall("lateralProfile/superelevation"), where),
        offset=_cubics(element.findall("lanes/laneOffset"), where),
        sections=sections,
        speeds=tuple(sorted(speeds)),
    )
    _check_values(road, where)
    return road


def _check_values(road: RoadRecord, where: str) -> None:
    """Raise InputError where a cubic of a road reaches what no road has."""
    whole = 0.0, road.length
    for what, cubics, allowed in (
        ("elevation", road.elevation, limits.HEIGHT),
        ("superelevation", road.superelevation, limits.ROLL),
        ("laneOffset", road.offset, limits.OFFSET),
    ):
        check_cubics(where, what, (cubics.start, cubics.coefficients), whole, allowed)
    for section in road.sections:
        for lane in section.lanes.values():
            for what, cubics in (("width", lane.width), ("border", lane.border)):
                if cubics is not None:
                    pieces, name = (cubics.start, cubics.coefficients), f"{where}: lane {lane.number}"
                    check_cubics(name, what, pieces, (section.start, section.end), limits.WIDTH)


def _link(element: ElementTree.Element | None, where: str, repair: Repair) -> Link | None:
    if element is None or element.get("elementId") is None:
        return None
    kind, contact = element.get("elementType", "road"), element.get("contactPoint", "")
    if kind == "road" and contact not in ("start", "end"):
        if element.get("elementS") is not None:
            return None  # a virtual connection in the middle of a road
        name = f"{where.partition(': ')[2]} (to road {element.get('elementId')!r})"
        repair(name, "the link has no contactPoint", "the link was left out", "add start or end")
        return None
    return Link(kind, element.get("elementId", ""), contact if kind == "road" else "")


def _section(element: ElementTree.Element, start: float, end: float, where: str, repair: Repair) -> Section:
    if element.get("singleSide") in ("true", "1"):
        raise InputError(f"{where}: laneSection at s = {start} holds for one side only; give both sides at every s")
    lanes = {}
    for side in ("left", "center", "right"):
        for lane in element.findall(f"{side}/lane"):
            record = _lane(lane, start, where, repair)
            if (record.number > 0) != (side == "left") or (record.number < 0) != (side == "right"):
                raise InputError(
                    f"{where}: lane {record.number} stands in <{side}>; left lanes are positive; correct it"
                )
            lanes[record.number] = record
    if 0 not in lanes:
        lanes[0] = LaneRecord(0, "none", None, None, (), (), (), None, None, False)
    for side in (1, -1):
        found = sorted(abs(n) for n in lanes if n * side > 0)
        if found != list(range(1, len(found) + 1)):
            repair(
                f"{where.rpartition(': ')[2]} at s = {start:g} ({found})", "lanes are not numbered 1, 2, 3 ...",
                "those that are missing were given the width 0", "renumber them",
            )  # fmt: skip
            for missing in set(range(1, max(found))) - set(found):
                lanes[side * missing] = LaneRecord(side * missing, "none", None, None, (), (), (), None, None, False)
    return Section(start, end, lanes)


def _lane(element: ElementTree.Element, start: float, where: str, repair: Repair) -> LaneRecord:
    lane = int(number(element, "id", where, limits=limits.LANE))
    where = f"{where}: lane {lane} at s = {start:g}"
    widths, borders = element.findall("width"), element.findall("border")
    if lane and not widths and not borders:
        raise InputError(f"{where}: has neither width nor border; one is needed; export the file again")
    links = [element.find(f"link/{name}") for name in ("predecessor", "successor")]
    before, after = (None if link is None else int(number(link, "id", where, limits=limits.LANE)) for link in links)
    marks = tuple(sorted((_mark(m, start, where) for m in element.findall("roadMark")), key=lambda m: m.start))
    heights = []
    for height in element.findall("height"):
        missing = [side for side in ("inner", "outer") if height.get(side) is None]
        if missing:
            fault, done = f"<height> attribute {' and '.join(missing)} is missing", "the record was left out"
            repair(where.partition(": ")[2], fault, done, "correct the file")
            continue
        sides = (number(height, side, where, limits=limits.KERB) for side in ("inner", "outer"))
        heights.append((start + number(height, "sOffset", where, 0.0, limits.STATION), *sides))
    return LaneRecord(
        number=lane,
        kind=element.get("type", "none"),
        width=_cubics(widths, where, "sOffset", start) if widths else None,
        border=_cubics(borders, where, "sOffset", start) if borders else None,
        heights=tuple(sorted(heights)),
        marks=marks,
        speeds=_speeds(element.findall("speed"), where, "sOffset", start, repair),
        predecessor=before,
        successor=after,
        reversed=element.get("direction") == "reversed",
    )


def _mark(element: ElementTree.Element, start: float, where: str) -> Mark:
    kind = element.get("type", "none")
    known = {"solid", "broken"}
    kind = kind if kind.split() and set(kind.split()) <= known else {"botts dots": "broken"}.get(kind, "none")
    bold = element.get("weight") == "bold"
    width = number(element, "width", where, 0.0, limits.PAINT) or (0.25 if bold else 0.12)
    line = element.find("type/line")
    dash = (3.0, 6.0)  # design value: what most countries paint in towns
    if line is not None:
        length, space = (number(line, name, where, 0.0, limits.DASH) for name in ("length", "space"))
        if min(length, space) > 0 and length + space < 2 * limits.MIN_DASH:
            raise InputError(
                f"{where}: <line> of a road mark: length {length:g} and space {space:g}; {2 * limits.MIN_DASH:g} m or "
                "more together are needed; correct the file"
            )
        dash = (length, space) if min(length, space) > 0 else dash
    color = element.get("color", "standard")
    return Mark(
        start + number(element, "sOffset", where, 0.0, limits.STATION),
        kind,
        width,
        color,
        dash,
        element.get("laneChange", ""),
    )


def read_junction(element: ElementTree.Element, where: str) -> JunctionRecord:
    """Read one junction; `where` is its file and name, for messages.

    Raises:
        InputError: If a lane link is no number of a lane.
    """
    connections = []
    for connection in element.findall("connection"):
        lanes = tuple(
            (int(number(link, "from", where, limits=limits.LANE)), int(number(link, "to", where, limits=limits.LANE)))
            for link in connection.findall("laneLink")
        )
        target = connection.get("connectingRoad") or connection.get("linkedRoad")
        incoming, contact = connection.get("incomingRoad"), connection.get("contactPoint", "start")
        if target and incoming:
            connections.append(Connection(incoming, target, contact, lanes))
    priorities = tuple((p.get("high", ""), p.get("low", "")) for p in element.findall("priority"))
    return JunctionRecord(element.get("id", ""), element.get("type", "default"), tuple(connections), priorities)
