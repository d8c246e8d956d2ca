"""Lanes in USD: one BasisCurves prim a lane, so that a stage alone is enough to drive on."""

from pxr import Sdf, Usd, UsdGeom, Vt

from mmw.core.errors import InputError
from mmw.traffic.roads.guide_curves import define_guides, read_curves, write_curve
from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.usd.prim_specs import set_value

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
    """Write every lane as a linear curve of purpose `guide` below a prim such as `/Town/Lanes`, sorted by name.

    Raises:
        InputError: If a lane's name cannot be a prim name.
    """
    define_guides(stage, path)
    with Sdf.ChangeBlock():
        layer = stage.GetEditTarget().GetLayer()
        for name in sorted(graph.lanes):
            if not Sdf.Path.IsValidIdentifier(name):
                raise InputError(f"lane {name!r}: not a prim name; letters, digits and _ are needed; rename its road")
            _write_lane(layer, f"{path}/{name}", graph.lanes[name])


def _write_lane(layer: Sdf.Layer, path: str, lane: Lane) -> None:
    spec, types = write_curve(layer, path, lane.points), Sdf.ValueTypeNames
    set_value(spec, WIDTH, types.Float, lane.width)
    set_value(spec, SPEED, types.Float, lane.speed)
    set_value(spec, JUNCTION, types.String, lane.junction)
    set_value(spec, PRIORITY, types.Int, lane.priority)
    set_value(spec, SUCCESSORS, types.StringArray, Vt.StringArray(lane.successors))
    set_value(spec, LEFT, types.String, lane.left)
    set_value(spec, RIGHT, types.String, lane.right)
    set_value(spec, SIGNAL, types.String, lane.signal)
    set_value(spec, STOP, types.Float, lane.stop)


def has_lanes(stage: Usd.Stage) -> bool:
    """Return whether a stage has a lane anywhere."""
    return any(prim.IsA(UsdGeom.BasisCurves) and prim.HasAttribute(WIDTH) for prim in stage.Traverse())


def read_lanes(stage: Usd.Stage, root_path: str) -> LaneGraph:
    """Return the lanes at or below a prim, in meters with z up, whatever the axes and units of the stage.

    Raises:
        InputError: If the prim does not exist, holds no lane, or a lane lacks an attribute or its points.
    """
    root = stage.GetPrimAtPath(root_path)
    where = stage.GetRootLayer().identifier
    if not root:
        raise InputError(f"{where}: no prim {root_path}; the lanes of a town are needed there; give the right path")
    lanes = {}
    for prim, points in read_curves(root, WIDTH):
        values = {name: prim.GetAttribute(name).Get() for name in (WIDTH, SPEED, JUNCTION, PRIORITY, SUCCESSORS)}
        missing = [name for name, value in values.items() if value is None]
        if missing or len(points) < 2:
            found = f"no {', '.join(missing)}" if missing else "fewer than two points"
            raise InputError(f"{where}: lane {prim.GetPath()} has {found}; all are needed; write it with write_lanes")
        lanes[prim.GetName()] = Lane(
            prim.GetName(),
            points,
            float(values[WIDTH]),
            float(values[SPEED]),
            values[JUNCTION],
            int(values[PRIORITY]),
            tuple(values[SUCCESSORS]),
            *(prim.GetAttribute(name).Get() or "" for name in (LEFT, RIGHT, SIGNAL)),
            *([float(prim.GetAttribute(STOP).Get())] if prim.HasAttribute(STOP) else []),
        )
    if not lanes:
        raise InputError(f"{where}: no lanes below {root_path}; rebuild the town with its lanes")
    return LaneGraph(lanes)
