"""Manage a dataset as a whole: its identity, its pending work, and the list of its files."""

import io
import json
from collections import defaultdict
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from pathlib import Path, PurePosixPath
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from mmw.core.errors import InputError
from mmw.core.frame_rate import FRAME_RATES
from mmw.core.licenses import license_of
from mmw.core.temp_files import is_temporary
from mmw.storage.atomic_files import StoreError
from mmw.storage.dataset_card import CARD, CONFIG, LICENSE, NOTICE, dataset_card
from mmw.storage.foreign_files import check_foreign_files
from mmw.storage.identity import changed_inputs, check_same, inputs_sha256, is_hashes, is_of
from mmw.storage.schemas import SCHEMA_VERSION, TABLES, views
from mmw.storage.shard_writer import MARKERS, META_KEYS, SHARD_DOTS, ShardKey, key_of, marker_path
from mmw.storage.store import DATASET, LOCKS, MANIFEST, Root, Store, store_of
from mmw.storage.sweep_index import dataset_roots

HEAD_TYPES = {"schema_version": str, "config_sha256": str, "versions": dict, "config": dict}
"""Required content of `dataset.json`."""
MARKER_TYPES = {
    "scenario": str, "weather": str | None, "frame_begin": int | None, "frame_end": int | None,
    "schema_version": str, "config_sha256": str,
}  # fmt: skip
"""Required content of a marker, besides the list of its files."""
FILE_TYPES = {"table": str, "path": str, "rows": int, "bytes": int, "sha256": str}
"""Required content of each entry of that list."""
MAX_NUMBER, MAX_FRAME = 2**63, 2**31 - 1
"""Limits of whole numbers in a manifest."""
_META_TYPES = {"seconds": int | float, "frame_rate_hz": int}
"""Metadata of a marker that is no text."""

_NUMBERS = {
    "frame_begin": pa.int32(), "frame_end": pa.int32(), "rows": pa.int64(), "bytes": pa.int64(),
    "seconds": pa.float64(), "frame_rate_hz": pa.int32(),
}  # fmt: skip
_COLUMNS = (
    "table", "scenario", "weather", "frame_begin", "frame_end", "path", "rows", "bytes", "sha256", "schema_version",
    *META_KEYS, "created_utc",
)  # fmt: skip
_MANIFEST_SCHEMA = pa.schema([(name, _NUMBERS.get(name, pa.string())) for name in _COLUMNS])


def folders() -> tuple[str, ...]:
    """Return the folders that a run creates; `--overwrite` removes only these. Older mmw stored views as tables."""
    return (MARKERS, *TABLES, *views(), "stages", "assets")


def prepare_root(
    root: Root,
    config_identity: Mapping[str, Any],
    config_sha256: str,
    versions: Mapping[str, Any],
    overwrite: bool,
    inputs: Mapping[str, Mapping[str, str]] | None = None,
    frame_rates_hz: Mapping[str, int] | None = None,
    sweep: Mapping[str, Any] | None = None,
) -> None:
    """Start a dataset, or resume an unfinished one of the same configuration and input files.

    A dataset of another configuration or other input files without a finished shard, such as after a failed first run,
    is replaced. Versions are stored, not compared.

    Args:
        root: Dataset.
        config_identity: What decides the data, see `Config.identity`.
        config_sha256: Its hash.
        versions: Versions of the software.
        overwrite: Whether data of another configuration is removed.
        inputs: Hashes of the input files, see `mmw.scene.input_files`; not compared if absent here or in the dataset.
        frame_rates_hz: Scenario -> frames a second, for readers.
        sweep: What a sweep says about this one of its datasets: `name`, `values`, `columns`.

    Raises:
        InputError: If the store has data of another configuration, of other input files or of another schema version,
            contains other files, or cannot be created, reached or written.
        OutOfSpaceError: If the disk is full.
    """
    store = store_of(root)
    store.check_writable()
    found = store.top_level_names()  # once: another part may start the dataset meanwhile
    if DATASET not in found:
        foreign = [name for name in found if name != LOCKS and not is_temporary(Path(name))]
        if foreign:
            raise InputError(
                f"{store}: has {', '.join(foreign[:5])}{' and more' if len(foreign) > 5 else ''} but no {DATASET}; "
                "a dataset needs an empty or new folder; give another --out"
            )
    elif overwrite or _is_other_and_empty(store, config_sha256, inputs):
        store.remove(
            (*folders(), MANIFEST, CARD, CONFIG, LICENSE, NOTICE)
        )  # markers first, so that a kill leaves no false marker
    else:
        check_same(store, read_dataset(store), config_identity, config_sha256, inputs)
        _start_writing(store, None)
        return
    content = {
        "schema_version": SCHEMA_VERSION,
        "config_sha256": config_sha256,
        **({} if inputs is None else {"inputs_sha256": inputs_sha256(inputs), "inputs": inputs}),
        "versions": dict(versions),
        "created_utc": datetime.now(UTC).isoformat(timespec="seconds"),
        **({} if frame_rates_hz is None else {"frame_rates_hz": dict(frame_rates_hz)}),
        "config": dict(config_identity),
        **({} if sweep is None else {"sweep": dict(sweep)}),
    }
    _start_writing(store, json.dumps(content, indent=1).encode())


