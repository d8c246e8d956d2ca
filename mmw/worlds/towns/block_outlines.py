"""Loops: kerb chains linked end to end enclose the blocks of a town, with the very vertices of the sidewalks."""

import numpy as np
import shapely

from mmw.core.errors import InputError
from mmw.worlds.towns.strip_mesh import Chain


def link_chains(chains: list[Chain]) -> list[np.ndarray]:
    """Return closed loops of kerb, sidewalk and verge borders, the carriageway on their left.

    Returns:
        One table a loop, shape [N, 5, 3], without the repeated last row.

    Raises:
        InputError: If the end of a chain does not touch exactly one start.
    """
    start: dict[tuple[float, float], int] = {}
    for k, chain in enumerate(chains):
        key = (float(chain.table[0, 0, 0]), float(chain.table[0, 0, 1]))
        if key in start:
            raise InputError(
                f"kerbs {chains[start[key]].name!r} and {chain.name!r} begin at one point; rebuild the roads"
            )
        start[key] = k
    left, loops = set(range(len(chains))), []
    while left:
        first = k = min(left)
        tables = []
        while True:
            left.discard(k)
            tables.append(chains[k].table[:-1])
            end = (float(chains[k].table[-1, 0, 0]), float(chains[k].table[-1, 0, 1]))
            if end not in start:
                raise InputError(f"the kerb {chains[k].name!r} ends at {end} where no other begins; rebuild the roads")
            k = start[end]
            if k == first:
                break
        loops.append(np.concatenate(tables))
    return loops


def enclosed(loops: list[np.ndarray], border: int) -> shapely.Geometry:
    """Return the region on the left of all loops, along one border of the edge strips.

    Args:
        loops: Tables from `link_chains`.
        border: 0 for the kerb line, 4 for the outer edge of the verge.

    Raises:
        InputError: If two loops cross there, or one crosses itself: roads or sidewalks overlap.
    """
    polygons = [shapely.Polygon(loop[:, border, :2]) for loop in loops]
    for polygon in polygons:
        if not polygon.is_valid:
            raise InputError(
                f"roads overlap: {shapely.is_valid_reason(polygon)}; "
                "move the roads there apart or narrow their sidewalks"
            )
    outer = [polygon for polygon in polygons if polygon.exterior.is_ccw]
    inner = [polygon for polygon in polygons if not polygon.exterior.is_ccw]
    tree = shapely.STRtree(polygons)
    a, b = tree.query(np.array(polygons), predicate="overlaps")
    if len(a):
        where = shapely.point_on_surface(shapely.intersection(polygons[a[0]], polygons[b[0]]))
        raise InputError(f"roads overlap near ({where.x:.0f}, {where.y:.0f}); move the roads there apart")
    return shapely.difference(shapely.union_all(outer), shapely.union_all(inner))
