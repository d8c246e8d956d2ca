"""Describe tables of sensor packages that are not installed, from what their files hold."""

import json
import re
import warnings
from collections.abc import Mapping
from pathlib import PurePath
from typing import Any

import pyarrow as pa
import pyarrow.fs as pafs
import pyarrow.parquet as pq

from mmw.config.sensor_spec import SENSORS
from mmw.storage.finding import one_line
from mmw.storage.table_spec import TableSpec

KEY = ("frame", "agent", "sensor")
"""Columns of the key of every sensor's table, where it has them."""


def spec_of_file(table: str, path: str, filesystem: pafs.FileSystem | None) -> TableSpec | None:
    """Return the specification of a table that one of its files gives; None if mmw has not written the file.

    Args:
        table: Name of the table, that of its folder.
        path: File, in `filesystem` where that is given.
        filesystem: None for local files.
    """
    place = filesystem or pafs.LocalFileSystem()
    try:
        with place.open_input_file(path) as file:
            schema = pq.read_schema(file)
        meta = schema.metadata or {}
        texts = _column_texts(meta)
    except (pa.ArrowException, OSError, ValueError) as error:
        warnings.warn(f"{path}: cannot be read ({one_line(error)}); table {table!r} is left out", stacklevel=4)
        return None
    if meta.get(b"mmw.table", b"").decode(errors="replace") != table or not re.fullmatch(r"[A-Za-z]\w*", table):
        return None
    fields = (pa.field(field.name, field.type, field.nullable, texts.get(field.name)) for field in schema)
    is_framed = "/weather=" in path
    key = tuple(name for name in KEY if name in schema.names)
    return TableSpec(table, "", tuple(fields), key, framed=is_framed)


def _column_texts(meta: Mapping[bytes, bytes]) -> dict[str, dict[str, str]]:
    """Return unit and meaning of each column, as a file holds them.

    Raises:
        ValueError: If they are damaged.
    """
    texts = json.loads(meta.get(b"mmw.columns", b"{}"))
    if not isinstance(texts, dict) or not all(
        isinstance(text, dict) and all(isinstance(value, str) for value in text.values()) for text in texts.values()
    ):
        raise ValueError("its key mmw.columns does not describe columns")
    return texts


def warn_of_missing_package(root: PurePath, table: str, info: Mapping[str, Any]) -> None:
    """Warn that the package that made a table is not installed, and name it.

    Args:
        root: The dataset.
        table: Name of the table.
        info: Content of `dataset.json`.
    """
    packages = info["versions"].get("sensors", {})  # sensor type -> distribution, of other packages
    sensors = info["config"].get("sensors", ())
    types = sorted({str(one["type"]) for one in sensors if isinstance(one, Mapping) and "type" in one} - set(SENSORS))
    lost = [f"{packages[type_]} (sensor {type_})" if type_ in packages else f"sensor {type_}" for type_ in types]
    named = f"the package of {', '.join(lost)}" if lost else "the package that made it"
    warnings.warn(
        f"{root}: table {table!r} is read as its files describe it; install {named} for its samples and figures",
        stacklevel=4,
    )
