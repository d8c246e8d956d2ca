"""Worker processes of traffic: the rows of this process, clear errors when one dies or fails, and no one left over."""

import gc
import multiprocessing
import os
import signal
from collections.abc import Sequence
from types import SimpleNamespace

import psutil
import pytest

from mmw.core.errors import InputError
from mmw.generation.live import traffic_processes
from mmw.generation.live.traffic_processes import TrafficLostError, TrafficProcesses, process_count
from mmw.traffic.demand import TrafficDemand
from mmw.traffic.live.control import Control
from mmw.traffic.live.live_traffic import LiveTraffic
from mmw.traffic.live.vehicle_server import ServedVehicles
from tests.fixtures.live_traffic import sedans_on
from tests.fixtures.traffic_towns import oval

ROWS = 3
WORLDS = 5

World = tuple[ServedVehicles, LiveTraffic]


@pytest.fixture(scope="module")
def asked() -> TrafficDemand:
    """Return the traffic of world 0 on a circuit."""
    return sedans_on(oval(), frame_count=400)


def begin(pool: TrafficProcesses, asked: TrafficDemand, worlds: Sequence[int]) -> dict[int, World]:
    """Start worlds, whose seeds are their numbers."""
    demands = [(world, asked.with_seed(world)) for world in worlds]
    found = {}
    for (world, demand), started in zip(demands, pool.start(demands, ROWS), strict=True):
        found[world] = started.vehicles, LiveTraffic(demand, (), started)
        found[world][1].advance(ROWS)
    return found


def go_on(pool: TrafficProcesses, worlds: dict[int, World], rows: int) -> None:
    """Make some rows of worlds, with controls that change."""
    for _ in range(rows):
        for _, traffic in worlds.values():
            traffic.command({"cav_1": Control(target_speed_m_s=3.0 + traffic.rows % 7)})
        asking = [(world, *own) for world, own in worlds.items() if own[0].must_ask]
        if asking:
            pool.drive(asking)
        for _, traffic in worlds.values():
            traffic.advance(traffic.rows + 1)


def pids(pool: TrafficProcesses) -> list[int]:
    """Return the running processes."""
    return [child.pid for server in pool._servers for child in server._children]


def test_number_of_processes_follows_cores_and_worlds(monkeypatch: pytest.MonkeyPatch) -> None:
    counts = {}
    for cores in (1, 2, 16):
        monkeypatch.setattr(traffic_processes, "cores", lambda cores=cores: cores)
        counts[cores] = [process_count(worlds) for worlds in (1, 7, 8, 24, 64, 1000)]
    assert counts == {1: [0] * 6, 2: [0, 0, 2, 2, 2, 2], 16: [0, 0, 2, 6, 16, 16]}
    monkeypatch.setattr(multiprocessing, "current_process", lambda: SimpleNamespace(daemon=True))
    assert process_count(64) == 0


def test_rows_are_the_same_in_any_number_of_processes(asked: TrafficDemand) -> None:
    poses = {}
    for processes in (0, 1, 3):
        pool = TrafficProcesses("test", asked, processes)
        try:
            worlds = begin(pool, asked, range(WORLDS))
            go_on(pool, worlds, 60)
            poses[processes] = [traffic.poses.tobytes() for _, traffic in worlds.values()]
            assert len(pids(pool)) == processes if processes else True
        finally:
            pool.close()
    assert poses[1] == poses[0] == poses[3] and len(set(poses[0])) == WORLDS


def test_process_that_dies_loses_its_worlds_alone_and_starts_again(asked: TrafficDemand) -> None:
    pool = TrafficProcesses("test", asked, 2)
    try:
        worlds = begin(pool, asked, range(WORLDS))
        go_on(pool, worlds, 20)
        rows = [traffic.rows for _, traffic in worlds.values()]
        while not worlds[0][0].must_ask:
            go_on(pool, worlds, 1)
            rows = [traffic.rows for _, traffic in worlds.values()]
        os.kill(pids(pool)[1], signal.SIGKILL)
        text = "test, worlds 1, 3: the process of the traffic died by signal 9; reset these worlds"
        with pytest.raises(TrafficLostError, match=text):
            go_on(pool, {world: worlds[world] for world in (1, 3)}, 1)
        assert [traffic.rows for _, traffic in worlds.values()] == rows
        assert [vehicles.is_lost for vehicles, _ in worlds.values()] == [False, True, False, True, False]
        with pytest.raises(TrafficLostError, match="test, world 3: its traffic was lost before; reset it"):
            pool.check(3, worlds[3][0])
        go_on(pool, {world: worlds[world] for world in (0, 2, 4)}, 20)
        again = begin(pool, asked, (1, 3))
        go_on(pool, again, again_rows := 30)
        for world in (1, 3):
            alone = LiveTraffic(asked.with_seed(world))
            alone.advance(ROWS)
            for _ in range(again_rows):
                alone.command({"cav_1": Control(target_speed_m_s=3.0 + alone.rows % 7)})
                alone.advance(alone.rows + 1)
            assert again[world][1].poses.tobytes() == alone.poses.tobytes()
    finally:
        pool.close()


