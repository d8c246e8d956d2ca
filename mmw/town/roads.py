"""Roads: strips along a reference line between two junction pads, with paint as strips of the same surface."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mmw.town.alignment import Alignment, Elevation
from mmw.town.description import Road
from mmw.town.lanes import Lane
from mmw.town.parts import MeshPart
from mmw.town.section import CrossSection
from mmw.town.strips import Chain, Surface, chain_parts, offset_table, quads, zipper

DASH = 3.0
"""Length of a dash and of the gap after it [m], about; design value."""
FINE = 1.5
"""Distance of rows where a road turns or changes its grade [m], about."""
LANE_STEP = 2.0
"""Largest distance of two points of a lane [m]."""
PAD_GAP, ZEBRA, STOP_GAP, STOP_LINE = 0.4, 2.6, 0.5, 0.4
"""From the pad outward: plain road, zebra crossing, plain road, stop line [m]; design values."""


@dataclass(frozen=True)
class RoadEnd:
    """How a road meets the junction pad at one of its ends."""

    trim: float
    """Distance from the node to the pad's border along the reference line [m]."""
    zebra: bool
    stop_line: bool

    @property
    def reserved(self) -> float:
        """Length of the paint across the road [m]."""
        zebra = ZEBRA + PAD_GAP if self.zebra else 0.0
        return PAD_GAP + zebra + (STOP_GAP + STOP_LINE if self.stop_line else 0.0)


@dataclass(frozen=True)
class RoadBody:
    """A road as built."""

    road: Road
    section: CrossSection
    parts: tuple[MeshPart, ...]
    right: Chain
    """Right-hand edge, in the direction of the reference line."""
    left: Chain
    """Left-hand edge, against the direction of the reference line."""
    centre_line: np.ndarray
    """Reference line between the pads [m], shape [N, 3]."""
    lanes: tuple[Lane, ...]
    """Lanes without successors; forward lanes first, each direction from the middle outward."""


@dataclass
class _Rows:
    """Rows across a road: station, kind of breaks, and what the cell after each row shows."""

    s: list[float]
    kind: list[str]
    cell: list[str]

    def add(self, s: float, kind: str, cell: str) -> None:
        self.s.append(s)
        self.kind.append(kind)
        self.cell.append(cell)


def _end_rows(end: RoadEnd, stop: str) -> list[tuple[float, str, str]]:
    """Rows from the pad outward: distance, kind, and the cell that follows outward."""
    rows = [(0.0, "pad", "plain")]
    d = PAD_GAP
    if end.zebra:
        rows += [(d, "bars", "zebra"), (d + ZEBRA, "bars", "plain")]
        d += ZEBRA + PAD_GAP
    if end.stop_line:
        rows += [(d, "main", "solid"), (d + STOP_GAP, "main", stop)]
        d += STOP_GAP + STOP_LINE
    return [*rows, (d, "main", "")]


def _place_rows(alignment: Alignment, elevation: Elevation, ends: tuple[RoadEnd, RoadEnd]) -> _Rows:
    s0, s1 = ends[0].trim, alignment.length - ends[1].trim
    first, last = _end_rows(ends[0], "stop_backward"), _end_rows(ends[1], "stop_forward")
    rows = _Rows([], [], [])
    for d, kind, cell in first[:-1]:
        rows.add(s0 + d, kind, cell)
    begin, end = s0 + first[-1][0], s1 - last[-1][0]
    count = max(1, round((end - begin) / DASH))
    borders = np.linspace(begin, end, count + 1)
    for k in range(count):
        paint = "dash" if k % 2 == 0 else "solid"
        probe = np.linspace(borders[k], borders[k + 1], 9)[1:-1]
        curved = np.any(alignment.at(probe)[2] != 0) or np.any(elevation.is_curved(probe))
        pieces = max(1, round((borders[k + 1] - borders[k]) / FINE)) if curved else 1
        for s in np.linspace(borders[k], borders[k + 1], pieces + 1)[:-1]:
            rows.add(float(s), "main", paint)
    cells = [cell for _, _, cell in last[:-1]][::-1]
    for (d, kind, _), cell in zip(last[::-1], [*cells, ""], strict=True):
        rows.add(s1 - d, kind, cell)
    return rows


