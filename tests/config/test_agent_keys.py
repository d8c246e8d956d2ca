"""Sensors, mounts and antennas go by role, or by the name of an agent, which has to be there."""

from typing import Any

import pytest

from mmw.config import Config, load_config
from mmw.core.errors import InputError
from mmw.sensors import Lidar

TOWN: dict[str, Any] = {
    "name": "one",
    "town": "town03",
    "traffic": {"vehicle_count": 4, "spawn_center_m": [0, 0, 0], "cav_ranks": [0, 1]},
    "rsus": [{"name": "corner", "position_m": [0, 0, 0]}],
}


def config(**changes: Any) -> Config:
    return Config(**{"scenarios": [TOWN], "sensors": [], **changes})


def test_a_name_comes_before_its_role() -> None:
    lidar = Lidar(on=("corner", "cav_2"), mount={"cav_2": {"position_m": (0, 0, 3.5)}})
    assert [lidar.is_on(*agent) for agent in (("cav", "cav_1"), ("cav", "cav_2"), ("rsu", "corner"))] == [
        False, True, True,
    ]  # fmt: skip
    assert lidar.mount_on("cav", "cav_2").position_m == (0, 0, 3.5)
    assert lidar.mount_on("cav", "cav_1").position_m == (0, 0, 2.5)
    assert lidar.mount_on("vehicle", "veh_001").position_m == (0, 0, 2.5)
    (antenna,) = config(channel={"antennas": [{"mount": {"corner": {"position_m": (0, 0, 6)}}}]}).channel.antennas
    assert antenna.mount_on("rsu", "corner").position_m == (0, 0, 6)
    assert antenna.mount_on("rsu", "other").position_m == (0, 0, 4)


def test_names_of_agents_are_accepted() -> None:
    found = config(sensors=[{"type": "lidar", "on": ["cav_2", "rsu"], "mount": {"corner": {"position_m": [0, 0, 5]}}}])
    assert found.agent_names == ("cav_1", "cav_2", "corner")
    stage = {"name": "two", "stage": "mine.usda"}
    assert config(scenarios=[TOWN, stage], sensors=[{"type": "lidar", "on": ["Ego"]}]).agent_names is None


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"sensors": [{"type": "lidar", "on": ["cavs"]}]}, r"sensors\[0\].on names 'cavs', .* did you mean `cav`"),
        ({"sensors": [{"type": "imu", "on": ["cav_3"]}]}, r"names 'cav_3', which is no role and no agent"),
        (
            {"sensors": [{"type": "imu", "mount": {"corners": {"yaw_deg": 3}}}]},
            r"sensors\[0\].mount names 'corners', .* did you mean `corner`",
        ),
        ({"channel": {"antennas": [{"on": ["drone"]}]}}, r"antennas\[0\].on names 'drone', .* there are"),
        (
            {"channel": {"links": [{"name": "up", "tx": ["cav"], "rx": ["corners"]}]}},
            r"links\[0\].rx names 'corners', .* did you mean `corner`",
        ),
        ({"sensors": [{"type": "imu", "on": ["cav_1", "cav_1"]}]}, "names one twice"),
    ],
)
def test_other_names_are_errors(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        config(**changes)


def test_models_of_cavs() -> None:
    with pytest.raises(InputError, match="cav_models names 3 models for 2 CAVs"):
        config(scenarios=[{**TOWN, "traffic": {**TOWN["traffic"], "cav_models": ("sedan", None, "van")}}])
    shipped = load_config("bus_and_truck")
    assert shipped.scenarios[0].traffic is not None
    assert shipped.scenarios[0].traffic.cav_models == ("city_bus", "box_truck")
