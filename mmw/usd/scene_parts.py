"""Read meshes of a stage as parts of a scene: placed, in meters, with materials, classes and corner primvars."""

from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from pxr import Sdf, Usd

from mmw.usd.material_entries import MaterialMap, entry_of, find_pattern
from mmw.usd.materials import Copies, MaterialUse, resolve_material
from mmw.usd.meshes import FoundMesh, MeshReader, bound_materials, check_placed, materials_of, place
from mmw.usd.preview_surface import DEFAULT_PRIMVAR, texture_primvar
from mmw.usd.primvars import NO_CORNERS, Corners, display_color, place_corners
from mmw.usd.wheels import mesh_wheels


@dataclass
class Part:
    """Triangles of one mesh prim, in meters, in the world or in an actor's frame."""

    points: np.ndarray
    """Vertices [m], shape [N, 3], float64."""
    faces: np.ndarray
    """Triangles, shape [M, 3], int32."""
    use: np.ndarray
    """Index into `PartReader.uses` of each face, shape [M], int32."""
    label: str
    """Semantic class of the mesh."""
    object_path: str
    """Prim path of the component that the mesh belongs to."""
    object_label: str
    """Semantic class of that component."""
    wheels: np.ndarray = field(default_factory=lambda: np.zeros((0, 4)))
    """Of an actor's mesh: center and radius of each wheel, see `mesh_wheels`."""
    wheel: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int32))
    """Wheel of each face, -1 for none, shape [M], int32."""
    corners: Corners = NO_CORNERS
    """Texture coordinates and normals."""


