"""Read the tables of a dataset as Arrow, pandas and NumPy; a filter skips folders and row groups."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
import pyarrow as pa
import pyarrow.dataset as pds
import pyarrow.fs as pafs

from mmw.core.constants import FRAME_RATE_HZ
from mmw.core.errors import InputError
from mmw.core.extras import needed_by
from mmw.dataset.column_arrays import arrays_of
from mmw.dataset.files import Markers, Parts, damage_of, framed_parts, has_files, list_files, list_folders, list_markers
from mmw.dataset.filesystem import find_storage, read_bytes
from mmw.dataset.plugin_tables import spec_of_file, warn_of_missing_package
from mmw.dataset.table_reader import check_columns, path_columns, read_view, row_filter
from mmw.storage.manifest import DATASET, frame_rates, parse_dataset, read_dataset
from mmw.storage.schema_checks import schema_problem, version_number
from mmw.storage.schemas import SCHEMA_VERSION, TABLES, table_spec, views, views_of
from mmw.storage.shard_writer import MARKERS
from mmw.storage.table_spec import TableSpec

if TYPE_CHECKING:
    import duckdb
    import pandas as pd

    from mmw.channel.path_table import CarrierPaths
    from mmw.dataset.beams import BeamSearch
    from mmw.dataset.frame import Frame


FOOTER_THREADS = 16
"""Threads that read the footers of files. Design value."""


@dataclass(frozen=True)
class Dataset:
    """A dataset folder: the files of published shards, those that have a marker.

    They are listed once; open it again after a run has added some.

    Examples:
        >>> import mmw
        >>> data = mmw.open_dataset("out/quickstart")
        >>> data.frame("town03_roundabout", "sunny", 0).agents["cav_1"].sensor("lidar").points.shape[1]
        3
    """

    root: Path
    """The folder; in `filesystem` where that is given."""
    filesystem: pafs.FileSystem | None = None
    """None for local files."""
    _opened: dict[str, pds.Dataset] = field(default_factory=dict, init=False, compare=False, repr=False)
    _checked: set[str] = field(default_factory=set, init=False, compare=False, repr=False)
    """Files whose columns have been checked."""
    _parts: "dict[str, Parts]" = field(default_factory=dict, init=False, compare=False, repr=False)

    @cached_property
    def info(self) -> dict[str, Any]:
        """`dataset.json`: schema version, configuration, its hash, versions."""
        if self.filesystem is None:
            return read_dataset(self.root)
        return parse_dataset(read_bytes(self.root, DATASET, self.filesystem), self.root)

    def frame_rate_hz(self, scenario: str) -> int:
        """Return the frames a second of a scenario: frame n is n / rate after its start [Hz]."""
        return frame_rates(self.info).get(scenario, FRAME_RATE_HZ)  # older datasets have 100 Hz

    @property
    def sweep(self) -> dict[str, Any]:
        """Keys of the sweep that made the dataset, by their dotted paths, and their values; empty without a sweep."""
        return self.info.get("sweep", {}).get("values", {})

    @cached_property
    def tables(self) -> tuple[str, ...]:
        """Names of the tables that have files; those of sensor packages that are not installed come last."""
        known = (name for name in TABLES if has_files(self.root, name, self.filesystem, self._markers))
        return (*known, *self._plugin_specs)

    @property
    def views(self) -> tuple[str, ...]:
        """Names of the views, which `read` and `connect` join from tables: `paths`, if there is a channel."""
        return views_of(self.tables)

    @property
    def content(self) -> str:
        """Words for messages: the tables, or why there are none."""
        if self.tables:
            return f"holds {', '.join(self.tables)}"
        return f"holds no table: {MARKERS} marks no shard as complete; run mmw.run, or copy that folder too"

    @cached_property
    def _markers(self) -> Markers:
        return list_markers(self.root, self.filesystem)

    @cached_property
    def _plugin_specs(self) -> dict[str, TableSpec]:
        """Tables of sensor packages that are not installed, as their files describe them."""
        found = {}
        for name in list_folders(self.root, self.filesystem):
            if (
                name not in TABLES
                and name not in views()
                and has_files(self.root, name, self.filesystem, self._markers)
            ):
                spec = spec_of_file(name, self.check_files(name)[0], self.filesystem)
                if spec is not None:
                    found[name] = spec
        return found

    def spec(self, table: str) -> TableSpec:
        """Return the specification of a table; without the sensor package that made it, as its files describe it.

        Raises:
            InputError: If no table has this name.
        """
        return self._plugin_specs[table] if table not in TABLES and table in self._plugin_specs else table_spec(table)

    def arrow(self, table: str) -> pds.Dataset:
        """Return a table as an Arrow dataset that skips the files of other scenarios and weathers.

        Raises:
            InputError: If the table is not known, has no file, its first file is damaged or lacks a column, or its
                folder holds others.
        """
        spec = self.spec(table)
        if table not in self.tables:
            raise InputError(f"{self.root}: table {table!r} has no file; it {self.content}")
        if table not in self._opened:
            if table not in TABLES:
                warn_of_missing_package(self.root, table, self.info)
            partitioning = pds.HivePartitioning.discover(infer_dictionary=True)
            paths = self.check_files(table)
            try:
                opened = pds.dataset(
                    paths, format="parquet", partitioning=partitioning, filesystem=self.filesystem,
                    partition_base_dir=(self.root / table).as_posix(),
                )  # fmt: skip
            except (pa.ArrowException, OSError) as error:
                raise self.damage(table, error) from error
            problem = schema_problem(opened.schema, spec)
            if problem:
                raise self.damage(table, InputError(problem))
            self._opened[table] = cast(pds.Dataset, opened)
        return self._opened[table]

    def read(
        self,
        table: str,
        *,
        columns: Sequence[str] | None = None,
        scenario: str | None = None,
        weather: str | None = None,
        frames: range | None = None,
        agent: str | None = None,
        sensor: str | None = None,
    ) -> pa.Table:
        """Return the rows of a table or view, sorted by scenario, weather, frame and the rest of its key.

        Args:
            table: Name of a table or view.
            columns: Columns to read; None reads all.
            scenario: Only this scenario.
            weather: Only this weather.
            frames: Only these frames; a step is allowed.
            agent: Only rows of this agent.
            sensor: Only rows of this sensor.

        Raises:
            InputError: If the table or a column is not known or has no file, or a file is damaged, which is named.

        Examples:
            >>> import mmw
            >>> data = mmw.open_dataset("out/quickstart")
            >>> rows = data.read("poses", columns=["x", "y"], frames=range(0, 2), weather="sunny", agent="cav_1")
            >>> rows.num_rows, rows.column_names
            (2, ['x', 'y'])
        """
        if table in self.views:
            return read_view(
                self, views()[table], columns=columns, scenario=scenario, weather=weather, frames=frames, agent=agent,
                sensor=sensor,
            )  # fmt: skip
        given = {"scenario": scenario, "weather": weather, "agent": agent, "sensor": sensor}
        given = {name: value for name, value in given.items() if value is not None}
        wanted = [*(columns or ()), *given, *([] if frames is None else ["frame"])]
        # Those of the files, by the first; reading all of them is slow.
        check_columns(self.root, table, self.arrow(table).schema.names, wanted)
        expression = row_filter(given, frames)
        part = self._files(table, scenario, weather, frames)
        try:
            self._check_schemas(table, part, expression)
            found = part.to_table(columns=list(columns) if columns else None, filter=expression)
        except (pa.ArrowException, OSError) as error:
            raise self.damage(table, error) from error
        for field_ in self.spec(table).columns:
            if not field_.nullable and field_.name in found.column_names and found[field_.name].null_count:
                raise self.damage(table, InputError(f"{field_.name} is null in some rows"))
        return found.unify_dictionaries()  # Arrow groups and counts no names whose files number them differently

    def _check_schemas(self, name: str, part: pds.Dataset, expression: pds.Expression | None) -> None:
        """Check the columns of the files that a filter leaves: rows of a file without `frame` would match no filter.

        Raises:
            InputError: If columns are missing or have other types.
            pa.ArrowException, OSError: If a file cannot be read.
        """
        spec = self.spec(name)
        found = [one for one in part.get_fragments(expression) if one.path not in self._checked]

        def check(one: pds.Fragment) -> None:
            if problem := schema_problem(one.physical_schema, spec):  # the scan uses the same footer
                raise InputError(f"{one.path}: {problem}; it is no file of {name!r}")
            self._checked.add(one.path)

        if len(found) == 1:
            check(found[0])
        elif found:
            with ThreadPoolExecutor(FOOTER_THREADS) as pool:
                list(pool.map(check, found))

    def _files(self, name: str, scenario: str | None, weather: str | None, frames: range | None) -> pds.Dataset:
        """Return a table without the files whose folder and number exclude them.

        Readers would open the footer of every file of the weather to find one frame; the number of a file is its first
        frame, and the next file's number is one past its last, or less.
        """
        table = self.arrow(name)
        if frames is None or not isinstance(table, pds.FileSystemDataset):
            return table
        if name not in self._parts:
            self._parts[name] = framed_parts(table)
        wanted = []
        first, last = min(frames, default=0), max(frames, default=-1)
        for (of_scenario, of_weather), some in self._parts[name].items():
            if scenario in (None, of_scenario) and (weather is None or of_weather in (None, weather)):
                ends = [begin for begin, _ in some[1:]] + [last + 1]
                wanted += [part for (begin, part), end in zip(some, ends, strict=True) if begin <= last and first < end]
        return pds.FileSystemDataset(wanted, table.schema, table.format, table.filesystem)

    def pandas(self, table: str, **where: Any) -> "pd.DataFrame":
        """Return rows of a table as a pandas DataFrame; list columns hold NumPy arrays.

        Args:
            table: Table name.
            where: `columns`, `scenario`, `weather`, `frames`, `agent` and `sensor` of `read`.

        Raises:
            InputError: As `read`.
            MissingPackageError: If pandas is not installed.

        Examples:
            >>> import mmw
            >>> links = mmw.open_dataset("out/quickstart").pandas("links", weather="sunny", frames=range(0, 1))
            >>> links.groupby("agent", observed=True)["path_count"].sum().to_dict()
            {'cav_1': 4, 'cav_2': 2, 'cav_3': 8}
        """
        with needed_by("Dataset.pandas"):
            return self.read(table, **where).to_pandas()

    def numpy(self, table: str, **where: Any) -> dict[str, np.ndarray]:
        """Return rows of a table as one array a column, shape [rows].

        Names are text, nulls of number columns NaN; lists and images are object arrays of arrays and mappings.

        Args:
            table: Table name.
            where: As of `pandas`.

        Raises:
            InputError: As `read`.

        Examples:
            >>> import mmw
            >>> poses = mmw.open_dataset("out/quickstart").numpy("poses", weather="sunny", frames=range(0, 1))
            >>> poses["agent"].tolist(), poses["x"].dtype
            (['cav_1', 'cav_2', 'cav_3', 'rsu_1'], dtype('float64'))
        """
        return arrays_of(self.read(table, **where))

    def frame(self, scenario: str, weather: str, frame: int) -> "Frame":
        """Return one frame: all agents with poses, sweeps, images, boxes, links and paths, read at their first use.

        Raises:
            InputError: If the dataset has no such frame.

        Examples:
            >>> import mmw
            >>> frame = mmw.open_dataset("out/quickstart").frame("town03_roundabout", "sunny", 0)
            >>> list(frame.agents), len(frame.boxes), len(frame.links)
            (['cav_1', 'cav_2', 'cav_3', 'rsu_1'], 20, 6)
        """
        from mmw.dataset.frame import Frame

        found = Frame(self, scenario, weather, int(frame))
        found.row  # noqa: B018 - fails now, with what there is, if there is no such frame
        return found

    def paths(
        self, carrier_hz: float, *, scenario: str | None = None, weather: str | None = None, frames: range | None = None
    ) -> "CarrierPaths":
        """Return the radio paths of all links at one carrier, also of links without any, see `docs/guides/csi.md`.

        Raises:
            InputError: If there is no channel in the dataset, or no such carrier.

        Examples:
            >>> import mmw
            >>> paths = mmw.open_dataset("out/quickstart").paths(28e9, weather="sunny", frames=range(0, 2))
            >>> paths.link_count, float(paths.carrier_hz)
            (6, 28000000000.0)
        """
        from mmw.channel.path_table import LINK_COLUMNS, CarrierPaths

        where: dict[str, Any] = {"scenario": scenario, "weather": weather, "frames": frames}
        rows = self.read("paths", columns=path_columns(self), **where)
        return CarrierPaths.from_table(rows, carrier_hz, self.read("links", columns=LINK_COLUMNS, **where))

    def connect(self, search: "BeamSearch | None" = None) -> "duckdb.DuckDBPyConnection":
        """Return a DuckDB connection with one view a table, and the views and functions of `docs/guides/query.md`.

        Args:
            search: Arrays, codebooks and band of the function `best_beam`; the paper's by default.

        Raises:
            InputError: If the folder holds no table, or a file is damaged.
            ImportError: If DuckDB is not installed.
        """
        from mmw.dataset.sql import make_connection

        return make_connection(self, search)

    def check_files(self, table: str) -> list[str]:
        """Return the paths of a table's published files.

        Raises:
            InputError: If its folder may not be read, or holds a file that is none of a dataset.
        """
        return list_files(self.root, table, self.filesystem, self._markers)

    def damage(self, table: str, error: Exception) -> InputError:
        """Return an error that names the first file of a table that cannot be read."""
        try:
            paths = self.check_files(table)
        except InputError as found:
            return found
        return damage_of(self.root, self.spec(table), self.filesystem, paths, error)


def open_dataset(root: str | Path, filesystem: Any = None) -> Dataset:
    """Return the dataset in a folder.

    Args:
        root: Folder, or a URI such as `s3://bucket/folder`.
        filesystem: A pyarrow or fsspec filesystem in which `root` is a path; None finds it from `root`.

    Raises:
        InputError: If the folder is not a dataset, or one of a schema that this version cannot read.

    Examples:
        >>> data = open_dataset("out/quickstart")
        >>> "lidar" in data.tables, data.info["config"]["scenarios"][0]["name"]
        (True, 'town03_roundabout')
    """
    place, found = find_storage(root, filesystem)
    dataset = Dataset(cast(Path, place), found)
    written = dataset.info["schema_version"]
    try:
        major = version_number(written)[0]
    except InputError as error:
        raise InputError(f"{dataset.root / DATASET}: {error}") from error
    if major != version_number(SCHEMA_VERSION)[0]:
        raise InputError(
            f"{dataset.root / DATASET}: schema {written}; this mmw reads {SCHEMA_VERSION}; use the mmw that made it"
        )
    return dataset


def connect(
    root: str | Path, filesystem: Any = None, search: "BeamSearch | None" = None
) -> "duckdb.DuckDBPyConnection":
    """Return a DuckDB connection to the dataset in a folder, see `Dataset.connect` and `open_dataset`.

    Examples:
        >>> connection = connect("out/quickstart")
        >>> where = "frame = 0 AND weather = 'sunny' AND carrier_hz = 28e9"
        >>> connection.sql(f"SELECT agent, round(gain_db, 1) FROM links WHERE {where}").fetchall()
        [('cav_1', -89.5), ('cav_2', -109.1), ('cav_3', -87.5)]
    """
    return open_dataset(root, filesystem).connect(search)
