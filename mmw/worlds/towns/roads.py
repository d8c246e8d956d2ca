"""Roads: strips along a reference line between two junction pads, with paint as strips of the same surface."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from mmw.core.errors import InputError
from mmw.traffic.roads.lane_graph import Lane
from mmw.worlds.towns.alignment import Alignment, Elevation
from mmw.worlds.towns.description import Road
from mmw.worlds.towns.medians import add_island
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.section import MEDIAN_GAP, CrossSection
from mmw.worlds.towns.strip_mesh import Chain, Surface, chain_parts, offset_table, quads, zipper

DASH = 3.0
"""Length of a dash and of the gap after it [m], about; design value."""
FINE = 1.5
"""Distance of rows where a road turns or changes its grade [m], about."""
LANE_STEP = 2.0
"""Largest distance of two points of a lane [m]."""
MIN_ROW = 0.4
"""Least distance of a row at the begin or end of a bridge from others [m]; design value."""
PAD_GAP, ZEBRA, STOP_GAP, STOP_LINE = 0.4, 2.6, 0.5, 0.4
"""From the pad outward: plain road, zebra crossing, plain road, stop line [m]; design values."""


MIN_WAITING, WAITING_GAP = 1.2, 0.3
"""Least distance of a waiting vehicle from the pad, and from the paint across the road [m]; design values."""


@dataclass(frozen=True)
class RoadEnd:
    """End of a road at a junction pad."""

    trim: float
    """Distance from the node to the pad's border along the reference line [m]."""
    zebra: bool
    stop_line: bool

    @property
    def waiting(self) -> float:
        """From the pad to the bumper of a vehicle that waits, before the stop line and the zebra crossing [m]."""
        return round(max(MIN_WAITING, self.reserved + WAITING_GAP if self.zebra or self.stop_line else 0.0), 3)

    @property
    def reserved(self) -> float:
        """Length of the paint across the road [m]."""
        zebra = ZEBRA + PAD_GAP if self.zebra else 0.0
        return PAD_GAP + zebra + (STOP_GAP + STOP_LINE if self.stop_line else 0.0)


@dataclass(frozen=True)
class Rows:
    """Rows across a road: where they lie, and what the cell after each row shows."""

    s: np.ndarray
    """Station of every row [m], shape [R]."""
    kind: tuple[str, ...]
    """Breaks of every row: `pad`, `bars` or `main`."""
    cell: tuple[str, ...]
    """Kind of surface between each row and the next."""
    between: tuple[int, int]
    """First and last row of the part between the paint across the road."""
    xy: np.ndarray
    """Reference line [m], shape [R, 2]."""
    left: np.ndarray
    """Unit vector to the left, shape [R, 2]."""
    z: np.ndarray
    """Height of the carriageway [m], shape [R]."""

    def across(self, row: int, offset: np.ndarray) -> np.ndarray:
        """Return the points of one row on the carriageway at lateral offsets [m], shape [K, 3]."""
        return np.column_stack([self.xy[row] + offset[:, None] * self.left[row], np.full(len(offset), self.z[row])])


@dataclass(frozen=True)
class RoadBody:
    """A road as built."""

    road: Road
    section: CrossSection
    parts: tuple[MeshPart, ...]
    """Meshes on the ground."""
    right: Chain
    """Right-hand edge, in the direction of the reference line."""
    left: Chain
    """Left-hand edge, against the direction of the reference line."""
    centre_line: np.ndarray
    """Reference line between the pads [m], shape [N, 3]."""
    lanes: tuple[Lane, ...]
    """Lanes without successors; forward lanes first, each direction from the middle outward."""
    rows: Rows
    cut: tuple[int, int] | None
    """First and last row of the bridge; None without one."""

    @property
    def on_ground(self) -> list[slice]:
        """Rows of the parts on the ground: one, or before and after the bridge."""
        return ground_slices(len(self.rows.s), self.cut)


def ground_slices(count: int, cut: tuple[int, int] | None) -> list[slice]:
    """Return the rows before and after a bridge, or all of `count` rows without one."""
    return [slice(0, count)] if cut is None else [slice(0, cut[0] + 1), slice(cut[1], count)]


def _end_rows(end: RoadEnd, stop: str) -> list[tuple[float, str, str]]:
    """Return the rows from the pad outward: distance, kind, and the cell that follows outward."""
    rows = [(0.0, "pad", "plain")]
    d = PAD_GAP
    if end.zebra:
        rows += [(d, "bars", "zebra"), (d + ZEBRA, "bars", "plain")]
        d += ZEBRA + PAD_GAP
    if end.stop_line:
        rows += [(d, "main", "solid"), (d + STOP_GAP, "main", stop)]
        d += STOP_GAP + STOP_LINE
    return [*rows, (d, "main", "")]


