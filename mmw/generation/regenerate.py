"""Generate rows of a dataset again, from its stored configuration and stages, by the code of a run.

One frame is traced, and of the sensors and agents only those that the rows need. As results depend on neither, the rows
equal the stored ones bit for bit, on the same kind of machine.
"""

import io
import os
from collections import defaultdict
from collections.abc import Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.compute as pc
import pyarrow.parquet as pq

from mmw.config import ScenarioConfig
from mmw.config.agent_keys import AGENT_ROLES
from mmw.config.sensor_spec import types_that_fill
from mmw.core.bvh_default import BVH_VARIABLE
from mmw.core.bvh_kind import select_bvh
from mmw.core.device import choose_device
from mmw.core.errors import InputError
from mmw.core.timing import StageTimer
from mmw.dataset import open_dataset
from mmw.generation.capture import capture_frames
from mmw.generation.pipeline import join_batches, make_batch
from mmw.generation.provenance import stored_config
from mmw.scene.input_files import hash_inputs
from mmw.scene.prepare import read_scenario, stored_stage
from mmw.scene.rows import static_rows
from mmw.scene.scene_data import SceneData
from mmw.scene.stage_digests import ASSETS, STAGES
from mmw.sensors.batch import Batch, TableRows
from mmw.storage.arrow_tables import check_table, table_from_columns
from mmw.storage.identity import changed_inputs
from mmw.storage.manifest import read_dataset, read_markers
from mmw.storage.schemas import table_spec
from mmw.storage.store import Root, store_of

CHANNEL_TABLES = ("links", "path_geometry", "path_gains")
"""Tables that the radio channel fills. All links of a frame are traced, because the ends of a pair share rays."""


