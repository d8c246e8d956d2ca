"""Load a configuration from a file and overrides; each problem is one line with file, key, value and remedy."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import yaml

from mmw.config.include import include_scenarios
from mmw.config.model import Config
from mmw.config.overrides import set_value
from mmw.config.sensors import add_sensor_schemas
from mmw.config.shipped import config_path
from mmw.config.yaml_file import ConfigError, read_yaml, reason_of, validated
from mmw.config.yaml_loader import parse_yaml, short
from mmw.core.errors import InputError

_NEEDED = "a mapping with the key `scenarios`"


def load_config(path: str | Path, overrides: Sequence[str] = (), patch: dict[str, Any] | None = None) -> Config:
    """Read a configuration, apply `a.b=c` overrides, then the options of `patch` by dotted key, and validate it.

    Raises:
        ConfigError: If the file, an override or a value cannot be used.

    Examples:
        >>> config = load_config("quickstart", ["frames.count=50", "weathers=[sunny, rainy]"])
        >>> config.frames.count, config.weathers, config.scenarios[0].name
        (50, ('sunny', 'rainy'), 'town03_roundabout')
    """
    path = config_path(path)
    data = _read(path)
    with _located(str(path)):
        data = include_scenarios(data, path, _read)
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
            set_value(data, key, value)
    return validated(Config, data, path)


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
