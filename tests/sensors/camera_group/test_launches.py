"""Launches of cameras that are kept from batch to batch are those that would be made anew."""

import dataclasses
from collections.abc import Sequence
from itertools import chain

import numpy as np
import pytest

from mmw.scene.scene_data import SceneData
from mmw.scene.views import SensorViews, Views
from mmw.sensors import DepthCamera, RgbCamera
from mmw.sensors.camera_group.launches import KeptLaunches, Launch, make_launches
from mmw.sensors.rgb.config import paper_cameras
from tests.fixtures.scenes import ABSENT, two_cars

CAMERAS = (DepthCamera(), *paper_cameras(), RgbCamera(name="small", width_px=64, height_px=48))
MOST = 4 * 640 * 480


def views_of(arrays: SceneData, frames: Sequence[int]) -> list[Views]:
    views = SensorViews(arrays, frames, CAMERAS)
    return [views.of(camera) for camera in CAMERAS]


def assert_equal(found: list[list[Launch]], parts: Sequence[Views], most: int) -> None:
    """Check views and cameras of pieces against launches that are made for these views alone."""
    of = dict(zip(map(id, CAMERAS), parts, strict=True))
    wanted = [list(launch.pieces(most)) for launch in make_launches(CAMERAS, lambda camera: of[id(camera)])]
    assert list(map(len, found)) == list(map(len, wanted))
    for own, other in zip(chain(*found), chain(*wanted), strict=True):
        assert (own.name, own.range_m, own.intrinsics) == (other.name, other.range_m, other.intrinsics)
        for field in dataclasses.fields(Views):
            np.testing.assert_array_equal(getattr(own.views, field.name), getattr(other.views, field.name))
        for camera, same in zip(own.cameras, other.cameras, strict=True):
            assert camera.sensor is same.sensor
            np.testing.assert_array_equal(camera.rows, same.rows)


def test_kept_launches_are_those_of_their_frames() -> None:
    """Whole, in pieces, and when an agent comes and goes; what follows from cameras and agents is shared."""
    arrays, kept = two_cars(6), KeptLaunches()
    arrays.poses[3, 0] = ABSENT
    for most in (100 * MOST, MOST):
        seen = {}
        for frames in ([0, 1], [1, 2], [2, 3], [4, 5]):
            parts = views_of(arrays, frames)
            found = kept.pieces(CAMERAS, parts, most)
            assert_equal(found, parts, most)
            seen[frames[0]] = [piece.kept for own in found for piece in own]
        assert all(one is other for one, other in zip(seen[0], seen[4], strict=True))
        assert not any(one is other for one in seen[0] for other in seen[2])
    first = kept.pieces(CAMERAS, views_of(arrays, [0]), MOST)[0][0]
    assert first.recall("what", lambda: [1]) is first.at(first.views.frame, first.views.pose).recall("what", list)


def test_a_depth_camera_that_sees_something_else_leaves_its_launch() -> None:
    """Views of the same agents, whose poses differ from those that the depth camera has joined."""
    arrays, kept = two_cars(3), KeptLaunches()
    parts = views_of(arrays, [0])
    assert len(kept.pieces(CAMERAS, parts, MOST)) == 2
    moved = [dataclasses.replace(parts[0], pose=parts[0].pose + 1.0), *parts[1:]]
    found = kept.pieces(CAMERAS, moved, MOST)
    assert len(found) == 3
    assert_equal(found, moved, MOST)


@pytest.mark.parametrize("frames", [[1], [1, 3]])
def test_cameras_without_views_have_launches_too(frames: list[int]) -> None:
    arrays = two_cars(4)
    arrays.poses[1, :] = ABSENT
    parts = views_of(arrays, frames)
    assert_equal(KeptLaunches().pieces(CAMERAS, parts, MOST), parts, MOST)
