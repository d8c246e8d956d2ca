"""Find the actors of a stage, the prims that move or carry sensors, and their poses in every frame."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import takewhile

import numpy as np
from pxr import Usd, UsdGeom

from mmw.core.errors import InputError
from mmw.core.transforms import continuous, cross, dot, length, quaternion_from_matrix
from mmw.usd.builtin_shapes import SHAPES
from mmw.usd.meshes import MAX_NUMBER_M, FoundMesh, MeshReader, semantic_label
from mmw.usd.prim_values import ancestors, attribute_value, decimals

ROLES = ("cav", "vehicle", "rsu", "pedestrian", "vru", "uav", "bs")
"""Roles of actors: those of agents, and vehicles and people that are none."""

FIXED_ROLES = ("rsu", "bs")
"""Roles of agents that stand still, and whose meshes are a part of the static town."""

PARKED = "Parked"
"""Name of a prim below which vehicles that do not move are parked."""

RIGID_TOLERANCE = 1.0e-4
"""Largest change of an actor's scale or shear over the frames [-]; float32 rotations change it by 1e-7."""


@dataclass(frozen=True)
class FoundActor:
    """One actor prim, before its meshes are known."""

    prim: Usd.Prim
    path: str
    name: str
    role: str
    label: str
    model_name: str
    size: tuple[float, float, float] | None
    """Length, width and height [m], None where the prim does not say."""
    center: tuple[float, float, float] | None
    is_parked: bool
    """Whether it is a vehicle below a prim called `PARKED` and does not move."""


def find_actors(stage: Usd.Stage, roles: Mapping[str, str]) -> list[FoundActor]:
    """Return the actors in the stage's order.

    An actor is a prim with `mmw:actor:role`, a prim that `roles` names, or a moving prim with a mesh below it; below an
    actor nothing else is one. A moving prim without a role is a vehicle.

    Args:
        stage: The stage.
        roles: Prim path -> role.

    Raises:
        InputError: If `roles` names a prim that does not exist, a role is unknown, or two actors have one name.
    """
    for path in roles:
        if not stage.GetPrimAtPath(path):
            raise InputError(
                f"actor_roles: {path} is not a prim of {stage.GetRootLayer().identifier}; correct the path"
            )
    found = []
    prims = iter(Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()))
    next(prims)  # the root of all prims
    for prim in prims:
        role = roles.get(str(prim.GetPath())) or attribute_value(prim, "mmw:actor:role")
        if role is None and _moves(prim) and _has_mesh(prim):
            role = "vehicle"
        if role is None:
            continue
        prims.PruneChildren()
        if role not in ROLES:
            raise InputError(f"{prim.GetPath()}: mmw:actor:role = {role!r}; one of {', '.join(ROLES)} is needed")
        model_name = str(attribute_value(prim, "mmw:actor:model") or prim.GetName())
        box = (attribute_value(prim, f"mmw:actor:{key}") for key in ("size", "center"))
        size, center = (None if value is None else decimals(value) for value in box)
        label, path = semantic_label(prim), str(prim.GetPath())
        is_parked = f"/{PARKED}/" in path and role in ("cav", "vehicle") and not _moves(prim)
        found.append(FoundActor(prim, path, prim.GetName(), str(role), label, model_name, size, center, is_parked))
    seen: dict[str, str] = {}
    for actor in found:
        if seen.setdefault(actor.name, actor.path) != actor.path:
            raise InputError(
                f"{actor.path} and {seen[actor.name]} are both called {actor.name!r}; "
                "actors need names of their own; rename one prim"
            )
    return found


