"""`sweep`: several datasets from one configuration file, and what makes them differ."""

from math import prod
from typing import Any

from pydantic import Field, model_validator

from mmw.config.section import Section
from mmw.core.errors import InputError

MAX_DATASETS = 1000
"""Datasets of one sweep; each has a folder with files of its own. Design value."""


class SweepConfig(Section):
    """Datasets that differ in some keys, by their dotted paths as in overrides: `scenarios.*.traffic.vehicle_count`."""

    grid: dict[str, Any] = Field(
        default_factory=dict,
        description="dotted key -> list of values, or map of names to values: a dataset for every combination (map)",
    )
    list: tuple[dict[str, Any], ...] = Field(
        default=(),
        description="a dataset for each entry: dotted key -> value, and its `name`; with `grid` too, for each entry "
        "and combination (list)",
    )

    @property
    def count(self) -> int:
        """Number of datasets."""
        return prod(len(values) for values in self.grid.values()) * max(len(self.list), 1)

    @model_validator(mode="after")
    def _makes_datasets(self) -> "SweepConfig":
        if not self.grid and not self.list:
            raise InputError("has neither `grid` nor `list`; give one, for example {grid: {seed: [1, 2, 3]}}")
        for key, values in self.grid.items():
            if not isinstance(values, tuple | list | dict):
                raise InputError(f"grid: {key} = {values!r} is one value; give a list, for example [{values}]")
            if not values:
                raise InputError(f"grid: {key} is an empty list, which makes no dataset; give at least one value")
        for index, entry in enumerate(self.list):
            if not entry.keys() - {"name"}:
                raise InputError(f"list: entry {index} changes no key; give it one, for example {{seed: {index + 1}}}")
        keys = {*self.grid, *(key for entry in self.list for key in entry)} - {"name"}
        for key in sorted(keys):
            first = key.partition(".")[0]
            if first in ("sweep", "output") and key not in ("output.shard_frames",):
                raise InputError(f"{key!r} cannot differ: the folder of each dataset has its name; remove the key")
        twice = sorted(self.grid.keys() & {key for entry in self.list for key in entry})
        if twice:
            raise InputError(f"{twice[0]!r} is in `grid` and in `list`; leave it in one of them")
        if self.count > MAX_DATASETS:
            raise InputError(
                f"makes {self.count:,} datasets; at most {MAX_DATASETS:,} are made; give fewer values, or use several "
                "files with a folder each"
            )
        return self
