"""The surface of one OpenDRIVE road: strips between lane borders, with paint cut out of the asphalt.

Paint is a strip of the road surface and never a second layer on it.
"""

from dataclasses import dataclass, field

import numpy as np
import shapely

from mmw.worlds.importers.opendrive.cross_section import RoadShape, choose_rows, surface_of
from mmw.worlds.importers.opendrive.records import Cubics, LaneRecord, Mark, Section
from mmw.worlds.towns.plan_geometry import polygons_of
from mmw.worlds.towns.strip_mesh import Surface

MATERIAL = {"paved": "asphalt", "walk": "concrete_sidewalk", "green": "grass"}
"""Surface of a lane type -> material."""
WHITE, YELLOW = "road_marking", "road_marking_yellow"
LEVEL = 1e-6
"""Borders of two lanes whose heights differ by less are one line [m]."""


@dataclass
class Sheet:
    """The top of a road or of a junction, before its edges are closed."""

    name: str
    surface: Surface = field(default_factory=Surface)
    outline: shapely.Geometry = field(default_factory=shapely.Polygon)
    """Outline in plan."""
    rows: list[np.ndarray] = field(default_factory=list)
    """Vertices of the rows of a road, the right edge first [m], each [columns, 3]."""
    stations: list[float] = field(default_factory=list)
    """Station of every row [m]."""


@dataclass(frozen=True)
class _Line:
    """One painted line along a border: between `inner` and `outer` distance from it, where `on` is true."""

    inner: np.ndarray
    outer: np.ndarray
    on: np.ndarray
    yellow: np.ndarray


def build_sheet(name: str, shape: RoadShape) -> Sheet:
    """Return the surface of a road outside junctions."""
    sheet, polygons = Sheet(name), []
    for section in shape.road.sections:
        s = choose_rows(shape, section.start, section.end, breaks(shape, section))
        table = _add_section(sheet, shape, section, s)
        edges = np.concatenate([table[:, 0, :2], table[::-1, -1, :2]])
        polygons += polygons_of(shapely.make_valid(shapely.Polygon(edges)), 0.0)
        sheet.rows += list(table)
        sheet.stations += s.tolist()
    sheet.outline = shapely.union_all(polygons, grid_size=1e-4)
    return sheet


def breaks(shape: RoadShape, section: Section, with_paint: bool = True) -> np.ndarray:
    """Return the stations inside a section where something begins or ends [m]."""
    road = shape.road
    cubics: list[Cubics | None] = [road.elevation, road.superelevation, road.offset]
    cubics += [c for lane in section.lanes.values() for c in (lane.width, lane.border)]
    found = [c.start for c in cubics if c is not None]
    found.append(np.array([piece.station for piece in shape.line.pieces]))
    for lane in section.lanes.values():
        found.append(np.array([station for station, _, _ in lane.heights]))
        for mark, end in mark_spans(lane, section) if with_paint else ():
            found.append(np.array([mark.start]))
            if "broken" in mark.kind:
                starts = np.arange(mark.start, end, sum(mark.dash))
                found += [starts, starts + mark.dash[0]]
    return np.concatenate(found) if found else np.zeros(0)


def mark_spans(lane: LaneRecord, section: Section) -> list[tuple[Mark, float]]:
    """Return the marks of a lane's outer border and where each ends [m]."""
    ends = [*(mark.start for mark in lane.marks[1:]), section.end]
    return [(mark, min(end, section.end)) for mark, end in zip(lane.marks, ends, strict=False)]


