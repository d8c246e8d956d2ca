"""Skybridges: a closed walkway of frame and panes between two buildings, on columns where no building carries it.

Made in a frame of its own: x along the bridge from its middle, y to the left, z as in the town.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from mmw.core.errors import InputError
from mmw.core.mesh import TriangleMesh, merge
from mmw.worlds.towns.ground_height import Ground
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.place_description import Skybridge
from mmw.worlds.towns.plan_geometry import rectangle_at, rotation, samples
from mmw.worlds.towns.primitives import box, place, quads, wall_cells, weld

FRAME, PANE = 0, 1
SILL, HEAD = 0.35, 0.35
"""Frame below and above the panes of a storey [m]; design values."""
PARAPET = 0.5
"""Frame above the topmost panes' head, up to the roof [m]; design value."""
POST = 0.8
"""Side of a column [m]; design value."""
POST_SPACING = 9.0
"""Largest distance of the columns across a bridge [m]; design value."""
INSET = 0.8
"""Distance of the columns' middle from the end of the bridge [m]."""
SUNK = 0.05
"""How far the bridge reaches into a building, and a column into the bridge; no two faces then lie in one plane [m]."""
FOOT = 0.6
"""Foundation of a column below the ground [m]."""
TOUCH = 0.3
"""A building this close to an end carries it [m]."""
OFF_KERB = 0.25
"""Heights of a road are taken this far from its kerbs, whose top is no road [m]."""
KERB = 0.3
"""Least distance of a column to a carriageway [m]."""


@dataclass(frozen=True)
class Span:
    """Placement of a skybridge."""

    description: Skybridge
    yaw: float
    """Direction from one end to the other, counter-clockwise from east [rad]."""
    plan: shapely.Polygon
    """Outline from above, in the town frame."""
    soffit: float
    """Height of the underside in the town frame [m]."""
    on_columns: tuple[bool, bool]
    """Whether the first and the second end stand on columns."""
    columns: tuple[tuple[float, float], ...]
    """Middles of the columns in the town frame [m]."""

    @property
    def length(self) -> float:
        """Distance between the two ends [m]."""
        return math.dist(self.description.start, self.description.end)

    @property
    def column_plans(self) -> list[shapely.Polygon]:
        """Plans of the columns in the town frame."""
        return [rectangle_at(column, self.yaw, POST, POST) for column in self.columns]


def find_span(
    bridge: Skybridge, carriageway: shapely.Geometry, buildings: Sequence[shapely.Polygon], ground: Ground
) -> Span:
    """Return where a skybridge runs, how high, and where its columns stand.

    Raises:
        InputError: If the ends lie too close, a building stands below the bridge, or a column would stand on a road.
    """
    where = f"skybridge {bridge.name!r}"
    start, end = np.array(bridge.start), np.array(bridge.end)
    length = float(np.linalg.norm(end - start))
    if length < 3.0:
        raise InputError(f"{where}: {length:.1f} m long; 3 m or more are needed; move its ends apart")
    yaw = math.atan2(*(end - start)[::-1])
    along, left = rotation(yaw).T
    plan = rectangle_at(0.5 * (start + end), yaw, length, bridge.width)
    inner = shapely.buffer(plan, -TOUCH, join_style="mitre")
    if any(shapely.intersects(inner, building) for building in buildings):
        raise InputError(f"{where}: a building placed by hand stands in its way; let the bridge end at the facade")
    below = shapely.intersection(plan, shapely.buffer(carriageway, -OFF_KERB, join_style="mitre"))
    area = plan if below.is_empty else below
    heights = ground.height(*samples(area, 1.0).T)
    if np.isnan(heights).any() or np.isnan(ground.height(*shapely.get_coordinates(plan).T)).any():
        raise InputError(f"{where}: reaches beyond the terrain; move it into the town")
    edges = [shapely.LineString([p - left * 0.4 * bridge.width, p + left * 0.4 * bridge.width]) for p in (start, end)]
    touched = [any(shapely.dwithin(edge, building, TOUCH) for building in buildings) for edge in edges]
    chosen = {"both": (True, True), "from": (True, False), "to": (False, True), "none": (False, False)}
    on_columns = chosen.get(bridge.supports, (not touched[0], not touched[1]))
    columns = []
    count = 1 + math.ceil((bridge.width - 2 * INSET) / POST_SPACING)
    across = np.linspace(-0.5, 0.5, max(count, 2)) * (bridge.width - 2 * INSET)
    for point, inward, has_columns in ((start, along, on_columns[0]), (end, -along, on_columns[1])):
        columns += [tuple(point + inward * INSET + left * t) for t in across] if has_columns else []
    for station in bridge.piers:
        if not INSET < station < length - INSET:
            raise InputError(f"{where}: piers at {station} m; stations from 0 to {length:.1f} m are needed; correct it")
        columns += [tuple(start + along * station + left * t) for t in across]
    span = Span(bridge, yaw, plan, round(float(heights.max()) + bridge.soffit, 3), on_columns, tuple(columns))
    for column in span.column_plans:
        if shapely.dwithin(carriageway, column, KERB):
            x, y = column.centroid.x, column.centroid.y
            raise InputError(f"{where}: a column at ({x:.1f}, {y:.1f}) stands on a road; move it")
    return span


