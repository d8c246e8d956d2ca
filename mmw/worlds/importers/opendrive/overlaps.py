"""Cut surfaces that lie on each other, so that one is left at every place, and pave gaps under lanes.

Roads of real files overlap where they meet without a junction, fold in bends tighter than they are wide, and leave
wedges open between them. Carriageways go before paved gaps, these before sidewalks, and sidewalks before grass; of
equals, the first road of the file.
"""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np
import scipy.spatial
import shapely

from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.worlds.checks.road import HALF_SWEPT_M, probes
from mmw.worlds.importers.opendrive.curbs import Sheets
from mmw.worlds.importers.opendrive.ground import OVERPASS
from mmw.worlds.importers.opendrive.road_surface import MATERIAL, Sheet
from mmw.worlds.towns.plan_geometry import polygons_of, triangulate_polygons, twice_areas
from mmw.worlds.towns.strip_mesh import Surface

TOUCH = 1e-3
"""Triangles that reach into each other by less than about this only touch [m]; half of it for each."""
LAP = 3e-4
"""Pieces reach this far over the triangles that they were cut by [m], so that no crack is left between rounded corners;
surfaces that reach into each other by less than 1 mm are no overlap to the check."""
GRID = 1e-5
"""Corners of cut triangles lie on a grid of this size [m]."""
MIN_HEIGHT = 1e-4
"""Triangles that are lower are left out [m]: in single precision, a kilometer from the origin, they have no area."""
RANK = {MATERIAL["walk"]: 2, MATERIAL["green"]: 3}
"""Materials that others go before; asphalt and paint have rank 0."""
GAP_RANK = 1
BESIDE = 1.5
"""A gap is paved along a lane to this far before and behind the probes that found it [m]; design value."""
CRACK = 1e-4
"""Cracks wider than twice this are gaps [m]."""
SEAM = 0.3
"""Near the ends of lanes the road is looked at a little aside, too, as in single precision they are elsewhere [m]."""
NUDGES = np.array([(x * far, y * far, 0.0) for far in (2e-3, 5e-4) for x, y in ((1, 0), (-1, 0), (0, 1), (0, -1))])
"""That far [m], shape [8, 3]; the longer ones step over cracks of a millimeter."""
BEYOND = 0.3
"""Paved gaps reach this far beyond the ends of the pieces of a lane [m]; design value."""
MARGIN = 0.05
"""They reach this far beyond what vehicles need to the side [m]; design value."""
PATCHES = "gaps"
"""Name of the sheet of paved gaps."""


def cut_overlaps(sheets: Sequence[Sheet], new: Sheet | None = None) -> int:
    """Cut the triangles of sheets in place where they overlap others at one level, and return how many were cut.

    Triangles that face down, as the inside of a tight bend does, are left out: others lie over them.

    Args:
        sheets: All sheets.
        new: One of them if the others have been cut already; only what is near it is looked at.
    """
    corners, owner = [], []
    for number, sheet in enumerate(sheets):
        points = np.concatenate(sheet.surface.points)
        for material, blocks in sheet.surface.faces.items():
            faces = np.concatenate(blocks)
            upward = faces[twice_areas(points[faces]) > 0.0]
            sheet.surface.faces[material] = [upward]
            corners.append(points[upward])
            rank = GAP_RANK if sheet.name == PATCHES else RANK.get(material, 0)
            owner += [(rank, number, material, row) for row in range(len(upward))]
    every = np.concatenate(corners)
    if new is not None:
        near = _near(every, np.array([sheets[number] is new for _, number, _, _ in owner]))
        every, owner = every[near], [owner[k] for k in near]
    winners = _winners(every, [key[:2] for key in owner])
    if not winners:
        return 0
    removed: dict[tuple[int, str], list[int]] = defaultdict(list)
    added: dict[tuple[int, str], list[np.ndarray]] = defaultdict(list)
    outlines = np.atleast_1d(np.array(shapely.polygons(every[:, :, :2])))
    for loser, others in winners.items():
        _, number, material, row = owner[loser]
        area = shapely.union_all(outlines[others], grid_size=GRID)  # a grid, as slivers without an area are invalid
        area = area.buffer(LAP, join_style="mitre").buffer(-2 * LAP, join_style="mitre")
        rest = shapely.difference(outlines[loser], area, grid_size=GRID)
        removed[number, material].append(row)
        parts = [part for part in polygons_of(rest, 0.0) if not part.buffer(-1.5 * LAP).is_empty]
        added[number, material].append(_on_plane(parts, every[loser]))
    for (number, material), rows in removed.items():
        surface = sheets[number].surface
        kept = np.delete(surface.faces[material][0], rows, axis=0)
        pieces = np.concatenate(added[number, material])
        index = surface.add_points(pieces.reshape(-1, 3)) if len(pieces) else np.zeros(0, np.int64)
        surface.faces[material] = [kept, index.reshape(-1, 3)]
    return len(winners)


