"""Clean imported meshes: prim names, degenerate triangles, bodies inside out, and a plausible size of the world."""

import logging
import re
from collections.abc import Collection, Sequence
from dataclasses import dataclass, field

import numpy as np

from mmw.core.closed_bodies import turn_outward
from mmw.core.errors import InputError
from mmw.core.mesh import TriangleMesh, compact
from mmw.worlds.importers.formats import UNITS
from mmw.worlds.importers.imported_scene import ImportedScene
from mmw.worlds.towns.mesh_part import MeshPart

logging.getLogger("trimesh").addHandler(logging.NullHandler())  # it logs traces of what it then raises

MIN_SIZE_M, MAX_SIZE_M = 1.0, 20_000.0
"""A world smaller or larger than this [m] is assumed to have a wrong unit. Design values."""

MAX_COORDINATE_M = 20_000.0
"""Farthest coordinate from the origin [m]: float32 vertices there are 2 mm apart, `PLANE_M` of
`mmw.core.planar_surfaces` is 1 mm. Design value."""

MAX_NUMBER_M = 1e12
"""Largest coordinate of a file [m]: beyond it float32 overflows in products."""

Y_UP = np.array([[1.0, 0.0, 0.0, 0.0], [0.0, 0.0, -1.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
"""A world with y up, to ours with z up: x stays, y becomes z, z becomes -y. Column vectors, shape [4, 4]."""

RESERVED = ("Materials", "Lanes")
"""Names directly below the town's root that meshes cannot have."""


def identifier(name: str) -> str:
    """Return a name as a prim name: letters, digits and `_`, not starting with a digit."""
    name = re.sub(r"\W", "_", name, flags=re.ASCII) or "_"
    return f"_{name}" if name[0].isdigit() else name


def free_name(stem: str, used: Collection[str], number: int = 1) -> str:
    """Return a name that is not used yet: `stem`, `stem_2`, `stem_3`, ...; those up to `number` are known to be."""
    name = stem if number == 1 else f"{stem}_{number}"
    while name in used:
        number += 1
        name = f"{stem}_{number}"
    return name


@dataclass
class PrimNames:
    """Unique prim names: the second `wall` below one parent becomes `wall_2`."""

    used_names: set[str] = field(default_factory=lambda: set(RESERVED))
    folders: dict[tuple[str, str], str] = field(default_factory=dict)
    _last_number: dict[str, int] = field(default_factory=dict)

    def child(self, parent: str, name: str) -> str:
        """Return a free path below a parent; an empty parent is the town's root."""
        stem = f"{parent}/{identifier(name)}".lstrip("/")
        path = free_name(stem, self.used_names, self._last_number.get(stem, 1))  # thousands may have one name
        self._last_number[stem] = int(path[len(stem) + 1 :] or 1)
        self.used_names.add(path)
        return path

    def folder(self, parent: str, name: str) -> str:
        """Return the path of a prim that holds others: always the same one for a name, and no mesh's."""
        if (parent, name) not in self.folders:
            self.folders[parent, name] = self.child(parent, name)
        return self.folders[parent, name]


@dataclass
class MeshCollector:
    """The meshes of a source, cleaned."""

    origin: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """Point of the source [m] that becomes (0, 0, 0), shape [3]."""
    parts: list[MeshPart] = field(default_factory=list)
    degenerate: int = 0
    """Triangles without area that were left out."""
    repeated: int = 0
    """Triangles with the corners of another one of their mesh that were left out."""
    turned: int = 0
    """Closed bodies that were inside out."""
    empty: list[str] = field(default_factory=list)
    """Meshes without any triangle that were left out."""

    def add(
        self, where: str, path: str, points: np.ndarray, faces: np.ndarray, material: str, label: str = "unlabeled"
    ) -> None:
        """Add a mesh, z up; one without triangles is left out.

        Args:
            where: File and object, for errors.
            path: Prim path below the town's root.
            points: Vertices before `origin` is subtracted [m], shape [N, 3].
            faces: Triangles, shape [M, 3].
            material: Material name.
            label: Semantic class.

        Raises:
            InputError: If a vertex is not finite, or a face refers to a vertex that does not exist.
        """
        points, faces = np.asarray(points, np.float64), np.asarray(faces)
        if len(points) == 0 or faces.size == 0:
            points, faces = np.zeros((0, 3)), np.zeros((0, 3), np.int64)
        if points.ndim != 2 or faces.ndim != 2 or points.shape[1] != 3 or faces.shape[1] != 3:
            raise InputError(
                f"{where}: vertices of {points.shape[1:]} and faces of {faces.shape[1:]} numbers; 3 of each are "
                "needed; repair the mesh in the tool that made it"
            )
        bad = ~(np.abs(points) <= MAX_NUMBER_M).all(axis=1)
        if bad.any():
            raise InputError(
                f"{where}: {bad.sum()} of {len(points)} vertices are not finite or beyond {MAX_NUMBER_M:g} m (the "
                f"first is number {np.flatnonzero(bad)[0]}); numbers are needed; repair the mesh"
            )
        if len(faces) and not 0 <= faces.min() <= faces.max() < len(points):
            raise InputError(
                f"{where}: a face refers to vertex {faces.max()} of {len(points)}; existing ones are needed; repair "
                "the mesh in the tool that made it"
            )
        mesh, degenerate, repeated = clean(points - self.origin, faces)
        self.degenerate += degenerate
        self.repeated += repeated
        if len(mesh.faces):
            faces, turned = turn_outward(mesh.points, mesh.faces)
            self.turned += turned
            self.parts.append(MeshPart.of(path, TriangleMesh(mesh.points, faces), material, label))
        else:
            self.empty.append(path)

    def notes(self) -> list[str]:
        """Return what was left out or turned, for people."""
        lines = []
        if self.degenerate:
            lines.append(f"{self.degenerate} triangles without area were left out")
        if self.repeated:
            lines.append(f"{self.repeated} triangles that repeat another one of their mesh were left out")
        if self.turned:
            lines.append(f"{self.turned} closed bodies were inside out; their faces were turned outward")
        if self.empty:
            names = ", ".join(self.empty[:5]) + (", ..." if len(self.empty) > 5 else "")
            lines.append(f"{len(self.empty)} meshes without triangles were left out: {names}")
        return lines


def clean(points: np.ndarray, faces: np.ndarray) -> tuple[TriangleMesh, int, int]:
    """Merge equal vertices; drop triangles without area, repeated triangles, and vertices without triangles.

    Vertices are compared as the float32 numbers that a USD file holds, so that faces that share an edge in the file
    share it in the mesh. Of triangles with the same three corners, also of opposite winding, the first stays: a wave
    that hits both would be reflected, or weakened, twice.

    Args:
        points: Vertices [m], shape [N, 3].
        faces: Triangles, shape [M, 3].

    Returns:
        The mesh, its vertices float64 of float32 numbers; how many triangles had no area, how many were repeated.
    """
    unique, kept_faces, kept, repeated = clean_faces(points, faces)
    return compact(unique, kept_faces), len(faces) - len(kept) - repeated, repeated


def clean_faces(points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
    """Clean a mesh as `clean` does, and return which triangles stay.

    Returns:
        Unique vertices, float64 of float32 numbers, shape [U, 3]; triangles that stay, shape [K, 3]; their rows,
        rising, shape [K]; how many of the others were repeated.
    """
    exact = points.astype(np.float32) + np.float32(0.0)  # no negative zero
    _, first, inverse = np.unique(_as_rows(exact), return_index=True, return_inverse=True)
    unique, faces = exact[first].astype(np.float64), inverse.reshape(-1)[faces]
    # the limit of `mmw.core.planar_surfaces.find_surfaces`
    solid = np.flatnonzero(2.0 * TriangleMesh(unique, faces).areas > 1e-12)
    corners_of = np.sort(faces[solid], axis=1).astype(np.int32)
    kept = solid[np.sort(np.unique(_as_rows(corners_of), return_index=True)[1])]
    return unique, faces[kept], kept, len(solid) - len(kept)


def _as_rows(triples: np.ndarray) -> np.ndarray:
    """Return rows of three 4-byte numbers as one item each: `np.unique` is several times faster than with `axis=0`."""
    return np.ascontiguousarray(triples).view(np.dtype((np.void, 12))).ravel()


def transformed(points: np.ndarray, faces: np.ndarray, matrix: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a mesh placed by a matrix (column vectors, shape [4, 4]); a mirroring one turns the faces over.

    A mesh whose vertices have no three numbers stays as it is: `MeshCollector.add` refuses it.
    """
    points, faces = np.asarray(points, np.float64), np.asarray(faces)
    if points.ndim != 2 or points.shape[1] != 3 or faces.ndim != 2:
        return points, faces
    points = points @ matrix[:3, :3].T + matrix[:3, 3]
    return points, faces[:, ::-1] if np.linalg.det(matrix[:3, :3]) < 0.0 else faces


def linear(srgb: Sequence[float]) -> tuple[float, float, float]:
    """Return an sRGB color, 0 to 1, as linear numbers.

    Source: IEC 61966-2-1.
    """
    value = np.clip(np.asarray(srgb[:3], np.float64), 0.0, 1.0)
    red, green, blue = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4).round(6).tolist()
    return red, green, blue


def bounds(scene: ImportedScene) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and the highest corner of a world [m], shape [3] each."""
    low, high = np.swapaxes([part.mesh.bounds for part in scene.parts], 0, 1)
    return low.min(axis=0), high.max(axis=0)


def check_scene(where: str, scene: ImportedScene) -> None:
    """Raise InputError for a scene without triangles, of an unlikely size, or with coordinates beyond the limits."""
    if not scene.parts:
        raise InputError(f"{where}: holds no triangle; a world needs surfaces; give a file with meshes")
    low, high = bounds(scene)
    size = high - low
    text = " x ".join(f"{length:.4g}" for length in size)
    if not MIN_SIZE_M <= size.max() <= MAX_SIZE_M:
        needed = "smaller than 1 m" if size.max() < MIN_SIZE_M else "larger than 20 km"
        raise InputError(
            f"{where}: the world is {text} m, {needed}; a wrong unit is likely; say what one unit of the file is with "
            f"--unit ({', '.join(UNITS)})"
        )
    if max(np.abs(low).max(), np.abs(high).max()) > MAX_COORDINATE_M:
        middle = " ".join(f"{value:.0f}" for value in (*(0.5 * (low + high))[:2], low[2]))
        raise InputError(
            f"{where}: the world ({text} m) lies around ({middle.replace(' ', ', ')}) m, more than 20 km from its "
            f"origin; float32 vertices are too coarse there; move it with --origin {middle}"
        )