def side_cells(bridge: Skybridge, length: float, soffit: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the grid of one glass side: borders across (fractions), heights [m], kinds `FRAME | PANE`."""
    count = max(1, round(length / bridge.bay_m))
    post = min(bridge.mullion_m, 0.5 * length / (count + 1)) / length
    pane = (1.0 - (count + 1) * post) / count
    left = np.arange(count) * (pane + post) + post
    across = np.concatenate([[0.0], np.column_stack([left, left + pane]).ravel(), [1.0]])
    floors = soffit + bridge.deck_m + bridge.storey_m * np.arange(bridge.storeys)
    bands = np.column_stack([floors + SILL, floors + bridge.storey_m - HEAD]).ravel()
    heights = np.concatenate([[soffit], bands, [floors[-1] + bridge.storey_m - HEAD + PARAPET]])
    kinds = np.full((len(heights) - 1, len(across) - 1), FRAME)
    kinds[1::2, 1::2] = PANE
    return across, heights, kinds


def build_skybridge(span: Span, ground: Ground) -> list[MeshPart]:
    """Return the meshes of a skybridge: one closed shell of frame, panes, underside and roof, and the columns.

    All four share the vertices of the sides' grid, so the shell has no open edge. The panes of a side lie in its plane.
    """
    bridge = span.description
    reach = [0.0 if stands else SUNK for stands in span.on_columns]
    x0, x1 = -0.5 * span.length - reach[0], 0.5 * span.length + reach[1]
    y = 0.5 * bridge.width
    across, heights, kinds = side_cells(bridge, x1 - x0, span.soffit)
    frame, panes = [], []
    sides = [((x0, -y), (x1, -y), across, kinds), ((x1, y), (x0, y), 1.0 - across[::-1], kinds[:, ::-1])]
    for start, end, borders, cells in sides:
        made = wall_cells(start, end, borders, heights, cells)
        frame.append(made[FRAME])
        panes.append(made[PANE])
    whole = np.full((len(heights) - 1, 1), FRAME)
    for start, end in (((x1, -y), (x1, y)), ((x0, y), (x0, -y))):
        frame.append(wall_cells(start, end, np.array([0.0, 1.0]), heights, whole)[FRAME])
    x = x0 + across * (x1 - x0)
    meshes = {
        "frame": (merge(frame), bridge.frame),
        "glass": (merge(panes), bridge.glass),
        "underside": (_deck(x, y, span.soffit, is_up=False), bridge.underside),
        "roof": (_deck(x, y, float(heights[-1]), is_up=True), bridge.roof),
    }
    middle = 0.5 * (np.array(bridge.start) + np.array(bridge.end))
    path, at = f"Skybridges/{bridge.name}", (*middle, 0.0)
    parts = [
        MeshPart.of(f"{path}/{name}", place(weld(mesh), at, span.yaw), material, "building")
        for name, (mesh, material) in meshes.items()
    ]
    if span.columns:
        posts = []
        for column, plan in zip(span.columns, span.column_plans, strict=True):
            foot = float(np.nanmin(ground.height(*shapely.get_coordinates(plan).T))) - FOOT
            top = span.soffit + SUNK
            post = box((POST, POST, top - foot), (0.0, 0.0, 0.5 * (top + foot)))
            posts.append(place(post, (*column, 0.0), span.yaw))
        parts.append(MeshPart.of(f"{path}/columns", merge(posts), bridge.underside, "building"))
    return parts


def _deck(x: np.ndarray, y: float, z: float, *, is_up: bool) -> TriangleMesh:
    """Return a level strip between the two sides, cut at the stations `x` [m] of their grid."""
    count = len(x)
    points = np.column_stack([np.tile(x, 2), np.repeat([-y, y], count), np.full(2 * count, z)])
    k = np.arange(count - 1)
    corners = np.column_stack([k, k + 1, k + 1 + count, k + count])
    return quads(points, corners if is_up else corners[:, ::-1])
