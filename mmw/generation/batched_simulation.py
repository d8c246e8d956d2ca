"""Step several worlds of one scenario together, traced in one launch: for vectorized reinforcement learning."""

import logging
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from operator import index

import pyarrow as pa

from mmw.channel.path_table import CarrierPaths
from mmw.config.load import Source, in_config
from mmw.core.errors import InputError
from mmw.dataset import Dataset
from mmw.dataset.frame import Frame
from mmw.generation.chosen_scenario import choose_scenario
from mmw.generation.executors.process_pool import start_server
from mmw.generation.live.episode import Episode, rows_at_start
from mmw.generation.live.frame_tables import LiveFrame
from mmw.generation.live.live_run import LiveRun
from mmw.generation.live.traffic_processes import TrafficProcesses, is_daemon, process_count
from mmw.generation.live.world_frames import WorldFrames, Worlds
from mmw.traffic.live.control import Control
from mmw.traffic.live.vehicle_server import ServedVehicles

LOGGER = logging.getLogger(__name__)

Controls = Mapping[str, Control | None]


class BatchedSimulation:
    """Worlds of one town, each with traffic of its own seed, stepped at 100 Hz and traced together.

    The worlds share what is in the scene: town, roadside units, weather, and vehicles with their models and paints.
    Places (with `vary.spawn`), routes, drivers, lanes, controls and noise differ. World k has the rows of
    `mmw.Simulation(config, mode="live")` for the same configuration with the world's `seed`, and with `scene_seed` that
    of this one, bit for bit on the same kind of machine.

    Drivers decide in worker processes where there are cores for them; the rows are the same.

    Nothing of a frame is traced before it is looked at. The first look at the channel or at a sensor in any world
    traces it for all, in one launch.

    Examples:
        >>> import mmw
        >>> config = mmw.load_config("quickstart", ["frames.count=20", "sensors=[]"])
        >>> with mmw.BatchedSimulation(config, 2) as simulation:
        ...     frames = simulation.step([{"cav_1": mmw.Control(target_speed_m_s=3.0)}, {}])
        ...     print([frame.frame for frame in frames], simulation.seeds)
        [2, 2] (42, 43)
    """

    def __init__(
        self,
        config: Source,
        worlds: int,
        *,
        scenario: str | None = None,
        weather: str | None = None,
        base: str | os.PathLike[str] | None = None,
        device: str = "auto",
        processes: int | None = None,
    ) -> None:
        """Load the town once, and start each world with its own seed: `seed` of the configuration, and those after it.

        Args:
            config: As for `mmw.Simulation`.
            worlds: Number of worlds, 1 or more; the device has to have memory for a frame of each.
            scenario: One of its scenarios; the first by default.
            weather: One of its weathers; the first by default.
            base: Folder that relative paths of input files start from.
            device: `cpu`, `cuda:N`, or `auto`.
            processes: Worker processes that the drivers decide in; 0 for this process. By default one for each core
                that this process may use and for every 4 worlds, whichever are fewer; 0 instead of one.

        Raises:
            ConfigError: If the configuration or a file that it names cannot be used; one line for each problem.
            InputError: If there is no such scenario, weather or device, its traffic cannot be stepped, or the vehicles
                find no places with a seed.
            TrafficLostError: If a worker process dies.
        """
        if isinstance(worlds, bool) or not isinstance(worlds, int) or worlds < 1:
            raise InputError(f"worlds = {worlds!r}; a whole number from 1 is needed")
        if processes is not None and (isinstance(processes, bool) or not isinstance(processes, int) or processes < 0):
            raise InputError(f"processes = {processes!r}; a whole number from 0 is needed, or None")
        if processes and is_daemon():
            raise InputError(f"processes = {processes}: this process is a daemon, which may start none; give 0 or None")
        chosen = choose_scenario(config, scenario, weather, base, device)
        engine = chosen.scenario.traffic.engine if chosen.scenario.traffic else None
        if engine not in (None, "idm"):
            with in_config(chosen.place):
                raise InputError(
                    f"scenario {chosen.scenario.name!r}: traffic.engine = {engine!r}: worlds are stepped together by "
                    "the engine idm alone; change engine, or step one simulation"
                )
        self.config = chosen.config
        """The configuration, validated."""
        self.scenario = chosen.scenario.name
        """Name of the scenario."""
        self.weather = chosen.weather
        """Name of the weather."""
        self.device = chosen.device
        """Warp device that traces."""
        number = process_count(worlds) if processes is None else min(processes, worlds)
        if number:
            start_server()
        run = LiveRun(
            chosen.config, chosen.scenario, chosen.weather, chosen.base, chosen.place, chosen.device, max_frames=worlds
        )
        self.frames = run.frames
        """Numbers of the frames that an episode can have."""
        self._run = run
        self._name = f"batched simulation of {self.scenario}"
        self._traffic: TrafficProcesses | None = None
        self._episodes: list[Episode] = []
        self._vehicles: list[ServedVehicles] = []
        self._present: WorldFrames | None = None
        self._frames: list[LiveFrame] = []
        try:
            self._run.make()
            for note in self._run.new_notes():
                LOGGER.warning("%s", note)
            self._worlds = Worlds(self._run.world, self.weather, self.scenario, self._name, LOGGER.warning)
            self._traffic = TrafficProcesses(self._name, self._run.world.demand, number)
            first = self._run.episode.seed
            started = self._start([(world, first + world) for world in range(worlds)])
            self._episodes, self._vehicles = map(list, zip(*started, strict=True))
        except BaseException:
            self.close()
            raise

    def __enter__(self) -> "BatchedSimulation":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __len__(self) -> int:
        """Return the number of worlds."""
        return len(self._episodes)

    def close(self) -> None:
        """Free the device and end all processes; frames that have been looked at stay usable.

        Closing again changes nothing.
        """
        self._run.close()
        if self._traffic is not None:
            self._traffic.close()

    @property
    def seeds(self) -> tuple[int, ...]:
        """Seed of each world."""
        return tuple(episode.seed for episode in self._episodes)

    @property
    def present(self) -> list[Frame]:
        """The present frame of each world."""
        self._look("present")
        return list(self._frames)

    def paths(self, carrier_hz: float) -> CarrierPaths:
        """Return the paths of all links of all worlds at a carrier [Hz]; `frame` of their keys counts the worlds.

        Raises:
            InputError: If there are no paths at this carrier, or the simulation is closed.
        """
        return self._look("paths").paths(carrier_hz)

    def table(self, name: str) -> pa.Table:
        """Return the rows of a table in the present frames of all worlds; its column `frame` counts the worlds.

        Raises:
            InputError: If there is no such table, it is made world by world, or the simulation is closed.
        """
        return self._look("table").table(name)

    def reset(self, seeds: Sequence[int | None] | None = None, *, worlds: Sequence[int] | None = None) -> list[Frame]:
        """Start new episodes, and return their first frames.

        Args:
            seeds: Seed of each world, None for that which it has; by default all keep theirs.
            worlds: Worlds that start anew, to which `seeds` belong; by default all.

        Raises:
            InputError: If a seed is none, there is no such world, its vehicles find no places, or the simulation is
                closed. Nothing has changed then.
            TrafficLostError: If a worker process dies. The worlds that the message names need another reset.
        """
        chosen = self._chosen("reset", worlds)
        given = [None] * len(chosen) if seeds is None else list(seeds)
        self._check_length("seeds", given, chosen)
        for world, seed in zip(chosen, given, strict=True):
            if seed is not None and (isinstance(seed, bool) or not isinstance(seed, int) or seed < 0):
                raise InputError(f"{self._name}, world {world}: seed = {seed!r}; a whole number from 0 is needed")
        own = [self._episodes[k].seed if seed is None else seed for k, seed in zip(chosen, given, strict=True)]
        started = self._start(list(zip(chosen, own, strict=True)))
        for world, (episode, vehicles) in zip(chosen, started, strict=True):
            self._vehicles[world].close()
            self._episodes[world], self._vehicles[world] = episode, vehicles
        self._present = None
        present = self.present
        return [present[world] for world in chosen]

    def _start(self, asked: Sequence[tuple[int, int]]) -> list[tuple[Episode, ServedVehicles]]:
        """Return new episodes of worlds, each with a seed."""
        assert self._traffic is not None
        demands = [(world, self._run.world.demand_of(seed)) for world, seed in asked]
        started = self._traffic.start(demands, rows_at_start(self.frames.start))
        made = []
        try:
            for (world, seed), own in zip(asked, started, strict=True):
                with self._named(world):
                    made.append(self._run.start_episode(seed, own))
        except BaseException:
            for own in started:
                own.vehicles.close()
            raise
        return [(episode, own.vehicles) for episode, own in zip(made, started, strict=True)]

    def step(
        self, controls: Sequence[Controls | None] | None = None, *, worlds: Sequence[int] | None = None
    ) -> list[Frame]:
        """Advance worlds by 10 ms and return their new frames.

        Args:
            controls: What the actors of each world do, as for `mmw.Simulation.step`.
            worlds: Worlds that go on, to which `controls` belong; by default all.

        Raises:
            InputError: If an episode is over, there is no such world or actor, a control cannot be obeyed, or the
                simulation is closed; the message names the world. No world has moved then.
            TrafficLostError: If a worker process dies, or drivers fail; the message names the world. No world has
                moved then, but those whose drivers were to decide have to be reset.
        """
        chosen = self._chosen("step", worlds)
        given = [None] * len(chosen) if controls is None else list(controls)
        self._check_length("controls", given, chosen)
        for world, own in zip(chosen, given, strict=True):
            with self._named(world):
                self._run.check_step(self._episodes[world], own)
                self._episodes[world].traffic.check(own or {})
        self._decide([(world, own or {}) for world, own in zip(chosen, given, strict=True)])
        for world in chosen:
            self._episodes[world].go_on()
        self._present = None
        present = self.present
        return [present[world] for world in chosen]

    def _decide(self, controls: Sequence[tuple[int, Controls]]) -> None:
        """Give worlds their controls, and let drivers decide where the next row needs it."""
        assert self._traffic is not None
        for world, _ in controls:
            self._traffic.check(world, self._vehicles[world])
        later, asked = [], []
        for world, own in controls:
            vehicles, traffic = self._vehicles[world], self._episodes[world].traffic
            if vehicles.must_ask:
                traffic.obey(own)
                asked.append((world, vehicles, traffic))
            else:
                later.append((traffic, own))
        if asked:
            self._traffic.drive(asked)
        for traffic, own in later:  # not before, as an error moves no world
            traffic.obey(own)

    def remove(self, world: int, name: str) -> None:
        """Take an actor out of the traffic of a world, as `mmw.Simulation.remove` does.

        Raises:
            InputError: If there is no such world or actor, it is absent or stands still in the town, or the simulation
                is closed. Nothing has changed then.
            TrafficLostError: If its traffic was lost.
        """
        with self._named(self._going("remove", world)):
            self._episodes[world].remove(name)

    def add(self, world: int, name: str, pose: Sequence[float] | None = None) -> None:
        """Put a removed actor back into the traffic of a world, as `mmw.Simulation.add` does.

        Args:
            world: The world.
            name: An actor that was removed there, at least one step before.
            pose: Body to world (x, y, z, qx, qy, qz, qw), or (x, y, z, yaw). Without one, a vehicle comes back to its
                route with its driver.

        Raises:
            InputError: If there is no such world or actor, it is there or stands still in the town, the pose is not
                finite, there is no safe place on the route, or the simulation is closed. Nothing has changed then.
            TrafficLostError: If its traffic was or is lost; reset the world.
        """
        with self._named(self._going("add", world)):
            self._episodes[world].add(name, pose)

    def _going(self, method: str, world: int) -> int:
        """Return a world whose traffic can go on."""
        (chosen,) = self._chosen(method, [world])
        assert self._traffic is not None
        self._traffic.check(chosen, self._vehicles[chosen])
        return chosen

    @contextmanager
    def _named(self, world: int) -> Iterator[None]:
        """Name a world in errors."""
        try:
            yield
        except InputError as error:
            raise InputError(f"{self._name}, world {world}: {error}") from error

    def save(self, world: int, out: str | os.PathLike[str], *, overwrite: bool = False) -> Dataset:
        """Write the frames of the present episode of a world as a dataset, as `mmw.Simulation.save` does.

        Raises:
            InputError: If there is no such world, the folder has other data, or the simulation is closed.
            Error: If the disk is full.
        """
        (chosen,) = self._chosen("save", [world])
        return self._run.save_episode(self._episodes[chosen], out, overwrite)

    def lane_changes(self, world: int) -> list[tuple[float, str, str, str]]:
        """Return the changes of lanes in the episode of a world, as `mmw.Simulation.lane_changes`."""
        (chosen,) = self._chosen("lane_changes", [world])
        return self._episodes[chosen].traffic.lane_changes

    def _look(self, method: str) -> WorldFrames:
        self._run.check_open(method)
        if self._present is None:
            self._present = WorldFrames(self._worlds, self._episodes)
            self._frames = self._present.frames()
        return self._present

    def _chosen(self, method: str, worlds: Sequence[int] | None) -> list[int]:
        self._run.check_open(method)
        chosen = [index(world) for world in (range(len(self)) if worlds is None else worlds)]
        unknown = [world for world in chosen if not 0 <= world < len(self)]
        if unknown:
            raise InputError(f"{self._name}: {method}: there is no world {unknown[0]}; give 0 to {len(self) - 1}")
        if len(set(chosen)) != len(chosen):
            raise InputError(f"{self._name}: {method}: worlds = {chosen} names one twice; name each once")
        return chosen

    def _check_length(self, name: str, given: Sequence[object], chosen: Sequence[int]) -> None:
        if len(given) != len(chosen):
            raise InputError(
                f"{self._name}: {name} has {len(given)} entries for {len(chosen)} worlds; give one for each"
            )
