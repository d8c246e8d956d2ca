"""Hugging Face Hub: plain Parquet files, one configuration per table, and a dataset card.

    OUT/README.md                                   dataset card: configurations, columns, provenance
    OUT/config.yaml, dataset.json                   configuration to generate it again, and its provenance
    OUT/rgb/town03_roundabout.sunny.000000.parquet  rows of 100 frames of one scenario in one weather
    OUT/path_geometry/town03_roundabout.000000.parquet  rows of 100 frames that are the same in every weather
    OUT/sensors/town03_roundabout.parquet           rows of a static table

    datasets.load_dataset(OUT, "rgb", split="train", streaming=True)

The view `paths` has no configuration: `path_gains` and `path_geometry` have one each, and join on the keys that both
have. Images are image features, lists are lists, names are strings; keys are columns, so no folder name matters. Files
are those of the dataset, byte for byte. Where frames or agents are picked, or a column of images is not nullable, which
`datasets` would show as dictionaries, rows are written again with the same encodings.

Losses: those of `FORMAT` below.

Source: Hugging Face documentation, "Repository cards" and "Manual configuration"; `datasets` 5.2.
"""

import json
import shutil
from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq
import yaml

from mmw.core.errors import InputError
from mmw.core.licenses import license_of
from mmw.dataset import Dataset
from mmw.dataset.export.export_folder import STATE
from mmw.dataset.export.exporter import Format, Option, Options, Part, Selection, Task, parts
from mmw.dataset.filesystem import read_text
from mmw.storage.arrow_tables import frame_rows
from mmw.storage.atomic_files import write_bytes_atomically
from mmw.storage.dataset_card import CARD, CONFIG, LICENSE, hub_license
from mmw.storage.finding import one_line
from mmw.storage.manifest import DATASET, read_markers
from mmw.storage.parquet_schema import write_options
from mmw.storage.schemas import column_text
from mmw.storage.table_spec import IMAGE, TableSpec

TAGS = ("wireless", "channel-state-information", "v2x", "lidar", "radar", "camera", "synthetic", "time-series")
"""Tags of the card."""
SIZES = (
    (1_000, "n<1K"), (10_000, "1K<n<10K"), (100_000, "10K<n<100K"), (1_000_000, "100K<n<1M"),
    (10_000_000, "1M<n<10M"), (100_000_000, "10M<n<100M"), (1_000_000_000, "100M<n<1B"),
)  # fmt: skip
"""Rows below which the Hub has a category, and its name."""


def tasks(dataset: Dataset, selection: Selection, options: Options) -> list[Task]:
    """Return one task a shard, one a scenario for its static tables, and one for the provenance.

    What is the same in every weather is a shard of its own, whose name has no weather.

    Raises:
        InputError: If nothing is left of the selection, the dataset is not in a local folder, or a file is missing.
    """
    if dataset.filesystem is not None:
        raise InputError(f"huggingface: {dataset.root} is no local folder; its files are copied; download it first")
    for marker in read_markers(dataset.root):
        for file in marker["files"]:
            if not (dataset.root / file["path"]).is_file():
                path = dataset.root / file["path"]
                raise InputError(f"{path}: is missing, but its shard was finished; run the configuration again")
    planned = [Task("provenance", partial(_write_provenance, dataset))]
    picked = parts(dataset, selection)
    for name in sorted({part.scenario for part in picked}):
        weathers = [part.weather for part in picked if part.scenario == name]
        frames = sorted({frame for part in picked if part.scenario == name for frame in part.frames})
        files = dict(_files(dataset, f"scenario={name}", framed=False))
        picks = {"weather": weathers if selection.weathers else None, "agent": selection.agents}
        planned.append(Task(name, partial(_write, dataset, files, name, picks)))
        planned += _shard_tasks(dataset, f"scenario={name}", frames, selection)
    for part in picked:
        planned += _shard_tasks(dataset, f"scenario={part.scenario}/weather={part.weather}", part.frames, selection)
    return planned


