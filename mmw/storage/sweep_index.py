"""Read and write the index of a sweep: which datasets are in a folder, and what makes them differ."""

import json
from collections.abc import Mapping, Sequence
from typing import Any

from mmw.config.output import folder_below
from mmw.core.errors import InputError
from mmw.storage.store import DATASET, Root, store_of

SWEEP = "sweep.json"
"""File at the root of a sweep: a list of records with `name`, `folder` and a column for every key of the sweep."""


def read_index(root: Root) -> list[dict[str, Any]]:
    """Return the records of a sweep's index; none if the root has no index.

    Raises:
        InputError: If it is damaged.
    """
    store = store_of(root)
    data = store.read(SWEEP)
    if data is None:
        return []
    place, cure = store.location(SWEEP), "remove it and run the sweep again, which writes it"
    try:
        records = json.loads(data)
    except (ValueError, RecursionError) as error:  # no JSON, as a whole
        raise InputError(f"{place}: is damaged ({error}); {cure}") from error
    if not isinstance(records, list) or not records or not all(map(_is_record, records)):
        raise InputError(f"{place}: is no list of datasets, each with a name and a folder below; {cure}")
    return records


def write_index(root: Root, records: Sequence[Mapping[str, Any]]) -> None:
    """Write the index of a sweep, and keep records of others in it whose datasets are there.

    Raises:
        InputError: If the root is itself a dataset, or its index is damaged.
        OutOfSpaceError, StoreError: As `Store.write_atomically`.
    """
    store = store_of(root)
    if store.read(DATASET) is not None:
        raise InputError(f"{store}: is one dataset, and a sweep makes a folder of several; give another --out")
    names = {record["name"] for record in records}
    kept = [
        record
        for record in read_index(store)
        if record["name"] not in names and store.read(f"{record['folder']}/{DATASET}") is not None
    ]
    store.check_writable()
    lines = ",\n".join(json.dumps(record) for record in [*records, *kept])
    store.write_atomically(SWEEP, f"[\n{lines}\n]\n".encode())


def dataset_roots(root: Root) -> dict[str, str]:
    """Return the datasets of a sweep, name -> folder or URL; none if the root has no index.

    Raises:
        InputError: If the index is damaged.
    """
    store = store_of(root)
    return {record["name"]: folder_below(store.address, record["folder"]) for record in read_index(store)}


def _is_record(record: Any) -> bool:
    """Return whether a record of an index has a name, and a folder that is directly below the index."""
    name, folder = (record.get("name"), record.get("folder")) if isinstance(record, dict) else (None, None)
    if not isinstance(name, str) or not isinstance(folder, str):
        return False
    return folder not in ("", ".", "..") and "/" not in folder and "\\" not in folder
