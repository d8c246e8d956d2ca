"""Recorded launches do what launches do."""

import numpy as np
import pytest
import warp as wp

from mmw.core import launch_recorder
from mmw.core.launch_recorder import LaunchRecorder
from mmw.kernels.lidar.returns import CarlaLidar, LidarReturn, carla_kernel
from mmw.kernels.lidar.trace import LidarRays


class _Arrays:
    """One ray that hits something 10 m away, as CARLA sees it."""

    def __init__(self, device: str) -> None:
        self.rays, self.carla = LidarRays(), CarlaLidar()
        self.rays.range = wp.full((1, 1), 10.0, dtype=float, device=device)
        self.carla.intensity_limit = 1.0
        self.key = wp.zeros(1, dtype=wp.vec2ui, device=device)
        self.returns = wp.zeros((1, 1, 1), dtype=LidarReturn, device=device)
        self.count = wp.zeros((1, 1), dtype=int, device=device)

    def launch(self, recorder: LaunchRecorder) -> float:
        """Return the intensity of the return."""
        recorder.launch(carla_kernel, (1, 1), [self.rays, self.carla, self.key], [self.returns, self.count])
        return float(self.returns.numpy()["intensity"][0, 0, 0])


def test_recorded_launch_sees_what_a_struct_holds_at_the_time(device: str) -> None:
    recorder, arrays = LaunchRecorder(device), _Arrays(device)
    assert arrays.launch(recorder) == 1.0
    arrays.carla.attenuation = 0.1
    assert arrays.launch(recorder) == pytest.approx(np.exp(-1.0), abs=1 / 512)
    assert len(recorder._recorded) == 1


def test_launch_on_other_arrays_is_another_one(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(launch_recorder, "KEPT_LAUNCHES", 2)
    recorder, several = LaunchRecorder(device), [_Arrays(device) for _ in range(3)]
    for attenuation, arrays in enumerate(several):
        arrays.carla.attenuation = 0.1 * attenuation
    for arrays in (*several, *several):
        assert arrays.launch(recorder) == pytest.approx(np.exp(-10.0 * arrays.carla.attenuation), abs=1 / 512)
    assert 1 <= len(recorder._recorded) <= 2


def test_launch_of_no_threads_does_nothing(device: str) -> None:
    recorder, arrays = LaunchRecorder(device), _Arrays(device)
    recorder.launch(carla_kernel, (0, 1), [arrays.rays, arrays.carla, arrays.key], [arrays.returns, arrays.count])
    assert not recorder._recorded and not arrays.count.numpy().any()
