"""The dataset folder as a whole: whose it is, what is still to make, and the list of what was made."""

import io
import json
import os
import shutil
from collections import defaultdict
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path, PurePath
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from mmw.tables.publish import FULL, OutOfSpaceError, publish_bytes
from mmw.tables.schemas import SCHEMA_VERSION, TABLES
from mmw.tables.writer import MARKERS, META_KEYS, ShardKey, marker_path
from mmw.temporary import is_temporary

DATASET = "dataset.json"
"""Whose folder it is: configuration, its hash, versions."""
HEAD_TYPES = {"schema_version": str, "config_sha256": str, "versions": dict, "config": dict}
"""What `dataset.json` must hold."""
MARKER_TYPES = {
    "scenario": str, "weather": str | None, "frame_begin": int | None, "frame_end": int | None,
    "schema_version": str, "config_sha256": str,
}  # fmt: skip
"""What a marker must hold, besides the list of its files."""
FILE_TYPES = {"table": str, "path": str, "rows": int, "bytes": int, "sha256": str}
"""What that list must hold of each."""
MANIFEST = "_manifest.parquet"
CARD = "README.md"
CONFIG = "config.yaml"
"""The resolved configuration as a file that `--config` takes again; written by whoever has it (`mmw.provenance`)."""
LOCKS = "_locks"
"""Folder of the locks (`mmw.tables.lock`); the underscore hides it from readers."""
FOLDERS = (MARKERS, *TABLES, "stages", "assets")
"""Folders that a run makes; `--overwrite` removes these and nothing else."""

_MANIFEST_SCHEMA = pa.schema(
    [
        ("table", pa.string()),
        ("scenario", pa.string()),
        ("weather", pa.string()),
        ("frame_begin", pa.int32()),
        ("frame_end", pa.int32()),
        ("path", pa.string()),
        ("rows", pa.int64()),
        ("bytes", pa.int64()),
        ("sha256", pa.string()),
        ("schema_version", pa.string()),
        *((name, pa.float64() if name == "seconds" else pa.string()) for name in META_KEYS),
        ("created_utc", pa.string()),
    ]
)


def prepare_root(
    root: Path, config_identity: Mapping[str, Any], config_sha256: str, versions: Mapping[str, Any], overwrite: bool
) -> None:
    """Make a dataset folder, or take up an unfinished one of the same configuration.

    A folder of another configuration without a finished shard, after a wrong first try for example, is taken over.

    Args:
        root: Dataset folder; made if it does not exist.
        config_identity: What decides the data (`Config.identity`).
        config_sha256: Its hash (`Config.sha256`).
        versions: What made it: versions of mmw and its libraries, asset hashes, device; stored, not compared.
        overwrite: Remove the data that is there, also another configuration's.

    Raises:
        ValueError: If the folder belongs to another configuration or schema version, holds something else, or cannot be
            made or written.
        OutOfSpaceError: If the disk is full.
    """
    root = Path(root)
    check_writable(root)
    if (root / DATASET).is_file():
        if overwrite or _is_other_and_empty(root, config_sha256):
            _remove_data(root)
        else:
            _check_same(root, config_identity, config_sha256)
            return
    elif root.is_dir():
        foreign = sorted(path.name for path in root.iterdir() if path.name != LOCKS and not is_temporary(path))
        if foreign:
            raise ValueError(
                f"{root}: holds {', '.join(foreign[:5])}{' and more' if len(foreign) > 5 else ''} but no {DATASET}; "
                "a dataset needs an empty or new folder; give another --out"
            )
    content = {
        "schema_version": SCHEMA_VERSION,
        "config_sha256": config_sha256,
        "versions": dict(versions),
        "created_utc": datetime.now(UTC).isoformat(timespec="seconds"),
        "config": dict(config_identity),
    }
    publish_bytes(root / DATASET, json.dumps(content, indent=1).encode())


def read_dataset(root: Path) -> dict[str, Any]:
    """Return a dataset's `dataset.json`.

    Raises:
        ValueError: If the folder is not a dataset, or the file is damaged or another program's.
    """
    path = Path(root) / DATASET
    try:
        data = path.read_bytes() if path.is_file() else None
    except OSError as error:
        raise ValueError(f"{path}: cannot be read ({error.strerror}); let yourself read it") from error
    return parse_dataset(data, Path(root))


