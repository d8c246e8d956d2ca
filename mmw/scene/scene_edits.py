"""Change what a scene consists of: detach, add, clone, remove and repaint objects; functions return new arrays."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from mmw.core.errors import InputError
from mmw.core.planar_surfaces import find_surfaces
from mmw.physics.materials.material import Material
from mmw.scene.scene_data import MODEL_NONE, Actor, Prototype, SceneData, SceneObject
from mmw.usd.semantics import CARLA_TAG

OBJECT_ROLE = "object"
"""Role of an actor that neither carries sensors nor has a box in the ground truth."""


def actor_of(data: SceneData, object_id: int) -> int:
    """Return the index of the actor that an object is, -1 for one of the static town."""
    return next((i for i, actor in enumerate(data.actors) if actor.object_id == object_id), -1)


def detach_object(data: SceneData, object_id: int) -> SceneData:
    """Return the scene with an object of the static town as an actor, which can move; it stays where it is.

    The actor's origin is the middle of the object's box, and its axes are the world's.

    Args:
        data: The scene.
        object_id: An object of the static town that has faces.
    """
    is_own = data.object_id == object_id
    points = data.points[data.faces[is_own]].reshape(-1, 3)
    middle = 0.5 * (points.min(axis=0) + points.max(axis=0))
    found, index = np.unique(points, axis=0, return_inverse=True)
    faces = index.reshape(-1, 3).astype(np.int32)
    model = make_prototype(
        data.objects[object_id].label, found - middle, faces, data.material[is_own], data.uv[is_own],
        data.normals[is_own],
    )  # fmt: skip
    name = unique_name(data, data.objects[object_id].prim_path.rpartition("/")[2])
    pose = np.array([*middle, 0.0, 0.0, 0.0, 1.0])
    return _with_actor(_without_faces(data, is_own), name, OBJECT_ROLE, model, pose, object_id)


def add_object(
    data: SceneData,
    name: str,
    points: np.ndarray,
    faces: np.ndarray,
    material_id: int,
    label: str,
    pose: np.ndarray,
    role: str = OBJECT_ROLE,
) -> SceneData:
    """Return the scene with a new object, which can move.

    Args:
        data: The scene.
        name: Name of the actor, not taken yet.
        points: Vertices in the object's frame [m], shape [N, 3].
        faces: Triangles, counter-clockwise from outside, shape [M, 3].
        material_id: Material of all faces.
        label: Semantic class.
        pose: Object to world, shape [7].
        role: One of `mmw.usd.actors.ROLES`, or `object`.
    """
    model = make_prototype(name, points, faces, np.full(len(faces), material_id, dtype=np.int32))
    return _with_actor(data, name, role, model, pose, None, label)


def clone_actor(data: SceneData, index: int, name: str, pose: np.ndarray) -> SceneData:
    """Return the scene with another actor of the same shape, materials and role; it stands at `pose` in every frame."""
    actor, object_id = data.actors[index], len(data.objects)
    row = replace(data.objects[actor.object_id], object_id=object_id, prim_path=f"/{name}", actor=name)
    copy = replace(actor, name=name, prim_path=f"/{name}", object_id=object_id)
    return replace(
        data,
        actors=(*data.actors, copy),
        objects=(*data.objects, row),
        poses=np.concatenate([data.poses, _still(data, pose)], axis=1),
    )


def remove_object(data: SceneData, object_id: int) -> SceneData:
    """Return the scene without an object; its row of `objects` stays, so that other objects keep their ids."""
    index = actor_of(data, object_id)
    if index < 0:
        return _without_faces(data, data.object_id == object_id)
    actors = (*data.actors[:index], *data.actors[index + 1 :])
    return replace(data, actors=actors, poses=np.delete(data.poses, index, axis=1))


def paint_object(data: SceneData, object_id: int, material_id: int, material_name: str) -> SceneData:
    """Return the scene with another material on all faces of an object; other actors of its shape keep theirs."""
    index = actor_of(data, object_id)
    row = replace(data.objects[object_id], materials=(material_name,))
    objects = (*data.objects[:object_id], row, *data.objects[object_id + 1 :])
    if index < 0:
        material = np.where(data.object_id == object_id, material_id, data.material).astype(np.int32)
        surface = find_surfaces(data.points, data.faces, data.object_id, material)
        return replace(data, material=material, surface=surface, objects=objects)
    actor = data.actors[index]
    old = data.models[actor.model]
    material = np.full(len(old.faces), material_id, dtype=np.int32)
    surface = find_surfaces(old.points, old.faces, np.zeros_like(material), material)
    model = replace(old, material=material, surface=surface)
    actors = (*data.actors[:index], replace(actor, model=len(data.models)), *data.actors[index + 1 :])
    return replace(data, models=(*data.models, model), actors=actors, objects=objects)


def add_material(data: SceneData, materials: dict[str, Material]) -> tuple[SceneData, int]:
    """Return the scene with one more material, and its id.

    Args:
        data: The scene.
        materials: The material in each of the scene's weathers.
    """
    number = len(next(iter(data.materials.values()), ()))
    return replace(data, materials={w: (*own, materials[w]) for w, own in data.materials.items()}), number


def make_prototype(
    name: str,
    points: np.ndarray,
    faces: np.ndarray,
    material: np.ndarray,
    uv: np.ndarray | None = None,
    normals: np.ndarray | None = None,
) -> Prototype:
    """Return the shape of an actor whose faces are all fixed to it, with its planar surfaces.

    Args:
        name: Name of the shape.
        points: Vertices in the actor's frame [m], shape [N, 3].
        faces: Triangles, shape [M, 3].
        material: Material id of each face, shape [M].
        uv: Texture coordinates of the corners, shape [M, 3, 2]; None for none.
        normals: Unit normals at the corners, shape [M, 3, 3]; None for flat faces.
    """
    points, faces = np.ascontiguousarray(points, dtype=np.float64), np.ascontiguousarray(faces, dtype=np.int32)
    material = np.ascontiguousarray(material, dtype=np.int32)
    surface = find_surfaces(points, faces, np.zeros_like(material), material)
    corners = {key: value for key, value in (("uv", uv), ("normals", normals)) if value is not None}
    return Prototype(name, points, faces, material, surface, **corners)


def check_mesh(where: str, points: ArrayLike, faces: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
    """Return vertices, [N, 3] float64, and triangles, [M, 3] int32, of a mesh that a user gave.

    Raises:
        InputError: If shapes are wrong, a number is not finite, or a face names no vertex; `where` begins the message.
    """
    vertices, triangles = np.asarray(points, dtype=np.float64), np.asarray(faces)
    if vertices.ndim != 2 or vertices.shape[1] != 3 or not len(vertices) or not np.isfinite(vertices).all():
        raise InputError(f"{where}: points of shape {vertices.shape}; finite numbers of shape [N, 3] are needed")
    if triangles.ndim != 2 or triangles.shape[1] != 3 or not len(triangles) or triangles.dtype.kind not in "iu":
        raise InputError(f"{where}: faces of shape {triangles.shape}; whole numbers of shape [M, 3] are needed")
    if triangles.min() < 0 or triangles.max() >= len(vertices):
        raise InputError(f"{where}: faces name vertex {triangles.max()}; there are {len(vertices)}; correct them")
    return vertices, triangles.astype(np.int32)


def unique_name(data: SceneData, wanted: str) -> str:
    """Return a name that no actor has: the wanted one, or that with a number."""
    taken = {actor.name for actor in data.actors}
    numbered = (f"{wanted}_{number}" for number in range(1, len(taken) + 2))
    return next(name for name in (wanted, *numbered) if name not in taken)


def _with_actor(
    data: SceneData, name: str, role: str, model: Prototype, pose: np.ndarray, object_id: int | None, label: str = ""
) -> SceneData:
    """Return the scene with a new actor, which is a new object, or one that loses its faces in the town."""
    low, high = model.points.min(axis=0), model.points.max(axis=0)
    length, width, height = (high - low).tolist()
    x, y, z = (0.5 * (low + high)).tolist()
    names = _material_names(data, model.material)
    if object_id is None:
        object_id = len(data.objects)
        row = SceneObject(object_id, f"/{name}", label, CARLA_TAG[label], names, name)
    else:
        row = replace(data.objects[object_id], actor=name)
    actor = Actor(name, role, row.prim_path, len(data.models), object_id, (length, width, height), (x, y, z), row.label)
    return replace(
        data,
        models=(*data.models, model),
        actors=(*data.actors, actor),
        objects=(*data.objects[:object_id], row, *data.objects[object_id + 1 :]),
        poses=np.concatenate([data.poses, _still(data, pose)], axis=1),
    )


def _still(data: SceneData, pose: np.ndarray) -> np.ndarray:
    """Return a pose in every row of poses, shape [rows, 1, 7]."""
    return np.broadcast_to(np.asarray(pose, dtype=np.float64), (len(data.poses), 1, 7))


def _without_faces(data: SceneData, is_gone: np.ndarray) -> SceneData:
    """Return the scene without some faces of the town; its other surfaces are numbered anew without gaps."""
    keep = ~is_gone
    surface = np.unique(data.surface[keep], return_inverse=True)[1].reshape(-1).astype(np.int32)
    per_face = {name: getattr(data, name)[keep] for name in ("faces", "material", "object_id", "uv", "normals")}
    return replace(data, surface=surface, **per_face)


def _material_names(data: SceneData, material: Sequence[int] | np.ndarray) -> tuple[str, ...]:
    own = next(iter(data.materials.values()), ())
    return tuple(sorted({own[k].name for k in np.unique(material)}))


def has_geometry(data: SceneData, object_id: int) -> bool:
    """Return whether an object has faces in the town, or is an actor with a shape."""
    index = actor_of(data, object_id)
    return bool((data.object_id == object_id).any()) if index < 0 else data.actors[index].model != MODEL_NONE
