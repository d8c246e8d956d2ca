"""List the published files of a table, check their names, and name the first that cannot be read."""

import os
import re
import stat
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path, PurePath
from urllib.parse import unquote

import pyarrow as pa
import pyarrow.dataset as pds
import pyarrow.fs as pafs
import pyarrow.parquet as pq

from mmw.core.errors import InputError
from mmw.storage.finding import one_line
from mmw.storage.schema_checks import schema_problem
from mmw.storage.schemas import TABLES
from mmw.storage.shard_writer import MARKERS, TABLE_FILE
from mmw.storage.table_spec import TableSpec

_HIDDEN = re.compile(r"/[._]")

NO_TABLES = ("stages", "assets")
"""Folders of a dataset that hold no tables."""


@dataclass(frozen=True)
class Markers:
    """Names of a dataset's markers; each stands for one published shard, or a scenario's static tables."""

    names: frozenset[str]

    @cached_property
    def _shards(self) -> dict[str, list[str]]:
        """Number of the shards -> `SCENARIO.WEATHER` of each."""
        found: dict[str, list[str]] = {}
        for name in self.names:
            shard, _, number = name.removesuffix(".json").rpartition(".")
            found.setdefault(number, []).append(shard)
        return found

    def publish(self, path: str) -> bool:
        """Return whether the marker of a table's file is there; it is written after all files of its shard.

        The name alone decides, so that nothing is read: `mmw verify` compares the content. Of a file that is the same
        in every weather, any weather's will do: it is written before the first of them.
        """
        found = TABLE_FILE.search(path)
        if found is None:
            return False
        table, scenario, weather, number = found.group("table", "scenario", "weather", "number")
        if weather is not None:
            return f"{scenario}.{weather}.{number}.json" in self.names
        if table in TABLES and TABLES[table].framed:
            return any(shard.startswith(f"{scenario}.") for shard in self._shards.get(number, ()))
        return f"{scenario}.json" in self.names


def list_markers(root: PurePath, filesystem: pafs.FileSystem | None) -> Markers:
    """Return the names of a dataset's markers.

    Raises:
        InputError: If their folder may not be read.
    """
    names = (path.rsplit("/", 1)[1] for path in _walk(root, MARKERS, filesystem) if path.endswith(".json"))
    return Markers(frozenset(names))


def list_files(root: PurePath, table: str, filesystem: pafs.FileSystem | None, markers: Markers) -> list[str]:
    """Return the paths of a table's published files, sorted.

    Names with a leading . or _ are skipped, as by other readers; so are files of shards without a marker: those of a
    running or killed run, and copies.

    Raises:
        InputError: If a folder may not be read, or a file has a name that no file of a dataset has, or is a link that
            leads nowhere, or is a pipe: readers would leave it out, or wait.
    """
    begin = len(root.as_posix()) + 1
    paths = sorted(path for path in _walk(root, table, filesystem) if not _HIDDEN.search(path, begin + len(table)))
    for path in paths:
        if not TABLE_FILE.fullmatch(path, begin):
            raise InputError(f"{path}: no file of a dataset has this name in table {table!r}; move it away")
    paths = [path for path in paths if markers.publish(path)]
    for path in paths if filesystem is None else ():
        mode = os.lstat(path).st_mode
        if stat.S_ISLNK(mode):
            if not os.path.exists(path):  # noqa: PTH110 - fast
                raise InputError(f"{path}: cannot be read (it is a link that leads nowhere); put the file back")
            mode = os.stat(path).st_mode  # noqa: PTH116 - fast
        if not stat.S_ISREG(mode):  # readers would wait for a pipe
            raise InputError(f"{path}: is no file but a folder, a pipe or a device; remove it")
    return paths


def has_files(root: PurePath, table: str, filesystem: pafs.FileSystem | None, markers: Markers) -> bool:
    """Return whether a table's folder holds published files.

    Raises:
        InputError: If a folder may not be read.
    """
    return any(markers.publish(path) for path in _walk(root, table, filesystem))


def list_folders(root: PurePath, filesystem: pafs.FileSystem | None) -> list[str]:
    """Return the names of the folders at the top of a dataset that may be tables, sorted.

    Raises:
        InputError: If it may not be read.
    """
    try:
        if filesystem is None:
            names = [entry.name for entry in os.scandir(root) if entry.name not in NO_TABLES and entry.is_dir()]
        else:
            found = filesystem.get_file_info(pafs.FileSelector(root.as_posix()))
            names = [info.base_name for info in found if info.type == pafs.FileType.Directory]
    except OSError as error:
        raise InputError(f"{root}: cannot be read ({error.strerror or one_line(error)})") from error
    return sorted(name for name in names if name[0] not in "._" and name not in NO_TABLES)


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


def damage_of(
    root: PurePath, spec: TableSpec, filesystem: pafs.FileSystem | None, paths: Collection[str], error: Exception
) -> InputError:
    """Return an error that names the first file of a table that cannot be read, by footers, then rows."""
    place = filesystem or pafs.LocalFileSystem()
    for is_whole in (False, True):
        for path in paths:
            if filesystem is None and Path(path).exists() and not Path(path).is_file():
                return InputError(f"{path}: is no file but a folder, a pipe or a device; remove it")
            try:
                with place.open_input_file(path) as file, pq.ParquetFile(file) as parquet:
                    problem = schema_problem(parquet.schema_arrow, spec)
                    if problem:
                        return InputError(f"{path}: {problem}; it is no file of {spec.name!r}")
                    for group in range(parquet.num_row_groups if is_whole else 0):
                        parquet.read_row_group(group)
            except PermissionError:
                return InputError(f"{path}: cannot be read (Permission denied); let yourself read it")
            except (pa.ArrowException, OSError) as reason:
                text = f"{path}: cannot be read ({one_line(reason)}); it is damaged"
                return InputError(f"{text}; `mmw verify {root}` lists all that is")
    return InputError(f"{root}: table {spec.name!r}: {one_line(error)}; check the columns and files that are read")


Parts = dict[tuple[str, str | None], list[tuple[int, pds.ParquetFileFragment]]]
"""Scenario and weather, None for all, -> first frame and file of each shard, by frame."""


def framed_parts(table: pds.FileSystemDataset) -> Parts:
    """Return the files of a framed table by the folders and the number that their names hold.

    Raises:
        InputError: If a file has another name.
    """
    found: Parts = {}
    for fragment in table.get_fragments():
        named = TABLE_FILE.search(fragment.path)
        if named is None:
            raise InputError(f"{fragment.path}: no file of a dataset has this name; move it away")
        place = unquote(named["scenario"]), named["weather"] and unquote(named["weather"])
        found.setdefault(place, []).append((int(named["number"]), fragment))
    for some in found.values():
        some.sort(key=lambda item: item[0])
    return found