def parse_dataset(data: bytes | None, root: PurePath) -> dict[str, Any]:
    """Return the content of a `dataset.json`.

    Args:
        data: The file's bytes; None if there is no such file.
        root: Its folder, for messages.

    Raises:
        ValueError: If there is none, or it is damaged or another program's.
    """
    if data is None:
        raise ValueError(f"{root}: has no {DATASET}; a dataset folder is needed; give the folder that mmw.run wrote")
    path = root / DATASET
    try:
        head = json.loads(data.decode("utf-8"))
    except ValueError as error:
        raise ValueError(f"{path}: {error}; the file is damaged; make the dataset again with --overwrite") from error
    missing = [key for key in HEAD_TYPES if not isinstance(head, dict) or key not in head]
    if missing:
        raise ValueError(f"{path}: has no {', '.join(missing)}; it is no mmw dataset's; give the folder of one")
    wrong = [key for key, type_ in HEAD_TYPES.items() if not isinstance(head[key], type_)]
    if wrong:
        raise ValueError(f"{path}: {', '.join(wrong)} cannot be understood; the file was changed; put the old one back")
    return head


def read_markers(root: Path) -> list[dict[str, Any]]:
    """Return every readable marker of a dataset, in the order of their names; damaged ones are left out."""
    markers = (_read_marker(path) for path in sorted((Path(root) / MARKERS).glob("*.json")))
    return [marker for marker in markers if marker is not None]


def pending_shards(root: Path, keys: Iterable[ShardKey]) -> list[ShardKey]:
    """Return the shards that have no valid marker: none of this configuration, or one whose files are not as it says.

    Only existence and size of the files are looked at; `verify` also reads them.
    """
    sha256 = read_dataset(root)["config_sha256"]
    return [key for key in keys if not _is_done(Path(root), key, sha256, (key.frame_begin, key.frame_end))]


def pending_scenarios(root: Path, names: Iterable[str]) -> list[str]:
    """Return the scenarios whose static tables have no valid marker."""
    sha256 = read_dataset(root)["config_sha256"]
    return [name for name in names if not _is_done(Path(root), name, sha256, (None, None))]


def finalize(root: Path) -> dict[str, Any]:
    """Write `_manifest.parquet` (one row a file) and the dataset card `README.md`, from the markers.

    Returns:
        `tables`: name -> {files, rows, bytes}; and the totals `files`, `rows`, `bytes`.
    """
    root = Path(root)
    head = read_dataset(root)
    rows = []
    for marker in read_markers(root):
        common = {name: marker.get(name) for name in _MANIFEST_SCHEMA.names if name in marker}
        rows += [{**common, **file} for file in marker["files"]]
    order = {name: index for index, name in enumerate(TABLES)}
    rows.sort(key=lambda row: (order[row["table"]], row["path"]))
    buffer = io.BytesIO()
    pq.write_table(pa.Table.from_pylist(rows, schema=_MANIFEST_SCHEMA), buffer, compression="zstd")
    publish_bytes(root / MANIFEST, buffer.getvalue())
    tables: dict[str, dict[str, int]] = defaultdict(lambda: {"files": 0, "rows": 0, "bytes": 0})
    for row in rows:
        entry = tables[row["table"]]
        entry["files"] += 1
        entry["rows"] += row["rows"]
        entry["bytes"] += row["bytes"]
    publish_bytes(root / CARD, dataset_card(head, tables).encode())
    totals = {name: sum(entry[name] for entry in tables.values()) for name in ("files", "rows", "bytes")}
    return {"tables": dict(tables), **totals}


def dataset_card(head: Mapping[str, Any], tables: Mapping[str, Mapping[str, int]]) -> str:
    """Return the text of the dataset card: one Hugging Face configuration a table, and a list of the tables."""
    lines = ["---", "configs:"]
    for name in tables:
        lines += [f"- config_name: {name}", f"  data_files: {name}/**/*.parquet"]
    lines += [
        "---",
        "",
        "# Multimodal wireless dataset",
        "",
        f"Made with mmw {head['versions'].get('mmw', '')}".rstrip() + f", schema {head['schema_version']}, "
        f"configuration `{head['config_sha256'][:12]}` (the whole of it is in `{DATASET}`; `{CONFIG}` makes it again).",
        "",
        "| table | one row is | rows | MB |",
        "|---|---|---:|---:|",
    ]
    lines += [
        f"| {name} | {TABLES[name].doc} | {t['rows']:,} | {t['bytes'] / 1e6:,.1f} |" for name, t in tables.items()
    ]
    lines += [
        "",
        "Every column has its unit and meaning in the files' `mmw.columns` key. Read with any Parquet reader, or:",
        "",
        "```python",
        "from mmw.dataset import connect",
        "",
        f'connect(".").sql("SELECT * FROM {next(iter(tables), "frames")} LIMIT 5")',
        "```",
        "",
    ]
    return "\n".join(lines)


