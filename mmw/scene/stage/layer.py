"""Write the layer of a scenario: its metadata, prims and animation."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from pxr import Gf, Sdf, UsdGeom

from mmw.core.errors import InputError
from mmw.core.transforms import continuous, normalize
from mmw.usd.prim_specs import new_prim, set_op_order, set_pose


def new_layer(name: str, meta: Mapping[str, Any], frame_rate: float, frame_count: int) -> Sdf.Layer:
    """Return an empty layer, z up, in meters, with a default prim and one time code a frame."""
    layer = Sdf.Layer.CreateAnonymous(name)
    root = layer.pseudoRoot
    root.SetInfo("upAxis", "Z")
    root.SetInfo("metersPerUnit", 1.0)
    layer.defaultPrim = "World"
    layer.timeCodesPerSecond = layer.framesPerSecond = frame_rate
    layer.startTimeCode, layer.endTimeCode = 0.0, float(frame_count - 1)
    layer.customLayerData = {key: _plain(value) for key, value in meta.items()}
    return layer


def define(layer: Sdf.Layer, path: str, type_name: str = "Xform", kind: str = "") -> Sdf.PrimSpec:
    """Return a new prim of a type.

    Raises:
        InputError: If the name cannot be a prim name, or is taken.
    """
    parent, name = path.rsplit("/", 1)
    if not Sdf.Path.IsValidIdentifier(name):
        raise InputError(f"{name!r} cannot be the name of a USD prim; letters, digits and _ are allowed; rename it")
    if layer.GetPrimAtPath(path):
        raise InputError(f"{name!r} is there twice below {parent or '/'}; prims need names of their own; rename one")
    return new_prim(layer, Sdf.Path(path), type_name, kind)


def place(prim: Sdf.PrimSpec, pose: np.ndarray) -> None:
    """Put a prim at a pose, shape [7], relative to its parent."""
    set_pose(prim, np.concatenate([pose[:3], normalize(pose[3:])]))


def animate(prim: Sdf.PrimSpec, poses: np.ndarray) -> None:
    """Move a prim along poses, one a time code from 0, shape [F, 7]; it is invisible where a pose is NaN.

    Positions stay float64. Neighboring quaternions have a positive product, so that viewers turn the short way.
    """
    is_there = np.all(np.isfinite(poses), axis=1)
    frames = np.flatnonzero(is_there)
    position = poses[is_there, :3].tolist()
    turn = continuous(normalize(poses[is_there, 3:])).tolist()
    double3, quatd = Sdf.ValueTypeNames.Double3, Sdf.ValueTypeNames.Quatd
    translate = Sdf.AttributeSpec(prim, "xformOp:translate", double3, declaresCustom=False).path
    orient = Sdf.AttributeSpec(prim, "xformOp:orient", quatd, declaresCustom=False).path
    layer = prim.layer
    for frame, (x, y, z), (qx, qy, qz, qw) in zip(frames.tolist(), position, turn, strict=True):
        layer.SetTimeSample(translate, frame, Gf.Vec3d(x, y, z))
        layer.SetTimeSample(orient, frame, Gf.Quatd(qw, qx, qy, qz))
    set_op_order(prim, "xformOp:translate", "xformOp:orient")
    if not is_there.all():
        token = Sdf.ValueTypeNames.Token
        visibility = Sdf.AttributeSpec(prim, "visibility", token, declaresCustom=False).path
        changes = np.flatnonzero(np.concatenate([[True], is_there[1:] != is_there[:-1]]))
        for frame in changes.tolist():
            state = UsdGeom.Tokens.inherited if is_there[frame] else UsdGeom.Tokens.invisible
            layer.SetTimeSample(visibility, frame, state)


def _plain(value: Any) -> Any:
    """Return a value as layer metadata can hold it: numbers and text as they are, anything else as text."""
    return value if isinstance(value, (bool, int, float, str)) else str(value)
