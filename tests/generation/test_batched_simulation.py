"""Worlds stepped together: the rows of simulations of their own, bit for bit, and calls that are refused as a whole."""

import gc
import os
import signal
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import psutil
import pytest

import mmw
from mmw import Control
from mmw.channel.path_table import CarrierPaths
from mmw.cli.verify import main as verify
from mmw.core.errors import InputError
from mmw.generation.live.traffic_processes import TrafficLostError
from mmw.generation.live.world_frames import WorldFrames
from tests.fixtures.live_config import SENSORS, TRAFFIC

SLOW = {"cav_1": Control(target_speed_m_s=3.0)}
STATIC = ("objects", "sensors", "materials")


@pytest.fixture(scope="module")
def config() -> mmw.Config:
    """Return a scenario with start places drawn by seed, fog with patches, clouds, and every kind of sensor."""
    return mmw.load_config(
        "quickstart", ["frames.count=40", "vary.spawn.radius_m=80", "weathers=[foggy]", SENSORS, *TRAFFIC]
    )


@pytest.fixture(scope="module")
def batch(config: mmw.Config) -> Iterator[mmw.BatchedSimulation]:
    """Return three worlds for all tests."""
    with mmw.BatchedSimulation(config, 3, device="cpu") as simulation:
        yield simulation


def assert_same_paths(one: CarrierPaths, other: CarrierPaths) -> None:
    for name, values in vars(one).items():
        is_float = np.asarray(values).dtype.kind in "fc"
        assert np.array_equal(values, getattr(other, name), equal_nan=is_float), name


@pytest.mark.slow
def test_every_world_has_the_rows_of_a_simulation_of_its_own(config: mmw.Config, batch: mmw.BatchedSimulation) -> None:
    """World 1 starts anew with another seed, so that the worlds have different frames."""
    batch.reset([42, 43, 44])
    batch.step([SLOW, {}, {}])
    batch.step()
    assert batch.reset([7], worlds=[1])[0].frame == 1
    frames = batch.step([{}, SLOW, None])
    assert [frame.frame for frame in frames] == [4, 2, 4] and batch.seeds == (42, 7, 44)
    places = np.array([frame.agents["cav_2"].pose[:2] for frame in frames])
    assert min(np.hypot(*(places - np.roll(places, 1, axis=0)).T)) > 3.0  # other start places
    for frame, seed, controls in zip(frames, (42, 7, 44), ([SLOW, {}, {}], [SLOW], [{}, {}, {}]), strict=True):
        own = config.model_copy(update={"seed": seed, "scene_seed": 42})
        with mmw.Simulation(own, mode="live", device="cpu") as alone:
            for one in controls:
                other = alone.step(one)
            for name in (*frame.data.tables, "paths"):
                assert frame.data.read(name) == other.data.read(name), (seed, name)
            assert_same_paths(frame.paths(28e9), other.paths(28e9))
        assert frame.row["seed"] == seed and len(frame.agents["cav_1"].sensor("lidar")) > 10


def test_agents_sensor_alone_is_that_of_all_and_joint_tables_are_those_of_the_worlds(
    batch: mmw.BatchedSimulation,
) -> None:
    batch.reset([42, 43, 44])
    alone, whole = batch.step(), batch.present
    assert [one is other for one, other in zip(alone, whole, strict=True)] == [True] * 3
    again = batch.step()
    points = [frame.agents["cav_1"].sensor("lidar").points for frame in again]
    table = batch.table("lidar")
    assert table.column("frame").to_pylist() == sorted(table.column("frame").to_pylist())
    for world, frame in enumerate(batch.present):
        rows = frame.data.read("lidar", agent="cav_1")
        assert np.array_equal(frame.agents["cav_1"].sensor("lidar").points, points[world]) and rows.num_rows == 1
    paths = batch.paths(28e9)
    assert sorted(set(paths.keys["frame"].tolist())) == [0, 1, 2]
    own = batch.present[1].paths(28e9)
    at = np.flatnonzero(paths.keys["frame"] == 1)
    assert paths.keys["agent"][at].tolist() == own.keys["agent"].tolist()
    assert np.array_equal(paths.a[np.isin(paths.link, at)], own.a) and len(own.a) > 0
    with pytest.raises(InputError, match="no table 'nothing'"):
        batch.table("nothing")
    with pytest.raises(InputError, match="'imu', which is made world by world"):
        batch.table("imu")


