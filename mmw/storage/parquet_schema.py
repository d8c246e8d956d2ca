"""Build the Arrow schema of a table with its file-level keys, and choose the encoding of every column."""

import json
from typing import Any

import pyarrow as pa

from mmw.core.remember import remembered
from mmw.storage.schemas import SCHEMA_VERSION, column_text, table_spec
from mmw.storage.table_spec import FRAME, IMAGE, TableSpec, ViewSpec, frame_column

RATE = "mmw.frame_rate_hz"
"""File-level key: frames a second, in files of other rates than 100 Hz."""


def arrow_schema(table: str | TableSpec | ViewSpec, meta: dict[str, str] | None = None) -> pa.Schema:
    """Return a table's Arrow schema with its file-level keys; the unit of `frame` is that of the rate in `meta`."""
    spec = table_spec(table) if isinstance(table, str) else table
    return _own_schema(spec) if meta is None else _schema(spec, meta)


@remembered()
def _own_schema(spec: TableSpec | ViewSpec) -> pa.Schema:
    return _schema(spec, {})


def _schema(spec: TableSpec | ViewSpec, meta: dict[str, str]) -> pa.Schema:
    own = spec.columns
    if RATE in meta:
        own = tuple(frame_column(meta[RATE]) if field.equals(FRAME) else field for field in own)
    columns = {field.name: column_text(field) for field in own}
    features = {field.name: _feature(field.type) for field in spec.columns}
    keys = {
        "mmw.schema_version": SCHEMA_VERSION,
        "mmw.table": spec.name,
        "mmw.columns": json.dumps(columns),
        "huggingface": json.dumps({"info": {"features": features}}),
    }
    return pa.schema(own, metadata={**keys, **meta})


_HF_TYPES = {"float": "float32", "double": "float64"}


def _feature(type_: pa.DataType) -> dict[str, Any]:
    """Return the Hugging Face feature of a type."""
    if pa.types.is_dictionary(type_):
        return {"dtype": "string", "_type": "Value"}
    if type_.equals(IMAGE):
        return {"_type": "Image"}
    if pa.types.is_list(type_):
        return {"feature": _feature(type_.value_type), "_type": "List"}
    return {"dtype": _HF_TYPES.get(str(type_), str(type_)), "_type": "Value"}


def write_options(table: str | TableSpec) -> dict[str, Any]:
    """Return the options of `pyarrow.parquet`: dictionaries for names and ids, split bytes for floats, zstd."""
    spec = table_spec(table) if isinstance(table, str) else table
    encoding: dict[str, str] = {}
    compression: dict[str, str] = {}
    dictionary: list[str] = []

    def visit(path: str, type_: pa.DataType) -> None:
        if pa.types.is_list(type_):
            visit(f"{path}.list.element", type_.value_type)
            return
        if type_.equals(IMAGE):
            compression.update({f"{path}.bytes": "none", f"{path}.path": "zstd"})
            return
        compression[path] = "zstd"
        if pa.types.is_dictionary(type_):
            dictionary.append(path)
        elif pa.types.is_floating(type_):
            encoding[path] = "BYTE_STREAM_SPLIT"
        elif pa.types.is_integer(type_) and ".list." not in path:
            encoding[path] = "DELTA_BINARY_PACKED"

    for field in spec.columns:
        visit(field.name, field.type)
    return {
        "use_dictionary": dictionary,
        "column_encoding": encoding,
        "compression": compression,
        "compression_level": {path: spec.level for path, codec in compression.items() if codec == "zstd"},
        "write_statistics": [field.name for field in spec.columns if not pa.types.is_nested(field.type)],
        "version": "2.6",
        "data_page_version": "1.0",
        "store_schema": True,
    }
