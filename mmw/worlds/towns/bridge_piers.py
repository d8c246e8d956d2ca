"""Piers of elevated roads: columns with a cross-head below the soffit, clear of what lies on the ground."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
import shapely

from mmw.core.errors import InputError
from mmw.core.mesh import TriangleMesh, merge
from mmw.worlds.towns.checks import MIN_CLEARANCE
from mmw.worlds.towns.elevated_roads import FOOT, Structure, Walls, bridge_of, outer_offset
from mmw.worlds.towns.ground_height import Ground
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.primitives import circle, place, prism, quads
from mmw.worlds.towns.roads import RoadBody

CLEAR = 0.5
"""Least distance of a column from the corridor of a road on the ground [m]; design value."""
COLUMN_PITCH = 9.0
"""A cross-head has a column for every so many meters of its length, begun [m]; design value."""
HEAD_DEPTH = 1.0
"""Depth of a cross-head below the soffit [m]; design value."""
HEAD_MARGIN = 0.75
"""The ends of a cross-head stay this far inside the outer faces of the deck [m]; design value."""
REACH = 8.0
"""How far beside the deck a column may stand that carries it by a beam [m]; design value."""
TRY_STEP = 0.5
"""Distance of the places that are tried, along and across [m]."""
EMBEDDED = 0.2
"""How far a column reaches into its cross-head, so that no gap is left [m]."""
SIDES = 12
"""Sides of a round column."""


@dataclass(frozen=True)
class _Site:
    """A cross-section of a bridge where a pier may stand."""

    station: float
    xy: np.ndarray
    left: np.ndarray
    soffit: float
    """Height of the soffit [m]."""
    grade: float
    """Slope of the deck along the road [-]."""

    def at(self, offset: np.ndarray) -> np.ndarray:
        """Return points at lateral offsets [m], shape [K, 2]."""
        return self.xy + np.asarray(offset)[..., None] * self.left


def add_piers(
    body: RoadBody, structure: Structure, walls: Walls, blocked: shapely.Geometry, carriageway: shapely.Geometry,
    ground: Ground,
) -> Structure:  # fmt: skip
    """Return a bridge with its piers.

    A pier stands at its even share of the span. Where something lies below, it moves along the deck; where that does
    not help, two columns stand beside the deck and carry a beam.

    Args:
        body: The road.
        structure: Its bridge, without piers.
        walls: Where the bridge is filled.
        blocked: Plan of what no column may stand on: roads with their sidewalks, other bridges.
        carriageway: Drivable area on the ground.
        ground: Heights of the ground.

    Raises:
        InputError: If a pier finds no place.
    """
    bridge, begin, _ = bridge_of(body)
    name = body.road.id
    first, last = body.rows.s[begin + walls.first], body.rows.s[begin + walls.last]
    count = max(1, round((last - first) / bridge.piers_every))
    pitch = (last - first) / count
    ring = _ring(bridge.columns, bridge.column_width)
    avoided = shapely.buffer(blocked, CLEAR + np.linalg.norm(ring[0]))
    shapely.prepare(avoided)
    meshes, plans, heads = [], [structure.supports], [structure.underside]
    for k in range(1, count):
        tries = _tries(body, first + k * pitch, 0.45 * pitch, avoided)
        fits = ((site, t) for site, t in tries if _is_clear(site, t, carriageway, ground))
        site, columns = next(fits, (None, None))
        if site is None or columns is None:
            x, y = _site(body, first + k * pitch).xy
            raise InputError(
                f"road {name!r}: no place for a pier near station {first + k * pitch:.0f} m, at ({x:.0f}, {y:.0f}): "
                "roads lie below; change piers_every, move the roads, or raise the bridge for a beam across them"
            )
        feet = site.at(columns)
        floor = ground.height(feet[:, 0], feet[:, 1])
        if np.isnan(floor).any():
            raise InputError(
                f"road {name!r}: no ground for a pier at station {site.station:.0f} m; increase terrain.margin"
            )
        head, low = _head(site, columns, outer_offset(body), bridge.column_width)
        yaw = float(np.arctan2(site.left[1], site.left[0]))
        for foot, z in zip(feet, floor, strict=True):
            column = prism(ring, z - FOOT, site.soffit - HEAD_DEPTH + EMBEDDED)
            meshes.append(place(column, (*foot, 0.0), yaw))
            plans.append(shapely.convex_hull(shapely.multipoints(meshes[-1].points[:, :2])))
        meshes.append(head)
        heads.append(low)
    if not meshes:
        return structure
    part = MeshPart.of(f"Bridges/{name}/piers", merge(meshes), "concrete_structure", "bridge")
    return replace(
        structure,
        parts=(*structure.parts, part),
        supports=shapely.union_all(plans),
        underside=np.concatenate(heads),
    )


def _site(body: RoadBody, station: float) -> _Site:
    rows = body.rows
    bridge, _, _ = bridge_of(body)
    k = int(np.clip(np.searchsorted(rows.s, station, side="right") - 1, 0, len(rows.s) - 2))
    gap = rows.s[k + 1] - rows.s[k]
    share = (station - rows.s[k]) / gap
    mixed = [(1 - share) * values[k] + share * values[k + 1] for values in (rows.xy, rows.left, rows.z)]
    left = mixed[1] / np.linalg.norm(mixed[1])
    return _Site(station, mixed[0], left, float(mixed[2]) - bridge.deck, float(rows.z[k + 1] - rows.z[k]) / float(gap))


def _tries(
    body: RoadBody, station: float, reach: float, avoided: shapely.Geometry
) -> Iterator[tuple[_Site, np.ndarray]]:
    """Yield places for a pier with the lateral positions of its columns [m], the best first."""
    half = outer_offset(body)
    count = int(np.ceil(2 * half / COLUMN_PITCH))
    regular = (np.arange(count) + 0.5 - 0.5 * count) * 2 * half / count
    steps = np.arange(0.0, reach, TRY_STEP)
    sites = [_site(body, station + sign * step) for step in steps for sign in ((1, -1) if step else (1,))]
    for site in sites:
        if _is_free(site, regular, avoided).all():
            yield site, regular
    beside = np.arange(0.5 * half, half + REACH, TRY_STEP)
    for site in sites:
        free = [np.flatnonzero(_is_free(site, sign * beside, avoided)) for sign in (-1, 1)]
        if all(len(found) for found in free):
            yield site, np.array([-beside[free[0][0]], beside[free[1][0]]])


def _is_free(site: _Site, offset: np.ndarray, avoided: shapely.Geometry) -> np.ndarray:
    points = site.at(offset)
    return ~shapely.intersects_xy(avoided, points[:, 0], points[:, 1])


def _is_clear(site: _Site, columns: np.ndarray, carriageway: shapely.Geometry, ground: Ground) -> bool:
    """Return whether the cross-head leaves enough height above every carriageway below it."""
    points = site.at(np.arange(columns.min() - 1.0, columns.max() + 1.0, TRY_STEP))
    points = points[shapely.intersects_xy(shapely.buffer(carriageway, 1.0), points[:, 0], points[:, 1])]
    z = ground.height(points[:, 0], points[:, 1])
    return bool(np.all(np.isnan(z) | (site.soffit - HEAD_DEPTH - z >= MIN_CLEARANCE)))


def _ring(form: str, width: float) -> np.ndarray:
    """Return the plan of a column about its axis [m], shape [K, 2]."""
    return circle(0.5 * width, SIDES) if form == "round" else circle(width / np.sqrt(2), 4, np.pi / 4)


def _head(site: _Site, columns: np.ndarray, half: float, width: float) -> tuple[TriangleMesh, np.ndarray]:
    """Return a cross-head, a box across the road that reaches a little into the deck, and its underside facing up."""
    reach = max(half - HEAD_MARGIN, float(np.abs(columns).max()) + 0.5 * width + 0.2)
    along = 0.5 * width + 0.2
    forward = np.array([site.left[1], -site.left[0]])
    corner = np.array([site.xy + a * along * forward + t * site.left for a, t in (
        (-1, -reach), (1, -reach), (1, reach), (-1, reach))])  # fmt: skip
    low, high = site.soffit - HEAD_DEPTH, site.soffit + abs(site.grade) * along + 0.1
    points = np.concatenate([np.column_stack([corner, np.full(4, z)]) for z in (low, high)])
    mesh = quads(points, [[3, 2, 1, 0], [4, 5, 6, 7], [0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7]])
    return mesh, points[np.array([[0, 1, 2], [0, 2, 3]])]
