"""Live simulation: frames that are traced when looked at, equal to those of the dataset that is saved."""

import pickle
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest

import mmw
from mmw import Control
from mmw.cli.verify import main as verify
from mmw.core.errors import InputError
from mmw.dataset.sample_rows import rows_of_table
from mmw.generation.live import frame_tables
from mmw.storage.schemas import table_spec
from tests.fixtures.live_config import SENSORS, TRAFFIC
from tests.fixtures.own_world import DATA
from tests.fixtures.simulated_files import assert_same_samples, write_simulated
from tests.fixtures.sumo_installed import needs_sumo

DRIVE = [
    {"cav_1": Control(acceleration_m_s2=-2.0), "cav_2": Control(target_speed_m_s=3.0)},
    {},
    {"cav_1": Control(steering_rad=0.1)},
    {"ped_001": Control(pose=[10.0, -20.0, 0.1, 0.5]), "cav_2": None},
]


@pytest.fixture(scope="module")
def config() -> mmw.Config:
    """Return a small scenario of 40 frames with every kind of sensor."""
    return mmw.load_config("quickstart", ["frames.count=40", SENSORS, *TRAFFIC])


@pytest.fixture(scope="module")
def live(config: mmw.Config) -> Iterator[mmw.Simulation]:
    """Return one live simulation for all tests."""
    with mmw.Simulation(config, mode="live", device="cpu") as simulation:
        yield simulation


def drive(simulation: mmw.Simulation) -> list[mmw.Frame]:
    """Return the frames of an episode with controls."""
    frames = [simulation.reset()]
    return [*frames, *(simulation.step(controls) for controls in DRIVE), *(simulation.step() for _ in range(6))]


@pytest.mark.slow
def test_saved_episode_has_the_rows_that_were_seen_and_passes_verify(live: mmw.Simulation, tmp_path: Path) -> None:
    frames = drive(live)
    assert [frame.frame for frame in frames] == list(range(1, 12))
    saved = live.save(tmp_path / "saved")
    assert saved.read("frames").column("frame").to_pylist() == list(range(1, 12))
    assert verify([str(tmp_path / "saved")]) == 0
    files = write_simulated(live, frames, tmp_path / "saved", tmp_path / "seen")
    assert len(files) > 15
    assert [name for name in files if (tmp_path / "seen" / name).read_bytes() != (saved.root / name).read_bytes()] == []
    more = {path.relative_to(tmp_path / "seen").as_posix() for path in (tmp_path / "seen").rglob("part-*")} - {*files}
    assert not any(
        pq.read_table(tmp_path / "seen" / name).num_rows for name in more
    )  # such as satellites, unless traced
    assert all(assert_same_samples(saved.frame(live.scenario, "sunny", frame.frame), frame) for frame in frames[:3])
    live.step()
    with pytest.raises(InputError, match="overwrite"):
        live.save(tmp_path / "saved")
    assert live.save(tmp_path / "saved", overwrite=True).read("frames").num_rows == 12


def test_a_sensor_of_an_agent_alone_is_that_of_all(live: mmw.Simulation) -> None:
    alone, whole = live.reset(), live.reset()
    whole.table("lidar"), whole.table("rgb")
    for name in ("cav_1", "rsu_1"):
        one, other = (frame.agents[name].sensor("lidar") for frame in (alone, whole))
        assert len(one) > 10 and np.array_equal(one.points, other.points)
        assert np.array_equal(alone.agents["cav_1"].sensor("imu").ax, whole.agents["cav_1"].sensor("imu").ax)
    assert alone.agents["cav_1"].sensor("front") is not None
    with pytest.raises(InputError, match="name one"):
        alone.agents["cav_1"].sensor("nose")


def plain(rows: list[dict[str, Any]]) -> str:
    """Return rows as text, with the bytes of images."""
    return repr([{k: dict(v) if isinstance(v, Mapping) else v for k, v in row.items()} for row in rows])