def _shard_tasks(dataset: Dataset, folder: str, frames: Sequence[int], selection: Selection) -> Iterable[Task]:
    """Yield a task for each shard in a folder of the tables with frames that has some of these."""
    picks = {"frame": frames if selection.frames is not None else None, "agent": selection.agents}
    shards: dict[str, dict[str, Path]] = {}
    for table, path in _files(dataset, folder, framed=True):
        shards.setdefault(path.stem.removeprefix("part-"), {})[table] = path
    names = [part.partition("=")[2] for part in folder.split("/")]
    for begin, after in pairwise([*sorted(shards), ""]):
        if any(int(begin) <= frame and (not after or frame < int(after)) for frame in frames):
            name = ".".join([*names, begin])
            yield Task(name, partial(_write, dataset, shards[begin], name, picks))


def _files(dataset: Dataset, folder: str, *, framed: bool) -> Iterable[tuple[str, Path]]:
    """Yield table and path of the published files in a folder of every table with frames, or of the others."""
    for table in (name for name in dataset.tables if dataset.spec(name).framed == framed):
        for path in map(Path, dataset.check_files(table)):
            if path.parent == dataset.root / table / folder:
                yield table, path


def _write_provenance(dataset: Dataset, out: Path) -> None:
    for name in (DATASET, CONFIG):
        if (dataset.root / name).is_file():
            shutil.copyfile(dataset.root / name, out / name)


def _write(
    dataset: Dataset, files: dict[str, Path], name: str, picks: Mapping[str, Sequence[Any] | None], out: Path
) -> None:
    """Write tables; rows with the picked values of those columns that are in a table's key, all if none is picked."""
    for table, path in files.items():
        spec = dataset.spec(table)
        own = {column: values for column, values in picks.items() if values and column in spec.key}
        _copy(spec, path, own, out / table / f"{name}.parquet")


def _copy(spec: TableSpec, path: Path, picks: Mapping[str, Sequence[Any]], target: Path) -> None:
    """Copy a file, or the rows whose columns have one of the picked values; nothing if no row is left."""
    schema = _read(path, pq.read_schema)
    loose = _with_nullable_images(schema)
    if not picks and loose.equals(schema):
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(path, target)
        return
    rows = _read(path, lambda file: pq.ParquetFile(file).read()).cast(loose)
    for column, values in picks.items():
        type_ = pa.int32() if column == "frame" else pa.string()
        rows = rows.filter(pc.is_in(rows[column].cast(type_), value_set=pa.array(list(values), type_)))
    if rows.num_rows:
        target.parent.mkdir(parents=True, exist_ok=True)
        frames = spec.frames_per_group
        group = max(frames * frame_rows(rows), 1) if frames else 65_536
        pq.write_table(rows, target, row_group_size=group, **write_options(spec))


def _read(path: Path, reader: Callable[[Path], Any]) -> Any:
    """Return the result of a reader.

    Raises:
        InputError: If it cannot read the file.
    """
    try:
        return reader(path)
    except (pa.ArrowException, OSError) as error:
        raise InputError(f"{path}: cannot be read ({one_line(error)}); `mmw verify` lists the damage") from error


def _with_nullable_images(schema: pa.Schema) -> pa.Schema:
    """Return a schema whose images may be null: `datasets` reads others as dictionaries of bytes and path."""
    fields = [field.with_nullable(True) if field.type.equals(IMAGE) else field for field in schema]
    return pa.schema(fields, metadata=schema.metadata)


def finish(dataset: Dataset, selection: Selection, out: Path) -> None:
    """Write the dataset card from the files in the folder."""
    counts: dict[str, dict[str, int]] = {}
    for table in dataset.tables:
        files = sorted((out / table).glob("*.parquet"))
        if files:
            rows = sum(pq.read_metadata(path).num_rows for path in files)
            counts[table] = {"rows": rows, "bytes": sum(path.stat().st_size for path in files)}
    options = json.loads((out / STATE).read_text(encoding="utf-8"))["options"]
    write_bytes_atomically(out / CARD, card(dataset, parts(dataset, selection), counts, options).encode())


