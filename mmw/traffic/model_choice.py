"""Draw the models and paints of vehicles."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mmw.core.errors import InputError
from mmw.traffic.vehicle_pose import Shape

CAV_MAX_HEIGHT = 2.2
"""CAVs carry their LiDAR 2.5 m above the ground, so they are lower than this where such models exist [m]."""

MODEL_WEIGHT: Mapping[str, float] = {
    "sedan": 0.30,
    "hatchback": 0.24,
    "suv": 0.20,
    "pickup": 0.10,
    "van": 0.09,
    "box_truck": 0.05,
    "city_bus": 0.02,
}
"""Share of the models in traffic; a model that is not named here has `OTHER_WEIGHT`."""

OTHER_WEIGHT = 0.1


def of_model(shapes: Sequence[Shape], name: str) -> list[Shape]:
    """Return the shape of a model.

    Raises:
        InputError: If there is no such model.
    """
    found = [shape for shape in shapes if shape.name == name]
    if not found:
        known = ", ".join(sorted(shape.name for shape in shapes))
        raise InputError(f"traffic.cav_models: there is no model {name!r}; there are {known}; name one of them")
    return found


def draw_paint(model: Any, generator: np.random.Generator) -> str:
    """Return one of the paints of a model."""
    return model.paints[int(generator.integers(len(model.paints)))]


def draw_models(shapes: Sequence[Shape], is_cav: bool, generator: np.random.Generator) -> list[Shape]:
    """Return the models in the order in which a vehicle tries them, drawn by weight without replacement.

    Vehicles that carry sensors try low models before high ones.
    """
    weight = np.array([MODEL_WEIGHT.get(shape.name, OTHER_WEIGHT) for shape in shapes])
    order = np.argsort(-np.log(generator.random(len(shapes))) / weight, kind="stable")  # exponential races
    drawn = [shapes[index] for index in order]
    if is_cav:
        drawn.sort(key=lambda shape: shape.height > CAV_MAX_HEIGHT)
    return drawn