def test_tables_that_are_traced_at_once_are_those_of_one_look_after_the_other(live: mmw.Simulation) -> None:
    together, alone = live.reset(), live.reset()
    together.trace()
    names = [name for name in together.data.tables if table_spec(name).framed]
    assert {"rgb", "depth", "boxes_2d", "box_visibility", "lidar", "radar", "links"} <= set(names)
    rows = {name: together.rows(name) for name in names}
    car = alone.agents["cav_1"]
    assert car.samples("rgb").keys() == {"front"} and len(car.sensor("lidar")) > 10
    for name in names:
        assert together.table(name) == alone.table(name), name
        assert plain(rows[name]) == plain(rows_of_table(alone.table(name)))
    for name in ("front", "depth"):
        one, other = (frame.agents["rsu_1"].sensor(name) for frame in (together, alone))
        key = "rgb" if name == "front" else "depth"
        assert np.array_equal(getattr(one, key), getattr(other, key))
    with pytest.raises(InputError, match="has no table 'nose'"):
        alone.trace("nose")


def test_tables_are_read_by_the_conditions_of_a_dataset(live: mmw.Simulation) -> None:
    """Those that all rows of the frame meet are not looked at; the others leave none, or some."""
    frame = live.reset()
    number, scenario, weather = frame.frame, frame.scenario, frame.weather
    for name in ("poses", "path_gains", "path_geometry", "paths"):
        own = {} if name == "path_geometry" else {"weather": weather}
        every = frame.data.read(name)
        assert every.num_rows > 0 and frame.table(name) == every
        for frames in (range(number, number + 1), range(number - 1, number + 5), range(number + 4, number - 1, -2)):
            assert frame.data.read(name, scenario=scenario, frames=frames, **own) == every
        for other in ({"scenario": "none"}, {"frames": range(number + 1, number + 3)}, {"frames": range(0)}):
            assert frame.data.read(name, **{**own, **other}).num_rows == 0
        some = frame.data.read(name, agent="cav_1", scenario=scenario, **own)
        assert set(some.column("agent").to_pylist()) == {"cav_1"} and some.num_rows < every.num_rows
    assert frame.data.read("poses", weather="none").num_rows == 0
    with pytest.raises(InputError, match=r"path_geometry.*has no column weather"):
        frame.data.read("path_geometry", weather=weather)


def test_what_was_traced_at_once_is_not_traced_again(live: mmw.Simulation, monkeypatch: pytest.MonkeyPatch) -> None:
    traced: list[Any] = []

    def record(name: str, call: Callable[..., Any], *given: Any) -> Any:
        traced.append(given[1] if name == "capture_makers" else name)
        return call(*given)

    for name in ("capture_makers", "trace_channel"):
        monkeypatch.setattr(frame_tables, name, partial(record, name, getattr(frame_tables, name)))
    frame, types = live.reset(), {sensor.type for sensor in live.config.sensors}
    frame.trace()
    assert len(traced) == 2 and traced[1] == "trace_channel"
    assert {maker[0] for maker in traced[0]} == {"poses", "boxes", "sight", "channel", "sensor"}
    for agent in frame.agents.values():
        samples = {kind: agent.samples(kind) for kind in types}
        assert len(samples["lidar"]) == 1 and all(len(cloud.points) for cloud in samples["lidar"].values())
    assert len(frame.boxes) and all(len(frame.paths(carrier)) for carrier in live.config.channel.carriers_hz)
    frame.trace()
    for name in frame.data.tables:
        if table_spec(name).framed:
            frame.table(name)
    assert len(traced) == 2


def test_points_are_made_when_they_are_looked_at_and_can_be_sent(live: mmw.Simulation) -> None:
    frame = live.reset()
    agent = frame.agents["cav_1"]
    cloud, row = agent.sensor("lidar"), frame.rows("lidar")[0]
    assert "points" not in vars(cloud) and "pose" not in vars(cloud) and len(cloud) == row["point_count"]
    assert "x" not in cloud.columns and cloud["ring"] is cloud.columns["ring"]
    sent = pickle.loads(pickle.dumps(cloud))
    np.testing.assert_array_equal(cloud.points, np.stack([row[axis] for axis in "xyz"], axis=1))
    np.testing.assert_array_equal(cloud.pose, agent.sensor_pose("lidar"))
    for name in ("points", "pose"):
        np.testing.assert_array_equal(getattr(sent, name), getattr(cloud, name))
    assert (sent.agent, sent.sensor, sent.columns.keys()) == ("cav_1", "lidar", cloud.columns.keys())


