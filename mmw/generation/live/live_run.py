"""Run a live simulation: make its world, step it, trace its frames on demand, save them."""

import os
import tempfile
import threading
import weakref
from collections.abc import Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import pyarrow as pa

from mmw.config import Config, ScenarioConfig
from mmw.config.load import in_config
from mmw.core.constants import FRAME_RATE_HZ
from mmw.core.device import writer_threads
from mmw.core.errors import InputError
from mmw.core.kinematics import differentiate
from mmw.core.timing import StageTimer
from mmw.dataset import Dataset, open_dataset
from mmw.generation.configuration_warnings import configuration_warnings, surface_warnings
from mmw.generation.live.episode import Episode
from mmw.generation.live.frame_tables import FrameTables, LiveFrame, Maker, table_makers
from mmw.generation.live.recorded_stage import RecordedStage
from mmw.generation.pipeline import make_batch
from mmw.generation.precompile import compiled_ahead, warm_up
from mmw.scene.prepare import make_demand, read_scenario, write_stage
from mmw.scene.rows import static_rows
from mmw.scene.sources import scenario_source
from mmw.sensors.batch import Batch
from mmw.storage.arrow_tables import table_from_columns
from mmw.traffic.demand import TrafficDemand, VehicleTrack
from mmw.traffic.drones import fly_drones
from mmw.traffic.live.control import Control
from mmw.traffic.live.live_traffic import LiveTraffic, check_live
from mmw.usd.vehicle_catalog import load_catalog

STAGE_FRAMES = 2
"""Frames of the stage that the world is read from; poses of later ones come from the traffic."""


@dataclass
class World:
    """Town and actors of one seed on the device."""

    config: Config
    demand: TrafficDemand
    batch: Batch
    static: Mapping[str, pa.Table]
    lock: threading.Lock
    """Held while a frame is on the device."""
    folder: tempfile.TemporaryDirectory[str]
    """Its stage and textures."""
    makers: Mapping[str, list[Maker]]
    """Table -> sources of its rows, of those that frames change."""
    shown: tuple[Episode, int] | None = None
    """Episode and frame on the device."""
    present: Batch | None = None
    """`batch` for them."""
    is_closed: bool = False

    def close(self) -> None:
        """Free the device and remove the files."""
        with self.lock:
            self.is_closed, self.shown, self.present = True, None, None
            self.folder.cleanup()

    @contextmanager
    def showing(self, episode: Episode, frame: int, agent: str | None, where: str) -> Iterator[Batch]:
        """Keep a frame of an episode on the device; the sensors of one agent count, or of all for None.

        Raises:
            InputError: If the simulation is closed.
        """
        with self.lock:
            if self.is_closed:
                raise InputError(
                    f"{where}: was closed or reset with another seed before this was looked at; look at it earlier"
                )
            if self.shown != (episode, frame):
                self.shown = None
                scene, arrays = self.batch.scene, episode.arrays(frame)
                motion = differentiate(arrays.poses, arrays.pose_dt)
                scene.replace_arrays(arrays, motion)
                scene.load_batch([frame])
                self.present, self.shown = replace(self.batch, arrays=arrays, motion=motion), (episode, frame)
            assert self.present is not None
            batch = self.present
            yield batch if agent is None else replace(batch, arrays=replace(batch.arrays, sensing=frozenset([agent])))


