"""Include scenarios of other files: a path under `scenarios` is replaced by the scenarios of that configuration."""

import copy
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from mmw.config.input_paths import input_places
from mmw.config.scenario import ScenarioConfig
from mmw.core.errors import InputError


def include_scenarios(data: dict[str, Any], folder: Path, read: Callable[[Path], dict[str, Any]]) -> dict[str, Any]:
    """Return a configuration's content in which every path under `scenarios` is replaced by that file's scenarios.

    An included scenario brings its frames along (its own, else those of its file). Weathers, sensors, channel, output
    and compute are those of the including file. Relative paths in it start from its own file's folder.

    Args:
        data: Content of the including file.
        folder: Folder of the including file.
        read: Reads the content of a file.

    Raises:
        InputError: If an included file holds no list of scenarios, or includes further files.
    """
    entries = data.get("scenarios")
    if not isinstance(entries, list) or not any(isinstance(entry, str) for entry in entries):
        return data
    scenarios: list[Any] = []
    for entry in entries:
        scenarios += _included(entry, folder, read) if isinstance(entry, str) else [entry]
    return data | {"scenarios": scenarios}


def _included(entry: str, folder: Path, read: Callable[[Path], dict[str, Any]]) -> list[Any]:
    content = read(folder / entry)
    found = content.get("scenarios")
    if not isinstance(found, list) or not all(isinstance(item, dict) for item in found):
        raise InputError(
            f"scenarios: {entry!r}: holds no list of described scenarios; name a file that describes its own"
        )
    frames = {"frames": content["frames"]} if content.get("frames") is not None else {}
    return [_moved(frames | item, Path(entry).parent) for item in found]


def _moved(scenario: dict[str, Any], folder: Path) -> dict[str, Any]:
    """Return a scenario whose relative paths start one folder further out."""
    moved = copy.deepcopy(scenario)
    for place in input_places(moved, ScenarioConfig):
        if place.is_declared and not Path(place.value).is_absolute():
            place.replace(Path(os.path.normpath(folder / place.value)).as_posix())
    return moved
