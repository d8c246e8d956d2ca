"""Lines and areas in a camera's picture: pixels computed by hand, and what surfaces hide."""

import numpy as np
import pytest

from mmw.core.camera_models import Distortion, Intrinsics
from mmw.core.transforms import pose_from_ypr
from mmw.viz.scene_view.overlay import PIECE_PX, PictureView, triangles_in_pixels

PINHOLE = Intrinsics(200, 100, 100.0, 100.0, 100.0, 50.0)
"""Field of view of 90 deg across; a point at (x, y, z) of the camera is at (100 - 100 y / x, 50 - 100 z / x)."""

LEVEL = pose_from_ypr((0.0, 0.0, 0.0), 0.0, 0.0)


def view(distance: np.ndarray | float | None = None, pose: np.ndarray = LEVEL, camera: Intrinsics = PINHOLE):
    if distance is not None:
        distance = np.broadcast_to(np.asarray(distance, dtype=np.float32), (camera.height, camera.width))
    return PictureView(camera, pose, distance)


def joined(runs, line: int = 0) -> np.ndarray:
    return np.concatenate([run.pixels for run in runs if run.line == line])


def test_points_are_at_the_pixels_of_a_pinhole() -> None:
    np.testing.assert_allclose(view().pixels(np.array([[10.0, 1.0, 2.0], [4.0, -2.0, -1.0]])), [(90, 30), (150, 75)])
    # The camera stands at (5, 5, 1) and looks north: north is ahead, east is right.
    north = view(pose=pose_from_ypr((5.0, 5.0, 1.0), np.pi / 2, 0.0))
    np.testing.assert_allclose(north.pixels(np.array([[7.0, 15.0, 2.0]])), [(120, 40)], atol=1e-9)
    assert np.isnan(view().pixels(np.array([-1.0, 0.0, 0.0]))).all()  # behind


def test_a_line_is_one_run_from_end_to_end() -> None:
    (run,) = view().runs([np.array([[10.0, 5.0, 0.0], [10.0, -5.0, 2.0]])])
    np.testing.assert_allclose(run.pixels[[0, -1]], [(50, 50), (150, 30)])
    steps = np.diff(run.pixels, axis=0)
    assert (np.linalg.norm(steps, axis=1) <= PIECE_PX).all() and (steps[:, 0] > 0.0).all()
    np.testing.assert_allclose(run.pixels[:, 1], 50.0 - 0.2 * (run.pixels[:, 0] - 50.0), atol=1e-9)
    assert not run.is_hidden


def test_a_line_from_behind_the_camera_enters_at_the_border() -> None:
    line = np.array([[-50.0, 4.0, 0.0], [50.0, 4.0, 0.0]])  # ahead at 4 m to the left: at the border where x = 4
    (run,) = view().runs([line])
    assert -PIECE_PX <= run.pixels[0, 0] <= PIECE_PX
    np.testing.assert_allclose(run.pixels[-1], (92, 50))
    assert view().runs([line * (-1.0, 1.0, 1.0) + (-60.0, 0.0, 0.0)]) == []  # all of it behind
    assert view().runs([np.array([[10.0, 50.0, 0.0], [20.0, 90.0, 0.0]])]) == []  # beside the picture


def test_segments_of_a_line_go_on_and_lines_do_not() -> None:
    bent = np.array([[10.0, 5.0, 0.0], [10.0, 0.0, 3.0], [10.0, -5.0, 0.0]])
    runs = view().runs([bent, bent - np.array([0.0, 0.0, 2.0])])
    assert [run.line for run in runs] == [0, 1]
    assert np.abs(runs[0].pixels - (100, 20)).sum(axis=1).min() < 1e-9  # its middle is a point of the run