def _is_painted(section: CrossSection, cell: str) -> np.ndarray:
    """Whether each strip of the main cross-section is paint in a cell, shape [K - 1]."""
    middle = 0.5 * (section.breaks[:-1] + section.breaks[1:])
    solid = np.array([kind == "solid" for kind in section.paint])
    dashed = np.array([kind == "dashed" for kind in section.paint])
    inner = np.abs(middle) < section.half - 0.1
    inner[[0, -1]] = False
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

    Args:
        road: Its description.
        section: Its cross-section.
        alignment: Reference line in plan, from node to node.
        elevation: Height along the reference line.
        ends: The junction at the first and at the last node.

    Raises:
        ValueError: If the pads and the paint across the road leave nothing between them.
    """
    need = sum(end.trim + end.reserved for end in ends) + 0.5
    if alignment.length < need:
        raise ValueError(
            f"road {road.id!r}: {alignment.length:.1f} m from node to node; its junctions need {need:.1f} m; "
            "move the nodes apart, reduce corner_radius, or set crosswalks: false"
        )
    rows = _place_rows(alignment, elevation, ends)
    s = np.array(rows.s)
    xy, heading, _ = alignment.at(s)
    z = elevation.at(s)
    left = np.stack([-np.sin(heading), np.cos(heading)], axis=1)
    kinds = {"pad": section.breaks[[0, -1]], "bars": section.bars, "main": section.breaks}
    surface = Surface()
    index = []
    for k, kind in enumerate(rows.kind):
        across = kinds[kind]
        points = np.column_stack([xy[k] + across[:, None] * left[k], np.full(len(across), z[k])])
        index.append(surface.add_points(points))
    painted = {cell: _is_painted(section, cell) for cell in set(rows.cell)}
    for k in range(len(s) - 1):
        kind, after = rows.kind[k], rows.kind[k + 1]
        if kind != after:
            surface.add_faces("asphalt", zipper(index[k], kinds[kind], index[k + 1], kinds[after]))
            continue
        is_paint = np.arange(len(index[k]) - 1) % 2 == 1 if rows.cell[k] == "zebra" else painted[rows.cell[k]]
        cells = quads(index[k], index[k + 1]).reshape(-1, 2, 3)
        surface.add_faces("asphalt", cells[~is_paint])
        surface.add_faces("road_marking", cells[is_paint])
    sides = []
    for name, sign, order in (("right", -1, slice(None)), ("left", 1, slice(None, None, -1))):
        foot = np.column_stack([xy + sign * section.half * left, z])
        table = offset_table(foot, sign * left, section.edge[:, 0], section.edge[:, 1])
        sides.append(Chain(f"{road.id}_{name}", table[order]))
    parts = surface.parts(
        {
            "asphalt": (f"Roads/{road.id}/asphalt", "road"),
            "road_marking": (f"Roads/{road.id}/marking", "road_line"),
        }
    )
    parts += chain_parts(road.id, sides)
    lanes = []
    for letter, offsets, order in (("f", section.forward, slice(None)), ("b", section.backward, slice(None, None, -1))):
        for k, t in enumerate(offsets):
            points = np.column_stack([xy + t * left, z])[order]
            beside = [f"{road.id}_{letter}{n}" if 0 <= n < len(offsets) else "" for n in (k - 1, k + 1)]
            lanes.append(
                Lane(
                    f"{road.id}_{letter}{k}",
                    densify(points, LANE_STEP),
                    section.width,
                    road.speed,
                    left=beside[0],
                    right=beside[1],
                )
            )
    line = np.column_stack([xy, z])
    return RoadBody(road, section, tuple(parts), sides[0], sides[1], line, tuple(lanes))


def densify(points: np.ndarray, step: float) -> np.ndarray:
    """Return a polyline with points added on its segments so that none is longer than `step` [m], shape [M, 3]."""
    out = [points[:1]]
    for a, b in pairwise(points):
        count = max(1, int(np.ceil(np.linalg.norm(b - a) / step - 1e-9)))
        out.append(a + (b - a) * (np.arange(1, count + 1) / count)[:, None])
    return np.concatenate(out)
