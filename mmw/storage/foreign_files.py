"""Find files in a dataset that are no part of it, such as copies: readers would take their rows too."""

from collections.abc import Collection, Iterable, Sequence
from pathlib import PurePosixPath

from mmw.core.errors import InputError
from mmw.storage.schemas import TABLES
from mmw.storage.shard_writer import MARKERS, ShardKey, marker_path, table_path
from mmw.storage.store import MANIFEST, Root, store_of

MAX_NAMES = 3
"""Files that a message names."""


def foreign_files(root: Root, plan: Iterable[ShardKey | str], listed: Collection[str] | None = None) -> list[str]:
    """Return the files among tables and markers that no shard or scenario of a dataset has.

    Files whose name begins with a dot or an underscore are left out, which all readers skip.

    Args:
        root: Dataset.
        plan: All its shards and scenarios, finished or not.
        listed: Files that the markers list, if all are finished; None also admits tables without a marker.
    """
    plan = list(plan)
    markers = {marker_path(key).as_posix() for key in plan}
    own = {
        table_path(table, key).as_posix()
        for table, spec in TABLES.items()
        for key in plan
        if spec.framed == isinstance(key, ShardKey)
    }

    def is_own(name: str) -> bool:
        top, _, rest = name.partition("/")
        if top == MARKERS:
            return name in markers
        if top in TABLES:
            return name in (own if listed is None else listed)
        return bool(rest) or not name.endswith(".parquet") or name == MANIFEST

    names = store_of(root).names()
    return [name for name in names if not PurePosixPath(name).name.startswith((".", "_")) and not is_own(name)]


def check_foreign_files(root: Root, plan: Iterable[ShardKey | str], listed: Collection[str] | None = None) -> None:
    """Check that a dataset has no `foreign_files`.

    Raises:
        InputError: If it has: they are not ours to remove.
    """
    if found := foreign_files(root, plan, listed):
        raise InputError(f"{store_of(root)}: {name_files(found)}, and run the same command again")


def name_files(names: Sequence[str]) -> str:
    """Return a text that names the first of some foreign files, with the cure."""
    more = f" and {len(names) - MAX_NAMES} more" if len(names) > MAX_NAMES else ""
    return (
        f"has files that are no part of the dataset, whose rows readers would take: {', '.join(names[:MAX_NAMES])}"
        f"{more}; delete them or move them away"
    )
