"""Write and read sidewalks in USD: the lines that people walk along."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from pxr import Sdf, Usd

from mmw.traffic.roads.guide_curves import define_guides, read_curves, write_curve
from mmw.usd.prim_specs import set_value

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
    layer = stage.GetEditTarget().GetLayer()
    for sidewalk in sidewalks:
        spec = write_curve(layer, f"{path}/{sidewalk.name}", sidewalk.points)
        set_value(spec, CLOSED, Sdf.ValueTypeNames.Bool, sidewalk.is_closed)


def read_sidewalks(stage: Usd.Stage, root_path: str) -> list[Sidewalk]:
    """Return the sidewalks below a prim in meters with z up, sorted by name; none if the prim does not exist."""
    root = stage.GetPrimAtPath(root_path)
    found = read_curves(root, CLOSED) if root else ()
    sidewalks = [Sidewalk(prim.GetName(), points, bool(prim.GetAttribute(CLOSED).Get())) for prim, points in found]
    return sorted(sidewalks, key=lambda sidewalk: sidewalk.name)
