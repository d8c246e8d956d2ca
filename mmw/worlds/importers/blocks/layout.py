"""Layout of an imported world in plan: carriageways, sidewalks, land, and the zones that nothing is built on."""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from mmw.core.mesh import merge
from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.worlds.importers.imported_scene import ImportedScene
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.plan_geometry import polygons_of, rectangle_at

ROAD_LABELS = ("road", "road_line")
"""Semantic classes of carriageways."""
GROUND_LABELS = (*ROAD_LABELS, "sidewalk", "terrain", "water", "bridge")
"""Semantic classes of what things stand on."""
OPEN_GROUND = "Terrain/ground"
"""Begin of the paths of the land between roads, as importers name it."""
FAST = 25.0
"""Lanes with a higher speed limit are a rural road or a motorway [m/s]: 90 km/h, design value."""
FAST_CLEAR = 12.0
"""Distance of buildings, sidewalks and furniture from fast lanes [m]; design value."""
BRIDGE_CLEAR = 3.0
"""Distance of buildings, sidewalks and furniture from bridges in plan [m]; design value."""
OPEN_END = 60.0
"""How far the land ahead of the open end of a road stays free, for the road goes on there [m]; design value."""
OPEN_WIDTH = 4.0
"""How far beyond the lane, on either side, it stays free [m]; design value."""
SEAM = 0.02
"""Gaps between meshes in plan below twice this are closed [m]; roads that are welded to 1 cm leave them."""


@dataclass(frozen=True)
class Layout:
    """Areas of a world in plan [m]."""

    carriageway: shapely.Geometry
    walks: shapely.Geometry
    """Sidewalks of the source."""
    greens: shapely.Geometry
    """Medians and verges of roads."""
    land: shapely.Geometry
    """Extent of the land between the roads: a box."""
    fast: shapely.Geometry
    """Zone along fast lanes."""
    bridges: shapely.Geometry
    """Zone along bridges."""
    ahead: shapely.Geometry
    """Zones ahead of the open ends of roads."""
    objects: tuple[shapely.Geometry, ...]
    """Plans of buildings, trees and other objects of the source."""

    @property
    def corridor(self) -> shapely.Geometry:
        """Carriageways with all that belongs to their roads."""
        return shapely.union_all([self.carriageway, self.walks, self.greens], grid_size=1e-4)

    @property
    def closed(self) -> shapely.Geometry:
        """Zones that nothing is built on."""
        return shapely.union_all([self.fast, self.bridges, self.ahead])


def find_layout(scene: ImportedScene) -> Layout:
    """Return the areas of an imported world."""
    groups: dict[str, list[MeshPart]] = defaultdict(list)
    for part in scene.parts:
        groups[_group(part)].append(part)
    lanes = list((scene.lanes or LaneGraph()).lanes.values())
    land = groups["land"] or scene.parts
    corners = np.concatenate([part.points[:, :2] for part in land])
    fast = [shapely.LineString(lane.points[:, :2]) for lane in lanes if lane.speed > FAST]
    return Layout(
        plan_of(groups["road"]),
        plan_of(groups["walk"]),
        plan_of(groups["green"]),
        shapely.box(*corners.min(axis=0), *corners.max(axis=0)),
        shapely.buffer(shapely.union_all(fast), FAST_CLEAR),
        shapely.buffer(_bridge_plan(scene.parts), BRIDGE_CLEAR),
        shapely.union_all([_ahead(*end) for end in open_ends(scene.lanes)]),
        tuple(_object_plans(groups["object"])),
    )


def _group(part: MeshPart) -> str:
    if part.label in ROAD_LABELS:
        return "road"
    if part.label == "sidewalk":
        return "walk"
    if part.path.startswith(OPEN_GROUND):
        return "land"
    return "green" if part.label in GROUND_LABELS else "object"


def plan_of(parts: Sequence[MeshPart]) -> shapely.Geometry:
    """Return the area in plan of the upward faces of meshes, without seams."""
    if not parts:
        return shapely.MultiPolygon()
    corners = merge(part.mesh for part in parts)
    faces = corners.corners[corners.crosses[:, 2] > 1e-7][:, :, :2]
    whole = shapely.union_all(shapely.polygons(faces), grid_size=1e-4)
    whole = shapely.buffer(shapely.buffer(whole, SEAM, join_style="mitre"), -SEAM, join_style="mitre")
    return shapely.MultiPolygon(polygons_of(shapely.simplify(whole, 0.001), 0.01))


def _bridge_plan(parts: Sequence[MeshPart]) -> shapely.Geometry:
    """Return the plan of all faces of bridges, those that look down too."""
    faces = [part.mesh.corners[:, :, :2] for part in parts if part.label == "bridge"]
    if not faces:
        return shapely.Polygon()
    areas = np.asarray(shapely.polygons(np.concatenate(faces)))
    return shapely.union_all(areas[shapely.area(areas) > 1e-6])


def open_ends(lanes: LaneGraph | None) -> list[tuple[np.ndarray, np.ndarray, float]]:
    """Return where lanes begin or end at nothing: point [2], direction away from the road [2], lane width [m]."""
    found: list[tuple[np.ndarray, np.ndarray, float]] = []
    if lanes is None:
        return found

    def add(lane: Lane, last: int, before: int) -> None:
        end = lane.points[last, :2]
        away = end - lane.points[before, :2]
        if np.linalg.norm(away) > 1e-9:
            found.append((end, away / np.linalg.norm(away), lane.width))

    for name, lane in lanes.lanes.items():
        if not lane.successors:
            add(lane, -1, -2)
        if not lanes.predecessors[name]:
            add(lane, 0, 1)
    return found


def _ahead(end: np.ndarray, away: np.ndarray, width: float) -> shapely.Polygon:
    middle = end + 0.5 * OPEN_END * away
    return rectangle_at(middle.tolist(), float(np.arctan2(away[1], away[0])), OPEN_END, width + 2 * OPEN_WIDTH)


def _object_plans(parts: Sequence[MeshPart]) -> list[shapely.Geometry]:
    """Return the hulls of objects: parts below one prim of the second level are one."""
    points: dict[str, list[np.ndarray]] = defaultdict(list)
    for part in parts:
        points["/".join(part.path.split("/")[:2])].append(part.points[:, :2])
    return [shapely.MultiPoint(np.concatenate(found)).convex_hull for found in points.values()]
