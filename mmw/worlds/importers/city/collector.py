"""Collect the surfaces of city objects, and make a mesh of each object and material."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mmw.core.closed_bodies import turn_outward
from mmw.core.errors import InputError
from mmw.core.georeference import Georeference
from mmw.core.mesh import compact
from mmw.physics.materials.material import RadioMaterial
from mmw.worlds.importers.city.polygons import normal_of, triangulate
from mmw.worlds.importers.city.reference_system import ReferenceSystem, check_numbers, check_reach, place
from mmw.worlds.importers.city.surface_types import (
    BUILDING,
    CLASSES,
    MATERIALS,
    OPEN,
    PITCH,
    PITCHED,
    STEEP,
    ObjectClass,
)  # fmt: skip
from mmw.worlds.importers.imported_scene import ImportedMaterial, ImportedScene
from mmw.worlds.importers.mesh_cleanup import MAX_COORDINATE_M, PrimNames, clean_faces
from mmw.worlds.towns.mesh_part import MeshPart

WATER = ImportedMaterial(
    "water", "water", (0.02, 0.05, 0.06), roughness=0.05, radio=RadioMaterial("itu", itu="itu_wet_ground")
)
"""Open water; the wettest of the ground rows replaces it, design value."""
PARTS = {"RoofSurface": "roof", "Window": "window", "WindowSurface": "window", "Door": "door", "DoorSurface": "door"}
"""Type of a surface -> mesh of its object; all others are in `facade` of a building and `surface` of other objects."""
GROUND_REACH = 0.5
"""A level surface of unknown type this near to the lowest point of its building is its underside [m]."""
MAX_POLYGONS = 3_000_000
"""Largest number of polygons of a file; a city of 100,000 detailed buildings."""

Rings = Sequence[np.ndarray]
"""Rings of a polygon, the outer one first, corners without the repeated first one, shape [N, 3]."""


@dataclass
class _Object:
    name: str
    path: str
    kind: ObjectClass
    polygons: list[Rings] = field(default_factory=list)
    types: list[str] = field(default_factory=list)

    @property
    def points(self) -> np.ndarray:
        """All corners, shape [N, 3]."""
        return np.concatenate([ring for rings in self.polygons for ring in rings])


@dataclass
class CityCollector:
    """Surfaces of city objects in the coordinates of their file."""

    path: Path
    notes: list[str] = field(default_factory=list)
    _objects: list[_Object] = field(default_factory=list)
    _left_out: Counter = field(default_factory=Counter)
    _polygons: int = 0
    _degenerate: int = 0
    _names: PrimNames = field(default_factory=PrimNames)

    def knows(self, type_name: str) -> bool:
        """Return whether objects of a type are built; others are counted for a note."""
        if type_name in CLASSES:
            return True
        self._left_out[type_name[:60]] += 1
        return False

    def add(self, name: str, type_name: str, surfaces: Sequence[tuple[Rings, str]]) -> None:
        """Add an object.

        Args:
            name: Its id in the file.
            type_name: A key of `CLASSES`.
            surfaces: Rings and type of each surface, empty for an unknown type.

        Raises:
            InputError: If the file has more than `MAX_POLYGONS`.
        """
        self._polygons += len(surfaces)
        if self._polygons > MAX_POLYGONS:
            raise InputError(f"{self.path}: more than {MAX_POLYGONS:,} polygons; cut out a smaller area")
        kept = [(rings, kind) for rings, kind in surfaces if kind not in OPEN and len(rings[0]) > 2]
        self._degenerate += sum(len(rings[0]) < 3 for rings, _ in surfaces)
        if kept:
            kind = CLASSES[type_name]
            each = _Object(name[:60], self._names.child(self._names.folder("", kind.group), f"b_{name}"), kind)
            each.polygons, each.types = [rings for rings, _ in kept], [kind for _, kind in kept]
            self._objects.append(each)

    def build(self, system: ReferenceSystem, notice: str = "") -> ImportedScene:
        """Return the scene.

        Args:
            system: Reference system of the coordinates.
            notice: As `ImportedScene.notice`.

        Raises:
            InputError: If there is no object, or coordinates cannot be used.
        """
        if not self._objects:
            kinds = f" (only {', '.join(sorted(self._left_out))})" if self._left_out else ""
            raise InputError(f"{self.path}: holds no city object with surfaces{kinds}; give a file with buildings")
        georeference = self._to_world(system)
        found = triangulate([rings for each in self._objects for rings in each.polygons])
        starts = np.cumsum([0, *(len(each.polygons) for each in self._objects)])
        rows = np.searchsorted(found.owner, starts)
        parts: list[MeshPart] = []
        degenerate, repeated, turned = self._degenerate + found.degenerate, 0, 0
        for k, each in enumerate(self._objects):
            corners = found.corners[rows[k] : rows[k + 1]]
            if len(corners) == 0:
                continue
            types = _surface_types(each)
            owner = found.owner[rows[k] : rows[k + 1]] - starts[k]
            points, faces, kept, twice = clean_faces(corners.reshape(-1, 3), np.arange(3 * len(corners)).reshape(-1, 3))
            repeated += twice
            faces, flipped = turn_outward(points, faces)
            turned += flipped
            parts += _parts(each, points, faces, [types[o] for o in owner[kept].tolist()])
        notes = list(self.notes)
        if self._left_out:
            named = ", ".join(f"{count} {name}" for name, count in sorted(self._left_out.items()))
            notes.append(f"objects of other types left out: {named}")
        for count, text in (
            (degenerate, "surfaces without an area were left out"),
            (found.repaired, "surfaces that cross themselves were repaired"),
            (repeated, "triangles that repeat another one of their object were left out"),
            (turned, "closed bodies were inside out; their faces were turned outward"),
        ):
            if count:
                notes.append(f"{count} {text}")
        if not any(part.label in ("terrain", "road", "ground") for part in parts):
            notes.append("no ground: the file has none; vehicles need roads of another file")
        foreign = {"water": WATER} if any(part.material == "water" for part in parts) else {}
        return ImportedScene(parts, foreign, None, tuple(notes), georeference=georeference, notice=notice)

    def _to_world(self, system: ReferenceSystem) -> Georeference | None:
        """Move the surfaces to the frame of the world, and return its place on the earth if that is known."""
        for each in self._objects:
            check_numbers(f"{self.path}: {each.name}", each.points)
        rings = [ring for each in self._objects for polygon in each.polygons for ring in polygon]
        world, georeference, notes = place(str(self.path), np.concatenate(rings), system)
        self.notes += notes
        placed = iter(np.split(world, np.cumsum([len(ring) for ring in rings])[:-1]))
        for each in self._objects:
            each.polygons = [[next(placed) for _ in polygon] for polygon in each.polygons]
        if np.abs(world).max(initial=0.0) > MAX_COORDINATE_M:  # one of them, or all, is named
            middles = np.array([each.points.mean(axis=0) for each in self._objects])
            away = np.linalg.norm(middles - np.median(middles, axis=0), axis=1)
            check_reach(f"{self.path}: {self._objects[int(np.argmax(away))].name}", world)
        return georeference


def _surface_types(each: _Object) -> list[str]:
    """Return the types of an object's surfaces; those of a building that are not known by where they look."""
    if each.kind is not BUILDING:
        return each.types
    low = min(float(ring[:, 2].min()) for rings in each.polygons for ring in rings[:1])
    types = []
    for rings, kind in zip(each.polygons, each.types, strict=True):
        if kind not in MATERIALS:
            normal = normal_of(rings[0])
            is_wall = abs(normal[2]) <= STEEP * np.linalg.norm(normal)
            is_low = float(rings[0][:, 2].mean()) < low + GROUND_REACH
            kind = "WallSurface" if is_wall else "GroundSurface" if is_low else "RoofSurface"
        if kind == "RoofSurface":
            normal = normal_of(rings[0])
            flat = float(np.linalg.norm(normal[:2])) <= PITCH * float(np.linalg.norm(normal))
            kind = "RoofSurface" if flat else PITCHED
        types.append(kind)
    return types


def _parts(each: _Object, points: np.ndarray, faces: np.ndarray, types: list[str]) -> list[MeshPart]:
    """Return one mesh for each material of an object."""
    kinds: dict[tuple[str, str], list[int]] = {}
    for row, kind in enumerate(types):
        if kind == PITCHED:
            key = ("roof", PITCHED)
        else:
            part = PARTS.get(kind, "facade" if each.kind is BUILDING else "surface")
            key = (part, MATERIALS.get(kind, each.kind.material))
        kinds.setdefault(key, []).append(row)
    names, parts = PrimNames(), []
    for (part, material), rows in sorted(kinds.items()):
        path = names.child(each.path, part)
        parts.append(MeshPart.of(path, compact(points, faces[rows]), material, each.kind.label))
    return parts
