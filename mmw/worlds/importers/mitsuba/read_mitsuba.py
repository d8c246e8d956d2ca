"""Mitsuba scenes, as Sionna RT reads them: shapes with transforms, and radio materials in both of Sionna's dialects."""

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from trimesh.exchange.ply import load_ply

from mmw.core.errors import InputError
from mmw.physics.materials.itu_rows import RADIO_ROWS
from mmw.physics.materials.material import LOBE_EXPONENTS, RadioMaterial, file_values, wrong_radio_value
from mmw.worlds.importers.imported_scene import ImportedMaterial, ImportedScene
from mmw.worlds.importers.mesh_cleanup import Y_UP, MeshCollector, PrimNames, identifier, transformed
from mmw.worlds.importers.mitsuba import values
from mmw.worlds.importers.xml_nodes import XmlNode

DEFAULT_THICKNESS_M = 0.1
"""Thickness of a radio material that gives none [m]. Source: Sionna RT 2, `DEFAULT_THICKNESS`."""

XML_NAMES = {"scattering": "scattering_coefficient", "xpd": "xpd_coefficient", "lobe_share": "lambda_", "itu": "type"}
"""Field of a radio material -> its name in a file, where that is another."""

SECTIONS = 32
"""Sides of a round shape; design value."""

GROUP = "Shapes"
"""Group below the town's root that holds the shapes."""

Mesh = tuple[np.ndarray, np.ndarray]
COLORS = ("color", "reflectance", "base_color", "diffuse_reflectance", "specular_reflectance")


def read_mitsuba(
    path: str | Path, *, up: str = "z", unit_m: float = 1.0, origin: Sequence[float] = (0.0, 0.0, 0.0)
) -> ImportedScene:
    """Return the shapes of a Mitsuba or Sionna RT scene.

    Read are the shapes ply, obj, rectangle, cube, sphere, disk, cylinder, merge, shapegroup and instance; transforms,
    variables and included files; the materials `itu-radio-material` and `radio-material`, materials whose id starts
    with `itu_` or `mat-itu_`, and the colors of others. A shape called `house-wall` becomes `wall` of the component
    `house`.

    Args:
        path: XML file.
        up: Axis that points up in the file, `z` (Sionna's) or `y`.
        unit_m: One unit of the file [m].
        origin: Point of the world [m] that becomes (0, 0, 0).

    Raises:
        InputError: With file and line, if the file, a file that it names, or a value cannot be used.
    """
    path = Path(path)
    to_world = np.diag([unit_m, unit_m, unit_m, 1.0])
    reader = _Reader(path.parent, Y_UP @ to_world if up == "y" else to_world, MeshCollector(np.asarray(origin, float)))
    elements = values.scene_elements(path)
    for node in elements:
        if node.tag == "bsdf":
            reader.add_bsdf(node)
        elif node.tag == "shape" and node.attributes.get("type") == "shapegroup":
            reader.groups[node.get("id")] = node
    for node in elements:
        if node.tag == "shape":
            reader.add_shape(node, np.eye(4), None)
    return ImportedScene(reader.meshes.parts, reader.materials, None, (*reader.notes, *reader.meshes.notes()))


