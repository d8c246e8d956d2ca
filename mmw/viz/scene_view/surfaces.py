"""Gather the surfaces of a scene at one frame as colored triangles, and cut them by a box."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mmw.core.choices import check_choice
from mmw.core.errors import InputError
from mmw.core.mesh import TriangleMesh
from mmw.core.transforms import normalize, rotate
from mmw.physics.materials.material import Material
from mmw.scene.radio_devices import finite_vector
from mmw.scene.scene_data import MODEL_NONE, Prototype, SceneData
from mmw.viz.plots.style import CLASS_COLORS
from mmw.worlds.materials.textures import srgb

ColorBy = Literal["material", "class"]
"""Quantity that surfaces are colored by: the material, or the semantic class of the object."""

Style = tuple[str, tuple[int, int, int]]
"""Name of a group of faces, and its 8-bit sRGB color."""


@dataclass(frozen=True)
class SurfaceMesh:
    """All faces of one color."""

    name: str
    points: np.ndarray
    """Vertices in the world [m], shape [N, 3], float32."""
    normals: np.ndarray
    """Unit normals at the vertices, shape [N, 3], float32."""
    faces: np.ndarray
    """Triangles, counter-clockwise seen from outside, shape [M, 3], uint32."""
    color: tuple[int, int, int]
    """8-bit sRGB."""


@dataclass(frozen=True)
class ClipBox:
    """The part of the world that is shown; surfaces are cut at its sides. An infinite side cuts nothing."""

    low: tuple[float, float, float] = (-np.inf, -np.inf, -np.inf)
    """Least x, y and z [m]."""
    high: tuple[float, float, float] = (np.inf, np.inf, np.inf)
    """Greatest x, y and z [m]."""

    @classmethod
    def of(cls, clip_z_m: float | None, clip: Sequence[float] | None) -> "ClipBox":
        """Return the box of the arguments of `show`.

        Args:
            clip_z_m: Height above which surfaces are cut off [m]; None cuts none.
            clip: Least x, y, z and greatest x, y, z [m]; None cuts nothing.

        Raises:
            InputError: If both are given, a number is NaN, there are not six, or a side is not before the other.
        """
        if clip_z_m is not None and clip is not None:
            raise InputError("show: clip_z_m and clip are both given; one of them is needed; leave the other out")
        if clip_z_m is not None:
            return cls(high=(np.inf, np.inf, float(finite_vector("show: clip_z_m", [clip_z_m], 1)[0])))
        if clip is None:
            return cls()
        try:
            sides = np.asarray(clip, dtype=np.float64)
        except (TypeError, ValueError):
            sides = np.full(6, np.nan)
        if sides.shape != (6,) or np.isnan(sides).any() or not (sides[:3] < sides[3:]).all():
            raise InputError(
                f"show: clip = {clip!r}; (xmin, ymin, zmin, xmax, ymax, zmax) in meters is needed, each minimum "
                "below its maximum, inf for an open side; correct it"
            )
        return cls(tuple(sides[:3].tolist()), tuple(sides[3:].tolist()))

    def cut(self, corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the parts of triangles inside the box.

        A triangle across a side is cut there: what remains is one triangle or two, and further columns are
        interpolated along its edges.

        Source: I. E. Sutherland, G. W. Hodgman, "Reentrant polygon clipping", Communications of the ACM 17(1), 1974.

        Args:
            corners: Corners of the triangles, x, y, z [m] first, shape [M, 3, K].

        Returns:
            Corners of the parts, shape [N, 3, K], and the triangle that each is of, shape [N], int64.
        """
        face = np.arange(len(corners))
        for axis in range(3):
            for side, sign in ((self.low[axis], -1.0), (self.high[axis], 1.0)):
                if np.isfinite(side):
                    corners, own = _cut_at(corners, sign * (corners[..., axis] - side))
                    face = face[own]
        return corners, face


EVERYTHING = ClipBox()
"""The box that cuts nothing."""