def test_same_seed_and_controls_give_the_same_rows_and_old_frames_stay_theirs(live: mmw.Simulation) -> None:
    """Frames of the first drive are traced after the second one has gone over the same numbers."""
    first = drive(live)
    seen = drive(live)
    for old, new in ((first[-1], seen[-1]), (first[2], seen[2])):
        for table in ("poses", "boxes", "imu", "lidar", "paths"):
            assert repr(old.table(table).to_pylist()) == repr(new.table(table).to_pylist()), table
    live.reset()
    other = live.step({"cav_1": Control(acceleration_m_s2=2.0)})
    for _ in range(9):
        other = live.step()
    assert other.frame == first[-1].frame
    assert other.agents["cav_1"].pose.tolist() != first[-1].agents["cav_1"].pose.tolist()


def test_tables_made_after_later_steps_are_those_of_their_frame(live: mmw.Simulation) -> None:
    """Arrays of a trace do not lie in memory that the next step writes to."""
    late, frames = live.reset(), []
    late.trace()
    for _ in range(3):
        frames.append(live.step())
        frames[-1].trace()
    at_once = live.reset()
    for name in late.data.tables:
        if table_spec(name).framed:
            assert late.table(name) == at_once.table(name), name


def test_paths_and_links_are_those_of_the_view(live: mmw.Simulation) -> None:
    frame = live.reset()
    paths = frame.paths(28e9)
    assert paths.link_count == 3
    assert len(paths) == sum(len(link.paths["a_re"]) for link in frame.links if link.carrier_hz == 28e9) > 0
    for carrier in (28e9, 4.9e9):
        found = frame.paths(carrier)
        expected = mmw.channel.CarrierPaths.from_table(frame.table("paths"), carrier, frame.table("links"))
        assert all(np.array_equal(getattr(found, n), getattr(expected, n)) for n in ("keys", "link", "row", "a", "tau"))
    with pytest.raises(InputError, match=r"the tables hold 4\.9e\+09, 2\.8e\+10 Hz"):
        frame.paths(5e9)


def test_actor_is_where_the_pose_says_two_frames_later(live: mmw.Simulation) -> None:
    """The next frame is known already, for the velocities of the present one."""
    live.reset()
    pose = [12.0, -18.0, 0.2, 0.5]
    frames = [live.step({"ped_001": Control(pose=pose)}), live.step(), live.step()]
    places = [frame.boxes.columns for frame in frames]
    at = next(row["object_id"] for row in frames[0].data.read("objects").to_pylist() if row["actor"] == "ped_001")
    found = [columns["x"][list(columns["object_id"]).index(at)] for columns in places]
    assert abs(found[0] - 12.0) > 0.1 and found[1] == pytest.approx(12.0, abs=0.05) and found[2] == found[1]


@pytest.mark.slow
def test_two_simulations_at_once_do_not_disturb_each_other(live: mmw.Simulation, config: mmw.Config) -> None:
    live.reset()
    with mmw.Simulation(config, mode="live", device="cpu") as other:
        for _ in range(8):  # a control shows after 60 ms at the latest
            mine = live.step({"cav_1": Control(acceleration_m_s2=-3.0)})
            theirs = other.step()
        kept, lost, seen = mine.table("lidar"), other.step(), theirs.paths(28e9)
        assert mine.table("poses") != theirs.table("poses")
    live.reset()
    for _ in range(8):
        again = live.step({"cav_1": Control(acceleration_m_s2=-3.0)})
    assert again.table("lidar") == kept
    assert theirs.table("poses").num_rows > 0  # looked at before
    assert np.array_equal(theirs.paths(28e9).a, seen.a)
    with pytest.raises(InputError, match="was closed or reset"):
        lost.table("lidar")
    with pytest.raises(InputError, match="was closed or reset"):
        lost.paths(28e9)
    for call in (other.step, other.reset, lambda: other.save("x"), lambda: other.lane_changes):
        with pytest.raises(InputError, match="is closed"):
            call()
    other.close()


@pytest.mark.slow
def test_another_seed_makes_another_fleet(config: mmw.Config) -> None:
    with mmw.Simulation(config, mode="live", device="cpu") as simulation:
        first = simulation.reset().boxes["x"]
        other = simulation.reset(seed=7)
        assert other.row["seed"] == 7 and other.boxes["x"].tolist() != first.tolist()
        assert simulation.reset().row["seed"] == 7
        for seed in (-1, True, 1.5):
            with pytest.raises(InputError, match="whole number"):
                simulation.reset(seed)


