"""Several worlds as frames of one scene: poses, numbers, seeds and random keys are those of each world alone."""

from dataclasses import replace

import numpy as np
import pytest

from mmw.core.kinematics import differentiate
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData
from mmw.scene.views import actor_views, view_keys, view_twists
from mmw.scene.world_batch import WorldBatch
from mmw.sensors.lidar.config import Lidar
from tests.fixtures.device_rays import fast_vehicles

NUMBERS, SEEDS = (7, 300, 7), (1, 2, 3)


@pytest.fixture(scope="module")
def scenes() -> list[SceneData]:
    """Return three scenes with the same vehicles, in other places in their five frames."""
    made = [fast_vehicles(seed, vehicles=6, frames=5)[0] for seed in (4, 5, 6)]
    return [replace(made[0], poses=one.poses) for one in made]


@pytest.fixture(scope="module")
def worlds(scenes: list[SceneData]) -> WorldBatch:
    """Return frame 2 of each as one batch."""
    return WorldBatch.of(scenes[0], np.concatenate([scene.poses[1:4] for scene in scenes]), NUMBERS, SEEDS)


def test_frames_are_the_worlds_with_their_numbers_and_seeds(scenes: list[SceneData], worlds: WorldBatch) -> None:
    assert worlds.frames == range(3) and worlds.points is scenes[0].points
    assert np.array_equal(worlds.frame_poses, np.stack([scene.poses[2] for scene in scenes]))
    assert np.array_equal(worlds.poses[worlds.frame_row(1)], scenes[1].poses[2])
    assert worlds.numbers([2, 0]).tolist() == [7, 7] and worlds.seeds([2, 0], 42) == [3, 1]
    assert scenes[0].numbers([2, 0]).tolist() == [2, 0] and scenes[0].seeds([2, 0], 42) == [42, 42]
    assert worlds.frame_rows([2, 0]).tolist() == [7, 1] and worlds.frame_rows([1]).tolist() == [4]
    for rows_of in (worlds.frame_row, lambda frame: worlds.frame_rows([frame])):
        with pytest.raises(ValueError, match="world 3 is not in the batch, which has 3"):
            rows_of(3)


def test_motion_and_device_poses_are_those_of_each_scene(scenes: list[SceneData], worlds: WorldBatch) -> None:
    """Central differences look one pose back and one ahead, both of the same world."""
    actors = np.arange(len(worlds.actors), dtype=np.int32)
    sensor = Lidar()
    views = actor_views(worlds, worlds.frames, sensor, actors)
    found = view_twists(worlds, worlds.motion(), views)
    together = DeviceScene(worlds, "cpu", 3)
    together.replace_arrays(worlds, worlds.motion())
    together.load_batch(worlds.frames)
    for world, scene in enumerate(scenes):
        own = view_twists(scene, differentiate(scene.poses), actor_views(scene, [2], sensor, actors))
        rows = views.batch_index == world
        assert all(np.array_equal(one[rows], other) for one, other in zip(found, own, strict=True))
        alone = DeviceScene(scene, "cpu", 1)
        alone.load_batch([2])
        for name in ("instance_pose", "instance_velocity", "instance_rate"):
            assert np.array_equal(getattr(together.struct, name).numpy()[world], getattr(alone.struct, name).numpy()[0])


def test_random_keys_go_by_the_seed_and_number_of_each_world(scenes: list[SceneData], worlds: WorldBatch) -> None:
    actors, sensor = np.arange(2, dtype=np.int32), Lidar()
    keys = view_keys(worlds, actor_views(worlds, worlds.frames, sensor, actors), 42, "town", "sunny")
    assert len(np.unique(keys, axis=0)) == len(keys) == 6
    own = actor_views(scenes[0], [2], sensor, actors)
    alone = WorldBatch.of(scenes[0], scenes[0].poses[1:4], [2], [9])
    assert np.array_equal(
        view_keys(alone, actor_views(alone, [0], sensor, actors), 42, "town"), view_keys(scenes[0], own, 9, "town")
    )


def test_actor_that_goes_has_the_motion_of_its_own_world(scenes: list[SceneData]) -> None:
    """Its last frame is an open end, which looks four poses back: at none of another world."""
    apart = []
    for world, scene in enumerate(scenes):
        poses = np.full((6, *scene.poses.shape[1:]), np.nan)
        poses[world % 2 : 5] = scene.poses[world % 2 :]
        apart.append(poses)
    apart[1][4, 2] = np.nan
    batch = WorldBatch.of(scenes[0], np.concatenate(apart), NUMBERS, SEEDS, before=3)
    assert np.array_equal(batch.frame_poses, np.stack([poses[3] for poses in apart]))
    assert batch.frame_rows([2, 0]).tolist() == [15, 3] and batch.frame_row(1) == 9
    found, whole = batch.motion(), differentiate(batch.poses, batch.pose_dt)
    for world in range(3):
        rows = slice(world % 2, 5)
        own = differentiate(apart[world][rows], batch.pose_dt)
        for name in ("velocity", "acceleration", "body_rate", "world_rate"):
            expected = getattr(own, name)[3 - rows.start]
            assert np.isfinite(expected).all()
            for motion in (found, whole):
                assert np.array_equal(getattr(motion, name).reshape(3, 6, -1, 3)[world, 3], expected)
