"""Build the USD assets of the vehicle models: geometry payload and interface layer with paint variants."""

from pathlib import Path

import numpy as np
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, Vt

from mmw.paths import assets_dir
from mmw.usd.semantics import TAXONOMY
from mmw.vehicles.body import build_skin
from mmw.vehicles.models import BLUEPRINTS, Block, Blueprint
from mmw.vehicles.shapes import Shape, box, corner_normals, join, wheel

PART_MATERIAL = {
    "body": "car_paint_<paint>", "glass": "car_glass", "rubber": "car_rubber", "lights_front": "car_light_front",
    "lights_rear": "car_light_rear", "trim": "car_trim", "plates": "sign_face",
}  # fmt: skip
"""Mesh of a vehicle -> material of the library."""

MATERIALS_ASSET = "../../materials/materials.usda"
"""The material library, seen from a vehicle's folder."""


def build_shape(model: str) -> Shape:
    """Return the whole model in the body frame, faces named after the mesh they go to.

    Args:
        model: A key of `BLUEPRINTS`.

    Raises:
        ValueError: If there is no such model.
    """
    if model not in BLUEPRINTS:
        raise ValueError(f"vehicle model = {model!r}; needed is one of {', '.join(BLUEPRINTS)}; name one of them")
    blueprint = BLUEPRINTS[model]
    shapes = [build_skin(body) for body in blueprint.bodies]
    for block in blueprint.blocks:
        shapes += _block(block)
    return join(shapes + _wheels(blueprint))


def _block(block: Block) -> list[Shape]:
    one = box(block.low, block.high, block.part, block.bevel)
    return [one, one.mirrored()] if block.mirror else [one]


def _wheels(blueprint: Blueprint) -> list[Shape]:
    wheels = blueprint.wheels
    front = wheel(wheels.radius, wheels.width, wheels.rim, wheels.spokes)
    rear = wheel(wheels.radius, wheels.rear_width or wheels.width, wheels.rim, wheels.spokes)
    inward = ((wheels.rear_width or wheels.width) - wheels.width) / 2
    left = [
        front.moved((blueprint.wheelbase / 2, wheels.track / 2, wheels.radius)),
        rear.moved((-blueprint.wheelbase / 2, wheels.track / 2 - inward, wheels.radius)),
    ]
    return left + [one.mirrored() for one in left]


def build_vehicle(model: str, out_dir: str | Path) -> Path:
    """Write the asset of one model, `<model>.usda` and `geometry.usdc`; the same model gives the same bytes.

    Args:
        model: A key of `BLUEPRINTS`.
        out_dir: Folder to write into, `assets/usd/vehicles/<model>` for the shipped one.

    Returns:
        Path of the interface layer.

    Raises:
        ValueError: If there is no such model.
    """
    shape = build_shape(model)
    folder = Path(out_dir)
    folder.mkdir(parents=True, exist_ok=True)
    geometry = _geometry_stage(model, shape)  # the stage keeps its layer alive
    geometry.GetRootLayer().Export(str(folder / "geometry.usdc"))
    path = folder / f"{model}.usda"
    _interface_layer(model, shape).Export(str(path))
    return path


def build_vehicles(out_dir: str | Path) -> list[Path]:
    """Write the assets of all models, one folder each below `out_dir`, and return their interface layers."""
    return [build_vehicle(model, Path(out_dir) / model) for model in BLUEPRINTS]


def _geometry_stage(model: str, shape: Shape) -> Usd.Stage:
    """Return the payload: one Mesh a part, with a normal at every face corner.

    Numbers are rounded to the micrometre, so that the last bit of a platform's cosine does not show in the file.
    """
    stage = Usd.Stage.CreateInMemory("geometry.usdc")
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, f"/{model}").GetPrim())
    normals = np.round(corner_normals(shape.points, shape.faces), 6) + 0.0
    for part in PART_MATERIAL:
        chosen = shape.parts == part
        if not chosen.any():
            continue
        used, faces = np.unique(shape.faces[chosen], return_inverse=True)
        points = (np.round(shape.points[used], 6) + 0.0).astype(np.float32)
        mesh = UsdGeom.Mesh.Define(stage, f"/{model}/{part}")
        mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
        mesh.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(np.full(chosen.sum(), 3, dtype=np.int32)))
        mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(faces.reshape(-1).astype(np.int32)))
        mesh.CreateNormalsAttr(Vt.Vec3fArray.FromNumpy(normals[chosen].reshape(-1, 3).astype(np.float32)))
        mesh.SetNormalsInterpolation(UsdGeom.Tokens.faceVarying)
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        mesh.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack([points.min(axis=0), points.max(axis=0)])))
    return stage


