"""Make the measurement surface that a caller names: a plane, the roads or an object of a scene."""

from collections.abc import Mapping
from difflib import get_close_matches
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mmw.channel.radio_map.measurement_surface import MeasurementSurface, mesh_surface, plane_grid, road_grid
from mmw.core.errors import InputError
from mmw.core.mesh import TriangleMesh, compact
from mmw.core.transforms import normalize, transform_points
from mmw.scene.radio_devices import finite_vector
from mmw.scene.scene_data import MODEL_NONE, SceneData
from mmw.scene.scene_edits import actor_of

PLANE, ROADS = "plane", "roads"
"""Names of the surfaces that are no object."""

HEIGHT_M = 1.5
"""Height of a plane above z = 0 and of cells above their road [m]: an antenna held in a hand. Source: Sionna RT 2.2."""

OBJECT_OFFSET_M = 0.01
"""Distance of cells from the object that they are on [m]: that of an antenna on its skin. Design value."""


def scene_surface(
    arrays: SceneData,
    frame: int,
    surface: str,
    tx_position: np.ndarray,
    *,
    cell_size_m: float = 2.0,
    height_m: float | None = None,
    center_m: ArrayLike | None = None,
    size_m: ArrayLike | None = None,
    orientation: ArrayLike | None = None,
    objects: Mapping[str, Any] | None = None,
) -> MeasurementSurface:
    """Return the measurement surface of a name.

    Args:
        arrays: The scene on the host.
        frame: Frame in which an object that moves is measured.
        surface: `plane`, `roads`, or the name or prim path of an object.
        tx_position: Transmitters, world frame [m], shape [T, 3]: plane and roads lie about their middle if a size but
            no center is given.
        cell_size_m: Side of a cell [m]; an object has a cell for each of its triangles.
        height_m: z of a plane, or height of cells above their road [m], 1.5 by default; distance of cells from an
            object along its outward normals [m], 0.01 by default.
        center_m: Middle (x, y) [m], or (x, y, z) of a plane, which then needs no height.
        size_m: Extent [m], shape [2]; the box of the scene by default.
        orientation: Plane to world, quaternion (x, y, z, w); level by default.
        objects: Name -> object with an `object_id`; prim paths are known without.

    Raises:
        InputError: If there is no such object, a value cannot be used, or does not go with the surface.
    """
    given = {"center_m": center_m, "size_m": size_m, "orientation": orientation}
    for name in () if surface == PLANE else ("orientation",) if surface == ROADS else given:
        if given[name] is not None:
            raise InputError(
                f"radio map: {name} of surface {surface!r}; only a plane{'' if name == 'orientation' else ' or roads'} "
                "can have it; leave it out"
            )
    if height_m is not None and not np.isfinite(height_m):
        raise InputError(f"radio map: height_m = {height_m:g}; a finite height is needed; correct it")
    if surface not in (PLANE, ROADS):
        mesh = object_mesh(arrays, frame, _object_id(arrays, surface, objects or {}), surface)
        mesh = mesh.select(mesh.areas > 0.0)
        return mesh_surface(mesh.points, mesh.faces, offset_m=OBJECT_OFFSET_M if height_m is None else height_m)
    height = HEIGHT_M if height_m is None else height_m
    center = (
        None if center_m is None else finite_vector("radio map: center_m", center_m, 3 if np.size(center_m) == 3 else 2)
    )
    if center is not None and size_m is None:
        raise InputError("radio map: center_m without size_m; the extent about the center is needed; give size_m")
    if center is not None and len(center) == 3 and (height_m is not None or surface == ROADS):
        raise InputError(
            f"radio map: center_m = {tuple(center.tolist())} of surface {surface!r} with a height; height_m has it "
            "already; give (x, y)"
        )
    if orientation is not None and (center is None or len(center) != 3):
        raise InputError("radio map: orientation without a center; give center_m as (x, y, z), and size_m")
    if size_m is not None:
        size = finite_vector("radio map: size_m", size_m, 2)
        middle = tx_position[:, :2].mean(axis=0) if center is None else center[:2]
        low, high = middle - size / 2.0, middle + size / 2.0
    elif len(arrays.points):
        low, high = arrays.points[:, :2].min(axis=0), arrays.points[:, :2].max(axis=0)
    else:
        raise InputError("radio map: the scene has no static geometry that tells an extent; give size_m")
    if surface == ROADS:
        return road_grid(arrays, cell_size_m, height, within_m=None if size_m is None else (*low, *high))
    z = height if center is None or len(center) == 2 else center[2]
    return plane_grid([*(low + high) / 2.0, z], high - low, cell_size_m, orientation)


def object_mesh(arrays: SceneData, frame: int, object_id: int, name: str) -> TriangleMesh:
    """Return the triangles of an object in a frame, world frame.

    Args:
        arrays: The scene on the host.
        frame: Frame number.
        object_id: Object of the static town, or an actor's.
        name: Name for messages.

    Raises:
        InputError: If it has no triangles, or is absent in that frame.
    """
    row = actor_of(arrays, object_id)
    if row < 0:
        mesh = compact(arrays.points, arrays.faces[arrays.object_id == object_id])
    elif arrays.actors[row].model == MODEL_NONE:
        mesh = compact(arrays.points, arrays.faces[:0])
    else:
        pose, model = arrays.poses[arrays.frame_row(frame), row], arrays.models[arrays.actors[row].model]
        if not np.isfinite(pose).all():
            raise InputError(f"radio map: object {name!r} is absent in frame {frame}; choose another frame")
        pose = np.concatenate([pose[:3], normalize(pose[3:])])
        mesh = TriangleMesh(transform_points(pose, model.points), model.faces)
    if not (mesh.areas > 0.0).any():
        raise InputError(f"radio map: object {name!r} has no triangles to measure on; choose another object")
    return mesh


def _object_id(arrays: SceneData, name: str, objects: Mapping[str, Any]) -> int:
    """Return the object of a name or prim path."""
    if name in objects:
        return int(objects[name].object_id)
    paths = {item.prim_path: item.object_id for item in arrays.objects}
    if name in paths:
        return paths[name]
    near = get_close_matches(name, [PLANE, ROADS, *objects, *paths], n=3, cutoff=0.4)
    raise InputError(
        f"radio map: surface = {name!r}; plane, roads, an object of the scene or a MeasurementSurface is needed; "
        f"{'did you mean ' + ' or '.join(near) + '?' if near else 'see scene.objects'}"
    )
