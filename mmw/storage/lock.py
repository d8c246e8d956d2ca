"""Lock a dataset folder for one run, or for several runs of its parts."""

import errno
import os
import platform
import re
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path, PurePosixPath

from filelock import FileLock, Timeout

from mmw.core.errors import InputError
from mmw.core.temp_files import Owner, is_temporary, owned, owner_of
from mmw.storage.store import LOCKS, Root, Store, store_of

PROBE_S = 1.0
"""Time in which a lock must become free [s]: processes that only look whether it is held lock it for a moment."""


@contextmanager
def writing(root: Root, index: int, count: int, warn: Callable[[str], None]) -> Iterator[Owner]:
    """Lock a dataset for writing; the operating system releases the lock when the process ends for any reason.

    A dataset in a remote store is locked in its staging folder, against other runs on this machine only. Unfinished
    files of this part that no running process can be writing are removed at the start and at the end.

    Args:
        root: Dataset; its folder must exist.
        index: Part that is written.
        count: Total number of parts; runs of the other parts may write at the same time.
        warn: Receives one line if the folder's file system has no locks: nothing is locked then, and unfinished files
            of other runs stay.

    Yields:
        The owner of this run, which the names of its workers' unfinished files must contain.

    Raises:
        InputError: If another process writes this part, or parts of another total number.
    """
    run = Owner(index, count)
    root = store_of(root)
    folder = root.staging / LOCKS
    folder.mkdir(parents=True, exist_ok=True)
    own = folder / f"part-{index}-of-{count}.lock"
    with ExitStack() as stack:
        if not _lock_or_fail(own, stack, root):
            warn(f"{root.staging}: its file system has no locks; start no other run of the same part on it")
            with _cleaning_up(root, run, lambda owner: owner is not None and run.has(owner)):
                yield run
            return
        for path in sorted(folder.glob("part-*.lock")):
            if path != own and not path.stem.endswith(f"-of-{count}"):
                with ExitStack() as probe:
                    _lock_or_fail(path, probe, root)
        holder = own.with_suffix(".json")
        holder.write_text(f"process {os.getpid()} on {platform.node()}")
        remove_temporaries(root.staging, lambda owner: _is_free(owner, index, count))
        try:
            with _cleaning_up(root, run, lambda owner: _is_free(owner, index, count)):
                yield run
        finally:
            with suppress(OSError):  # keep the error that ended the run, if any
                holder.unlink(missing_ok=True)


@contextmanager
def _cleaning_up(root: Store, run: Owner, is_chosen: Callable[[Owner | None], bool]) -> Iterator[None]:
    """Mark temporary files of this process with the run; at the end remove those of the chosen owners.

    These are not only the run's own: a worker of a killed run may have started a file after this run began.
    """
    with owned(root.staging, run):
        try:
            yield
        finally:
            with suppress(OSError):  # keep the error that ended the run, if any; the next run removes them
                remove_temporaries(root.staging, is_chosen)


def _is_free(owner: Owner | None, index: int, count: int) -> bool:
    """Return whether no other process can be writing a temporary file, for the process that locked part `index`.

    If there is a single part, this holds for every file; otherwise for the part's own files, and for those of another
    total number of parts, which cannot be written at the same time. A file without an owner may be in use.
    """
    if count == 1:
        return True
    return owner is not None and (owner.count != count or owner.index == index)


def remove_leftovers(root: Root, index: int, count: int) -> None:
    """Remove what dead processes left of other parts of a finished dataset, for the process that locked part `index`.

    These are unfinished files, and notes about who holds a lock. Those of parts that a process is writing stay, as do
    unfinished files without an owner while there is such a process.
    """
    root = store_of(root)
    left = [(path, owner_of(path)) for path in temporaries(root.staging)]
    own, busy = (index, count), set[tuple[int, int]]()
    for path in sorted((root.staging / LOCKS).glob("part-*.lock")):
        part = _part(path)
        if part is None or part == own:
            continue
        try:
            with ExitStack() as probe:
                if not _lock(path, probe, timeout_s=0.0):
                    return
                path.with_suffix(".json").unlink(missing_ok=True)
        except Timeout:
            busy.add(part)
    for path, owner in left:  # a process that locks a part from now on starts new files, so those found are free
        if not busy if owner is None else (owner.index, owner.count) not in {own, *busy}:
            path.unlink(missing_ok=True)
    probes = [name for name in root.names(LOCKS) if is_temporary(PurePosixPath(name))]  # in a remote store too
    root.remove(name for name in probes if _is_free(owner_of(PurePosixPath(name)), index, count))


def _part(lock: Path) -> tuple[int, int] | None:
    """Return index and total number of the part that a file locks."""
    found = re.fullmatch(r"part-(\d+)-of-(\d+)", lock.stem)
    return None if found is None else (int(found[1]), int(found[2]))


@contextmanager
def exclusive_lock(root: Path, name: str, timeout_s: float = -1.0) -> Iterator[None]:
    """Lock a resource of a folder, such as the stage of a scenario, while the block runs; wait forever if time < 0.

    Raises:
        Timeout: If it is still locked then.
    """
    folder = root / LOCKS
    folder.mkdir(parents=True, exist_ok=True)
    with ExitStack() as stack:
        _lock(folder / f"{name}.lock", stack, timeout_s)  # without locks two processes write the same files, atomically
        yield


def writers(root: Root) -> list[str]:
    """Return part, process and machine of the runs that are writing a dataset; of a remote store only local runs.

    Raises:
        OSError: If a lock cannot even be read, so that nothing is known.
    """
    paths = sorted((store_of(root).staging / LOCKS).glob("part-*.lock"))
    return [f"{path.stem.replace('-', ' ')}: {_holder(path)}" for path in paths if _is_locked(path)]


def _is_locked(path: Path) -> bool:
    """Return whether a process holds a lock; the dataset may be another user's, or on a disk mounted for reading."""
    try:
        with ExitStack() as probe:
            _lock(path, probe, timeout_s=0.0)
    except Timeout:
        return True
    except OSError as error:
        if os.name == "nt" or error.errno not in (errno.EACCES, errno.EPERM, errno.EROFS):
            raise
        return _is_locked_for_reader(path)
    return False


def _is_locked_for_reader(path: Path) -> bool:
    """Return the same by a shared lock, for which a file need not be writable. Windows has no such function."""
    import fcntl

    with path.open("rb") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False


def temporaries(root: Path) -> list[Path]:
    """Return the unfinished files below a folder."""
    return [path for path in root.rglob(".*") if is_temporary(path) and path.is_file()]


def remove_temporaries(root: Path, is_chosen: Callable[[Owner | None], bool] = lambda owner: True) -> None:
    """Remove unfinished files of the chosen owners, None for files without one; none may be in use."""
    for path in temporaries(root):
        if is_chosen(owner_of(path)):
            path.unlink(missing_ok=True)


def _lock(path: Path, stack: ExitStack, timeout_s: float) -> bool:
    """Acquire a lock in time, else raise `Timeout`; return False if the file system has no locks, as on clusters."""
    try:
        stack.enter_context(FileLock(path, timeout=timeout_s))
    except NotImplementedError:  # filelock raises it there
        return False
    return True


def _lock_or_fail(path: Path, stack: ExitStack, root: Store) -> bool:
    try:
        return _lock(path, stack, timeout_s=PROBE_S)
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
