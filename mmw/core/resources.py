"""Locate the shipped configurations and USD assets, in a checkout or a wheel, and the user's cache."""

import os
import sys
from importlib.resources import files
from pathlib import Path

from mmw.core.errors import InputError


def configs_dir() -> Path:
    """Return the folder of the shipped configuration files."""
    return Path(str(files("mmw.configs") / "quickstart.yaml")).parent


def shipped_configs() -> dict[str, Path]:
    """Return the shipped configurations by name: whole ones, those of single scenarios, and examples of keys."""
    patterns = ("*.yaml", "scenarios/*.yaml", "examples/*.yaml")
    return {path.stem: path for pattern in patterns for path in sorted(configs_dir().glob(pattern))}


def assets_dir() -> Path:
    """Return the folder of the shipped USD assets (`towns/`, `vehicles/`, `materials/`)."""
    return Path(str(files("mmw.assets") / "usd"))


def cache_dir() -> Path:
    """Return the user's cache folder, which need not exist.

    Source: XDG Base Directory Specification; Windows and macOS have their own folders.
    """
    if given := os.environ.get("XDG_CACHE_HOME"):
        return Path(given)
    if sys.platform == "win32":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    return Path.home() / ("Library/Caches" if sys.platform == "darwin" else ".cache")


def shipped_towns() -> list[str]:
    """Return the names of the shipped towns, sorted."""
    return sorted(path.name for path in (assets_dir() / "towns").iterdir() if path.is_dir())


def town_path(name: str) -> Path:
    """Return the interface layer of a shipped town.

    Raises:
        InputError: If no shipped town has this name; the message lists those that exist.
    """
    path = assets_dir() / "towns" / name / f"{name}.usda"
    if not path.is_file():
        raise InputError(
            f"town = {name!r}; shipped towns are: {', '.join(shipped_towns())}; name one of them, or give a USD file"
        )
    return path