@dataclass
class _Reader:
    folder: Path
    to_world: np.ndarray
    meshes: MeshCollector
    names: PrimNames = field(default_factory=PrimNames)
    materials: dict[str, ImportedMaterial] = field(default_factory=dict)
    bsdfs: dict[str, str] = field(default_factory=dict)  # id -> name of the Material prim
    groups: dict[str, XmlNode] = field(default_factory=dict)
    notes: list[str] = field(default_factory=list)

    def add_bsdf(self, node: XmlNode, owner: str = "") -> str:
        """Read a material and return its name; one inside a shape without an id is called after the shape."""
        source = node.attributes.get("id") or owner
        if not source:
            raise InputError(f"{node.where}: <bsdf> has no id; shapes refer to it by that; add one")
        if not owner and source in self.bsdfs:
            raise InputError(f"{node.where}: the id {source!r} is given twice; materials need their own; rename one")
        name = identifier(source.removeprefix("mat-"))
        while name in self.materials:
            name += "_"
        self.materials[name] = _material(node, name, source)
        if not owner:
            self.bsdfs[source] = name
        if any(below.tag == "texture" for below in node.below()):
            self.notes.append(f"material {source}: its texture is not read; give it a color with a material map")
        return name

    def add_shape(self, node: XmlNode, outer: np.ndarray, inherited: str | None, is_instanced: bool = False) -> None:
        """Add a shape, or the shapes inside a merged or instanced one."""
        kind = node.get("type")
        material = self.material_of(node, inherited)
        matrix = outer @ values.transform(node)
        if kind == "merge":
            for child in node.find("shape"):
                self.add_shape(child, matrix, material, is_instanced)
        elif kind == "instance":
            if is_instanced:
                raise InputError(f"{node.where}: an instance inside a shapegroup; Mitsuba has one level; flatten it")
            group = next((ref.get("id") for ref in node.find("ref") if ref.get("id") in self.groups), None)
            if group is None:
                raise InputError(f"{node.where}: the instance refers to no shapegroup; add <ref id=.../>")
            for child in self.groups[group].find("shape"):
                self.add_shape(child, matrix, material, is_instanced=True)
        elif kind == "shapegroup":
            return
        elif kind in _SHAPES or kind in ("ply", "obj"):
            points, faces = _SHAPES[kind](node) if kind in _SHAPES else _load(node, self.folder)
            points, faces = transformed(points, faces, self.to_world @ matrix)
            faces = faces[:, ::-1] if values.flag(node, "flip_normals", "flipNormals") else faces
            self.meshes.add(node.where, self.path_of(node, kind), points, faces, material or self.no_material())
        else:
            known = ", ".join([*_SHAPES, "ply", "obj", "merge", "shapegroup", "instance"])
            raise InputError(f"{node.where}: shape {kind!r} is not read; one of {known} is needed; convert it to ply")

    def material_of(self, node: XmlNode, inherited: str | None) -> str | None:
        for child in node.children:
            if child.tag == "bsdf":
                return self.add_bsdf(child, owner=_shape_name(node))
            if child.tag == "ref" and child.attributes.get("name", "bsdf") in ("bsdf", "material"):
                wanted = child.get("id")
                if wanted in self.bsdfs:
                    return self.bsdfs[wanted]
                if wanted not in self.groups:
                    known = ", ".join(self.bsdfs) or "none"
                    raise InputError(
                        f"{child.where}: no <bsdf> has the id {wanted!r}; the file's are: {known}; correct the ref"
                    )
        return inherited

    def no_material(self) -> str:
        self.materials.setdefault("no_material", ImportedMaterial("no_material", ""))
        return "no_material"

    def path_of(self, node: XmlNode, kind: str) -> str:
        """Return a prim path: `house-wall` is the part `wall` of `house`, any other shape is a mesh of its own."""
        name, above = _shape_name(node) or kind, self.names.folder("", GROUP)
        head, _, tail = name.rpartition("-")
        if head and tail:
            return self.names.child(self.names.folder(above, head), tail)
        return self.names.child(above, name)


def _shape_name(node: XmlNode) -> str:
    name = node.attributes.get("id") or node.attributes.get("name")
    if name:
        return name.removeprefix("mesh-")
    return Path(values.text(node, "filename")).stem or node.attributes.get("type", "")


def _material(node: XmlNode, name: str, source: str) -> ImportedMaterial:
    inner = node
    while inner.get("type") in ("twosided", "mask", "bumpmap", "normalmap") and list(inner.find("bsdf")):
        inner = next(inner.find("bsdf"))
    kind = inner.get("type")
    is_metal = kind in ("conductor", "roughconductor")
    alpha = values.number(inner, "alpha", 0.1)
    roughness = alpha**0.5 if kind in ("roughconductor", "roughdielectric", "roughplastic") else 0.8
    return ImportedMaterial(
        name,
        source,
        color=values.color(node, *COLORS),
        opacity=values.number(node, "opacity", 1.0),
        metallic=values.number(inner, "metallic", 1.0 if is_metal else 0.0),
        roughness=values.number(inner, "roughness", roughness),
        **_radio(node, source),
    )


