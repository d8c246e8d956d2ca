"""Buildings of an extract together: apart from each other, without the walls that they share, with windows."""

from collections.abc import Callable

import numpy as np
import shapely

from mmw.core.errors import InputError
from mmw.worlds.importers.osm.building_overlaps import keep_apart
from mmw.worlds.importers.osm.buildings import Body, build_body, shared_walls
from mmw.worlds.importers.osm.terrain import stand_on
from mmw.worlds.importers.osm.windows import LAYOUT, MAX_WINDOWS
from mmw.worlds.towns.mesh_part import MeshPart

Height = Callable[[np.ndarray], np.ndarray]
BANDS_NOTE = f"over {MAX_WINDOWS:,} windows: one band of glass for each storey; windows=single or none changes it"
LAYOUTS = ("single", "bands", "none")
"""Layouts of windows."""


def build_quarter(
    bodies: list[Body], paved: shapely.Geometry | None = None, windows: str = "", height: Height | None = None
) -> tuple[list[Body], list[MeshPart], list[str]]:
    """Return buildings as they are built on level ground, their meshes, and notes for people.

    Args:
        bodies: The buildings.
        paved: Area that they have to leave free [m]; None without lanes.
        windows: `single`, `bands` or `none`; empty for single ones unless there are very many.
        height: Height of the ground that they stand on [m], shape [N, 2] -> [N]; None for z = 0.

    Raises:
        InputError: If `windows` is another word.
    """
    bodies, notes = keep_apart(bodies, paved)
    standing = bodies if height is None else stand_on(bodies, height)
    walls = shared_walls(standing)
    others: list[dict[tuple, list[Body]]] = [{} for _ in standing]
    for wall, found in walls.items():
        for k in found:
            others[k][wall] = [standing[i] for i in found if i != k]
    layout = _layout(bodies, windows)
    parts = [part for body, near in zip(standing, others, strict=True) for part in build_body(body, near, layout)]
    notes += [f"{len(walls)} walls between buildings left out where both sides are covered"] * bool(walls)
    notes += [BANDS_NOTE] * (layout == "bands" and not windows)
    return bodies, parts, notes


def _layout(bodies: list[Body], windows: str) -> str:
    """Return `single`, `bands` or `none`: as given, else single windows unless there are too many."""
    if windows:
        if windows not in LAYOUTS:
            raise InputError(f"windows={windows}: is not known; give one of {', '.join(LAYOUTS)}")
        return windows
    length = sum(body.plan.length * body.storeys for body in bodies)
    return "single" if length / LAYOUT.bay_m <= MAX_WINDOWS else "bands"
