"""Read Material prims as `mmw.physics.materials.material.Material`, with or without radio attributes."""

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path

from pxr import Usd, UsdShade

from mmw.config.material_map import MaterialEntry
from mmw.config.physics_presets import Physics
from mmw.core.errors import InputError
from mmw.core.resources import assets_dir
from mmw.physics.materials.appearance import Appearance
from mmw.physics.materials.itu_rows import RADIO_ROWS
from mmw.physics.materials.material import (
    LIDAR_REFLECTANCE_905NM,
    Material,
    RadioMaterial,
    file_values,
    lidar_reflectance,
    wrong_radio_value,
)
from mmw.usd.material_entries import MaterialMap, entry_of, mapped_radio, named_row, overridden
from mmw.usd.material_library import LIBRARY, LIBRARY_FILE, NONVISUAL, ROOT
from mmw.usd.preview_surface import Notes, read_appearance
from mmw.usd.prim_values import attribute_value, decimal, decimals
from mmw.usd.schema import RADIO_ATTRIBUTES
from mmw.usd.standard_materials import standard_radio

NO_COLOR = (0.5, 0.5, 0.5)
"""Diffuse color of a material that gives none as a number [-]."""


def _itu(*rows: str) -> dict[str, RadioMaterial]:
    return {
        name: RadioMaterial("itu", itu=row) for row, names in (r.split(": ") for r in rows) for name in names.split()
    }


RADIO_OF_BASE = {
    **_itu(
        "itu_very_dry_ground: asphalt", "itu_concrete: concrete", "itu_brick: brick", "itu_marble: stone marble",
        "itu_glass: clear_glass one_way_mirror plexiglass fiberglass", "itu_wood: wood bark",
        "itu_metal: aluminum steel iron", "itu_medium_dry_ground: leaf_grass soil dirt grass",
    ),
    "plastic": LIBRARY["plastic"].radio,
    "rubber": LIBRARY["car_rubber"].radio,
}  # fmt: skip
"""SimReady non-visual base token -> radio description: the nearest row of ITU-R P.2040, by substance."""

RADIO_OF_LABEL = _itu(
    "itu_concrete: building wall sidewalk bridge", "itu_very_dry_ground: road road_line",
    "itu_medium_dry_ground: terrain ground", "itu_wood: vegetation",
    "itu_metal: pole guard_rail fence traffic_light traffic_sign car truck bus train motorcycle bicycle rail_track",
)  # fmt: skip
"""Semantic class -> radio description, the last resort for a bound material that says nothing about itself."""


@dataclass(frozen=True)
class MaterialUse:
    """One material as the scene uses it: ids are given to these, so they must not depend on the weather."""

    name: str
    prim_path: str
    """Material prim; empty for a mesh without one that the material map describes."""
    fallback: RadioMaterial | None
    """Radio material by material map, name, non-visual base or label; None if `mmw:radio:*` decides."""
    library: str = ""
    """Material of the library that the material map names, for LiDAR and appearance too; empty if it names none."""
    pattern: str = ""
    """Pattern of the material map whose entry changes the material; empty if none does."""
    display_color: tuple[float, float, float] | None = None
    """Color of the mesh, drawn where no surface shader of a material is read; None for no such color."""
    has_uv: bool = True
    """Whether the mesh has texture coordinates."""


def resolve_material(
    label: str, material: Usd.Prim | None, entry: MaterialEntry | None = None, pattern: str = ""
) -> MaterialUse | None:
    """Return the source of the radio description of a mesh; the first that exists counts, None if there is none.

    The entry of a material map; `mmw:radio:*` of the bound material; a material name that is or holds an `itu_...` row;
    its non-visual base; the semantic class. An entry that names no radio material changes what the next of these says.

    Args:
        label: Semantic class of the mesh.
        material: Bound material.
        entry: Entry of the material map that decides about the mesh.
        pattern: Its pattern.

    Raises:
        InputError: If the name holds an `itu_...` row that does not exist, and the map gives no other one.
    """
    path = str(material.GetPath()) if material else ""
    name = material.GetName() if material else ""
    if entry is None or not entry.changes_material:
        entry, pattern = None, ""
    library = (entry.material or "") if entry is not None else ""
    if library:
        return MaterialUse(library, path, LIBRARY[library].radio, library, pattern)
    if material and _has_radio(material):
        return MaterialUse(name, path, None, "", pattern)
    is_inferred = material and not (entry is not None and entry.names_radio)
    fallback = _infer_radio(material, label) if is_inferred else None
    if entry is not None:
        fallback = mapped_radio(entry, fallback)
        name = name or entry.radio or "mapped"
    return MaterialUse(name, path, fallback, "", pattern) if fallback else None


