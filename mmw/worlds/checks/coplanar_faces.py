"""Find faces that lie in one plane and overlap: which of them a ray hits is undefined."""

from dataclasses import dataclass

import numpy as np

from mmw.core.errors import InputError
from mmw.worlds.checks.box_pairs import area_and_centre, clip, own_pairs, spiral
from mmw.worlds.checks.findings import Finding, as_place
from mmw.worlds.checks.stage_model import StageModel

PLANE_M = 2.0e-3
"""Faces closer than this lie in one plane [m]; design value, ten times what rays are moved off a surface."""

ANGLE_RAD = np.radians(0.1)
"""Normals closer than this, either sign, are parallel [rad]; design value."""

PENETRATION_M = 1.0e-3
"""Faces whose interiors reach into each other by less than this only touch [m]: float32 seams and welds."""

MAX_OVERLAPS = 200_000
"""Overlapping pairs that are kept; design value, a shipped town has none that are visible."""

MIN_AREA_M2 = 1.0e-3
"""Overlap of two prims that is reported [m2]; design value, 10 cm2."""

VISIBILITY_RAYS = 24
"""Rays on each side of an overlap that test whether it is visible."""

OFF_SURFACE_M = 5.0e-3
"""Height over an overlap at which those rays start [m]: clear of both faces."""

FAR_M = 2000.0
"""Length of those rays [m]: beyond a town."""

MIN_RISE = 0.03
"""Sine of the elevation above which a ray that hits nothing has reached the sky [-]."""

MAX_SPOTS = 6
"""Largest overlaps of a pair of prims that are looked at."""

_SHARE_OF_CELL = 5.0
"""Scale of the normal's key: its width, 4 ANGLE_RAD, is a small part of a cell of the grid."""


@dataclass(frozen=True)
class Overlaps:
    """Pairs of faces that overlap."""

    first: np.ndarray
    """Face with the lower number, shape [P]."""
    second: np.ndarray
    area: np.ndarray
    """Common area [m2], shape [P]."""
    place: np.ndarray
    """Middle of the common area [m], shape [P, 3]."""
    is_opposite: np.ndarray
    """Whether the two face opposite directions, shape [P]."""


def find_overlaps(corners: np.ndarray, normal: np.ndarray, area: np.ndarray) -> Overlaps:
    """Return all pairs of triangles in one plane that overlap.

    Args:
        corners: Corners of the triangles [m], shape [M, 3, 3].
        normal: Unit normals, shape [M, 3]; zero for a triangle without area, which overlaps nothing.
        area: Areas [m2], shape [M].
    """
    chosen = np.flatnonzero(area > 1.0e-8)
    own, plane = corners[chosen], normal[chosen]
    # Functions of the normal that forget its sign and change by at most twice the angle.
    x, y, z = plane.T
    key = _SHARE_OF_CELL * np.stack([x * x, y * y, x * y + y * z + z * x], axis=1)
    slack = _SHARE_OF_CELL * ANGLE_RAD
    low = np.concatenate([own.min(axis=1) - 0.5 * PLANE_M, key - slack], axis=1)
    high = np.concatenate([own.max(axis=1) + 0.5 * PLANE_M, key + slack], axis=1)
    found: list[tuple[np.ndarray, ...]] = []
    count = 0
    for i, j in own_pairs(low, high):
        if len(i):
            found.append(_overlap(corners, normal, area, chosen[i], chosen[j]))
            count += len(found[-1][0])
        if count > MAX_OVERLAPS:
            raise InputError(
                f"the stage: over {MAX_OVERLAPS:,} pairs of its faces lie on each other; remove repeated ones"
            )
    if not found:
        return Overlaps(*(np.zeros((0,), dtype=int),) * 2, np.zeros(0), np.zeros((0, 3)), np.zeros(0, dtype=bool))
    return Overlaps(*(np.concatenate(column) for column in zip(*found, strict=True)))


def _overlap(
    corners: np.ndarray, normal: np.ndarray, area: np.ndarray, i: np.ndarray, j: np.ndarray
) -> tuple[np.ndarray, ...]:
    """Return the pairs of triangles i and j, both [P], that overlap: the columns of `Overlaps`."""
    cross = np.cross(normal[i], normal[j])
    keep = np.einsum("px,px->p", cross, cross) < np.sin(ANGLE_RAD) ** 2
    i, j = np.minimum(i, j)[keep], np.maximum(i, j)[keep]
    swap = area[i] < area[j]
    large, small = np.where(swap, j, i), np.where(swap, i, j)
    up, origin = normal[large], corners[large, 0]
    height = np.einsum("pcx,px->pc", corners[small] - origin[:, None], up)
    keep = (height.min(axis=1) < PLANE_M) & (height.max(axis=1) > -PLANE_M)
    large, small, up, origin, height = large[keep], small[keep], up[keep], origin[keep], height[keep]
    u = corners[large, 1] - origin
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    axes = np.stack([u, np.cross(up, u)], axis=2)
    flat = [np.einsum("pcx,pxk->pck", corners[face] - origin[:, None], axes) for face in (large, small)]
    opposite = np.einsum("px,px->p", up, normal[small]) < 0.0
    flat[1][opposite] = flat[1][opposite][:, ::-1]
    height[opposite] = height[opposite][:, ::-1]
    reach = np.minimum(_reach(flat[0], flat[1]), _reach(flat[1], flat[0]))
    keep = reach > PENETRATION_M
    large, small, origin, axes, opposite, height = (
        values[keep] for values in (large, small, origin, axes, opposite, height)
    )
    a, b = flat[0][keep], flat[1][keep]
    polygon, count = b, np.full(len(b), 3)
    for k in range(3):
        edge = a[:, (k + 1) % 3] - a[:, k]
        outward = np.stack([edge[:, 1], -edge[:, 0]], axis=1)
        polygon, count = clip(polygon, count, outward, np.einsum("px,px->p", outward, a[:, k]))
    common, centre = area_and_centre(polygon, count)
    off_plane = np.abs(np.einsum("pc,pc->p", _barycentric(b, centre), height))
    place = origin + np.einsum("pxk,pk->px", axes, centre)
    keep = (common > 0.1 * MIN_AREA_M2) & (off_plane < PLANE_M)
    return (
        np.minimum(large, small)[keep], np.maximum(large, small)[keep], common[keep], place[keep], opposite[keep]
    )  # fmt: skip


