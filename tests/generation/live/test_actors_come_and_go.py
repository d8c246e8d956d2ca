"""Actors are removed from a live simulation and added again: nothing sees them, and saved rows are those seen."""

import json
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np
import pytest

import mmw
from mmw import Control
from mmw.cli.verify import main as verify
from mmw.core.errors import InputError
from tests.fixtures.simulated_files import assert_same_samples, write_simulated

SENSORS = (
    "sensors=[{type: lidar, channels: 8, points_per_channel: 90, scene_flow: true}, {type: imu}, {type: gnss}, "
    "{type: radar, azimuth_rays: 24, elevation_rays: 8}, "
    "{type: depth, width_px: 32, height_px: 24, segmentation: true}]"
)
TRAFFIC = [
    "scenarios.town03_roundabout.traffic.vehicle_count=9",
    "scenarios.town03_roundabout.traffic.pedestrian_count=3",
]


@pytest.fixture(scope="module")
def live() -> Iterator[mmw.Simulation]:
    """Return one live simulation for all tests."""
    config = mmw.load_config("quickstart", ["frames.count=40", SENSORS, *TRAFFIC])
    with mmw.Simulation(config, mode="live", device="cpu") as simulation:
        yield simulation


def object_id(frame: mmw.Frame, actor: str) -> int:
    """Return the number of an actor's object."""
    return next(row["object_id"] for row in frame.data.read("objects").to_pylist() if row["actor"] == actor)


def drive(simulation: mmw.Simulation, look: bool = False) -> list[mmw.Frame]:
    """Return the frames of an episode in which a CAV, a vehicle and a person go and come back; look at each at once."""
    frames = [simulation.reset()]

    def step(count: int = 1, **controls: Control | None) -> None:
        for _ in range(count):
            frames.append(simulation.step(controls))
            if look:
                frames[-1].trace("poses", "imu", "boxes")

    place = frames[0].agents["cav_2"].pose
    ahead = np.concatenate([place[:2] + 3.0, place[2:3] + 0.2])
    for name in ("cav_2", "veh_001", "ped_001"):
        simulation.remove(name)
    step(3)
    turned = [
        *ahead,
        *(np.array([[0, -1, 0, 0], [1, 0, 0, 0], [0, 0, 0, 1], [0, 0, -1, 0]]) @ place[3:]),
    ]  # half a turn
    simulation.add("cav_2", turned)
    step(2)
    simulation.add("ped_001", [*ahead[:2] + 2.0, ahead[2], 1.0])
    step(2, cav_2=Control(steering_rad=0.1, acceleration_m_s2=3.0))
    simulation.remove("cav_2")  # after three rows at rest
    step(2)
    simulation.add("cav_2", [*ahead, 2.0])
    simulation.remove("cav_1")
    step(5, cav_2=Control(pose=[*ahead + 0.1, 2.1]))
    simulation.remove("cav_2")
    step(3)
    return frames


def present(frames: Sequence[mmw.Frame], agent: str) -> list[int]:
    """Return the frames in which an agent is there."""
    return [frame.frame for frame in frames if agent in frame.agents]


def test_removed_actor_is_in_no_table_and_added_one_has_finite_motion(live: mmw.Simulation) -> None:
    frames = drive(live)
    assert present(frames, "cav_2") == [1, 2, 6, 7, 8, 9, 12, 13, 14, 15, 16]
    assert present(frames, "cav_1") == list(range(1, 12))
    for frame in (frames[1], frames[2], frames[5]):  # 2, 3, 6
        is_there = "cav_2" in frame.agents
        number = object_id(frame, "cav_2")
        assert ("cav_2" in frame.table("poses").column("agent").to_pylist()) == is_there
        assert (number in frame.boxes.columns["object_id"]) == is_there
        linked = {row[key] for row in frame.table("links").to_pylist() for key in ("agent", "peer")}
        assert ("cav_2" in linked) == is_there
        assert ("cav_2" in frame.table("imu").column("agent").to_pylist()) == is_there
        gone = {object_id(frame, name) for name in ("cav_2", "veh_001", "ped_001")}
        seen = {int(one) for row in frame.table("lidar").to_pylist() for one in row["object_id"]}
        if not is_there:
            assert not gone & seen and not gone & {int(one) for one in frame.boxes.columns["object_id"]}
    first = frames[5]
    row = next(row for row in first.table("poses").to_pylist() if row["agent"] == "cav_2")
    assert [row[name] for name in ("vx", "vy", "vz", "wx", "wy", "wz")] == [0.0] * 6
    for table in ("poses", "imu", "boxes"):
        for frame in frames:
            for column in frame.table(table).columns:
                if "float" in str(column.type):
                    assert np.isfinite(column.to_numpy()).all(), (frame.frame, table)


