"""Add roadside units and base stations of the configuration to a user's own stage, by a small layer over it."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from pxr import Gf, Sdf, Usd

from mmw.core.errors import InputError
from mmw.core.transforms import pose_to_matrix
from mmw.scene.stage.layer import define
from mmw.usd.atomic_layers import save_layers
from mmw.usd.meshes import to_metres
from mmw.usd.open_stage import open_stage
from mmw.usd.prim_specs import set_op_order, set_value

ROOTS = {"rsu": "/RSU", "bs": "/BS"}
"""Role -> prim path of its units: beside the user's own root prims, so that no transform of theirs moves them."""

_COPIED = ("upAxis", "metersPerUnit", "startTimeCode", "endTimeCode", "defaultPrim")
"""Layer metadata that a stage reads from its strongest layer only."""


def overlay_units(path: str | Path, source: str | Path, units: Mapping[str, Sequence[tuple[str, np.ndarray]]]) -> Path:
    """Write a layer that adds roadside units and base stations to a stage, in the stage's own axes and units.

    Args:
        path: `.usda` file to write; one that is there is replaced.
        source: The user's stage; the layer refers to it by its absolute path.
        units: Role, `rsu` or `bs` -> names and poses in our world (z up, meters), shape [7].

    Returns:
        The layer's path.

    Raises:
        InputError: If the stage has a prim where a unit would go, or an up axis that is not known.
        OSError: If the file cannot be written.
    """
    path, source = Path(path).resolve(), Path(source).resolve()
    stage = open_stage(source, Usd.Stage.LoadNone)
    below = stage.GetRootLayer().pseudoRoot
    layer = Sdf.Layer.CreateAnonymous(path.name)
    for key in _COPIED:
        if below.HasInfo(key):
            layer.pseudoRoot.SetInfo(key, below.GetInfo(key))
    layer.timeCodesPerSecond = stage.GetTimeCodesPerSecond()  # the same rate, so that USD scales no time sample
    layer.framesPerSecond = stage.GetFramesPerSecond()
    layer.subLayerPaths.append(source.as_posix())
    metres = to_metres(stage)
    for role, root in ROOTS.items():
        if units.get(role):
            define(layer, root)
    for role, name, pose in ((role, *unit) for role, placed in units.items() for unit in placed):
        if stage.GetPrimAtPath(f"{ROOTS[role]}/{name}"):
            raise InputError(f"{source}: has a prim {ROOTS[role]}/{name} already; name the agent differently")
        # Row vectors; the unit's own axes stay x forward, y left, z up in meters once the reader has turned both sides.
        matrix = metres @ pose_to_matrix(pose).T @ np.linalg.inv(metres)
        prim = define(layer, f"{ROOTS[role]}/{name}", kind="component")
        kinds = Sdf.ValueTypeNames
        set_value(prim, "xformOp:transform", kinds.Matrix4d, Gf.Matrix4d(matrix.tolist()))
        set_op_order(prim, "!resetXformStack!", "xformOp:transform")
        set_value(prim, "mmw:actor:role", kinds.Token, role)
    save_layers({path: layer})
    return path
