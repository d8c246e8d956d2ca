"""Arrays that sensors keep change no sample, neither of before nor of later."""

import pytest

from mmw.config import SensorConfig
from mmw.sensors import Lidar, Radar, workspace
from mmw.sensors.lidar import sweep_arrays
from mmw.sensors.scene_capture import capture
from tests.fixtures.scene_captures import FREE, OTHER, assert_same, context, street

SENSORS = [
    Lidar(channels=8, points_per_channel=60),
    Lidar(channels=8, points_per_channel=60, returns="dual", rolling=True),
    Lidar(channels=8, points_per_channel=60, mode="carla"),
    Radar(),
    Radar(output="dense"),
    Radar(mode="carla", points=300),
]

each_sensor = pytest.mark.parametrize("sensor", SENSORS, ids=lambda one: f"{one.type}-{one.mode}")


@each_sensor
def test_samples_stay_when_the_arrays_are_traced_into_again(device: str, sensor: SensorConfig) -> None:
    scene, weathers = context(street(), device, 1), ["sunny", "rainy"]
    first = capture(scene, sensor, pose=FREE, weather=weathers)
    second = capture(scene, sensor, pose=OTHER, weather=weathers)
    again = [capture(scene, sensor, pose=pose, weather="rainy") for pose in (FREE, OTHER, FREE, OTHER)]  # replayed
    assert len(scene.cache["workspaces"]) == 1
    for weather in weathers:
        for pose, found in ((FREE, first), (OTHER, second)):
            assert_same(capture(context(street(), device, 1), sensor, pose=pose, weather=weather), found[weather])
    for found, wanted in zip(again, (first, second) * 2, strict=True):
        assert_same(found, wanted["rainy"])


@each_sensor
def test_large_batches_keep_no_arrays(device: str, sensor: SensorConfig, monkeypatch: pytest.MonkeyPatch) -> None:
    wanted = capture(context(street(), device, 1), sensor, pose=FREE)
    for module in (workspace, sweep_arrays):
        monkeypatch.setattr(module, "KEPT_RAYS", 0)
    scene = context(street(), device, 1)
    assert_same(capture(scene, sensor, pose=FREE), wanted)
    assert "workspaces" not in scene.cache


def test_arrays_of_few_sensors_are_kept(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(workspace, "KEPT_SPACES", 2)
    scene = context(street(), device, 1)
    for count in (1, 2, 3, 1):
        found = capture(scene, SENSORS[0], pose=[FREE] * count)
        assert len(found) == count and len(scene.cache["workspaces"]) <= 2
