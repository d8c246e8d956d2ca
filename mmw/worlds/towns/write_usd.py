"""Town parts and lane graph -> USD: an interface layer with weather variants over a payload with the geometry.

The weather variants override attributes of the ground's Material prims. A variant loses to an opinion of its own layer
stack but beats references and payloads, so the interface layer holds no opinion of its own on what a variant sets:
materials come by reference, geometry by payload.
"""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from pxr import Kind, Sdf, Usd, UsdGeom, Vt

from mmw.core.errors import InputError
from mmw.core.resources import assets_dir
from mmw.traffic.roads.lane_graph import LaneGraph
from mmw.traffic.roads.lane_prims import write_lanes
from mmw.traffic.roads.sidewalk_prims import Sidewalk, write_sidewalks
from mmw.usd import schema
from mmw.usd.actors import PARKED
from mmw.usd.atomic_layers import save_layers
from mmw.usd.material_library import LIBRARY
from mmw.usd.prim_specs import new_mesh, new_prim, set_label, set_normals, set_texture_coordinates
from mmw.usd.vehicle_catalog import load_catalog
from mmw.worlds.materials.textures import TILES
from mmw.worlds.towns.block_description import TownWeather
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.parked_prims import ParkedCar, write_parked
from mmw.worlds.towns.picture_uv import picture_coordinates
from mmw.worlds.towns.smooth_normals import part_normals
from mmw.worlds.towns.texture_uv import indexed, texture_coordinates

ROOT = Sdf.Path("/Town")
GROUND_MATERIALS = ("asphalt", "road_marking", "concrete_sidewalk", "curb", "grass", "soil")
"""Materials whose radio attributes the weather variants override."""

PAYLOAD = "geometry.usdc"


def set_meters_z_up(stage: Usd.Stage) -> None:
    """Write axes and unit of every town."""
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)


def _write_mesh(layer: Sdf.Layer, path: Sdf.Path, part: MeshPart) -> Sdf.PrimSpec:
    if layer.GetPrimAtPath(path):
        raise InputError(f"part {part.path!r} is given twice; give each mesh its own path")
    if part.material not in LIBRARY:
        known = ", ".join(sorted(LIBRARY))
        raise InputError(f"{path}: material {part.material!r}; the library holds {known}; use one of them")
    mesh = new_mesh(layer, path, _rounded(part.points), part.faces, ROOT.AppendPath(f"Materials/{part.material}"))
    corners = picture_coordinates(part)
    if corners is not None:
        set_texture_coordinates(mesh, *indexed(corners.reshape(-1, 2)))
    elif part.material in TILES:
        set_texture_coordinates(mesh, *texture_coordinates(part.mesh))
    normals = part_normals(part)
    if normals is not None:
        set_normals(mesh, _rounded(normals))
    return mesh


def _rounded(values: np.ndarray) -> np.ndarray:
    """Return float64 values whose float32 is the same on every CPU: a zero may be 1e-18 or -0 on another one."""
    return np.round(values, 9) + 0.0


def _write_groups(layer: Sdf.Layer, parts: Sequence[MeshPart]) -> None:
    """Write groups, components and meshes; a label of a whole group is written on the group."""
    groups: dict[str, dict[str, list[MeshPart]]] = {}
    for part in parts:
        names = part.path.split("/")
        if len(names) < 2 or not all(Sdf.Path.IsValidIdentifier(name) for name in names):
            raise InputError(f"part {part.path!r}: not a prim path; `Group/name` or `Group/component/mesh` is needed")
        groups.setdefault(names[0], {}).setdefault(names[1], []).append(part)
    for group, members in groups.items():
        path = ROOT.AppendChild(group)
        spec = new_prim(layer, path, "Xform", Kind.Tokens.group)
        labels = {part.label for member in members.values() for part in member}
        shared = labels.pop() if len(labels) == 1 else ""
        if shared:
            set_label(spec, shared)
        for name, member in members.items():
            _write_component(layer, path.AppendChild(name), member, shared)


def _write_component(layer: Sdf.Layer, path: Sdf.Path, parts: Sequence[MeshPart], inherited: str) -> None:
    """Write one component with its meshes, or a single mesh directly in its group."""
    label = parts[0].label
    if len(parts[0].path.split("/")) == 2:
        specs = [_write_mesh(layer, ROOT.AppendPath(part.path), part) for part in parts]
        owner = specs[0]
    else:
        owner = new_prim(layer, path, "Xform", Kind.Tokens.component)
        for part in parts:
            mesh = _write_mesh(layer, ROOT.AppendPath(part.path), part)
            if part.label != label:
                set_label(mesh, part.label)
    if label != inherited:
        set_label(owner, label)


