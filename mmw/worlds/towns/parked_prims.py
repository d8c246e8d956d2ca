"""Parked cars in USD: actors that never move, each an instance of a shipped vehicle like those that do."""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pxr import Kind, Sdf

from mmw.usd.prim_specs import new_prim, set_pose
from mmw.usd.vehicle_catalog import VehicleModel
from mmw.worlds.vehicles.actor_prims import describe_actor


@dataclass(frozen=True)
class ParkedCar:
    """One car that never moves."""

    name: str
    model: str
    """A key of the vehicle catalog."""
    paint: str
    pose: np.ndarray
    """Body to town frame, origin on the ground midway between the axles, shape [7]."""


def write_parked(
    layer: Sdf.Layer, group: Sdf.Path, cars: Sequence[ParkedCar], catalog: Mapping[str, VehicleModel], folder: Path
) -> None:
    """Write one Xform a car, with `mmw:actor:*` attributes, over an instance of its vehicle asset."""
    new_prim(layer, group, "Xform", Kind.Tokens.group)
    for car in cars:
        model = catalog[car.model]
        prim = new_prim(layer, group.AppendChild(car.name), "Xform", Kind.Tokens.group)
        set_pose(prim, car.pose)
        describe_actor(prim, "vehicle", model, Path(os.path.relpath(model.asset, folder)).as_posix(), car.paint)
