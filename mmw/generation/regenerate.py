"""Rows of a dataset made once more, from its stored configuration and stages, by the code that made them first.

One frame is traced, and of the sensors and agents only what the rows need. As results depend on neither, the rows equal
the stored ones bit for bit, on the same kind of device.
"""

import io
import os
from collections import defaultdict
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from mmw.config import Config, ScenarioConfig
from mmw.config.sensor_spec import types_that_fill
from mmw.core.bvh_default import BVH_VARIABLE
from mmw.core.bvh_kind import select_bvh
from mmw.core.device import choose_device
from mmw.core.errors import InputError
from mmw.core.timing import StageTimer
from mmw.dataset import open_dataset
from mmw.generation.pipeline import join_batches, make_job, record_frames
from mmw.generation.provenance import stored_config
from mmw.scene.prepare import ASSETS, STAGES, read_scenario, stored_stage
from mmw.scene.rows import static_rows
from mmw.scene.scene_data import SceneData
from mmw.sensors.batch import Batch, TableRows
from mmw.storage.arrow_tables import check_table, table_from_columns
from mmw.storage.manifest import read_markers
from mmw.storage.schemas import table_spec
from mmw.storage.store import Root, store_of

CHANNEL_TABLES = ("links", "paths")
"""Tables that the radio channel fills. All links of a frame are traced, because the ends of a pair share rays."""


@dataclass
class RowRegenerator:
    """Makes rows of one dataset again; a scenario's scene stays on the device until another scenario is asked for."""

    root: Root
    """Dataset; nothing in it is changed."""
    device: str
    """Warp device name, or `auto`."""
    _scenario: str = ""
    _arrays: SceneData | None = None
    _job: Batch | None = None
    _held: ExitStack = field(default_factory=ExitStack)
    _pool: ThreadPoolExecutor = field(default_factory=lambda: ThreadPoolExecutor(2, thread_name_prefix="mmw-remake"))

    def __post_init__(self) -> None:
        store = store_of(self.root)
        self.address = store.address
        self.config = stored_config(store)
        select_bvh(os.environ.get(BVH_VARIABLE) or self.config.compute.bvh)
        self.device = choose_device(self.device)
        self._stages: Path = self._held.enter_context(store.copy(STAGES, ASSETS))

    def __enter__(self) -> "RowRegenerator":
        return self

    def __exit__(self, *_: object) -> None:
        self._pool.shutdown()
        self._held.close()

    def rows(
        self,
        table: str,
        scenario: str,
        weather: str | None = None,
        frame: int | None = None,
        agent: str | None = None,
        sensor: str | None = None,
        **key: Any,
    ) -> pa.Table:
        """Return rows of a table, made now, sorted by the table's key.

        Args:
            table: Table name.
            scenario: Scenario of the configuration.
            weather: One of its weathers; needed by every table with frames.
            frame: One of its frames; needed by every table with frames.
            agent: Only rows of this agent, and only its sensors are traced; None for all.
            sensor: Only rows of this sensor, and only it is traced; None for all.
            key: Further columns of the table's key and the values wanted, such as `peer` or `object_id`.

        Raises:
            InputError: If a name is not known, or the dataset's configuration makes no such row.
        """
        spec = table_spec(table)
        found = self._find(scenario)
        wanted = {"agent": agent, "sensor": sensor, "weather": None if spec.framed else weather, **key}
        wanted = {name: value for name, value in wanted.items() if value is not None}
        columns = [column.name for column in spec.columns]
        for name in wanted:
            if name not in columns:
                raise InputError(f"{name} = {wanted[name]}: table {table} has no such column; leave it out")
        if not spec.framed:
            columns_of = static_rows(self._read(found), self.config, found)[table]
            return _only(table_from_columns(table, {"scenario": scenario, **columns_of}), wanted)
        if weather not in self.config.weathers:
            raise InputError(f"weather = {weather}: the dataset has {', '.join(self.config.weathers)}; name one")
        frames = self.config.frames_of(found)
        if frame is None or not frames.start <= frame < frames.stop:
            raise InputError(f"frame = {frame}: {scenario} has {frames.start} to {frames.stop - 1}; name one")
        job = self._restricted(table, found, agent, sensor)
        collected: TableRows = {weather: defaultdict(list)}
        record_frames(job, [frame], collected)
        batches = collected[weather].get(table)
        if not batches:
            raise InputError(f"table {table}: the dataset's configuration makes no row of it; name another table")
        return _only(join_batches(table, scenario, weather, batches), wanted)

    def _find(self, name: str) -> ScenarioConfig:
        for scenario in self.config.scenarios:
            if scenario.name == name:
                return scenario
        names = ", ".join(scenario.name for scenario in self.config.scenarios)
        raise InputError(f"scenario = {name}: the dataset has {names}; name one")

    def _read(self, scenario: ScenarioConfig) -> SceneData:
        if self._scenario != scenario.name or self._arrays is None:
            self._job = None
            self._arrays = read_scenario(self.config, scenario, stored_stage(self._stages, scenario))
            self._scenario = scenario.name
        return self._arrays

    def _job_of(self, scenario: ScenarioConfig, with_channel: bool) -> Batch:
        """Return the job of a scenario with all its sensors, one frame a batch."""
        arrays = self._read(scenario)
        if self._job is None or (with_channel and self._job.surfaces is None):
            self._job = make_job(
                self.config, scenario, arrays, self.device, 1, self._pool, StageTimer(), with_channel=with_channel
            )
        return self._job if with_channel else replace(self._job, surfaces=None)

    def _restricted(self, table: str, scenario: ScenarioConfig, agent: str | None, sensor: str | None) -> Batch:
        """Return the job that traces what a table's rows need, and nothing else that takes time."""
        types = types_that_fill(table)
        sensors = tuple(
            section for section in self.config.sensors if section.type in types and sensor in (None, section.name)
        )
        if sensor is not None and not sensors and sensor != "antenna":
            names = ", ".join(section.name for section in self.config.sensors if section.type in types)
            raise InputError(f"sensor = {sensor}: table {table} has {names or 'none'} in this dataset; name one")
        arrays = self._read(scenario)
        if agent is not None and agent not in {actor.name for actor in arrays.actors}:
            names = ", ".join(actor.name for actor in arrays.actors if actor.role in ("cav", "rsu"))
            raise InputError(f"agent = {agent}: {scenario.name} has {names}; name one")
        job = self._job_of(scenario, table in CHANNEL_TABLES)
        config: Config = job.config.model_copy(update={"sensors": sensors})
        sensing = None if agent is None else frozenset([agent])
        return replace(job, config=config, arrays=replace(job.arrays, sensing=sensing))