def _cut_at(corners: np.ndarray, distance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the parts of triangles where a distance is at most 0, and the triangle of each.

    Args:
        corners: Corners, shape [M, 3, K].
        distance: Signed distance of each corner from the plane [m], shape [M, 3].
    """
    is_out = distance > 0.0
    whole = np.flatnonzero(~is_out.any(axis=1))
    crossed = np.flatnonzero(is_out.any(axis=1) & (distance < 0.0).any(axis=1))
    parts, faces = [corners[whole]], [whole]
    for out_count in (1, 2):
        own = crossed[is_out[crossed].sum(axis=1) == out_count]
        # The odd corner, alone on its side, comes first; the order around the triangle stays.
        odd = np.argmax(is_out[own] == (out_count == 1), axis=1)
        turn = (odd[:, None] + np.arange(3)) % 3
        a, b, c = np.moveaxis(np.take_along_axis(corners[own], turn[..., None], axis=1), 1, 0)
        da, db, dc = np.take_along_axis(distance[own], turn, axis=1).T
        ab = a + (da / (da - db))[:, None] * (b - a)
        ac = a + (da / (da - dc))[:, None] * (c - a)
        pieces = [(a, ab, ac)] if out_count == 2 else [(ab, b, c), (ab, c, ac)]
        for piece in pieces:
            parts.append(np.stack(piece, axis=1))
            faces.append(own)
    face = np.concatenate(faces)
    order = np.argsort(face, kind="stable")
    return np.concatenate(parts)[order], face[order]


def faces_with_normals(shape: SceneData | Prototype) -> np.ndarray:
    """Return position and unit normal at the corners of each face of a town or a prototype, shape [M, 3, 6], float64.

    Where the shape has no normal, that of the face stands.
    """
    mesh = TriangleMesh(shape.points, shape.faces)
    is_flat = (shape.normals == 0.0).all(axis=-1, keepdims=True)
    return np.concatenate([mesh.corners, np.where(is_flat, mesh.normals[:, None], shape.normals)], axis=-1)


def actor_faces(arrays: SceneData, frame: int) -> list[tuple[int, np.ndarray]]:
    """Return the actors with geometry that are present in a frame: index, and corners as of `faces_with_normals`."""
    poses, found = arrays.poses[arrays.frame_row(frame)], []
    local = {index: faces_with_normals(model) for index, model in enumerate(arrays.models)}
    for index, (actor, pose) in enumerate(zip(arrays.actors, poses, strict=True)):
        if actor.model != MODEL_NONE and np.isfinite(pose).all():
            shape = local[actor.model]
            turn = normalize(pose[3:])
            points = rotate(turn, shape[..., :3]) + pose[:3]
            found.append((index, np.concatenate([points, rotate(turn, shape[..., 3:])], axis=-1)))
    return found


def group_meshes(corners: np.ndarray, group: np.ndarray, styles: Sequence[Style]) -> list[SurfaceMesh]:
    """Return a mesh for each group of faces; vertices of equal place and normal are joined.

    Args:
        corners: Position and normal at the corners of each face, shape [M, 3, 6].
        group: Index into `styles` of each face, shape [M].
        styles: Name and color of each group.
    """
    found = []
    for index in np.unique(group):
        both = corners[group == index].reshape(-1, 6).astype(np.float32) + np.float32(0.0)  # no -0: bytes are compared
        rows = np.ascontiguousarray(both).view(np.dtype((np.void, both.itemsize * 6))).ravel()
        _, first, place = np.unique(rows, return_index=True, return_inverse=True)
        faces = place.reshape(-1, 3).astype(np.uint32)
        name, color = styles[index]
        found.append(SurfaceMesh(name, both[first, :3], both[first, 3:], faces, color))
    return found


def material_styles(materials: Sequence[Material]) -> list[Style]:
    """Return name and color of each material."""
    colors = [srgb(np.asarray(material.color)) for material in materials]
    return [
        (material.name, (int(red), int(green), int(blue)))
        for material, (red, green, blue) in zip(materials, colors, strict=True)
    ]


def scene_surfaces(
    arrays: SceneData, frame: int, materials: Sequence[Material], box: ClipBox, color_by: ColorBy = "material"
) -> tuple[list[SurfaceMesh], dict[str, list[SurfaceMesh]]]:
    """Return the surfaces of a scene in a frame, cut by a box: those of the town, and actor -> its own.

    Args:
        arrays: The scene.
        frame: Frame.
        materials: Materials by id, of the weather that is shown.
        box: Part of the world that is shown.
        color_by: Quantity that gives the colors.

    Raises:
        InputError: If `color_by` is unknown.
    """
    check_choice("show: color_by", color_by, ColorBy)
    by_class = color_by == "class"
    styles = [(label, CLASS_COLORS[label]) for label in CLASS_COLORS] if by_class else material_styles(materials)
    number = {label: index for index, label in enumerate(CLASS_COLORS)}
    group = arrays.material
    if by_class:
        group = np.array([number[one.label] for one in arrays.objects], dtype=np.int64)[arrays.object_id]
    corners, face = box.cut(faces_with_normals(arrays))
    town = group_meshes(corners, group[face], styles)
    actors = {}
    for index, whole in actor_faces(arrays, frame):
        actor = arrays.actors[index]
        own = np.full(len(whole), number[actor.label]) if by_class else arrays.models[actor.model].material
        corners, face = box.cut(whole)
        if len(face):
            actors[actor.name] = group_meshes(corners, own[face], styles)
    return town, actors
