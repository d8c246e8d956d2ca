"""Find the paths of input files in a configuration: the only place that knows which values are paths."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import UnionType
from typing import Annotated, Any, Union, get_args, get_origin

from pydantic import BaseModel

from mmw.config.section import InputFile
from mmw.config.sensor import SensorConfig
from mmw.config.sensor_spec import SENSORS


@dataclass(frozen=True)
class InputPlace:
    """A value of a configuration that is, or may be, the path of an input file."""

    holder: Any
    """Map or list that contains the value, so that it can be replaced."""
    key: str | int
    keys: tuple[str | int, ...]
    """Keys from the section where the search began."""
    is_declared: bool
    """Whether the section declares a path. Without, it is text of a key that other packages define, which is a path
    if there is such a file."""

    @property
    def value(self) -> str:
        """The path as written."""
        return self.holder[self.key]

    def replace(self, path: str) -> None:
        """Write another path."""
        self.holder[self.key] = path

    def __str__(self) -> str:
        return ".".join(map(str, self.keys))


def input_places(data: dict[str, Any], section: type[BaseModel]) -> Iterator[InputPlace]:
    """Yield all input paths in the content of a section, which may be a file's or a dumped configuration's.

    A path is a value whose field is an `InputPath` or a `pathlib.Path`. Content of the wrong shape has no paths.
    """
    yield from _in_section(data, section, ())


def _in_section(data: Mapping[str, Any], section: type[BaseModel], keys: tuple[str | int, ...]) -> Iterator[InputPlace]:
    for name, field in section.model_fields.items():
        key = field.alias or name
        if key in data:
            annotation = Annotated[(field.annotation, *field.metadata)] if field.metadata else field.annotation
            yield from _in_value(data, key, annotation, keys)


def _in_value(holder: Any, key: str | int, annotation: Any, keys: tuple[str | int, ...]) -> Iterator[InputPlace]:
    value, here, origin, arguments = holder[key], (*keys, key), get_origin(annotation), get_args(annotation)
    if origin is Annotated:
        marks = [mark for mark in arguments[1:] if isinstance(mark, InputFile)]
        if not marks:
            yield from _in_value(holder, key, arguments[0], keys)
        elif isinstance(value, str) and value.endswith(marks[0].suffixes or ("",)):
            yield InputPlace(holder, key, here, is_declared=True)
    elif origin in (Union, UnionType):
        for one in arguments:
            yield from _in_value(holder, key, one, keys)
    elif annotation is Any or (isinstance(annotation, type) and issubclass(annotation, Path)):
        if isinstance(value, str):
            yield InputPlace(holder, key, here, is_declared=annotation is not Any)
        elif isinstance(value, dict | list):
            for below in list(value) if isinstance(value, dict) else range(len(value)):
                yield from _in_value(value, below, annotation, here)
    elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
        kind = value.get("type") if isinstance(value, dict) and annotation is SensorConfig else None
        if isinstance(kind, str) and kind in SENSORS:
            yield from _in_section(value, SENSORS[kind].config, here)
        elif isinstance(value, dict) and annotation is not SensorConfig:
            yield from _in_section(value, annotation, here)
    elif isinstance(value, list):
        items = [one for one in arguments if one is not Ellipsis]
        for index in range(len(value)) if items else ():
            yield from _in_value(value, index, items[min(index, len(items) - 1)], here)
    elif isinstance(value, dict) and len(arguments) == 2:
        for below in list(value):
            yield from _in_value(value, below, arguments[1], here)
