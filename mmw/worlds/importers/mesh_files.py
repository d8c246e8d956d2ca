"""glTF, OBJ, PLY, STL and OFF files: meshes with the names, the hierarchy and the materials that the file has."""

import io
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from mmw.core.errors import InputError
from mmw.worlds.importers.formats import MESHES
from mmw.worlds.importers.imported_scene import ImportedMaterial, ImportedScene
from mmw.worlds.importers.mesh_cleanup import Y_UP, MeshCollector, PrimNames, free_name, identifier, linear, transformed

GROUP = "Model"
"""Group below the town's root that holds the meshes."""

SINGLE = (".ply", ".stl", ".off")
"""Formats that hold one mesh, which is called after the file."""

COMPRESSION = ("KHR_draco_mesh_compression", "EXT_meshopt_compression")
"""Extensions of glTF without which its buffers hold no numbers."""
MAX_HEADER = 1_000_000
"""Bytes of a binary glTF in which the names of its extensions are looked for; its text comes first."""

UP_OF_SUFFIX = {".glb": "y", ".gltf": "y"}
"""Source: glTF 2.0, 3.4: +Y is up, units are meters. The other formats say nothing; z and meters are assumed."""


def read_meshes(
    path: str | Path, *, up: str = "", unit_m: float = 0.0, origin: Sequence[float] = (0.0, 0.0, 0.0)
) -> ImportedScene:
    """Return the meshes of a file.

    Every node that has a mesh becomes a prim below `Model`, with its ancestors above it. Instances become meshes of
    their own; a mirroring transform turns the faces over. Textures are not read: a material has the mean color.

    Args:
        path: File of a format of `mmw.worlds.importers.formats.MESHES`.
        up: Axis that points up in the file, `y` or `z`; the format's own if empty.
        unit_m: One unit of the file [m]; 1 if zero.
        origin: Point of the world [m] that becomes (0, 0, 0).

    Raises:
        InputError: If the file cannot be read or a vertex is not finite.
    """
    path = Path(path)
    suffix = path.suffix.lower()
    scene = _load(path, suffix)
    up, notes = up or UP_OF_SUFFIX.get(suffix, "z"), []
    if suffix not in UP_OF_SUFFIX and not unit_m:
        notes.append(f"{suffix[1:]} files say neither unit nor up axis: meters and {up} up are assumed (--unit, --up)")
    unit = unit_m or 1.0
    scale = np.diag([unit, unit, unit, 1.0])
    to_world = Y_UP @ scale if up == "y" else scale
    meshes, materials, names = MeshCollector(np.asarray(origin, float)), MaterialCollector(), PrimNames()
    base = names.folder("", GROUP)
    for node, prim, mesh in _named_meshes(scene, base, names, path.stem if suffix in SINGLE else ""):
        if not isinstance(mesh, trimesh.Trimesh):  # lines and points have no surface
            meshes.empty.append(prim)
            continue
        matrix = to_world @ np.asarray(scene.graph[node][0], float)
        points, faces = transformed(mesh.vertices, mesh.faces, matrix)
        meshes.add(f"{path}: {node}", prim, points, faces, materials.name_of(mesh))
    return ImportedScene(meshes.parts, materials.found, None, (*notes, *materials.notes, *meshes.notes()))


def _load(path: Path, suffix: str) -> trimesh.Scene:
    if not path.is_file():
        raise InputError(f"{path}: no such file; give an existing {', '.join(MESHES.suffixes)} file")
    if suffix == ".glb":
        return load_glb(path.read_bytes(), str(path))
    options = {"split_objects": True, "split_groups": True} if suffix == ".obj" else {}
    try:
        return trimesh.load_scene(str(path), process=False, **options)
    except Exception as error:  # trimesh raises any exception of its parsers
        raise _unreadable(str(path), suffix[1:], error) from None


def load_glb(data: bytes, where: str) -> trimesh.Scene:
    """Return the scene of a binary glTF.

    Raises:
        InputError: If it cannot be read, or is compressed.
    """
    start = data[:MAX_HEADER]
    packed = next((name for name in COMPRESSION if name.encode() in start), None)
    try:
        return trimesh.load_scene(io.BytesIO(data), file_type="glb", process=False)
    except Exception as error:  # trimesh raises any exception of its parsers
        if packed:
            raise InputError(
                f"{where}: its meshes are compressed by {packed}, which is not read; export it without compression"
            ) from None
        raise _unreadable(where, "glb", error) from None


