"""Run a live simulation: make its world, step it, trace its frames on demand, save them."""

import os
import tempfile
import threading
import weakref
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import pyarrow as pa

from mmw.config import Config, ScenarioConfig
from mmw.config.load import in_config
from mmw.core.constants import FRAME_RATE_HZ
from mmw.core.cuda import retain_memory
from mmw.core.device import GPU_BYTES_PER_WORKER, writer_threads
from mmw.core.errors import InputError
from mmw.core.kinematics import differentiate_row, placed
from mmw.core.remember import remembered
from mmw.core.timing import StageTimer
from mmw.dataset import Dataset, open_dataset
from mmw.generation.configuration_warnings import configuration_warnings, surface_warnings
from mmw.generation.live.episode import Episode
from mmw.generation.live.frame_tables import FrameTables, LiveFrame, Maker, table_makers
from mmw.generation.live.recorded_stage import RecordedStage
from mmw.generation.pipeline import make_batch
from mmw.generation.precompile import compiled_ahead, warm_up
from mmw.scene.prepare import make_demand, margin_frames, read_scenario, write_stage
from mmw.scene.rows import static_rows
from mmw.scene.scene_data import SceneData
from mmw.scene.sources import scenario_source
from mmw.sensors.batch import Batch
from mmw.storage.arrow_tables import table_from_columns
from mmw.traffic.demand import TrafficDemand, VehicleTrack
from mmw.traffic.drones import fly_drones
from mmw.traffic.live.control import Control
from mmw.traffic.live.live_traffic import LiveTraffic, Started, check_live
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
    fleet: tuple[tuple[str, str], ...]
    """Model and paint of each vehicle."""
    shown: tuple[object, ...] | None = None
    """Episode and frame on the device, or what else is there."""
    present: Batch | None = None
    """`batch` for them."""
    is_closed: bool = False

    def close(self) -> None:
        """Free the device and remove the files."""
        with self.lock:
            self.is_closed, self.shown, self.present = True, None, None
            self.folder.cleanup()

    def demand_of(self, seed: int) -> TrafficDemand:
        """Return the demand for traffic of a seed, with the vehicles of this world."""
        return self.demand.with_seed(seed, None if seed == self.demand.seed_of_scene else self.fleet)

    def traffic(self, seed: int, drones: Sequence[VehicleTrack], started: Started | None) -> LiveTraffic:
        """Return traffic of a seed at its start, with the vehicles of this world; `started` as of `LiveTraffic`.

        Raises:
            InputError: If the vehicles of this world find no places.
        """
        traffic = LiveTraffic(self.demand_of(seed), drones, started)
        if traffic.fleet != self.fleet:
            raise InputError(
                f"seed = {seed}: places for {len(traffic.fleet)} of the scene's {len(self.fleet)} vehicles are left; "
                "give another seed, or a smaller traffic.vehicle_count"
            )
        return traffic

    def check_open(self, where: str) -> None:
        """Check that the world is there; the lock is held.

        Raises:
            InputError: If it was closed.
        """
        if self.is_closed:
            raise InputError(
                f"{where}: was closed or reset with another seed before this was looked at; look at it earlier"
            )

    @contextmanager
    def showing(self, episode: Episode, frame: int, agent: str | None, where: str) -> Iterator[Batch]:
        """Keep a frame of an episode on the device; the sensors of one agent count, or of all for None.

        Raises:
            InputError: If the simulation is closed.
        """
        with self.lock:
            self.check_open(where)
            if self.shown != (episode, frame):
                self.shown = None
                scene, arrays = self.batch.scene, episode.arrays(frame)
                row = arrays.frame_row(frame)
                motion = placed(differentiate_row(arrays.poses, row, arrays.pose_dt), row, len(arrays.poses))
                scene.replace_arrays(arrays, motion)
                scene.load_batch([frame])
                config = _with_seed(self.batch.config, episode.seed)
                self.present = replace(self.batch, config=config, arrays=arrays, motion=motion)
                self.shown = episode, frame
            assert self.present is not None
            batch = self.present
            yield batch if agent is None else replace(batch, arrays=replace(batch.arrays, sensing=frozenset([agent])))


@remembered()
def _with_seed(config: Config, seed: int) -> Config:
    return config if config.seed == seed else config.model_copy(update={"seed": seed})