def test_error_in_a_process_names_the_world(asked: TrafficDemand, monkeypatch: pytest.MonkeyPatch) -> None:
    pool = TrafficProcesses("test", asked, 2)
    try:
        worlds = begin(pool, asked, range(WORLDS))
        while not worlds[0][0].must_ask:
            go_on(pool, worlds, 1)
        rows = [traffic.rows for _, traffic in worlds.values()]
        worlds[3][0].command(99, Control(target_speed_m_s=1.0))  # there is no such vehicle
        with pytest.raises(TrafficLostError, match=r"test, world 3: its traffic failed: IndexError: .*; reset"):
            pool.drive([(world, *own) for world, own in worlds.items()])
        assert [traffic.rows for _, traffic in worlds.values()] == rows
        assert all(vehicles.is_lost for vehicles, _ in worlds.values())  # they may be ahead
        assert len(pids(pool)) == 2
        for vehicles, _ in worlds.values():
            vehicles.close()
        go_on(pool, begin(pool, asked, range(WORLDS)), 10)
    finally:
        pool.close()


def test_vehicle_comes_back_through_a_process_and_loses_its_world_if_that_dies(asked: TrafficDemand) -> None:
    poses = []
    for processes in (0, 2):
        pool = TrafficProcesses("test", asked, processes)
        try:
            worlds = begin(pool, asked, range(3))
            go_on(pool, worlds, 40)
            worlds[1][1].remove("cav_2")
            go_on(pool, worlds, 12)
            worlds[1][1].add("cav_2")
            with pytest.raises(InputError, match="add 'cav_2': is there already"):
                worlds[1][1].add("cav_2")
            go_on(pool, worlds, 60)
            poses.append([traffic.poses.tobytes() for _, traffic in worlds.values()])
            if processes:
                worlds[1][1].remove("cav_2")
                go_on(pool, worlds, 3)
                os.kill(pids(pool)[1], signal.SIGKILL)
                with pytest.raises(
                    TrafficLostError, match="test, world 1: the process of the traffic died by signal 9"
                ):
                    worlds[1][1].add("cav_2")
                assert [vehicles.is_lost for vehicles, _ in worlds.values()] == [False, True, False]
        finally:
            pool.close()
    assert poses[0] == poses[1]


def test_fault_while_a_vehicle_comes_back_loses_its_world_alone(asked: TrafficDemand) -> None:
    pool = TrafficProcesses("test", asked, 1)
    try:
        worlds = begin(pool, asked, range(3))
        go_on(pool, worlds, 10)
        with pytest.raises(TrafficLostError, match=r"test, world 1: its traffic failed: IndexError: .*; reset"):
            worlds[1][0].resume(99, worlds[1][1].rows, [])  # there is no such vehicle
        assert [vehicles.is_lost for vehicles, _ in worlds.values()] == [False, True, False]
    finally:
        pool.close()


def test_demand_that_cannot_be_met_names_the_world_and_leaves_the_others(asked: TrafficDemand) -> None:
    pool = TrafficProcesses("test", asked, 2)
    try:
        worlds = begin(pool, asked, range(WORLDS))
        short = asked.with_seed(1, (("tank", "paint_green"),) * 8)
        with pytest.raises(InputError, match=r"test, world 2: .*tank"):
            pool.start([(0, asked), (2, short)], ROWS)
        go_on(pool, worlds, 30)
    finally:
        pool.close()


def test_processes_end_with_their_pool(asked: TrafficDemand) -> None:
    pool = TrafficProcesses("test", asked, 2)
    begin(pool, asked, range(2))
    first = pids(pool)
    pool.close()
    pool.close()
    begin(pool, asked, range(2))
    second = pids(pool)
    del pool
    gc.collect()
    assert len({*first, *second}) == 4 and not any(psutil.pid_exists(pid) for pid in (*first, *second))
