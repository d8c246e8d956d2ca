"""`a.b=c` on the command line: one value of the file replaced, defaults that the file leaves out included."""

from typing import Any

from pydantic import BaseModel
from pydantic_core import PydanticUndefined, to_jsonable_python

from mmw.config.explain import models_in, tag_of
from mmw.config.model import Config


def set_value(data: dict[str, Any], key: str, value: Any) -> None:
    """Replace one value of a configuration file's content.

    Lists take a number. Where the file leaves out something on the way, its default is put there first, so that
    `sensors.0.range_m=80` changes the first default sensor.

    Args:
        data: Content of the file; changed in place.
        key: Dotted key.
        value: The new value.

    Raises:
        ValueError: If the key does not lead anywhere.
    """
    *way, last = parts = key.split(".")
    if not all(parts):
        raise ValueError("a part of the key is empty; write it as section.key=value, for example frames.count=10")
    here: Any = data
    models: list[type[BaseModel]] = [Config]
    for depth, part in enumerate(way):
        place = _place(here, part, ".".join(way[:depth]))
        if isinstance(here, dict):
            owners = [model for model in models if part in model.model_fields]
            if here.get(part) is None:
                here[part] = _default(owners, part)
            # Maps, such as `mount`, have keys of the user's own: the models stay those of their values.
            models = [found for model in owners for found in models_in(model, part)] or models
        here = here[place]
        if isinstance(here, dict):
            models = [model for model in models if tag_of(model) == here.get("type", tag_of(model))] or models
    here[_place(here, last, ".".join(way))] = value


def _place(container: Any, part: str, where: str) -> int | str:
    if isinstance(container, list):
        if not part.isdigit() or int(part) >= len(container):
            span = f"index it with 0 to {len(container) - 1}" if container else "give the whole list"
            raise ValueError(f"{where} is a list of {len(container)}; {span}")
        return int(part)
    if not isinstance(container, dict):
        raise ValueError(f"{where} = {container!r} has no keys below it; check the key")
    return part


def _default(owners: list[type[BaseModel]], name: str) -> Any:
    """Return what a key has if the file leaves it out, as a file says it; an empty section where it must be given."""
    for owner in owners:
        default = owner.model_fields[name].get_default(call_default_factory=True)
        if default is not PydanticUndefined and default is not None:
            return _as_file(default)
    return {}


def _as_file(value: Any) -> Any:
    """Return a value as the shortest file that gives it: of sections what is set, and their `type`.

    What depends on another key, such as a LiDAR's channels on its table of elevations, is then still free.
    """
    if isinstance(value, BaseModel):
        given = {
            name: _as_file(getattr(value, name)) for name in type(value).model_fields if name in value.model_fields_set
        }
        return {"type": tag_of(type(value)), **given} if tag_of(type(value)) else given
    if isinstance(value, dict):
        return {key: _as_file(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_as_file(item) for item in value]
    return to_jsonable_python(value)