def _interface_layer(model: str, shape: Shape) -> Sdf.Layer:
    """Return the interface layer: payload, label, dimensions, material bindings and the paint variants.

    It is written spec by spec, not through a stage, because its relative paths resolve only once it is in its place.
    """
    blueprint = BLUEPRINTS[model]
    layer = Sdf.Layer.CreateAnonymous(f"{model}.usda")
    layer.pseudoRoot.SetInfo("upAxis", "Z")
    layer.pseudoRoot.SetInfo("metersPerUnit", 1.0)
    layer.defaultPrim = model
    root = Sdf.PrimSpec(layer, model, Sdf.SpecifierDef, "Xform")
    root.SetInfo("kind", Kind.Tokens.component)
    root.SetInfo("assetInfo", {"name": model})
    root.SetInfo("apiSchemas", Sdf.TokenListOp.Create([f"SemanticsLabelsAPI:{TAXONOMY}", "GeomModelAPI"]))
    root.payloadList.Prepend(Sdf.Payload("./geometry.usdc"))
    _author(root, f"semantics:labels:{TAXONOMY}", Sdf.ValueTypeNames.TokenArray, [blueprint.label], custom=False)
    extent = np.stack([shape.points.min(axis=0), shape.points.max(axis=0)]).astype(np.float32)
    _author(root, "extentsHint", Sdf.ValueTypeNames.Float3Array, Vt.Vec3fArray.FromNumpy(extent), custom=False)

    low, high = declared_box(blueprint, shape)
    numbers = {
        "wheelbase": blueprint.wheelbase, "track": blueprint.wheels.track, "wheelRadius": blueprint.wheels.radius,
        "length": blueprint.length, "width": blueprint.width, "height": blueprint.height,
    }  # fmt: skip
    for name, value in numbers.items():
        _author(root, f"mmw:vehicle:{name}", Sdf.ValueTypeNames.Float, value)
    _author(root, "mmw:vehicle:center", Sdf.ValueTypeNames.Float3, Gf.Vec3f(*((low + high) / 2).tolist()))

    scope = Sdf.PrimSpec(root, "Materials", Sdf.SpecifierDef, "Scope")
    for part, material in PART_MATERIAL.items():
        if part != "body" and (shape.parts == part).any():
            _bind(root, scope, part, material)
    root.SetInfo("variantSetNames", Sdf.StringListOp.Create(["paint"]))
    root.variantSelections["paint"] = blueprint.paints[0]
    paints = Sdf.VariantSetSpec(root, "paint")
    for paint in blueprint.paints:
        variant = Sdf.VariantSpec(paints, paint).primSpec
        _bind(variant, _child(variant, "Materials"), "body", PART_MATERIAL["body"].replace("<paint>", paint))
    return layer


def _child(parent: Sdf.PrimSpec, name: str) -> Sdf.PrimSpec:
    return Sdf.PrimSpec(parent, name, Sdf.SpecifierOver)


def _author(prim: Sdf.PrimSpec, name: str, kind: Sdf.ValueTypeName, value: object, custom: bool = True) -> None:
    variability = Sdf.VariabilityVarying
    attribute = Sdf.AttributeSpec(prim, name, kind, variability, custom)
    attribute.default = value


def _bind(root: Sdf.PrimSpec, scope: Sdf.PrimSpec, part: str, material: str) -> None:
    """Reference one material of the library below `scope` and bind it to one mesh of the vehicle."""
    _child(scope, material).referenceList.Prepend(Sdf.Reference(MATERIALS_ASSET, f"/Materials/{material}"))
    mesh = _child(root, part)
    mesh.SetInfo("apiSchemas", Sdf.TokenListOp.Create(["MaterialBindingAPI"]))
    binding = Sdf.RelationshipSpec(mesh, "material:binding", custom=False)
    binding.targetPathList.explicitItems = [f"/{root.path.GetPrimPath().name}/Materials/{material}"]


def declared_box(blueprint: Blueprint, shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of the model's box, which leaves the mirrors out, in the body frame [m], shape [3] each."""
    middle = (shape.points[:, 0].min() + shape.points[:, 0].max()) / 2
    half = np.array([blueprint.length, blueprint.width]) / 2
    return np.array([middle - half[0], -half[1], 0.0]), np.array([middle + half[0], half[1], blueprint.height])


if __name__ == "__main__":
    print(*build_vehicles(assets_dir() / "vehicles"), sep="\n")
