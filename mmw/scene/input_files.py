"""Hash the input files of a configuration: the files of the user that its rows depend on."""

import os
from collections.abc import Iterator, Mapping
from pathlib import Path

from pxr import Tf

from mmw.config import Config
from mmw.config.input_paths import InputPlace, input_places
from mmw.config.scenario import TOWN_SUFFIXES
from mmw.core.errors import InputError
from mmw.core.hashing import sha256
from mmw.core.resources import assets_dir
from mmw.scene.sources import is_town_file, scenario_source
from mmw.scene.stage.asset_copies import dependencies

Inputs = dict[str, dict[str, str]]
"""Name of a scenario, or key of another section -> file, relative to the folder of the named one -> SHA-256."""

MISSING = "missing"
"""Stands for the hash of a file that a stage refers to and that does not exist, such as a texture."""


def hash_inputs(config: Config, base: Path) -> Inputs:
    """Return the hashes of all files that a configuration names, and of all files that these refer to.

    Files that mmw ships are left out: they belong to its version, see `mmw.generation.software`. Each file is read
    once. Names do not depend on where the files are.

    Args:
        config: The configuration.
        base: Folder that relative paths start from.

    Raises:
        InputError: If a file does not exist, cannot be read, or USD cannot read it.
    """
    data = config.model_dump(mode="json")
    found: Inputs = {}
    known: dict[Path, str] = {}
    trees: dict[Path, dict[str, Path | None]] = {}  # scenarios share towns
    for place in input_places(data, type(config)):
        path = base / place.value
        if not place.is_declared and not path.exists():
            continue
        if path not in trees:
            trees[path] = dict(_files(place, path))
        files = found.setdefault(_owner(place, data), {})
        for name, file in trees[path].items():
            digest = MISSING if file is None else known.get(file) or known.setdefault(file, _digest(file))
            files[name if files.get(name, digest) == digest else f"{place}: {name}"] = digest
    return found


def hash_shipped_towns(config: Config, base: Path) -> Inputs:
    """Return the hashes of the USD files of shipped towns, by scenario."""
    found: Inputs = {}
    for scenario in config.scenarios:
        if scenario.town is not None and not is_town_file(scenario):
            folder = scenario_source(scenario, base).parent
            files = sorted(path for path in folder.iterdir() if path.suffix in TOWN_SUFFIXES)
            found[scenario.name] = {path.name: sha256(path) for path in files}
    return found


def _owner(place: InputPlace, data: Mapping) -> str:
    """Return the scenario whose section has a path; else the key of the section."""
    if place.keys[0] == "scenarios":
        return data["scenarios"][place.keys[1]]["name"]
    return ".".join(map(str, place.keys[:-1]))


def _files(place: InputPlace, path: Path) -> Iterator[tuple[str, Path | None]]:
    """Yield name and path of a file and of all files that it refers to, None for missing ones; or those of a folder."""
    if path.is_dir():
        for file in sorted(file for file in path.rglob("*") if file.is_file()):
            yield f"{path.name}/{file.relative_to(path).as_posix()}", file
        return
    if not path.is_file():
        raise InputError(f"{place} = {place.value!r}: no such file ({path}); give an existing one")
    yield path.name, path
    if path.suffix not in TOWN_SUFFIXES:
        return
    try:
        others = dependencies(path)
    except Tf.ErrorException as error:
        reason = str(error).strip().splitlines()[-1].strip()
        raise InputError(f"{place} = {place.value!r}: USD cannot read it ({reason}); give an intact file") from None
    real, shipped = path.resolve(), assets_dir().resolve()
    for file in others.files:
        if file == real:
            continue
        if not file.is_relative_to(shipped):
            yield _relative(file, real.parent), file
        elif file.is_relative_to(shipped / "towns"):
            yield f"assets/usd/{file.relative_to(shipped).as_posix()}", file
    for name in others.missing:
        yield _relative(Path(name).resolve(), real.parent) if Path(name).is_absolute() else name, None


def _relative(file: Path, folder: Path) -> str:
    return Path(os.path.relpath(file, folder)).as_posix()


def _digest(file: Path) -> str:
    try:
        return sha256(file)
    except OSError as error:
        raise InputError(f"{file}: cannot be read ({error.strerror}); change its permissions") from None
