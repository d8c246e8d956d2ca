"""OpenStreetMap extract (.osm, also packed) -> World: buildings, streets as surfaces, trees; flat, without lanes."""

from pathlib import Path

import numpy as np
import shapely

from mmw.physics.materials.material import RadioMaterial
from mmw.worlds.importers.imported_scene import ImportedMaterial, ImportedScene
from mmw.worlds.importers.osm.buildings import Body, build_body, find_bodies, shared_walls
from mmw.worlds.importers.osm.feature import Extract
from mmw.worlds.importers.osm.ground import build_ground, plan_ground
from mmw.worlds.importers.osm.materials import Palette
from mmw.worlds.importers.osm.xml import read_extract
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.props import build_prop

WATER = ImportedMaterial(
    "water", "water", (0.02, 0.05, 0.06), roughness=0.05, radio=RadioMaterial("itu", itu="itu_wet_ground")
)
"""Open water; the wettest of the ground rows replaces it, design value."""
TREE_SPACING = 8.0
"""Distance of the trees of a row [m]; design value."""

NOTICE = (
    "contains information from OpenStreetMap, (c) OpenStreetMap contributors, which is made available under the Open "
    "Database License (ODbL) 1.0: https://www.openstreetmap.org/copyright"
)
"""Text that has to be named with the data.

Source: ODbL 1.0, section 4.3, and the attribution guidelines of the OSM Foundation."""


def read_osm(path: str | Path, origin: tuple[float, float] | None = None) -> ImportedScene:
    """Read an OpenStreetMap extract.

    Args:
        path: The .osm file, as openstreetmap.org exports it, or one packed by bzip2 or gzip.
        origin: Latitude and longitude of the world's origin [deg]; the middle of the extract if None.

    Returns:
        Buildings as closed solids that reach 0.5 m into the ground, the ground at z = 0, trees. No lanes. All but
        buildings is cut at the `bounds` of the file.

    Raises:
        InputError: If the file is no extract, is broken, is larger than 20 km or holds neither buildings nor roads.
    """
    extract = read_extract(Path(path), origin)
    palette = Palette()
    bodies, notes = find_bodies(extract, palette)
    walls = shared_walls(bodies)
    others: list[dict[tuple, list[Body]]] = [{} for _ in bodies]
    for wall, found in walls.items():
        for k in found:
            others[k][wall] = [bodies[i] for i in found if i != k]
    parts = [part for body, near in zip(bodies, others, strict=True) for part in build_body(body, near)]
    plan, more = plan_ground(extract, [body.plan for body in bodies])
    ground = build_ground(plan)
    trees = _trees(extract, bodies)
    notes = [
        f"origin: latitude {extract.origin[0]:.6f}, longitude {extract.origin[1]:.6f} deg",
        *extract.notes,
        *notes,
        *more,
        *_contacts(bodies, len(walls)),
        "no lanes: for traffic, convert the extract with SUMO (netconvert --osm-files x.osm --opendrive-output x.xodr) "
        "and import that",
    ]
    if palette.unknown:
        notes.append(f"materials and colors not understood: {', '.join(sorted(palette.unknown))}")
    every = [*ground, *parts, *trees]
    foreign = {WATER.name: WATER} if any(part.material == WATER.name for part in every) else {}
    return ImportedScene(every, {**palette.foreign, **foreign}, None, tuple(notes), notice=NOTICE)


def _contacts(bodies: list[Body], shared: int) -> list[str]:
    """Return notes on buildings that touch or overlap."""
    notes = [f"{shared} walls between buildings left out where both sides are covered"] if shared else []
    plans = np.array([body.plan for body in bodies])
    if len(plans) < 2:
        return notes
    first, second = shapely.STRtree(plans).query(plans, predicate="intersects")
    pairs = [(i, j) for i, j in zip(first.tolist(), second.tolist(), strict=True) if i < j]
    pairs = [
        (i, j) for i, j in pairs if min(bodies[i].eaves, bodies[j].eaves) > max(bodies[i].bottom, bodies[j].bottom)
    ]
    count = sum(shapely.intersection(plans[i], plans[j]).area > 0.05 for i, j in pairs)
    if count:
        notes.append(f"{count} pairs of buildings overlap in plan; correct them in the source if walls flicker")
    return notes


def _trees(extract: Extract, bodies: list[Body]) -> list[MeshPart]:
    """Return single trees and rows of trees, none of them inside a building."""
    places = [point.xy[0] for point in extract.points if point.tags.get("natural") == "tree"]
    for way in extract.ways:
        if way.tags.get("natural") == "tree_row" and len(way.xy) > 1:
            line = shapely.LineString(way.xy)
            steps = np.arange(0.0, line.length + 1e-9, TREE_SPACING)
            places += list(shapely.get_coordinates(shapely.line_interpolate_point(line, steps)))
    if not places:
        return []
    built = shapely.union_all([body.plan for body in bodies])
    kept = [xy for xy in places if not shapely.contains_xy(built, *xy)]
    parts = []
    for number, xy in enumerate(kept):
        rng = np.random.default_rng([7, number])
        parts += build_prop(f"tree_{number:04d}", "broadleaf_tree", (*xy.tolist(), 0.0), 0.0, rng)
    return parts
