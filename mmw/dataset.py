"""Open a dataset: SQL over every table with DuckDB, or Arrow datasets, without knowing the folder layout.

from mmw.dataset import connect
connect("out/quickstart").sql("SELECT frame, agent, gain_db FROM links WHERE carrier_hz = 28e9").df()
"""

import glob
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyarrow as pa
import pyarrow.dataset as pds

from mmw.tables.manifest import read_dataset
from mmw.tables.schemas import TABLES, table_spec

if TYPE_CHECKING:
    import duckdb

LIDAR_POINTS = """
CREATE OR REPLACE VIEW lidar_points AS
SELECT scenario, weather, frame, agent, sensor, unnest(x) AS x, unnest(y) AS y, unnest(z) AS z,
       unnest(intensity) AS intensity, unnest(ring) AS ring, unnest(object_id) AS object_id, unnest(label) AS label,
       unnest(time_offset) AS time_offset, unnest(return_number) AS return_number
FROM lidar
"""
"""A view with one row a LiDAR return, sensor frame."""

RADAR_POINTS = """
CREATE OR REPLACE VIEW radar_points AS
SELECT scenario, weather, frame, agent, sensor, unnest(range) AS range, unnest(azimuth) AS azimuth,
       unnest(elevation) AS elevation, unnest(velocity) AS velocity, unnest(power_db) AS power_db,
       unnest(snr_db) AS snr_db, unnest(rcs_dbsm) AS rcs_dbsm, unnest(object_id) AS object_id, unnest(label) AS label
FROM radar
"""
"""A view with one row a radar point, sensor frame; power, SNR and RCS are null where the sensor is CARLA's."""

POINT_VIEWS = {"lidar": LIDAR_POINTS, "radar": RADAR_POINTS}
"""Table -> the view that takes its lists apart."""


@dataclass(frozen=True)
class Dataset:
    """A dataset folder."""

    root: Path

    @cached_property
    def info(self) -> dict[str, Any]:
        """`dataset.json`: schema version, configuration, its hash, versions."""
        return read_dataset(self.root)

    @property
    def tables(self) -> tuple[str, ...]:
        """Names of the tables that have files."""
        return tuple(name for name in TABLES if any((self.root / name).rglob("*.parquet")))

    def arrow(self, table: str) -> pds.Dataset:
        """Return a table as an Arrow dataset that skips the files of other scenarios and weathers.

        Raises:
            ValueError: If the table is not known or has no file.
        """
        table_spec(table)
        if table not in self.tables:
            raise ValueError(
                f"{self.root}: table {table!r} has no file; it holds {', '.join(self.tables) or 'no table'}"
            )
        partitioning = pds.HivePartitioning.discover(infer_dictionary=True)
        return pds.dataset(self.root / table, format="parquet", partitioning=partitioning)

    def read(
        self,
        table: str,
        *,
        columns: Sequence[str] | None = None,
        scenario: str | None = None,
        weather: str | None = None,
        frames: range | None = None,
        agent: str | None = None,
    ) -> pa.Table:
        """Return the rows of a table, sorted by scenario, weather, frame and the rest of the table's key.

        Args:
            table: Table name.
            columns: Columns to read; None reads all.
            scenario: Only this scenario.
            weather: Only this weather.
            frames: Only these frames; a step is allowed.
            agent: Only rows of this agent.

        Raises:
            ValueError: If the table is not known or has no file.
        """
        conditions = [
            pds.field(name) == value for name, value in _given(scenario=scenario, weather=weather, agent=agent)
        ]
        if frames is not None:
            conditions += [pds.field("frame") >= min(frames, default=0), pds.field("frame") <= max(frames, default=-1)]
            if abs(frames.step) != 1:
                conditions.append(pds.field("frame").isin(list(frames)))
        expression = None
        for condition in conditions:
            expression = condition if expression is None else expression & condition
        return self.arrow(table).to_table(columns=list(columns) if columns else None, filter=expression)

    def connect(self) -> "duckdb.DuckDBPyConnection":
        """Return a DuckDB connection with one view a table, and `lidar_points` and `radar_points` with
        one row a point.

        Raises:
            ValueError: If the folder holds no table.
            ImportError: If DuckDB is not installed.
        """
        try:
            import duckdb
        except ImportError as error:
            raise ImportError("mmw.dataset.connect needs DuckDB; install it with: pip install 'mmw[query]'") from error
        if not self.tables:
            raise ValueError(f"{self.root}: holds no table yet; run mmw.run first")
        connection = duckdb.connect()
        for name in self.tables:
            files = f"{glob.escape(str(self.root / name))}/**/*.parquet".replace("'", "''")
            connection.execute(
                f"CREATE VIEW {name} AS SELECT * FROM "
                f"read_parquet('{files}', hive_partitioning = true, hive_types_autocast = false)"
            )
        for name, view in POINT_VIEWS.items():
            if name in self.tables:
                connection.execute(view)
        return connection


def open_dataset(root: str | Path) -> Dataset:
    """Return the dataset in a folder.

    Raises:
        ValueError: If the folder is not a dataset.
    """
    dataset = Dataset(Path(root).resolve())
    read_dataset(dataset.root)
    return dataset


def connect(root: str | Path) -> "duckdb.DuckDBPyConnection":
    """Return a DuckDB connection to the dataset in a folder: one view a table, `lidar_points` and `radar_points`."""
    return open_dataset(root).connect()


def _given(**values: str | None) -> list[tuple[str, str]]:
    return [(name, value) for name, value in values.items() if value is not None]
