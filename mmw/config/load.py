"""Load a configuration and apply overrides; each problem is one line with file, key, value and remedy."""

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from mmw.config.file_content import file_content
from mmw.config.include import include_scenarios
from mmw.config.model import Config
from mmw.config.overrides import set_value
from mmw.config.sensors import add_sensor_schemas
from mmw.config.shipped import config_path
from mmw.config.sweep_members import SweepMember, expand_sweep
from mmw.config.yaml_file import ConfigError, read_yaml, reason_of, validated
from mmw.config.yaml_loader import parse_yaml, short
from mmw.core.errors import InputError

_NEEDED = "a mapping with the key `scenarios`"

Source = str | os.PathLike[str] | Mapping[str, Any] | Config
"""Configuration that a function takes: a file, the name of a shipped one, the content of a file, or an object."""


def load_config(
    source: Source,
    overrides: Sequence[str] = (),
    patch: Mapping[str, Any] | None = None,
    *,
    base: str | os.PathLike[str] | None = None,
) -> Config:
    """Return a configuration after `a.b=c` overrides and the options of `patch`, validated.

    Args:
        source: Path of a YAML file; name of a shipped configuration, such as `quickstart`; content of a file as a
            mapping, which may hold sections such as `mmw.sensors.Lidar()`; or a `Config`.
        overrides: `key=value` as on the command line, values as YAML: `frames.count=10`, `sensors.lidar.range_m=80`.
        patch: Dotted key -> value, applied after the overrides.
        base: Folder that the paths of included files in a mapping start from; the current folder by default.

    The result has no folder of its own: `mmw.generate` and `mmw.Simulation` take the one that its relative paths start
    from as `base`.

    Raises:
        ConfigError: If the file, an override or a value cannot be used.

    Examples:
        >>> config = load_config("quickstart", ["frames.count=50", "weathers=[sunny, rainy]"])
        >>> config.frames.count, config.weathers, config.scenarios[0].name
        (50, ('sunny', 'rainy'), 'town03_roundabout')
    """
    place = place_of(source)
    return validated(Config, _changed_content(source, place, overrides, patch, base), place)


def load_sweep(
    source: Source,
    overrides: Sequence[str] = (),
    patch: Mapping[str, Any] | None = None,
    *,
    base: str | os.PathLike[str] | None = None,
) -> tuple[SweepMember, ...]:
    """Return the datasets of a configuration's `sweep`, each with its configuration; none without a sweep.

    Arguments are those of `load_config`. Values of the sweep replace those of overrides.

    Raises:
        ConfigError: As `load_config`; of several wrong datasets the first is told.
    """
    place = place_of(source)
    data = _changed_content(source, place, overrides, patch, base)
    sweep = validated(Config, data, place).sweep
    return () if sweep is None else expand_sweep(data, sweep, place)


def _changed_content(
    source: Source,
    place: Path | str,
    overrides: Sequence[str],
    patch: Mapping[str, Any] | None,
    base: str | os.PathLike[str] | None,
) -> dict[str, Any]:
    """Return the content of a configuration after overrides and options, see `load_config`."""
    data = _content(source, place, base_folder(source, base))
    if isinstance(overrides, str) or not all(isinstance(item, str) for item in overrides):
        raise ConfigError([f"overrides = {short(overrides)}: a list of texts is needed, such as ['frames.count=10']"])
    for item in overrides:
        key, sign, text = item.partition("=")
        where = f"override {short(item, 120)}"
        if not sign or not key:
            raise ConfigError([f"{where}: write it as key=value, for example frames.count=10"])
        try:
            value = parse_yaml(text)
        except yaml.YAMLError as error:
            reason = reason_of(error)
            raise ConfigError(
                [f"{where}: the value is not valid YAML ({reason}); quote it, or close its brackets"]
            ) from None
        with _located(where):
            set_value(data, key, value)
    for key, value in (patch or {}).items():
        with _located(f"option for {key}"):
            set_value(data, key, file_content(value))
    return data


def place_of(source: Source) -> Path | str:
    """Return the file of a configuration, or a word for one that is no file, as messages begin with it.

    Raises:
        ConfigError: If there is no such file, or the source is none of the kinds of `load_config`.
    """
    if isinstance(source, str | os.PathLike):
        return config_path(Path(source))
    if isinstance(source, Mapping | Config):
        return "configuration"
    raise ConfigError(
        [
            f"configuration = {short(source)}: is of type {type(source).__name__}; give a YAML file, the name of a "
            "shipped configuration, a mapping or an mmw.Config"
        ]
    )


@contextmanager
def in_config(place: Path | str) -> Iterator[None]:
    """Let the problems of a configuration that the block finds begin with its place, see `place_of`."""
    try:
        yield
    except ConfigError as error:
        raise ConfigError([f"{place}: {problem}" for problem in error.problems]) from error


def base_folder(source: Source, base: str | os.PathLike[str] | None = None) -> Path:
    """Return the folder that relative paths of a configuration start from: `base`, its file's, or the current one.

    Raises:
        ConfigError: If there is no such folder or file.
    """
    if base is not None:
        folder = Path(base)
        if not folder.is_dir():
            raise ConfigError([f"base = {str(folder)!r}: no such folder; give the one that relative paths start from"])
        return folder
    place = place_of(source)
    return place.parent if isinstance(place, Path) else Path.cwd()


def _content(source: Source, place: Path | str, base: Path) -> dict[str, Any]:
    """Return the content of a configuration, its included scenarios filled in."""
    with _located(str(place)):
        if isinstance(source, Mapping | Config):
            return include_scenarios(file_content(source), base, _read)
        path = Path(place)
        return include_scenarios(_read(path), path.parent, _read)


@contextmanager
def _located(where: str) -> Iterator[None]:
    """Say where bad input was found; a problem of another file says so itself."""
    try:
        yield
    except ConfigError:
        raise
    except InputError as error:
        raise ConfigError([f"{where}: {error}"]) from None


def _read(path: Path) -> dict[str, Any]:
    """Return the content of a configuration file."""
    return read_yaml(path, _NEEDED)


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of the file format, for editors; `configs/mmw.schema.json` is its committed copy."""
    schema = Config.model_json_schema()
    add_sensor_schemas(schema)
    items = schema["properties"]["scenarios"]
    path = {"type": "string", "description": "another configuration file, whose scenarios and frames are taken (path)"}
    items["items"] = {"anyOf": [items["items"], path]}
    return schema | {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "mmw configuration"}


def to_yaml(config: Config) -> str:
    """Return the resolved configuration as YAML, every default written out."""
    return yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False, allow_unicode=True, width=120)
