"""The LiDAR benchmark measures sweeps of every weather, on the device and with the copy."""

import pytest

from bench.lidar import LIDARS, line, measure, with_sensors
from bench.scenes import grid_town, with_vehicles
from mmw.sensors import Lidar
from tests.fixtures.device_rays import loaded

pytestmark = pytest.mark.slow  # benchmarks are not part of the package


def test_every_weather_is_measured_twice() -> None:
    arrays = with_sensors(with_vehicles(grid_town(), 1))
    scene = loaded(arrays, "cpu")
    config = Lidar(on=("cav",), channels=8, points_per_channel=64)
    results = measure(scene, config, ["sunny", "foggy"], repeats=1)
    assert [(r.weather, r.where) for r in results] == [
        (weather, where) for where in ("on the device", "with copy") for weather in ("sunny", "foggy", "all")
    ]
    sunny, foggy, both = results[:3]
    assert sunny.scans == foggy.scans == LIDARS and both.scans == 2 * LIDARS
    assert sunny.returns + foggy.returns == both.returns > 0
    assert sunny.echoes == sunny.cost == 0.0 < foggy.echoes
    assert all(r.trace_s > 0 and r.shade_s > 0 and r.weather in line(r) for r in results)
