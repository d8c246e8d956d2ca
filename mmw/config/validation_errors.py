"""Validation errors of pydantic as one line each: file, key, value, and the remedy."""

import difflib
import json
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from mmw.config.sensor import SensorConfig
from mmw.config.sensor_spec import SENSORS

Key = tuple[str | int, ...]

_NEEDED = {
    "model_type": "a section of keys is needed; fill it, or remove the key to have its defaults",
    "model_attributes_type": "a section of keys is needed; fill it, or remove the key to have its defaults",
    "dict_type": "a map of keys and values is needed; fill it, or remove the key",
    "int_type": "a whole number is needed, without quotes",
    "int_from_float": "a whole number is needed",
    "float_type": "a number is needed, without quotes",
    "bool_type": "true or false is needed, without quotes",
    "string_type": "text is needed; put it in quotes if it looks like a number",
}
"""Messages that replace pydantic's words about Python types, by its error type."""


def problem_line(place: Path | str, error: ErrorDetails, root: type[BaseModel]) -> str:
    """Return one line for one error of a file whose content is a `root`, or of what `place` calls it."""
    is_key = error["loc"][-1:] == ("[key]",)  # pydantic's word for the key of a map
    models, key = _walk(error["loc"][:-1] if is_key else error["loc"], root)
    where = f"{place}: {key_text(key) or 'the file'}" if key or isinstance(place, Path) else place
    if error["type"] == "extra_forbidden":
        known = sorted({name for model in models for name in keys_of(model)})
        near = difflib.get_close_matches(str(key[-1]), known, n=1)
        cure = f"did you mean `{near[0]}`?" if near else f"known keys here: {', '.join(known)}"
        return f"{where} = {_short(error['input'])}: unknown key; {cure}"
    field = _field(models, key)
    described = (field.description if field else None) or ""
    if error["type"] == "missing" and not isinstance(key[-1], str):  # a tuple that is too short
        where, count = where.rpartition("[")[0], int(key[-1])
        return f"{where}: holds {count} or fewer values; more are needed" + (f"; {described}" if described else "")
    if error["type"] == "missing":
        return f"{where}: missing; add it" + (f" ({described})" if described else "")
    message = _NEEDED.get(error["type"]) or error["msg"].removeprefix("Value error, ")
    message = message.replace("Input should be", "must be")
    context = error.get("ctx", {})
    if error["type"] in ("tuple_type", "list_type"):
        example = "1, 2" if isinstance(error["input"], dict | list | None) else error["input"]
        message = f"a list is needed, such as [{example}]"
    if error["type"] == "string_pattern_mismatch":
        others = "`_` and `-`" if "_-" in str(context.get("pattern")) else "`_`"
        message = f"a name is needed: a letter, then letters, digits, {others}"
    if error["type"] == "too_long":
        has_limit = field is not None and any(hasattr(rule, "max_length") for rule in field.metadata)
        limit = f"{'at most ' * has_limit}{context.get('max_length')}"  # else as many as a point has, for example
        message = f"holds {context.get('actual_length')} values; {limit} are needed"
    if error["type"] == "union_tag_not_found":
        tags = [str(tag) for tag in map(tag_of, models) if tag]
        message = f"`type` is missing; say which sensor it is: {', '.join(tags[:-1])} or {tags[-1]}"
    if error["type"] == "union_tag_invalid":
        message = (
            f"type = {_short(context.get('tag'))} is unknown; one of {context.get('expected_tags')} is needed, or the "
            "package that adds it (entry point group mmw.sensors), or a call of mmw.register_sensor"
        )
    is_short = not (is_key or isinstance(error["input"], dict | list | tuple | BaseModel))
    found = f" = {_short(error['input'])}" if is_short else ""
    return f"{where}{found}: {message[0].lower() + message[1:]}" + (f"; {described}" if described else "")


def key_text(key: Sequence[str | int]) -> str:
    """Return a location in a configuration as text, such as `sensors[0].range_m`."""
    return "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in key).lstrip(".")


def _walk(location: Sequence[str | int], root: type[BaseModel]) -> tuple[list[type[BaseModel]], Key]:
    """Follow an error's location through the models.

    Pydantic puts the type of a sensor into the location, which is no key of the file; it is left out here.

    Returns:
        The models that may have the last key, and the location as the user wrote it.
    """
    models: list[type[BaseModel]] = [root]
    inside: list[type[BaseModel]] = [root]
    key: list[str | int] = []
    for part in location:
        tagged = [model for model in inside if tag_of(model) == part]
        if tagged and key and isinstance(key[-1], int):
            inside = tagged
            continue
        key.append(part)
        if isinstance(part, int):
            continue
        models = inside
        holders = [model for model in models if part in keys_of(model)]  # none: the part is the key of a map
        inside = [found for model in holders for found in models_in(model, str(part))] if holders else models
    return inside if inside and key and isinstance(key[-1], int) else models, tuple(key)


def keys_of(model: type[BaseModel]) -> dict[str, FieldInfo]:
    """Return the fields of a section by their keys in the file."""
    return {field.alias or name: field for name, field in model.model_fields.items()}


def tag_of(model: type[BaseModel]) -> Any:
    """Return the `type` that a section of a union is known by; None for other sections."""
    field = model.model_fields.get("type")
    return field.default if field else None


def models_in(model: type[BaseModel], name: str) -> Iterator[type[BaseModel]]:
    """Yield the sections of a field, also those in lists, maps and unions."""

    def find(annotation: Any) -> Iterator[type[BaseModel]]:
        if annotation is SensorConfig:
            yield from (spec.config for spec in SENSORS.values())
        elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
            yield annotation
        for argument in get_args(annotation):
            yield from find(argument)

    yield from find(keys_of(model)[name].annotation)


def _field(models: list[type[BaseModel]], key: Key) -> FieldInfo | None:
    names = [part for part in key if isinstance(part, str)]
    fields = [keys_of(model)[names[-1]] for model in models if names and names[-1] in keys_of(model)]
    return fields[0] if fields else None


def _short(value: Any) -> str:
    text = json.dumps(value, default=str)
    return text if len(text) <= 60 else text[:57] + "..."
