"""Agents that a configuration places: base stations, drones, connected pedestrians; names, errors, hashes."""

from typing import Any

import pytest

from mmw.config import Config, ConfigError, ScenarioConfig
from mmw.config.agent_keys import AGENT_ROLES, ROLE_MOUNTS, AgentIdentity, Body
from mmw.config.antennas import AntennaConfig
from mmw.core.errors import InputError
from mmw.sensors import DepthCamera, Imu, Lidar, Radar
from mmw.sensors.rgb.config import paper_cameras
from mmw.usd.vehicle_catalog import VehicleModel, load_catalog

TRAFFIC: dict[str, Any] = {
    "vehicle_count": 4, "spawn_center_m": [0, 0, 0], "cav_ranks": [0, 1], "pedestrian_count": 5, "vru_ranks": [3, 0],
}  # fmt: skip
BUS = Body(front=5.6, rear=-6.4, left=1.3, right=-1.2, roof=3.05)
DRONE = {"name": "uav_1", "position_m": [0, 0, 20]}


def scenario(**changes: Any) -> dict[str, Any]:
    return {"name": "one", "town": "town03", "traffic": TRAFFIC, **changes}


def flight(*points: tuple[float, float], **changes: Any) -> dict[str, Any]:
    """Return a drone that flies along x: (time [s], x [m])."""
    waypoints = [{"time_s": time, "position_m": [x, 0, 20]} for time, x in points]
    return {"name": "uav_1", "waypoints": waypoints, **changes}


def test_agents_of_all_roles_have_names() -> None:
    found = Config(
        scenarios=[scenario(rsus=[{"position_m": [0, 0, 0]}], base_stations=[{"position_m": [0, 0, 25]}], uavs=[DRONE])]
    )
    assert found.agent_names == ("cav_1", "cav_2", "vru_1", "vru_2", "rsu_1", "bs_1", "uav_1")
    assert set(ROLE_MOUNTS) == set(AGENT_ROLES)


def test_keys_that_are_not_used_do_not_show() -> None:
    """Hashes of configurations of before there were these keys stay."""
    plain = Config(scenarios=[scenario(traffic={**TRAFFIC, "vru_ranks": ()})])
    data = plain.identity()["scenarios"][0]
    assert not {"base_stations", "uavs"} & set(data) and "vru_ranks" not in data["traffic"]
    used = Config(scenarios=[scenario(uavs=[DRONE])])
    again = Config.model_validate(used.model_dump(mode="json"))
    assert again == used and used.sha256() != plain.sha256()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"traffic": {**TRAFFIC, "vru_ranks": [5]}}, "vru_ranks holds 5; .* pedestrian_count - 1 = 4"),
        ({"traffic": {**TRAFFIC, "vru_ranks": [1, 1]}}, "names a pedestrian twice"),
        ({"uavs": [{"name": "vru_1", "position_m": [0, 0, 9]}]}, "uavs holds 'vru_1', a name of generated traffic"),
        ({"uavs": [DRONE], "base_stations": [{"name": "uav_1", "position_m": [0, 0, 9]}]}, "'uav_1' is in two of"),
        ({"base_stations": [{"position_m": [0, 0, 9]}] * 2}, "base_stations = .* names a unit twice"),
        ({"town": None, "traffic": None, "stage": "a.usda", "uavs": [DRONE]}, "give it the role uav"),
        ({"uavs": [{"name": "uav_1"}]}, "exactly one of `position_m` and `waypoints`"),
        ({"uavs": [flight((0, 0))]}, "two or more, growing"),
        ({"uavs": [flight((0, 0), (2, 5), (1, 6))]}, "two or more, growing"),
        ({"uavs": [flight((0, 0), (1, 5), yaw_deg=30)]}, "`yaw_deg` goes with `position_m`"),
        (
            {"uavs": [flight((0, 0), (10, 20), (11, 20), (12, 100), (30, 120))]},
            r"leg from waypoint 3 at 11 s to waypoint 4 at 12 s needs .* m/s; at most max_speed_mps = 19",
        ),
    ],
)  # fmt: skip
def test_mistakes_are_named(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ConfigError, match=message):
        ScenarioConfig(**scenario(**changes))


def test_a_limit_of_ones_own_holds() -> None:
    """The fastest of a leg from rest to rest is 35/16 of its mean speed."""
    ScenarioConfig(**scenario(uavs=[flight((0, 0), (10, 50), max_speed_mps=11)]))
    with pytest.raises(ConfigError, match=r"needs 10\.9 m/s"):
        ScenarioConfig(**scenario(uavs=[flight((0, 0), (10, 50), max_speed_mps=10.9)]))