def _read_marker(path: Path) -> dict[str, Any] | None:
    try:
        marker = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return None
    if not isinstance(marker, dict) or not isinstance(marker.get("files"), list):
        return None
    is_framed = marker.get("weather") is not None
    is_whole = (
        _fits(marker, MARKER_TYPES)
        and all(_fits(file, FILE_TYPES) for file in marker["files"])
        and all((marker[name] is not None) == is_framed for name in ("frame_begin", "frame_end"))
    )
    return marker if is_whole else None


def _fits(content: Any, types: Mapping[str, Any]) -> bool:
    """True if a value is a mapping whose keys hold what they should."""
    return isinstance(content, dict) and all(
        key in content and isinstance(content[key], type_) for key, type_ in types.items()
    )


def _is_done(root: Path, key: ShardKey | str, sha256: str, frames: tuple[int | None, int | None]) -> bool:
    marker = _read_marker(root / marker_path(key))
    if marker is None or marker["config_sha256"] != sha256 or marker["schema_version"] != SCHEMA_VERSION:
        return False
    if (marker["frame_begin"], marker["frame_end"]) != frames:
        return False
    paths = [(root / file["path"], file["bytes"]) for file in marker["files"]]
    return all(path.is_file() and path.stat().st_size == size for path, size in paths)


def _remove_data(root: Path) -> None:
    """Remove what a run makes but `dataset.json`: markers first, so that a kill on the way leaves no false claim."""
    for folder in (root / name for name in FOLDERS):
        if folder.is_dir():
            shutil.rmtree(folder)
    for name in (MANIFEST, CARD, CONFIG):
        (root / name).unlink(missing_ok=True)


def check_writable(root: Path) -> None:
    """Make a dataset folder if it does not exist.

    Raises:
        ValueError: If it cannot be made or written to.
        OutOfSpaceError: If the disk is full.
    """
    there = next(path for path in (root, *root.absolute().parents) if path.exists())
    if not there.is_dir():
        raise ValueError(f"{root}: {there} is a file; the dataset needs a folder; give another --out")
    if not os.access(there, os.W_OK | os.X_OK):
        raise ValueError(f"{root}: {there} cannot be written to; give another --out, or change its permissions")
    try:
        root.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        if error.errno in FULL:
            raise OutOfSpaceError(f"{root}: no space left to make it; free some space and run again") from error
        raise ValueError(f"{root}: cannot be made ({error.strerror}); give another --out") from error


def _is_other_and_empty(root: Path, sha256: str) -> bool:
    has_frames = any(marker["frame_begin"] is not None for marker in read_markers(root))
    return read_dataset(root)["config_sha256"] != sha256 and not has_frames


def _check_same(root: Path, identity: Mapping[str, Any], sha256: str) -> None:
    there = read_dataset(root)
    if there["schema_version"] != SCHEMA_VERSION:
        raise ValueError(
            f"{root}: has schema {there['schema_version']}; this version writes {SCHEMA_VERSION}; "
            "use --overwrite to replace the data, or another --out"
        )
    if there["config_sha256"] == sha256:
        return
    differences = config_differences(there["config"], identity)
    shown = "; ".join(differences[:6]) + (f"; and {len(differences) - 6} more" if len(differences) > 6 else "")
    raise ValueError(
        f"{root}: belongs to configuration {there['config_sha256'][:12]}, this one is {sha256[:12]}: {shown}; "
        "use --overwrite to replace the data, or another --out"
    )


def config_differences(old: Mapping[str, Any], new: Mapping[str, Any]) -> list[str]:
    """Return `key: old -> new` for every value in which two identities of configurations differ, sorted."""
    return sorted(_differences("", dict(old), json.loads(json.dumps(new))))


def _differences(where: str, old: Any, new: Any) -> list[str]:
    """Return `key: old -> new` for every leaf that differs."""
    if isinstance(old, dict) and isinstance(new, dict):
        keys = sorted(set(old) | set(new))
        return [text for key in keys for text in _differences(f"{where}.{key}", old.get(key), new.get(key))]
    if isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        return [text for i in range(len(old)) for text in _differences(f"{where}.{i}", old[i], new[i])]
    return [] if old == new else [f"{where.lstrip('.')}: {_short(old)} -> {_short(new)}"]


def _short(value: Any) -> str:
    text = json.dumps(value)
    return text if len(text) <= 40 else text[:37] + "..."
