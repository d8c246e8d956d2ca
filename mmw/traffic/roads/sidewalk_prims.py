"""Write and read sidewalks in USD: the lines that people walk along."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pxr import Sdf, Usd, UsdGeom, Vt

from mmw.traffic.roads.guide_curves import define_guides, read_curves

CLOSED = "mmw:walk:closed"


@dataclass(frozen=True)
class Sidewalk:
    """One line that people follow, all in its direction."""

    name: str
    points: np.ndarray
    """On the sidewalk, town frame [m], shape [N, 3]; a closed line does not repeat its first point."""
    is_closed: bool


def write_sidewalks(stage: Usd.Stage, path: str, sidewalks: Sequence[Sidewalk]) -> None:
    """Write every sidewalk as a linear curve of purpose `guide`."""
    define_guides(stage, path)
    for sidewalk in sidewalks:
        curve = UsdGeom.BasisCurves.Define(stage, f"{path}/{sidewalk.name}")
        points = np.ascontiguousarray(sidewalk.points, dtype=np.float32)
        curve.CreateTypeAttr(UsdGeom.Tokens.linear)
        curve.CreateCurveVertexCountsAttr([len(points)])
        curve.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
        curve.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(np.stack([points.min(axis=0), points.max(axis=0)])))
        curve.GetPrim().CreateAttribute(CLOSED, Sdf.ValueTypeNames.Bool).Set(sidewalk.is_closed)


def read_sidewalks(stage: Usd.Stage, root_path: str) -> list[Sidewalk]:
    """Return the sidewalks below a prim in metres with z up, sorted by name; none if the prim does not exist."""
    root = stage.GetPrimAtPath(root_path)
    found = read_curves(root, CLOSED) if root else ()
    sidewalks = [Sidewalk(prim.GetName(), points, bool(prim.GetAttribute(CLOSED).Get())) for prim, points in found]
    return sorted(sidewalks, key=lambda sidewalk: sidewalk.name)
