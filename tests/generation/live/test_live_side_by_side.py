"""Two live simulations on one device, stepped and looked at in turn: each has the rows that it has alone."""

import pyarrow as pa
import pytest

import mmw
from mmw import Control
from tests.conftest import DEVICES

pytestmark = pytest.mark.slow

SENSORS = (
    "sensors=[{type: lidar, on: [cav_1], channels: 8, points_per_channel: 60}, {type: imu, on: [cav_1]}, "
    "{type: depth, on: [cav_1], width_px: 24, height_px: 16}, "
    "{type: rgb, on: [cav_1], name: front, width_px: 24, height_px: 16}]"
)
TABLES = ("poses", "boxes", "lidar", "imu", "depth", "rgb", "links", "paths")
STEPS = 6
DRIVES = {
    "town03_roundabout": {"cav_1": Control(acceleration_m_s2=-3.0)},
    "town07_single_lane": {"cav_1": Control(steering_rad=0.2, acceleration_m_s2=1.0)},
}
"""Scenario -> controls of the first step."""


def live(scenario: str, device: str) -> mmw.Simulation:
    """Return a simulation of a few vehicles in a scenario of another town."""
    traffic = f"scenarios.{scenario}.traffic"
    changes = [f"{traffic}.vehicle_count=6", f"{traffic}.cav_ranks=[0, 1]", "frames.count=20", SENSORS]
    changes += ["channel.candidates=exhaustive"]
    return mmw.Simulation(mmw.load_config(scenario, changes), mode="live", device=device)


def look(frame: mmw.Frame) -> dict[str, pa.Table]:
    """Return what a frame has in all tables."""
    return {name: frame.table(name) for name in TABLES}


def alone(scenario: str, device: str) -> list[dict[str, pa.Table]]:
    """Return what all frames of a drive have, in a simulation without another one beside it."""
    with live(scenario, device) as simulation:
        frames = [simulation.reset(), simulation.step(DRIVES[scenario])]
        frames += [simulation.step() for _ in range(STEPS - 1)]
        return [look(frame) for frame in frames]


@pytest.mark.parametrize("device", DEVICES)
def test_two_simulations_in_turn_have_the_rows_that_each_has_alone(device: str) -> None:
    """Steps alternate; one is looked at in every frame, the other one in every second, and later again in reverse."""
    first, second = DRIVES
    expected = {scenario: alone(scenario, device) for scenario in DRIVES}
    with live(first, device) as one, live(second, device) as other:
        mine, theirs = [one.reset()], [other.reset()]
        seen = [look(mine[0])]
        for step in range(STEPS):
            theirs.append(other.step(DRIVES[second] if step == 0 else None))
            mine.append(one.step(DRIVES[first] if step == 0 else None))
            seen.append(look(mine[-1]))
            if step % 2:
                assert theirs[-1].table("lidar").equals(expected[second][step + 1]["lidar"])
        late = [look(frame) for frame in reversed(theirs)][::-1]
        again = look(one.reset())
    for scenario, found in ((first, seen), (second, late), (first, [again])):
        for number, (tables, own) in enumerate(zip(found, expected[scenario], strict=False)):
            for name in TABLES:
                assert own[name].num_rows > 0 and tables[name].equals(own[name]), (scenario, number, name)
    assert not expected[first][1]["lidar"].equals(expected[first][2]["lidar"])
