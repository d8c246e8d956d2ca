"""Write an imported scene as a town asset: an interface layer with weather variants over a payload with the geometry.

Materials of the library come by reference to a copy beside the asset, materials of the source are written into the
payload, so that a weather variant of the interface layer can override both. The asset needs no file of another folder.
"""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pxr import Kind, Sdf, Usd, UsdGeom

from mmw.core.errors import InputError
from mmw.traffic.roads.lane_prims import write_lanes
from mmw.usd import schema
from mmw.usd.atomic_layers import save_layers
from mmw.usd.georeference import write_georeference
from mmw.usd.material_library import LIBRARY, LIBRARY_FILE, MaterialSpec
from mmw.usd.material_library import ROOT as LIBRARY_ROOT
from mmw.usd.notices import write_notice
from mmw.usd.prim_specs import new_mesh, new_prim, set_label
from mmw.worlds.importers.imported_scene import ImportedMaterial, ImportedScene
from mmw.worlds.importers.material_copies import copy_materials
from mmw.worlds.materials.library import write_material
from mmw.worlds.towns.block_description import SHIPPED_WEATHER
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.write_usd import GROUND_MATERIALS, ROOT, interface_layer, set_meters_z_up

UNLABELED = "unlabeled"

LOOK_OF_ROW = {
    "itu_concrete": "concrete_facade", "itu_brick": "brick_facade", "itu_marble": "marble_facade", "itu_wood": "wood",
    "itu_plywood": "wood", "itu_chipboard": "wood", "itu_floorboard": "wood", "itu_glass": "glass_facade",
    "itu_metal": "metal_fascia", "itu_pec": "metal_fascia", "itu_very_dry_ground": "asphalt",
    "itu_medium_dry_ground": "soil", "itu_wet_ground": "soil", "itu_asphalt_concrete": "asphalt",
}  # fmt: skip
"""Radio row -> library material that lends its color, where the source has none, and its SimReady base. Design
values."""


@dataclass
class _Node:
    """A prim of the geometry: a group of others, or a mesh."""

    path: str
    children: dict[str, "_Node"] = field(default_factory=dict)
    part: MeshPart | None = None

    def labels(self) -> set[str]:
        """Return the semantic classes of all meshes at or below."""
        own = {self.part.label} if self.part else set()
        return own.union(*(child.labels() for child in self.children.values()))


def write_scene(
    scene: ImportedScene,
    out: str | Path,
    name: str,
    *,
    overwrite: bool = False,
) -> Path:
    """Write an interface layer and what it needs, all of it or nothing; the same input gives the same bytes.

    These are the payload, `<name>_geometry.usdc`, and, where materials of the library are used, a copy of these and of
    their textures in `<name>_materials/`. All paths are relative.

    Args:
        scene: The scene, after `check_scene` and `apply_material_map`.
        out: Folder of the asset, made if missing, or the interface layer itself, a `.usda`, `.usd` or `.usdc` file.
        name: Name of the asset, and of the interface layer in a folder.
        overwrite: Whether files that are there are replaced.

    Returns:
        Path of the interface layer.

    Raises:
        InputError: If a material has no radio description, a path cannot be a prim's, or a file exists.
        OSError: If a file cannot be written; what was there before stays.
    """
    schema.register()
    path, payload = asset_files(out, name)
    materials = path.with_name(f"{path.stem}_materials") / LIBRARY_FILE
    layers, textures = {payload: _geometry(scene)}, {}
    if library := sorted({part.material for part in scene.parts if part.material not in scene.materials}):
        layers[materials], files = copy_materials(library)
        textures = {materials.parent / file: data for file, data in files.items()}
    layers[path] = _interface(scene, payload.name, f"{materials.parent.name}/{materials.name}", library, name)
    for file in (*layers, *textures):
        if file.exists() and not overwrite:
            raise InputError(f"{file}: is there already; give --overwrite to replace it, or another --out")
    save_layers(layers, textures)
    return path


def asset_files(out: str | Path, name: str) -> tuple[Path, Path]:
    """Return interface layer and payload of an asset, in a folder or as the USD file that `out` names."""
    path = Path(out).resolve()
    if path.suffix not in (".usd", ".usda", ".usdc"):
        path = path / f"{name}.usda"
    return path, path.with_name(f"{path.stem}_geometry.usdc")