def unknown_row(material: Usd.Prim) -> str:
    """Return the `itu_...` row that a material's name holds if it does not exist and `mmw:radio:*` is not there."""
    row = named_row(material.GetName())
    return "" if row in RADIO_ROWS or _has_radio(material) else row


def _infer_radio(material: Usd.Prim, label: str) -> RadioMaterial | None:
    """Return the radio description by name, non-visual base or semantic class, without `mmw:radio:*`."""
    if unknown_row(material):
        raise InputError(
            f"{material.GetPath()}: the radio material {unknown_row(material)!r} of its name does not exist; use one "
            f"of {', '.join(RADIO_ROWS)}; rename it, or describe it by mmw:radio:* or a material map"
        )
    row = named_row(material.GetName())
    if row:
        return RadioMaterial("itu", itu=row)
    return RADIO_OF_BASE.get(attribute_value(material, NONVISUAL + "base", "none")) or RADIO_OF_LABEL.get(label)


def read_material(
    stage: Usd.Stage, use: MaterialUse, notes: Notes | None = None, physics: Physics = "paper"
) -> Material:
    """Return a material as the stage describes it now, that is in the weather that is selected now.

    Args:
        stage: The stage.
        use: The material as a mesh uses it.
        notes: Receives notes for users of the RGB camera.
        physics: Preset of the channel; beyond `paper`, materials of the shipped library are those of
            `mmw.usd.standard_materials`.

    Raises:
        InputError: If its `mmw:radio:*` attributes contradict themselves or are out of range.
    """
    material = _as_authored(stage, use, notes)
    name = use.library or (material.name if use.fallback is None and _is_of_library(stage, use) else "")
    radio = standard_radio(name, material.radio) if physics != "paper" else material.radio
    return material if radio == material.radio else replace(material, radio=radio, radar_radio=material.radio)


def _is_of_library(stage: Usd.Stage, use: MaterialUse) -> bool:
    """Return whether a material prim is composed from the shipped library, or from the copy of it beside a dataset."""
    specs = stage.GetPrimAtPath(use.prim_path).GetPrimStack()
    return any(spec.path == f"{ROOT}/{use.name}" and Path(spec.layer.realPath).name == LIBRARY_FILE for spec in specs)


def _as_authored(stage: Usd.Stage, use: MaterialUse, notes: Notes | None) -> Material:
    """Return a material as the stage or the material map describes it."""
    if use.library:
        spec = LIBRARY[use.library]
        reflectance = lidar_reflectance(spec.base, spec.coating, spec.attributes, spec.color)
        is_retro = "retroreflective" in spec.attributes
        appearance = replace(library_appearance(use.library), has_uv=use.has_uv)
        return Material(use.name, spec.radio, spec.base, reflectance, spec.color, spec.coating, is_retro, appearance)
    if not use.prim_path and use.fallback is not None:
        color = use.display_color or NO_COLOR
        return Material(
            use.name, use.fallback, "none", lidar_reflectance("none"), color, appearance=Appearance(color=color)
        )
    prim = stage.GetPrimAtPath(use.prim_path)
    base = str(attribute_value(prim, NONVISUAL + "base", "none"))
    coating = str(attribute_value(prim, NONVISUAL + "coating", "none"))
    attributes = tuple(attribute_value(prim, NONVISUAL + "attributes") or ())
    color = _diffuse_color(prim)
    reflectance = lidar_reflectance(base if base in LIDAR_REFLECTANCE_905NM else "none", coating, attributes, color)
    radio = use.fallback if use.fallback is not None else _read_radio(prim)
    is_retro = "retroreflective" in attributes
    appearance = replace(read_appearance(prim, {} if notes is None else notes, use.display_color), has_uv=use.has_uv)
    if not appearance.textures:
        appearance = replace(appearance, has_uv=True)
    return Material(use.name, radio, base, reflectance, color, coating, is_retro, appearance)


