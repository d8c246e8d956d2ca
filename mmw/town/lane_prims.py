"""Lanes in USD: one BasisCurves prim a lane, so that a stage alone is enough to drive on."""

import numpy as np
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

from mmw.town.lanes import Lane, LaneGraph
from mmw.usd.extract import to_metres

WIDTH = "mmw:lane:width"
SPEED = "mmw:lane:speed"
JUNCTION = "mmw:lane:junction"
PRIORITY = "mmw:lane:priority"
SUCCESSORS = "mmw:lane:successors"
LEFT = "mmw:lane:left"
RIGHT = "mmw:lane:right"
SIGNAL = "mmw:lane:signal"
STOP = "mmw:lane:stop"


def write_lanes(stage: Usd.Stage, path: str, graph: LaneGraph) -> None:
    """Write every lane as a linear curve of purpose `guide`, sorted by name.

    Args:
        stage: Stage whose edit target receives the prims.
        path: Prim path of the group, such as `/Town/Lanes`.
        graph: Lanes; their names must be identifiers.

    Raises:
        ValueError: If a lane's name cannot be a prim name.
    """
    group = UsdGeom.Scope.Define(stage, path)
    UsdGeom.Imageable(group).CreatePurposeAttr(UsdGeom.Tokens.guide)
    with Sdf.ChangeBlock():
        layer = stage.GetEditTarget().GetLayer()
        for name in sorted(graph.lanes):
            if not Sdf.Path.IsValidIdentifier(name):
                raise ValueError(f"lane {name!r}: not a prim name; letters, digits and _ are needed; rename its road")
            _write_lane(layer, f"{path}/{name}", graph.lanes[name])


def _write_lane(layer: Sdf.Layer, path: str, lane: Lane) -> None:
    spec = Sdf.CreatePrimInLayer(layer, path)
    spec.specifier, spec.typeName = Sdf.SpecifierDef, "BasisCurves"
    points = np.ascontiguousarray(lane.points, dtype=np.float32)
    low, high = points.min(axis=0), points.max(axis=0)
    types, uniform = Sdf.ValueTypeNames, Sdf.VariabilityUniform
    for name, kind, value, variability in (
        ("type", types.Token, "linear", uniform),
        ("curveVertexCounts", types.IntArray, Vt.IntArray([len(points)]), Sdf.VariabilityVarying),
        ("points", types.Point3fArray, Vt.Vec3fArray.FromNumpy(points), Sdf.VariabilityVarying),
        ("extent", types.Float3Array, Vt.Vec3fArray([Gf.Vec3f(*low.tolist()), Gf.Vec3f(*high.tolist())]), None),
        (WIDTH, types.Float, lane.width, None),
        (SPEED, types.Float, lane.speed, None),
        (JUNCTION, types.String, lane.junction, None),
        (PRIORITY, types.Int, lane.priority, None),
        (SUCCESSORS, types.StringArray, Vt.StringArray(lane.successors), None),
        (LEFT, types.String, lane.left, None),
        (RIGHT, types.String, lane.right, None),
        (SIGNAL, types.String, lane.signal, None),
        (STOP, types.Float, lane.stop, None),
    ):
        is_custom = name.startswith("mmw:")
        attribute = Sdf.AttributeSpec(spec, name, kind, variability or Sdf.VariabilityVarying, is_custom)
        attribute.default = value


def read_lanes(stage: Usd.Stage, root_path: str) -> LaneGraph:
    """Return the lanes at or below a prim, in metres with z up, whatever the axes and units of the stage.

    Args:
        stage: A town, or a scenario that references one.
        root_path: Where to look, such as `/Town/Lanes` or `/World/Town`.

    Raises:
        ValueError: If the prim does not exist, holds no lane, or a lane lacks an attribute or its points.
    """
    root = stage.GetPrimAtPath(root_path)
    where = stage.GetRootLayer().identifier
    if not root:
        raise ValueError(f"{where}: no prim {root_path}; the lanes of a town are needed there; give the right path")
    transforms, metres = UsdGeom.XformCache(), to_metres(stage)
    lanes = {}
    for prim in Usd.PrimRange(root):
        if not prim.IsA(UsdGeom.BasisCurves) or not prim.HasAttribute(WIDTH):
            continue
        values = {name: prim.GetAttribute(name).Get() for name in (WIDTH, SPEED, JUNCTION, PRIORITY, SUCCESSORS)}
        missing = [name for name, value in values.items() if value is None]
        points = UsdGeom.BasisCurves(prim).GetPointsAttr().Get()
        if missing or points is None or len(points) < 2:
            found = f"no {', '.join(missing)}" if missing else "fewer than two points"
            raise ValueError(f"{where}: lane {prim.GetPath()} has {found}; all are needed; write it with write_lanes")
        matrix = np.array(transforms.GetLocalToWorldTransform(prim), dtype=np.float64)
        matrix = matrix @ metres
        xyz = np.array(points, dtype=np.float64) @ matrix[:3, :3] + matrix[3, :3]
        lanes[prim.GetName()] = Lane(
            prim.GetName(),
            xyz,
            float(values[WIDTH]),
            float(values[SPEED]),
            values[JUNCTION],
            int(values[PRIORITY]),
            tuple(values[SUCCESSORS]),
            *(prim.GetAttribute(name).Get() or "" for name in (LEFT, RIGHT, SIGNAL)),
            *([float(prim.GetAttribute(STOP).Get())] if prim.HasAttribute(STOP) else []),
        )
    if not lanes:
        raise ValueError(f"{where}: no lanes below {root_path}; rebuild the town with its lanes")
    return LaneGraph(lanes)
