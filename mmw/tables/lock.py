"""Who writes a dataset folder: one run, or several that make its parts, and nobody else beside them."""

import os
import platform
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from mmw.errors import InputError
from mmw.tables.store import LOCKS, Root, Store, store_of
from mmw.temporary import is_temporary


@contextmanager
def writing(root: Root, index: int, count: int, tell: Callable[[str], None]) -> Iterator[None]:
    """Hold a dataset for writing; the operating system lets go of it when the process ends, however it ends.

    A dataset in a store is held in its staging folder, against the other runs of this machine alone.

    Args:
        root: Dataset; its folder must exist.
        index: Part that is written.
        count: Parts in all; runs of other parts of as many may write at the same time.
        tell: Takes one line if the folder's file system has no locks: nothing is held then.

    Raises:
        InputError: If another process writes this part, or parts of another number.
    """
    root = store_of(root)
    folder = root.staging / LOCKS
    folder.mkdir(parents=True, exist_ok=True)
    own = folder / f"part-{index}-of-{count}.lock"
    with ExitStack() as held:
        if not _take(own, held, root):
            tell(f"{root.staging}: its file system has no locks; start no other run of the same part on it")
            yield
            return
        for path in sorted(folder.glob("part-*.lock")):
            if path != own and not path.stem.endswith(f"-of-{count}"):
                with ExitStack() as looked:
                    _take(path, looked, root)
        holder = own.with_suffix(".json")
        holder.write_text(f"process {os.getpid()} on {platform.node()}")
        if count == 1:
            remove_temporaries(root.staging)
        try:
            yield
        finally:
            holder.unlink(missing_ok=True)


@contextmanager
def only_one(root: Path, name: str, timeout_s: float = -1.0) -> Iterator[None]:
    """Hold something of a folder while others wait, such as a scenario's stage while it is made.

    Args:
        root: The dataset's folder, or another one that exists.
        name: What is held.
        timeout_s: How long to wait for another process or thread that has it [s]; without end if negative.

    Raises:
        Timeout: If it still has it then.
    """
    folder = root / LOCKS
    folder.mkdir(parents=True, exist_ok=True)
    with ExitStack() as held:
        _hold(folder / f"{name}.lock", held, timeout_s)  # without locks two make the same files, whole both times
        yield


def writers(root: Root) -> list[str]:
    """Return the runs that write a dataset now: part, process and machine of each; into a store only this machine's."""
    found = []
    for path in sorted((store_of(root).staging / LOCKS).glob("part-*.lock")):
        try:
            with ExitStack() as looked:
                _hold(path, looked, timeout_s=0.0)
        except Timeout:
            found.append(f"{path.stem.replace('-', ' ')}: {_holder(path)}")
    return found


def remove_temporaries(root: Path) -> None:
    """Remove files that killed runs left unfinished; nobody else may write the folder."""
    for path in root.rglob(".*"):
        if path.is_file() and is_temporary(path):
            path.unlink(missing_ok=True)


def _hold(path: Path, held: ExitStack, timeout_s: float) -> bool:
    """Take a lock; False where the file system has none, as on some clusters.

    Raises:
        Timeout: If another process has it.
    """
    try:
        held.enter_context(FileLock(path, timeout=timeout_s))
    except NotImplementedError:  # what filelock raises there
        return False
    return True


def _take(path: Path, held: ExitStack, root: Store) -> bool:
    try:
        return _hold(path, held, timeout_s=0.0)
    except Timeout:
        raise InputError(
            f"{root}: is being written by another run ({_holder(path)}, {path.stem.replace('-', ' ')}); "
            "wait for it or stop it, or give another --out"
        ) from None


def _holder(path: Path) -> str:
    try:
        return path.with_suffix(".json").read_text()
    except OSError:
        return "unknown process"