def _add_section(sheet: Sheet, shape: RoadShape, section: Section, s: np.ndarray) -> np.ndarray:
    """Add the strips of one lane section to a sheet and return all vertices, shape [rows, columns, 3]."""
    borders = shape.borders(section, s)
    order = [number for number in sorted(borders) if number]
    middle = 0.5 * (s[:-1] + s[1:])
    columns: list[tuple[np.ndarray, np.ndarray]] = []
    strips: list[tuple[int, str, _Line | None]] = []  # right column, material, paint
    for number in order:
        lane = section.lanes[number]
        (inner, outer), (dz_inner, dz_outer) = borders[number], shape.heights(lane, s)
        low, high = ((outer, dz_outer), (inner, dz_inner)) if number < 0 else ((inner, dz_inner), (outer, dz_outer))
        if not columns or np.abs(columns[-1][1] - low[1]).max() > LEVEL:
            columns.append(low)
        kind = surface_of(lane.kind)
        lines: list[list[_Line]] = [[], []]
        if kind == "paved":
            lines = [_lines(section.lanes, number, side, section, middle, s) for side in (-1, 1)]
        room = np.maximum(high[0] - low[0], 1e-9)
        cuts = [(low, line.inner, line.outer, line) for line in lines[0]]
        cuts += [(high, -line.outer, -line.inner, line) for line in reversed(lines[1])]
        for origin, near, far, line in cuts:
            for offset, paint in ((near, None), (far, line)):
                part = np.clip((origin[0] + offset - low[0]) / room, 0.0, 1.0)
                t = np.maximum(low[0] + part * room, columns[-1][0])
                strips.append((len(columns) - 1, MATERIAL[kind], paint))
                columns.append((t, low[1] + part * (high[1] - low[1])))
        strips.append((len(columns) - 1, MATERIAL[kind], None))
        columns.append(high)
    if not columns:  # a section without lanes has no width
        columns.append((borders[0][0], np.zeros(len(s))))
    table = np.stack([shape.place(s, t, dz) for t, dz in columns], axis=1)
    index = sheet.surface.add_points(table.reshape(-1, 3)).reshape(table.shape[:2])
    for right, material, line in strips:
        a, b = index[:-1, right], index[1:, right]
        c, d = index[1:, right + 1], index[:-1, right + 1]
        faces = np.stack([np.stack([a, b, c], axis=1), np.stack([a, c, d], axis=1)], axis=1).reshape(-1, 3)
        if line is None:
            sheet.surface.add_faces(material, faces)
            continue
        painted = np.repeat(line.on, 2)
        yellow = np.repeat(line.yellow, 2)
        sheet.surface.add_faces(material, faces[~painted])
        sheet.surface.add_faces(WHITE, faces[painted & ~yellow])
        sheet.surface.add_faces(YELLOW, faces[painted & yellow])
    return table


def _lines(
    lanes: dict[int, LaneRecord], number: int, side: int, section: Section, middle: np.ndarray, s: np.ndarray
) -> list[_Line]:
    """Paint that a lane carries along its right (-1) or left (1) border, the nearest to the border first."""
    owner = lanes[number] if side * number > 0 else lanes[number + side]
    other = lanes.get(number + side or number + 2 * side)  # there is no lane 0 between -1 and 1
    alone = other is None or surface_of(other.kind) != "paved"
    reach = np.zeros((2, 2, len(s)))  # line, inner and outer, row
    on, yellow = np.zeros((2, len(middle)), bool), np.zeros((2, len(middle)), bool)
    for mark, end in mark_spans(owner, section):
        cell = (middle > mark.start) & (middle < end)
        row = (s >= mark.start - 1e-6) & (s <= end + 1e-6)
        dashed = (middle - mark.start) % sum(mark.dash) < mark.dash[0]
        for slot, (first, last, word) in enumerate(_across(mark, owner.number, side, alone)):
            reach[slot][:, row] = np.array([[first], [last]])
            on[slot] |= cell & ((word == "solid") | dashed)
            yellow[slot] |= cell & (mark.color == "yellow")
    return [_Line(reach[k, 0], reach[k, 1], on[k], yellow[k]) for k in range(2) if on[k].any()]


def _across(mark: Mark, owner: int, side: int, alone: bool) -> list[tuple[float, float, str]]:
    """Distances from the border between which a lane carries paint [m], and whether it is `solid` or `broken`.

    A lane carries its half of the paint, and all of it where nothing paved lies beyond the border.
    """
    if mark.kind == "none":
        return []
    words, w = mark.kind.split(), mark.width
    if len(words) == 1:
        return [(0.0, w if alone else 0.5 * w, words[0])]
    left, right = (words[1], words[0]) if owner > 0 else (words[0], words[1])  # inside first; center: left to right
    near, far = (left, right) if side < 0 else (right, left)
    return [(0.0, w, far), (2 * w, 3 * w, near)] if alone else [(0.5 * w, 1.5 * w, near)]
