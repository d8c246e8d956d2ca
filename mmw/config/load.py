"""File + overrides -> Config. Every problem becomes one line that names the file, the key, the value and the cure."""

import difflib
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import yaml
from pydantic import BaseModel, ValidationError

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
        raise ConfigError([_problem(path, data, item) for item in error.errors()]) from None


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


def _problem(path: Path, data: Any, error: Any) -> str:
    location = [
        part for part in error["loc"] if part not in ("lidar", "depth", "imu") or _has(data, error["loc"], part)
    ]
    key = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in location).lstrip(".") or "the file"
    message = error["msg"].removeprefix("Value error, ")
    kind = error["type"]
    if kind == "extra_forbidden":
        known = _known_keys(location[:-1])
        near = difflib.get_close_matches(str(location[-1]), known, n=1)
        cure = f"did you mean `{near[0]}`?" if near else f"known keys here: {', '.join(known)}"
        return f"{path}: {key} = {_short(error['input'])}: unknown key; {cure}"
    if kind == "missing":
        return f"{path}: {key}: missing; add it ({_describe(location) or message})"
    found = "" if isinstance(error["input"], dict | list) else f" = {_short(error['input'])}"
    described = _describe(location)
    return f"{path}: {key}{found}: {message[0].lower() + message[1:]}" + (f"; {described}" if described else "")


def _has(data: Any, loc: tuple[Any, ...], tag: str) -> bool:
    """Whether `tag` is a key of the file rather than the name of a sensor type that pydantic puts into locations."""
    for part in loc[: loc.index(tag)]:
        try:
            data = data[part]
        except (KeyError, IndexError, TypeError):
            return False
    return isinstance(data, dict) and tag in data


def _section(location: Sequence[Any]) -> type[BaseModel] | None:
    from mmw.config import scenario, sensors
    from mmw.config.model import FramesConfig

    if not location:
        return Config
    head, rest = location[0], [part for part in location[1:] if not isinstance(part, int)]
    if head == "scenarios":
        inner = {"traffic": scenario.TrafficConfig, "rsus": scenario.RsuConfig}
        return inner.get(rest[0]) if rest else scenario.ScenarioConfig
    if head == "sensors":
        return sensors.MountConfig if rest else None
    simple = {"frames": FramesConfig} | {
        name: info.annotation for name, info in Config.model_fields.items() if name in ("channel", "output", "compute")
    }
    return simple.get(head) if not rest else None


def _known_keys(location: Sequence[Any]) -> list[str]:
    if location and location[0] == "sensors" and not [p for p in location[1:] if not isinstance(p, int)]:
        from mmw.config.sensors import DepthConfig, ImuConfig, LidarConfig

        return sorted({name for model in (LidarConfig, DepthConfig, ImuConfig) for name in model.model_fields})
    section = _section(location)
    return sorted(section.model_fields) if section else []


def _describe(location: Sequence[Any]) -> str:
    names = [part for part in location if isinstance(part, str)]
    section = _section(list(location[:-1])) if names else None
    field = section.model_fields.get(names[-1]) if section else None
    return (field.description or "") if field else ""


def _short(value: Any) -> str:
    text = json.dumps(value, default=str)
    return text if len(text) <= 60 else text[:57] + "..."


def json_schema() -> dict[str, Any]:
    """Return the JSON Schema of the file format, for editors; `configs/mmw.schema.json` is its committed copy."""
    return Config.model_json_schema() | {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "title": "mmw configuration",
    }


def to_yaml(config: Config) -> str:
    """Return the resolved configuration as YAML, every default written out."""
    return yaml.safe_dump(config.model_dump(mode="json"), sort_keys=False, allow_unicode=True, width=120)
