"""Turn values of Python code into the content of a configuration file: maps, lists, text, numbers and truth values."""

import os
from collections.abc import Mapping
from typing import Any

from pydantic import BaseModel

from mmw.config.validation_errors import key_text, tag_of
from mmw.config.yaml_loader import MAX_DEPTH, short
from mmw.core.errors import InputError


def file_content(value: Any, key: tuple[str | int, ...] = ()) -> Any:
    """Return a value as the shortest file content: of sections their `type` and the keys that are set.

    Values that depend on another key, such as a LiDAR's channels on its table of elevations, are not set. Nothing of
    the result is shared with the value.

    Args:
        value: Section, map, sequence, path, number, text, truth value, None, or an array of NumPy.
        key: Its place, for messages.

    Raises:
        InputError: If a file has no such value, or it is nested too deep.
    """
    if len(key) > MAX_DEPTH:
        raise InputError(f"{key_text(key[:3])}...: is nested more than {MAX_DEPTH} deep; no section is; shorten it")
    if value is None or isinstance(value, str | bool | int | float):
        return value
    if isinstance(value, BaseModel):
        fields = type(value).model_fields
        given = {
            field.alias or name: file_content(getattr(value, name), (*key, field.alias or name))
            for name, field in fields.items()
            if name in value.model_fields_set
        }
        return {"type": tag_of(type(value)), **given} if tag_of(type(value)) else given
    if isinstance(value, Mapping):
        return {_checked(name, key): file_content(item, (*key, name)) for name, item in value.items()}
    if isinstance(value, list | tuple):
        return [file_content(item, (*key, index)) for index, item in enumerate(value)]
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if hasattr(value, "tolist"):  # of NumPy: an array, or one of its numbers
        return file_content(value.tolist(), key)
    raise InputError(
        f"{key_text(key) or 'value'} = {short(value)}: is of type {type(value).__name__}; give text, numbers, truth "
        "values, lists, maps, or a section such as mmw.sensors.Lidar()"
    )


def _checked(name: Any, key: tuple[str | int, ...]) -> Any:
    """Return a key of a map, which is text or, as in YAML, a number."""
    if isinstance(name, str | int | float):
        return name
    where = f"{key_text(key)}: " if key else ""
    raise InputError(f"{where}the key {short(name)} is of type {type(name).__name__}; give text")
