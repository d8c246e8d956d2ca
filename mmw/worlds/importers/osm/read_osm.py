"""OpenStreetMap extract (.osm, also packed) -> World, flat: buildings, streets, trees, and lanes where asked for."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely

from mmw.core.georeference import Georeference
from mmw.physics.materials.material import RadioMaterial
from mmw.worlds.importers.geo.drape import drape
from mmw.worlds.importers.imported_scene import ImportedMaterial, ImportedScene
from mmw.worlds.importers.osm.bounds import read_bbox
from mmw.worlds.importers.osm.building_overlaps import HEADROOM
from mmw.worlds.importers.osm.buildings import Body, find_bodies
from mmw.worlds.importers.osm.crossings import stripe_crossings
from mmw.worlds.importers.osm.feature import Extract
from mmw.worlds.importers.osm.ground import build_ground, plan_ground
from mmw.worlds.importers.osm.materials import Palette
from mmw.worlds.importers.osm.quarter import build_quarter
from mmw.worlds.importers.osm.signals import build_signals
from mmw.worlds.importers.osm.terrain import relief_of
from mmw.worlds.importers.osm.traffic import build_roads
from mmw.worlds.importers.osm.xml import read_extract
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.props import build_prop

WATER = ImportedMaterial(
    "water", "water", (0.02, 0.05, 0.06), roughness=0.05, radio=RadioMaterial("itu", itu="itu_wet_ground")
)
"""Open water; the wettest of the ground rows replaces it, design value."""
TREE_SPACING = 8.0
"""Distance of the trees of a row [m]; design value."""
CLEAR = 0.05
"""Distance of buildings from the carriageway [m]; design value, kerbs and walls share no plane."""
TRUNK = 0.8
"""Trees nearer to the carriageway are left out [m]; design value. Crowns over it are raised above vehicles."""

NOTICE = (
    "contains information from OpenStreetMap, (c) OpenStreetMap contributors, which is made available under the Open "
    "Database License (ODbL) 1.0: https://www.openstreetmap.org/copyright"
)
"""Text that has to be named with the data.

Source: ODbL 1.0, section 4.3, and the attribution guidelines of the OSM Foundation."""


def read_osm(
    path: str | Path,
    origin: tuple[float, float] | None = None,
    *,
    bbox: str = "",
    traffic: bool = False,
    driving_side: str = "",
    windows: str = "",
    terrain: str = "",
) -> ImportedScene:
    """Read an OpenStreetMap extract.

    Args:
        path: The .osm file, as openstreetmap.org exports it, or one packed by bzip2 or gzip.
        origin: Latitude and longitude of the world's origin [deg]; the middle of the extract if None.
        bbox: West, south, east and north, separated by commas [deg], that count instead of the `bounds` of the file.
        traffic: Whether roads get lanes, by SUMO's netconvert.
        driving_side: `left` or `right`; empty to tell it from the extract and its place.
        windows: `single`, `bands` or `none`; empty for single ones unless there are very many.
        terrain: Raster of heights that the ground follows; empty for level ground.

    Returns:
        Buildings as closed solids that reach 0.5 m into the ground, the ground at z = 0, trees, and lanes where
        `traffic`. All but buildings is cut at the `bounds` of the file.

    Raises:
        InputError: If the file is no extract, is broken, is larger than 20 km or holds neither buildings nor roads; if
            there are no roads for `traffic`.
        MissingPackageError: If netconvert is needed and missing.
    """
    extract = read_extract(Path(path), origin, read_bbox(bbox) if bbox else None)
    palette = Palette()
    bodies, notes = find_bodies(extract, palette)
    relief = relief_of(extract, Path(terrain)) if terrain else None
    roads = build_roads(extract, driving_side) if traffic else None
    paved = roads.areas["paved"] if roads else None
    free = None if paved is None else paved.buffer(CLEAR, quad_segs=2)
    bodies, parts, apart = build_quarter(bodies, free, windows, relief.height if relief is not None else None)
    plan, more = plan_ground(extract, [body.plan for body in bodies], roads.areas if roads else None)
    if roads:
        asphalt = shapely.union(roads.areas["paved"], shapely.difference(plan.layers["road"], roads.areas["raised"]))
        stripes, striped = stripe_crossings(extract, asphalt, roads.crossings)
        plan.layers["paint"] = shapely.union(plan.layers["paint"], stripes)
        more += [f"{striped} crossings of the map have stripes besides"] * bool(striped)
    ground = build_ground(plan)
    trees = place_trees(extract, bodies, paved)
    lights: list[MeshPart] = []
    if roads:
        plans = [body.plan for body in bodies if body.bottom < HEADROOM]
        lights, crowded = build_signals(roads.lanes, roads.areas["paved"], plans, is_left_hand=roads.is_left_hand)
        apart += [f"{crowded} approaches have no room for the pole of a traffic light"] * bool(crowded)
    notes = [
        f"origin: latitude {extract.origin[0]:.6f}, longitude {extract.origin[1]:.6f} deg; of the sensor gnss: "
        f"reference_latitude_deg: {extract.origin[0]:.6f}, reference_longitude_deg: {extract.origin[1]:.6f}",
        *extract.notes,
        *notes,
        *more,
        *apart,
        *(roads.notes if roads else ["no lanes: --traffic gives the roads lanes"]),
    ]
    if palette.unknown:
        notes.append(f"materials and colors not understood: {', '.join(sorted(palette.unknown))}")
    every = [*ground, *parts, *trees, *lights]
    foreign = {WATER.name: WATER} if any(part.material == WATER.name for part in every) else {}
    lanes, place = roads.lanes if roads else None, Georeference(*extract.origin)
    materials = {**palette.foreign, **foreign}
    scene = ImportedScene(every, materials, lanes, tuple(notes), georeference=place, notice=NOTICE)
    return drape(scene, relief, "Buildings/") if relief is not None else scene


def place_trees(extract: Extract, bodies: list[Body], paved: shapely.Geometry | None) -> list[MeshPart]:
    """Return single trees and rows of trees, none of them inside a building or on the carriageway."""
    places = [point.xy[0] for point in extract.points if point.tags.get("natural") == "tree"]
    for way in extract.ways:
        if way.tags.get("natural") == "tree_row" and len(way.xy) > 1:
            line = shapely.LineString(way.xy)
            steps = np.arange(0.0, line.length + 1e-9, TREE_SPACING)
            places += list(shapely.get_coordinates(shapely.line_interpolate_point(line, steps)))
    if not places:
        return []
    built = shapely.union_all([body.plan for body in bodies])
    if paved is not None:
        built = shapely.union(built, paved.buffer(TRUNK, quad_segs=2))
        shapely.prepare(paved)
    shapely.prepare(built)
    kept = [xy for xy in places if not shapely.contains_xy(built, *xy)]
    parts = []
    for number, xy in enumerate(kept):
        rng = np.random.default_rng([7, number])
        tree = build_prop(f"tree_{number:04d}", "broadleaf_tree", (*xy.tolist(), 0.0), 0.0, rng)
        crown = [part for part in tree if part.points[:, 2].min() > 1.0]
        reach = max((float(np.linalg.norm(part.points[:, :2] - xy, axis=1).max()) for part in crown), default=0.0)
        if paved is not None and crown and shapely.dwithin(paved, shapely.Point(xy), reach):
            low = min(float(part.points[:, 2].min()) for part in crown)
            tall = np.array([1.0, 1.0, max(1.0, (HEADROOM + 0.1) / low)])
            tree = [replace(part, points=part.points * tall) for part in tree]
        parts += tree
    return parts