def _start_writing(store: Store, head: bytes | None) -> None:
    try:
        store.start_writing(head)
    except StoreError as error:
        raise InputError(str(error)) from error


def read_dataset(root: Root) -> dict[str, Any]:
    """Return a dataset's `dataset.json`.

    Raises:
        InputError: If there is no dataset, or the file is damaged or another program's.
    """
    store = store_of(root)
    head = _read_head(store)
    if head is None and (datasets := dataset_roots(store)):
        raise InputError(
            f"{store.location()}: is a sweep of {len(datasets)} datasets; give the folder of one, such as "
            f"{next(iter(datasets.values()))}"
        )
    return parse_dataset(head, store.location())


def _read_head(store: Store) -> bytes | None:
    try:
        return store.read(DATASET)
    except OSError as error:
        raise InputError(
            f"{store.location(DATASET)}: cannot be read ({error.strerror}); change its permissions"
        ) from error
    except StoreError as error:
        raise InputError(str(error)) from error


def parse_dataset(data: bytes | None, root: object) -> dict[str, Any]:
    """Return the content of a `dataset.json`.

    Raises:
        InputError: If there is none, or it is damaged or another program's.
    """
    if data is None:
        raise InputError(f"{root}: has no {DATASET}; a dataset folder is needed; give the folder that mmw.run wrote")
    path = f"{root}/{DATASET}"
    try:
        head = json.loads(data.decode("utf-8"))
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: {error}; the file is damaged; make the dataset again with --overwrite") from error
    missing = [key for key in HEAD_TYPES if not isinstance(head, dict) or key not in head]
    if missing:
        raise InputError(f"{path}: has no {', '.join(missing)}; it is no mmw dataset's; give the folder of one")
    wrong = [key for key, type_ in HEAD_TYPES.items() if not isinstance(head[key], type_)]
    if "inputs" in head and not (is_hashes(head["inputs"]) and isinstance(head.get("inputs_sha256"), str)):
        wrong.append("inputs")
    versions = head["versions"] if isinstance(head["versions"], dict) else {}
    if not is_hashes({"packages": versions.get("packages", {})}) or not is_hashes(versions.get("sources", {})):
        wrong.append("versions")
    if any(rate not in FRAME_RATES for rate in frame_rates(head).values()):
        wrong.append("frame_rates_hz")
    if wrong:
        raise InputError(f"{path}: {', '.join(wrong)} cannot be understood; the file was changed; put the old one back")
    return head


def frame_rates(head: Mapping[str, Any]) -> dict[str, int]:
    """Return scenario -> frames a second, of a `dataset.json`; a dataset of before there were rates has none."""
    rates = head.get("frame_rates_hz", {})
    return rates if isinstance(rates, dict) else {"": 0}  # no rate


