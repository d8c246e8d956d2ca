"""File + overrides -> Config. Every problem becomes one line that names the file, the key, the value and the cure."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from mmw.config.explain import problem_line
from mmw.config.model import Config


class ConfigError(ValueError):
    """A configuration that cannot be used; `problems` holds one line for each problem."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("\n".join(problems))
        self.problems = list(problems)


class _Loader(yaml.SafeLoader):
    """YAML 1.1 as PyYAML reads it, except that `28e9` is a number and a key given twice is an error."""


_Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(?:[0-9][0-9_]*)(?:\.[0-9_]*)?[eE][-+]?[0-9]+$"),
    list("-+0123456789"),
)


def _mapping(loader: _Loader, node: yaml.MappingNode) -> dict[Any, Any]:
    keys = [loader.construct_object(key) for key, _ in node.value]
    for key in keys:
        if keys.count(key) > 1:
            raise yaml.constructor.ConstructorError(None, None, f"the key {key!r} is given twice", node.start_mark)
    return loader.construct_mapping(node, deep=True)


_Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)


def load_config(path: str | Path, overrides: Sequence[str] = (), patch: dict[str, Any] | None = None) -> Config:
    """Read, override and validate a configuration.

    Args:
        path: YAML file.
        overrides: `a.b=c` items applied in order; lists take a number (`sensors.0.range_m=80`), values are YAML.
        patch: Dotted key -> value, applied last (the command line's own options).

    Raises:
        ConfigError: If the file, an override or a value cannot be used.
    """
    path = Path(path)
    try:
        data = yaml.load(path.read_text(encoding="utf-8"), Loader=_Loader)
    except FileNotFoundError:
        raise ConfigError([f"{path}: no such file; give --config an existing YAML file"]) from None
    except (OSError, UnicodeDecodeError) as error:
        raise ConfigError([f"{path}: cannot be read ({error}); give --config a readable YAML file"]) from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"{path}:{mark.line + 1}:{mark.column + 1}" if mark else str(path)
        raise ConfigError([f"{where}: not valid YAML: {getattr(error, 'problem', error)}; correct that line"]) from None
    if not isinstance(data, dict):
        raise ConfigError([f"{path}: holds {type(data).__name__}; a mapping with the key `scenarios` is needed"])
    for item in overrides:
        key, sign, text = item.partition("=")
        if not sign or not key:
            raise ConfigError([f"override {item!r}: write it as key=value, for example frames.count=10"])
        try:
            value = yaml.load(text, Loader=_Loader)
        except yaml.YAMLError as error:
            raise ConfigError([f"override {item!r}: the value is not valid YAML ({error}); quote it"]) from None
        _set(data, key, value, f"override {item!r}")
    for key, value in (patch or {}).items():
        _set(data, key, value, f"option for {key}")
    try:
        return Config.model_validate(data)
    except ValidationError as error:
        raise ConfigError([problem_line(path, item) for item in error.errors()]) from None


def _set(data: Any, key: str, value: Any, where: str) -> None:
    parts = key.split(".")
    for depth, part in enumerate(parts):
        last = depth == len(parts) - 1
        here = ".".join(parts[:depth]) or "the file"
        if isinstance(data, list):
            if not part.isdigit() or int(part) >= len(data):
                raise ConfigError([f"{where}: {here} is a list of {len(data)}; index it with 0 to {len(data) - 1}"])
            if last:
                data[int(part)] = value
            else:
                data = data[int(part)]
        elif isinstance(data, dict):
            if last:
                data[part] = value
            else:
                if data.get(part) is None:
                    data[part] = {}
                data = data[part]
        else:
            raise ConfigError([f"{where}: {here} = {data!r} has no keys below it; check the key"])


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of the file format, for editors; `configs/mmw.schema.json` is its committed copy."""
    return Config.model_json_schema() | {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "mmw configuration",
    }


def to_yaml(config: Config) -> str:
    """Return the resolved configuration as YAML, every default written out."""
    return yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False, allow_unicode=True, width=120)
