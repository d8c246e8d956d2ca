"""Walk lines in USD: where people go on the sidewalks."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from mmw.usd.meshes import to_metres

CLOSED = "mmw:walk:closed"


@dataclass(frozen=True)
class Walk:
    """One line that people follow, all in its direction."""

    name: str
    points: np.ndarray
    """On the sidewalk, town frame [m], shape [N, 3]; a closed line does not repeat its first point."""
    is_closed: bool


def write_walks(stage: Usd.Stage, path: str, walks: Sequence[Walk]) -> None:
    """Write every walk as a linear curve of purpose `guide`."""
    group = UsdGeom.Scope.Define(stage, path)
    UsdGeom.Imageable(group).CreatePurposeAttr(UsdGeom.Tokens.guide)
    for walk in walks:
        curve = UsdGeom.BasisCurves.Define(stage, f"{path}/{walk.name}")
        points = np.ascontiguousarray(walk.points, dtype=np.float32)
        curve.CreateTypeAttr(UsdGeom.Tokens.linear)
        curve.CreateCurveVertexCountsAttr([len(points)])
        curve.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
        curve.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack([points.min(axis=0), points.max(axis=0)])))
        curve.GetPrim().CreateAttribute(CLOSED, Sdf.ValueTypeNames.Bool).Set(walk.is_closed)


def read_walks(stage: Usd.Stage, root_path: str) -> list[Walk]:
    """Return the walks below a prim in metres with z up, sorted by name; none if the prim does not exist."""
    root = stage.GetPrimAtPath(root_path)
    if not root:
        return []
    transforms, metres = UsdGeom.XformCache(), to_metres(stage)
    walks = []
    for prim in Usd.PrimRange(root):
        if not prim.IsA(UsdGeom.BasisCurves) or not prim.HasAttribute(CLOSED):
            continue
        matrix = np.array(transforms.GetLocalToWorldTransform(prim), dtype=np.float64)
        points = np.array(UsdGeom.BasisCurves(prim).GetPointsAttr().Get(), dtype=np.float64)
        matrix = matrix @ metres
        xyz = points @ matrix[:3, :3] + matrix[3, :3]
        walks.append(Walk(prim.GetName(), xyz, bool(prim.GetAttribute(CLOSED).Get())))
    return sorted(walks, key=lambda walk: walk.name)