@dataclass
class PartReader:
    """Turns meshes into parts, and collects their materials and notes."""

    meshes: MeshReader
    material_map: MaterialMap
    uses: dict[MaterialUse, int] = field(default_factory=dict)
    """Material uses and their numbers, in order of appearance."""
    unresolved: dict[str, None] = field(default_factory=dict)
    """Meshes without a radio material, one line each."""
    matched: set[str] = field(default_factory=set)
    """Patterns of the material map that decide about a mesh."""
    notes: dict[str, None] = field(default_factory=dict)
    """Notes for the user on looks, one line each."""
    first_mesh: dict[MaterialUse, str] = field(default_factory=dict)
    """Material use -> the first mesh without texture coordinates, or with a color of its own."""
    copies: Copies = field(default_factory=Copies)
    _shading: dict[Sdf.Path, tuple[str, bool]] = field(default_factory=dict)
    _resolved: dict[tuple[Sdf.Path | None, str], MaterialUse | None] = field(default_factory=dict)
    _shading_of_copies: dict[Hashable, tuple[str, bool]] = field(default_factory=dict)

    def parts(
        self, meshes: Sequence[FoundMesh], matrices: Sequence[np.ndarray], is_moving: Sequence[bool]
    ) -> list[Part | None]:
        """Return meshes as parts; None for one without a triangle.

        Each step handles all meshes: a town has thousands of small ones, and mesh after mesh takes twice as long.

        Args:
            meshes: The meshes.
            matrices: Mesh space to that of the part, row vectors, shape [4, 4] each.
            is_moving: Whether each belongs to an actor, and so may have wheels.
        """
        self.meshes.read([mesh.prim for mesh in meshes])
        cuts = [self.meshes.triangles(mesh.prim) for mesh in meshes]
        rows = [k for k, cut in enumerate(cuts) if len(cut.faces)]
        prims, kept = [meshes[k].prim for k in rows], [cuts[k] for k in rows]
        bound = [
            bound_materials(prim, cut.polygon, whole)
            for prim, cut, whole in zip(prims, kept, materials_of(prims), strict=True)
        ]
        labels = [self._label(prim, materials[0]) for prim, (materials, _) in zip(prims, bound, strict=True)]
        objects = [self._object(meshes[k], label) for k, label in zip(rows, labels, strict=True)]
        shading = [[self.shading(material) for material in materials] for materials, _ in bound]
        names = [[name for name, _ in own] for own in shading]
        raw = [
            [self.meshes.corners(prim, cut, name) for name in own]
            for prim, cut, own in zip(prims, kept, names, strict=True)
        ]
        ids = [
            [self._use_id(prim, label, *row) for row in zip(materials, own, found, strict=True)]
            for prim, label, (materials, _), own, found in zip(prims, labels, bound, shading, raw, strict=True)
        ]
        placed = [place(cut, matrices[k]) for cut, k in zip(kept, rows, strict=True)]
        for prim, (points, _) in zip(prims, placed, strict=True):
            check_placed(prim.GetPath(), points)
        corners = [
            place_corners(self._corners(own, found, index), matrices[k])
            for own, found, (_, index), k in zip(names, raw, bound, rows, strict=True)
        ]
        parts: list[Part | None] = [None] * len(meshes)
        for n, k in enumerate(rows):
            (points, faces), use = placed[n], np.array(ids[n], dtype=np.int32)[bound[n][1]]
            wheels = mesh_wheels(prims[n], kept[n], matrices[k]) if is_moving[k] else ()
            parts[k] = Part(points, faces, use, labels[n], *objects[n], *wheels, corners=corners[n])
        return parts

    def shading(self, material: Usd.Prim | None) -> tuple[str, bool]:
        """Return the primvar that a material's textures read, and whether its surface shader is read."""
        if material is None:
            return DEFAULT_PRIMVAR, False
        path = material.GetPath()
        if path not in self._shading:
            key = self.copies.specs(material) or path
            if key not in self._shading_of_copies:
                self._shading_of_copies[key] = texture_primvar(material)
            self._shading[path] = self._shading_of_copies[key]
        return self._shading[path]

    def _label(self, prim: Usd.Prim, material: Usd.Prim | None) -> str:
        """Return the class of a mesh: that of the material map, by path, first material's name or class, or its own."""
        label = self.meshes.label(prim)
        entry = entry_of(self.material_map, self._pattern(prim, material, label))
        return entry.label if entry is not None and entry.label is not None else label

    def _pattern(self, prim: Usd.Prim, material: Usd.Prim | None, label: str) -> str:
        """Return the pattern of the material map that decides about a mesh's material, empty for none."""
        name = material.GetName() if material else ""
        pattern = find_pattern(self.material_map, str(prim.GetPath()), name, label=label)
        self.matched.update([pattern] if pattern else ())
        return pattern

    def _object(self, mesh: FoundMesh, label: str) -> tuple[str, str]:
        """Return path and class of the component that a mesh belongs to, both of the class that the map gives."""
        component = self.meshes.component(mesh.anchor)
        is_own = component == mesh.prim or label != self.meshes.label(mesh.prim)
        own = label if is_own else self.meshes.label(component)
        return str(component.GetPath()), label if own == "unlabeled" else own

    def _corners(self, names: Sequence[str], found: Sequence[Corners], index: np.ndarray) -> Corners:
        """Return what lies at a mesh's corners, from the primvars that its materials read; notes what is wrong."""
        of_name: Mapping[str, Corners] = dict(zip(names, found, strict=True))
        for own in of_name.values():
            self.notes.update((line, None) for line in own.notes)
        if len(of_name) == 1:
            return found[0]
        uv = np.zeros((len(index), 3, 2), dtype=np.float32)
        for k, own in enumerate(found):
            if own.uv is not None:
                uv[index == k] = own.uv[index == k]
        return Corners(uv, found[0].normals)

    def _use_id(
        self, prim: Usd.Prim, label: str, material: Usd.Prim | None, shading: tuple[str, bool], corners: Corners
    ) -> int:
        """Return the number of the use of one of a mesh's materials, -1 where nothing describes it."""
        key = material.GetPath() if material else None, label
        if self.material_map or key not in self._resolved:  # the map needs the path of the mesh
            pattern = self._pattern(prim, material, self.meshes.label(prim))
            entry = entry_of(self.material_map, pattern)
            self._resolved[key] = resolve_material(label, material, entry, pattern)
        use, has_uv = self._resolved[key], corners.uv is not None
        if use is None:
            known = f"material {material.GetPath()}" if material else "no material"
            self.unresolved[f"{prim.GetPath()} ({known})"] = None
            return -1
        color = None if shading[1] else display_color(prim)
        if not has_uv or color is not None:
            use = replace(use, has_uv=has_uv, display_color=color)
            self.first_mesh.setdefault(use, str(prim.GetPath()))
        return self.uses.setdefault(use, len(self.uses))