class LiveRun:
    """World, present episode and saved datasets of a live simulation; the methods of `Simulation` call it."""

    def __init__(
        self, config: Config, scenario: ScenarioConfig, weather: str, base: Path, place: Path | str, device: str
    ):
        """Make the world of the configuration's seed, and go to the first frame.

        Raises:
            InputError: If the scenario has no town, an engine that cannot be stepped, another rate than 100 Hz or too
                few frames.
        """
        self._config, self._scenario, self._weather = config, scenario, weather
        self._base, self._place, self._device = base, place, device
        frames = config.frames_of(scenario)
        self.frames = range(max(frames.start, 1), frames.stop)
        self.name = f"simulation of {scenario.name}"
        with in_config(place):
            self._check()
        self._stack = ExitStack()
        self._finalizer = weakref.finalize(self, self._stack.close)
        threads = writer_threads(config.compute.writer_threads, 1)
        self._pool = self._stack.enter_context(ThreadPoolExecutor(threads, thread_name_prefix="mmw-live"))
        self._world: World | None = None
        self._episode: Episode | None = None
        self._notes: list[str] = []
        self._is_closed = False

    def _check(self) -> None:
        scenario, rate = self._scenario, self._config.frame_rate_of(self._scenario)
        where = f"scenario {scenario.name!r}"
        if scenario.traffic is None:
            raise InputError(f"{where}: has a stage, whose motion is recorded; mode live needs town and traffic")
        try:
            check_live(scenario.traffic.engine)
        except InputError as error:
            raise InputError(f"{where}: traffic.{error}") from None
        if rate != FRAME_RATE_HZ:
            raise InputError(f"{where}: frames.rate_hz = {rate}: mode live steps at 100 Hz; remove rate_hz")
        if not self.frames:
            raise InputError(
                f"{where}: frames end at {self.frames.stop}: frame 0 is there for the velocities of frame 1, the first "
                "live one; give frames.count = 2 or more"
            )

    def reset(self, seed: int | None = None) -> LiveFrame:
        """Start anew, with a seed or the one before; return the first frame.

        Raises:
            InputError: If the seed is none, the world cannot be made, or the simulation is closed.
        """
        self._check_open("reset")
        if seed is not None and (isinstance(seed, bool) or not isinstance(seed, int) or seed < 0):
            raise InputError(f"seed = {seed!r}; a whole number from 0 is needed")
        if self._world is None or (seed is not None and seed != self._world.config.seed):
            if seed is not None:
                self._config = self._config.model_copy(update={"seed": seed})
            self._make_world(self._config)
        else:
            self._start(self._world, LiveTraffic(self._world.demand, self._drones(self._world.demand)))
        return self.frame()

    def _drones(self, demand: TrafficDemand) -> list[VehicleTrack]:
        return fly_drones(self._scenario.uavs, demand.frame_count)

    def _start(self, world: World, traffic: LiveTraffic) -> None:
        self._end_episode()
        self._episode = Episode(traffic, world.batch.arrays, self.frames.start)

    def _end_episode(self) -> None:
        """Free what the engine of the present episode holds; its frames can still be looked at."""
        if self._episode is not None:
            self._episode.traffic.close()
        self._episode = None

    def _make_world(self, config: Config) -> None:
        scenario = self._scenario
        with in_config(self._place):
            source = scenario_source(scenario, self._base)
            demand = make_demand(config, scenario, source, load_catalog(), self._base)
            try:
                traffic = LiveTraffic(demand, self._drones(demand))
            except InputError as error:
                raise InputError(f"scenario {scenario.name!r}: traffic.{error}") from error
            traffic.advance(STAGE_FRAMES)
        if self._world is not None:  # the device has room for one
            self._world.close()
            self._end_episode()
            self._world = None
        holder = tempfile.TemporaryDirectory(prefix="mmw_simulation_")
        folder = Path(holder.name)
        weathers = tuple(dict.fromkeys((config.weathers[0], self._weather)))
        some = config.model_copy(update={"weathers": weathers})
        first = config.frames_of(scenario).model_copy(update={"start": 0, "count": STAGE_FRAMES - 1})
        with compiled_ahead(some, self._device) as kernels:
            skies = warm_up(some, self._pool)
            stage = write_stage(config, scenario, self._base, folder, traffic.tracks)
            arrays = read_scenario(config.model_copy(update={"frames": first}), scenario, stage)
            self._notes = [*traffic.notes, *configuration_warnings(arrays, config, scenario)]
            for future in (*kernels, *skies):
                future.result()
        batch = make_batch(some, scenario, arrays, self._device, 1, self._pool, StageTimer())
        batch = replace(batch, puts_off=True)
        self._notes += [*surface_warnings(batch.surfaces), *batch.texture_notes()]
        static = {
            name: table_from_columns(name, {"scenario": scenario.name, **columns})
            for name, columns in static_rows(arrays, config).items()
        }
        self._world = World(config, demand, batch, static, threading.Lock(), holder, table_makers(config))
        self._start(self._world, traffic)

    def new_notes(self) -> list[str]:
        """Return the notes on a world that was made since the last call."""
        notes, self._notes = self._notes, []
        return notes

    @property
    def static_tables(self) -> Mapping[str, pa.Table]:
        """Tables that no frame changes."""
        return {} if self._world is None else self._world.static

    @property
    def lane_changes(self) -> list[tuple[float, str, str, str]]:
        """Changes of lanes in this episode."""
        return self._present("lane_changes")[1].traffic.lane_changes

    def _present(self, method: str) -> tuple[World, Episode]:
        self._check_open(method)
        if self._world is None or self._episode is None:
            raise InputError(f"{self.name}: {method} before reset; call reset first")
        return self._world, self._episode

    def _check_open(self, method: str) -> None:
        if self._is_closed:
            raise InputError(f"{self.name}: {method}: is closed; make another one")

    def frame(self) -> LiveFrame:
        """Return the present frame."""
        world, episode = self._present("frame")
        number = episode.frame

        def load(agent: str | None) -> AbstractContextManager[Batch]:
            return world.showing(episode, number, agent, self.name)

        scenario = self._scenario.name
        tables = FrameTables(self.name, scenario, self._weather, number, world.static, load, world.makers)
        return LiveFrame(tables, scenario, self._weather, number)

    def step(self, controls: Mapping[str, Control | None] | None = None) -> LiveFrame:
        """Go to the next frame.

        Raises:
            InputError: If the episode is over, a control cannot be obeyed, or the simulation is closed.
        """
        _, episode = self._present("step")
        if controls is not None and not isinstance(controls, Mapping):
            raise InputError(f"controls = {controls!r}: a mapping of actors' names to mmw.Control is needed")
        if episode.frame + 1 >= self.frames.stop:
            raise InputError(
                f"{self.name}: frame {episode.frame} is the last of the episode; reset it, or raise frames.count "
                f"({self.frames.stop})"
            )
        episode.step(controls or {})
        return self.frame()

    def save(self, out: str | os.PathLike[str], overwrite: bool) -> Dataset:
        """Write the frames of this episode as a dataset.

        Raises:
            InputError: If nothing was driven, the folder has other data, or the simulation is closed.
            Error: If the disk is full.
        """
        world, episode = self._present("save")
        count = episode.frame + 1 - self.frames.start
        frames = world.config.frames_of(self._scenario)
        frames = frames.model_copy(update={"start": self.frames.start, "count": count})
        output = world.config.output.model_copy(update={"dir": os.fspath(out)})
        compute = world.config.compute.model_copy(update={"device": self._device, "workers": 1})
        own = {"frames": frames, "output": output, "compute": compute, "scenarios": (self._scenario,)}
        tracks = [replace(track, poses=track.poses[: episode.frame + 2]) for track in episode.traffic.tracks]
        stage = RecordedStage(world.config.model_copy(update=own), self._scenario, self._base, tracks)
        stage.write_dataset(self._place, overwrite)
        return open_dataset(out)

    def close(self) -> None:
        """Free the device; frames that have been looked at stay usable."""
        self._is_closed = True
        if self._world is not None:
            self._world.close()
        self._end_episode()
        self._world = None
        self._finalizer()
