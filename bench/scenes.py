"""Scenes to measure on: a procedural town, or a shipped one, with vehicles that drive along its streets."""

from collections.abc import Sequence
from functools import cache

import numpy as np
import trimesh

from mmw.config.foliage import FoliageModel
from mmw.core.planar_surfaces import find_surfaces
from mmw.core.resources import town_path
from mmw.physics.materials.material import Material, RadioMaterial
from mmw.scene.reader import read_stage
from mmw.scene.scene_data import Actor, Prototype, SceneData, SceneObject

BLOCKS = 8
"""Blocks of the procedural town along x and along y, unless given."""

CELLS = 12.5
"""Cells of its ground along each side, for each block."""

PITCH = 60.0
"""From street to street [m]."""

VEHICLES = 40
"""Vehicles in every frame."""

CONCRETE = Material("concrete", RadioMaterial("itu", itu="itu_concrete"), "concrete", 0.37, (0.4, 0.4, 0.4))


def grid_town(blocks: int = BLOCKS, *, with_surfaces: bool = True) -> SceneData:
    """Return a procedural town: rolling ground, square blocks of four houses with recessed windows.

    Args:
        blocks: Blocks along x and along y; 8 x 8 have over 100,000 triangles.
        with_surfaces: Find its surfaces. Rays do not need them, and they are slow for large towns.
    """
    rng = np.random.default_rng(7)
    parts = [_ground(half=0.5 * blocks * PITCH + 20.0, cells=round(CELLS * blocks))]
    lot = 0.25 * (PITCH - 14.0)
    for corner in np.ndindex(blocks, blocks):
        middle = (np.array(corner) + 0.5 - 0.5 * blocks) * PITCH
        for offset in ((-lot, -lot), (lot, -lot), (-lot, lot), (lot, lot)):
            floors = int(rng.integers(3, 8))
            at = middle + offset
            points, faces = _house(width=2.0 * lot - 1.0, floors=floors, windows=3)
            parts.append((points + np.append(at, _height(at)), faces))
    offsets = np.cumsum([0] + [len(points) for points, _ in parts])
    points = np.concatenate([points for points, _ in parts])
    faces = np.concatenate([faces + offset for (_, faces), offset in zip(parts, offsets[:-1], strict=True)])
    object_id = np.repeat(np.arange(len(parts)), [len(faces) for _, faces in parts]).astype(np.int32)
    material = np.zeros(len(faces), dtype=np.int32)
    labels = ["road"] + ["building"] * (len(parts) - 1)
    objects = tuple(SceneObject(k, f"/Town/part_{k}", label, 0, ("concrete",)) for k, label in enumerate(labels))
    surface = find_surfaces(points, faces, object_id, material) if with_surfaces else np.zeros_like(material)
    return SceneData(
        points, faces.astype(np.int32), material, object_id, surface, (), (), range(1), np.zeros((1, 0, 7)),
        {"sunny": (CONCRETE,)}, objects,
    )  # fmt: skip


def shipped_town(name: str, foliage: FoliageModel = "hull") -> SceneData:
    """Return a shipped town without vehicles."""
    return read_stage(town_path(name), range(1), ["sunny"], foliage=foliage)


def with_vehicles(town: SceneData, frames: int) -> SceneData:
    """Return a town with 40 vehicles on its roads, 1,280 triangles each, which move 0.15 m a frame.

    Spots are drawn from the faces of objects labeled `road`, by area.
    """
    rng = np.random.default_rng(11)
    road = np.isin(town.object_id, [o.object_id for o in town.objects if o.label == "road"])
    corners = town.points[town.faces[road]]
    corners = corners[np.abs(corners[..., :2].mean(axis=1)).max(axis=1) < 0.5 * BLOCKS * PITCH]
    area = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    pick = rng.choice(len(corners), VEHICLES, p=area / area.sum())
    spot = corners[pick].mean(axis=1)
    if len(corners) and town.objects[0].prim_path == "/Town/part_0":  # the grid town: onto the nearest street
        nearest = np.round(spot[:, :2] / PITCH) * PITCH + rng.choice([-3.0, 3.0], (VEHICLES, 1))
        along = rng.integers(0, 2, VEHICLES)
        spot[np.arange(VEHICLES), along] = nearest[np.arange(VEHICLES), along]
        yaw = np.where(along == 1, 0.0, 0.5 * np.pi)
        spot[:, 2] = _height(spot[:, :2])
    else:
        yaw = rng.uniform(-np.pi, np.pi, VEHICLES)
    heading = np.stack([np.cos(yaw), np.sin(yaw), 0.0 * yaw], axis=1)
    poses = np.zeros((frames, VEHICLES, 7))
    poses[..., :3] = spot + 0.15 * (np.arange(frames)[:, None, None] - 0.5 * frames) * heading
    poses[..., 5], poses[..., 6] = np.sin(0.5 * yaw), np.cos(0.5 * yaw)
    models = tuple(_vehicle(size) for size in ((4.6, 1.85, 1.5), (4.2, 1.8, 1.6), (5.6, 2.05, 2.6), (8.0, 2.5, 3.2)))
    first = len(town.objects)
    actors, objects = [], list(town.objects)
    for v in range(VEHICLES):
        size = tuple(np.ptp(models[v % 4].points, axis=0).tolist())
        path = f"/Actors/veh_{v:03d}"
        actors.append(Actor(f"veh_{v:03d}", "vehicle", path, v % 4, first + v, size, (0.0, 0.0, size[2] / 2), "car"))
        objects.append(SceneObject(first + v, path, "car", 14, ("concrete",), f"veh_{v:03d}"))
    return SceneData(
        town.points, town.faces, town.material, town.object_id, town.surface, models, tuple(actors), range(frames),
        poses, town.materials, tuple(objects), foliage=town.foliage,
    )  # fmt: skip


