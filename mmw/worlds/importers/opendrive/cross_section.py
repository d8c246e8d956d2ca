"""Compute the points of an OpenDRIVE road: lane borders, heights, rows that follow its curves."""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mmw.worlds.importers.opendrive.records import LaneRecord, RoadRecord, Section
from mmw.worlds.importers.opendrive.reference_line import ReferenceLine

KERB_HEIGHT = 0.14
"""Height of sidewalks and kerbs above the carriageway where the file gives none [m]; design value."""
RAISED = ("sidewalk", "walking", "curb")
"""Lane types that lie a kerb higher than the carriageway."""
GREEN = ("none", "median", "grass")
"""Lane types that are soft ground."""
PLAN_ERROR = 0.005
"""Largest distance of a mesh edge from the curve that it stands for, in plan [m]; design value."""
HEIGHT_ERROR = 0.0005
"""The same in height [m]: wheels roll on the mesh."""
MAX_ROW = 10.0
"""Largest distance of two rows of vertices [m]; design value."""
FINE = 0.25
"""Distance of the samples from which rows are chosen [m]; design value."""


def surface_of(kind: str) -> str:
    """Return `paved`, `walk` or `green` for a lane type; unknown types are paved."""
    if kind in RAISED:
        return "walk"
    return "green" if kind in GREEN else "paved"


@dataclass(frozen=True)
class RoadShape:
    """A road as a function of station s and lateral position t (positive to the left)."""

    road: RoadRecord
    line: ReferenceLine

    def place(self, s: np.ndarray, t: np.ndarray, dz: np.ndarray | float = 0.0) -> np.ndarray:
        """Return points in the world [m], shape [..., N, 3].

        Args:
            s: Stations [m], shape [N].
            t: Lateral positions [m], shape [..., N].
            dz: Height above the road surface [m], shape [N] or a number.
        """
        xy, heading = self.line.at(s)
        roll = self.road.superelevation.at(s)
        left = np.column_stack([-np.sin(heading), np.cos(heading)])
        z = self.road.elevation.at(s) + t * np.sin(roll) + dz
        return np.concatenate([xy + (t * np.cos(roll))[..., None] * left, z[..., None]], axis=-1)

    def section_at(self, s: float) -> Section:
        """Return the lane section that holds at a station [m]."""
        return next((x for x in self.road.sections if s < x.end), self.road.sections[-1])

    def borders(self, section: Section, s: np.ndarray) -> dict[int, tuple[np.ndarray, np.ndarray]]:
        """Return lane number -> lateral positions of the inner and the outer border [m], each of the shape of `s`."""
        zero = self.road.offset.at(s)
        found = {0: (zero, zero)}
        for side in (1, -1):
            inner = zero
            for k in range(1, len(section.lanes) + 1):
                lane = section.lanes.get(side * k)
                if lane is None:
                    break
                if lane.width is not None:
                    outer = inner + side * np.maximum(lane.width.at(s), 0.0)
                else:
                    outer = zero + side * np.abs(lane.border.at(s)) if lane.border else inner
                    outer = side * np.maximum(side * outer, side * inner)
                found[side * k] = (inner, outer)
                inner = outer
        return found

    def heights(self, lane: LaneRecord, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the heights of the inner and the outer border of a lane above the road surface [m]."""
        inner = np.full(len(s), KERB_HEIGHT if lane.kind in RAISED else 0.0)
        outer = inner.copy()
        for station, low, high in lane.heights:
            inner[s >= station - 1e-9], outer[s >= station - 1e-9] = low, high
        return inner, outer

    def edges(self, s: np.ndarray) -> np.ndarray:
        """Return every lane border and the reference line at stations of one section [m], shape [B, N, 3]."""
        borders = self.borders(self.section_at(0.5 * (s[0] + s[-1])), s)
        return self.place(s, np.stack([np.zeros_like(s), *(outer for _, outer in borders.values())]))


def choose_rows(shape: RoadShape, start: float, end: float, fixed: np.ndarray) -> np.ndarray:
    """Return stations of rows of vertices, ascending from `start` to `end`, the stations `fixed` among them [m].

    Between neighboring rows no edge of the road leaves its chord by more than `PLAN_ERROR` in plan and `HEIGHT_ERROR`
    in height.
    """
    fixed = fixed[(fixed > start + 1e-3) & (fixed < end - 1e-3)]
    fixed = np.unique(np.concatenate([[start, end], np.round(fixed, 4)]))
    rows = [float(fixed[0])]
    for low, high in pairwise(fixed.tolist()):
        count = max(2, int(np.ceil((high - low) / FINE)) + 1)
        s = np.linspace(low, high, count)
        at = 0
        points = shape.edges(s)
        while at < count - 1:
            reach = min(count - 1, at + int(MAX_ROW / FINE))
            at = _farthest(points, s, at, reach)
            rows.append(float(s[at]))
    return np.array(rows)


def _farthest(points: np.ndarray, s: np.ndarray, start: int, last: int) -> int:
    """Index of the last sample whose chord from `start` follows the curves; halves the stretch until it does."""
    end = last
    while end > start + 1:
        inner = points[:, start : end + 1]
        chord = inner[:, -1:] - inner[:, :1]
        part = np.sum((inner - inner[:, :1]) * chord, axis=2) / np.maximum(np.sum(chord**2, axis=2), 1e-12)
        even = (s[start : end + 1] - s[start]) / (s[end] - s[start])
        off = inner - inner[:, :1] - part[..., None] * chord
        drift = np.abs(part - even).max()
        plan, height = np.hypot(off[..., 0], off[..., 1]).max(), np.abs(off[..., 2]).max()
        if plan <= PLAN_ERROR and height <= HEIGHT_ERROR and drift < 0.2:
            return end
        end = start + (end - start) // 2
    return end
