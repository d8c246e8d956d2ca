"""Files that are there completely or not at all: temporary name, flush to disk, rename, flush the folder."""

import errno
import os
import shutil
from pathlib import Path

from mmw.core.errors import Error
from mmw.core.temp_files import temporary_path

FULL = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC))
"""Error numbers of a full disk and of a full quota."""


class OutOfSpaceError(Error, RuntimeError):
    """Report a full disk. Nothing that was published before is touched, and a rerun resumes."""


class StoreError(Error, RuntimeError):
    """Report a store elsewhere that cannot be reached, or refuses. What is finished is kept, and a rerun resumes."""


def write_bytes_atomically(path: Path, data: bytes | memoryview) -> None:
    """Write a file so that a reader, a kill or a power cut sees all of it or nothing.

    Args:
        path: Final name; an existing file is replaced.
        data: The whole content.

    Raises:
        OutOfSpaceError: If the disk or the quota is full; the temporary file is removed.
    """
    temporary = temporary_path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with temporary.open("wb") as file:
            file.write(data)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
        flush_folder(path.parent)
    except OSError as error:
        temporary.unlink(missing_ok=True)
        if error.errno in FULL:
            raise OutOfSpaceError(_no_space(path, len(data))) from error
        raise


def flush_folder(folder: Path) -> None:
    """Flush a folder's entries to disk, so that a rename survives a power cut. Windows has no such call."""
    if os.name == "nt":
        return
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _no_space(path: Path, size: int) -> str:
    folder = next(parent for parent in path.parents if parent.is_dir())
    free = shutil.disk_usage(folder).free
    return (
        f"{folder}: no space left for {path.name}: {size:,} bytes needed, {free:,} bytes free; "
        "free some space, or use a folder elsewhere (--out, or output.staging of a store), and run the same command "
        "again: it resumes"
    )
