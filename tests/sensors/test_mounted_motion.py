"""Samples of sensors on several agents are those of each agent alone, bit for bit."""

import dataclasses
from collections.abc import Callable

import numpy as np
import pytest

from mmw.config import MountConfig
from mmw.core.transforms import pose_from_ypr
from mmw.scene.views import Views, sample_views
from mmw.sensors import Gnss, Imu
from mmw.sensors.gnss.error_models import make_gnss
from mmw.sensors.imu.simulate import make_imu
from mmw.sensors.mounted_motion import view_grid
from tests.fixtures.driving_agents import driving
from tests.fixtures.scenes import ABSENT

FRAMES = 24
MOUNT = {"cav": MountConfig(position_m=(1.3, -0.4, 1.7), yaw_deg=20.0)}
SENSORS = {
    "carla": (make_imu, Imu(mount=MOUNT)),
    "late": (make_imu, Imu(mount=MOUNT, accel_lag_frames=1, handedness="left")),
    "physical": (make_imu, Imu(mount=MOUNT, mode="physical", accel_turn_on_std=0.1, misalignment_std_deg=0.5)),
    "gnss": (make_gnss, Gnss(mount=MOUNT)),
    "drifting gnss": (make_gnss, Gnss(mount=MOUNT, mode="physical")),
}


def curves(count: int) -> list[np.ndarray]:
    """Return winding ways with numbers of which no two sums round alike."""
    random, time = np.random.default_rng(3), np.arange(FRAMES)[:, None]
    return [
        pose_from_ypr(
            np.cumsum(random.normal(size=(FRAMES, 3)), axis=0) + 800.0, *(0.1 * time * random.normal(size=3)).T
        )
        for _ in range(count)
    ]


@pytest.mark.parametrize("kind", SENSORS)
@pytest.mark.parametrize("rows", [[0], [1], [11, 12], [FRAMES - 2], [FRAMES - 1], list(range(FRAMES))])
@pytest.mark.parametrize("is_absent", [False, True])
def test_agents_together_are_those_one_by_one(rows: list[int], kind: str, is_absent: bool) -> None:
    make: Callable = SENSORS[kind][0]
    config = SENSORS[kind][1]
    arrays = driving(*curves(3))
    if is_absent:
        arrays.poses[9:11, 1] = ABSENT
    views = sample_views(arrays, rows, config)
    together = make(arrays, views, config, 3, "s")
    for actor in range(3):
        own = views.actor == actor
        alone = make(arrays, views.take(own), config, 3, "s")
        for field in dataclasses.fields(alone):
            found, wanted = getattr(together, field.name)[own], getattr(alone, field.name)
            np.testing.assert_array_equal(found, wanted, err_msg=field.name)


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
