"""The USD asset of a vehicle or a figure: a geometry payload below an interface layer with paint variants."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Gf, Kind, Sdf, Usd, UsdGeom, Vt

from mmw.usd.prim_specs import apply_api, set_label, set_value
from mmw.usd.wheels import WHEEL_CENTER, WHEEL_FAMILY, WHEEL_RADIUS
from mmw.worlds.vehicles.primitives import Shape, corner_normals

MATERIALS_ASSET = "../../materials/materials.usda"
"""The material library, seen from an asset's folder."""


@dataclass(frozen=True)
class WheelSpec:
    """One wheel of a vehicle."""

    name: str
    """Name of its GeomSubset in every mesh that has faces of it."""
    center: Sequence[float]
    """Center in the body frame [m], shape [3]."""
    radius: float
    """Radius of the tyre [m]."""
    faces: range
    """Its faces in the shape."""


@dataclass(frozen=True)
class AssetSpec:
    """Metadata of an asset."""

    label: str
    """Semantic class."""
    materials: Mapping[str, str]
    """Part of the shape -> material of the library; `<paint>` in it is replaced by the variant's name."""
    paints: Sequence[str]
    """Variants; the first is selected."""
    prefix: str
    """Prefix of the dimensions, such as `mmw:vehicle:`."""
    dimensions: Mapping[str, float]
    """Name -> length [m]; length, width and height of the box are needed."""
    center: Sequence[float]
    """Middle of the box in the body frame [m], shape [3]."""
    wheels: Sequence[WheelSpec] = ()
    """Wheels of a vehicle; none for a figure."""


def write_asset(name: str, shape: Shape, spec: AssetSpec, out_dir: str | Path) -> Path:
    """Write `<name>.usda` and `geometry.usdc`, return the path of the first; the same input gives the same bytes."""
    folder = Path(out_dir)
    folder.mkdir(parents=True, exist_ok=True)
    geometry = _geometry_stage(name, shape, spec)  # the stage keeps its layer alive
    geometry.GetRootLayer().Export(str(folder / "geometry.usdc"))
    path = folder / f"{name}.usda"
    _interface_layer(name, shape, spec).Export(str(path))
    return path


def _geometry_stage(model: str, shape: Shape, spec: AssetSpec) -> Usd.Stage:
    """Return the payload: one Mesh a part, with a normal at every face corner.

    Numbers are rounded to the micrometer, so that the last bit of a platform's cosine does not show in the file.
    """
    stage = Usd.Stage.CreateInMemory("geometry.usdc")
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, f"/{model}").GetPrim())
    normals = np.round(corner_normals(shape), 6) + 0.0
    for part in spec.materials:
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
        _write_coordinates(mesh, shape.coordinates()[chosen].reshape(-1, 2))
        mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
        mesh.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack([points.min(axis=0), points.max(axis=0)])))
        for wheel in spec.wheels:
            _write_wheel(mesh, wheel, np.flatnonzero(chosen))
    return stage


def _write_coordinates(mesh: UsdGeom.Mesh, st: np.ndarray) -> None:
    """Write the texture coordinates of all face corners, shape [C, 2], unless all are zero."""
    if not st.any():
        return
    kind = Sdf.ValueTypeNames.TexCoord2fArray
    variable = UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("st", kind, UsdGeom.Tokens.faceVarying)
    values, indices = np.unique(np.round(st, 6) + 0.0, axis=0, return_inverse=True)
    variable.Set(Vt.Vec2fArray.FromNumpy(values.astype(np.float32)))
    variable.SetIndices(Vt.IntArray.FromNumpy(indices.reshape(-1).astype(np.int32)))