@pytest.mark.slow
def test_saved_episode_has_the_rows_that_were_seen_and_passes_verify(live: mmw.Simulation, tmp_path: Path) -> None:
    frames = drive(live, look=True)
    saved = live.save(tmp_path / "saved")
    assert verify([str(tmp_path / "saved")]) == 0
    files = write_simulated(live, frames, tmp_path / "saved", tmp_path / "seen")
    assert [name for name in files if (tmp_path / "seen" / name).read_bytes() != (saved.root / name).read_bytes()] == []
    assert all(assert_same_samples(saved.frame(live.scenario, "sunny", frame.frame), frame) for frame in frames[:7])
    note = tmp_path / "saved" / "stages" / f"{live.scenario}.json"
    known = json.loads(note.read_text())
    # The frame after the last, 18, is known too.
    assert known["absent"]["cav_2"] == [[3, 6], [10, 12], [17, 20]] and known["absent"]["cav_1"] == [[12, 20]]
    del known["absent"]["cav_1"]
    note.write_text(json.dumps(known))
    assert verify([str(tmp_path / "saved")]) == 1, "a CAV is absent, and nobody removed it"
    drive(live)
    live.save(tmp_path / "again")
    parts = [path.relative_to(tmp_path / "saved") for path in (tmp_path / "saved").rglob("part-*")]
    assert len(parts) > 10, "the same calls give the same bytes"
    assert all((tmp_path / "saved" / part).read_bytes() == (tmp_path / "again" / part).read_bytes() for part in parts)


@pytest.mark.slow
@pytest.mark.parametrize("more", [0, 1, 2])
def test_episode_saved_in_the_first_frames_of_an_added_actor(live: mmw.Simulation, more: int, tmp_path: Path) -> None:
    """The stage then ends one frame later: rows do not depend on what comes after."""
    place = live.reset().agents["cav_2"].pose
    live.remove("cav_2")
    live.step()
    live.add("cav_2", place.tolist())
    live.step({"cav_2": Control(pose=[*place[:3] + 0.5, 0.3])})
    for _ in range(more + 1):
        frame = live.step()
    seen = {name: frame.table(name) for name in ("poses", "imu", "boxes")}
    saved = live.save(tmp_path / "saved")
    for name, table in seen.items():
        own = saved.frame(live.scenario, "sunny", frame.frame).table(name)
        assert "cav_2" in own.column("agent").to_pylist() if name != "boxes" else True
        assert repr(own.select(table.column_names).to_pylist()) == repr(table.to_pylist())


@pytest.mark.slow
@pytest.mark.parametrize("more", [0, 3, 20])
def test_saved_rows_of_a_vehicle_that_came_back_to_its_route(live: mmw.Simulation, more: int, tmp_path: Path) -> None:
    """It stands, then its driver goes on: every row is the one that was seen, wherever the episode ends."""
    frames = [live.reset()]
    live.remove("cav_2")
    frames += [live.step() for _ in range(4)]
    live.add("cav_2")
    frames += [live.step() for _ in range(more + 2)]
    for frame in frames:
        frame.trace("poses", "imu", "boxes")
    assert present(frames, "cav_2") == [1, 2, *range(7, 8 + more)]
    rows = [row for row in frames[6].table("poses").to_pylist() if row["agent"] == "cav_2"]
    assert [rows[0][name] for name in ("vx", "vy", "vz", "wx", "wy", "wz")] == [0.0] * 6
    saved = live.save(tmp_path / "saved")
    assert verify([str(tmp_path / "saved")]) == 0
    files = write_simulated(live, frames, tmp_path / "saved", tmp_path / "seen")
    assert [name for name in files if (tmp_path / "seen" / name).read_bytes() != (saved.root / name).read_bytes()] == []


def test_bad_calls_are_refused_and_nothing_has_changed(live: mmw.Simulation) -> None:
    live.reset()
    plain = live.step().table("poses")
    live.reset()
    for call, text in (
        (lambda: live.remove("cav_9"), "no such actor"),
        (lambda: live.add("cav_9", [0, 0, 0, 0]), "no such actor"),
        (lambda: live.remove("rsu_1"), "remove 'rsu_1': belongs to the town and stays"),
        (lambda: live.add("rsu_1", [0, 0, 0, 0]), "add 'rsu_1': belongs to the town"),
        (lambda: live.add("cav_1", [0, 0, 0, 0]), "is there already"),
        (lambda: live.add("cav_1", [float("nan"), 0, 0, 0]), "finite numbers"),
    ):
        with pytest.raises(InputError, match=text):
            call()
    assert live.step().table("poses") == plain
    live.remove("cav_1")
    with pytest.raises(InputError, match="has just been removed"):
        live.add("cav_1", [0, 0, 0, 0])
    live.step()
    with pytest.raises(InputError, match="is absent; add it first"):
        live.step({"cav_1": Control()})
    assert "cav_1" in live.reset().agents


def test_calls_after_close_and_of_a_replay_are_refused(live: mmw.Simulation) -> None:
    with mmw.Simulation(live.config, device="cpu") as replay:
        for call in (lambda: replay.remove("cav_1"), lambda: replay.add("cav_1", [0, 0, 0, 0])):
            with pytest.raises(InputError, match="needs mode='live'"):
                call()
    simulation = mmw.Simulation(live.config, mode="live", device="cpu")
    simulation.close()
    for call in (lambda: simulation.remove("cav_1"), lambda: simulation.add("cav_1", [0, 0, 0, 0])):
        with pytest.raises(InputError, match="is closed"):
            call()