def _write_weather(stage: Usd.Stage, weather: Mapping[str, TownWeather], materials: Sequence[str]) -> None:
    """Write the variant set `weather`, which gives materials the radio row of wet ground; the first one is selected.

    Looks are the same in all variants: a camera darkens and smooths what is wet itself.
    """
    prim = stage.GetPrimAtPath(ROOT)
    variants = prim.GetVariantSets().AddVariantSet("weather")
    for name, state in weather.items():
        variants.AddVariant(name)
        variants.SetVariantSelection(name)
        with variants.GetVariantEditContext():
            for key, value, doc in (
                ("rainRate", state.rain_rate_mm_h, "Rain rate [mm/h]."),
                ("visibility", state.visibility_m, "Meteorological optical range [m]."),
            ):
                attribute = prim.CreateAttribute(f"mmw:weather:{key}", Sdf.ValueTypeNames.Float)
                attribute.Set(value)
                attribute.SetDocumentation(doc)
            for material in materials if state.ground_itu else ():
                _write_ground(stage, material, state.ground_itu)
    variants.SetVariantSelection(next(iter(weather)))


def _write_ground(stage: Usd.Stage, material: str, itu: str) -> None:
    prim = stage.OverridePrim(ROOT.AppendPath(f"Materials/{material}"))
    for key, value in (("model", "itu"), ("itu", itu)):
        attribute = schema.RADIO_ATTRIBUTES[key]
        prim.CreateAttribute(attribute.name, attribute.type_name, False, attribute.variability).Set(value)


def interface_layer(
    name: str, parts: Sequence[MeshPart], payload: str, weather: Mapping[str, TownWeather], wet: Sequence[str]
) -> Sdf.Layer:
    """Return the layer that users refer to, without its materials: metadata, payload, weather variants.

    Args:
        name: Name of the asset.
        parts: All meshes, for the extent.
        payload: File name of the payload, which will lie beside the layer.
        weather: Variant name -> state; the first is the default.
        wet: Library materials whose radio attributes the weather overrides.
    """
    layer = Sdf.Layer.CreateAnonymous(f"{name}.usda")
    stage = Usd.Stage.Open(layer)
    set_meters_z_up(stage)
    root = UsdGeom.Xform.Define(stage, ROOT).GetPrim()
    stage.SetDefaultPrim(root)
    Usd.ModelAPI(root).SetKind(Kind.Tokens.assembly)
    Usd.ModelAPI(root).SetAssetName(name)
    corners = [[part.points.min(axis=0), part.points.max(axis=0)] for part in parts]
    extent = np.stack([np.min(corners, axis=(0, 1)), np.max(corners, axis=(0, 1))]).astype(np.float32)
    UsdGeom.ModelAPI.Apply(root).SetExtentsHint(Vt.Vec3fArray.FromNumpy(extent))
    UsdGeom.Scope.Define(stage, ROOT.AppendChild("Materials"))
    _write_weather(stage, weather, wet)
    del stage  # the payload is relative to a file that does not exist yet, so nothing may compose it here
    layer.GetPrimAtPath(ROOT).payloadList.Prepend(Sdf.Payload(f"./{payload}", ROOT))
    return layer


def write_town(
    out_dir: str | Path,
    name: str,
    parts: Sequence[MeshPart],
    lanes: LaneGraph,
    weather: Mapping[str, TownWeather],
    materials: str | Path | None = None,
    parked: Sequence[ParkedCar] = (),
    walks: Sequence[Sidewalk] = (),
) -> Path:
    """Write `<name>.usda` (interface) and `geometry.usdc` (payload); the same input gives the same bytes.

    Args:
        out_dir: Folder of the town asset; made if missing.
        name: Name of the town and of the interface layer.
        parts: All meshes, in the town frame; prims are written in this order.
        lanes: Lane graph.
        weather: Variant name -> state; the first is the default.
        materials: The material library; the shipped one by default. It is referenced by relative path.
        parked: Parked cars, which reference the shipped vehicles by relative path.
        walks: Where people walk.

    Returns:
        Path of the interface layer.

    Raises:
        InputError: If a part has an unknown material or label, an invalid path, or the path of another part.
        OSError: If a file cannot be written; files that were there before stay.
    """
    schema.register()
    out_dir = Path(out_dir).resolve()
    out_dir.mkdir(parents=True, exist_ok=True)
    materials = Path(materials or assets_dir() / "materials" / "materials.usda").resolve()

    geometry = Sdf.Layer.CreateAnonymous(PAYLOAD)
    stage = Usd.Stage.Open(geometry)
    set_meters_z_up(stage)
    with Sdf.ChangeBlock():
        new_prim(geometry, ROOT, "Xform")
        _write_groups(geometry, parts)
    stage.SetDefaultPrim(stage.GetPrimAtPath(ROOT))
    write_lanes(stage, str(ROOT.AppendChild("Lanes")), lanes)
    write_sidewalks(stage, str(ROOT.AppendChild("Walks")), walks)
    del stage
    if parked:  # with references relative to the file, so after the stage that would compose them
        write_parked(geometry, ROOT.AppendChild(PARKED), parked, load_catalog(), out_dir)

    layer = interface_layer(name, parts, PAYLOAD, weather, GROUND_MATERIALS)
    reference = Sdf.Reference(Path(os.path.relpath(materials, out_dir)).as_posix(), "/Materials")
    layer.GetPrimAtPath(ROOT.AppendChild("Materials")).referenceList.Prepend(reference)
    path = out_dir / f"{name}.usda"
    save_layers({out_dir / PAYLOAD: geometry, path: layer})
    return path
