"""Build the USD assets of vehicles, figures, the cyclist and the drone: `python -m mmw.worlds.vehicles.build`."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from mmw.core.errors import InputError
from mmw.core.resources import assets_dir
from mmw.worlds.vehicles import cyclist_model, drone_model
from mmw.worlds.vehicles.body_loft import build_skin
from mmw.worlds.vehicles.models import BLUEPRINTS, Block, Blueprint
from mmw.worlds.vehicles.pedestrian_models import FIGURES, build_figure
from mmw.worlds.vehicles.primitives import Shape, box, join, pod
from mmw.worlds.vehicles.surface_panels import build_panel
from mmw.worlds.vehicles.wheel import wheel
from mmw.worlds.vehicles.write_usd import AssetSpec, WheelSpec, write_asset

PART_MATERIAL = {
    "body": "car_paint_<paint>", "glass": "car_glass", "rubber": "car_rubber", "rims": "car_rim", "trim": "car_trim",
    "gloss": "car_gloss", "mirror": "car_mirror", "lights_front": "car_light_front", "lights_rear": "car_light_rear",
    "lights_brake": "car_light_brake", "lights_clear": "car_light_clear", "lights_amber": "car_light_amber",
    "plates": "car_plate", "lettering": "truck_lettering", "sign": "bus_sign",
}  # fmt: skip
"""Mesh of a vehicle -> material of the library."""

FIGURE_MATERIAL = {
    "shirt": "cloth_<paint>", "trousers": "<trousers>", "skin": "<skin>", "hair": "<hair>", "eyes": "hair",
    "lips": "lips", "rubber": "car_rubber",
}  # fmt: skip
"""Mesh of a figure -> material of the library, or the field of `Figure` that names it."""


def build_shape(model: str) -> Shape:
    """Return the whole model in the body frame, faces named after the mesh they go to.

    Raises:
        InputError: If there is no such model.
    """
    if model not in BLUEPRINTS:
        raise InputError(f"vehicle model = {model!r}; needed is one of {', '.join(BLUEPRINTS)}; name one of them")
    blueprint = BLUEPRINTS[model]
    shapes = [build_skin(body) for body in blueprint.bodies]
    for block in (block for block in blueprint.blocks if not block.is_pod):
        shapes += _block(block)
    for panel in blueprint.panels:
        shapes += _pair(build_panel(panel, join(shapes)), panel.mirror)
    for block in (block for block in blueprint.blocks if block.is_pod):
        shapes += _block(block)
    return join(shapes + [shape for shape, _, _ in _wheels(blueprint)])


def _block(block: Block) -> list[Shape]:
    if block.is_pod:
        return _pair(pod(block.low, block.high, block.part), block.mirror)
    return _pair(box(block.low, block.high, block.part, block.bevel), block.mirror)


def _pair(one: Shape, has_mirror_image: bool) -> list[Shape]:
    return [one, one.mirrored()] if has_mirror_image else [one]


def _wheels(blueprint: Blueprint) -> list[tuple[Shape, str, tuple[float, float, float]]]:
    """Return shape, name and center [m] of every wheel, all in the body frame."""
    wheels, found = blueprint.wheels, []
    for side, sign in (("left", 1.0), ("right", -1.0)):
        for axle, x, width in (("front", 0.5, wheels.width), ("rear", -0.5, wheels.rear_width or wheels.width)):
            inward = (width - wheels.width) / 2
            center = (x * blueprint.wheelbase, wheels.track / 2 - inward, wheels.radius)
            shape = wheel(wheels.radius, width, wheels.rim, wheels.spokes).moved(center)
            place = (center[0], sign * center[1], center[2])
            found.append((shape if sign > 0.0 else shape.mirrored(), f"wheel_{axle}_{side}", place))
    return found


def _wheel_specs(blueprint: Blueprint, face_count: int) -> list[WheelSpec]:
    """Return the wheels of a model of so many faces, of which the wheels are the last."""
    wheels = _wheels(blueprint)
    first = face_count - sum(len(shape.faces) for shape, _, _ in wheels)
    specs = []
    for shape, name, center in wheels:
        specs.append(WheelSpec(name, center, blueprint.wheels.radius, range(first, first + len(shape.faces))))
        first += len(shape.faces)
    return specs


def build_vehicle(model: str, out_dir: str | Path) -> Path:
    """Write the asset of one model, `<model>.usda` and `geometry.usdc`; the same model gives the same bytes.

    Raises:
        InputError: If there is no such model.
    """
    shape, blueprint = build_shape(model), BLUEPRINTS[model]
    low, high = declared_box(blueprint, shape)
    dimensions = {
        "wheelbase": blueprint.wheelbase, "track": blueprint.wheels.track, "wheelRadius": blueprint.wheels.radius,
        "length": blueprint.length, "width": blueprint.width, "height": blueprint.height,
    }  # fmt: skip
    center = ((low + high) / 2).tolist()
    wheels = _wheel_specs(blueprint, len(shape.faces))
    spec = AssetSpec(blueprint.label, PART_MATERIAL, blueprint.paints, "mmw:vehicle:", dimensions, center, wheels)
    return write_asset(model, shape, spec, out_dir)


def build_vehicles(out_dir: str | Path) -> list[Path]:
    """Write the assets of all models, one folder each below `out_dir`, and return their interface layers."""
    return [build_vehicle(model, Path(out_dir) / model) for model in BLUEPRINTS]


def build_figures(out_dir: str | Path) -> list[Path]:
    """Write the assets of all figures, one folder each below `out_dir`, and return their interface layers."""
    made = []
    for name, figure in FIGURES.items():
        own = {"<trousers>": figure.trousers, "<skin>": figure.skin, "<hair>": figure.hair}
        materials = {part: own.get(material, material) for part, material in FIGURE_MATERIAL.items()}
        spec = _spec("pedestrian", materials, figure.colors, "mmw:pedestrian:", shape := build_figure(name))
        made.append(write_asset(name, shape, spec, Path(out_dir) / name))
    return made


def build_drones(out_dir: str | Path) -> list[Path]:
    """Write the asset of the drone into a folder of its own below `out_dir`, and return its interface layer."""
    model = drone_model
    spec = _spec("dynamic", model.DRONE_MATERIAL, model.PAINTS, "mmw:drone:", shape := model.build_drone())
    return [write_asset(model.NAME, shape, spec, Path(out_dir) / model.NAME)]


def build_cyclists(out_dir: str | Path) -> list[Path]:
    """Write the asset of the cyclist into a folder of its own below `out_dir`, and return its interface layer."""
    model = cyclist_model
    spec = _spec("bicycle", model.CYCLIST_MATERIAL, model.PAINTS, "mmw:cyclist:", shape := model.build_cyclist())
    return [write_asset(model.NAME, shape, spec, Path(out_dir) / model.NAME)]


def _spec(label: str, materials: Mapping[str, str], paints: Sequence[str], prefix: str, shape: Shape) -> AssetSpec:
    """Return the metadata of a body without wheels, with the box of its shape."""
    low, high = shape.points.min(axis=0), shape.points.max(axis=0)
    dimensions = dict(zip(("length", "width", "height"), (high - low).tolist(), strict=True))
    return AssetSpec(label, materials, paints, prefix, dimensions, (0.5 * (low + high)).tolist())


def declared_box(blueprint: Blueprint, shape: Shape) -> tuple[np.ndarray, np.ndarray]:
    """Return the corners of the model's box, without the mirrors, in the body frame [m], shape [3] each."""
    middle = (shape.points[:, 0].min() + shape.points[:, 0].max()) / 2
    half = np.array([blueprint.length, blueprint.width]) / 2
    return np.array([middle - half[0], -half[1], 0.0]), np.array([middle + half[0], half[1], blueprint.height])


if __name__ == "__main__":
    print(*build_vehicles(assets_dir() / "vehicles"), sep="\n")
    print(*build_figures(assets_dir() / "pedestrians"), *build_drones(assets_dir() / "drones"), sep="\n")
    print(*build_cyclists(assets_dir() / "cyclists"), sep="\n")
