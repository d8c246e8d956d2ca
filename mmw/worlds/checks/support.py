"""Whether things stand on something: parts in the air, and things under the ground."""

import numpy as np

from mmw.core.bvh import RayMesh
from mmw.core.planar_surfaces import components
from mmw.worlds.checks.box_pairs import box_pairs
from mmw.worlds.checks.components import Pieces
from mmw.worlds.checks.findings import Finding, as_place, does_not_apply
from mmw.worlds.checks.stage_model import GROUND_LABELS, World

FLOAT_M = 0.05
"""Height over the ground from which on a part floats [m]; design value."""

TOUCH_M = 0.01
"""Parts closer than this hold each other [m]; design value."""

BELOW_M = 0.003
"""Rays start this far below a lowest point [m], so that they miss the part itself and find ground that it touches."""

SLACK_M = 0.001
"""Vertices this close to the lowest one are lowest too [m]."""

UP = np.array([0.0, 0.0, 1.0])


def standing_findings(world: World, pieces: Pieces) -> list[Finding]:
    """Return parts that float, and things that lie wholly under the ground."""
    if not len(world.ground):
        reason = f"no mesh has a class that things stand on ({', '.join(GROUND_LABELS)})"
        return [does_not_apply(rule, reason) for rule in ("floating", "sunken")]
    if not pieces.count:
        return []
    ground = RayMesh(world.points, world.faces[world.ground])
    return [*_floating(world, pieces, ground), *_sunken(world, pieces, ground)]


def _is_below(world: World, ground: RayMesh, points: np.ndarray) -> np.ndarray:
    """Return whether each point [P, 3] is under the ground: the first ground above it shows its back, shape [P]."""
    _, face = ground.cast(points, UP, 1000.0)
    return (face >= 0) & (world.normal[world.ground][face, 2] > 0.0)


def _floating(world: World, pieces: Pieces, ground: RayMesh) -> list[Finding]:
    moving = np.array([part.is_moving for part in world.parts], dtype=bool)[pieces.part]
    z = world.corners[pieces.face, :, 2]
    row, column = np.nonzero(z <= pieces.lowest[pieces.piece][:, None] + SLACK_M)
    point = world.corners[pieces.face[row], column] - BELOW_M * UP
    piece = pieces.piece[row]
    stands = _is_below(world, ground, point)
    fall, _ = world.rays.cast(point, -UP, 1000.0)
    gap = np.full(pieces.count, np.inf)
    np.minimum.at(gap, piece, np.where(stands, 0.0, fall + BELOW_M))
    floats = (gap > FLOAT_M) & ~moving
    suspects = np.flatnonzero(floats)
    if not len(suspects):
        return []
    first, second = _contacts(world, pieces, floats)
    is_free = np.append(floats, False)
    held = components(pieces.count + 1, first, np.where(is_free[second], second, pieces.count))
    findings = []
    for label in np.unique(held[suspects]):
        if label == held[pieces.count]:
            continue
        group = suspects[held[suspects] == label]
        lowest = group[np.argmin(gap[group])]
        rows = np.flatnonzero(piece == lowest)
        part = world.parts[pieces.part[lowest]]
        below = f"{gap[lowest]:.2f} m above what is below" if np.isfinite(gap[lowest]) else "with nothing below"
        more = f", with {len(group) - 1} more that hang on it" if len(group) > 1 else ""
        text = f"a piece of {part.thing} touches nothing and is {below} it{more}"
        path = part.thing if part.is_actor else part.path
        cure = "put it on the ground, or let it touch what holds it"
        findings.append(Finding("error", "floating", path, text, cure, as_place(point[rows[0]] + BELOW_M * UP)))
    return findings


def _contacts(world: World, pieces: Pieces, floats: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return pairs of pieces (a floating one, any other one or the ground) that touch; the ground is piece K."""
    every = np.arange(len(world.faces))
    piece_of = np.full(len(world.faces), pieces.count)
    piece_of[pieces.face] = pieces.piece
    is_free = np.append(floats, False)
    mine = every[is_free[piece_of]]
    low, high = world.corners.min(axis=1), world.corners.max(axis=1)
    found = [np.zeros((0, 2), dtype=int)]
    for i, j in box_pairs(low[mine] - TOUCH_M, high[mine] + TOUCH_M, low, high):
        i = mine[i]
        keep = piece_of[i] != piece_of[j]
        i, j = i[keep], j[keep]
        keep = _meets_plane(world, i, j) & _meets_plane(world, j, i)
        found.append(np.unique(np.stack([piece_of[i[keep]], piece_of[j[keep]]], axis=1), axis=0))
    first, second = np.unique(np.concatenate(found), axis=0).T
    return first, second


def _meets_plane(world: World, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Return whether triangles i reach the planes of triangles j, within `TOUCH_M`, shape [P]."""
    height = np.einsum("pcx,px->pc", world.corners[i] - world.corners[j, :1], world.normal[j])
    return (height.min(axis=1) < TOUCH_M) & (height.max(axis=1) > -TOUCH_M)


def _sunken(world: World, pieces: Pieces, ground: RayMesh) -> list[Finding]:
    thing_of = np.array([part.thing for part in world.parts], dtype=object)
    names, thing = np.unique(thing_of[world.part_of[pieces.face]], return_inverse=True)
    z = world.corners[pieces.face, :, 2]
    top = np.full(len(names), -np.inf)
    np.maximum.at(top, thing, z.max(axis=1))
    row, column = np.nonzero(z >= top[thing][:, None] - SLACK_M)
    point = world.corners[pieces.face[row], column]
    is_above = np.zeros(len(names), dtype=bool)
    np.logical_or.at(is_above, thing[row], ~_is_below(world, ground, point))
    return [
        Finding(
            "error", "sunken", str(names[k]), "lies wholly under the ground", "raise it",
            as_place(point[np.flatnonzero(thing[row] == k)[0]]),
        )
        for k in np.flatnonzero(~is_above)
    ]  # fmt: skip
