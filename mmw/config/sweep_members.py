"""Expand a sweep into the configurations of its datasets, each with a name that is also its folder."""

import copy
import itertools
import json
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mmw.config.model import Config
from mmw.config.output import OutputConfig, folder_below
from mmw.config.overrides import set_value
from mmw.config.sweep import SweepConfig
from mmw.config.yaml_file import ConfigError, validated
from mmw.config.yaml_loader import short
from mmw.core.errors import InputError

_TEXT = re.compile(r"[A-Za-z0-9_.+-]{1,40}")
"""Values that are a part of a name as they are. No `=`: readers of Hive folders would take it for a column."""
_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+,-]{0,199}")
_RESERVED = ("name", "folder")
"""Columns of the index that no key may have."""


@dataclass(frozen=True)
class SweepMember:
    """One dataset of a sweep."""

    name: str
    """Name, and folder below that of the sweep."""
    values: Mapping[str, Any]
    """Dotted key -> value."""
    columns: Mapping[str, Any]
    """Short key -> value, or the value's name where it is no number or text: the columns of the index."""
    config: Config
    """Configuration, without the sweep."""

    @property
    def record(self) -> dict[str, Any]:
        """Record of the index."""
        return {"name": self.name, "folder": self.name, **self.columns}

    @property
    def provenance(self) -> dict[str, Any]:
        """Place in the sweep, as `dataset.json` of the dataset has it."""
        return {"name": self.name, "values": dict(self.values), "columns": dict(self.columns)}


@dataclass(frozen=True)
class _Value:
    """A key, its value, and the value's text in a name."""

    key: str
    value: Any
    text: str | None


def expand_sweep(data: Mapping[str, Any], sweep: SweepConfig, place: Path | str) -> tuple[SweepMember, ...]:
    """Return the datasets of a sweep: for each entry of `list` all combinations of `grid`, its last key fastest.

    Args:
        data: Content of the configuration file, overrides applied.
        sweep: Its section `sweep`.
        place: The file, or words for what is no file, for messages.

    Raises:
        ConfigError: If a name cannot be made or is made twice, a key leads nowhere, or a dataset's configuration is not
            valid; for the first such dataset.
    """
    labels = _labels([key for entry in sweep.list for key in entry if key != "name"] + list(sweep.grid))
    base = {key: value for key, value in data.items() if key != "sweep"}
    folder = output_dir(base)
    members: dict[str, SweepMember] = {}
    for given, listed, combined in _combinations(sweep):
        values = [*listed, *combined]
        try:
            name = _name(given, combined if given is not None else values, labels)
            if name.casefold() in members:  # some file systems take both for one folder
                raise InputError(f"two datasets are called {name!r}; give each a `name` of its own, or remove one")
            content = copy.deepcopy(base)
            for item in values:
                set_value(content, item.key, item.value)
            set_value(content, "output.dir", folder_below(folder, name))
        except InputError as error:
            raise ConfigError([f"{place}: sweep: {error}"]) from None
        try:
            config = validated(Config, content, f"{place}: sweep: dataset {name!r}")
        except ConfigError as error:
            raise ConfigError(error.problems[:1]) from None  # the other keys of the file are right
        columns = {labels[item.key]: _cell(item) for item in values}
        members[name.casefold()] = SweepMember(name, {item.key: item.value for item in values}, columns, config)
    return tuple(members.values())


def output_dir(data: Mapping[str, Any]) -> str:
    """Return `output.dir` of a configuration file's content."""
    output = data.get("output")
    given = output.get("dir") if isinstance(output, dict) else None
    return given or OutputConfig().dir


def _combinations(sweep: SweepConfig) -> Iterator[tuple[Any, list[_Value], list[_Value]]]:
    """Yield the given name of every dataset, its values of `list` and those of `grid`."""
    axes = [
        [_Value(key, value, str(name)) for name, value in values.items()]
        if isinstance(values, dict)
        else [_Value(key, value, _text(value)) for value in values]
        for key, values in sweep.grid.items()
    ]
    for entry in sweep.list or ({},):
        listed = [_Value(key, value, _text(value)) for key, value in entry.items() if key != "name"]
        for combined in itertools.product(*axes):
            yield entry.get("name"), listed, list(combined)


def _name(given: Any, values: Iterable[_Value], labels: Mapping[str, str]) -> str:
    """Return the name of a dataset: the given one, if any, then key and value of others.

    Raises:
        InputError: If it would be no name of a folder.
    """
    parts = [] if given is None else [str(given)]
    for item in values:
        if item.text is None:
            raise InputError(
                f"{item.key} = {short(item.value)} makes no name; write `grid` as {{{item.key}: {{NAME: VALUE}}}}, "
                "or give the entry of `list` a `name`"
            )
        parts.append(f"{labels[item.key]}-{item.text}")
    name = ",".join(parts)
    if not _NAME.fullmatch(name):
        raise InputError(
            f"{short(name, 80)} is no name of a folder; at most 200 letters, digits, `_`, `-`, `.`, `+` and `,` are "
            "needed; give a `name`, or write `grid` as {KEY: {NAME: VALUE}}"
        )
    return name


def _labels(keys: Iterable[str]) -> dict[str, str]:
    """Return a short name of each dotted key: its last parts, as many as tell it from the others."""
    known = list(dict.fromkeys(keys))
    labels = {}
    for key in known:
        parts = key.split(".")
        for first in range(len(parts) - 1, -1, -1):
            label = ".".join(parts[first:])
            is_shared = any(other != key and f".{other}".endswith(f".{label}") for other in known)
            if not (is_shared or label in _RESERVED or parts[first] == "*" or parts[first].isdecimal()):
                break
        labels[key] = label.replace("*", "all")
    return labels


def _text(value: Any) -> str | None:
    """Return a value as a part of a name; None if it has no short text."""
    if isinstance(value, list | tuple) and value and not any(isinstance(item, list | tuple | dict) for item in value):
        texts = [_text(item) for item in value]
        return None if None in texts else "+".join(map(str, texts))
    if isinstance(value, dict | list | tuple):
        return None
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    text = _number(value) if is_number else value if isinstance(value, str) else json.dumps(value)
    return text if _TEXT.fullmatch(text) else None


def _number(value: float) -> str:
    """Return a number as short as it can be: 28e9, 4.9e9, 20261126, 0.5."""
    large = [f"{value / 1e6:.12g}e6", f"{value / 1e9:.12g}e9"] if abs(value) >= 1e6 else []
    texts = [text for text in (f"{value:.12g}", *large) if text.count("e") < 2]
    return min((text for text in texts if float(text) == value), key=len, default=repr(value))


def _cell(item: _Value) -> Any:
    """Return a value for the index: numbers, text and truth values as they are, others by their name."""
    is_plain = item.value is None or isinstance(item.value, bool | int | float | str)
    return item.value if is_plain else item.text or short(item.value, 200)