def read_markers(root: Root) -> list[dict[str, Any]]:
    """Return every marker of a dataset, sorted by name; damaged ones are skipped, see `named_markers`."""
    return list(named_markers(store_of(root)).values())


def named_markers(
    store: Store, names: Iterable[str] | None = None, *, skip_unreadable: bool = False
) -> dict[str, dict[str, Any]]:
    """Return markers of a dataset by the names of their files, all, sorted, if no names are given; no damaged ones.

    Raises:
        OSError: If a file cannot be read, unless `skip_unreadable`.
    """
    if names is None:
        names = [name for name in store.names(MARKERS) if name.endswith(".json")]
    return _markers(store, names, skip_unreadable=skip_unreadable)


def pending(root: Root, keys: Iterable[ShardKey | str]) -> list[ShardKey | str]:
    """Return the shards and scenarios without a valid marker of this configuration.

    A marker is valid if its files exist with their sizes; `verify` also reads them.

    Raises:
        OSError: If a marker cannot be read.
    """
    store, keys = store_of(root), list(keys)
    done = _finished(store, keys, read_dataset(store))
    return [key for key in keys if key not in done]


def pending_shards(root: Root, keys: Iterable[ShardKey]) -> list[ShardKey]:
    """Return the shards that have no valid marker, see `pending`."""
    return [key for key in pending(root, keys) if isinstance(key, ShardKey)]


def pending_scenarios(root: Root, names: Iterable[str]) -> list[str]:
    """Return the scenarios whose static tables have no valid marker, see `pending`."""
    return [name for name in pending(root, names) if isinstance(name, str)]


def upload_finished(root: Root, keys: Iterable[ShardKey]) -> int:
    """Upload shards that an earlier run finished on this machine and could not upload.

    Returns:
        Number of uploaded shards; 0 if the dataset is local.

    Raises:
        StoreError: If the store cannot be reached or refuses.
    """
    store = store_of(root)
    found = _finished(Store(store.folder), list(keys), read_dataset(store))
    for key, marker in found.items():
        store.upload([file["path"] for file in marker["files"]], marker_path(key).as_posix(), remove_local=True)
    return len(found)


def finalize(root: Root, plan: Iterable[ShardKey | str] | None = None) -> dict[str, Any]:
    """Write `_manifest.parquet` (one row per file) and the dataset card `README.md`, from the markers.

    Args:
        root: Dataset.
        plan: All its shards and scenarios, if they are finished: then no other file may be in its tables.

    Returns:
        `tables`: name -> {files, rows, bytes}; and the totals `files`, `rows`, `bytes`.

    Raises:
        InputError: If there is one.
    """
    store = store_of(root)
    head, markers = read_dataset(store), read_markers(store)
    manifest = manifest_rows(markers)
    if plan is not None:
        check_foreign_files(store, plan, set(manifest.column("path").to_pylist()))
    buffer = io.BytesIO()
    pq.write_table(manifest, buffer, compression="zstd")
    store.write_atomically(MANIFEST, buffer.getvalue())
    tables: dict[str, dict[str, int]] = defaultdict(lambda: {"files": 0, "rows": 0, "bytes": 0})
    for row in manifest.to_pylist():
        entry = tables[row["table"]]
        entry["files"] += 1
        entry["rows"] += row["rows"]
        entry["bytes"] += row["bytes"]
    card = dataset_card(head, tables, read_license(store), notes_of(markers))
    store.write_atomically(CARD, card.encode())
    totals = {name: sum(entry[name] for entry in tables.values()) for name in ("files", "rows", "bytes")}
    return {"tables": dict(tables), **totals}


