"""Lock a dataset folder for one run, or for several that make its parts."""

import os
import platform
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from mmw.core.errors import InputError
from mmw.core.temp_files import Owner, is_temporary, owned, owner_of
from mmw.storage.store import LOCKS, Root, Store, store_of


@contextmanager
def writing(root: Root, index: int, count: int, tell: Callable[[str], None]) -> Iterator[Owner]:
    """Hold a dataset for writing; the operating system lets go of it when the process ends, however it ends.

    A dataset in a store is held in its staging folder, against the other runs of this machine alone. Unfinished files
    that nobody alive can be writing are removed: at the start those of killed runs, at the end those of this run's
    killed workers.

    Args:
        root: Dataset; its folder must exist.
        index: Part that is written.
        count: Parts in all; runs of other parts of as many may write at the same time.
        tell: Takes one line if the folder's file system has no locks: nothing is held then, and unfinished files of
            other runs stay.

    Yields:
        The mark of this run, which its workers' unfinished files must bear.

    Raises:
        InputError: If another process writes this part, or parts of another number.
    """
    run = Owner(index, count)
    root = store_of(root)
    folder = root.staging / LOCKS
    folder.mkdir(parents=True, exist_ok=True)
    own = folder / f"part-{index}-of-{count}.lock"
    with ExitStack() as held:
        if not _take(own, held, root):
            tell(f"{root.staging}: its file system has no locks; start no other run of the same part on it")
            with _cleaning_up(root, run):
                yield run
            return
        for path in sorted(folder.glob("part-*.lock")):
            if path != own and not path.stem.endswith(f"-of-{count}"):
                with ExitStack() as looked:
                    _take(path, looked, root)
        holder = own.with_suffix(".json")
        holder.write_text(f"process {os.getpid()} on {platform.node()}")
        remove_temporaries(root.staging, lambda owner: _is_free(owner, index, count))
        try:
            with _cleaning_up(root, run):
                yield run
        finally:
            with suppress(OSError):  # what ended the run matters, not that the folder cannot be written to any more
                holder.unlink(missing_ok=True)


@contextmanager
def _cleaning_up(root: Store, run: Owner) -> Iterator[None]:
    """Give temporary files of this process the run's mark; at the end remove all that bear it."""
    with owned(root.staging, run):
        try:
            yield
        finally:
            with suppress(OSError):  # as above; the next run tries again
                remove_temporaries(root.staging, lambda owner: owner is not None and run.has(owner))


def _is_free(owner: Owner | None, index: int, count: int) -> bool:
    """Return whether nobody alive can be writing a temporary file, for who holds part `index` of `count`.

    That is so for every file where the part is the whole. Otherwise for the part's own, and for those of parts of
    another number, which cannot be written at the same time. What bears no mark may be anybody's.
    """
    if count == 1:
        return True
    return owner is not None and (owner.count != count or owner.index == index)


def clean_other_parts(root: Root, index: int, count: int) -> None:
    """Remove unfinished files of the other parts of a dataset that nobody writes now.

    Args:
        root: Dataset, of which part `index` of `count` is held.
        index: That part.
        count: Parts in all.
    """
    root = store_of(root)
    left = [(path, owner_of(path)) for path in temporaries(root.staging)]
    for part in {owner.index for _, owner in left if owner is not None and owner.count == count} - {index}:
        with ExitStack() as looked, suppress(Timeout):
            if _hold(root.staging / LOCKS / f"part-{part}-of-{count}.lock", looked, timeout_s=0.0):
                looked.close()  # who takes it from now on begins new files: those that were found are nobody's
                for path, owner in left:
                    if owner is not None and (owner.index, owner.count) == (part, count):
                        path.unlink(missing_ok=True)


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


def temporaries(root: Path) -> list[Path]:
    """Return the unfinished files below a folder."""
    return [path for path in root.rglob(".*") if is_temporary(path) and path.is_file()]


def remove_temporaries(root: Path, chosen: Callable[[Owner | None], bool] = lambda owner: True) -> None:
    """Remove unfinished files.

    Args:
        root: Folder.
        chosen: Tells by a file's owner, or None if its name does not say, whether it goes; nobody may be writing it.
    """
    for path in temporaries(root):
        if chosen(owner_of(path)):
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
