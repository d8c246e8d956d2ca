"""Simulate a scenario frame by frame in memory: replay the rows that a run would store, or step live traffic."""

import logging
import os
import tempfile
import threading
import weakref
from collections.abc import Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from operator import index
from pathlib import Path
from typing import Literal, overload

import pyarrow as pa
import pyarrow.compute as pc

from mmw.config import ScenarioConfig
from mmw.config.load import Source
from mmw.core.device import writer_threads
from mmw.core.errors import InputError
from mmw.core.timing import StageTimer
from mmw.dataset import Dataset
from mmw.dataset.frame import Frame
from mmw.dataset.table_reader import MemoryTables
from mmw.generation.chosen_scenario import choose_scenario
from mmw.generation.configuration_warnings import configuration_warnings, surface_warnings
from mmw.generation.live.live_run import LiveRun
from mmw.generation.live.saved_export import DATASET, save_export
from mmw.generation.pipeline import join_batches, make_batch, trace_work
from mmw.generation.precompile import compiled_ahead, warm_up
from mmw.generation.shards import Work
from mmw.scene.prepare import prepare_scenario, read_scenario
from mmw.scene.rows import static_rows
from mmw.sensors.batch import Batch, TableRows
from mmw.storage.arrow_tables import normalize_names, table_from_columns
from mmw.traffic.live.control import Control

LOGGER = logging.getLogger(__name__)

FRAMES_PER_LAUNCH = {"cpu": 1, "cuda": 16}
"""Frames that an iteration traces in one launch at most; `compute.batch_frames` may be fewer. On an H100 a frame among
16 takes a sixth of its time alone (`docs/development/scaling.md`); on a CPU nine tenths, and the first comes later.
Design values."""


