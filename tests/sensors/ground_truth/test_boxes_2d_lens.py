"""2-D boxes behind lenses that bend lines, against dense rays."""

import numpy as np
import pytest

from mmw.config.lens import LensConfig
from mmw.core.camera_models import Intrinsics
from mmw.core.transforms import transform_points
from mmw.sensors.ground_truth.boxes_2d import project_boxes
from mmw.sensors.render.projection import unproject
from tests.fixtures.scenes import box_mesh
from tests.oracles.tracing import triangle_hits
from tests.sensors.ground_truth.test_boxes_2d import boxes_at, level, random_boxes, views_at

LENSES = {
    "barrel": LensConfig(model="brown_conrady", k1=-0.12, k2=0.01, p1=0.004, p2=-0.003).intrinsics(60, 44, 90.0),
    "fisheye": LensConfig(model="fisheye", k1=-0.03, cx_px=28.0, cy_px=24.0).intrinsics(60, 44, 200.0),
}


def rays(camera: Intrinsics, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return points of the image, `step` px apart, and their directions, of depth 1 but for a fisheye."""
    u, v = np.meshgrid(np.arange(0, camera.width + step, step), np.arange(0, camera.height + step, step))
    direction = unproject(camera, np.stack([u.ravel(), v.ravel()], axis=1))
    if camera.distortion.model != "fisheye":
        direction /= direction[:, :1]
    return u.ravel(), v.ravel(), direction


def framed_by_rays(
    image: tuple[np.ndarray, np.ndarray, np.ndarray], pose: np.ndarray, size: np.ndarray
) -> np.ndarray | None:
    """Return the rectangle of those points of the image whose ray meets the box."""
    u, v, direction = image
    points, faces = box_mesh(size)
    ray, _, depth = triangle_hits(np.zeros(direction.shape), direction, transform_points(pose, points)[faces])
    meets = np.zeros(u.size, dtype=bool)
    meets[ray[depth >= 0.01]] = True
    return np.array([u[meets].min(), v[meets].min(), u[meets].max(), v[meets].max()]) if meets.any() else None


@pytest.mark.parametrize("lens", LENSES)
def test_framed_boxes_equal_dense_rays(lens: str) -> None:
    camera, boxes, step, compared = LENSES[lens], random_boxes(60, 3), 0.5, 0
    found, image = project_boxes(camera, views_at(), boxes), rays(camera, step)
    for row in range(60):
        expected = framed_by_rays(image, boxes.pose[row], boxes.size[row])
        place = np.flatnonzero(found.box == row)
        if expected is None:
            assert all(np.diff(found.amodal[place].reshape(-1, 2, 2), axis=1).min(axis=2) < step), row
            continue
        assert len(place) == 1, row
        outward = (expected - found.amodal[place[0]]) * [-1, -1, 1, 1]
        assert outward.max() <= 0.02, (row, found.amodal[place[0]], expected)
        assert np.median(-outward) <= 1.5 * step and outward.min() > -6 * step, (row, found.amodal[place[0]], expected)
        compared += 1
    assert compared > 20


def test_a_fisheye_frames_what_is_behind_its_plane() -> None:
    """A post 1 m behind and 4 m to the left of a lens of 200 deg: 104 deg from the axis, outside a pinhole's world."""
    camera = LensConfig(model="fisheye").intrinsics(400, 400, 220.0)
    boxes = boxes_at(np.array([level(-1.0, 4.0, 0.0)]), np.array([[0.2, 0.2, 0.2]]))
    found = project_boxes(camera, views_at(), boxes)
    angle = np.arctan2(4.0, -1.0)
    middle = 200.0 - camera.fx * angle
    assert found.amodal[0, 0] < middle < found.amodal[0, 2] and found.amodal[0, 2] - found.amodal[0, 0] < 12.0
    assert found.truncation[0] == pytest.approx(0.0, abs=1e-9)
    behind = boxes_at(np.array([level(-6.0, 0.0, 0.0)]), np.array([[1.0, 1.0, 1.0]]))
    assert len(project_boxes(camera, views_at(), behind).box) == 0