def _place_rows(
    road: Road, alignment: Alignment, elevation: Elevation, ends: tuple[RoadEnd, RoadEnd]
) -> tuple[Rows, tuple[int, int] | None]:
    """Return the rows of a road, and which of them begin and end its bridge."""
    s0, s1 = ends[0].trim, alignment.length - ends[1].trim
    first, last = _end_rows(ends[0], "stop_backward"), _end_rows(ends[1], "stop_forward")
    rows = [(s0 + d, kind, cell) for d, kind, cell in first[:-1]]
    begin, end = s0 + first[-1][0], s1 - last[-1][0]
    count = max(1, round((end - begin) / DASH))
    borders = np.linspace(begin, end, count + 1)
    before = len(rows)
    for k in range(count):
        paint = "dash" if k % 2 == 0 else "solid"
        probe = np.linspace(borders[k], borders[k + 1], 9)[1:-1]
        curved = np.any(alignment.at(probe)[2] != 0) or np.any(elevation.is_curved(probe))
        pieces = max(1, round((borders[k + 1] - borders[k]) / FINE)) if curved else 1
        for s in np.linspace(borders[k], borders[k + 1], pieces + 1)[:-1]:
            rows.append((float(s), "main", paint))
    bridge = road.bridge
    wanted = (begin, end)
    if bridge is not None:
        wanted = (begin if bridge.start is None else bridge.start, end if bridge.end is None else bridge.end)
        _cut_rows(road.id, wanted, rows, before, end)
    between = (before, len(rows))
    cells = [cell for _, _, cell in last[:-1]][::-1]
    for (d, kind, _), cell in zip(last[::-1], [*cells, ""], strict=True):
        rows.append((s1 - d, kind, cell))
    station = np.array([row[0] for row in rows])
    xy, heading, _ = alignment.at(station)
    left = np.stack([-np.sin(heading), np.cos(heading)], axis=1)
    kinds, paints = tuple(row[1] for row in rows), tuple(row[2] for row in rows)
    made = Rows(station, kinds, paints, between, xy, left, elevation.at(station))
    if bridge is None:
        return made, None
    first, last = (int(np.argmin(np.abs(made.s - station))) for station in wanted)
    if last - first < 4:
        raise InputError(
            f"road {road.id!r}: bridge from {wanted[0]:.1f} to {wanted[1]:.1f} m; it ends well after it begins; "
            "correct one"
        )
    return made, (first, last)


def _cut_rows(
    name: str, wanted: tuple[float, float], rows: list[tuple[float, str, str]], before: int, end: float
) -> None:
    """Put a row at the begin and at the end of the bridge, in place; one that is very near moves there.

    Raises:
        InputError: If the bridge does not lie between the paint across the ends of the road.
    """
    begin = rows[before][0]
    for key, station in zip(("from", "to"), wanted, strict=True):
        if not begin <= station <= end:
            raise InputError(
                f"road {name!r}: bridge.{key} = {station}; needed: between {begin:.1f} and {end:.1f} m, the ends of "
                "its junctions (measured from the node `from`); correct it"
            )
        near = min(range(before, len(rows)), key=lambda k: abs(rows[k][0] - station))
        is_near = abs(rows[near][0] - station) < MIN_ROW
        if end - station < MIN_ROW or (is_near and near == before):
            continue
        if is_near:
            rows[near] = (station, *rows[near][1:])
            continue
        after = next((k for k in range(before, len(rows)) if rows[k][0] > station), len(rows))
        rows.insert(after, (station, "main", rows[after - 1][2]))


def _is_painted(section: CrossSection, cell: str) -> np.ndarray:
    """Return whether each strip of the main cross-section is paint in a cell, shape [K - 1]."""
    middle = 0.5 * (section.breaks[:-1] + section.breaks[1:])
    solid = np.array([kind == "solid" for kind in section.paint])
    dashed = np.array([kind == "dashed" for kind in section.paint])
    inner = np.abs(middle) < section.half - 0.1
    inner[[0, -1]] = False
    if len(section.island):
        inner &= np.abs(middle) > section.island[-1] + 0.5 * MEDIAN_GAP  # the stop line ends at the line of the median
    match cell:
        case "dash":
            return solid | dashed
        case "solid":
            return solid
        case "stop_forward":
            return solid | (inner & ((middle < 0) | (len(section.backward) == 0)))
        case "stop_backward":
            return solid | (inner & (middle > 0))
        case _:
            return np.zeros(len(solid), dtype=bool)


