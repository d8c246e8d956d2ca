"""Write files atomically: temporary name, flush to disk, rename, flush the folder."""

import errno
import os
import shutil
from contextlib import suppress
from pathlib import Path

from mmw.core.errors import Error
from mmw.core.temp_files import temporary_path

DISK_FULL = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC))
"""Error numbers of a full disk and of a full quota."""


class OutOfSpaceError(Error, RuntimeError):
    """Report a full disk. Finished files are not touched, and a rerun resumes."""


class StoreError(Error, RuntimeError):
    """Report a store that cannot be reached or refuses. Finished work is stored, and a rerun resumes."""


def write_bytes_atomically(path: Path, data: bytes | memoryview) -> None:
    """Write a file so that a reader, a kill or a power cut sees all of it or nothing.

    Raises:
        OutOfSpaceError: If the disk or the quota is full; the temporary file is removed.
        OSError: If the system refuses otherwise; it names the file.
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
        with suppress(OSError):  # keep the error that ended the writing; the next run removes the file
            temporary.unlink(missing_ok=True)
        if error.errno in DISK_FULL:
            raise OutOfSpaceError(_no_space(path, len(data))) from error
        error.filename, error.filename2 = str(path), None  # not the temporary one, or none
        raise


def flush_folder(folder: Path) -> None:
    """Flush a folder's entries to disk, so that a rename survives a power cut. Windows has no such function."""
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
        "free some space, or use another folder (--out, or output.staging of a store), and run the same command "
        "again: it resumes"
    )
