"""The base of every section: unknown keys are errors, values never change after validation."""

from dataclasses import dataclass
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

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


InputPath = Annotated[str, InputFile()]
"""Path of a file or folder that a run reads, relative to the configuration file's folder. Its content is a part of the
identity of the dataset."""


class Section(BaseModel):
    """A section of the configuration file."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, use_attribute_docstrings=False)