class RowRegenerator:
    """Generates rows of one dataset again; a scenario stays on the device until rows of another one are requested."""

    def __init__(self, root: Root, device: str) -> None:
        """Read the configuration of a dataset, in which nothing is changed.

        Args:
            root: Dataset.
            device: Warp device name, or `auto`.
        """
        store = store_of(root)
        self.address = store.address
        self.config = stored_config(store)
        self._inputs = read_dataset(store).get("inputs", {})
        select_bvh(os.environ.get(BVH_VARIABLE) or self.config.compute.bvh)
        self.device = choose_device(device)
        self._held = ExitStack()
        self._pool = self._held.enter_context(ThreadPoolExecutor(2, thread_name_prefix="mmw-regenerate"))
        self._stages: Path = self._held.enter_context(store.local_copy(STAGES, ASSETS))
        self._arrays: SceneData | None = None
        self._scenario = ""
        self._batch: Batch | None = None

    def __enter__(self) -> "RowRegenerator":
        return self

    def __exit__(self, *_: object) -> None:
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
        """Generate rows of a table, sorted by the table's key.

        Args:
            table: Table name.
            scenario: Scenario of the configuration.
            weather: One of its weathers; needed by every table with frames.
            frame: One of its frames; needed by every table with frames.
            agent: Only rows of this agent, and only its sensors are traced; None for all.
            sensor: Only rows of this sensor, and only it is traced; None for all.
            key: Values of further columns of the table's key, such as `peer` or `object_id`.

        Raises:
            InputError: If a name is not known, the dataset's configuration makes no such row, or the user's stage has
                changed.
        """
        spec = table_spec(table)
        found = self.config.scenario(scenario)
        wanted = {"agent": agent, "sensor": sensor, "weather": None if spec.of_weather else weather, **key}
        wanted = {name: value for name, value in wanted.items() if value is not None}
        columns = [column.name for column in spec.columns]
        for name in wanted:
            if name not in columns:
                raise InputError(f"{name} = {wanted[name]}: table {table} has no such column; leave it out")
        if not spec.framed:
            columns_of = static_rows(self._read(found), self.config)[table]
            return check_table(
                table, select_rows(table_from_columns(table, {"scenario": scenario, **columns_of}), wanted)
            )
        if not spec.by_weather:
            weather = self.config.weathers[0]
        if weather not in self.config.weathers:
            raise InputError(f"weather = {weather}: the dataset has {', '.join(self.config.weathers)}; name one")
        frames = self.config.frames_of(found)
        if frame is None or not frames.start <= frame < frames.stop:
            raise InputError(f"frame = {frame}: {scenario} has {frames.start} to {frames.stop - 1}; name one")
        collected: TableRows = {weather: defaultdict(list)}
        capture_frames(self._restricted(table, found, agent, sensor), [frame], collected)
        batches = collected[weather].get(table)
        if not batches:
            raise InputError(f"table {table}: the dataset's configuration makes no row of it; name another table")
        return check_table(table, select_rows(join_batches(table, scenario, weather, batches), wanted))

    def _read(self, scenario: ScenarioConfig) -> SceneData:
        if self._scenario != scenario.name or self._arrays is None:
            self._batch = None
            self._check_stage(scenario)
            self._arrays = read_scenario(self.config, scenario, stored_stage(self._stages, scenario))
            self._scenario = scenario.name
        return self._arrays

    def _check_stage(self, scenario: ScenarioConfig) -> None:
        """Check that a stage which is read where the user has it is the one that was traced."""
        recorded = self._inputs.get(scenario.name)
        if scenario.stage is None or recorded is None:
            return
        now = hash_inputs(self.config.model_copy(update={"scenarios": (scenario,)}), Path())
        if changes := changed_inputs({"inputs": {scenario.name: recorded}}, {scenario.name: now[scenario.name]}):
            raise InputError(
                f"{self.address}: {'; '.join(changes)} since the dataset was made; its rows cannot be made again; put "
                "the old content back"
            )

    def _restricted(self, table: str, scenario: ScenarioConfig, agent: str | None, sensor: str | None) -> Batch:
        """Return the batch of a scenario that traces only what a table's rows need, one frame at a time."""
        named = {section.name: section for section in self.config.sensors if section.type in types_that_fill(table)}
        if sensor is not None and sensor not in named and sensor not in self.config.channel.antenna_names:
            raise InputError(
                f"sensor = {sensor}: table {table} has {', '.join(named) or 'none'} in this dataset; name one"
            )
        arrays = self._read(scenario)
        if agent is not None and agent not in {actor.name for actor in arrays.actors}:
            names = ", ".join(actor.name for actor in arrays.actors if actor.role in AGENT_ROLES)
            raise InputError(f"agent = {agent}: {scenario.name} has {names}; name one")
        with_channel = table in CHANNEL_TABLES
        if self._batch is None or (with_channel and self._batch.surfaces is None):
            self._batch = make_batch(
                self.config, scenario, arrays, self.device, 1, self._pool, StageTimer(), with_channel=with_channel
            )
        batch = self._batch
        sensors = tuple(section for section in named.values() if sensor in (None, section.name))
        return replace(
            batch,
            config=self.config.model_copy(update={"sensors": sensors}),
            arrays=replace(batch.arrays, sensing=None if agent is None else frozenset([agent])),
            surfaces=batch.surfaces if with_channel else None,
        )


def stored_rows(root: str | Path, table: str, key: dict[str, Any]) -> pa.Table:
    """Return the rows of a dataset that have a key, with the columns in the table's order."""
    spec, frame = table_spec(table), key.get("frame")
    names = [column.name for column in spec.columns]
    found = open_dataset(root).read(
        table,
        columns=names,
        scenario=key.get("scenario"),
        weather=key.get("weather") if spec.of_weather else None,
        frames=None if frame is None else range(frame, frame + 1),
    )
    return select_rows(found, {name: value for name, value in key.items() if name in names})


def other_machine(then: str, now: str) -> str:
    """Explain why rows of one kind of machine may differ from those of another."""
    return (
        f"it was made on {then or 'an unknown machine'}, and this is {now}: between the two last bits may differ, and "
        "what hangs on them (docs/concepts/determinism.md); make it again on the first kind to compare bit by bit"
    )


def machines(root: Root, scenario: str, weather: str | None = None, frame: int | None = None) -> list[str]:
    """Return the kinds of machine that generated a scenario, a weather of it, or a frame, sorted."""
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

    -0 is not 0 here, and values below a null do not count.
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
