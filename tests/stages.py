"""Small USD stages written by tests."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, UsdShade, Vt

from tests.scenes import box_mesh

WET = {"sunny": "itu_very_dry_ground", "rainy": "itu_wet_ground"}


def new_stage(path: Path, *, up: str = "Z", metres_per_unit: float = 1.0) -> Usd.Stage:
    """Return an empty stage with the prim /World, 100 time codes a second."""
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, up)
    UsdGeom.SetStageMetersPerUnit(stage, metres_per_unit)
    stage.SetTimeCodesPerSecond(100)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/World").GetPrim())
    return stage


def add_material(stage: Usd.Stage, path: str, itu: str = "", base: str = "") -> UsdShade.Material:
    """Write a Material prim, with radio attributes if `itu` is given and a non-visual base if `base` is."""
    material = UsdShade.Material.Define(stage, path)
    prim = material.GetPrim()
    if itu:
        prim.CreateAttribute("mmw:radio:model", Sdf.ValueTypeNames.Token).Set("itu")
        prim.CreateAttribute("mmw:radio:itu", Sdf.ValueTypeNames.Token).Set(itu)
        prim.CreateAttribute("mmw:radio:thickness", Sdf.ValueTypeNames.Float).Set(0.1)
    if base:
        prim.CreateAttribute("omni:simready:nonvisual:base", Sdf.ValueTypeNames.Token).Set(base)
    return material


def bind(prim: Usd.Prim, material: UsdShade.Material, purpose: str = "") -> None:
    """Bind a material, for all purposes or for one."""
    tokens = UsdShade.Tokens
    api = UsdShade.MaterialBindingAPI.Apply(prim)
    api.Bind(material, tokens.weakerThanDescendants, purpose) if purpose else api.Bind(material)


def label(prim: Usd.Prim, name: str) -> None:
    """Write the semantic class of a prim."""
    prim.CreateAttribute("semantics:labels:class", Sdf.ValueTypeNames.TokenArray).Set(Vt.TokenArray([name]))


def add_polygons(
    stage: Usd.Stage, path: str, points: np.ndarray, polygons: Sequence[Sequence[int]], material=None
) -> UsdGeom.Mesh:
    """Write a Mesh prim of polygons."""
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(np.asarray(points, dtype=np.float32)))
    mesh.CreateFaceVertexCountsAttr([len(polygon) for polygon in polygons])
    mesh.CreateFaceVertexIndicesAttr([index for polygon in polygons for index in polygon])
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
    if material:
        bind(mesh.GetPrim(), material)
    return mesh


def add_box(stage: Usd.Stage, path: str, size, center=(0.0, 0.0, 0.0), material=None) -> UsdGeom.Mesh:
    """Write a box as a Mesh prim."""
    points, faces = box_mesh(size, center)
    return add_polygons(stage, path, points, faces.tolist(), material)


def animate(stage: Usd.Stage, path: str, positions: np.ndarray, yaw: np.ndarray | float = 0.0) -> UsdGeom.Xform:
    """Write an Xform with a translation and a rotation about z in every frame from 0."""
    xform = UsdGeom.Xform.Define(stage, path)
    translate = xform.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble)
    orient = xform.AddOrientOp(UsdGeom.XformOp.PrecisionFloat)
    for frame, (position, angle) in enumerate(zip(positions, np.broadcast_to(yaw, len(positions)), strict=True)):
        translate.Set(Gf.Vec3d(*map(float, position)), frame)
        orient.Set(Gf.Quatf(float(np.cos(angle / 2)), 0.0, 0.0, float(np.sin(angle / 2))), frame)
    return xform


def write_town(path: Path) -> Path:
    """Write a town asset with a weather variant set over referenced content: level road and one building."""
    inner = path.with_name("geometry.usda")
    stage = Usd.Stage.CreateNew(str(inner))
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    root = UsdGeom.Xform.Define(stage, "/Town").GetPrim()
    stage.SetDefaultPrim(root)
    asphalt = add_material(stage, "/Town/Materials/asphalt", WET["sunny"], "asphalt")
    marble = add_material(stage, "/Town/Materials/marble", "itu_marble", "marble")
    glass = add_material(stage, "/Town/Materials/glass", "itu_glass", "clear_glass")
    label(UsdGeom.Xform.Define(stage, "/Town/Roads").GetPrim(), "road")
    points = [[-50, -50, 0], [50, -50, 0], [50, 50, 0], [-50, 50, 0]]
    add_polygons(stage, "/Town/Roads/street", points, [[0, 1, 2, 3]], asphalt)
    building = UsdGeom.Xform.Define(stage, "/Town/Buildings/b_001")
    building.AddTranslateOp().Set(Gf.Vec3d(0.0, 30.0, 5.0))
    Usd.ModelAPI(building.GetPrim()).SetKind("component")
    label(building.GetPrim(), "building")
    add_box(stage, "/Town/Buildings/b_001/facade", (20, 10, 10), material=marble)
    add_box(stage, "/Town/Buildings/b_001/window", (2, 0.2, 2), (0, -5.1, 0), glass)
    stage.Save()
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    town = stage.DefinePrim("/Town", "Xform")
    stage.SetDefaultPrim(town)
    town.GetReferences().AddReference("./geometry.usda")
    variants = town.GetVariantSets().AddVariantSet("weather")
    for weather, row in WET.items():
        variants.AddVariant(weather)
        variants.SetVariantSelection(weather)
        with variants.GetVariantEditContext():
            over = stage.OverridePrim("/Town/Materials/asphalt")
            over.CreateAttribute("mmw:radio:itu", Sdf.ValueTypeNames.Token).Set(row)
    variants.SetVariantSelection("sunny")
    stage.Save()
    return path


def write_scenario(folder: Path, frames: int = 5) -> Path:
    """Write a scenario stage as mmw composes it: a town, two cars that share a model, a van, and a roadside unit.

    cav_1 drives along x from (-10, 0), 1 m a frame; veh_002 turns on the spot at (10, 5); veh_003 stands at (20, -5).
    """
    write_town(folder / "town.usda")
    vehicle = Usd.Stage.CreateNew(str(folder / "sedan.usda"))
    UsdGeom.SetStageUpAxis(vehicle, "Z")
    UsdGeom.SetStageMetersPerUnit(vehicle, 1.0)
    root = UsdGeom.Xform.Define(vehicle, "/sedan").GetPrim()
    vehicle.SetDefaultPrim(root)
    Usd.ModelAPI(root).SetKind("component")
    label(root, "car")
    paint = add_material(vehicle, "/sedan/Materials/paint", "itu_metal", "steel")
    glass = add_material(vehicle, "/sedan/Materials/car_glass", "itu_glass", "clear_glass")
    add_box(vehicle, "/sedan/body", (4.5, 1.8, 1.0), (0, 0, 0.5), paint)
    add_box(vehicle, "/sedan/glass", (2.0, 1.6, 0.5), (0, 0, 1.25), glass)
    vehicle.Save()

    path = folder / "scenario.usda"
    stage = new_stage(path)
    stage.SetStartTimeCode(0)
    stage.SetEndTimeCode(frames - 1)
    stage.DefinePrim("/World/Town").GetReferences().AddReference("./town.usda")
    step = np.arange(frames, dtype=np.float64)
    still = np.ones((frames, 1))
    tracks = {
        "cav_1": ("cav", np.stack([-10 + step, 0 * step, 0 * step], axis=1), 0.0),
        "veh_002": ("vehicle", still * [10.0, 5.0, 0.0], 0.3 * step),
        "veh_003": ("vehicle", still * [20.0, -5.0, 0.0], 0.0),
    }
    for name, (role, positions, yaw) in tracks.items():
        prim = animate(stage, f"/World/Actors/{name}", positions, yaw).GetPrim()
        prim.CreateAttribute("mmw:actor:role", Sdf.ValueTypeNames.Token).Set(role)
        prim.CreateAttribute("mmw:actor:model", Sdf.ValueTypeNames.String).Set("sedan")
        prim.CreateAttribute("mmw:actor:size", Sdf.ValueTypeNames.Float3).Set(Gf.Vec3f(4.5, 1.8, 1.5))
        prim.CreateAttribute("mmw:actor:center", Sdf.ValueTypeNames.Float3).Set(Gf.Vec3f(0.1, 0.0, 0.75))
        model = stage.DefinePrim(f"/World/Actors/{name}/Model")
        model.GetReferences().AddReference("./sedan.usda")
        model.SetInstanceable(True)
    rsu = UsdGeom.Xform.Define(stage, "/World/RSU/rsu_1")
    rsu.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(1.0, 2.0, 6.0))
    rsu.GetPrim().CreateAttribute("mmw:actor:role", Sdf.ValueTypeNames.Token).Set("rsu")
    stage.Save()
    return path
