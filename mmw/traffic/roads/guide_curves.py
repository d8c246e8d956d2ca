"""Read curves of purpose `guide`: lanes and sidewalks are linear BasisCurves with an attribute of their own."""

from collections.abc import Iterator

import numpy as np
from pxr import Usd, UsdGeom

from mmw.usd.meshes import to_metres


def define_guides(stage: Usd.Stage, path: str) -> None:
    """Write a scope of purpose `guide`."""
    UsdGeom.Imageable(UsdGeom.Scope.Define(stage, path)).CreatePurposeAttr(UsdGeom.Tokens.guide)


def read_curves(root: Usd.Prim, marker: str) -> Iterator[tuple[Usd.Prim, np.ndarray]]:
    """Yield the curves at or below a prim that have an attribute, and their points [m] with z up, shape [N, 3]."""
    transforms, metres = UsdGeom.XformCache(), to_metres(root.GetStage())
    for prim in Usd.PrimRange(root):
        if prim.IsA(UsdGeom.BasisCurves) and prim.HasAttribute(marker):
            matrix = np.array(transforms.GetLocalToWorldTransform(prim), dtype=np.float64) @ metres
            points = np.array(UsdGeom.BasisCurves(prim).GetPointsAttr().Get() or [], dtype=np.float64).reshape(-1, 3)
            yield prim, points @ matrix[:3, :3] + matrix[3, :3]
