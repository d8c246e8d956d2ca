"""Generate the page `docs/reference/tables.md` from the schemas."""

from collections.abc import Sequence

import pyarrow as pa

from mmw.storage.schemas import SCHEMA_VERSION, TABLES, column_text, views
from mmw.storage.table_spec import ViewSpec


def schema_markdown() -> str:
    """Return the documentation of every table, view and column."""
    stored = [field for spec in TABLES.values() for field in spec.columns]
    by_key: dict[tuple[str, ...], list[str]] = {}
    for spec in (*TABLES.values(), *views().values()):
        by_key.setdefault(spec.full_key, []).append(f"[{spec.name}](#{spec.name})")
    shared = _shared_columns()
    lines = [
        "# Tables",
        "",
        "Generated from `mmw/storage/schemas.py`: `MMW_UPDATE_GOLDEN=1 pytest tests/storage/test_tables.py`.",
        "",
        f"- Schema version: {SCHEMA_VERSION} ([compatibility](schema-versions.md)).",
        "- Units and frames: [Conventions](../concepts/conventions.md). Sensor models: [Sensors](../sensors/index.md).",
        "- Files: `TABLE/scenario=S/weather=W/part-FFFFFF.parquet`, with F the first frame of the file; tables without "
        "`frame` are in `TABLE/scenario=S/part-000000.parquet`, and those that are the same in every weather in "
        "`TABLE/scenario=S/part-FFFFFF.parquet`.",
        "- A view has no files: `mmw.open` and `mmw.connect` join it from its tables.",
        "- Rows are sorted by key. Tables join on shared key columns and on `object_id`.",
        "",
        "## Keys",
        "",
        "| key | tables |",
        "|---|---|",
        *(f"| {', '.join(key)} | {', '.join(tables)} |" for key, tables in by_key.items()),
        "",
        "Key columns of several tables, not repeated below:",
        "",
        *_column_rows(list(shared.values())),
    ]
    for spec in (*TABLES.values(), *views().values()):
        in_keys = [shared[name] for name in spec.full_key if name in shared]
        own = [f for f in spec.columns if not any(f.equals(key, check_metadata=True) for key in in_keys)]
        lines += ["", f"## {spec.name}", "", spec.doc, ""]
        if isinstance(spec, ViewSpec):
            tables = " and ".join(f"[{name}](#{name})" for name in spec.tables)
            lines += [f"A view of {tables}, whose columns have the same meaning here:", ""]
            lines += [", ".join(field.name for field in own if field in stored) + ".", ""]
            own = [field for field in own if field not in stored]
        lines += _column_rows(own)
    return "\n".join(lines) + "\n"


def _shared_columns() -> dict[str, pa.Field]:
    """Return the key columns that are equal in several tables, by name."""
    keys = [(spec.name, field) for spec in TABLES.values() for field in spec.columns if field.name in spec.full_key]
    return {
        field.name: field
        for table, field in keys
        if any(field.equals(other, check_metadata=True) for name, other in keys if name != table)
    }


def _column_rows(fields: Sequence[pa.Field]) -> list[str]:
    """Return a table of columns; consecutive columns whose meanings differ in one word, such as x, share a row."""
    groups: list[list[pa.Field]] = []
    for field in fields:
        if groups and _differing_word([*groups[-1], field]) is not None:
            groups[-1].append(field)
        else:
            groups.append([field])
    rows = [f"| {', '.join(f.name for f in group)} | {_type_name(group[0])} | {_meaning(group)} |" for group in groups]
    return ["| column | type | unit | meaning |", "|---|---|---|---|", *rows]


def _differing_word(group: Sequence[pa.Field]) -> int | None:
    """Return the position of the only word in which the meanings of columns of one type and unit differ."""
    if len({(_type_name(field), column_text(field).get("unit")) for field in group}) > 1:
        return None
    meanings = [column_text(field)["doc"].split() for field in group]
    if len({len(words) for words in meanings}) > 1:
        return None
    differing = [place for place, words in enumerate(zip(*meanings, strict=True)) if len(set(words)) > 1]
    return differing[0] if len(differing) == 1 else None


def _meaning(group: Sequence[pa.Field]) -> str:
    """Return unit and meaning of columns; the word in which they differ lists all of theirs."""
    text = column_text(group[0])
    words = text["doc"].split()
    if len(group) > 1:
        place = _differing_word(group)
        each = [column_text(field)["doc"].split()[place] for field in group]
        words[place] = "/".join([*(word.rstrip(",;") for word in each[:-1]), each[-1]])
    meaning = " ".join(words).replace("|", "\\|")
    return f"{text.get('unit', '')} | {meaning}"


def _type_name(field: pa.Field) -> str:
    kind = str(field.type)
    if kind.startswith("dictionary"):
        kind = "name"
    elif kind.startswith("struct"):
        kind = "image"
    elif kind.startswith("list"):
        kind = f"list of {field.type.value_type}"
    return f"{kind}, nullable" if field.nullable else kind
