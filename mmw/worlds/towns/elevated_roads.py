"""Elevated roads: where walls carry a bridge, where piers, and how the ground closes around it."""

from dataclasses import dataclass

import numpy as np
import shapely

from mmw.core.errors import InputError
from mmw.worlds.towns.description import Bridge
from mmw.worlds.towns.ground_height import Ground
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.roads import RoadBody
from mmw.worlds.towns.strip_mesh import Chain

PARAPET_WIDTH = 0.3
"""Thickness of a parapet [m]; design value."""
FOOT = 1.0
"""How far walls and columns reach into the ground [m]; design value."""
AROUND, MAX_STEP = 20.0, 1.5
"""A bridge begins where the road is less than `MAX_STEP` above the ground `AROUND` it, beside and ahead [m]; design
values."""


@dataclass(frozen=True)
class Structure:
    """A bridge as built."""

    road: str
    parts: tuple[MeshPart, ...]
    plan: shapely.Polygon
    """Everything between the outer faces of the parapets."""
    supports: shapely.Geometry
    """Plan of walls, fill and columns on the ground."""
    surface: np.ndarray
    """Triangles of the carriageway, facing up [m], shape [M, 3, 3]."""
    underside: np.ndarray
    """Triangles of the soffit and of the underside of the cross-heads, facing up [m], shape [K, 3, 3]."""

    @property
    def cover(self) -> shapely.Geometry:
        """Plan of the whole structure, with cross-heads and columns that stand beside the deck."""
        heads = shapely.union_all(shapely.polygons(self.underside[:, :, :2]))
        return shapely.union_all([self.plan, self.supports, heads])


@dataclass(frozen=True)
class Walls:
    """Stretch of a structure between walls; rows count from the beginning of the bridge."""

    first: int
    """Row of the abutment at the end of the first fill."""
    last: int
    """Row of the abutment at the begin of the second fill."""
    ground: np.ndarray
    """Height of the ground at the right and at the left face of every row of the bridge [m], shape [N, 2]."""
    foot: np.ndarray
    """Height of the underside of the fill at every row [m], shape [N]."""


def bridge_of(body: RoadBody) -> tuple[Bridge, int, int]:
    """Return the bridge of a road that has one, and its first and last row."""
    assert body.road.bridge is not None and body.cut is not None
    return body.road.bridge, *body.cut


def outer_offset(body: RoadBody) -> float:
    """Return the distance from the reference line to the outer face of a parapet [m]."""
    return body.section.half + float(body.section.edge[3, 0]) + PARAPET_WIDTH


def outer_faces(body: RoadBody) -> np.ndarray:
    """Return the right and the left outer face in plan at every row of the bridge [m], shape [N, 2, 2]."""
    _, begin, end = bridge_of(body)
    offset = outer_offset(body)
    xy, left = body.rows.xy[begin : end + 1], body.rows.left[begin : end + 1]
    return np.stack([xy - offset * left, xy + offset * left], axis=1)


def plan_of(body: RoadBody, rows: slice = slice(None)) -> shapely.Polygon:
    """Return the plan of a bridge, or of some of its rows.

    Raises:
        InputError: If it crosses itself.
    """
    faces = outer_faces(body)[rows]
    plan = shapely.Polygon(np.concatenate([faces[:, 0], faces[::-1, 1]]))
    if not plan.is_valid:
        raise InputError(
            f"road {body.road.id!r}: the plan of its bridge crosses itself ({shapely.is_valid_reason(plan)}); "
            "widen the bends, or split the road at a node"
        )
    return plan


def find_walls(body: RoadBody, ground: Ground) -> Walls:
    """Return how far a bridge is filled at both ends.

    Raises:
        InputError: If the bridge begins or ends above the ground, leaves the terrain, lies in the ground, never rises
            to `fill_below`, or comes down to it in between.
    """
    bridge, begin, end = bridge_of(body)
    name, rows = body.road.id, slice(begin, end + 1)
    z, xy, s = body.rows.z[rows], body.rows.xy[rows], body.rows.s[rows]
    faces = outer_faces(body)
    at = np.concatenate([faces, xy[:, None]], axis=1)
    level = ground.height(at[:, :, 0], at[:, :, 1])
    kerb = body.section.edge[3, 1]
    level[[0, -1]] = z[[0, -1], None] + kerb  # the border of the ground itself
    if np.isnan(level).any():
        k = int(np.argmax(np.isnan(level).any(axis=1)))
        raise InputError(f"road {name!r}: no ground below its bridge at station {s[k]:.1f} m; increase terrain.margin")
    _check_ends(body, ground)
    height = z - level.max(axis=1)
    if height.min() < -kerb - 0.5 * bridge.parapet:
        k = int(np.argmin(height))
        raise InputError(
            f"road {name!r}: its bridge lies {-height[k]:.1f} m below the ground at station {s[k]:.1f} m; raise the "
            "road there or end the bridge"
        )
    high = np.flatnonzero(height >= bridge.fill_below)
    if not len(high):
        raise InputError(
            f"road {name!r}: its bridge rises to {height.max():.1f} m above the ground; more than fill_below = "
            f"{bridge.fill_below} m is needed; raise the road, lower fill_below, or remove `bridge`"
        )
    first, last = int(high[0]), int(high[-1])
    if last == first:
        first, last = max(first - 1, 1), min(last + 1, len(z) - 2)
    dip = first + int(np.argmin(height[first : last + 1]))
    if height[dip] < min(bridge.fill_below, height[first], height[last]):
        raise InputError(
            f"road {name!r}: its bridge comes down to {height[dip]:.1f} m above the ground at station {s[dip]:.1f} m; "
            f"fill_below = {bridge.fill_below} m is needed between its ends; make it two bridges, or raise the road"
        )
    foot = np.minimum(level.min(axis=1) - FOOT, z - bridge.deck - 0.5)
    return Walls(first, last, level[:, :2], foot)


