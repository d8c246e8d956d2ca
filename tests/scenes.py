"""Scenes built in code for every test: town parts and box vehicles become `SceneArrays` without any USD."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import trimesh

from mmw.materials import LIDAR_REFLECTANCE_905NM, Material, RadioMaterial
from mmw.poses import make_pose, multiply, quaternion_exp
from mmw.scene_arrays import Actor, Model, SceneArrays, SceneObject
from mmw.surfaces import find_surfaces
from mmw.town.parts import MeshPart
from mmw.usd.semantics import CARLA_TAG

ITU = {
    "asphalt": "itu_very_dry_ground", "concrete_facade": "itu_concrete", "marble_facade": "itu_marble",
    "brick_facade": "itu_brick", "window_glass": "itu_glass", "metal_pole": "itu_metal", "car_paint_red": "itu_metal",
    "car_paint_blue": "itu_metal", "car_glass": "itu_glass", "wood": "itu_wood", "grass": "itu_medium_dry_ground",
}  # fmt: skip
BASE = {
    "asphalt": "asphalt", "concrete_facade": "concrete", "marble_facade": "marble", "brick_facade": "brick",
    "window_glass": "clear_glass", "metal_pole": "steel", "car_paint_red": "steel", "car_paint_blue": "steel",
    "car_glass": "clear_glass", "wood": "wood", "grass": "leaf_grass",
}  # fmt: skip

IDENTITY_POSE = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
ABSENT = (np.nan,) * 7


def material(name: str) -> Material:
    """Return a material of the kind that its name says, such as `asphalt`; any other name is half-space concrete."""
    base = BASE.get(name, "concrete")
    radio = RadioMaterial("itu", itu=ITU.get(name, "itu_concrete"))
    return Material(name, radio, base, LIDAR_REFLECTANCE_905NM[base], (0.5, 0.5, 0.5))


def pose(x: float, y: float, z: float = 0.0, yaw: float = 0.0) -> tuple[float, ...]:
    """Return a level pose with yaw [rad] as (x, y, z, qx, qy, qz, qw)."""
    return (x, y, z, 0.0, 0.0, float(np.sin(yaw / 2)), float(np.cos(yaw / 2)))


def moving_poses(start: np.ndarray, velocity: np.ndarray, rate: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Return poses [T, V, 7] of bodies that keep their velocity and angular velocity, both in the world frame [V, 3].

    Args:
        start: Poses at time 0, shape [V, 7].
        velocity: Velocity of the origins [m/s].
        rate: Angular velocity [rad/s].
        times: Times [s], shape [T].
    """
    time = np.asarray(times, dtype=np.float64)[:, None, None]
    return make_pose(start[:, :3] + velocity * time, multiply(quaternion_exp(rate * time), start[:, 3:]))


def box_mesh(size: Sequence[float], center: Sequence[float] = (0.0, 0.0, 0.0)) -> tuple[np.ndarray, np.ndarray]:
    """Return points [8, 3] and outward faces [12, 3] of a box; faces 2k and 2k + 1 are one side: -x +x -y +y -z +z."""
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64)
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = [triangle for a, b, c, d in quads for triangle in ((a, b, c), (a, c, d))]
    return 0.5 * signs * np.asarray(size, dtype=np.float64) + np.asarray(center), np.array(faces, dtype=np.int32)