def _write_wheel(mesh: UsdGeom.Mesh, wheel: WheelSpec, faces: np.ndarray) -> None:
    """Write the GeomSubset of a wheel in a mesh of some faces of the shape, unless none of them is the wheel's."""
    inside = np.flatnonzero((faces >= wheel.faces.start) & (faces < wheel.faces.stop))
    if len(inside) == 0:
        return
    indices = Vt.IntArray.FromNumpy(inside.astype(np.int32))
    subset = UsdGeom.Subset.CreateGeomSubset(mesh, wheel.name, UsdGeom.Tokens.face, indices, WHEEL_FAMILY)
    UsdGeom.Subset.SetFamilyType(mesh, WHEEL_FAMILY, UsdGeom.Tokens.nonOverlapping)
    prim = subset.GetPrim()
    prim.CreateAttribute(WHEEL_CENTER, Sdf.ValueTypeNames.Float3).Set(Gf.Vec3f(*map(float, wheel.center)))
    prim.CreateAttribute(WHEEL_RADIUS, Sdf.ValueTypeNames.Float).Set(wheel.radius)


def _interface_layer(model: str, shape: Shape, spec: AssetSpec) -> Sdf.Layer:
    """Return the interface layer: payload, label, dimensions, material bindings and the paint variants.

    It is written spec by spec, not through a stage, because its relative paths resolve only once it is in its place.
    """
    layer = Sdf.Layer.CreateAnonymous(f"{model}.usda")
    layer.pseudoRoot.SetInfo("upAxis", "Z")
    layer.pseudoRoot.SetInfo("metersPerUnit", 1.0)
    layer.defaultPrim = model
    root = Sdf.PrimSpec(layer, model, Sdf.SpecifierDef, "Xform")
    root.SetInfo("kind", Kind.Tokens.component)
    root.SetInfo("assetInfo", {"name": model})
    set_label(root, spec.label)
    apply_api(root, "GeomModelAPI")
    root.payloadList.Prepend(Sdf.Payload("./geometry.usdc"))
    extent = np.stack([shape.points.min(axis=0), shape.points.max(axis=0)]).astype(np.float32)
    set_value(root, "extentsHint", Sdf.ValueTypeNames.Float3Array, Vt.Vec3fArray.FromNumpy(extent))

    for name, value in spec.dimensions.items():
        set_value(root, f"{spec.prefix}{name}", Sdf.ValueTypeNames.Float, value)
    set_value(root, f"{spec.prefix}center", Sdf.ValueTypeNames.Float3, Gf.Vec3f(*map(float, spec.center)))

    scope = Sdf.PrimSpec(root, "Materials", Sdf.SpecifierDef, "Scope")
    for part, material in spec.materials.items():
        if "<paint>" not in material and (shape.parts == part).any():
            _bind(root, scope, part, material)
    root.SetInfo("variantSetNames", Sdf.StringListOp.Create(["paint"]))
    root.variantSelections["paint"] = spec.paints[0]
    paints = Sdf.VariantSetSpec(root, "paint")
    for paint in spec.paints:
        variant = Sdf.VariantSpec(paints, paint).primSpec
        for part, material in spec.materials.items():
            if "<paint>" in material:
                _bind(variant, _child(variant, "Materials"), part, material.replace("<paint>", paint))
    return layer


def _child(parent: Sdf.PrimSpec, name: str) -> Sdf.PrimSpec:
    return Sdf.PrimSpec(parent, name, Sdf.SpecifierOver)


def _bind(root: Sdf.PrimSpec, scope: Sdf.PrimSpec, part: str, material: str) -> None:
    """Add a reference to one material of the library below `scope` and bind it to one mesh of the vehicle."""
    if material not in scope.nameChildren:  # two parts may share one
        _child(scope, material).referenceList.Prepend(Sdf.Reference(MATERIALS_ASSET, f"/Materials/{material}"))
    mesh = _child(root, part)
    apply_api(mesh, "MaterialBindingAPI")
    binding = Sdf.RelationshipSpec(mesh, "material:binding", custom=False)
    binding.targetPathList.explicitItems = [f"/{root.path.GetPrimPath().name}/Materials/{material}"]
