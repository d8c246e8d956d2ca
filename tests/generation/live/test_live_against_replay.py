"""A live simulation without controls against the replay of its configuration: equal in all but the filters' part."""

from collections.abc import Iterator

import pyarrow as pa
import pyarrow.compute as pc
import pytest

import mmw
from mmw.generation.live.episode import BEFORE
from tests.conftest import DEVICES

pytestmark = pytest.mark.slow

SCENE = [
    "frames.count=12",
    "sensors=[{type: imu, on: [cav, vru, uav]}, {type: gnss, on: [cav, rsu, vru, uav, bs]}]",
    "scenarios.town03_roundabout.traffic={vehicle_count: 6, spawn_center_m: [-0.5, -0.5, 0], cav_ranks: [1], "
    "pedestrian_count: 3, vru_ranks: [0], cyclist_count: 1, vru_cyclist_ranks: [0]}",
    "scenarios.town03_roundabout.uavs=[{name: uav_1, waypoints: [{time_s: 0, position_m: [-10, -20, 18]}, "
    "{time_s: 4, position_m: [10, -20, 22]}]}]",
    "scenarios.town03_roundabout.base_stations=[{name: bs_1, position_m: [30, -40, 60]}]",
]
KNOWN_AHEAD = ("rsu_1", "vru_1", "vru_2", "uav_1", "bs_1")
"""Agents whose motion no filter of the live traffic touches."""


@pytest.fixture(scope="module", params=DEVICES)
def pair(request: pytest.FixtureRequest) -> Iterator[tuple[mmw.Simulation, list[mmw.Frame], mmw.Simulation]]:
    """Return a live simulation, its frames without controls, and the replay of the same configuration."""
    config = mmw.load_config("quickstart", SCENE)
    with (
        mmw.Simulation(config, mode="live", device=request.param) as live,
        mmw.Simulation(config, device=request.param) as replay,
    ):
        yield live, [live.reset(), *(live.step() for _ in range(10))], replay


def of_agents(frame: mmw.Frame, table: str, names: tuple[str, ...]) -> pa.Table:
    """Return the rows of some agents in a table."""
    rows = frame.table(table)
    return rows.filter(pc.is_in(pc.cast(rows["agent"], pa.string()), pa.array(names)))


def test_tables_that_no_frame_changes_are_equal(pair: tuple) -> None:
    live, _, replay = pair
    assert set(live.static_tables) == set(replay.static_tables) == {"objects", "sensors", "materials"}
    for name, table in live.static_tables.items():
        assert table.num_rows > 3 and table.equals(replay.static_tables[name]), name


def test_rows_that_do_not_depend_on_the_filters_are_equal_bit_by_bit(pair: tuple) -> None:
    """Actors, sizes, names and counts, and all that belongs to actors whose motion is known ahead."""
    _, frames, replay = pair
    for frame in frames[BEFORE::3]:
        other = replay.frame(frame.frame)
        assert frame.table("frames").equals(other.table("frames"))
        mine, theirs = frame.table("boxes"), other.table("boxes")
        what = ["object_id", "category", "agent", "length", "width", "height"]
        assert mine.select(what).equals(theirs.select(what)) and mine.num_rows == 6 + 3 + 1 + 1
        known = pc.is_in(pc.cast(mine["category"], pa.string()), pa.array(["pedestrian", "bicycle", "dynamic"]))
        own = mine.filter(known)
        assert own.num_rows == 5 and own.equals(theirs.filter(known))
        for table, count in (("poses", 5), ("gnss", 5), ("imu", 3)):
            own = of_agents(frame, table, KNOWN_AHEAD)
            assert own.num_rows == count and own.equals(of_agents(other, table, KNOWN_AHEAD)), table
        keys = ["agent", "peer", "antenna", "peer_antenna", "carrier", "carrier_hz"]
        assert frame.table("links").select(keys).equals(other.table("links").select(keys))


def test_vehicles_are_where_the_replay_has_them(pair: tuple) -> None:
    """Within what filters of one variance can differ: see `tests/traffic/live`."""
    _, frames, replay = pair
    for frame in frames[BEFORE::3]:
        mine, theirs = (one.table("boxes") for one in (frame, replay.frame(frame.frame)))
        for axis in "xyz":
            assert mine[axis].to_numpy() == pytest.approx(theirs[axis].to_numpy(), abs=0.002)
