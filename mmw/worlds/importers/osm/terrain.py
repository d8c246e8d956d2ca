"""Heights under an OpenStreetMap extract: its buildings stand on the lowest ground below their walls."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely

from mmw.core.georeference import Georeference
from mmw.core.planar_surfaces import components
from mmw.worlds.importers.geo.relief import Relief, read_relief
from mmw.worlds.importers.osm.buildings import Body
from mmw.worlds.importers.osm.feature import Extract

TOUCH = 0.05
"""Pieces of one building closer than this touch [m]."""
EVERY = 2.0
"""Distance of the heights that are looked at along the walls of a building [m]; design value."""


def relief_of(extract: Extract, path: Path) -> Relief:
    """Return the heights of a raster under an extract, smooth along its roads.

    Raises:
        InputError: If the raster cannot be used, see `read_relief`.
    """
    found = [f.xy for f in (*extract.ways, *extract.points) if len(f.xy) and f.tags]
    found += [shapely.get_coordinates(f.area) for f in (*extract.ways, *extract.relations) if f.area is not None]
    every = np.concatenate(found) if found else np.zeros((1, 2))
    roads = [shapely.LineString(way.xy) for way in extract.ways if way.tags.get("highway") and len(way.xy) > 1]
    box = np.concatenate([every.min(axis=0), every.max(axis=0)])
    return read_relief(path, Georeference(*extract.origin).degrees, box, roads)


def stand_on(bodies: list[Body], height: Callable[[np.ndarray], np.ndarray]) -> list[Body]:
    """Return buildings moved up by the lowest ground below their walls; pieces of one that touch move together.

    Args:
        bodies: Buildings on ground at z = 0.
        height: Height of the ground [m], shape [N, 2] -> [N].
    """
    if not bodies:
        return []
    rings = [shapely.get_coordinates(shapely.segmentize(body.plan, EVERY)) for body in bodies]
    z = height(np.concatenate(rings))
    start = np.cumsum([0, *(len(ring) for ring in rings)])[:-1]
    lowest = np.minimum.reduceat(z, start)
    plans = np.array([body.plan for body in bodies])
    first, second = shapely.STRtree(plans).query(plans, predicate="dwithin", distance=TOUCH)
    stems = np.array([body.name.split("_")[0] for body in bodies])
    is_one = stems[first] == stems[second]
    whole = components(len(bodies), first[is_one], second[is_one])
    together = np.full(len(bodies), np.inf)
    np.minimum.at(together, whole, lowest)
    lowest = together[whole]
    return [
        replace(body, bottom=body.bottom + base, eaves=body.eaves + base)
        for body, base in zip(bodies, lowest.tolist(), strict=True)
    ]
