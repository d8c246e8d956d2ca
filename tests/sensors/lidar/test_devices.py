"""LiDAR on a device against a CPU: the same hits to the last bit, and returns within a step of the stored grid.

Kernels of rays fuse no product with a sum, so a GPU rounds as a CPU does. Sine, cosine, exponential and logarithm come
from the library of each device and may differ in their last bits: they turn the poses of a rolling sweep, and are in
the power and the noise of a return.
"""

import numpy as np
import pytest

from mmw.physics.weather.weather import PRESETS
from mmw.scene.scene_data import SceneData
from mmw.scene.views import make_views, view_keys
from mmw.sensors import Lidar
from mmw.sensors.lidar.returns import LidarHits, find_returns
from mmw.sensors.lidar.simulate import trace_lidar_hits
from tests.fixtures.lidar_sweeps import TUMBLING
from tests.fixtures.scenes import random_triangles, two_cars
from tests.fixtures.sensor_runs import all_carriers, loaded

STREET = Lidar(on=("cav",))
SOUP = all_carriers(random_triangles(3, 400, vehicles=6, frames=2))
DENSE = TUMBLING.model_copy(update={"channels": 32, "points_per_channel": 180})
both_scenes = pytest.mark.parametrize(
    ("arrays", "config"), [(two_cars(2), STREET), (SOUP, DENSE)], ids=["street", "soup"]
)


def traced(arrays: SceneData, config: Lidar, device: str) -> LidarHits:
    return trace_lidar_hits(loaded(arrays, device), make_views(arrays, list(arrays.frames), config), config)


def values(hits: LidarHits) -> dict[str, np.ndarray]:
    return {name: getattr(hits.rays, name).numpy() for name in ("range", "cos_incidence", "object_id", "material_id")}


@both_scenes
def test_hits_are_those_of_a_cpu_to_the_last_bit(device: str, arrays: SceneData, config: Lidar) -> None:
    own, expected = (values(traced(arrays, config, where)) for where in (device, "cpu"))
    assert np.isfinite(expected["range"]).mean() > 0.2
    for name, wanted in expected.items():
        np.testing.assert_array_equal(own[name], wanted, err_msg=name)


@both_scenes
def test_hits_of_a_rolling_sweep_are_those_of_a_cpu_but_for_its_turn(
    device: str, arrays: SceneData, config: Lidar
) -> None:
    """The bits of a turn are 1e-7 of it: a ray meets another surface only where it passes an edge as near as that."""
    config = config.model_copy(update={"rolling": True})
    own, expected = (values(traced(arrays, config, where)) for where in (device, "cpu"))
    is_same = (own["object_id"] == expected["object_id"]) & (own["material_id"] == expected["material_id"])
    assert (~is_same).sum() <= 1e-4 * is_same.size
    near = is_same & np.isfinite(expected["range"]) & (expected["cos_incidence"] > 0.01)  # grazing rays move far
    off = np.abs(own["range"][near] - expected["range"][near])
    assert (off > 1e-4).sum() <= 1e-4 * is_same.size  # such a ray meets another face of the same object


@pytest.mark.parametrize("mode", ["physical", "carla"])
@pytest.mark.parametrize("weather", ["sunny", "rainy"])
def test_returns_are_those_of_a_cpu_within_a_step(device: str, mode: str, weather: str) -> None:
    arrays, config = two_cars(2), STREET.model_copy(update={"mode": mode})
    views = make_views(arrays, list(arrays.frames), config)
    keys = view_keys(arrays, views, 1, "test", weather, config.name)
    found = []
    for where in (device, "cpu"):
        materials = arrays.materials["sunny"]
        returns, count = find_returns(traced(arrays, config, where), materials, PRESETS[weather], keys, (0, 0))
        found.append((returns.numpy()[..., 0], count.numpy()))
    (own, own_count), (expected, count) = found
    assert count.sum() > 1000
    assert (own_count != count).sum() <= 1e-4 * count.size  # at a threshold of power or probability
    both = (own_count > 0) & (count > 0)
    is_same = own["label"][both] == expected["label"][both]
    assert (~is_same).sum() <= 1e-4 * count.size
    intensity, distance = (np.abs(own[name][both] - expected[name][both])[is_same] for name in ("intensity", "range"))
    assert intensity.max() <= 1 / 256 and (intensity > 0).sum() <= 1e-3 * count.size  # halves of a step go either way
    assert np.quantile(distance, 0.999) <= 1e-4