def test_full_memory_halves_the_worlds_of_a_launch(
    batch: mmw.BatchedSimulation, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    def look() -> tuple[Any, Any]:
        batch.reset([42, 43, 44])
        batch.step()
        return batch.table("lidar"), batch.present[2].paths(28e9)

    table, paths = look()
    load = WorldFrames._load

    def full(self: WorldFrames, whole: Any, some: range) -> None:
        load(self, whole, some)
        if len(some) > 1:
            raise RuntimeError("Failed to allocate 123 bytes on device 'cuda:0'")

    monkeypatch.setattr(WorldFrames, "_load", full)
    split_table, split_paths = look()
    assert "memory is full with 3 worlds a launch; going on with 1" in caplog.text
    assert split_table == table and len(paths) > 3
    assert_same_paths(split_paths, paths)


def test_fault_in_one_world_leaves_all_where_they_are_and_names_it(batch: mmw.BatchedSimulation) -> None:
    before = batch.reset([42, 43, 44])
    for controls, text in (
        ([{}, {"cav_9": Control()}, {}], "world 1: control of 'cav_9': there is no such actor"),
        ([SLOW, {}, {"ped_001": Control(target_speed_m_s=1.0)}], "world 2: .*only its pose"),
        ([{}, [1], {}], "world 1: .*a mapping"),
        ([{}, {}], "controls has 2 entries for 3 worlds"),
    ):
        with pytest.raises(InputError, match=text):
            batch.step(controls)
    with pytest.raises(InputError, match="acceleration_m_s2 = nan"):  # such a control cannot be made
        batch.step([{}, {"cav_1": Control(acceleration_m_s2=float("nan"))}, {}])
    assert batch.present[0] is before[0]
    for worlds, text in (([3], "no world 3"), ([-1], "no world -1"), ([1, 1], "one twice")):
        with pytest.raises(InputError, match=text):
            batch.step(worlds=worlds)
    for seed in (-1, True, 1.5):
        with pytest.raises(InputError, match="world 2: seed"):
            batch.reset([None, None, seed])
    assert batch.seeds == (42, 43, 44) and batch.present[2] is before[2]
    for _ in range(38):
        batch.step(worlds=[0])
    with pytest.raises(InputError, match=r"world 0: .*is the last of the episode"):
        batch.step()
    assert [frame.frame for frame in batch.present] == [39, 1, 1]


@pytest.mark.slow
def test_saved_world_has_what_was_seen(batch: mmw.BatchedSimulation, tmp_path: Path) -> None:
    batch.reset([42, 43, 44])
    frames = [batch.step([{}, SLOW, {}])[1], batch.step()[1]]
    seen = [frame.table("lidar").to_pylist() for frame in frames]
    saved = batch.save(1, tmp_path / "saved")
    assert verify([str(tmp_path / "saved")]) == 0
    for frame, rows in zip(frames, seen, strict=True):
        assert repr(saved.frame(batch.scenario, batch.weather, frame.frame).table("lidar").to_pylist()) == repr(rows)
    assert batch.lane_changes(1) == []


@pytest.mark.slow
def test_closed_simulation_is_refused_and_another_on_the_device_goes_on(config: mmw.Config) -> None:
    own = config.model_copy(update={"sensors": ()})
    with mmw.BatchedSimulation(own, 2, device="cpu") as kept, mmw.BatchedSimulation(own, 2, device="cpu") as other:
        seen, lost = other.step(), kept.step()
        for world in range(2):
            assert seen[world].table("paths") == lost[world].table("paths")
        unseen = other.step()
        other.close()
        other.close()
        for call in (
            other.step,
            other.reset,
            lambda: other.present,
            lambda: other.paths(28e9),
            lambda: other.save(0, "x"),
        ):
            with pytest.raises(InputError, match="is closed"):
                call()
        with pytest.raises(InputError, match="was closed or reset"):
            unseen[1].table("paths")
        assert kept.step()[1].table("paths").num_rows > 0


@pytest.mark.parametrize("worlds", [0, -1, True, 2.0])
def test_number_of_worlds_is_checked(config: mmw.Config, worlds: int) -> None:
    with pytest.raises(InputError, match="whole number from 1"):
        mmw.BatchedSimulation(config, worlds, device="cpu")


@pytest.mark.parametrize("processes", [-1, True, 1.5])
def test_number_of_processes_is_checked(config: mmw.Config, processes: Any) -> None:
    with pytest.raises(InputError, match="whole number from 0"):
        mmw.BatchedSimulation(config, 2, device="cpu", processes=processes)


@pytest.mark.filterwarnings("ignore:Implicitly cleaning up")  # one is let go without `close`
@pytest.mark.slow
def test_worlds_in_processes_are_those_of_this_one_and_survive_the_loss_of_a_process(config: mmw.Config) -> None:
    own = config.model_copy(update={"sensors": ()})
    with mmw.BatchedSimulation(own, 5, device="cpu") as here:
        simulation = mmw.BatchedSimulation(own, 5, device="cpu", processes=2)
        first = pids_of(simulation)
        for k in range(12):
            controls = [{"cav_1": Control(target_speed_m_s=2.0 + (k + world) % 9)} for world in range(5)]
            simulation.step(controls)
            here.step(controls)
            assert simulation.table("poses") == here.table("poses")
        before = simulation.present
        os.kill(first[1], signal.SIGKILL)
        with pytest.raises(TrafficLostError, match=r"worlds 1, 3: .*died by signal 9"):
            for _ in range(6):
                simulation.step()
                here.step()
                before = simulation.present
        assert simulation.present[3] is before[3] and len({frame.frame for frame in simulation.present}) == 1
        assert simulation.table("poses") == here.table("poses")
        with pytest.raises(TrafficLostError, match=r"world 1: its traffic was lost before; reset it"):
            simulation.step(worlds=[1])
        for each in (simulation, here):
            each.reset([7, 8, 9, 10, 11])
            for _ in range(6):
                each.step()
        assert simulation.table("poses") == here.table("poses")
        pids = {*first, *pids_of(simulation)}
        del simulation, each, before
        gc.collect()
        assert len(pids) == 3 and not any(map(psutil.pid_exists, pids))


def pids_of(simulation: mmw.BatchedSimulation) -> list[int]:
    """Return the processes of the traffic."""
    assert simulation._traffic is not None
    return [child.pid for server in simulation._traffic._servers for child in server._children]


@pytest.mark.slow
def test_memory_stays_flat_over_steps(config: mmw.Config) -> None:
    """An episode keeps the poses of its frames for `save`, a few kilobytes a frame and world; frames are let go."""
    own = config.model_copy(
        update={"sensors": config.sensors[:1], "frames": config.frames.model_copy(update={"count": 230})}
    )
    with mmw.BatchedSimulation(own, 2, device="cpu") as simulation:
        counts, sizes = [], []
        for _ in range(2):
            for _ in range(100):
                simulation.step([SLOW, {}])
                assert simulation.table("lidar").num_rows and simulation.table("links").num_rows
            gc.collect()
            counts.append(len(gc.get_objects()))
            sizes.append(psutil.Process().memory_info().rss)
    assert counts[1] - counts[0] < 1000  # plans of vehicles that change lanes; a kept frame has some 60 objects
    assert sizes[1] - sizes[0] < 40e6


@pytest.mark.slow
def test_seed_of_the_scene_keeps_the_town_of_a_live_simulation(config: mmw.Config) -> None:
    """The stage is written once; the vehicles of another seed are those of a simulation that began with it."""
    own = config.model_copy(update={"sensors": (), "scene_seed": 42})
    with mmw.Simulation(own, mode="live", device="cpu") as simulation:
        objects = simulation.static_tables["objects"]
        poses = simulation.reset(7).data.read("poses")
        assert simulation.static_tables["objects"] is objects
        assert simulation.reset(42).data.read("poses") != poses and simulation.reset(7).row["seed"] == 7
    with mmw.Simulation(own.model_copy(update={"seed": 7}), mode="live", device="cpu") as other:
        assert other.static_tables["objects"] == objects
        assert other.reset().data.read("poses") == poses


def test_seed_of_the_scene_needs_the_engine_idm() -> None:
    with pytest.raises(InputError, match=r"scene_seed.*gives vehicles of the engine idm"):
        mmw.load_config("quickstart", ["scene_seed=1", "scenarios.town03_roundabout.traffic.engine=sumo"])


def test_worlds_need_the_engine_idm() -> None:
    config = mmw.load_config("quickstart", ["scenarios.town03_roundabout.traffic.engine=sumo"])
    with pytest.raises(InputError, match=r"traffic.engine = 'sumo': .*the engine idm alone"):
        mmw.BatchedSimulation(config, 2, device="cpu")


def come_and_go(step, remove, add) -> list[Any]:
    """Return what steps return while a CAV, a vehicle and a person go and come back, on a route and at a pose."""
    out = [step({})]
    place = out[0].agents["cav_2"].pose
    for name in ("cav_2", "veh_001", "ped_001"):
        remove(name)
    out += [step({}) for _ in range(3)]
    add("cav_2")
    add("ped_001", [*place[:3], 0.5])
    out += [step({}) for _ in range(2)]
    out += [step({"cav_2": Control(target_speed_m_s=5.0)}), step({})]
    remove("cav_1")
    out += [step({}) for _ in range(2)]
    add("veh_001", [place[0] + 3.0, *place[1:3], 1.0])
    return out + [step({}) for _ in range(3)]


@pytest.mark.slow
def test_actors_come_and_go_in_one_world_as_in_a_simulation_of_its_own(
    config: mmw.Config, batch: mmw.BatchedSimulation, tmp_path: Path
) -> None:
    """The other worlds keep theirs; rows are those of a single simulation bit for bit, also where motion ends."""

    def step(controls: dict[str, Control]) -> Any:
        frame = batch.step([{}, controls, {}])[1]
        frame.trace()
        batch.present[0].trace()
        others.append(batch.present[0])
        return frame

    others: list[Any] = []
    batch.reset([42, 43, 44])
    frames = come_and_go(step, lambda name: batch.remove(1, name), lambda *args: batch.add(1, *args))
    own = config.model_copy(update={"seed": 43, "scene_seed": 42})
    with mmw.Simulation(own, mode="live", device="cpu") as alone:
        alone.reset()
        for frame, other in zip(frames, come_and_go(alone.step, alone.remove, alone.add), strict=True):
            assert list(frame.agents) == list(other.agents)
            for name in (*frame.data.tables, "paths"):
                assert frame.data.read(name) == other.data.read(name), (frame.frame, name)
    assert ["cav_2" in frame.agents for frame in frames[:8]] == [True, True, False, False, False, True, True, True]
    with mmw.Simulation(config, mode="live", device="cpu") as alone:
        alone.reset()
        for frame in others:
            other = alone.step()
            for name in ("poses", "boxes", "lidar", "links", "path_gains", "imu"):
                assert frame.data.read(name) == other.data.read(name), (frame.frame, name)
    saved = batch.save(1, tmp_path / "saved")
    assert verify([str(tmp_path / "saved")]) == 0
    assert saved.frame(frames[5].scenario, "foggy", frames[5].frame).table("imu").num_rows == len(
        frames[5].table("imu")
    )


def test_bad_removes_and_adds_name_the_world(batch: mmw.BatchedSimulation) -> None:
    batch.reset([42, 43, 44])
    for call, text in (
        (lambda: batch.remove(1, "cav_9"), "world 1: remove 'cav_9': there is no such actor"),
        (lambda: batch.remove(3, "cav_1"), "remove: there is no world 3; give 0 to 2"),
        (lambda: batch.add(2, "cav_1"), "world 2: add 'cav_1': is there already"),
        (lambda: batch.add(0, "rsu_1", [0, 0, 0, 0]), "world 0: add 'rsu_1': belongs to the town and stays"),
    ):
        with pytest.raises(InputError, match=text):
            call()
    assert all("cav_1" in frame.agents for frame in batch.step())
