"""Apply an `a.b=c` override of the command line to the content of a configuration file."""

import copy
from typing import Any

from pydantic import BaseModel
from pydantic_core import PydanticUndefined

from mmw.config.file_content import file_content
from mmw.config.model import Config
from mmw.config.scenario import ScenarioConfig
from mmw.config.validation_errors import models_in, tag_of
from mmw.config.yaml_loader import MAX_DEPTH, short
from mmw.core.errors import InputError

EVERY = "*"
"""Wildcard for every item of a list."""


def set_value(data: dict[str, Any], key: str, value: Any) -> None:
    """Replace one value of a configuration file's content, or one in every item of a list.

    An item of a list is named by its number or its `name`; `*` is every item: `scenarios.0.town`,
    `sensors.lidar.range_m`, `scenarios.*.traffic.warmup_s`. Missing sections are
    filled with their defaults first, so that `sensors.lidar.range_m=80` changes the default LiDAR.

    Raises:
        InputError: If the key does not lead anywhere.
    """
    parts = key.split(".")
    if len(parts) > MAX_DEPTH:
        raise InputError(f"the key has {len(parts)} parts; at most {MAX_DEPTH} are read; shorten it")
    if not all(parts):
        raise InputError("a part of the key is empty; write it as section.key=value, for example frames.count=10")
    if parts[0] not in Config.model_fields and parts[0] in ScenarioConfig.model_fields:
        raise InputError(f"{parts[0]!r} is a key of scenarios; write scenarios.{EVERY}.{key} for all, or a name for *")
    _set(data, parts, 0, [Config], value)


def _set(here: Any, parts: list[str], depth: int, models: list[type[BaseModel]], value: Any) -> None:
    """Replace the value at `parts[depth:]` below a place of the file, whose models are known."""
    part, is_last = parts[depth], depth == len(parts) - 1
    for place in _places(here, part, ".".join(parts[:depth]), models):
        if is_last:
            here[place] = copy.deepcopy(value)  # items of a list share nothing
            continue
        below = models
        if isinstance(here, dict):
            owners = [model for model in models if part in model.model_fields]
            if here.get(part) is None:
                here[part] = _default(owners, part)
            # Maps, such as `mount`, have keys of the user's own: the models stay those of their values.
            below = [found for model in owners for found in models_in(model, part)] or models
        inner = here[place]
        if isinstance(inner, dict):
            below = [model for model in below if tag_of(model) == inner.get("type", tag_of(model))] or below
        _set(inner, parts, depth + 1, below, value)


def _places(container: Any, part: str, where: str, models: list[type[BaseModel]]) -> list[int] | list[str]:
    """Return the numbers of the items of a list, or the key of a section, that a part of a key means."""
    if isinstance(container, dict):
        return [part]
    if not isinstance(container, list):
        raise InputError(f"{where} = {short(container)} has no keys below it; check the key")
    if part == EVERY and container:
        return list(range(len(container)))
    if part.isdecimal() and len(part) < 10 and int(part) < len(container):
        return [int(part)]
    names = [_name(item, models) for item in container]
    if names.count(part) == 1:
        return [names.index(part)]
    if part in names:
        raise InputError(f"{where} holds {part!r} {names.count(part)} times; give its number, from 0, or name them")
    if not container:
        raise InputError(f"{where} is a list of 0; give the whole list")
    known = [name for name in dict.fromkeys(names) if name]
    raise InputError(
        f"{where} is a list of {len(container)}; index it with 0 to {len(container) - 1}"
        + (f", a name ({', '.join(known)})" if known else "")
        + f" or {EVERY} for all"
    )


def _name(item: Any, models: list[type[BaseModel]]) -> str | None:
    """Return the name of an item of a list, that of its model if it has none of its own; None without either."""
    if not isinstance(item, dict):
        return None
    fields = [model.model_fields for model in models if tag_of(model) == item.get("type", tag_of(model))]
    defaults = [known["name"].default for known in fields if "name" in known]
    name = item.get("name", *defaults[:1])
    return name if isinstance(name, str) else None  # a file may contain anything


def _default(owners: list[type[BaseModel]], name: str) -> Any:
    """Return the default of a key as file content; an empty section for a required one."""
    for owner in owners:
        default = owner.model_fields[name].get_default(call_default_factory=True)
        if default is not PydanticUndefined and default is not None:
            return file_content(default)
    return {}
