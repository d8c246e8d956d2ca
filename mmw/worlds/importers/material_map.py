"""The material map of an import: a YAML file with the materials of an imported scene."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path

from mmw.config import ConfigError
from mmw.config.material_map import MaterialEntry
from mmw.config.yaml_file import read_yaml, validated
from mmw.core.errors import InputError
from mmw.physics.materials.itu_rows import RADIO_ROWS
from mmw.physics.materials.material import RadioMaterial
from mmw.usd.material_entries import find_pattern, mapped_radio, named_row, unknown_names
from mmw.usd.material_library import LIBRARY
from mmw.worlds.importers.imported_scene import ImportedMaterial, ImportedScene, library_material
from mmw.worlds.importers.mesh_cleanup import free_name, identifier
from mmw.worlds.towns.mesh_part import MeshPart

NEEDED = 'a map of patterns, such as "*wall*": {radio: itu_brick}'
"""Content of a material map's file."""


def load_material_map(path: str | Path) -> dict[str, MaterialEntry]:
    """Return the entries of a material map, in the file's order.

    An entry is a map of keys, or only the name of a radio material (`"*wall*": itu_brick`).

    Raises:
        ConfigError: If the file cannot be read, or with one line for each unknown key, material, row or label.
    """
    path = Path(path)
    data = read_yaml(path, NEEDED)
    if not data:
        raise InputError(f"{path}: holds no entries; {NEEDED} is needed")
    problems, entries = [], {}
    for pattern, value in data.items():
        try:
            entry = validated(MaterialEntry, value, path, (str(pattern),))
        except ConfigError as error:
            problems += error.problems
            continue
        entries[str(pattern)] = entry
        problems += unknown_names(f"{path}: {str(pattern)!r}", entry)
        problems += [f"{path}: {str(pattern)!r}: {line}" for line in _not_in_files(entry)]
    if problems:
        raise ConfigError(problems)
    return entries


def apply_material_map(where: str, scene: ImportedScene, entries: Mapping[str, MaterialEntry]) -> ImportedScene:
    """Return a scene in which every material has a radio description.

    The first pattern that matches a mesh decides the keys that it has; all others are the source's. A pattern is
    matched against the mesh's prim path in the town (`/Town/Shapes/house`), the same path without `/Town`, and its
    material's name in the source. A material without an entry that names a row (`itu_brick`) in its own name has that.

    Args:
        where: The source file, for errors.
        scene: The imported scene.
        entries: The material map.

    Raises:
        InputError: If a mesh is left without radio material, with the list of all such meshes and a map to fill in, or
            if the source names a radio material that does not exist.
    """
    for pattern, entry in entries.items():
        for line in _not_in_files(entry):
            raise InputError(f"{where}: materials[{pattern!r}]: {line}")
    found = [(part, _match(part, scene, entries)) for part in scene.parts]
    by_map = {entries[pattern].material for _, pattern in found if pattern}
    taken = {part.material for part in scene.parts if part.material not in scene.materials} | (by_map - {None})
    materials: dict[str, ImportedMaterial] = {}
    name_of: dict[tuple[str, str], str] = {}  # material of the source, and the pattern that changes it
    parts, missing = [], {}
    for part, pattern in found:
        entry = entries[pattern] if pattern else None
        label = entry.label if entry and entry.label else part.label
        imported = _imported_material(part, scene, entry)
        name = part.material if imported is None else ""
        if entry and entry.material:
            name = entry.material
        elif imported is not None:
            key = part.material, pattern if entry and entry.changes else ""
            if key not in name_of:
                name_of[key] = free_name(imported.name, taken | materials.keys())
                materials[name_of[key]] = replace(imported, name=name_of[key])
            name = name_of[key]
            if imported.radio is None and not imported.unknown_row:
                missing.setdefault(imported.source, []).append(f"/Town/{part.path}")
        parts.append(replace(part, material=name, label=label))
    if missing:
        raise InputError(_missing(where, missing))
    for material in materials.values():
        if material.radio is None:
            raise InputError(
                f"{where}: material {material.source!r}: the radio material {material.unknown_row!r} does not exist; "
                f"use one of {', '.join(sorted(RADIO_ROWS))}; correct the file, or name another with --materials"
            )
    used = {pattern for _, pattern in found}
    idle = tuple(f"{name!r} of the material map decides nothing" for name in entries if name not in used)
    return replace(scene, parts=parts, materials=materials, notes=(*scene.notes, *idle))


def _not_in_files(entry: MaterialEntry) -> Iterator[str]:
    """Yield a line for each key that the file of an imported asset cannot hold."""
    if entry.weathers:
        yield "weathers: a file has its materials in one weather; give it in `materials` of a configuration"
    if entry.lidar_reflectance is not None:
        yield "lidar_reflectance: files hold the base that gives it; give `base`, or `materials` of a configuration"


def _match(part: MeshPart, scene: ImportedScene, entries: Mapping[str, MaterialEntry]) -> str:
    """Return the first pattern that matches a mesh, empty if none does."""
    material = scene.materials.get(part.material)
    source = material.source if material else part.material
    return find_pattern(entries, f"/Town/{part.path}", f"/{part.path}", source, label=part.label)


def _imported_material(part: MeshPart, scene: ImportedScene, entry: MaterialEntry | None) -> ImportedMaterial | None:
    """Return a mesh's material with the changes of its entry; None for a library material that stays as it is."""
    changes = entry.changes if entry else {}
    source = scene.materials.get(part.material)
    if source is None:
        if part.material not in LIBRARY:
            raise InputError(f"{part.path}: material {part.material!r} is neither in the library nor in the world")
        if not changes or (entry and entry.material):
            return None
        source = library_material(part.material)
    radio, row = source.radio, source.unknown_row or named_row(source.source)
    if radio is None and row in RADIO_ROWS:
        radio = RadioMaterial("itu", itu=row)
    if entry:
        radio = mapped_radio(entry, radio)
    base = "" if {"radio", "relative_permittivity"} & set(changes) else source.base  # another substance
    base = str(changes.get("base", base))
    look = {key: changes[key] for key in ("color", "roughness", "metallic", "opacity") if key in changes}
    name = source.name if source.source else identifier(entry.radio if entry and entry.radio else source.name)
    return replace(source, name=name, radio=radio, unknown_row="" if radio else row, base=base, **look)


def _missing(where: str, missing: Mapping[str, list[str]]) -> str:
    """Return the error for meshes without radio material: all of them, and a map to fill in."""
    count = sum(map(len, missing.values()))
    lines = [
        f"{where}: {count} meshes have no radio material; every surface needs one; say with --materials map.yaml what "
        "they are, for example:"
    ]
    for source, paths in missing.items():
        if source:
            lines.append(f"  {_quoted(source)}: {{radio: itu_concrete}}  # {', '.join(paths)}")
        else:
            lines += [f"  {_quoted(path)}: {{radio: itu_concrete}}  # no material in the file" for path in paths]
    return "\n".join(lines)


def _quoted(name: str) -> str:
    """Return a name as a YAML key that matches nothing else."""
    literal = re.sub(r"([*?\[])", r"[\1]", name)
    return '"' + literal.replace("\\", "\\\\").replace('"', '\\"') + '"'