def _check_ends(body: RoadBody, ground: Ground) -> None:
    """Raise InputError if the road is well above the ground around it where its bridge begins or ends."""
    _, begin, end = bridge_of(body)
    offset = outer_offset(body) + AROUND
    for key, row, sense in (("from", begin, 1.0), ("to", end, -1.0)):
        xy, left = body.rows.xy[row], body.rows.left[row]
        ahead = sense * np.array([left[1], -left[0]])
        points = np.array([xy + offset * left, xy - offset * left, xy + AROUND * ahead])
        around = ground.height(points[:, 0], points[:, 1])
        step = float(body.rows.z[row] - np.mean(around[np.isfinite(around)])) if np.isfinite(around).any() else 0.0
        if step > MAX_STEP:
            raise InputError(
                f"road {body.road.id!r}: bridge.{key}: the road is {step:.1f} m above the ground around station "
                f"{body.rows.s[row]:.1f} m; a bridge begins level with the ground; move it to where the slope begins"
            )


def ground_chains(body: RoadBody, walls: Walls | None) -> list[Chain]:
    """Return the edges of a road on the ground, closed at its bridge: around its walls, or straight across without."""
    if body.cut is None:
        return [body.right, body.left]
    begin, end = body.cut
    right, left = body.right.table, body.left.table[::-1]
    paths = {begin: np.zeros((0, 3)), end: np.zeros((0, 3))}
    if walls is not None:
        faces = np.concatenate([outer_faces(body), walls.ground[:, :, None]], axis=2)  # [N, 2, 3]
        head, tail = faces[: walls.first + 1], faces[walls.last :]
        paths[begin] = np.concatenate([head[:, 0], head[::-1, 1]])
        paths[end] = np.concatenate([tail[::-1, 1], tail[:, 0]])
    name = body.road.id
    return [
        Chain(f"{name}_right0", right[: begin + 1]),
        _cap(f"{name}_from", right[begin], left[begin], paths[begin]),
        Chain(f"{name}_left0", left[begin::-1]),
        Chain(f"{name}_left1", left[: end - 1 : -1]),
        _cap(f"{name}_to", left[end], right[end], paths[end]),
        Chain(f"{name}_right1", right[end:]),
    ]


def end_lines(body: RoadBody) -> list[shapely.LineString]:
    """Return the lines across a road where its bridge begins and ends, between the kerbs."""
    _, begin, end = bridge_of(body)
    right, left = body.right.table, body.left.table[::-1]
    return [shapely.LineString([right[row, 0, :2], left[row, 0, :2]]) for row in (begin, end)]


def kerb_lines(body: RoadBody) -> shapely.Geometry:
    """Return the kerbs of a road in plan, on the ground and on its bridge, with those of its raised median."""
    lines = [chain.table[:, 0, :2] for chain in (body.right, body.left)]
    if len(body.section.island):
        plan = _island(body, slice(*body.rows.between))
        lines.append(np.concatenate([plan, plan[:1]]))
    return shapely.multilinestrings([shapely.LineString(line) for line in lines])


def islands_of(body: RoadBody) -> list[shapely.Polygon]:
    """Return the plan of the raised median of a road where it lies on the ground; empty without one."""
    first, last = body.rows.between
    if not len(body.section.island):
        return []
    pieces = [slice(max(first, piece.start), min(last, piece.stop - 1)) for piece in body.on_ground]
    return [shapely.Polygon(_island(body, piece)) for piece in pieces if piece.stop > piece.start]


def _island(body: RoadBody, rows: slice) -> np.ndarray:
    """Return the outline of the raised median between two rows, both included [m], shape [K, 2]."""
    rows = slice(rows.start, rows.stop + 1)
    xy, left, half = body.rows.xy[rows], body.rows.left[rows], body.section.island[-1]
    return np.concatenate([xy - half * left, (xy + half * left)[::-1]])


def _cap(name: str, first: np.ndarray, last: np.ndarray, path: np.ndarray) -> Chain:
    """Return a chain across a road: its kerb line goes straight over, its outer border along `path` [m], [K, 3]."""
    keep = np.ones(len(path), dtype=bool)
    for at, point in ((0, first[4]), (-1, last[4])):
        if len(path) and np.linalg.norm(path[at, :2] - point[:2]) < 1e-6:
            keep[at] = False
    path = path[keep]
    middle = np.repeat(first[None], len(path), axis=0)
    middle[:, 4] = path
    return Chain(name, np.concatenate([first[None], middle, last[None]]))
