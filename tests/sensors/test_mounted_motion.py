"""Motion of sensors on several agents is that of each agent alone, bit for bit."""

import dataclasses

import numpy as np
import pytest

from mmw.config import MountConfig
from mmw.core.transforms import pose_from_ypr
from mmw.scene.views import Views
from mmw.sensors import Imu
from mmw.sensors.mounted_motion import mounted_motion, view_grid
from tests.fixtures.driving_agents import driving
from tests.fixtures.scenes import ABSENT

FRAMES = 24
CONFIG = Imu(mount={"cav": MountConfig(position_m=(1.3, -0.4, 1.7), yaw_deg=20.0)})


def curves(count: int) -> list[np.ndarray]:
    """Return winding ways with numbers of which no two sums round alike."""
    random, time = np.random.default_rng(3), np.arange(FRAMES)[:, None]
    return [
        pose_from_ypr(
            np.cumsum(random.normal(size=(FRAMES, 3)), axis=0) + 800.0, *(0.1 * time * random.normal(size=3)).T
        )
        for _ in range(count)
    ]


@pytest.mark.parametrize("lag", [0, 1])
@pytest.mark.parametrize("rows", [[0], [1], [11, 12], [FRAMES - 2], [FRAMES - 1], list(range(FRAMES))])
@pytest.mark.parametrize("is_absent", [False, True])
def test_agents_together_are_those_one_by_one(rows: list[int], lag: int, is_absent: bool) -> None:
    arrays = driving(*curves(3))
    if is_absent:
        arrays.poses[9:11, 1] = ABSENT
    at, actors = np.array(rows), np.arange(3, dtype=np.int32)
    together = mounted_motion(arrays, CONFIG, actors, at, lag)
    for k in range(3):
        alone = mounted_motion(arrays, CONFIG, actors[k : k + 1], at, lag)
        np.testing.assert_array_equal(together.pose[:, k], alone.pose[:, 0])
        for field in dataclasses.fields(together.motion):
            found, wanted = (getattr(part.motion, field.name) for part in (together, alone))
            np.testing.assert_array_equal(found[together.at, k], wanted[alone.at, 0], err_msg=field.name)


@pytest.mark.parametrize(("frame", "actor"), [([4, 4], [0, 2]), ([4, 4, 7], [0, 2, 2]), ([4, 4], [2, 0]), ([], [])])
def test_grid_of_views_has_the_place_of_each(frame: list[int], actor: list[int]) -> None:
    count = len(frame)
    none = np.full(count, -1, np.int32)
    views = Views(np.array(frame, np.int64), none, np.array(actor, np.int32), np.zeros((count, 7)), none)
    grid = view_grid(views)
    of_actor, at_frame = grid.place
    np.testing.assert_array_equal(grid.frames[at_frame], views.frame)
    np.testing.assert_array_equal(grid.actors[of_actor], views.actor)
    assert grid.frames.tolist() == sorted(set(frame)) and grid.actors.tolist() == sorted(set(actor))