def stored_rows(root: str | Path, table: str, key: dict[str, Any]) -> pa.Table:
    """Return the rows of a dataset that have a key, with the columns in the table's order."""
    spec = table_spec(table)
    frame = key.get("frame")
    rest = {name: value for name, value in key.items() if name not in ("scenario", "weather", "frame")}
    if not spec.framed and "weather" in [column.name for column in spec.columns] and "weather" in key:
        rest["weather"] = key["weather"]
    found = open_dataset(root).read(
        table,
        columns=[column.name for column in spec.columns],
        scenario=key.get("scenario"),
        weather=key.get("weather") if spec.framed else None,
        frames=None if frame is None else range(frame, frame + 1),
    )
    return select_rows(found, rest)


def other_machine(then: str, now: str) -> str:
    """Return why rows that were made on one kind of machine may differ from those made on another."""
    return (
        f"it was made on {then or 'an unknown machine'}, and this is {now}: between the two last bits may differ, and "
        "what hangs on them (docs/concepts/determinism.md); make it again on the first kind to compare bit by bit"
    )


def machines(root: Root, scenario: str, weather: str | None = None, frame: int | None = None) -> list[str]:
    """Return the kinds of machine that made some rows: of a scenario, a weather of it, or a frame; sorted."""
    return sorted(
        {
            str(marker.get("device") or "")
            for marker in read_markers(root)
            if marker["scenario"] == scenario
            and (weather is None or marker["weather"] in (None, weather))
            and (frame is None or marker["weather"] is None or marker["frame_begin"] <= frame < marker["frame_end"])
        }
    )


def differing_columns(one: pa.Table, other: pa.Table) -> list[str]:
    """Return the columns that two tables of the same schema do not share bit for bit; all if they differ in length.

    -0 is not 0 here, and what stands below a null does not count.
    """
    if one.num_rows != other.num_rows:
        return list(one.column_names)
    return [name for name in one.column_names if _bytes(one.select([name])) != _bytes(other.select([name]))]


def _bytes(table: pa.Table) -> bytes:
    """Return what identifies a column: its values as Parquet encodes them plainly."""
    column = table.column(0)
    if pa.types.is_dictionary(column.type):
        column = column.cast(pa.string())
    sink = io.BytesIO()
    plain = pa.table({"column": column.combine_chunks()})
    pq.write_table(plain, sink, use_dictionary=False, compression="none", write_statistics=False, store_schema=False)
    return sink.getvalue()


def select_rows(table: pa.Table, wanted: Mapping[str, Any]) -> pa.Table:
    """Return the rows whose columns have the wanted values."""
    for name, value in wanted.items():
        column = table.column(name)
        if pa.types.is_dictionary(column.type):
            column = column.cast(pa.string())
        table = table.filter(pc.equal(column, pa.scalar(value).cast(column.type)))
    return table


def _only(table: pa.Table, wanted: Mapping[str, Any]) -> pa.Table:
    name = (table.schema.metadata or {})[b"mmw.table"].decode()
    return check_table(name, select_rows(table, wanted)) if wanted else table