def _radio(node: XmlNode, source: str) -> dict[str, Any]:
    """Return the radio material of a material, or its row that does not exist; nothing for a visual one."""
    named = re.match(r"(?:mat-)?itu[-_]([A-Za-z_]*[A-Za-z])", source)
    kind = node.get("type")
    fields: dict[str, Any] = {**file_values(RadioMaterial("constant")), "thickness": DEFAULT_THICKNESS_M}
    numbers = [name for name, default in fields.items() if isinstance(default, float | int)]
    if kind == "itu-radio-material" or named:
        row = values.text(node, "type") or (named[1] if named else "")
        if not row:
            raise InputError(f"{node.where}: the material {source!r} has no <string name='type'>; add a row of P.2040")
        fields |= {"model": "itu", "itu": f"itu_{row}"}
        numbers = [name for name in numbers if name not in ("relative_permittivity", "conductivity")]
        if fields["itu"] not in RADIO_ROWS:
            return {"unknown_row": fields["itu"]}
    elif kind != "radio-material":
        return {}
    fields |= {name: values.number(node, XML_NAMES.get(name, name), fields[name]) for name in numbers}
    fields |= {name: int(fields[name]) for name in LOBE_EXPONENTS if fields[name] == int(fields[name])}
    fields["scattering_pattern"] = values.text(node, "scattering_pattern", "lambertian")
    wrong = wrong_radio_value(fields)
    if wrong is not None:
        name, needed = wrong
        raise InputError(
            f"{node.where}: {XML_NAMES.get(name, name)} = {fields[name]!r}; {needed} is needed; correct the value"
        )
    return {"radio": RadioMaterial(**fields)}


def _load(node: XmlNode, folder: Path) -> Mesh:
    path = values.find_file(node, folder)
    try:
        if path.suffix.lower() == ".ply":  # without trimesh's copies: a town has thousands of these files
            with path.open("rb") as file:
                arrays = load_ply(file, skip_materials=True)
            return np.asarray(arrays["vertices"], np.float64), np.asarray(arrays.get("faces", ()), np.int64)
        mesh = trimesh.load_mesh(str(path), process=False)
        return np.array(mesh.vertices, np.float64), np.array(mesh.faces, np.int64)
    except Exception as error:  # trimesh raises any exception of its parsers
        reason = " ".join(str(error).split())[:120] or type(error).__name__
        raise InputError(f"{node.where}: {path}: cannot be read ({reason}); write the mesh again") from None


def _rectangle(node: XmlNode) -> Mesh:
    points = np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]])
    return points, np.array([[0, 1, 2], [0, 2, 3]])


def _cube(node: XmlNode) -> Mesh:
    box = trimesh.creation.box((2.0, 2.0, 2.0))
    return np.array(box.vertices), np.array(box.faces)


def _sphere(node: XmlNode) -> Mesh:
    ball = trimesh.creation.icosphere(subdivisions=3, radius=values.number(node, "radius", 1.0))
    return np.array(ball.vertices) + values.point(node, "center", (0.0, 0.0, 0.0)), np.array(ball.faces)


def _ring(height: float) -> np.ndarray:
    angle = np.linspace(0.0, 2.0 * np.pi, SECTIONS, endpoint=False)
    return np.stack([np.cos(angle), np.sin(angle), np.full(SECTIONS, height)], axis=1)


def _disk(node: XmlNode) -> Mesh:
    here = np.arange(SECTIONS)
    faces = np.stack([np.full(SECTIONS, SECTIONS), here, (here + 1) % SECTIONS], axis=1)
    return np.concatenate([_ring(0.0), np.zeros((1, 3))]), faces


def _cylinder(node: XmlNode) -> Mesh:
    """Return the mantle of a cylinder, as Mitsuba's has no caps."""
    start, end = values.point(node, "p0", (0.0, 0.0, 0.0)), values.point(node, "p1", (0.0, 0.0, 1.0))
    axis = (end - start) / max(float(np.linalg.norm(end - start)), 1e-300)
    side = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    side /= max(float(np.linalg.norm(side)), 1e-300)
    ring = _ring(0.0) * values.number(node, "radius", 1.0)
    around = ring[:, :1] * side + ring[:, 1:2] * np.cross(axis, side)
    here, after = np.arange(SECTIONS), (np.arange(SECTIONS) + 1) % SECTIONS
    low = np.stack([here, after, after + SECTIONS], axis=1)
    high = np.stack([here, after + SECTIONS, here + SECTIONS], axis=1)
    return np.concatenate([start + around, end + around]), np.concatenate([low, high])


_SHAPES: dict[str, Callable[[XmlNode], Mesh]] = {
    "rectangle": _rectangle, "cube": _cube, "sphere": _sphere, "disk": _disk, "cylinder": _cylinder,
}  # fmt: skip
"""Shapes without a file, as Mitsuba defines them before `to_world`."""
