"""Float64 NumPy oracles: slow and plain counterparts of the kernels."""

from dataclasses import dataclass

import numpy as np

from mmw.core.transforms import rotate, transform_points
from mmw.scene.device_scene import instance_actors
from mmw.scene.scene_data import SceneData


@dataclass(frozen=True)
class OracleScene:
    """Every triangle of one frame in the world frame: town first, then the instances that are present."""

    corners: np.ndarray  # [M, 3, 3]
    object_id: np.ndarray
    material: np.ndarray
    surface: np.ndarray
    face: np.ndarray
    instance: np.ndarray


@dataclass(frozen=True)
class OracleHits:
    """First hits of rays; t = inf and ids -1 for a miss. Shapes [R], normal [R, 3]."""

    t: np.ndarray
    object_id: np.ndarray
    material: np.ndarray
    surface: np.ndarray
    face: np.ndarray
    instance: np.ndarray
    normal: np.ndarray
    next_t: np.ndarray
    """Distance of the second triangle on the ray, so that a test can set near ties apart."""


def oracle_scene(arrays: SceneData, frame: int) -> OracleScene:
    """Return the triangles of a frame."""
    count = len(arrays.faces)
    columns = [
        [arrays.points[arrays.faces]], [arrays.object_id], [arrays.material], [arrays.surface],
        [np.arange(count)], [np.full(count, -1)],
    ]  # fmt: skip
    offset = arrays.town_surface_count
    row = arrays.frame_row(frame)
    for instance, index in enumerate(instance_actors(arrays)):
        actor, pose = arrays.actors[index], arrays.poses[row, index]
        model = arrays.models[actor.model]
        if np.isfinite(pose).all():
            many = len(model.faces)
            values = (
                transform_points(pose, model.points)[model.faces], np.full(many, actor.object_id), model.material,
                offset + model.surface, np.arange(many), np.full(many, instance),
            )  # fmt: skip
            for column, value in zip(columns, values, strict=True):
                column.append(value)
        offset += int(model.surface.max()) + 1
    return OracleScene(*(np.concatenate(column) for column in columns))


def triangle_hits(
    origin: np.ndarray, direction: np.ndarray, corners: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return ray, triangle and distance [m] of every hit of a ray and a triangle; both sides count.

    Every ray is tried against every triangle whose bounding sphere it comes near; spheres of `GROUP` neighbors in the
    list are asked first.

    Source: T. Möller, B. Trumbore, "Fast, minimum storage ray/triangle intersection", J. Graphics Tools 2(1), 1997.
    """
    ray, triangle = _near_pairs(origin, direction, corners)
    a, b, c = np.moveaxis(corners[triangle], 1, 0)
    edge_1, edge_2 = b - a, c - a
    p = np.cross(direction[ray], edge_2)
    determinant = np.einsum("px,px->p", p, edge_1)
    with np.errstate(divide="ignore", invalid="ignore"):
        inverse = 1.0 / determinant
        s = origin[ray] - a
        u = np.einsum("px,px->p", s, p) * inverse
        q = np.cross(s, edge_1)
        v = np.einsum("px,px->p", q, direction[ray]) * inverse
        t = np.einsum("px,px->p", q, edge_2) * inverse
        is_hit = (np.abs(determinant) > 1e-14) & (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > 0.0)
    return ray[is_hit], triangle[is_hit], t[is_hit]


GROUP = 32
"""Triangles that share a sphere in the first, coarse test."""


def _near_pairs(origin: np.ndarray, direction: np.ndarray, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the (ray, triangle) pairs that come near each other: all hits, and some more."""
    middle = corners.mean(axis=1)
    reach = np.linalg.norm(corners - middle[:, None], axis=2).max(axis=1, initial=0.0) + 1e-6
    starts = np.arange(0, len(corners), GROUP)
    group_middle = middle[starts]
    away = np.linalg.norm(middle - np.repeat(group_middle, GROUP, axis=0)[: len(corners)], axis=1)
    group_reach = np.maximum.reduceat(away + reach, starts) if len(starts) else reach
    to_group = group_middle - origin[:, None]
    along = np.einsum("rgx,rx->rg", to_group, direction)
    ray, group = np.nonzero(np.einsum("rgx,rgx->rg", to_group, to_group) <= along**2 + (group_reach + 1e-3) ** 2)
    ray = np.repeat(ray, GROUP)
    triangle = (group[:, None] * GROUP + np.arange(GROUP)).ravel()
    ray, triangle = ray[triangle < len(corners)], triangle[triangle < len(corners)]
    to_triangle = middle[triangle] - origin[ray]
    along = np.einsum("px,px->p", to_triangle, direction[ray])
    near = np.einsum("px,px->p", to_triangle, to_triangle) <= along**2 + (reach[triangle] + 1e-3) ** 2
    return ray[near], triangle[near]


def cast_rays(
    arrays: SceneData,
    frame: int,
    origin: np.ndarray,
    direction: np.ndarray,
    t_max: float = np.inf,
    ignore: np.ndarray | int = -1,
) -> OracleHits:
    """Return what rays hit first in one frame; `ignore` is an instance that rays do not see, -1 for none."""
    scene = oracle_scene(arrays, frame)
    origin = np.broadcast_to(np.asarray(origin, dtype=np.float64), direction.shape)
    ignore = np.broadcast_to(ignore, len(direction))
    found, step = [], max(256, 1_000_000 // max(len(scene.corners), 1))
    for start in range(0, len(direction), step):
        part = slice(start, start + step)
        ray, triangle, distance = triangle_hits(origin[part], direction[part], scene.corners)
        found.append((ray + start, triangle, distance))
    none = (np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0))
    ray, triangle, distance = (np.concatenate(column) for column in zip(none, *found, strict=True))
    keep = (distance < t_max) & ((ignore[ray] < 0) | (scene.instance[triangle] != ignore[ray]))
    order = np.flatnonzero(keep)[np.lexsort((triangle[keep], distance[keep], ray[keep]))]
    ray, triangle, distance = ray[order], triangle[order], distance[order]
    first = np.searchsorted(ray, np.arange(len(direction)))
    ray, triangle, distance = np.append(ray, [-1, -1]), np.append(triangle, [-1, -1]), np.append(distance, [np.inf] * 2)
    own, second = ray[first] == np.arange(len(direction)), ray[first + 1] == np.arange(len(direction))
    face, t = np.where(own, triangle[first], -1), np.where(own, distance[first], np.inf)
    next_t = np.where(own & second, distance[first + 1], np.inf)
    edge = np.diff(scene.corners[face], axis=1) if len(scene.corners) else np.zeros((len(face), 2, 3))
    normal = np.cross(edge[:, 0], edge[:, 1])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)
    normal *= np.where(np.einsum("rx,rx->r", normal, direction) > 0.0, -1.0, 1.0)[:, None]
    normal[face < 0] = 0.0

    def of_face(values: np.ndarray) -> np.ndarray:
        return np.where(face >= 0, np.append(values, -1)[face], -1)

    return OracleHits(
        t, of_face(scene.object_id), of_face(scene.material), of_face(scene.surface), of_face(scene.face),
        of_face(scene.instance), normal, next_t,
    )  # fmt: skip