class LiveRun:
    """World, present episode and saved datasets of a live simulation; the methods of `Simulation` call it."""

    def __init__(
        self,
        config: Config,
        scenario: ScenarioConfig,
        weather: str,
        base: Path,
        place: Path | str,
        device: str,
        max_frames: int = 1,
    ):
        """Make the world of the configuration's seed, and go to the first frame.

        Raises:
            InputError: If the scenario has no town, an engine that cannot be stepped, another rate than 100 Hz or too
                few frames.
        """
        self._config, self._scenario, self._weather = config, scenario, weather
        self._base, self._place, self._device = base, place, device
        self._max_frames = max_frames
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
        self.check_open("reset")
        if seed is not None and (isinstance(seed, bool) or not isinstance(seed, int) or seed < 0):
            raise InputError(f"seed = {seed!r}; a whole number from 0 is needed")
        if seed is not None:
            self._config = self._config.model_copy(update={"seed": seed})
        if self._world is None or self._world.config.seed_of_scene != self._config.seed_of_scene:
            self.make()
        else:
            episode = self.start_episode(self._config.seed)
            self._end_episode()
            self._episode = episode
        return self.frame()

    def start_episode(self, seed: int, started: Started | None = None) -> Episode:
        """Return traffic of a seed at its first frame, with the vehicles of the present world.

        Args:
            seed: The seed.
            started: As of `LiveTraffic`.

        Raises:
            InputError: If the vehicles of this world find no places.
        """
        world = self.world
        with in_config(self._place):
            traffic = world.traffic(seed, self._drones(world.demand), started)
            return self._episode_of(traffic, world.batch.arrays, seed)

    def _episode_of(self, traffic: LiveTraffic, arrays: SceneData, seed: int) -> Episode:
        return Episode(traffic, arrays, self.frames.start, seed, margin_frames(self._config))

    def _drones(self, demand: TrafficDemand) -> list[VehicleTrack]:
        return fly_drones(self._scenario.uavs, demand.frame_count)

    def _end_episode(self) -> None:
        """Free what the engine of the present episode holds; its frames can still be looked at."""
        if self._episode is not None:
            self._episode.traffic.close()
        self._episode = None

    def make(self) -> None:
        """Make the world of the seed, and go to its first frame.

        Raises:
            InputError: If the world cannot be made.
        """
        config, scenario = self._config, self._scenario
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
        retain_memory(self._device, GPU_BYTES_PER_WORKER)
        batch = make_batch(some, scenario, arrays, self._device, self._max_frames, self._pool, StageTimer())
        batch = replace(batch, puts_off=True)
        self._notes += [*surface_warnings(batch.surfaces), *batch.texture_notes()]
        static = {
            name: table_from_columns(name, {"scenario": scenario.name, **columns})
            for name, columns in static_rows(arrays, config).items()
        }
        makers = table_makers(config)
        self._world = World(config, demand, batch, static, threading.Lock(), holder, makers, traffic.fleet)
        self._episode = self._episode_of(traffic, batch.arrays, config.seed)

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

    @property
    def world(self) -> World:
        """Town and actors.

        Raises:
            InputError: If there are none yet, or the simulation is closed.
        """
        return self._present("world")[0]

    @property
    def episode(self) -> Episode:
        """The present episode; errors as of `world`."""
        return self._present("episode")[1]

    def _present(self, method: str) -> tuple[World, Episode]:
        self.check_open(method)
        if self._world is None or self._episode is None:
            raise InputError(f"{self.name}: {method} before reset; call reset first")
        return self._world, self._episode

    def check_open(self, method: str) -> None:
        """Check that the simulation is open.

        Raises:
            InputError: If it is closed.
        """
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

    def check_step(self, episode: Episode, controls: object) -> None:
        """Check what does not depend on the actors before an episode is stepped.

        Raises:
            InputError: If the episode is over, or the controls are no mapping.
        """
        if controls is not None and not isinstance(controls, Mapping):
            raise InputError(f"controls = {controls!r}: a mapping of actors' names to mmw.Control is needed")
        if episode.frame + 1 >= self.frames.stop:
            raise InputError(
                f"{self.name}: frame {episode.frame} is the last of the episode; reset it, or raise frames.count "
                f"({self.frames.stop})"
            )

    def step(self, controls: Mapping[str, Control | None] | None = None) -> LiveFrame:
        """Go to the next frame.

        Raises:
            InputError: If the episode is over, a control cannot be obeyed, or the simulation is closed.
        """
        _, episode = self._present("step")
        self.check_step(episode, controls)
        episode.step(controls or {})
        return self.frame()

    def remove(self, name: str) -> None:
        """Take an actor out of the scene; errors as of `Episode.remove`, also if the simulation is closed."""
        self._present("remove")[1].remove(name)

    def add(self, name: str, pose: Sequence[float] | None) -> None:
        """Put an actor back into the scene; errors as of `Episode.add`, also if the simulation is closed."""
        self._present("add")[1].add(name, pose)

    def save(self, out: str | os.PathLike[str], overwrite: bool) -> Dataset:
        """Write the frames of this episode as a dataset.

        Raises:
            InputError: If nothing was driven, the folder has other data, or the simulation is closed.
            Error: If the disk is full.
        """
        return self.save_episode(self._present("save")[1], out, overwrite)

    def save_episode(self, episode: Episode, out: str | os.PathLike[str], overwrite: bool) -> Dataset:
        """Write the frames of an episode of the present world; errors as of `save`."""
        config = self.world.config
        if episode.seed != config.seed:
            config = config.model_copy(update={"seed": episode.seed, "scene_seed": config.seed_of_scene})
        count = episode.frame + 1 - self.frames.start
        frames = config.frames_of(self._scenario)
        frames = frames.model_copy(update={"start": self.frames.start, "count": count})
        output = config.output.model_copy(update={"dir": os.fspath(out)})
        compute = config.compute.model_copy(update={"device": self._device, "workers": 1})
        own = {"frames": frames, "output": output, "compute": compute, "scenarios": (self._scenario,)}
        tracks = [replace(track, poses=track.poses[: episode.frame + 2]) for track in episode.traffic.tracks]
        stage = RecordedStage(config.model_copy(update=own), self._scenario, self._base, tracks)
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
