"""The base of every section: unknown keys are errors, values never change after validation."""

import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$", max_length=64)]
"""A key of the dataset: letters, digits, `_` and `-`, because it becomes a folder name and a partition value."""

PrimName = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=64)]
"""A name that becomes a USD prim: letters, digits and `_`."""

Vec3 = tuple[float, float, float]
"""Three numbers: x, y, z."""


@dataclass(frozen=True)
class InputFile:
    """Mark of a text field that is the path of a file which a run reads; see `mmw.config.input_paths`."""

    suffixes: tuple[str, ...] = ()
    """Endings by which a path is told from a name; every value is a path if empty."""


PathText = Annotated[str, BeforeValidator(lambda value: os.fspath(value) if isinstance(value, os.PathLike) else value)]
"""Path as text; Python code may give a path object."""

InputPath = Annotated[PathText, InputFile()]
"""Path of a file or folder that a run reads, relative to the configuration file's folder. Its content is a part of the
identity of the dataset."""


class Section(BaseModel):
    """A section of the configuration file."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, use_attribute_docstrings=False)

    if not TYPE_CHECKING:  # type checkers read the keys from the fields

        def __init__(self, /, **values: Any) -> None:
            """Validate the values of the keys.

            Raises:
                ConfigError: With one line for each problem.
            """
            try:
                super().__init__(**values)
            except ValidationError as error:
                from mmw.config.yaml_file import config_error

                raise config_error(error, type(self).__name__, type(self)) from None

        # Pydantic would call it for sections inside others too, whose errors are lines of the outermost one.
        __init__.__pydantic_base_init__ = True


def without_empty(data: dict[str, Any], *keys: str) -> dict[str, Any]:
    """Return the values of a section without those of some keys that are empty."""
    return {key: value for key, value in data.items() if value or key not in keys}
