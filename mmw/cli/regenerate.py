"""Generate single rows of a dataset again, from its stored configuration: `mmw regenerate`."""

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from mmw.cli.command import run_command
from mmw.core.errors import InputError

MAX_SHOWN = 6
"""Numbers of a list that are printed."""

SUFFIXES = (".parquet", ".jsonl", ".png", ".jpg")
"""Endings of --out."""


def main(argv: Sequence[str], prog: str = "mmw regenerate") -> int:
    """Run `mmw regenerate` and return its exit code: 0 done, 1 rows differ from the stored ones, 2 bad input."""
    parser = argparse.ArgumentParser(
        prog=prog,
        description="Generate rows of a table again, tracing only what they need, and print or write them.",
        epilog="Example: %(prog)s lidar out/quickstart frame=3 agent=cav_1 --compare. Scenario and weather may be left "
        "out where the dataset has one; what else is left out means all.",
    )
    parser.add_argument("table", help="table, such as lidar or rgb")
    parser.add_argument("dataset", help="dataset folder, or s3://bucket/folder")
    parser.add_argument(
        "key", nargs="*", metavar="key=value", help="scenario, weather, frame, agent, sensor, peer, carrier, ..."
    )
    parser.add_argument(
        "--out",
        type=Path,
        metavar="FILE",
        help="write the rows (.parquet, .jsonl) or the image of a row (.png, .jpg)",
    )
    parser.add_argument("--compare", action="store_true", help="compare the rows with the stored ones bit for bit")
    parser.add_argument("--device", default="auto", help="auto, cpu or cuda:N")
    return run_command(parser, _regenerate, argv, intermixed=True)


def _regenerate(arguments: argparse.Namespace) -> int:
    out: Path | None = arguments.out
    if out is not None and out.suffix not in SUFFIXES:
        raise InputError(f"--out {out}: the file must end in {', '.join(SUFFIXES)}; rename it")
    from mmw.core.device import machine_kind
    from mmw.generation.regenerate import RowRegenerator, differing_columns, machines, other_machine, stored_rows
    from mmw.storage.schemas import table_spec

    spec = table_spec(arguments.table)
    with RowRegenerator(arguments.dataset, arguments.device) as regenerator:
        key = parse_key(arguments.table, arguments.key)
        for name, names in (
            ("scenario", [scenario.name for scenario in regenerator.config.scenarios]),
            ("weather", list(regenerator.config.weathers)),
        ):
            if name in key or name not in spec.full_key:
                continue
            if len(names) == 1:
                key[name] = names[0]
            else:
                raise InputError(f"{name} is missing: the dataset has {', '.join(names)}; add {name}=NAME")
        made = regenerator.rows(arguments.table, **key)
    if arguments.compare:
        columns = differing_columns(made, stored_rows(arguments.dataset, arguments.table, key))
        print(f"{made.num_rows} rows differ in {', '.join(columns)}" if columns else f"{made.num_rows} rows are equal")
        now = machine_kind(regenerator.device)
        there = machines(arguments.dataset, key["scenario"], key.get("weather"), key.get("frame"))
        if columns and there != [now]:
            print(other_machine(" and ".join(there), now))
        return 1 if columns else 0
    if out is not None:
        write_rows(made, out)
        print(out)
        return 0
    for row in made.to_pylist():
        print("\n".join(f"{name}: {_shown(value)}" for name, value in row.items()), end="\n\n")
    print(f"{made.num_rows} rows of {arguments.table}")
    return 0


def parse_key(table: str, items: Sequence[str]) -> dict[str, Any]:
    """Return the values of `key=value` items, of the types of a table's columns.

    Raises:
        InputError: If an item is not key=value, no column of the table's key, or not of its type.
    """
    from mmw.storage.schemas import table_spec

    spec = table_spec(table)
    types = {column.name: column.type for column in spec.columns}
    known = spec.full_key
    found: dict[str, Any] = {}
    for item in items:
        name, sign, text = item.partition("=")
        if not sign or name not in known:
            raise InputError(f"{item!r}: the key of table {table} is {', '.join(known)}; write one as key=value")
        type_ = types.get(name, pa.string())
        try:
            found[name] = pa.scalar(text).cast(pa.string() if pa.types.is_dictionary(type_) else type_).as_py()
        except pa.ArrowInvalid as error:
            raise InputError(f"{item!r}: {name} holds {type_}; write such a value") from error
    return found


def write_rows(rows: pa.Table, out: Path) -> None:
    """Write rows as Parquet or as one JSON object a line, or the image of a single row as the file that it is.

    Raises:
        InputError: If an image is asked for and the rows do not hold exactly one of that kind.
    """
    out.parent.mkdir(parents=True, exist_ok=True)
    if out.suffix == ".parquet":
        pq.write_table(rows, out)
        return
    listed = rows.to_pylist()
    if out.suffix == ".jsonl":
        lines = [json.dumps({name: _plain(value) for name, value in row.items()}) for row in listed]
        out.write_text("".join(f"{line}\n" for line in lines))
        return
    images = [value for row in listed for value in row.values() if isinstance(value, dict) and "bytes" in value]
    if len(images) != 1:
        raise InputError(f"--out {out}: the rows hold {len(images)} images; one is needed; name agent and sensor")
    suffix = Path(images[0]["path"]).suffix.replace(".jpeg", ".jpg")
    if suffix != out.suffix:
        raise InputError(f"--out {out}: the image is a {suffix} file; end the name with that")
    out.write_bytes(images[0]["bytes"])


def _plain(value: Any) -> Any:
    """Return a value for JSON; of an image its name."""
    return value["path"] if isinstance(value, dict) and "bytes" in value else value


def _shown(value: Any) -> str:
    if isinstance(value, dict) and "bytes" in value:
        return f"{value['path']} ({len(value['bytes'])} bytes)"
    if isinstance(value, list) and len(value) > MAX_SHOWN:
        return f"[{', '.join(f'{item:.6g}' for item in value[:MAX_SHOWN])}, ...] ({len(value)})"
    return f"{value:.9g}" if isinstance(value, float) else str(value)
