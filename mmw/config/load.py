"""File + overrides -> Config. Every problem becomes one line that names the file, the key, the value and the cure."""

import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml
from pydantic import ValidationError

from mmw.config.explain import problem_line
from mmw.config.include import include_scenarios
from mmw.config.model import Config
from mmw.config.override import set_value


class ConfigError(ValueError):
    """A configuration that cannot be used; `problems` holds one line for each problem."""

    def __init__(self, problems: Sequence[str]) -> None:
        super().__init__("\n".join(problems))
        self.problems = list(problems)


class Loader(yaml.SafeLoader):
    """YAML as people read it: `28e9` is a number, `on` is a key and no boolean, a key given twice is an error."""


_BOOL, _TIMESTAMP = "tag:yaml.org,2002:bool", "tag:yaml.org,2002:timestamp"
Loader.yaml_implicit_resolvers = {
    first: [(tag, pattern) for tag, pattern in resolvers if tag not in (_BOOL, _TIMESTAMP)]
    for first, resolvers in yaml.SafeLoader.yaml_implicit_resolvers.items()
}
Loader.add_implicit_resolver(_BOOL, re.compile(r"^(?:true|True|TRUE|false|False|FALSE)$"), list("tTfF"))
Loader.add_implicit_resolver(
    "tag:yaml.org,2002:float",
    re.compile(r"^[-+]?(?:[0-9][0-9_]*)(?:\.[0-9_]*)?[eE][-+]?[0-9]+$"),
    list("-+0123456789"),
)


def _mapping(loader: Loader, node: yaml.MappingNode) -> dict[Any, Any]:
    keys = [loader.construct_object(key) for key, _ in node.value]
    for key in keys:
        if keys.count(key) > 1:
            raise yaml.constructor.ConstructorError(None, None, f"the key {key!r} is given twice", node.start_mark)
    return loader.construct_mapping(node, deep=True)


Loader.add_constructor(yaml.resolver.BaseResolver.DEFAULT_MAPPING_TAG, _mapping)


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
    data = _read(path)
    try:
        data = include_scenarios(data, path, _read)
    except ConfigError:
        raise
    except ValueError as error:
        raise ConfigError([f"{path}: {error}"]) from None
    for item in overrides:
        key, sign, text = item.partition("=")
        if not sign or not key:
            raise ConfigError([f"override {item!r}: write it as key=value, for example frames.count=10"])
        try:
            set_value(data, key, yaml.load(text, Loader=Loader))
        except yaml.YAMLError as error:
            raise ConfigError(
                [f"override {item!r}: the value is not valid YAML ({_reason(error)}); quote it, or close its brackets"]
            ) from None
        except ValueError as error:
            raise ConfigError([f"override {item!r}: {error}"]) from None
    for key, value in (patch or {}).items():
        try:
            set_value(data, key, value)
        except ValueError as error:
            raise ConfigError([f"option for {key}: {error}"]) from None
    try:
        # As JSON, strictly: lists become tuples, but the text "42" is no number and 1 is not true.
        return Config.model_validate_json(json.dumps(_whole(data), default=str), strict=True)
    except ValidationError as error:
        raise ConfigError([problem_line(path, item) for item in error.errors()]) from None


def _read(path: Path) -> dict[str, Any]:
    """Return the content of a configuration file."""
    try:
        data = yaml.load(path.read_text(encoding="utf-8"), Loader=Loader)
    except FileNotFoundError:
        raise ConfigError([f"{path}: no such file; give an existing YAML file"]) from None
    except (OSError, UnicodeDecodeError) as error:
        reason = error.strerror if isinstance(error, OSError) else "it is not UTF-8 text"
        raise ConfigError([f"{path}: cannot be read ({reason}); give a readable YAML file"]) from None
    except yaml.YAMLError as error:
        mark = getattr(error, "problem_mark", None)
        where = f"{path}:{mark.line + 1}:{mark.column + 1}" if mark else str(path)
        raise ConfigError([f"{where}: not valid YAML: {_reason(error)}; correct that line"]) from None
    if not isinstance(data, dict):
        kind = {"NoneType": "nothing", "str": "only text", "list": "a list"}.get(type(data).__name__, "no keys")
        raise ConfigError([f"{path}: holds {kind}; a mapping with the key `scenarios` is needed"])
    return data


def _reason(error: yaml.YAMLError) -> str:
    """Return what is wrong with a piece of YAML in one line."""
    return " ".join(str(getattr(error, "problem", None) or error).split())


def _whole(value: Any) -> Any:
    """Return a file's content with whole numbers as integers: `1e6` rays are a count too."""
    if isinstance(value, dict):
        return {key: _whole(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_whole(item) for item in value]
    return int(value) if isinstance(value, float) and value.is_integer() else value


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of the file format, for editors; `configs/mmw.schema.json` is its committed copy."""
    schema = Config.model_json_schema()
    items = schema["properties"]["scenarios"]
    path = {"type": "string", "description": "another configuration file, whose scenarios and frames are taken (path)"}
    items["items"] = {"anyOf": [items["items"], path]}
    return schema | {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "mmw configuration",
    }


def to_yaml(config: Config) -> str:
    """Return the resolved configuration as YAML, every default written out."""
    return yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False, allow_unicode=True, width=120)