def quad_part(
    path: str, corners: Sequence[Sequence[float]], material: str = "asphalt", label: str = "road", cells: int = 1
) -> MeshPart:
    """Return a flat four-sided part, counter-clockwise seen from its front, of cells x cells x 2 triangles."""
    a, b, c, d = (np.asarray(corner, dtype=np.float64) for corner in corners)
    step = np.linspace(0.0, 1.0, cells + 1)
    u, v = np.meshgrid(step, step, indexing="ij")
    u, v = u.reshape(-1, 1), v.reshape(-1, 1)
    points = (1 - u) * (1 - v) * a + u * (1 - v) * b + u * v * c + (1 - u) * v * d
    i, j = (k.ravel() for k in np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij"))
    p = i * (cells + 1) + j
    q = p + cells + 1
    faces = np.stack([p, q, q + 1, p, q + 1, p + 1], axis=1).reshape(-1, 3)
    return MeshPart(path, points, faces.astype(np.int32), material, label)


def ground_part(half: float = 50.0, z: float = 0.0, material: str = "asphalt", cells: int = 1) -> MeshPart:
    """Return a square of level road around the origin that faces up."""
    corners = [(-half, -half, z), (half, -half, z), (half, half, z), (-half, half, z)]
    return quad_part("Roads/ground", corners, material, "road", cells)


def wall_part(
    name: str, start: Sequence[float], end: Sequence[float], height: float, material: str = "concrete_facade"
) -> MeshPart:
    """Return an upright wall from one (x, y) to another; it faces the right-hand side of that way."""
    (x0, y0), (x1, y1) = start, end
    corners = [(x0, y0, 0.0), (x1, y1, 0.0), (x1, y1, height), (x0, y0, height)]
    return quad_part(f"Buildings/{name}", corners, material, "building")


def box_part(path: str, size: Sequence[float], center: Sequence[float], material: str, label: str) -> MeshPart:
    """Return a box with faces outward."""
    points, faces = box_mesh(size, center)
    return MeshPart(path, points, faces, material, label)


def box_model(
    name: str, size: Sequence[float] = (4.5, 1.8, 1.5), center: Sequence[float] = (0.0, 0.0, 0.75), material: int = 0
) -> Model:
    """Return a box vehicle that stands on z = 0 of its frame; `material` is an id (see `arrays_from_parts`)."""
    points, faces = box_mesh(size, center)
    ids = np.full(len(faces), material, dtype=np.int32)
    return Model(name, points, faces, ids, find_surfaces(points, faces, np.zeros_like(ids), ids))


def arrays_from_parts(
    parts: Sequence[MeshPart],
    models: Sequence[Model] = (),
    actors: Sequence[tuple[str, str, int]] = (),
    poses: np.ndarray | Sequence | None = None,
    *,
    first_frame: int = 0,
    materials: Mapping[str, Material] | Sequence[str] = (),
    weathers: Sequence[str] = ("sunny",),
) -> SceneArrays:
    """Return a scene.

    Args:
        parts: Town; the first two elements of a part's path name its object.
        models: Shapes of the vehicles; their material ids index the materials in the order described below.
        actors: (name, role, model index or -1).
        poses: Shape [F, V, 7]; one frame of identity poses when left out.
        first_frame: Number of the first frame.
        materials: Materials by name, or further names. Ids: these first, in order, then the parts' as they appear.
        weathers: Every one gets the same materials.
    """
    given = dict(materials) if isinstance(materials, Mapping) else {name: material(name) for name in materials}
    for part in parts:
        given.setdefault(part.material, material(part.material))
    if models and not given:
        given["car_paint_red"] = material("car_paint_red")
    names = list(given)
    groups = ["/World/Town/" + "/".join(part.path.split("/")[:2]) for part in parts]
    object_of = {path: i for i, path in enumerate(sorted(set(groups)))}
    offsets = np.cumsum([0] + [len(part.points) for part in parts])
    points = np.concatenate([np.zeros((0, 3))] + [part.points for part in parts])
    faces = [part.faces + offset for part, offset in zip(parts, offsets[:-1], strict=True)]
    faces = np.concatenate([np.zeros((0, 3), np.int32), *faces]).astype(np.int32)
    counts = [len(part.faces) for part in parts]
    ids = np.repeat(np.array([names.index(part.material) for part in parts], dtype=np.int32), counts)
    object_id = np.repeat(np.array([object_of[group] for group in groups], dtype=np.int32), counts)
    objects = []
    for path, index in object_of.items():
        own = [part for part, group in zip(parts, groups, strict=True) if group == path]
        used = tuple(sorted({part.material for part in own}))
        objects.append(SceneObject(index, path, own[0].label, CARLA_TAG[own[0].label], used))
    actor_list = []
    for name, role, model in actors:
        index = len(objects)
        path = f"/World/RSU/{name}" if role == "rsu" else f"/World/Actors/{name}"
        size, center, used, label = (0.0, 0.0, 0.0), (0.0, 0.0, 0.0), (), "static"
        if model >= 0:
            low, high = models[model].points.min(axis=0), models[model].points.max(axis=0)
            size, center = tuple((high - low).tolist()), tuple((0.5 * (high + low)).tolist())
            used, label = tuple(sorted({names[m] for m in models[model].material})), "car"
        actor_list.append(Actor(name, role, path, model, index, size, center, label))
        objects.append(SceneObject(index, path, label, CARLA_TAG[label], used, name))
    if poses is None:
        poses = np.broadcast_to(np.array(IDENTITY_POSE), (1, len(actor_list), 7))
    poses = np.array(poses, dtype=np.float64).reshape(len(poses), len(actor_list), 7)
    return SceneArrays(
        points, faces, ids, object_id, find_surfaces(points, faces, object_id, ids), tuple(models), tuple(actor_list),
        range(first_frame, first_frame + len(poses)), poses,
        {weather: tuple(given.values()) for weather in weathers}, tuple(objects),
    )  # fmt: skip


def ground_and_wall() -> SceneArrays:
    """Level ground, 100 m x 100 m, and a concrete wall 10 m high in the plane y = 20 that faces -y."""
    return arrays_from_parts([ground_part(), wall_part("wall", (-30.0, 20.0), (30.0, 20.0), 10.0)])


def closed_box(size: float = 10.0) -> SceneArrays:
    """One closed cube around the origin: every ray from inside hits it."""
    return arrays_from_parts([box_part("Buildings/room", (size,) * 3, (0.0, 0.0, 0.0), "concrete_facade", "building")])


def street_canyon(
    models: Sequence[Model] = (), actors: Sequence[tuple[str, str, int]] = (), poses: np.ndarray | None = None
) -> SceneArrays:
    """A street along x, 20 m wide, between a marble row (y = 10) and a glass row (y = -10), 15 m high.

    Material ids: asphalt 0, marble_facade 1, window_glass 2, car_paint_red 3, car_glass 4.
    """
    parts = [
        quad_part("Roads/street", [(-100, -10, 0), (100, -10, 0), (100, 10, 0), (-100, 10, 0)], "asphalt", "road", 8),
        wall_part("north", (-100.0, 10.0), (100.0, 10.0), 15.0, "marble_facade"),
        wall_part("south", (100.0, -10.0), (-100.0, -10.0), 15.0, "window_glass"),
    ]
    names = ("asphalt", "marble_facade", "window_glass", "car_paint_red", "car_glass")
    return arrays_from_parts(parts, models, actors, poses, materials=names)


def two_cars(frame_count: int = 4) -> SceneArrays:
    """The street canyon with two box cars that drive along x, and a roadside unit without geometry.

    cav_1 moves from (-20, -3), 1 m a frame; veh_001 comes the other way from (20, 3); rsu_1 stands at (0, 9, 5).
    """
    models = (box_model("sedan", material=3), box_model("van", (5.5, 2.0, 2.4), (0.3, 0.0, 1.2), material=4))
    actors = [("cav_1", "cav", 0), ("veh_001", "vehicle", 1), ("rsu_1", "rsu", -1)]
    rows = [
        [pose(-20.0 + k, -3.0), pose(20.0 - k, 3.0, yaw=np.pi), pose(0.0, 9.0, 5.0, yaw=-np.pi / 2)]
        for k in range(frame_count)
    ]
    return street_canyon(models, actors, np.array(rows))


def random_triangles(
    seed: int = 0, count: int = 300, half: float = 20.0, *, vehicles: int = 0, frames: int = 1
) -> SceneArrays:
    """Triangles of 1 to 4 m anywhere in a cube, and vehicles of such triangles with any rotation in every frame."""
    rng = np.random.default_rng(seed)

    def soup(number: int, spread: float) -> tuple[np.ndarray, np.ndarray]:
        corners = rng.uniform(-spread, spread, (number, 1, 3)) + rng.uniform(-2.0, 2.0, (number, 3, 3))
        return corners.reshape(-1, 3), np.arange(3 * number, dtype=np.int32).reshape(-1, 3)

    names = ("asphalt", "concrete_facade", "window_glass", "wood")
    parts = []
    for k, name in enumerate(names):
        points, faces = soup(count // len(names), half)
        parts.append(MeshPart(f"Props/soup_{k}", points, faces, name, "static"))
    models, actors, poses = [], [], np.zeros((frames, vehicles, 7))
    for v in range(vehicles):
        points, faces = soup(12, 1.5)
        ids = rng.integers(0, len(names), len(faces)).astype(np.int32)
        models.append(Model(f"model_{v}", points, faces, ids, find_surfaces(points, faces, np.zeros_like(ids), ids)))
        actors.append((f"veh_{v:03d}", "vehicle", v))
    poses[..., :3] = rng.uniform(-half, half, (frames, vehicles, 3))
    quaternion = rng.normal(size=(frames, vehicles, 4))
    poses[..., 3:] = quaternion / np.linalg.norm(quaternion, axis=-1, keepdims=True)
    return arrays_from_parts(parts, models, actors, poses, materials=names)


def arrays_from_ply(files: Mapping[str, tuple[Path, Material]], **rest) -> SceneArrays:
    """Return a scene of PLY files: object name -> (file, material); `rest` goes to `arrays_from_parts`."""
    parts, materials = [], {}
    for name, (path, described) in files.items():
        mesh = trimesh.load_mesh(path, process=False)
        materials[described.name] = described
        points, faces = np.array(mesh.vertices, dtype=np.float64), np.array(mesh.faces, dtype=np.int32)
        parts.append(MeshPart(f"Buildings/{name}", points, faces, described.name, "building"))
    return arrays_from_parts(parts, materials=materials, **rest)
