"""The base of every section: unknown keys are errors, values never change after validation."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

Name = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_-]*$", max_length=64)]
"""A key of the dataset: letters, digits, `_` and `-`, because it becomes a folder name and a partition value."""

PrimName = Annotated[str, Field(pattern=r"^[A-Za-z][A-Za-z0-9_]*$", max_length=64)]
"""A name that becomes a USD prim: letters, digits and `_`."""

Vec3 = tuple[float, float, float]
"""Three numbers: x, y, z."""


class Section(BaseModel):
    """A section of the configuration file."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False, use_attribute_docstrings=False)