def read_materials(
    stage: Usd.Stage,
    uses: Iterable[MaterialUse],
    notes: Notes,
    copies: "Copies",
    material_map: MaterialMap | None = None,
    weather: str = "",
    physics: Physics = "paper",
) -> list[Material]:
    """Return the material of each use in a weather, which is selected; copies are read once, unless they have notes.

    `copies` remembers materials across weathers: a material that a weather changes is no copy. Entries of the map
    change what was read.
    """
    found = []
    for use in uses:
        prim = stage.GetPrimAtPath(use.prim_path) if use.prim_path and not use.library else None
        specs = copies.specs(prim) if prim else None
        key, own = (replace(use, prim_path=""), specs), {}
        known = copies.materials.get(key) if specs else None
        if known is None:
            known = read_material(stage, use, own, physics)
        else:
            known = replace(known, appearance=replace(known.appearance, prim_path=use.prim_path))
        entry = entry_of(material_map or {}, use.pattern)
        found.append(known if entry is None else overridden(known, entry, weather))
        notes.update(own)
        if specs and not own:
            copies.materials[key] = known
    return found


@dataclass
class Copies:
    """Finds materials that are copies of one: every vehicle of a stage has its own of the same library."""

    materials: dict[tuple[MaterialUse, tuple], Material] = field(default_factory=dict)
    """Use without its path, and specs -> the material that was read for them."""
    _is_closed: dict[tuple, bool] = field(default_factory=dict)

    def specs(self, prim: Usd.Prim) -> tuple | None:
        """Return what a material's prims are made of, the same for copies; None if they read a prim beside them."""
        prims = list(Usd.PrimRange(prim, Usd.TraverseInstanceProxies()))
        specs = tuple((p.GetName(), *((spec.layer.identifier, spec.path) for spec in p.GetPrimStack())) for p in prims)
        if specs not in self._is_closed:
            connected = [at for p in prims for at in p.GetAuthoredAttributes() if at.HasAuthoredConnections()]
            sources = [source for attribute in connected for source in attribute.GetConnections()]
            self._is_closed[specs] = all(source.HasPrefix(prim.GetPath()) for source in sources)
        return specs if self._is_closed[specs] else None


@cache
def library_appearance(name: str) -> Appearance:
    """Return the appearance of a material of the shipped library."""
    stage = Usd.Stage.Open(str(assets_dir() / "materials" / LIBRARY_FILE))
    return read_appearance(stage.GetPrimAtPath(f"{ROOT}/{name}"), {})


def _has_radio(prim: Usd.Prim) -> bool:
    attribute = prim.GetAttribute(RADIO_ATTRIBUTES["model"].name)
    return bool(attribute) and attribute.HasAuthoredValue()


def _read_radio(prim: Usd.Prim) -> RadioMaterial:
    where = prim.GetPath()
    values = {}
    for name, default in file_values(RadioMaterial("constant")).items():
        value = attribute_value(prim, RADIO_ATTRIBUTES[name].name, default)
        values[name] = decimal(value) if isinstance(default, float) else type(default)(value)
    wrong = wrong_radio_value(values)
    if wrong is not None:
        name, needed = wrong
        raise InputError(
            f"{where}: {RADIO_ATTRIBUTES[name].name} = {values[name]!r}; {needed} is needed; correct the attribute"
        )
    return RadioMaterial(**values)


def _diffuse_color(prim: Usd.Prim) -> tuple[float, float, float]:
    """Return the diffuse color where the surface shader has it as a number, else a middle gray.

    Beside a texture the number is its mean in materials of mmw, which have the radio schema; elsewhere it is arbitrary.
    """
    shader = UsdShade.Material(prim).ComputeSurfaceSource()[0]
    port = shader.GetInput("diffuseColor") if shader else None
    value = port.Get() if port and (_has_radio(prim) or not port.HasConnectedSource()) else None
    return NO_COLOR if value is None else decimals(value)
