"""Parked cars in USD: actors that never move, each an instance of a shipped vehicle like those that do."""

import os
from collections.abc import Mapping, Sequence
from pathlib import Path

from pxr import Gf, Kind, Sdf

from mmw.town.parking import ParkedCar
from mmw.usd.semantics import TAXONOMY
from mmw.vehicles.catalog import VehicleModel


def write_parked(
    layer: Sdf.Layer, group: Sdf.Path, cars: Sequence[ParkedCar], catalog: Mapping[str, VehicleModel], folder: Path
) -> None:
    """Write one Xform a car, with `mmw:actor:*` attributes, over an instance of its vehicle asset.

    Args:
        layer: Layer that receives the prims; the parent of `group` exists in it.
        group: Prim path of the group.
        cars: The cars; their names become prim names.
        catalog: Model name -> model.
        folder: Folder in which the layer will lie; the references are relative to it.
    """
    _define(layer, group, Kind.Tokens.group)
    types = Sdf.ValueTypeNames
    for car in cars:
        model, path = catalog[car.model], group.AppendChild(car.name)
        prim = _define(layer, path, Kind.Tokens.group)
        x, y, z, qx, qy, qz, qw = car.pose.tolist()
        _set(prim, "xformOp:translate", types.Double3, Gf.Vec3d(x, y, z), custom=False)
        # Double: USD takes the arc cosine of w, and in float that is off by up to 3e-4 rad for small turns.
        _set(prim, "xformOp:orient", types.Quatd, Gf.Quatd(qw, qx, qy, qz), custom=False)
        order = Sdf.AttributeSpec(prim, "xformOpOrder", types.TokenArray, Sdf.VariabilityUniform)
        order.default = ["xformOp:translate", "xformOp:orient"]
        _set(prim, "mmw:actor:role", types.Token, "vehicle")
        _set(prim, "mmw:actor:model", types.String, model.name)
        _set(prim, "mmw:actor:size", types.Float3, Gf.Vec3f(model.length, model.width, model.height))
        _set(prim, "mmw:actor:center", types.Float3, Gf.Vec3f(*model.center))
        prim.SetInfo("apiSchemas", Sdf.TokenListOp.Create(prependedItems=[f"SemanticsLabelsAPI:{TAXONOMY}"]))
        _set(prim, f"semantics:labels:{TAXONOMY}", types.TokenArray, [model.label], custom=False)
        body = _define(layer, path.AppendChild("Model"))
        body.referenceList.Prepend(Sdf.Reference(Path(os.path.relpath(model.asset, folder)).as_posix()))
        body.variantSelections["paint"] = car.paint
        body.instanceable = True


def _define(layer: Sdf.Layer, path: Sdf.Path, kind: str = "") -> Sdf.PrimSpec:
    spec = Sdf.CreatePrimInLayer(layer, path)
    spec.specifier, spec.typeName = Sdf.SpecifierDef, "Xform"
    if kind:
        spec.kind = kind
    return spec


def _set(spec: Sdf.PrimSpec, name: str, type_name: Sdf.ValueTypeName, value: object, custom: bool = True) -> None:
    Sdf.AttributeSpec(spec, name, type_name, Sdf.VariabilityVarying, custom).default = value