def _near(corners: np.ndarray, is_new: np.ndarray) -> np.ndarray:
    """Return the triangles that may touch new ones, and these: row numbers."""
    middle = corners[:, :, :2].mean(axis=1)
    radius = np.linalg.norm(corners[:, :, :2] - middle[:, None], axis=2).max(axis=1)
    away, _ = scipy.spatial.cKDTree(middle[is_new]).query(middle)
    return np.flatnonzero(away < radius + radius[is_new].max())


def _winners(corners: np.ndarray, keys: list[tuple[int, int]]) -> dict[int, list[int]]:
    """Return the triangles that lose to others, and these: of two that overlap at one level the smaller key wins.

    Args:
        corners: Triangles that face up [m], shape [M, 3, 3].
        keys: Rank and sheet of each.
    """
    plan = corners[:, :, :2]
    side = np.linalg.norm(np.roll(plan, -1, axis=1) - np.roll(plan, 1, axis=1), axis=2)  # opposite each corner
    perimeter = np.maximum(side.sum(axis=1), 1e-12)
    radius = twice_areas(corners) / perimeter
    middle = np.einsum("mk,mkx->mx", side, plan) / perimeter[:, None]
    rows = np.flatnonzero(radius > GRID)
    share = 1.0 - 0.5 * np.minimum(TOUCH / radius[rows, None, None], 1.0)
    inner = shapely.polygons(middle[rows, None] + share * (plan[rows] - middle[rows, None]))
    first, second = shapely.STRtree(inner).query(inner, predicate="intersects")
    first, second = first[first < second], second[first < second]
    common = shapely.get_coordinates(shapely.centroid(shapely.intersection(inner[first], inner[second])))
    first, second = rows[first], rows[second]
    level = np.abs(_height(corners[first], common) - _height(corners[second], common)) < OVERPASS
    found: dict[int, list[int]] = defaultdict(list)
    for i, j in zip(first[level].tolist(), second[level].tolist(), strict=True):
        winner, loser = (i, j) if (keys[i], i) < (keys[j], j) else (j, i)
        found[loser].append(winner)
    return found