def actor_poses(actors: list[FoundActor], times: np.ndarray, metres: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """Return the poses of actors.

    A pose is rigid, so the constant scale of an actor's transform, if it has one, goes into its model: model points
    times the actor's stretch are in its rigid frame.

    Args:
        actors: The actors.
        times: Time code of each frame, shape [F].
        metres: Stage world to ours, row vectors, shape [4, 4].

    Returns:
        Poses [F, V, 7], NaN where an actor is invisible, and the stretch of each actor, row vectors, [4, 4] each.

    Raises:
        InputError: If an actor's scale changes over the frames, or is zero.
    """
    poses, stretches = np.empty((len(times), len(actors), 7)), np.empty((len(actors), 4, 4))
    moves = np.array([any(map(_moves, ancestors(actor.prim))) for actor in actors], dtype=bool)
    for columns, codes in ((np.flatnonzero(moves), times), (np.flatnonzero(~moves), times[:1])):  # a still one once
        if len(columns):
            poses[:, columns], stretches[columns] = _rigid_poses([actors[k] for k in columns], codes, metres)
    for column, actor in enumerate(actors):
        image, codes = UsdGeom.Imageable(actor.prim), times if _visibility_varies(actor.prim) else times[:1]
        hidden = np.array([image.ComputeVisibility(time) == UsdGeom.Tokens.invisible for time in codes])
        poses[np.broadcast_to(hidden, len(times)), column] = np.nan
    return poses, list(stretches)


def _rigid_poses(actors: list[FoundActor], times: np.ndarray, metres: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return poses and stretches of `actor_poses`, at least one actor, whether they are visible or not."""
    matrices = np.empty((len(times), len(actors), 4, 4))
    cache = UsdGeom.XformCache()
    for row, time in enumerate(times):
        cache.SetTime(time)
        for column, actor in enumerate(actors):
            matrices[row, column] = cache.GetLocalToWorldTransform(actor.prim)
    for column in np.flatnonzero(~(np.abs(matrices) <= MAX_NUMBER_M).all(axis=(0, 2, 3))):  # NaN too
        raise InputError(
            f"{actors[column].path}: its transform is not finite, or beyond {MAX_NUMBER_M:g}; correct its xformOps"
        )
    # Both sides change their frame: the actor's own axes become ours (z up, meters) too.
    matrices = np.linalg.inv(metres) @ matrices @ metres
    rigid = _orthonormal(matrices[..., :3, :3], actors)
    stretch = matrices[..., :3, :3] @ np.swapaxes(rigid, -1, -2)
    change = np.abs(stretch - stretch[:1]).max(axis=(0, 2, 3), initial=0.0)
    for actor, by in zip(actors, change, strict=True):
        if by > RIGID_TOLERANCE:
            raise InputError(
                f"{actor.path}: its scale changes by {by:.2g} over the frames; actors are rigid; "
                "remove the scale animation"
            )
    poses = np.empty((len(times), len(actors), 7))
    poses[..., :3] = matrices[..., 3, :3]
    # Row vectors: the matrix is the transpose of the usual rotation.
    poses[..., 3:] = continuous(quaternion_from_matrix(np.swapaxes(rigid, -1, -2)))
    stretches = np.tile(np.eye(4), (len(actors), 1, 1))
    is_stretched = np.abs(stretch[0] - np.eye(3)).max(axis=(1, 2)) > RIGID_TOLERANCE
    stretches[is_stretched, :3, :3] = stretch[0, is_stretched]
    return poses, stretches


def model_matrix(meshes: MeshReader, mesh: FoundMesh, actor: Usd.Prim) -> np.ndarray:
    """Return mesh space to actor space, row vectors, stage units, shape [4, 4].

    Raises:
        InputError: If a prim between the mesh and its actor moves.
    """
    for prim in takewhile(lambda prim: prim != actor, ancestors(mesh.anchor)):
        if _moves(prim):
            raise InputError(
                f"{prim.GetPath()}: moves inside the actor {actor.GetPath()}; an actor is one rigid body; "
                "remove the inner animation, or move the prim out of the actor"
            )
    to_actor = meshes.relative(mesh.anchor, actor)
    return to_actor if mesh.to_anchor is None else mesh.to_anchor @ to_actor


def _orthonormal(linear: np.ndarray, actors: list[FoundActor]) -> np.ndarray:
    """Return the rotation part of row-vector matrices [F, V, 3, 3]: rows made orthonormal in order, right-handed."""
    x = linear[..., 0, :]
    y = linear[..., 1, :]
    lengths = length(x)
    y = y - x * (dot(x, y) / np.maximum(lengths, 1e-300) ** 2)
    widths = length(y)
    for column in np.flatnonzero((np.minimum(lengths, widths) < 1e-12).any(axis=(0, 2))):
        raise InputError(f"{actors[column].path}: its scale is zero; an actor needs a size; set the scale")
    x, y = x / lengths, y / widths
    return np.stack([x, y, cross(x, y)], axis=-2)


def _moves(prim: Usd.Prim) -> bool:
    return prim.IsA(UsdGeom.Xformable) and UsdGeom.Xformable(prim).TransformMightBeTimeVarying()


def _has_mesh(prim: Usd.Prim) -> bool:
    below = Usd.PrimRange(prim, Usd.TraverseInstanceProxies())
    return any(p.IsA(UsdGeom.Mesh) or p.GetTypeName() in (*SHAPES, "PointInstancer") for p in below)


def _visibility_varies(prim: Usd.Prim) -> bool:
    shown = (UsdGeom.Imageable(p) for p in ancestors(prim) if p.IsA(UsdGeom.Imageable))
    return any(image.GetVisibilityAttr().ValueMightBeTimeVarying() for image in shown)