def _geometry(scene: ImportedScene) -> Sdf.Layer:
    """Return the payload: meshes, lanes and the source's own materials."""
    layer = Sdf.Layer.CreateAnonymous("geometry.usdc")
    stage = Usd.Stage.Open(layer)
    set_meters_z_up(stage)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, ROOT).GetPrim())
    UsdGeom.Scope.Define(stage, ROOT.AppendChild("Materials"))
    used = {part.material for part in scene.parts}
    for name, material in scene.materials.items():
        if name in used:
            write_material(stage, str(ROOT.AppendPath(f"Materials/{name}")), material_spec(material))
    with Sdf.ChangeBlock():
        for node in _tree(scene).children.values():
            _write_node(layer, node, 1, UNLABELED, False, scene.components)
    if scene.lanes is not None:
        write_lanes(stage, str(ROOT.AppendChild("Lanes")), scene.lanes)
    return layer


def material_spec(material: ImportedMaterial) -> MaterialSpec:
    """Return a foreign material as the library describes its own.

    Raises:
        InputError: If it has no radio description.
    """
    radio = material.radio
    if radio is None:
        raise InputError(f"material {material.name!r} has no radio description; apply a material map first")
    look = LIBRARY.get(LOOK_OF_ROW.get(radio.itu, ""))
    roughness, metallic, color = material.roughness, material.metallic, material.color
    if color is None and look is not None:
        roughness, metallic, color = look.roughness, look.metallic, look.color
    return MaterialSpec(
        radio,
        material.base or (look.base if look is not None else "none"),
        color or (0.5, 0.5, 0.5),
        roughness,
        metallic,
        material.opacity,
        coating=material.coating,
        attributes=material.attributes,
    )


def _tree(scene: ImportedScene) -> _Node:
    root = _Node("")
    for part in scene.parts:
        node, names = root, part.path.split("/")
        for depth, name in enumerate(names):
            if not Sdf.Path.IsValidIdentifier(name) or names[0] in ("Materials", "Lanes"):
                raise InputError(f"part {part.path!r}: not a prim path of a town; rename it")
            node = node.children.setdefault(name, _Node("/".join(names[: depth + 1])))
            if node.part is not None:
                raise InputError(f"part {part.path!r}: {node.path!r} is a mesh already; give each mesh its own path")
        if node.children:
            raise InputError(f"part {part.path!r}: other meshes are below it; give each mesh its own path")
        node.part = part
    return root


def _write_node(
    layer: Sdf.Layer, node: _Node, depth: int, inherited: str, is_inside: bool, components: Collection[str]
) -> None:
    """Write a prim and what is below it; a label of all of that is written on the prim.

    Everything above a component is a group. A prim right above meshes is a component, unless it is a top-level group.
    """
    kind = "" if is_inside else _kind(node, depth, components)
    path = ROOT.AppendPath(node.path)
    if node.part is not None:
        binding = ROOT.AppendPath(f"Materials/{node.part.material}")
        spec = new_mesh(layer, path, node.part.points, node.part.faces, binding)
        if kind:
            spec.kind = kind
    else:
        spec = new_prim(layer, path, "Xform", kind)
    labels = node.labels()
    if len(labels) == 1 and labels != {inherited}:
        inherited = labels.pop()
        set_label(spec, inherited)
    for child in node.children.values():
        _write_node(layer, child, depth + 1, inherited, is_inside or kind == Kind.Tokens.component, components)


def _kind(node: _Node, depth: int, components: Collection[str]) -> str:
    if node.path in components:
        return Kind.Tokens.component
    if node.part is not None:
        return ""
    has_components = any(child.part is None or child.path in components for child in node.children.values())
    return Kind.Tokens.group if depth == 1 or has_components else Kind.Tokens.component


def _interface(scene: ImportedScene, payload: str, materials: str, library: Sequence[str], name: str) -> Sdf.Layer:
    """Return the layer that users refer to, with its materials of the library, which are in the file `materials`."""
    wet = [material for material in GROUND_MATERIALS if material in library]
    layer = interface_layer(name, scene.parts, payload, SHIPPED_WEATHER, wet)
    write_notice(layer, scene.notice)
    write_georeference(layer, scene.georeference)
    for material in library:
        spec = new_prim(layer, ROOT.AppendPath(f"Materials/{material}"), "Material")
        spec.referenceList.Prepend(Sdf.Reference(f"./{materials}", f"{LIBRARY_ROOT}/{material}"))
    return layer