def card(dataset: Dataset, picked: list[Part], counts: dict[str, dict[str, int]], options: Options) -> str:
    """Return the text of the dataset card for exported parts, with rows and bytes of each exported table."""
    info = dataset.info
    own = license_of(read_text(dataset.root, LICENSE, dataset.filesystem))
    license_id = options["license"] or (hub_license(own) if own else "")
    first = "rgb" if "rgb" in counts else next(iter(counts))
    head = {
        "pretty_name": options["title"],
        **({"license": license_id} if license_id else {}),
        "tags": list(TAGS),
        "size_categories": [_size(sum(count["rows"] for count in counts.values()))],
        "configs": [
            {
                "config_name": table,
                **({"default": True} if table == first else {}),
                "data_files": [{"split": "train", "path": f"{table}/*.parquet"}],
            }
            for table in counts
        ],
    }
    scenarios = sorted({part.scenario for part in picked})
    weathers = sorted({part.weather for part in picked})
    frames = {frame for part in picked for frame in part.frames}
    rates = sorted({dataset.frame_rate_hz(scenario) for scenario in scenarios})
    durations = " or ".join(f"1/{rate}" for rate in rates)
    versions = {name: info["versions"][name] for name in ("mmw", "git", "device") if info["versions"].get(name)}
    lines = [
        "---",
        yaml.safe_dump(head, sort_keys=False).rstrip(),
        "---",
        "",
        f"# {options['title']}",
        "",
        "Synthetic: radio channels, LiDAR, cameras, radar, inertial and satellite navigation samples and ground "
        "truth of connected vehicles and roadside units, traced in the same scenes at the same instants.",
        "",
        f"- scenarios: {', '.join(scenarios)}",
        f"- weathers: {', '.join(weathers)}",
        f"- frames {min(frames)} to {max(frames)}, {durations} s each",
        f"- agents: {', '.join(sorted({agent for part in picked for agent in part.agents}))}",
        "",
        "```python",
        "from datasets import load_dataset",
        "",
        f'rows = load_dataset("THIS_REPOSITORY", "{first}", split="train", streaming=True)',
        "```",
        "",
        "Stream it: without `streaming=True` everything is copied into a cache first. Tables join on the key columns "
        "that they share: scenario, weather, frame, agent, and on object_id. A path is a row of `path_geometry`, and "
        "one of `path_gains` for each weather and carrier.",
        "",
        "## Provenance",
        "",
        f"- schema version {info['schema_version']}, made {info['created_utc']}",
        f"- configuration SHA-256 `{info['config_sha256']}`; `{CONFIG}` makes the same rows again, `{DATASET}` has the "
        "versions and the hashes of the input files",
        *(f"- {name} {value}" for name, value in versions.items()),
        "",
        "## Tables",
        "",
        "| configuration | one row is | rows | MB |",
        "|---|---|---:|---:|",
        *(
            f"| {table} | {dataset.spec(table).doc} | {count['rows']:,} | {count['bytes'] / 1e6:,.1f} |"
            for table, count in counts.items()
        ),
    ]
    for table in counts:
        lines += ["", f"### {table}", "", "| column | unit | meaning |", "|---|---|---|"]
        for field in dataset.spec(table).columns:
            text = column_text(field)
            cells = (field.name, text.get("unit", ""), text.get("doc", ""))
            lines.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return "\n".join([*lines, ""])


def _size(rows: int) -> str:
    return next((name for limit, name in SIZES if rows < limit), "n>1B")


FORMAT = Format(
    name="huggingface",
    summary="folder for the Hugging Face Hub: Parquet with image features, one configuration a table, a dataset card",
    losses=(
        "every column is there; the USD stages and assets are omitted",
        "the folders scenario=... and weather=... are gone: filter by the columns of these names",
        "all rows are split `train`: leak-free splits are the user's choice",
    ),
    tasks=tasks,
    finish=finish,
    options=(
        Option("title", "Multimodal wireless dataset", "name on the card"),
        Option(
            "license",
            "",
            "license on the card, an identifier of the Hub such as cc-by-4.0; by default that of the data",
        ),
    ),
)