def sphere_directions(count: int) -> np.ndarray:
    """Return unit directions spread over the sphere on a Fibonacci lattice, shape [count, 3]."""
    index = np.arange(count) + 0.5
    z = 1.0 - 2.0 * index / count
    angle = 2.0 * np.pi * index / ((1.0 + np.sqrt(5.0)) / 2.0)
    radius = np.sqrt(1.0 - z * z)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), z], axis=1)


def sensor_rays(pose: np.ndarray, direction_s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return world origins and directions, each [R, 3], of sensor-frame directions at one pose."""
    return np.broadcast_to(pose[:3], direction_s.shape), rotate(pose[3:], direction_s)


def trapezoid(values: np.ndarray, at: np.ndarray) -> float:
    """Return the integral of samples by the trapezoidal rule; NumPy 1.26 and 2 call it by different names.

    Args:
        values: Samples, shape [N].
        at: Where they are, shape [N].
    """
    return float(np.sum((values[1:] + values[:-1]) / 2 * np.diff(at)))


AMBIGUOUS_ANGLE = 1e-6
"""A ray is ambiguous if the oracle's object changes when the ray turns by this [rad]."""


def is_ambiguous(arrays: SceneData, frame: int, origin: np.ndarray, direction: np.ndarray, t_max: float) -> np.ndarray:
    """Return whether the oracle hits another object when a ray turns by `AMBIGUOUS_ANGLE` in one of eight ways, [R]."""
    here = cast_rays(arrays, frame, origin, direction, t_max).object_id
    side = np.cross(direction, np.where(np.abs(direction[:, 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]))
    side /= np.linalg.norm(side, axis=1, keepdims=True)
    other = np.cross(direction, side)
    found = np.zeros(len(direction), dtype=bool)
    for angle in np.arange(8) * np.pi / 4:
        turned = direction + AMBIGUOUS_ANGLE * (np.cos(angle) * side + np.sin(angle) * other)
        turned /= np.linalg.norm(turned, axis=1, keepdims=True)
        found |= cast_rays(arrays, frame, origin, turned, t_max).object_id != here
    return found


def agreeing_rays(
    arrays: SceneData, frame: int, rays: tuple[np.ndarray, np.ndarray], found: tuple[np.ndarray, np.ndarray],
    expected: tuple[np.ndarray, np.ndarray], reach: float, t_max: float = np.inf,
) -> np.ndarray:  # fmt: skip
    """Return which rays agree with the oracle, shape [R], after a check that each of the others is ambiguous.

    Args:
        arrays: The scene.
        frame: Its frame.
        rays: Origins and unit directions, world frame, shape [R, 3] each.
        found: Distances, inf for a miss, and objects of the rays, shape [R] each.
        expected: Those of the oracle before they end at `reach`, an edge like any other.
        reach: Distance at which what a ray hits is too far.
        t_max: Length of the rays of the oracle [m].
    """
    distance = np.where(expected[0] < reach, expected[0], np.inf)
    object_id = np.where(expected[0] < reach, expected[1], -1)
    with np.errstate(invalid="ignore"):
        is_same = (found[1] == object_id) & ~(np.abs(found[0] - distance) > 1e-3)
    odd = np.flatnonzero(~is_same)
    if len(odd):
        clear = ~is_ambiguous(arrays, frame, rays[0][odd], rays[1][odd], t_max)
        clear &= np.abs(expected[0][odd] - reach) > 1e-3
        assert not clear.any(), (frame, odd[clear], found[0][odd[clear]], distance[odd[clear]])
    return is_same