def manifest_rows(markers: Iterable[Mapping[str, Any]]) -> pa.Table:
    """Return the rows of the manifest, one for each file that markers list, by table and path.

    Tables that this mmw does not know, such as those of a sensor package that is not installed, come last.
    """
    rows = []
    for marker in markers:
        common = {name: marker.get(name) for name in _MANIFEST_SCHEMA.names if name in marker}
        rows += [{**common, **file} for file in marker["files"]]
    order = {name: index for index, name in enumerate(TABLES)}
    rows.sort(key=lambda row: (order.get(row["table"], len(order)), row["table"], row["path"]))
    return pa.Table.from_pylist(rows, schema=_MANIFEST_SCHEMA)


def read_license(root: Root) -> str:
    """Return the SPDX identifier of a dataset's license, empty for a dataset that names none."""
    data = store_of(root).read(LICENSE)
    return "" if data is None else license_of(data.decode("utf-8", "replace"))


def notes_of(markers: Iterable[Mapping[str, Any]]) -> dict[str, list[str]]:
    """Return the notes that a run wrote down, by scenario; see `write_scenario`."""
    return {marker["scenario"]: [str(line) for line in marker["notes"]] for marker in markers if marker.get("notes")}


def _markers(store: Store, names: Iterable[str], *, skip_unreadable: bool = False) -> dict[str, dict[str, Any]]:
    """Return the markers that are complete."""
    contents = store.read_all(names, skip_unreadable=skip_unreadable)
    found = {name: _parse_marker(data) for name, data in contents.items()}
    return {name: marker for name, marker in found.items() if marker is not None}


def _parse_marker(data: bytes) -> dict[str, Any] | None:
    try:
        marker = json.loads(data.decode("utf-8"))
    except (ValueError, RecursionError):
        return None
    if not isinstance(marker, dict) or not isinstance(marker.get("files"), list):
        return None
    is_framed = marker.get("weather") is not None
    is_complete = (
        _fits(marker, MARKER_TYPES)
        and all(_fits(file, FILE_TYPES) for file in marker["files"])
        and all(_is_a(marker.get(name), _META_TYPES.get(name, str) | None) for name in (*META_KEYS, "created_utc"))
        and all((marker[name] is not None) == is_framed for name in ("frame_begin", "frame_end"))
        and all((marker[name] or 0) <= MAX_FRAME for name in ("frame_begin", "frame_end"))
    )
    return marker if is_complete else None


def _fits(content: Any, types: Mapping[str, Any]) -> bool:
    """Return whether a value is a mapping with the given keys and types of values."""
    return isinstance(content, dict) and all(
        key in content and _is_a(content[key], type_) for key, type_ in types.items()
    )


def _is_a(value: Any, type_: Any) -> bool:
    """Return whether a value has a type; whole numbers must also be those of a manifest."""
    if isinstance(value, bool) or not isinstance(value, type_):  # to Python, True is a whole number
        return False
    return not isinstance(value, int) or 0 <= value < MAX_NUMBER


def _finished(
    store: Store, keys: Iterable[ShardKey | str], head: Mapping[str, Any]
) -> dict[ShardKey | str, dict[str, Any]]:
    """Return the valid markers of a dataset's configuration and input files, of shards and static tables."""
    names = {marker_path(key).as_posix(): key for key in keys}
    found = {
        names[name]: marker
        for name, marker in _markers(store, names).items()
        if key_of(marker) == names[name] and marker["schema_version"] == SCHEMA_VERSION and is_of(marker, head)
    }
    sizes = store.sizes({file["path"] for marker in found.values() for file in marker["files"]})
    return {
        key: marker for key, marker in found.items()
        if all(sizes.get(file["path"]) == file["bytes"] for file in marker["files"])
    }  # fmt: skip


def _is_other_and_empty(store: Store, sha256: str, inputs: Mapping[str, Mapping[str, str]] | None) -> bool:
    head = read_dataset(store)
    if head["config_sha256"] == sha256 and not changed_inputs(head, inputs):
        return False
    return not has_shards(store)


def has_shards(root: Root) -> bool:
    """Return whether a dataset has a marker of a shard, of whatever configuration, readable or not."""
    names = (PurePosixPath(name).name for name in store_of(root).names(MARKERS))
    return any(name.endswith(".json") and name.count(".") == SHARD_DOTS for name in names)
