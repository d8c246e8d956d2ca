"""Generate the page `docs/reference/tables.md` from the schemas."""

import pyarrow as pa

from mmw.storage.schemas import SCHEMA_VERSION, TABLES, column_text


def schema_markdown() -> str:
    """Return the documentation of every table and column."""
    lines = [
        "# Tables",
        "",
        "This page is made from `mmw/storage/schemas.py` by `mmw.storage.schema_docs.schema_markdown`; "
        "`MMW_UPDATE_GOLDEN=1 pytest tests/storage/test_tables.py` writes it again.",
        "",
        f"Schema version {SCHEMA_VERSION}. World frame: x east, y north, z up; metres, seconds, radians. Zenith angles "
        "are from +z, azimuths from +x counter-clockwise. An agent's and a sensor's frame is x forward, y left, z up. "
        "`agent` owns a row and is the receiver of `links` and `paths`; `peer` is the transmitter. What each sensor's "
        "columns mean: [Sensors](../sensors/index.md).",
        "",
        "Tables with frames are in `TABLE/scenario=S/weather=W/part-FFFFFF.parquet` (F = first frame of the file), the "
        "others in `TABLE/scenario=S/part-000000.parquet`. Rows are sorted by the key. All tables join on the key "
        "columns that they share, and on `object_id`.",
        "",
        "| table | one row is | key |",
        "|---|---|---|",
    ]
    for spec in TABLES.values():
        partition = ["scenario", "weather"] if spec.framed else ["scenario"]
        lines.append(f"| [{spec.name}](#{spec.name}) | {spec.doc} | {', '.join([*partition, *spec.key])} |")
    for spec in TABLES.values():
        lines += ["", f"## {spec.name}", "", spec.doc, "", "| column | type | unit | meaning |", "|---|---|---|---|"]
        for field in spec.columns:
            text = column_text(field)
            meaning = text["doc"].replace("|", "\\|")
            lines.append(f"| {field.name} | {_type_name(field)} | {text.get('unit', '')} | {meaning} |")
    return "\n".join(lines) + "\n"


def _type_name(field: pa.Field) -> str:
    kind = str(field.type)
    if kind.startswith("dictionary"):
        kind = "name"
    elif kind.startswith("struct"):
        kind = "image"
    elif kind.startswith("list"):
        kind = f"list of {field.type.value_type}"
    return f"{kind}, nullable" if field.nullable else kind
