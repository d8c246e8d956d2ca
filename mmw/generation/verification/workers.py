"""Check the files of a dataset of many shards with several processes."""

import multiprocessing
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool

from mmw.core.errors import InputError
from mmw.generation.executors.process_pool import CAN_FORK
from mmw.generation.verification.planned_rows import PlannedRows, Seen
from mmw.storage.finding import Finding
from mmw.storage.row_checks import MAX_SHARDS
from mmw.storage.shard_files import check_shards
from mmw.storage.store import Store, store_of

MIN_SHARDS = 64
"""Shards for which one more process pays off: its start takes as long as reading some 500 small files. Design value."""


def check_files(store: Store, markers: list[dict], rows: PlannedRows | None, workers: int) -> Iterator[Finding]:
    """Yield what is wrong with the files that markers list, and with their rows.

    A process decodes small files on one core, whatever its threads: Python holds a lock for most of the time.

    Args:
        store: Dataset.
        markers: Markers whose list of files is right.
        rows: Compares rows with a configuration; it has seen those of all shards afterwards.
        workers: Processes, of which fewer are started for few shards.

    Raises:
        InputError: If a process was killed.
    """
    workers = min(workers, len(markers) // MIN_SHARDS)
    if workers < 2:
        yield from check_shards(store, markers, rows)
        return
    count = workers * -(-len(markers) // (workers * MAX_SHARDS))
    size = -(-len(markers) // count)
    blocks = [markers[first : first + size] for first in range(0, len(markers), size)]
    context = multiprocessing.get_context("forkserver" if CAN_FORK else "spawn")
    context.set_forkserver_preload([__name__])
    with ProcessPoolExecutor(workers, context, _begin, (store.address, rows)) as pool:
        try:
            for findings, seen in pool.map(_check, blocks):
                yield from findings
                if rows is not None:
                    rows.seen.add(seen)
        except BrokenProcessPool as error:
            raise InputError(
                f"{store}: a process that read its files was killed, perhaps for lack of memory; use --workers 1"
            ) from error


_store: Store
_rows: PlannedRows | None


def _begin(address: str, rows: PlannedRows | None) -> None:
    """Prepare a process."""
    global _store, _rows
    _store, _rows = store_of(address), rows


def _check(markers: list[dict]) -> tuple[list[Finding], Seen]:
    """Return what is wrong with the files of some markers, and what their rows need of static tables."""
    if _rows is not None:
        _rows.seen = Seen()
    found = list(check_shards(_store, markers, _rows, threads=1))
    return found, Seen() if _rows is None else _rows.seen
