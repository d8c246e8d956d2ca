"""Find the entry of a material map for a mesh, and apply it to a radio description."""

import re
from collections.abc import Mapping
from dataclasses import replace
from fnmatch import fnmatchcase

from mmw.config.material_map import MaterialEntry
from mmw.physics.materials.itu_rows import RADIO_ROWS
from mmw.physics.materials.material import RadioMaterial
from mmw.physics.materials.scattering_patterns import scattering_pattern_names
from mmw.usd.material_library import LIBRARY
from mmw.usd.semantics import CARLA_TAG

MaterialMap = Mapping[str, MaterialEntry | str]
"""Pattern -> entry; text is the name of a radio material."""


def find_pattern(material_map: MaterialMap, *names: str) -> str:
    """Return the first pattern that matches one of some names, empty if none does."""
    return next((pattern for pattern in material_map if any(fnmatchcase(name, pattern) for name in names if name)), "")


def find_entry(material_map: MaterialMap, *names: str) -> MaterialEntry | None:
    """Return the entry of the first pattern that matches one of some names."""
    pattern = find_pattern(material_map, *names)
    return MaterialEntry.model_validate(material_map[pattern]) if pattern else None


def named_row(name: str) -> str:
    """Return the `itu_...` row that a material's name is or holds, such as mat_itu_concrete_001; empty if none."""
    found = re.search(r"itu_[a-z_]*[a-z]", name)
    return found[0] if found else ""


def mapped_radio(entry: MaterialEntry, known: RadioMaterial | None) -> RadioMaterial | None:
    """Return the radio description that an entry makes of a known one, None for none."""
    if entry.material is not None:
        return LIBRARY[entry.material].radio
    if entry.radio is not None:
        known = RadioMaterial("itu", itu=entry.radio)
    elif entry.relative_permittivity is not None:
        conductivity = entry.conductivity or 0.0
        known = RadioMaterial("constant", relative_permittivity=entry.relative_permittivity, conductivity=conductivity)
    others = entry.model_dump(include={"thickness", "scattering", "xpd", "scattering_pattern"}, exclude_none=True)
    return replace(known, **others) if known is not None else None


def unknown_names(where: str, entry: MaterialEntry) -> list[str]:
    """Return a line for each name of an entry that does not exist."""
    return [
        f"{where}: {key} = {value!r} is unknown; use one of {', '.join(sorted(known))}"
        for key, known in (
            ("material", LIBRARY),
            ("radio", RADIO_ROWS),
            ("scattering_pattern", scattering_pattern_names()),
            ("label", CARLA_TAG),
        )
        if (value := getattr(entry, key)) is not None and value not in known
    ]
