"""Build sidewalks with kerbs along carriageways that border on open ground."""

import numpy as np
import shapely
from shapely.geometry.polygon import orient

from mmw.core.mesh import merge
from mmw.worlds.importers.blocks.layout import ROAD_LABELS, Layout
from mmw.worlds.importers.imported_scene import ImportedScene
from mmw.worlds.importers.opendrive.cross_section import KERB_HEIGHT
from mmw.worlds.importers.opendrive.curbs import SLAB
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.plan_geometry import PlanFaces, polygons_of, subtract_area, triangulate_polygons
from mmw.worlds.towns.strip_mesh import Surface

WIDTH = 2.0
"""Width of a sidewalk [m]; that of our own towns."""
BESIDE = 0.3
"""A carriageway with a sidewalk or a verge within this distance needs none [m]; design value."""
EVERY = 2.0
"""Largest distance of the vertices along a sidewalk [m]; design value."""
MIN_WIDTH = 0.6
"""Narrower pieces are left out [m]; design value."""
MIN_AREA = 6.0
"""Smaller pieces are left out [m^2]; design value."""
SEAM_REACH = 0.05
"""How far the opened area reaches over the borders of the whole one [m]."""
SPIKE = 0.005
"""Spikes narrower than twice this are cut off [m]."""
SLOT = 0.003
"""Distance of a kerb from the side of its road [m]: over the 2 mm in which faces count as one plane."""
BELOW = 0.05
"""How far kerbs reach below the carriageway [m], so that nothing looks through beneath them; design value."""
TOUCH = 0.01
"""Edges this close to a carriageway or a sidewalk lie on its border [m]."""
ABOVE_GROUND = 0.03
"""Least height above the ground, where that rises from the road [m]; design value."""


def plan_sidewalks(layout: Layout) -> shapely.MultiPolygon:
    """Return the areas of new sidewalks in plan."""
    taken = shapely.union(layout.walks, layout.greens)
    bare = shapely.difference(shapely.boundary(layout.carriageway), shapely.buffer(taken, BESIDE))
    strips = shapely.buffer(bare, WIDTH, cap_style="flat", join_style="round", quad_segs=4)
    objects = shapely.union_all([shapely.buffer(plan, 0.1) for plan in layout.objects])
    rest = shapely.MultiPolygon(polygons_of(shapely.union_all(strips, grid_size=1e-4), 0.0))
    paved = shapely.buffer(layout.carriageway, SLOT, join_style="mitre")
    for area in (paved, taken, layout.closed, objects):
        rest = subtract_area(rest, area, 1e-4)
    opened = shapely.buffer(shapely.buffer(rest, -0.5 * MIN_WIDTH), 0.5 * MIN_WIDTH + SEAM_REACH, join_style="mitre")
    rest = shapely.intersection(rest, opened)  # wide pieces keep their border with the carriageway
    rest = shapely.buffer(shapely.buffer(rest, -SPIKE, join_style="mitre"), SPIKE, join_style="mitre")
    return shapely.MultiPolygon([orient(part) for part in polygons_of(rest, MIN_AREA)])


def build_sidewalks(scene: ImportedScene, layout: Layout, areas: shapely.MultiPolygon) -> list[MeshPart]:
    """Return sidewalks, a kerb higher than the carriageway beside them, with sides down into the ground.

    Args:
        scene: The world, for the heights of its roads and its ground.
        layout: Its areas.
        areas: Result of `plan_sidewalks`.
    """
    roads = _faces([part for part in scene.parts if part.label in ROAD_LABELS])
    land = _faces([part for part in scene.parts if part.label == "terrain"])
    edge = shapely.boundary(layout.carriageway)
    shapely.prepare(edge)
    walks = shapely.boundary(layout.walks)
    parts = []
    for number, area in enumerate(polygons_of(areas, 0.0), 1):
        polygon = shapely.segmentize(area, EVERY)
        triangles = triangulate_polygons(polygon)
        xy, index = np.unique(triangles.reshape(-1, 2), axis=0, return_inverse=True)
        kerb = shapely.get_coordinates(shapely.shortest_line(shapely.points(xy), edge)).reshape(-1, 2, 2)[:, 1]
        road = _lowest(roads, kerb)
        is_known = np.isfinite(road)
        if not is_known.any():
            continue
        nearest = shapely.STRtree(shapely.points(xy[is_known])).nearest(shapely.points(xy))
        road = road[is_known][nearest]
        z = np.fmax(road + KERB_HEIGHT, _lowest(land, xy) + ABOVE_GROUND)
        surface = Surface()
        top = surface.add_points(np.column_stack([xy, z]))
        surface.add_faces("concrete_sidewalk", top[index.reshape(-1, 3)])
        height = {tuple(point): (z[k], road[k]) for k, point in enumerate(xy.tolist())}
        for ring in (polygon.exterior, *polygon.interiors):
            _add_sides(surface, shapely.get_coordinates(ring), height, edge, walks)
        name = f"front_{number:03d}"
        paths = {
            "concrete_sidewalk": (f"Sidewalks/{name}/walk", "sidewalk"),
            "curb": (f"Sidewalks/{name}/curb", "sidewalk"),
        }
        parts += surface.parts(paths)
    return parts


def _add_sides(
    surface: Surface,
    ring: np.ndarray,
    height: dict[tuple[float, ...], tuple[float, float]],
    edge: shapely.Geometry,
    walks: shapely.Geometry,
) -> None:
    """Add the vertical faces below a ring [N, 2], the outside on its right: to the road, else into the ground."""
    heights = np.array([height[tuple(point)] for point in ring.tolist()])
    a, b = ring[:-1], ring[1:]
    middle = shapely.points(0.5 * (a + b))
    at_road = np.asarray(shapely.dwithin(edge, middle, TOUCH))
    is_open = ~shapely.dwithin(walks, middle, TOUCH)
    low_a = np.column_stack([a, np.where(at_road, heights[:-1, 1] - BELOW, heights[:-1, 0] - SLAB)])[is_open]
    low_b = np.column_stack([b, np.where(at_road, heights[1:, 1] - BELOW, heights[1:, 0] - SLAB)])[is_open]
    top_a, top_b = np.column_stack([a, heights[:-1, 0]])[is_open], np.column_stack([b, heights[1:, 0]])[is_open]
    i, j, k, m = surface.add_points(np.concatenate([low_a, low_b, top_a, top_b])).reshape(4, -1)
    surface.add_faces("curb", np.column_stack([i, j, m]))
    surface.add_faces("curb", np.column_stack([i, m, k]))


def _faces(parts: list[MeshPart]) -> PlanFaces:
    mesh = merge(part.mesh for part in parts)
    return PlanFaces(mesh.corners[mesh.crosses[:, 2] > 1e-7])


def _lowest(faces: PlanFaces, xy: np.ndarray) -> np.ndarray:
    """Return the height of the lowest face at points [N, 2], NaN where there is none, shape [N]."""
    query, (p, q), z = faces.hits(xy, 2 * TOUCH)
    inside = (p > -0.5) & (q > -0.5) & (p + q < 1.5)  # a sliver must not be extended to far heights
    found = np.full(len(xy), np.inf)
    np.minimum.at(found, query[inside], z[inside])
    return np.where(np.isfinite(found), found, np.nan)
