"""Read curves of purpose `guide`: lanes and sidewalks are linear BasisCurves with an attribute of their own."""

from collections.abc import Iterator

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from mmw.usd.meshes import to_metres
from mmw.usd.prim_specs import new_prim, set_value


def define_guides(stage: Usd.Stage, path: str) -> None:
    """Write a scope of purpose `guide`."""
    UsdGeom.Imageable(UsdGeom.Scope.Define(stage, path)).CreatePurposeAttr(UsdGeom.Tokens.guide)


def write_curve(layer: Sdf.Layer, path: str, points: np.ndarray) -> Sdf.PrimSpec:
    """Write a linear curve through points [m], shape [N, 3], and return its prim for further attributes."""
    spec, types = new_prim(layer, Sdf.Path(path), "BasisCurves"), Sdf.ValueTypeNames
    points = np.ascontiguousarray(points, dtype=np.float32)
    extent = np.stack([points.min(axis=0), points.max(axis=0)])
    set_value(spec, "type", types.Token, "linear", uniform=True)
    set_value(spec, "curveVertexCounts", types.IntArray, Vt.IntArray([len(points)]))
    set_value(spec, "points", types.Point3fArray, Vt.Vec3fArray.FromNumpy(points))
    set_value(spec, "extent", types.Float3Array, Vt.Vec3fArray.FromNumpy(extent))
    return spec


def read_curves(root: Usd.Prim, marker: str) -> Iterator[tuple[Usd.Prim, np.ndarray]]:
    """Yield the curves at or below a prim that have an attribute, and their points [m] with z up, shape [N, 3]."""
    transforms, metres = UsdGeom.XformCache(), to_metres(root.GetStage())
    for prim in Usd.PrimRange(root):
        if prim.IsA(UsdGeom.BasisCurves) and prim.HasAttribute(marker):
            matrix = np.array(transforms.GetLocalToWorldTransform(prim), dtype=np.float64) @ metres
            points = np.array(UsdGeom.BasisCurves(prim).GetPointsAttr().Get() or [], dtype=np.float64).reshape(-1, 3)
            yield prim, points @ matrix[:3, :3] + matrix[3, :3]
