"""The vehicle models that traffic may use: their dimensions and paints, read from the USD assets."""

from dataclasses import dataclass
from pathlib import Path

from pxr import Usd, UsdSemantics

from mmw.paths import assets_dir
from mmw.usd.semantics import TAXONOMY


@dataclass(frozen=True)
class VehicleModel:
    """One vehicle asset, without its geometry. Body frame: x forward, y left, z up, origin on the ground midway
    between the axles."""

    name: str
    """Name of the asset and of its root prim."""
    asset: Path
    """Absolute path of the interface layer."""
    label: str
    """Semantic class, a key of `mmw.usd.semantics.CARLA_TAG`."""
    paints: tuple[str, ...]
    """Variants of the set `paint`; the asset's own selection first."""
    wheelbase: float
    """Distance between the axles [m]."""
    track: float
    """Distance between the middles of the left and the right tyres [m]."""
    wheel_radius: float
    """Tyre radius [m]."""
    length: float
    """Length of the box [m]."""
    width: float
    """Width of the box, which leaves the mirrors out [m]."""
    height: float
    """Height of the box above the ground [m]."""
    center: tuple[float, float, float]
    """Centre of the box in the body frame [m]."""


def load_catalog(directory: str | Path | None = None) -> dict[str, VehicleModel]:
    """Read every vehicle asset `<name>/<name>.usda` of a folder, without its geometry.

    Args:
        directory: Folder with one sub-folder a model; the shipped vehicles when left out.

    Returns:
        Model name -> model, sorted by name.

    Raises:
        ValueError: If the folder holds no vehicle, or an asset lacks its label, its paints or one of its dimensions.
    """
    folder = assets_dir() / "vehicles" if directory is None else Path(directory)
    assets = sorted(path for path in folder.glob("*/*.usda") if path.stem == path.parent.name)
    if not assets:
        raise ValueError(
            f"vehicles: no <name>/<name>.usda in {folder}; one is needed; build them with mmw.vehicles.build"
        )
    return {path.stem: _read_model(path) for path in assets}


def _read_model(path: Path) -> VehicleModel:
    stage = Usd.Stage.Open(str(path), Usd.Stage.LoadNone)
    root = stage.GetDefaultPrim()
    if not root:
        raise ValueError(f"{path}: no defaultPrim; the vehicle's root prim is needed; set it on the layer")
    labels = UsdSemantics.LabelsAPI(root, TAXONOMY).GetLabelsAttr()
    label = labels.Get() if labels else None
    variants = root.GetVariantSet("paint")
    paints = variants.GetVariantNames()
    if not label or not paints:
        found = f"label {list(label or [])}, paints {list(paints)}"
        raise ValueError(f"{path}: {found}; a class label and a variant set `paint` are needed; author them on {root}")
    selected = variants.GetVariantSelection()
    x, y, z = _dimension(path, root, "center")
    return VehicleModel(
        name=path.stem,
        asset=path.resolve(),
        label=str(label[0]),
        paints=tuple(sorted(paints, key=lambda paint: (paint != selected, paint))),
        wheelbase=_metres(_dimension(path, root, "wheelbase")),
        track=_metres(_dimension(path, root, "track")),
        wheel_radius=_metres(_dimension(path, root, "wheelRadius")),
        length=_metres(_dimension(path, root, "length")),
        width=_metres(_dimension(path, root, "width")),
        height=_metres(_dimension(path, root, "height")),
        center=(_metres(x), _metres(y), _metres(z)),
    )


def _metres(value: float) -> float:
    """Return a float32 of the file as the decimal number that was meant, to the micrometre [m]."""
    return round(float(value), 6)


def _dimension(path: Path, root: Usd.Prim, name: str):
    attribute = root.GetAttribute(f"mmw:vehicle:{name}")
    value = attribute.Get() if attribute else None
    if value is None:
        raise ValueError(f"{path}: no value of mmw:vehicle:{name} on {root.GetPath()}; needed in metres; author it")
    return value
