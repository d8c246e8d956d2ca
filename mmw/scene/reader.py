"""Read a scenario stage, mmw's or the user's own, into `SceneData`."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from pxr import Usd

from mmw.config.foliage import FoliageModel
from mmw.config.physics_presets import Physics
from mmw.core.constants import FRAME_RATE_HZ
from mmw.core.errors import InputError
from mmw.core.frame_rate import pose_stride
from mmw.core.planar_surfaces import find_surfaces
from mmw.physics.materials.material import Material
from mmw.physics.weather.weather import choose_variant
from mmw.scene.scene_data import MODEL_NONE, Actor, Prototype, SceneData, SceneObject
from mmw.usd.actors import FIXED_ROLES, FoundActor, actor_poses, find_actors, model_matrix
from mmw.usd.material_entries import MaterialMap
from mmw.usd.materials import read_materials
from mmw.usd.meshes import MeshReader, to_metres
from mmw.usd.open_stage import check_references, open_stage, reads_usd
from mmw.usd.scene_parts import Part, PartReader
from mmw.usd.semantics import CARLA_TAG

WEATHER = "weather"
"""Name of the variant set that changes materials."""

MAX_NAMES = 20
"""Most names of materials that a note lists."""

Triple = tuple[float, float, float]


@reads_usd
def read_stage(
    path: str | Path,
    frames: range,
    weathers: Sequence[str] | Mapping[str, Sequence[str]],
    *,
    margin: int = 0,
    rate_hz: int = FRAME_RATE_HZ,
    roles: Mapping[str, str] | None = None,
    material_map: MaterialMap | None = None,
    physics: Physics = "paper",
    foliage: FoliageModel = "hull",
) -> SceneData:
    """Read town, actors, poses and materials of a stage.

    A mesh under a prim that moves, or that has an `mmw:actor:role` that is not of `FIXED_ROLES`, belongs to the topmost
    such prim; every other mesh is static town. Frame n is n / `rate_hz` after the stage's start. Meshes that are
    invisible, or of purpose proxy or guide, are ignored; an actor is absent in the frames in which it is invisible.

    Args:
        path: USD file.
        frames: Frames to read.
        weathers: Weathers to read materials for, each a variant of the stage's variant sets called `weather`; or
            weather -> variants that can stand for it, of which each set selects the first that it has.
        margin: Frames to read beyond `frames` on each side where the stage has them, for derivatives at the ends.
        rate_hz: Frames a second, see `mmw.core.frame_rate.FRAME_RATES`.
        roles: Prim path -> one of `mmw.usd.actors.ROLES`, for stages without `mmw:actor:role`.
        material_map: Glob of mesh prim paths or material names, or `label:` and one of classes -> what a mesh is,
            whatever the stage says.
        physics: Preset of the channel; beyond `paper`, materials of the shipped library are more than the paper's, see
            `mmw.usd.standard_materials`.
        foliage: What sensors meet where there are crowns of trees.

    Returns:
        The scene in the world frame (z up, meters).

    Raises:
        InputError: If the file is missing, unreadable or empty; if a frame or weather is not in it; if a mesh has no
            material, deforms, or moves inside its actor.
    """
    stage = open_stage(Path(path))
    check_references(stage, Path(path))
    name = str(path)
    frames, times = _frame_times(stage, name, frames, margin, rate_hz)
    switches = _weather_prims(stage)
    variants = dict(weathers) if isinstance(weathers, Mapping) else {weather: (weather,) for weather in weathers}
    _check_weathers(switches, name, variants)
    for names in list(variants.values())[:1]:
        _select(stage, switches, names)
    metres = to_metres(stage)
    reader = PartReader(MeshReader(stage, Usd.TimeCode(times[0])), material_map or {})
    actors = find_actors(stage, roles or {})
    actor_of = {actor.path: row for row, actor in enumerate(actors) if actor.role not in FIXED_ROLES}
    poses, stretches = actor_poses(actors, times, metres)

    meshes = list(reader.meshes.meshes())
    owners = [_owner(mesh.anchor, actor_of) for mesh in meshes]
    is_shown = [reader.meshes.is_visible(mesh.prim) for mesh in meshes]  # a moving mesh always: its poses give the time
    parts = reader.parts(
        meshes,
        [
            reader.meshes.to_world(mesh) @ metres
            if row is None
            else model_matrix(reader.meshes, mesh, actors[row].prim) @ metres @ stretches[row]
            for mesh, row in zip(meshes, owners, strict=True)
        ],
        [row is not None for row in owners],
    )
    static, moving = [], [[] for _ in actors]
    for part, row, is_visible in zip(parts, owners, is_shown, strict=True):
        if part is not None and row is not None:
            moving[row].append(part)
        elif part is not None and is_visible:
            static.append(part)
    if reader.unresolved:
        listed = "\n  ".join(reader.unresolved)
        raise InputError(
            f"{name}: {len(reader.unresolved)} prims have no radio material; bind one with mmw:radio:* attributes, or "
            f"give `materials` (prim path glob -> itu_concrete, ...):\n  {listed}"
        )
    if not static and not any(moving):
        raise InputError(
            f"{name}: the stage has no visible mesh; a scene needs at least one; check purpose and visibility"
        )
    materials, ids = _materials(stage, switches, reader, variants, physics)
    notes = _idle_patterns(reader)
    data = _assemble(static, actors, moving, frames, poses, materials, ids, tuple(reader.notes), notes, rate_hz)
    return replace(data, foliage=foliage)


def _frame_times(stage: Usd.Stage, name: str, frames: range, margin: int, rate_hz: int) -> tuple[range, np.ndarray]:
    """Return the frames to read, margins included, and the time code of each row of poses."""
    if len(frames) == 0:
        raise InputError(f"{name}: no frames are given; at least one is needed")
    rate, start, last = stage.GetTimeCodesPerSecond(), 0.0, frames[-1]
    if stage.HasAuthoredTimeCodeRange():
        start = stage.GetStartTimeCode()
        last = int(np.floor((stage.GetEndTimeCode() - start) / rate * rate_hz + 1e-6))
        outside = [frame for frame in (frames[0], frames[-1]) if not 0 <= frame <= last]
        if outside:
            raise InputError(
                f"{name}: frame {outside[0]} is outside the stage, which holds frames 0 to {last} "
                f"({stage.GetEndTimeCode() - start:g} time codes at {rate:g} a second), {rate_hz} a second; give others"
            )
    frames = range(max(frames[0] - margin, 0), min(frames[-1] + margin, last) + 1)
    stride = pose_stride(rate_hz)
    rows = np.arange(frames[0] * stride, frames[-1] * stride + 1, dtype=np.float64)
    return frames, start + rows * rate / (rate_hz * stride)  # whole time codes stay whole


def _weather_prims(stage: Usd.Stage) -> list[Usd.Prim]:
    return [prim for prim in stage.Traverse() if prim.HasVariantSets() and prim.GetVariantSets().HasVariantSet(WEATHER)]


def _check_weathers(switches: list[Usd.Prim], name: str, variants: Mapping[str, Sequence[str]]) -> None:
    for prim in switches:
        known = prim.GetVariantSet(WEATHER).GetVariantNames()
        for weather, names in variants.items():
            if choose_variant(names, known) is None:
                raise InputError(
                    f"{name}: weather {weather!r} is not a variant of {prim.GetPath()}; it has {', '.join(known)}, "
                    f"none of {', '.join(names)}; set air.{weather}.variant to one that it has, or author the variant"
                )


def _select(stage: Usd.Stage, switches: list[Usd.Prim], names: Sequence[str]) -> None:
    """Select in each set the first variant that it has, in the session layer, which changes no file."""
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        for path in [prim.GetPath() for prim in switches]:
            variants = stage.GetPrimAtPath(path).GetVariantSet(WEATHER)
            variants.SetVariantSelection(choose_variant(names, variants.GetVariantNames()) or names[0])


def _owner(prim: Usd.Prim, actor_of: Mapping[str, int]) -> int | None:
    """Return the actor that a mesh belongs to: the topmost of its ancestors that is one."""
    path, end = str(prim.GetPath()), 0
    while actor_of and end >= 0:
        end = path.find("/", end + 1)
        found = actor_of.get(path if end < 0 else path[:end])
        if found is not None:
            return found
    return None


def _materials(
    stage: Usd.Stage,
    switches: list[Usd.Prim],
    reader: PartReader,
    variants: Mapping[str, Sequence[str]],
    physics: Physics,
) -> tuple[dict[str, tuple[Material, ...]], np.ndarray]:
    """Return materials by weather and id, and the id of each use. Uses that agree in every weather share an id."""
    columns, uses = {}, list(reader.uses)
    for weather, names in variants.items():
        _select(stage, switches, names)
        columns[weather] = read_materials(
            stage, uses, reader.notes, reader.copies, reader.material_map, weather, physics
        )
        for use, material in zip(uses, columns[weather], strict=True):
            if material.appearance.textures and not material.appearance.has_uv:
                reader.notes[
                    f"material {material.appearance.prim_path}: mesh {reader.first_mesh[use]} has no texture "
                    "coordinates; each texture is drawn as its mean there"
                ] = None
    rows = [tuple(column[k] for column in columns.values()) for k in range(len(uses))]
    if not variants:
        return {}, np.arange(len(uses), dtype=np.int32)
    order = sorted(range(len(uses)), key=lambda k: (uses[k].name, uses[k].prim_path))
    unique = list(dict.fromkeys(rows[k] for k in order))
    ids = np.array([unique.index(row) for row in rows], dtype=np.int32)
    return {weather: tuple(row[w] for row in unique) for w, weather in enumerate(variants)}, ids


def _idle_patterns(reader: PartReader) -> tuple[str, ...]:
    """Return a line for each pattern of the material map that decides about no mesh."""
    names = sorted({use.name for use in reader.uses})
    listed = ", ".join(names[:MAX_NAMES]) + (", ..." if len(names) > MAX_NAMES else "")
    return tuple(
        f"materials[{pattern!r}] decides nothing: no mesh has such a prim path, material or class, or an "
        f"earlier pattern matches it too; materials here are {listed}"
        for pattern in reader.material_map
        if pattern not in reader.matched
    )


def _join(parts: list[Part], ids: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points, faces and material ids of several parts as one mesh."""
    offsets = np.cumsum([0] + [len(part.points) for part in parts])
    points = np.concatenate([np.zeros((0, 3))] + [part.points for part in parts])
    shifted = [part.faces + offset for part, offset in zip(parts, offsets[:-1], strict=True)]
    faces = np.concatenate([np.zeros((0, 3), dtype=np.int32), *shifted]).astype(np.int32)
    material = np.concatenate([np.zeros(0, dtype=np.int32)] + [ids[part.use] for part in parts]).astype(np.int32)
    return points, faces, material