def build_road(
    road: Road, section: CrossSection, alignment: Alignment, elevation: Elevation, ends: tuple[RoadEnd, RoadEnd]
) -> RoadBody:
    """Return a road between its two junction pads.

    Raises:
        InputError: If the pads and the paint across the road leave nothing between them.
    """
    need = sum(end.trim + end.reserved for end in ends) + 0.5
    if alignment.length < need:
        raise InputError(
            f"road {road.id!r}: {alignment.length:.1f} m from node to node; its junctions need {need:.1f} m; "
            "move the nodes apart, reduce corner_radius, or set crosswalks: false"
        )
    rows, cut = _place_rows(road, alignment, elevation, ends)
    surface = Surface()
    for piece in ground_slices(len(rows.s), cut):
        add_carriageway(surface, section, rows, piece)
    sides = []
    for name, sign, order in (("right", -1, slice(None)), ("left", 1, slice(None, None, -1))):
        foot = np.column_stack([rows.xy + sign * section.half * rows.left, rows.z])
        table = offset_table(foot, sign * rows.left, section.edge[:, 0], section.edge[:, 1])
        sides.append(Chain(f"{road.id}_{name}", table[order]))
    parts = surface.parts(
        {
            "asphalt": (f"Roads/{road.id}/asphalt", "road"),
            "road_marking": (f"Roads/{road.id}/marking", "road_line"),
            "curb": (f"Sidewalks/{road.id}/median_curb", "sidewalk"),
            "concrete_sidewalk": (f"Sidewalks/{road.id}/median", "sidewalk"),
            "grass": (f"Terrain/median_{road.id}", "terrain"),
        }
    )
    line = np.column_stack([rows.xy, rows.z])
    lanes = _lanes(road, section, rows, ends)
    body = RoadBody(road, section, tuple(parts), sides[0], sides[1], line, lanes, rows, cut)
    edges = [Chain(chain.name, chain.table[piece]) for chain in sides for piece in _pieces(body, chain)]
    return replace(body, parts=(*parts, *chain_parts(road.id, edges)))


def _pieces(body: RoadBody, chain: Chain) -> list[slice]:
    """Return the rows of a chain that are on the ground, in the order of the chain."""
    if chain is body.right or body.cut is None:
        return body.on_ground
    count = len(body.rows.s)
    return [slice(count - piece.stop, count - piece.start) for piece in body.on_ground[::-1]]


def add_carriageway(surface: Surface, section: CrossSection, rows: Rows, piece: slice) -> list[np.ndarray]:
    """Add the strips of asphalt and paint, and the raised median, of some rows of a road.

    Returns:
        The vertices of every row, from the right to the left kerb.
    """
    kinds = {"pad": section.breaks[[0, -1]], "bars": section.bars, "main": section.breaks}
    chosen = range(piece.start, piece.stop)
    index = {row: surface.add_points(rows.across(row, kinds[rows.kind[row]])) for row in chosen}
    painted = {cell: _is_painted(section, cell) for cell in set(rows.cell)}
    first, last = rows.between
    for k in chosen[:-1]:
        kind, after = rows.kind[k], rows.kind[k + 1]
        if kind != after:
            surface.add_faces("asphalt", zipper(index[k], kinds[kind], index[k + 1], kinds[after]))
            continue
        is_paint = np.arange(len(index[k]) - 1) % 2 == 1 if rows.cell[k] == "zebra" else painted[rows.cell[k]]
        cells = quads(index[k], index[k + 1]).reshape(-1, 2, 3)
        is_open = np.ones(len(is_paint), dtype=bool)
        if len(section.island) and first <= k < last:
            is_open[section.island_breaks[0]] = False
        surface.add_faces("asphalt", cells[~is_paint & is_open])
        surface.add_faces("road_marking", cells[is_paint])
    if len(section.island):
        inside = range(max(first, chosen.start), min(last, chosen.stop - 1) + 1)
        up = np.array([0.0, 0.0, section.island_height])
        tops = [rows.across(row, section.island) + up for row in inside]
        feet = [index[row][list(section.island_breaks)] for row in inside]
        add_island(surface, section.island_top, tops, feet, (first in inside, last in inside))
    return list(index.values())


def _lanes(road: Road, section: CrossSection, rows: Rows, ends: tuple[RoadEnd, RoadEnd]) -> tuple[Lane, ...]:
    lanes = []
    for letter, offsets, order in (("f", section.forward, slice(None)), ("b", section.backward, slice(None, None, -1))):
        for k, t in enumerate(offsets):
            points = np.column_stack([rows.xy + t * rows.left, rows.z])[order]
            beside = [f"{road.id}_{letter}{n}" if 0 <= n < len(offsets) else "" for n in (k - 1, k + 1)]
            lanes.append(
                Lane(
                    f"{road.id}_{letter}{k}",
                    densify(points, LANE_STEP),
                    section.width,
                    road.speed,
                    left=beside[0],
                    right=beside[1],
                    stop=ends[letter == "f"].waiting,
                )
            )
    return tuple(lanes)


def densify(points: np.ndarray, step: float) -> np.ndarray:
    """Return a polyline with points added on its segments so that none is longer than `step` [m], shape [M, 3]."""
    out = [points[:1]]
    for a, b in pairwise(points):
        count = max(1, int(np.ceil(np.linalg.norm(b - a) / step - 1e-9)))
        out.append(a + (b - a) * (np.arange(1, count + 1) / count)[:, None])
    return np.concatenate(out)