def _reach(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Return how far triangles b reach inside of that edge of a, [P, 3, 2] each, where that is least [m]."""
    edge = np.roll(a, -1, axis=1) - a
    inward = np.stack([-edge[..., 1], edge[..., 0]], axis=2)
    inward /= np.maximum(np.linalg.norm(edge, axis=2, keepdims=True), 1.0e-12)
    depth = np.einsum("pex,pecx->pec", inward, b[:, None] - a[:, :, None])
    return depth.max(axis=2).min(axis=1)


def _barycentric(triangle: np.ndarray, point: np.ndarray) -> np.ndarray:
    """Return the weights [P, 3] of the corners of plane triangles [P, 3, 2] at points [P, 2]."""
    a, b, c = (triangle[:, k] for k in range(3))
    total = _cross(b - a, c - a)
    second, third = _cross(point - a, c - a) / total, _cross(b - a, point - a) / total
    return np.stack([1.0 - second - third, second, third], axis=1)


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]


def coplanar_findings(model: StageModel) -> list[Finding]:
    """Return overlapping faces by pair of prims: visible ones as errors, hidden ones as information."""
    if not len(model.mesh.faces):
        return []
    found = find_overlaps(model.mesh.corners, model.mesh.normals, model.mesh.areas)
    pair = np.sort(np.stack([model.part_of[found.first], model.part_of[found.second]], axis=1), axis=1)
    pairs, group = np.unique(pair, axis=0, return_inverse=True)
    group = group.ravel()
    total = np.bincount(group, found.area, len(pairs))
    order = np.lexsort((-found.area, group))
    rank = np.arange(len(order)) - np.searchsorted(group[order], group[order])
    chosen = order[(rank < MAX_SPOTS) & (total[group[order]] > MIN_AREA_M2)]
    seen = np.zeros(len(found.first), dtype=bool)
    if len(chosen):
        seen[chosen] = is_seen(model, found.place[chosen], model.mesh.normals[found.first[chosen]])
    ends = np.searchsorted(group[order], np.arange(len(pairs) + 1))
    findings = []
    for k, (a, b) in enumerate(pairs):
        rows = order[ends[k] : ends[k + 1]]
        if total[k] <= MIN_AREA_M2:
            continue
        visible = rows[seen[rows]]
        row = visible[0] if len(visible) else rows[0]
        paths = " and ".join(dict.fromkeys((model.parts[a].path, model.parts[b].path)))
        facing = "face opposite directions" if found.is_opposite[row] else "face the same direction"
        text = f"{len(rows)} pairs of faces overlap in one plane, {total[k]:.3f} m2 in all; they {facing}"
        at = as_place(found.place[row])
        if len(visible):
            cure = "remove one of the two, or move them apart by more than 2 mm"
            findings.append(Finding("error", "coplanar", paths, text, cure, at))
        else:
            findings.append(Finding("info", "touching", paths, f"{text}, where nothing can see them", "", at))
    return findings


def is_seen(model: StageModel, place: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return whether places on surfaces are visible from the open, from either side.

    A place is seen if a ray from it rises to the sky, or hits the front of a face from where one does. Inside a solid
    every ray hits a back; inside a box without a bottom it hits the ground, from where nothing rises to the sky.

    Args:
        model: All triangles.
        place: Places [m], shape [P, 3].
        normal: Unit normal there, shape [P, 3].

    Returns:
        Shape [P].
    """
    seen = np.zeros(len(place), dtype=bool)
    for side in (normal, -normal):
        direction = _hemisphere(side)
        start = np.repeat(place + OFF_SURFACE_M * side, VISIBILITY_RAYS, axis=0)
        t, face = model.rays.cast(start, direction, FAR_M)
        reaches = (face < 0) & (direction[:, 2] > MIN_RISE)
        front = np.flatnonzero((face >= 0) & (np.einsum("rx,rx->r", model.mesh.normals[face], direction) < 0.0))
        if len(front):
            hit_point = (
                start[front] + direction[front] * t[front, None] + OFF_SURFACE_M * model.mesh.normals[face[front]]
            )
            second = _hemisphere(model.mesh.normals[face[front]])
            _, beyond = model.rays.cast(np.repeat(hit_point, VISIBILITY_RAYS, axis=0), second, FAR_M)
            rises = (beyond < 0) & (second[:, 2] > MIN_RISE)
            reaches[front] = rises.reshape(len(front), -1).any(axis=1)
        seen |= reaches.reshape(len(place), -1).any(axis=1)
    return seen


def _hemisphere(normal: np.ndarray) -> np.ndarray:
    """Return `VISIBILITY_RAYS` unit directions over the hemisphere about each normal [P, 3], shape [P * rays, 3]."""
    local = spiral((np.arange(VISIBILITY_RAYS) + 0.5) / VISIBILITY_RAYS)
    helper = np.where(np.abs(normal[:, 2:]) < 0.9, [[0.0, 0.0, 1.0]], [[1.0, 0.0, 0.0]])
    u = np.cross(helper, normal)
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    return np.einsum("rk,pkx->prx", local, np.stack([u, np.cross(normal, u), normal], axis=1)).reshape(-1, 3)