def _join_corners(parts: list[Part]) -> tuple[np.ndarray, np.ndarray]:
    """Return texture coordinates and normals of the faces of several parts, zeros where a part has none."""

    def joined(name: str, width: int) -> np.ndarray:
        values = [np.zeros((0, 3, width), dtype=np.float32)]
        for part in parts:
            own = getattr(part.corners, name)
            values.append(np.zeros((len(part.faces), 3, width), dtype=np.float32) if own is None else own)
        return np.concatenate(values)

    return joined("uv", 2), joined("normals", 3)


def _join_wheels(parts: list[Part]) -> tuple[np.ndarray, np.ndarray]:
    """Return the wheels of several parts, and the wheel of each face; equal center and radius make one wheel."""
    row_of: dict[tuple[float, ...], int] = {}
    columns = []
    for part in parts:
        rows = [row_of.setdefault(tuple(wheel), len(row_of)) for wheel in part.wheels.tolist()]
        columns.append(np.array([*rows, -1], dtype=np.int32)[part.wheel])
    return np.array(list(row_of), dtype=np.float64).reshape(-1, 4), np.concatenate(columns)


def _assemble(
    static: list[Part],
    found: list[FoundActor],
    moving: list[list[Part]],
    frames: range,
    poses: np.ndarray,
    materials: dict[str, tuple[Material, ...]],
    ids: np.ndarray,
    look_notes: tuple[str, ...],
    material_notes: tuple[str, ...],
    rate_hz: int,
) -> SceneData:
    names = [material.name for material in next(iter(materials.values()), ())] or [""] * (int(ids.max(initial=0)) + 1)

    def used(values: Iterable[int]) -> tuple[str, ...]:
        return tuple(sorted({names[k] for k in set(values)}))

    points, faces, material = _join(static, ids)
    label_of = {part.object_path: part.object_label for part in reversed(static)}
    index_of = {path: k for k, path in enumerate(sorted(label_of))}
    counts = [len(part.faces) for part in static]
    object_id = np.repeat(np.array([index_of[part.object_path] for part in static], dtype=np.int32), counts)
    objects = []
    pairs = np.unique(object_id * np.int64(len(names)) + material)  # object and material, once each
    own = np.split(pairs % len(names), np.searchsorted(pairs // len(names), np.arange(1, len(index_of))))
    for (path, k), ids_of in zip(index_of.items(), own, strict=False):
        objects.append(SceneObject(k, path, label_of[path], CARLA_TAG[label_of[path]], used(ids_of.tolist())))

    models: list[Prototype] = []
    model_of: dict[tuple, int] = {}
    surface_of: dict[tuple, np.ndarray] = {}
    actors = []
    for actor, parts in zip(found, moving, strict=True):
        label, model, used_names = actor.label, MODEL_NONE, ()
        if parts:
            model_points, model_faces, model_material = _join(parts, ids)
            wheels, wheel = _join_wheels(parts)
            uv, normals = _join_corners(parts)
            values = (model_points, model_faces, model_material, wheels, wheel, uv, normals)
            key = tuple(value.tobytes() for value in values)
            if key not in model_of:
                model_of[key] = len(models)
                _, first, kind = np.unique(model_material, return_index=True, return_inverse=True)
                kind = np.argsort(np.argsort(first))[kind]  # the same for all paints of a model
                shape = (*key[:2], kind.tobytes())
                if shape not in surface_of:
                    surface_of[shape] = find_surfaces(model_points, model_faces, np.zeros_like(kind), kind)
                models.append(Prototype(actor.model_name, *values[:3], surface_of[shape], *values[3:]))
            model = model_of[key]
            used_names = used(model_material.tolist())
            label = parts[0].label if label == "unlabeled" else label
        size, center = _box(actor, models[model].points if parts else None)
        path, object_index = actor.path, len(objects)
        kind = (label, actor.is_parked, actor.model_name)
        actors.append(Actor(actor.name, actor.role, path, model, object_index, size, center, *kind))
        objects.append(SceneObject(object_index, path, label, CARLA_TAG[label], used_names, actor.name))
    surface = find_surfaces(points, faces, object_id, material)
    return SceneData(
        points, faces, material, object_id, surface, tuple(models), tuple(actors), frames, poses, materials,
        tuple(objects), *_join_corners(static), look_notes, material_notes=material_notes, rate_hz=rate_hz,
    )  # fmt: skip


def _box(actor: FoundActor, points: np.ndarray | None) -> tuple[Triple, Triple]:
    """Return size and middle of an actor's box [m]: what its attributes say, else what its mesh spans."""
    low, high = (points.min(axis=0), points.max(axis=0)) if points is not None else (np.zeros(3), np.zeros(3))
    length, width, height = (high - low).tolist()
    x, y, z = (0.5 * (low + high)).tolist()
    return actor.size or (length, width, height), actor.center or (x, y, z)
