"""The models of vehicles and people that traffic may use: dimensions and paints, read from the USD assets."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pxr import Usd

from mmw.core.errors import InputError
from mmw.core.resources import assets_dir
from mmw.usd.prim_values import attribute_value
from mmw.usd.semantics import TAXONOMY


@dataclass(frozen=True)
class ActorModel:
    """One asset that moves, without its geometry.

    Body frame: x forward, y left, z up, origin on the ground, or in the middle of a drone.
    """

    name: str
    """Name of the asset and of its root prim."""
    asset: Path
    """Absolute path of the interface layer."""
    label: str
    """Semantic class, a key of `mmw.usd.semantics.CARLA_TAG`."""
    paints: tuple[str, ...]
    """Variants of the set `paint`; the asset's own selection first."""
    length: float
    """Length of the box [m]."""
    width: float
    """Width of the box, which leaves the mirrors out [m]."""
    height: float
    """Height of the box [m]."""
    center: tuple[float, float, float]
    """Center of the box in the body frame [m]."""


@dataclass(frozen=True)
class VehicleModel(ActorModel):
    """A vehicle; its origin lies midway between the axles."""

    wheelbase: float
    """Distance between the axles [m]."""
    track: float
    """Distance between the middles of the left and the right tyres [m]."""
    wheel_radius: float
    """Tyre radius [m]."""


def load_catalog(directory: str | Path | None = None) -> dict[str, VehicleModel]:
    """Read every vehicle asset `<name>/<name>.usda` of a folder, the shipped ones when left out, sorted by name.

    Raises:
        InputError: If the folder holds no vehicle, or an asset lacks its label, its paints or one of its dimensions.
    """
    folder = assets_dir() / "vehicles" if directory is None else Path(directory)
    own = {"wheelbase": "wheelbase", "track": "track", "wheel_radius": "wheelRadius"}
    return {path.stem: VehicleModel(**_read_model(path, "mmw:vehicle:", own)) for path in _assets(folder, "vehicles")}


def load_figures() -> dict[str, ActorModel]:
    """Read every shipped figure of a person on foot, sorted by name; errors as of `load_catalog`."""
    return _bodies("pedestrians", "mmw:pedestrian:")


def load_cyclists() -> dict[str, ActorModel]:
    """Read every shipped cyclist, a person on a bicycle, sorted by name; errors as of `load_catalog`."""
    return _bodies("cyclists", "mmw:cyclist:")


def load_drones() -> dict[str, ActorModel]:
    """Read every shipped drone, sorted by name; errors as of `load_catalog`."""
    return _bodies("drones", "mmw:drone:")


def load_bodies() -> dict[str, ActorModel]:
    """Read every shipped vehicle, figure, cyclist and drone; errors as of `load_catalog`."""
    return {**load_catalog(), **load_figures(), **load_cyclists(), **load_drones()}


def _bodies(what: str, prefix: str) -> dict[str, ActorModel]:
    paths = _assets(assets_dir() / what, what)
    return {path.stem: ActorModel(**_read_model(path, prefix, {})) for path in paths}


def _assets(folder: Path, what: str) -> list[Path]:
    assets = sorted(path for path in folder.glob("*/*.usda") if path.stem == path.parent.name)
    if not assets:
        raise InputError(
            f"{what}: no <name>/<name>.usda in {folder}; one is needed; build them with mmw.worlds.vehicles.build"
        )
    return assets


def _read_model(path: Path, prefix: str, own: Mapping[str, str]) -> dict[str, Any]:
    """Return the arguments of `ActorModel`, and of a further field for each key of `own`, which names its attribute."""
    stage = Usd.Stage.Open(str(path), Usd.Stage.LoadNone)
    root = stage.GetDefaultPrim()
    if not root:
        raise InputError(f"{path}: no defaultPrim; the asset's root prim is needed; set it on the layer")
    label = attribute_value(root, f"semantics:labels:{TAXONOMY}")
    variants = root.GetVariantSet("paint")
    paints = variants.GetVariantNames()
    if not label or not paints:
        found = f"label {list(label or [])}, paints {list(paints)}"
        raise InputError(f"{path}: {found}; a class label and a variant set `paint` are needed; author them on {root}")
    selected = variants.GetVariantSelection()
    x, y, z = _dimension(path, root, f"{prefix}center")
    return {
        "name": path.stem,
        "asset": path.resolve(),
        "label": str(label[0]),
        "paints": tuple(sorted(paints, key=lambda paint: (paint != selected, paint))),
        **{key: _metres(_dimension(path, root, prefix + key)) for key in ("length", "width", "height")},
        **{key: _metres(_dimension(path, root, prefix + name)) for key, name in own.items()},
        "center": (_metres(x), _metres(y), _metres(z)),
    }


def _metres(value: float) -> float:
    """Return a float32 of the file as the decimal number that was meant, to the micrometer [m]."""
    return round(float(value), 6)


def _dimension(path: Path, root: Usd.Prim, name: str):
    value = attribute_value(root, name)
    if value is None:
        raise InputError(f"{path}: no value of {name} on {root.GetPath()}; needed in meters; author it")
    return value