def test_what_is_behind_a_wall_is_hidden() -> None:
    """A wall 10 m ahead covers the left half of the picture; a line goes away from the camera through both halves."""
    distance = np.full((100, 200), np.inf, dtype=np.float32)
    distance[:, :100] = 10.0
    to_the_left = np.array([[4.0, 1.0, 0.0], [40.0, 1.0, 0.0]])  # passes x = 10 at pixel 90
    runs = view(distance).runs([to_the_left, to_the_left * (1.0, -1.0, 1.0)])
    assert [(run.line, run.is_hidden) for run in runs] == [(0, False), (0, True), (1, False)]
    seen, hidden = runs[0].pixels, runs[1].pixels
    assert seen[0] == pytest.approx((75, 50)) and hidden[-1] == pytest.approx((97.5, 50))
    assert seen[-1] == pytest.approx(hidden[0])  # dashes begin where the line ends
    assert 90.0 - PIECE_PX <= seen[-1, 0] <= 90.0 + PIECE_PX
    assert view(None).runs([to_the_left])[0].is_hidden is False


def test_a_point_on_a_surface_is_visible_also_at_a_grazing_angle() -> None:
    """Level ground 1.5 m below the camera; its depth changes by meters from a pixel to the next near the horizon."""
    rows = np.arange(100) + 0.5
    down = np.maximum(rows - 50.0, 1e-9) / 100.0
    columns = (np.arange(200) + 0.5 - 100.0) / 100.0
    length = np.sqrt(1.0 + down[:, None] ** 2 + columns**2)
    distance = np.where(rows[:, None] > 50.0, 1.5 / down[:, None] * length, np.inf)
    points = np.array([[x, 0.3 * x, -1.5] for x in (4.0, 9.0, 23.0, 61.0, 140.0)])
    assert not view(distance).is_hidden(points).any()
    under = points[1:3] - np.array([0.0, 0.0, 1.0])  # a meter under the ground
    assert view(distance).is_hidden(under).all()


def test_a_fisheye_bends_a_straight_line() -> None:
    camera = Intrinsics(200, 200, 100.0, 100.0, 100.0, 100.0, Distortion("fisheye"))  # r = 100 px a radian
    (run,) = view(camera=camera).runs([np.array([[5.0, 5.0, 3.0], [5.0, -5.0, 3.0]])])
    angle = np.arctan2(np.hypot(5.0, 3.0), 5.0)
    expected = 100.0 + 100.0 * angle * np.array([-5.0, -3.0]) / np.hypot(5.0, 3.0)
    np.testing.assert_allclose(run.pixels[0], expected, atol=1e-9)
    middle = run.pixels[np.argmin(np.abs(run.pixels[:, 0] - 100.0))]
    assert middle == pytest.approx((100.0, 100.0 - 100.0 * np.arctan2(3.0, 5.0)), abs=1.5)
    assert middle[1] < run.pixels[0, 1] - 2.0  # higher than the straight line between the ends


def test_pixels_show_the_triangle_that_their_ray_hits(device: str) -> None:
    """A level square 2 m below the camera, in two triangles: intersections of the rays computed by hand."""
    square = np.array([[4.0, -3.0, -2.0], [10.0, -3.0, -2.0], [10.0, 3.0, -2.0], [4.0, 3.0, -2.0]])
    found = triangles_in_pixels(view(), square[[[0, 1, 2], [0, 2, 3]]], device)
    v, u = np.indices(found.shape)
    x = 2.0 / np.maximum((v + 0.5 - 50.0) / 100.0, 1e-9)
    y = -(u + 0.5 - 100.0) / 100.0 * x
    inside = (v >= 50) & (x > 4.0) & (x < 10.0) & (np.abs(y) < 3.0)
    expected = np.where(inside, np.where(y + 3.0 > x - 4.0, 1, 0), -1)  # beside the diagonal from corner 0 to 2
    edge = (np.abs(y + 3.0 - (x - 4.0)) < 1e-3) | (np.abs(np.abs(y) - 3.0) < 1e-3)
    assert inside.sum() > 1000 and (found == expected)[~edge].all()
    near = triangles_in_pixels(view(5.0), square[[[0, 1, 2], [0, 2, 3]]], device)  # something 5 m away all around
    length = np.sqrt(x**2 + y**2 + 4.0)
    assert (near[inside & (length > 5.1)] == -1).all() and (near[inside & (length < 4.99) & ~edge] >= 0).all()
    assert (triangles_in_pixels(view(), np.zeros((0, 3, 3)), device) == -1).all()