def _height(xy: np.ndarray) -> np.ndarray:
    """Return the height of the procedural ground [m]: low waves, at most 3 m."""
    return 1.5 * np.sin(xy[..., 0] / 90.0) + 1.5 * np.cos(xy[..., 1] / 70.0)


def _grid(cells_u: int, cells_v: int) -> tuple[np.ndarray, np.ndarray]:
    """Return points [N, 2] of a unit square and faces of its cells."""
    u, v = np.meshgrid(np.linspace(0, 1, cells_u + 1), np.linspace(0, 1, cells_v + 1), indexing="ij")
    i, j = (k.ravel() for k in np.meshgrid(np.arange(cells_u), np.arange(cells_v), indexing="ij"))
    a = i * (cells_v + 1) + j
    b = a + cells_v + 1
    faces = np.stack([a, b, b + 1, a, b + 1, a + 1], axis=1).reshape(-1, 3)
    return np.stack([u.ravel(), v.ravel()], axis=1), faces


def _ground(half: float, cells: int) -> tuple[np.ndarray, np.ndarray]:
    unit, faces = _grid(cells, cells)
    xy = (2.0 * unit - 1.0) * half
    return np.column_stack([xy, _height(xy)]), faces


@cache
def _house(width: float, floors: int, windows: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a house on the origin of four walls whose every second cell is set back 0.2 m, and a flat roof."""
    wall, wall_faces = _grid(2 * windows + 1, 2 * floors + 1)
    cell = np.arange(len(wall_faces)) // 2
    is_window = ((cell // (2 * floors + 1)) % 2 == 1) & ((cell % (2 * floors + 1)) % 2 == 1)
    points, faces = [], []
    for side in range(4):
        angle = 0.5 * np.pi * side
        turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
        # Every cell has corners of its own, so that a window can be set back and leaves a reveal behind its frame.
        for mask, depth in ((~is_window, 0.0), (is_window, 0.2)):
            corner = wall[wall_faces[mask]].reshape(-1, 2)
            xy = np.stack([(corner[:, 0] - 0.5) * width, np.full(len(corner), -0.5 * width + depth)], axis=1) @ turn.T
            faces.append(np.arange(len(corner)).reshape(-1, 3) + sum(map(len, points)))
            points.append(np.column_stack([xy, corner[:, 1] * (3.2 * floors + 1.0) - 1.0]))
    low, faces_roof = _grid(1, 1)
    faces.append(faces_roof + sum(map(len, points)))
    points.append(np.column_stack([(low - 0.5) * width, np.full(len(low), 3.2 * floors)]))
    return np.concatenate(points), np.concatenate(faces)


def _vehicle(size: Sequence[float]) -> Prototype:
    """Return a rounded box of 1,280 triangles on z = 0: a superellipsoid."""
    ball = trimesh.creation.icosphere(subdivisions=3)
    rounded = np.sign(ball.vertices) * np.abs(ball.vertices) ** 0.4
    points = (rounded / np.abs(rounded).max(axis=0) * 0.5 + [0.0, 0.0, 0.5]) * size
    faces = np.array(ball.faces, dtype=np.int32)
    ids = np.zeros(len(faces), dtype=np.int32)
    return Prototype("rounded", points, faces, ids, np.arange(len(faces), dtype=np.int32))
