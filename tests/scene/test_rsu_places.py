"""Places of roadside units that are drawn by seed: beside the road, near their own place, in nothing solid."""

import numpy as np
import pytest
import shapely

from mmw.config import load_config
from mmw.core.resources import town_path
from mmw.scene.device_scene import DeviceScene
from mmw.scene.ray_casting import cast_rays
from mmw.scene.reader import read_stage
from mmw.scene.rsu_places import VIEW_SHARE, draw_rsu_poses
from tests.fixtures import town_checks as checks

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def drawn() -> dict[int, np.ndarray]:
    """Return seed -> pose of the unit of a crossroad in Town10."""
    found = {}
    for seed in range(3):
        config = load_config("town10_crossroad", [f"seed={seed}", "vary={rsu: {radius_m: 40}}"])
        ((name, found[seed]),) = draw_rsu_poses(config, config.scenarios[0], town_path("town10"))
        assert name == "rsu_1"
    return found


def test_units_stand_beside_the_road_in_nothing_solid(drawn: dict[int, np.ndarray]) -> None:
    """As the shipped units, see `tests/worlds/towns/test_shipped_towns.py`."""
    own = np.array(load_config("town10_crossroad").scenarios[0].rsus[0].position_m)
    stage, network = checks.stage_of("town10"), checks.network_of("town10")
    for pose in drawn.values():
        foot = shapely.Point(pose[:2])
        assert np.linalg.norm(pose[:2] - own[:2]) <= 40.0
        assert 0.3 < shapely.distance(network.carriageway, foot) < 12.0
        for group in ("Buildings", "Props"):
            for component, points in checks.components(stage, group):
                near = points[(points[:, 2] > pose[2] - 1) & (points[:, 2] < pose[2] + 5)]
                if len(near) and np.hypot(*(near[:, :2] - pose[:2]).T).min() < 12.0:
                    plan = shapely.convex_hull(shapely.multipoints(near[:, :2]))
                    assert not shapely.dwithin(plan, foot, 0.2), component.GetPath()


def test_seeds_differ_and_the_same_seed_does_not(drawn: dict[int, np.ndarray]) -> None:
    assert len({tuple(np.round(pose[:3], 3)) for pose in drawn.values()}) > 1
    config = load_config("town10_crossroad", ["seed=1", "vary={rsu: {radius_m: 40}}"])
    ((_, again),) = draw_rsu_poses(config, config.scenarios[0], town_path("town10"))
    np.testing.assert_array_equal(again, drawn[1])


def test_the_antenna_sees_most_of_the_carriageway_nearby(drawn: dict[int, np.ndarray]) -> None:
    scene = DeviceScene(read_stage(town_path("town10"), range(1), ["sunny"]), "cpu", max_batch_frames=1)
    scene.load_batch([scene.arrays.frames[0]])
    network, generator = checks.network_of("town10"), np.random.default_rng(1)
    for pose in drawn.values():
        eye = pose[:3] + np.array([0, 0, 4.0])
        plan = pose[:2] + generator.uniform(-50, 50, (4000, 2))
        plan = plan[shapely.intersects_xy(network.carriageway, *plan.T)]
        offset = np.column_stack([plan, network.height(*plan.T) + 1.5]) - eye
        length = np.linalg.norm(offset, axis=1)
        hits = cast_rays(scene, np.tile(eye, (len(plan), 1)), offset / length[:, None])
        assert len(plan) > 300 and np.mean(hits.distance > length - 0.1) > VIEW_SHARE - 0.15


def test_a_unit_without_other_places_stays() -> None:
    config = load_config("town05_ring_road", ["vary={rsu: {radius_m: 5}}"])  # on the parapet
    ((_, pose),) = draw_rsu_poses(config, config.scenarios[0], town_path("town05"))
    np.testing.assert_allclose(pose[:3], config.scenarios[0].rsus[0].position_m)