class Simulation:
    """Frames of one scenario in one weather, traced when they are requested; nothing of them is written.

    A frame is the `mmw.Frame` of a dataset: its tables have the rows that `mmw.generate` stores for the same
    configuration, bit for bit on the same kind of machine. It keeps its own rows only, so that frames can be kept
    after the simulation is closed. `frame.data.read` gives the tables `objects`, `sensors` and `materials` too.

    Iterating traces the frames in order, and again each time. `len(simulation)` counts them, `simulation[i]` traces
    the i-th, and `simulation.frame(k)` the one with number k. Notes on the scenario are records of the logger `mmw`.

    Examples:
        >>> import mmw
        >>> config = mmw.load_config("quickstart", ["frames.count=2", "sensors=[{type: gnss}]"])
        >>> with mmw.Simulation(config) as simulation:
        ...     for frame in simulation:
        ...         print(frame.frame, frame.agents["cav_1"].sensor("gnss").speed > 0.0)
        0 True
        1 True
    """

    def __init__(
        self,
        config: Source,
        *,
        scenario: str | None = None,
        weather: str | None = None,
        base: str | os.PathLike[str] | None = None,
        device: str = "auto",
        mode: Literal["replay", "live"] = "replay",
    ) -> None:
        """Simulate the traffic, read the scenario, and load it onto the device.

        Its USD stage is in a temporary folder, which is removed by `close`, by the end of a `with` block, or with the
        object.

        Args:
            config: Path of a YAML file; name of a shipped configuration, such as `quickstart`; content of a file as a
                mapping; or a `Config`.
            scenario: One of its scenarios; the first by default.
            weather: One of its weathers; the first by default.
            base: Folder that relative paths of input files start from. By default that of the configuration file; the
                current folder for a mapping and a `Config`.
            device: `cpu`, `cuda:N`, or `auto` for `compute.device`, by default the first CUDA device, else the CPU.
            mode: `replay` traces the frames of the configuration. `live` steps them one by one, with controls.

        Raises:
            ConfigError: If the configuration or a file that it names cannot be used; one line for each problem.
            InputError: If there is no such scenario, weather, device or mode, or its traffic cannot be stepped.
            OutOfSpaceError: If the disk of temporary files is full.
        """
        source = choose_scenario(config, scenario, weather, base, device)
        self.config = found = source.config
        """The configuration, validated."""
        chosen = source.scenario
        self.scenario = chosen.name
        """Name of the scenario."""
        self.weather = source.weather
        """Name of the weather."""
        self.device = source.device
        """Warp device that traces."""
        frames = found.frames_of(chosen)
        self.frames = range(frames.start, frames.stop)
        """Numbers of the frames."""
        self.rate_hz = found.frame_rate_of(chosen)
        """Frames a second: frame n is n / rate_hz after the start of the scenario [Hz]."""
        self._lock = threading.Lock()
        self._batch: Batch | None = None
        self._live: LiveRun | None = None
        if mode == "live":
            self._live = LiveRun(found, chosen, self.weather, source.base, source.place, self.device)
            self.frames = self._live.frames
            self.reset()
            return
        if mode != "replay":
            raise InputError(f"mode = {mode!r}: there are replay and live; name one of them")
        self._step = min(found.compute.batch_frames, FRAMES_PER_LAUNCH[self.device.partition(":")[0]])
        with ExitStack() as stack:
            self._load(chosen, source.base, stack)
            self._finalizer = weakref.finalize(self, stack.pop_all().close)

    def _load(self, scenario: ScenarioConfig, base: Path, stack: ExitStack) -> None:
        """Load the scenario onto the device; what it keeps open is closed with the stack."""
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="mmw_simulation_")))
        threads = writer_threads(self.config.compute.writer_threads, 1)
        pool = stack.enter_context(ThreadPoolExecutor(threads, thread_name_prefix="mmw-simulation"))
        # The first weather of a run decides which textures have holes; the others would be prepared for nothing.
        weathers = tuple(dict.fromkeys((self.config.weathers[0], self.weather)))
        config = self.config.model_copy(update={"weathers": weathers})
        with compiled_ahead(config, self.device) as kernels:
            skies = warm_up(config, pool)
            stage = prepare_scenario(self.config, scenario, base, folder)
            arrays = read_scenario(self.config, scenario, stage)
            _log(configuration_warnings(arrays, self.config, scenario))
            for future in (*kernels, *skies):
                future.result()
        self._batch = make_batch(config, scenario, arrays, self.device, self._step, pool, StageTimer())
        _log(surface_warnings(self._batch.surfaces))
        _log(self._batch.texture_notes())
        self.static_tables: Mapping[str, pa.Table] = {
            name: table_from_columns(name, {"scenario": self.scenario, **columns})
            for name, columns in static_rows(arrays, self.config).items()
        }
        """Tables that no frame changes: `objects`, `sensors`, `materials`."""

    def __enter__(self) -> "Simulation":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Free the device and remove the temporary folder; frames stay usable, and closing again changes nothing."""
        if self._live is not None:
            self._live.close()
            return
        with self._lock:
            self._batch = None
            self._finalizer()

    def reset(self, seed: int | None = None) -> Frame:
        """Start a live episode and return its first frame; the object is made with the seed of the configuration.

        Without a seed, with the same, or where the configuration has a `scene_seed`, the town stays on the device,
        which is fast. Otherwise another seed makes another fleet, whose stage is written and read anew.

        Args:
            seed: In place of `seed` of the configuration, from now on.

        Raises:
            InputError: If the mode is not live, the seed is none, or the simulation is closed.
        """
        frame = self._stepped("reset").reset(seed)
        self.static_tables = self._stepped("reset").static_tables
        _log(self._stepped("reset").new_notes())
        return frame

    def step(self, controls: Mapping[str, Control | None] | None = None) -> Frame:
        """Advance live traffic by 10 ms and return the new frame, of which nothing is traced before it is looked at.

        Args:
            controls: Name of an actor -> what it does; holds until the next control of the same actor. `None` or
                `Control()` gives a vehicle back to its driver.

        Raises:
            InputError: If the mode is not live, the episode is over, there is no such actor, it cannot do this, or the
                simulation is closed. Traffic has not moved then.
        """
        return self._stepped("step").step(controls)

    def remove(self, name: str) -> None:
        """Take an actor out of live traffic: no sensor, link or other vehicle sees it until it is added again.

        The frame after the present one is known already, for velocities; the actor is absent from the next one on.

        Args:
            name: A vehicle, pedestrian, cyclist or drone.

        Raises:
            InputError: If the mode is not live, there is no such actor, it is absent or stands still in the town, or
                the simulation is closed. Nothing has changed then.
        """
        self._stepped("remove").remove(name)

    def add(self, name: str, pose: Sequence[float] | None = None) -> None:
        """Put a removed actor back into live traffic, two frames after the present one, as a pose of a `Control` is.

        It stands still for four frames at least. At a pose it stays until a control (`pose`, or `steering_rad` of a
        vehicle) moves it.

        Args:
            name: An actor that was removed, at least one step before.
            pose: Body to world (x, y, z, qx, qy, qz, qw), or (x, y, z, yaw), whatever is in its way. Without one, a
                vehicle of the engine idm comes back with its driver, at the safe place nearest to where it left its
                route.

        Raises:
            InputError: If the mode is not live, there is no such actor, it is there or stands still in the town, the
                pose is not finite, there is no safe place on the route, the traffic is of another engine, or the
                simulation is closed. Nothing has changed then.
        """
        self._stepped("add").add(name, pose)

    @overload
    def save(
        self, out: str | os.PathLike[str], *, format: Literal["dataset"] = "dataset", overwrite: bool = False
    ) -> Dataset: ...
    @overload
    def save(self, out: str | os.PathLike[str], *, format: str, overwrite: bool = False) -> Dataset | Path: ...
    def save(self, out: str | os.PathLike[str], *, format: str = DATASET, overwrite: bool = False) -> Dataset | Path:
        """Write all frames of the live episode up to the present one as a dataset, and open it.

        Every sensor of every frame is in it, also those that were not looked at; they are traced now, from the poses
        that were driven. Rows that were looked at are the same, bit for bit.

        Args:
            out: Dataset folder, or `s3://bucket/folder`.
            format: `dataset`, or a format of `mmw export`, such as `mcap` for Foxglove and ROS 2; `out` is then a
                local folder for its files, and is returned.
            overwrite: Replace the data, or the export, in the folder.

        Raises:
            InputError: If the mode is not live, there is no such format, the folder has other data, or the simulation
                is closed.
            MissingPackageError: If the format needs a package that is not installed.
            Error: If the disk is full.
        """
        live = self._stepped("save")
        if format == DATASET:
            return live.save(out, overwrite)
        return save_export(lambda folder: live.save(folder, False), out, format, overwrite, live.name)

    @property
    def lane_changes(self) -> list[tuple[float, str, str, str]]:
        """Changes of lanes in a live episode: time of the decision [s], vehicle, lane before, lane after."""
        return self._stepped("lane_changes").lane_changes

    def _stepped(self, method: str) -> LiveRun:
        if self._live is None:
            raise InputError(f"simulation of {self.scenario}: {method} needs mode='live'; this one replays")
        return self._live

    def _check_replayed(self) -> None:
        if self._live is not None:
            raise InputError(f"simulation of {self.scenario}: is live; use reset and step, or mode='replay'")

    def __len__(self) -> int:
        return len(self.frames)

    def __iter__(self) -> Iterator[Frame]:
        self._check_replayed()
        first = self.frames.start
        while first < self.frames.stop:
            some = range(first, min(first + self._step, self.frames.stop))
            yield from self._trace(some)
            first = some.stop

    def __getitem__(self, position: int) -> Frame:
        """Trace the frame at a position, counted from 0, or from the end if negative.

        Raises:
            InputError: If there is no such position.
        """
        place = index(position)
        if not -len(self) <= place < len(self):
            raise InputError(f"simulation[{place}]: has {len(self)} frames; give 0 to {len(self) - 1}")
        return self._trace(range(self.frames[place], self.frames[place] + 1))[0]

    def frame(self, number: int) -> Frame:
        """Trace the frame with a number, as `Dataset.frame` reads it.

        Raises:
            InputError: If the configuration has no such frame.
        """
        number = index(number)
        if number not in self.frames:
            first, last = self.frames.start, self.frames.stop - 1
            raise InputError(f"frame = {number}: {self.scenario} has {first} to {last}; name one of them")
        return self._trace(range(number, number + 1))[0]

    def _trace(self, frames: range) -> list[Frame]:
        """Trace some frames, in one launch if the memory is enough."""
        found: list[Frame] = []
        work = Work(self.scenario, frames.start, frames.stop, (self.weather,))
        self._check_replayed()
        with self._lock:  # the device holds one batch of frames
            if self._batch is None:
                raise InputError(f"simulation of {self.scenario}: is closed; make another one")
            self._step = trace_work(
                self._batch, work, self._step, _LogReporter(), lambda some, rows: found.extend(self._frames(some, rows))
            )
        return found

    def _frames(self, frames: range, rows: TableRows) -> Iterator[Frame]:
        """Yield the frames of a batch, each with a copy of its own rows."""
        whole = {
            name: join_batches(name, self.scenario, self.weather, batches)
            for name, batches in rows[self.weather].items()
        }
        root = f"simulation of {self.scenario}"
        for frame in frames:
            own = {name: _rows_of(table, frame) for name, table in whole.items()}
            yield Frame(
                MemoryTables(root, {**own, **self.static_tables}, self.rate_hz), self.scenario, self.weather, frame
            )


def _log(notes: Iterable[str]) -> None:
    for note in notes:
        LOGGER.warning("%s", note)


def _rows_of(table: pa.Table, frame: int) -> pa.Table:
    """Return the rows of a frame, sharing nothing with the others."""
    return normalize_names(table.filter(pc.equal(table.column("frame"), frame)))


class _LogReporter:
    """`Reporter` of a simulation."""

    def __init__(self) -> None:
        self.timer = StageTimer()

    def warn_once(self, text: str) -> None:
        LOGGER.warning("%s", text)

    def advance(self, frames: int, where: str) -> None:
        LOGGER.debug("%s: %d frames", where, frames)
