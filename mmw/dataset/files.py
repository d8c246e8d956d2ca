"""List the files of a table, check their names, and name the first that cannot be read."""

import os
import re
from collections.abc import Iterator
from pathlib import Path, PurePath

import pyarrow as pa
import pyarrow.fs as pafs
import pyarrow.parquet as pq

from mmw.core.errors import InputError
from mmw.storage.file_checks import SHARD_FILE, one_line
from mmw.storage.schemas import table_spec


def list_files(root: PurePath, table: str, filesystem: pafs.FileSystem | None) -> list[str]:
    """Return the paths of a table's files, sorted; names with a leading . or _ are skipped, as by other readers.

    Raises:
        InputError: If a folder may not be read, or a file has a name that no file of a dataset has, or is a link that
            leads nowhere: readers would leave it out.
    """
    top = (root / table).as_posix()
    paths = sorted(path for path in _walk(root, table, filesystem) if not re.search(r"/[._]", path[len(top) :]))
    for path in paths:
        if not SHARD_FILE.fullmatch(path[len(root.as_posix()) + 1 :]):
            raise InputError(f"{path}: no file of a dataset has this name in table {table!r}; move it away")
        if filesystem is None and Path(path).is_symlink() and not Path(path).exists():
            raise InputError(f"{path}: cannot be read (it is a link that leads nowhere); put the file back")
    return paths


def has_files(root: PurePath, table: str, filesystem: pafs.FileSystem | None) -> bool:
    """Return whether a table's folder holds Parquet files.

    Raises:
        InputError: If a folder may not be read.
    """
    return any(path.endswith(".parquet") for path in _walk(root, table, filesystem))


def _walk(root: PurePath, table: str, filesystem: pafs.FileSystem | None) -> Iterator[str]:
    """Yield the paths of everything but folders below a table's folder.

    Links to folders count as files, so that they are found to be foreign: a reader that follows one that leads back
    would have every row many times.
    """
    if filesystem is not None:
        selector = pafs.FileSelector((root / table).as_posix(), recursive=True, allow_not_found=True)
        found = filesystem.get_file_info(selector)
        yield from (info.path for info in found if info.type != pafs.FileType.Directory)
        return

    def stop(error: OSError) -> None:
        if not isinstance(error, FileNotFoundError | NotADirectoryError):  # no such table
            raise InputError(f"{error.filename}: cannot be read ({error.strerror}); let yourself read it") from error

    for parent, folders, names in os.walk(Path(root) / table, onerror=stop):
        place = Path(parent).as_posix()
        yield from (f"{place}/{name}" for name in names)
        yield from (
            f"{place}/{name}" for name in folders if name.endswith(".parquet") or Path(parent, name).is_symlink()
        )


def damage_of(root: PurePath, table: str, filesystem: pafs.FileSystem | None, error: Exception) -> InputError:
    """Return an error that names the first file of a table that cannot be read, by footers, then rows."""
    place = filesystem or pafs.LocalFileSystem()
    key = table_spec(table).key
    try:
        paths = list_files(root, table, filesystem)
    except InputError as found:
        return found
    for is_whole in (False, True):
        for path in paths:
            if filesystem is None and Path(path).exists() and not Path(path).is_file():
                return InputError(f"{path}: is no file but a folder, a pipe or a device; remove it")
            try:
                with place.open_input_file(path) as file, pq.ParquetFile(file) as parquet:
                    missing = [name for name in key if name not in parquet.schema_arrow.names]
                    if missing:
                        return InputError(f"{path}: has no column {', '.join(missing)}; it is no file of {table!r}")
                    for group in range(parquet.num_row_groups if is_whole else 0):
                        parquet.read_row_group(group)
            except PermissionError:
                return InputError(f"{path}: cannot be read (Permission denied); let yourself read it")
            except (pa.ArrowException, OSError) as reason:
                text = f"{path}: cannot be read ({one_line(reason)}); it is damaged"
                return InputError(f"{text}; `mmw verify {root}` lists all that is")
    return InputError(f"{root}: table {table!r}: {one_line(error)}; check the columns and files that are read")