def _height(corners: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Return the height of the plane of each triangle [M, 3, 3] at a point [M, 2] in plan [m], shape [M]."""
    a, b, c = (corners[:, k] for k in range(3))
    u, v, w = b[:, :2] - a[:, :2], c[:, :2] - a[:, :2], xy - a[:, :2]
    area = twice_areas(corners)
    s = (w[:, 0] * v[:, 1] - w[:, 1] * v[:, 0]) / area
    t = (u[:, 0] * w[:, 1] - u[:, 1] * w[:, 0]) / area
    return a[:, 2] + s * (b[:, 2] - a[:, 2]) + t * (c[:, 2] - a[:, 2])


def _on_plane(polygons: list[shapely.Polygon], corners: np.ndarray) -> np.ndarray:
    """Return triangles that fill polygons, in the plane of a triangle [3, 3], shape [M, 3, 3]."""
    if not polygons:
        return np.zeros((0, 3, 3))
    plan = triangulate_polygons(polygons)
    longest = np.linalg.norm(plan - np.roll(plan, 1, axis=1), axis=2).max(axis=1)
    plan = plan[twice_areas(plan) > MIN_HEIGHT * longest].reshape(-1, 2)
    height = _height(np.broadcast_to(corners, (len(plan), 3, 3)), plan)
    return np.column_stack([plan, height]).reshape(-1, 3, 3)


def carriageways(sheets: Sequence[Sheet], touch: float = TOUCH) -> Sheets:
    """Return what vehicles drive on, looked up in plan; faces within `touch` of a point [m] count as under it."""
    return Sheets([_paved(sheet.surface) for sheet in sheets], touch)


def _paved(surface: Surface) -> Surface:
    faces = {material: blocks for material, blocks in surface.faces.items() if material not in RANK}
    return Surface(surface.points, faces, surface.count)


def pave_gaps(graph: LaneGraph, roads: Sheets) -> Sheet | None:
    """Return a sheet of asphalt along lanes where the carriageways leave gaps under them, None if they do not.

    Args:
        graph: The lanes.
        roads: The carriageways.
    """
    sheet, before, outlines = Sheet(PATCHES), graph.predecessors, []
    for lane in graph.lanes.values():
        points, _, _ = probes(lane, is_joined=(bool(before[lane.name]), bool(lane.successors)))
        ends = np.linalg.norm(points[:, None] - lane.points[[0, -1]], axis=2).min(axis=1) < 0.5 * lane.width + SEAM
        points = np.concatenate([points, *(points[ends] + step for step in NUDGES)])
        bad = points[np.isnan(roads.nearest(points, 0.5 * OVERPASS))]  # the edges of wide banked lanes are that far off
        if len(bad):
            corners = _band(lane, bad)
            index = sheet.surface.add_points(corners.reshape(-1, 3)).reshape(-1, 4)
            sheet.surface.add_faces(MATERIAL["paved"], index[:, [[0, 1, 2], [0, 2, 3]]])
            cells = shapely.make_valid(shapely.polygons(corners[:, :, :2]))
            outlines += [part for cell in cells for part in polygons_of(cell, 0.0)]
    if not outlines:
        return None
    sheet.outline = shapely.union_all(outlines, grid_size=1e-4)
    return sheet


def _band(lane: Lane, bad: np.ndarray) -> np.ndarray:
    """Return cells of the band that vehicles need along a lane near some points [m], shape [K, 4, 3]."""
    half = (min(lane.width / 2.0, HALF_SWEPT_M) if lane.junction else lane.width / 2.0) + MARGIN
    step = np.diff(lane.points[:, :2], axis=0)
    way = np.concatenate([step[:1], step[:-1] + step[1:], step[-1:]])
    way /= np.maximum(np.linalg.norm(way, axis=1, keepdims=True), 1e-9)
    left = np.column_stack([-way[:, 1], way[:, 0], np.zeros(len(way))])
    right, left = lane.points - half * left, lane.points + half * left
    cells = np.stack([right[:-1], right[1:], left[1:], left[:-1]], axis=1)
    unit = step / np.maximum(np.linalg.norm(step, axis=1, keepdims=True), 1e-9)
    aside = half * np.column_stack([-unit[:, 1], unit[:, 0], np.zeros(len(unit))])
    over = BEYOND * np.column_stack([unit, np.zeros(len(unit))])
    start, end = lane.points[:-1] - over, lane.points[1:] + over
    boxes = np.stack([start - aside, end - aside, end + aside, start + aside], axis=1)  # at kinks they reach farther
    cells = np.concatenate([cells, boxes])
    middle = cells.mean(axis=1)
    reach = half + BESIDE + 0.5 * np.tile(np.linalg.norm(step, axis=1), 2)
    near = np.linalg.norm(middle[:, None, :2] - bad[None, :, :2], axis=2).min(axis=1) < reach
    return cells[near]
