"""A late accelerometer reads the same in live, saved and replayed frames, from the first one on."""

from pathlib import Path

import pyarrow as pa
import pyarrow.compute as pc
import pytest

import mmw

SCENE = [
    "scenarios.town03_roundabout.traffic={vehicle_count: 3, spawn_center_m: [-0.5, -0.5, 0], cav_ranks: [1], "
    "pedestrian_count: 2, vru_ranks: [0]}",
    "scenarios.town03_roundabout.uavs=[{name: uav_1, waypoints: [{time_s: 0, position_m: [-10, -20, 18]}, "
    "{time_s: 4, position_m: [10, -20, 22]}]}]",
    "channel.enabled=false",
]
KNOWN_AHEAD = ("vru_1", "uav_1")
"""Agents whose motion no filter of the live traffic touches."""


def known(table: pa.Table) -> pa.Table:
    """Return the rows of agents that move alike in live and replayed traffic."""
    return table.filter(pc.is_in(pc.cast(table["agent"], pa.string()), pa.array(KNOWN_AHEAD)))


@pytest.mark.slow
@pytest.mark.parametrize(("start", "lag"), [(0, 0), (0, 1), (1, 1), (2, 1), (6, 1)])
def test_live_saved_and_replayed_readings_are_equal(start: int, lag: int, tmp_path: Path) -> None:
    sensors = f"sensors=[{{type: imu, on: [cav, vru, uav], accel_lag_frames: {lag}}}]"
    config = mmw.load_config("quickstart", [*SCENE, sensors, f"frames.start={start}", "frames.count=8"])
    with mmw.Simulation(config, mode="live", device="cpu") as live:
        frames = [live.reset(), *(live.step() for _ in range(4))]
        seen = [frame.table("imu") for frame in frames]
        saved = live.save(tmp_path / "saved")
    whole = mmw.load_config("quickstart", [*SCENE, sensors, f"frames.count={start + 8}"])
    with (
        mmw.Simulation(config, device="cpu") as replay,
        mmw.Simulation(whole, device="cpu") as longer,
        mmw.BatchedSimulation(config, 1, device="cpu") as worlds,
    ):
        for frame, table in zip(frames, seen, strict=True):
            assert table.num_rows == 3
            own = saved.frame(live.scenario, "sunny", frame.frame).table("imu")
            assert own.select(table.column_names).to_pylist() == table.to_pylist()
            for other in (replay, longer):
                assert known(other.frame(frame.frame).table("imu")).equals(known(table)), (frame.frame, other is longer)
            (same,) = worlds.present
            assert same.table("imu").equals(table)
            worlds.step()