def _unreadable(where: str, kind: str, error: Exception) -> InputError:
    reason = " ".join(str(error).split())[:120] or type(error).__name__
    return InputError(f"{where}: cannot be read as {kind} ({reason}); write the file again")


def placed_meshes(
    scene: trimesh.Scene, base: str, names: PrimNames, to_world: np.ndarray
) -> Iterator[tuple[str, str, np.ndarray, np.ndarray, trimesh.Trimesh]]:
    """Yield node, prim path, vertices [m], shape [N, 3], faces and mesh of a glTF scene; y becomes up.

    Args:
        scene: The scene.
        base: Prim that holds the meshes.
        names: Names of prims that are used.
        to_world: Matrix of the frame with z up, column vectors, shape [4, 4].
    """
    for node, prim, mesh in _named_meshes(scene, base, names):
        if isinstance(mesh, trimesh.Trimesh):
            matrix = to_world @ Y_UP @ np.asarray(scene.graph[node][0], float)
            points, faces = transformed(mesh.vertices, mesh.faces, matrix)
            yield node, prim, points, faces, mesh


def _named_meshes(
    scene: trimesh.Scene, base: str, names: PrimNames, single: str = ""
) -> Iterator[tuple[str, str, Any]]:
    """Yield node, prim path and geometry, sorted by node, so that the same file gives the same prims.

    A node that has others below it becomes a prim that holds them, and its mesh. `single` names the only mesh of a
    format that has no names.
    """
    parents = dict(scene.graph.transforms.parents)
    above = set(parents.values())

    def folder(node: str) -> str:
        if node == scene.graph.base_frame or node not in parents:
            return base
        return names.folder(folder(parents[node]), node)

    for node in sorted(scene.graph.nodes_geometry):
        geometry = scene.graph[node][1]
        if single:
            prim = names.child(base, single)
        elif node in above:
            prim = names.child(folder(node), geometry)
        else:
            prim = names.child(folder(parents.get(node, node)), node)
        yield node, prim, scene.geometry[geometry]


@dataclass
class MaterialCollector:
    """Materials of the file, by what they are: two of the same name may differ."""

    found: dict[str, ImportedMaterial] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)
    _name_of: dict[tuple, str] = field(default_factory=dict)

    def name_of(self, mesh: trimesh.Trimesh) -> str:
        """Return the name of a mesh's material, which is added if it is new."""
        material = getattr(mesh.visual, "material", None)
        source = getattr(material, "name", None)
        source = source if isinstance(source, str) else ""
        look = _look(mesh, material)
        key = (source, *look.items())
        if key not in self._name_of:
            name = free_name(identifier(source) if source else "no_material", self.found)
            self.found[name] = ImportedMaterial(name, source, **look)
            self._name_of[key] = name
            if _texture(material) is not None:
                self.notes.append(f"material {source or 'without a name'}: of its texture the mean color is kept")
        return self._name_of[key]


def _texture(material: Any) -> Any:
    images = (getattr(material, name, None) for name in ("baseColorTexture", "image"))
    return next((image for image in images if image is not None), None)


def _look(mesh: trimesh.Trimesh, material: Any) -> Mapping[str, Any]:
    """Return color, opacity, metallic and roughness of a mesh, as fields of `ImportedMaterial`."""
    if material is None:
        visual: Any = mesh.visual
        if getattr(visual, "kind", None) not in ("face", "vertex"):
            return {}
        colors = visual.face_colors if visual.kind == "face" else visual.vertex_colors
        return {"color": linear(np.asarray(colors, np.float64)[:, :3].mean(axis=0) / 255.0)}
    if hasattr(material, "baseColorFactor"):  # glTF; factors are linear, the defaults are the standard's
        factor = material.baseColorFactor
        color = np.ones(4) if factor is None else np.asarray(factor, np.float64) / 255.0
        metallic, roughness = material.metallicFactor, material.roughnessFactor
        look = {
            "opacity": round(float(color[3]), 6) if material.alphaMode == "BLEND" else 1.0,
            "metallic": 1.0 if metallic is None else float(metallic),
            "roughness": 1.0 if roughness is None else float(roughness),
        }
    else:
        diffuse = getattr(material, "diffuse", None)
        if diffuse is None:
            return {}
        color, look = np.asarray(diffuse, np.float64) / 255.0, {}
    image = _texture(material)
    if image is not None:
        color = color[:3] * linear(np.asarray(image.convert("RGB"), np.float64).mean(axis=(0, 1)) / 255.0)
    red, green, blue = np.round(color[:3], 6).tolist()
    return {"color": (red, green, blue), **look}