def test_bad_calls_are_refused_and_do_not_move_traffic(live: mmw.Simulation) -> None:
    frame = live.reset()
    for controls, text in (
        ({"cav_9": Control()}, "no such actor"),
        ({"rsu_1": Control(pose=[0, 0, 0, 0])}, "no such actor"),
        ([1], "a mapping"),
        ({"ped_001": Control(target_speed_m_s=1.0)}, "only its pose"),
    ):
        with pytest.raises(InputError, match=text):
            live.step(controls)
    assert live.step().frame == frame.frame + 1
    for _ in range(37):
        live.step()
    with pytest.raises(InputError, match=r"is the last of the episode; reset it, or raise frames\.count"):
        live.step()
    with pytest.raises(InputError, match="is live"):
        live[0]
    with pytest.raises(InputError, match="is live"):
        next(iter(live))


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ("frames.count=1", "frames.count = 2 or more"),
        ("frames.rate_hz=50", "mode live steps at 100 Hz"),
    ],
)
def test_scenario_that_cannot_be_stepped_is_refused(change: str, text: str) -> None:
    with pytest.raises(InputError, match=text):
        mmw.Simulation(mmw.load_config("quickstart", [change]), mode="live", device="cpu")


def test_recorded_traffic_cannot_be_stepped(tmp_path: Path) -> None:
    (tmp_path / "drive.csv").write_text("t,id,x,y\n0,a,0,0\n1,a,5,0\n")
    own = {"engine": "replay", "trajectories": "drive.csv", "spawn_center_m": [0, 0, 0], "cav_ids": ["a"]}
    config = mmw.load_config("quickstart", [f"scenarios.town03_roundabout.traffic={own}"])
    with pytest.raises(InputError, match=r"traffic\.engine = 'replay': mode live steps the engines idm and sumo"):
        mmw.Simulation(config, base=tmp_path, mode="live", device="cpu")


@pytest.mark.slow
@needs_sumo
def test_sumo_is_stepped_saved_and_is_the_same_again(tmp_path: Path) -> None:
    engine = ["scenarios.town03_roundabout.traffic.engine=sumo", "channel.enabled=false", "sensors=[{type: gnss}]"]
    config = mmw.load_config("quickstart", ["frames.count=40", *TRAFFIC, *engine])
    with mmw.Simulation(config, mode="live", device="cpu") as simulation:
        for name in ("one", "other"):
            frames = drive(simulation)
            saved = simulation.save(tmp_path / name)
            seen = frames[-1].table("poses").to_pylist()
            assert saved.frame(simulation.scenario, "sunny", frames[-1].frame).table("poses").to_pylist() == seen
        with pytest.raises(InputError, match="no such actor"):
            simulation.step({"cav_9": Control()})
    with pytest.raises(InputError, match="is closed"):
        simulation.step()
    assert verify([str(tmp_path / "one")]) == 0
    parts = [path.relative_to(tmp_path / "one") for path in (tmp_path / "one").rglob("part-*")]
    assert len(parts) > 5
    assert all((tmp_path / "one" / part).read_bytes() == (tmp_path / "other" / part).read_bytes() for part in parts)


def test_mode_is_checked_and_replay_has_no_steps(config: mmw.Config) -> None:
    with pytest.raises(InputError, match="there are replay and live"):
        mmw.Simulation(config, mode="alive", device="cpu")


def test_recorded_stage_has_no_steps_and_cannot_be_live(tmp_path: Path) -> None:
    own = mmw.load_config(DATA / "every_sensor.yaml", ["sensors=[{type: gnss}]", "channel.enabled=false"])
    with pytest.raises(InputError, match="has a stage, whose motion is recorded"):
        mmw.Simulation(own, base=DATA, mode="live", device="cpu")
    with mmw.Simulation(own, base=DATA, device="cpu") as replay:
        for call in (replay.step, replay.reset, lambda: replay.save(tmp_path), lambda: replay.lane_changes):
            with pytest.raises(InputError, match="needs mode='live'"):
                call()