def test_name_comes_before_model_before_class_before_role() -> None:
    mount = {key: {"position_m": (0, 0, z)} for z, key in enumerate(("cav", "label:bus", "model:city_bus", "cav_2"), 1)}
    lidar = Lidar(on=("label:bus", "model:van"), mount=mount)
    agents = {
        ("cav", "cav_2", "city_bus", "bus"): (True, 4), ("cav", "cav_1", "city_bus", "bus"): (True, 3),
        ("cav", "cav_1", "other_bus", "bus"): (True, 2), ("cav", "cav_1", "sedan", "car"): (False, 1),
        ("cav", "cav_1", "van", "car"): (True, 1),
    }  # fmt: skip
    for agent, (is_on, z) in agents.items():
        assert lidar.is_on(*agent) is is_on and lidar.mount_on(*agent).position_m[2] == z
    assert not lidar.is_on("vehicle", "veh_001", "city_bus", "bus")  # no agent


def test_mounts_count_from_the_body() -> None:
    bus = AgentIdentity("cav", "cav_1", "city_bus", "bus", BUS)
    own = {"label:bus": {"position_m": (0.5, 0.2, 0.4), "relative_to": "roof", "yaw_deg": 90}}
    mount = Lidar(mount=own).mount_on(*bus)
    assert mount.position_m == (0.5, 0.2, 0.4 + 3.05) and mount.yaw_deg == 90
    for side, place in {
        "front": (0.1 + 5.6, 0.2, 0.4), "rear": (0.1 - 6.4, 0.2, 0.4), "left": (0.1, 0.2 + 1.3, 0.4),
        "right": (0.1, 0.2 - 1.2, 0.4),
    }.items():  # fmt: skip
        own = {"model:city_bus": {"position_m": (0.1, 0.2, 0.4), "relative_to": side}}
        assert Lidar(mount=own).mount_on(*bus).position_m == place
    with pytest.raises(InputError, match=r"corner: mount\.rsu: relative_to = roof needs an agent with a body; use"):
        Lidar(mount={"rsu": {"relative_to": "roof"}}).mount_on("rsu", "corner")


@pytest.mark.parametrize("vehicle", load_catalog().values(), ids=lambda vehicle: vehicle.name)
def test_default_mounts_are_in_the_open_on_every_vehicle(vehicle: VehicleModel) -> None:
    """Those on cars are at the places of before, to the bit."""
    body = Body.of_box((vehicle.length, vehicle.width, vehicle.height), vehicle.center)
    assert body is not None
    agent = AgentIdentity("cav", "cav_1", vehicle.name, vehicle.label, body)
    mounted = (Lidar(), AntennaConfig(), DepthCamera(), Radar(), *paper_cameras()[1:])
    mounts = [one.mount_on(*agent) for one in mounted]
    assert [mount.yaw_deg for mount in mounts] == [0, 0, 0, 0, 180, 90, -90]
    places = [mount.position_m for mount in mounts]
    if vehicle.label == "car":
        assert places[:4] == [(0, 0, 2.5), (0, 0, 2.5), (1.5, 0, 2.4), (2.5, 0, 0.6)]
        assert places[4:] == [(-1.5, 0, 2.4), (0, 0.7, 2.4), (0, -0.7, 2.4)]
    else:
        roof, front, rear = (round(at, 9) for at in (body.roof + 1.05, body.front + 0.25, body.rear - 0.25))
        left, right = round(body.left + 0.25, 9), round(body.right - 0.25, 9)
        assert [tuple(round(part, 9) for part in place) for place in places] == [
            (0, 0, roof), (0, 0, roof), (front, 0, 2.4), (front, 0, 0.6), (rear, 0, 2.4), (0, left, 2.4),
            (0, right, 2.4),
        ]  # fmt: skip


def test_a_mount_of_cavs_is_that_of_large_ones_too() -> None:
    """A given `cav` holds for buses as before; a stored configuration holds all mounts."""
    bus = AgentIdentity("cav", "cav_1", "city_bus", "bus", BUS)
    high = Lidar(mount={"cav": {"position_m": (0, 0, 4)}})
    for lidar in (high, Lidar(**high.model_dump())):
        assert lidar.mount_on(*bus).position_m == (0, 0, 4)
    assert Lidar(**Lidar().model_dump()) == Lidar()


def test_new_roles_have_a_mount() -> None:
    assert Imu(on=("vru",)).mount_on("vru", "vru_1").position_m == ROLE_MOUNTS["vru"]
    assert Lidar().mount_on("uav", "uav_1").position_m == (0, 0, -0.15)
    assert Lidar(mount={"bs": {"position_m": (1, 0, 5)}}).mount_on("bs", "bs_1").position_m == (1, 0, 5)


def test_malformed_keys_are_refused() -> None:
    with pytest.raises(ConfigError, match="on"):
        Lidar(on=("size:big",))
