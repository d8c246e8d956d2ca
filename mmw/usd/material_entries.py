"""Find the entry of a material map for a mesh, and apply it to a material."""

import re
from collections.abc import Collection, Mapping
from dataclasses import replace
from fnmatch import fnmatchcase

from mmw.config.material_map import MaterialChanges, MaterialEntry
from mmw.physics.materials.itu_rows import RADIO_ROWS
from mmw.physics.materials.material import LIDAR_REFLECTANCE_905NM, Material, RadioMaterial, lidar_reflectance
from mmw.physics.materials.scattering_patterns import scattering_pattern_names
from mmw.usd.material_library import LIBRARY
from mmw.usd.semantics import CARLA_TAG

SURFACE_FIELDS = (
    "thickness", "scattering", "xpd", "scattering_pattern", "alpha_r", "alpha_i", "lobe_share", "rms_height", "layers",
)  # fmt: skip
"""Fields of a radio material beside its substance, which an entry changes one by one."""

LOOK_FIELDS = ("color", "roughness", "metallic", "opacity")
"""Fields of an appearance that an entry changes one by one."""

MaterialMap = Mapping[str, MaterialEntry | str]
"""Pattern -> entry; text is the name of a radio material."""

LABEL = "label:"
"""Begin of a pattern of semantic classes, such as `label:building`; no prim path and no name of a material has it."""


def find_pattern(material_map: MaterialMap, *names: str, label: str = "") -> str:
    """Return the first pattern that matches one of some names, or a class after `label:`; empty if none does."""
    values = (*names, LABEL + label)
    return next((pattern for pattern in material_map if any(fnmatchcase(name, pattern) for name in values if name)), "")


def entry_of(material_map: MaterialMap, pattern: str) -> MaterialEntry | None:
    """Return the entry of a pattern that `find_pattern` found, None for an empty one."""
    return MaterialEntry.model_validate(material_map[pattern]) if pattern else None


def named_row(name: str) -> str:
    """Return the `itu_...` row that a material's name is or holds, such as mat_itu_concrete_001; empty if none."""
    found = re.search(r"itu_[a-z_]*[a-z]", name)
    return found[0] if found else ""


def mapped_radio(entry: MaterialChanges, known: RadioMaterial | None) -> RadioMaterial | None:
    """Return the radio description that an entry makes of a known one, None for none.

    A substance of an entry brings a smooth half-space, apart from what the entry says itself: a wall of brick is none
    of the thickness of the pane that was there. One for a weather alone leaves thickness and scattering as they are.
    """
    others = entry.model_dump(include=set(SURFACE_FIELDS), exclude_none=True)
    if isinstance(entry, MaterialEntry):
        if entry.material is not None:
            return LIBRARY[entry.material].radio
    elif known is not None:
        others = {**{name: getattr(known, name) for name in SURFACE_FIELDS}, **others}
    if entry.radio is not None:
        known = RadioMaterial("itu", itu=entry.radio)
    elif entry.relative_permittivity is not None:
        conductivity = entry.conductivity or 0.0
        known = RadioMaterial("constant", relative_permittivity=entry.relative_permittivity, conductivity=conductivity)
    return replace(known, **others) if known is not None else None


def overridden(material: Material, entry: MaterialEntry, weather: str) -> Material:
    """Return a material with the changes of an entry, and then with those for a weather.

    A changed base gives the LiDAR reflectance, unless it is given itself. A changed color, roughness, metalness or
    opacity takes the place of its texture.
    """
    for changes in (entry, entry.weathers.get(weather)):
        if changes is not None and changes.changes:
            material = _changed(material, changes)
    return material


def _changed(material: Material, changes: MaterialChanges) -> Material:
    look = {name: value for name in LOOK_FIELDS if (value := getattr(changes, name)) is not None}
    appearance = replace(material.appearance, **look, **{f"{name}_texture": None for name in look})
    if not appearance.textures:
        appearance = replace(appearance, has_uv=True)
    base, color = changes.base or material.nonvisual_base, changes.color or material.color
    reflectance = material.lidar_reflectance
    if changes.lidar_reflectance is not None:
        reflectance = changes.lidar_reflectance
    elif changes.base is not None or (changes.color is not None and material.coating != "none"):
        attributes = ("retroreflective",) if material.is_retroreflective else ()
        reflectance = lidar_reflectance(base, material.coating, attributes, color)
    radio = mapped_radio(changes, material.radio) or material.radio
    seen = material.radar_radio and mapped_radio(changes, material.radar_radio)
    return replace(
        material,
        radio=radio,
        radar_radio=None if seen == radio else seen,
        nonvisual_base=base,
        color=color,
        lidar_reflectance=reflectance,
        appearance=appearance,
    )


def unknown_names(where: str, entry: MaterialEntry, weathers: Collection[str] | None = None) -> list[str]:
    """Return a line for each name of an entry that does not exist.

    Args:
        where: Place of the entry.
        entry: The entry.
        weathers: Names of weathers that exist; None to leave them unchecked.
    """
    lines = []
    if weathers is not None:
        lines += [
            f"{where}: weathers.{name}: there is no such weather; name one of {', '.join(weathers)}"
            for name in entry.weathers
            if name not in weathers
        ]
    for place, changes in ((where, entry), *((f"{where}: weathers.{key}", c) for key, c in entry.weathers.items())):
        lines += [
            f"{place}: {key} = {value!r} is unknown; use one of {', '.join(sorted(known))}"
            for key, known in (
                ("material", LIBRARY),
                ("radio", RADIO_ROWS),
                ("scattering_pattern", scattering_pattern_names()),
                ("base", LIDAR_REFLECTANCE_905NM),
                ("label", CARLA_TAG),
            )
            if (value := getattr(changes, key, None)) is not None and value not in known
        ]
    return lines


def unknown_entries(key: str, entries: Mapping[str, MaterialEntry], weathers: Collection[str]) -> list[str]:
    """Return a line for each name in a material map that does not exist, classes that its patterns name too.

    Args:
        key: Place of the map, such as `materials`.
        entries: The map.
        weathers: Names of weathers that exist.
    """
    lines = []
    for pattern, entry in entries.items():
        where = f"{key}[{pattern!r}]"
        if pattern.startswith(LABEL) and not any(fnmatchcase(LABEL + label, pattern) for label in CARLA_TAG):
            lines.append(f"{where}: no class matches; use one of {', '.join(sorted(CARLA_TAG))} after {LABEL!r}")
        lines += unknown_names(where, entry, weathers)
    return lines
