"""Compare the schema version of a file with that of this mmw, and its columns with what readers need."""

from collections.abc import Iterator, Sequence

import pyarrow as pa

from mmw.core.errors import InputError
from mmw.storage.finding import Finding
from mmw.storage.schemas import SCHEMA_VERSION
from mmw.storage.table_spec import TableSpec

MAX_NAMES = 6
"""Columns that a message names."""


def version_number(text: str) -> tuple[int, int]:
    """Return the major and minor number of a schema version.

    Raises:
        InputError: If the text is not a version.
    """
    major, dot, minor = str(text).partition(".")
    if not (dot and major.isdecimal() and minor.isdecimal() and len(text) < 20):
        raise InputError(f"schema version {text!r} is not MAJOR.MINOR; the file is damaged or of another program")
    return int(major), int(minor)


def check_version(path: str, text: str) -> Iterator[Finding]:
    """Yield why a schema version is none that this mmw reads."""
    try:
        found, own = version_number(text), version_number(SCHEMA_VERSION)
    except InputError as error:
        yield Finding("schema", path, str(error))
        return
    if found > own:
        yield Finding("schema", path, f"schema {text} is newer than {SCHEMA_VERSION} of this mmw; update mmw")
    elif found[0] < own[0]:
        yield Finding("schema", path, f"schema {text} is older than {own[0]}.0; use the mmw that made it")


def schema_problem(found: pa.Schema, spec: TableSpec, columns: Sequence[str] | None = None) -> str:
    """Return why rows of a file cannot be read as those of a table, empty if they can.

    Columns that are not of the key may be missing from a file of another schema version, and types may differ in width:
    `mmw verify` is stricter.

    Args:
        found: Schema of the file.
        spec: The table.
        columns: Columns that are needed; None: those that the table has.
    """
    names = found.names
    twice = sorted({name for name in names if names.count(name) > 1})
    if twice:
        return f"has the column {_listed(twice)} twice"
    version = (found.metadata or {}).get(b"mmw.schema_version", b"").decode(errors="replace")
    known = {field.name: field.type for field in spec.columns}
    needed = columns or dict.fromkeys([*spec.key, *(known if version in ("", SCHEMA_VERSION) else ())])
    missing = [name for name in needed if name not in names]
    if missing:
        return f"has no column {_listed(missing)}"
    for name, type_ in known.items():
        if name in names and _kind(found.field(name).type) != _kind(type_):
            return f"column {name} holds {found.field(name).type}, not {_plain(type_)}"
    return ""


def _listed(names: list[str]) -> str:
    more = len(names) - MAX_NAMES
    return ", ".join(names[:MAX_NAMES]) + (f" and {more} more" if more > 0 else "")


def _plain(type_: pa.DataType) -> pa.DataType:
    """Return the type of the values of a dictionary; other types as they are."""
    return type_.value_type if pa.types.is_dictionary(type_) else type_


def _kind(type_: pa.DataType) -> object:
    """Return the kind of a type, the same for whole numbers and for floats of any width, and for text."""
    type_ = _plain(type_)
    is_kind = {
        "text": (pa.types.is_string, pa.types.is_large_string, pa.types.is_string_view),
        "bytes": (pa.types.is_binary, pa.types.is_large_binary, pa.types.is_binary_view),
        "whole number": (pa.types.is_integer,),
        "number": (pa.types.is_floating,),
    }
    for kind, tests in is_kind.items():
        if any(test(type_) for test in tests):
            return kind
    if pa.types.is_list(type_) or pa.types.is_large_list(type_):
        return "list", _kind(type_.value_type)
    if pa.types.is_struct(type_):
        return "struct", tuple((field.name, _kind(field.type)) for field in type_)
    return str(type_)
