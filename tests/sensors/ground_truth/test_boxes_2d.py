"""2-D boxes: pixels against the instance image, projected boxes against rays and sampled surfaces."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from mmw.config import MountConfig
from mmw.config.lens import LensConfig
from mmw.core.camera_models import Intrinsics
from mmw.core.transforms import compose, transform_points
from mmw.scene.scene_data import SceneData
from mmw.scene.table_rows import Columns
from mmw.scene.views import make_views
from mmw.sensors import DepthCamera
from mmw.sensors.camera_group.rows import box_2d_rows
from mmw.sensors.ground_truth import boxes_2d
from mmw.sensors.ground_truth.boxes_2d import project_boxes, visible_pixels
from mmw.sensors.ground_truth.boxes_3d import make_boxes
from mmw.sensors.ground_truth.visibility import boxed_actors
from mmw.sensors.render.projection import intrinsics_of, unproject
from tests.fixtures.depth_cameras import STREET, boxes_at, camera, level, random_boxes, views_at
from tests.fixtures.scenes import ABSENT, box_mesh, two_cars
from tests.fixtures.traced_depth import traced_depth
from tests.oracles.tracing import triangle_hits

CAMERA = LensConfig().intrinsics(60, 44, 110.0)
LENSES = {
    "pinhole": CAMERA,
    "barrel": LensConfig(model="brown_conrady", k1=-0.12, k2=0.01, p1=0.004, p2=-0.003).intrinsics(60, 44, 90.0),
    "fisheye": LensConfig(model="fisheye", k1=-0.03, cx_px=28.0, cy_px=24.0).intrinsics(60, 44, 200.0),
}
EYE = Intrinsics(200, 100, 100.0, 100.0, 100.0, 50.0)
"""A camera whose images are easy to work out by hand."""


def dense_rays(camera: Intrinsics, step: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the points of the image, `step` px apart, and their rays: u, v [px], shape [N], and [N, 3]."""
    u, v = np.meshgrid(np.arange(0, camera.width + step, step), np.arange(0, camera.height + step, step))
    u, v = u.ravel(), v.ravel()
    through = unproject(camera, np.stack([u, v], axis=1))
    if camera.distortion.model != "fisheye":
        through /= through[:, :1]
    return u, v, through


def framed_by_rays(
    rays: tuple[np.ndarray, np.ndarray, np.ndarray], to_camera: np.ndarray, size: np.ndarray
) -> np.ndarray | None:
    """Return the rectangle of those points of `dense_rays` whose ray hits the box 1 cm deep or more."""
    u, v, through = rays
    points, faces = box_mesh(size)
    ray, _, depth = triangle_hits(np.zeros(through.shape), through, transform_points(to_camera, points)[faces])
    is_hit = np.zeros(u.size, dtype=bool)
    is_hit[ray[depth >= 0.01]] = True
    return np.array([u[is_hit].min(), v[is_hit].min(), u[is_hit].max(), v[is_hit].max()]) if is_hit.any() else None


@pytest.mark.parametrize(("lens", "seed"), [("pinhole", 0), ("pinhole", 1), ("barrel", 3), ("fisheye", 3)])
def test_framed_boxes_equal_dense_rays(lens: str, seed: int) -> None:
    """The image of a box, of any pose, around and behind the camera: a rectangle no ray leaves, tight to one step."""
    camera, boxes, step, kinds = LENSES[lens], random_boxes(60, seed), 0.5, []
    found = project_boxes(camera, views_at(), boxes)
    bent, rays = lens != "pinhole", dense_rays(camera, step)
    for row in range(60):
        expected = framed_by_rays(rays, boxes.pose[row], boxes.size[row])
        place = np.flatnonzero(found.box == row)
        if expected is None:  # nothing, or a corner that fell between the rays
            assert all(np.diff(found.amodal[place].reshape(-1, 2, 2), axis=1).min(axis=2) < step), row
            kinds.append("nothing")
            continue
        assert len(place) == 1, row
        corner_depth = transform_points(boxes.pose[row], box_mesh(boxes.size[row])[0])[:, 0]
        kinds.append("before" if corner_depth.min() > 0.01 else "across")
        amodal = found.amodal[place[0]]
        outward = (expected - amodal) * [-1, -1, 1, 1]  # how far a ray reaches beyond the rectangle
        assert outward.max() <= (0.02 if bent else 1e-9), (row, amodal, expected)
        # An acute corner may stick out between rays: tight to a step on most sides, to a few on all.
        most = (1.5 if bent else 1.0) * step
        assert np.median(-outward) <= most and outward.min() > -6 * step, (row, amodal, expected)
    assert len(kinds) - kinds.count("nothing") > 20 and set(kinds) >= {"before", "across"}
    assert bent or "nothing" in kinds


def test_boxes_before_the_camera_equal_their_sampled_surface() -> None:
    boxes = random_boxes(80, 7)
    found = project_boxes(CAMERA, views_at(), boxes)
    grid = np.linspace(-0.5, 0.5, 101)
    a, b = (k.ravel() for k in np.meshgrid(grid, grid))
    sides = [np.insert(np.stack([a, b], axis=1), axis, side, axis=1) for axis in range(3) for side in (-0.5, 0.5)]
    surface = np.concatenate(sides)
    tried = 0
    for row, amodal, truncation in zip(found.box, found.amodal, found.truncation, strict=True):
        points = transform_points(boxes.pose[row], surface * boxes.size[row])
        if points[:, 0].min() < 0.5:
            continue
        u = 30.0 - CAMERA.fx * points[:, 1] / points[:, 0]
        v = 22.0 - CAMERA.fx * points[:, 2] / points[:, 0]
        inside = (u >= 0) & (u <= 60) & (v >= 0) & (v <= 44)
        if not inside.any():
            continue
        tried += 1
        seen = np.array([u[inside].min(), v[inside].min(), u[inside].max(), v[inside].max()])
        spacing = CAMERA.fx * 0.01 * boxes.size[row].max() * 2.0 / points[:, 0].min()
        outward = (seen - amodal) * [-1, -1, 1, 1]
        assert outward.max() <= 1e-9 and outward.min() > -spacing, (row, seen, amodal)
        # The eight corners are among the points, so the whole rectangle is exact.
        whole = (u.max() - u.min()) * (v.max() - v.min())
        share = (amodal[2] - amodal[0]) * (amodal[3] - amodal[1]) / whole
        assert truncation == pytest.approx(1.0 - share, abs=1e-9)
        if inside.all():
            np.testing.assert_allclose(amodal, seen, atol=1e-9)
            assert truncation == pytest.approx(0.0, abs=1e-12)
    assert tried > 15


def test_known_boxes() -> None:
    """fx = 100 px, W = 200, H = 100: the numbers are by hand."""
    pose = [
        level(10.5, 0.0, 0.0),  # front at 10 m, 2 m wide and high: 10 px to each side of the middle
        level(10.5, 10.0, 0.0),  # its left half is outside: front from u = -10 to 10
        level(10.5, -30.0, 0.0),  # right of the image
        level(-10.0, 0.0, 0.0),  # behind
        level(0.0, 0.0, 0.0),  # around the camera
        level(1.0, 0.0, -20.0),  # below the image
    ]
    boxes = boxes_at(np.array(pose), np.array([[1.0, 2.0, 2.0]] * 6))
    found = project_boxes(EYE, views_at(), boxes)
    assert found.box.tolist() == [0, 1, 4]
    np.testing.assert_allclose(found.amodal[0], [90, 40, 110, 60])
    # Back right corner at 11 m: u = 100 - 100 * 9 / 11.
    np.testing.assert_allclose(found.amodal[1], [0, 40, 100 - 900 / 11, 60])
    np.testing.assert_allclose(found.amodal[2], [0, 0, 200, 100])
    back = 100 - 900 / 11
    np.testing.assert_allclose(found.truncation[:2], [0.0, 1.0 - back / (back + 10.0)], atol=1e-12)
    assert 0.99 < found.truncation[2] < 1.0
    np.testing.assert_allclose(found.distance, [10.5, np.hypot(10.5, 10.0), 0.0])


def test_box_partly_behind_the_camera() -> None:
    """A lorry that stands beside the camera, 2 m to its left, from 6 m behind to 4 m ahead, eyes at half its height."""
    found = project_boxes(EYE, views_at(), boxes_at(np.array([level(-1.0, 3.0, 0.0)]), np.array([[10, 2, 3.0]])))
    # Its near side, y = 2, ends 4 m ahead at u = 50, half a meter of image high: v = 50 -+ 37.5; at the left edge,
    # 2 m ahead, it is 75 px high to each side, more than the image.
    np.testing.assert_allclose(found.amodal, [[0, 0, 50, 100]])
    assert found.truncation[0] > 0.99
    low = project_boxes(EYE, views_at(), boxes_at(np.array([level(-1.0, 3.0, -1.0)]), np.array([[10, 2, 1.0]])))
    # Half a meter to 1.5 m below the eyes: its top edge rises from v = 75 at the left edge to 62.5.
    np.testing.assert_allclose(low.amodal, [[0, 62.5, 50, 100]])


def test_side_of_a_box_through_the_camera() -> None:
    """A box on the right, whose side lies 1 mm left of the eye: the near plane, 1 cm ahead, cuts it at u = 100 - 10."""
    found = project_boxes(EYE, views_at(), boxes_at(np.array([level(0, -0.999, 0)]), np.array([[2, 2, 2.0]])))
    np.testing.assert_allclose(found.amodal, [[90, 0, 200, 100]])


def test_pose_of_the_camera_counts() -> None:
    """Camera and box moved and turned together give the same image."""
    boxes = random_boxes(40, 3)
    rng = np.random.default_rng(4)
    turn = rng.normal(size=4)
    moved = np.concatenate([[120.0, -340.0, 25.0], turn / np.linalg.norm(turn)])
    here = project_boxes(CAMERA, views_at(), boxes)
    there = project_boxes(CAMERA, views_at(moved), replace(boxes, pose=compose(moved, boxes.pose)))
    np.testing.assert_array_equal(there.box, here.box)
    np.testing.assert_allclose(there.amodal, here.amodal, atol=1e-6)
    np.testing.assert_allclose(there.distance, here.distance, atol=1e-9)


def numpy_boxes(object_id: np.ndarray, wanted: list[int]) -> tuple[np.ndarray, dict]:
    """Return pixel counts [A, K] and (view, place) -> rectangle, by plain NumPy."""
    counts, bounds = np.zeros((len(object_id), len(wanted)), dtype=int), {}
    for view, image in enumerate(object_id):
        for place, one in enumerate(wanted):
            v, u = np.nonzero(image == one)
            counts[view, place] = len(u)
            if len(u):
                bounds[view, place] = [u.min(), v.min(), u.max() + 1, v.max() + 1]
    return counts, bounds


@pytest.mark.parametrize("size", [(60, 44), (8, 8), (33, 17), (17, 50)])
def test_visible_boxes_equal_numpy(device: str, size: tuple[int, int]) -> None:
    rng = np.random.default_rng(2)
    # Blobs of nine objects and nothing; not all are wanted, one that is wanted is not there.
    coarse = rng.integers(-1, 9, (3, size[1] // 4 + 1, size[0] // 4 + 1))
    object_id = np.kron(coarse, np.ones((1, 4, 4), dtype=int))[:, : size[1], : size[0]].astype(np.int32)
    wanted = [6, 0, 40, 3]
    found = visible_pixels(wp.array(object_id, dtype=int, device=device), wanted)
    counts, bounds = numpy_boxes(object_id, wanted)
    np.testing.assert_array_equal(found.pixels, counts)
    assert found.pixels.dtype == np.int32 and found.bounds.dtype == np.int32
    for (view, place), expected in bounds.items():
        assert found.bounds[view, place].tolist() == expected
    assert counts[:, 2].sum() == 0 and counts.sum() > 0


def test_no_views_and_nothing_wanted(device: str) -> None:
    image = wp.zeros((2, 8, 8), dtype=int, device=device)
    assert visible_pixels(image, []).pixels.shape == (2, 0)
    nothing = visible_pixels(wp.zeros((0, 8, 8), dtype=int, device=device), [3, 4])
    assert (nothing.pixels.shape, nothing.bounds.shape) == ((0, 2), (0, 2, 4))
    found = project_boxes(CAMERA, views_at(), boxes_at(np.zeros((0, 7)), np.zeros((0, 3))))
    assert found.amodal.shape == (0, 4) and len(found.distance) == 0


def rows_of(
    arrays: SceneData, device: str, config: DepthCamera, frames: list[int]
) -> tuple[Columns, np.ndarray, list[int]]:
    """Return the rows of a camera, its instance images, and the objects that have boxes."""
    object_id = traced_depth(arrays, device, config, frames).object_id
    wanted = [arrays.actors[i].object_id for i in boxed_actors(arrays.actors)]
    visible = visible_pixels(wp.array(object_id, dtype=int, device=device), wanted)
    views, boxes = make_views(arrays, frames, config), make_boxes(arrays, frames)
    return box_2d_rows(arrays, config.name, views, intrinsics_of(config), boxes, visible), object_id, wanted


def test_rows_of_a_street(device: str) -> None:
    """Visible and amodal boxes of cars between houses, as the table gets them."""
    arrays = two_cars(30)
    arrays.poses[5, 1] = ABSENT
    frames = [3, 5, 12]
    config = camera(on=("cav", "rsu"), mount=STREET, width_px=120, height_px=90)
    rows, object_id, wanted = rows_of(arrays, device, config, frames)
    views = make_views(arrays, frames, config)
    counts, bounds = numpy_boxes(object_id, wanted)
    view_of = {
        (int(f), arrays.actors[a].name): i for i, (f, a) in enumerate(zip(views.frame, views.actor, strict=True))
    }
    listed, agents = np.zeros_like(counts), rows["agent"].to_list()
    for row in range(len(rows["frame"])):
        view = view_of[int(rows["frame"][row]), agents[row]]
        place = wanted.index(int(rows["object_id"][row]))
        listed[view, place] += 1
        edges = [rows[name][row].as_py() for name in ("u_min", "v_min", "u_max", "v_max")]
        assert rows["pixels"][row] == counts[view, place]
        if counts[view, place] == 0:
            assert edges == [None] * 4
            continue
        assert edges == bounds[view, place]
        amodal = [rows[f"amodal_{name}"][row] for name in ("u_min", "v_min", "u_max", "v_max")]
        # Bodies are boxes here, so pixels lie in the amodal rectangle; a pixel shows what is at its center.
        assert amodal[0] <= edges[0] + 0.5 and amodal[1] <= edges[1] + 0.5
        assert amodal[2] >= edges[2] - 0.5 and amodal[3] >= edges[3] - 0.5
        # Nothing stands before the cars of this street: the visible box is the amodal one, to a pixel.
        np.testing.assert_allclose(edges, amodal, atol=1.0)
    assert listed.max() == 1 and np.all(listed[counts > 0] == 1)
    assert not any(f == 5 and o == wanted[1] for f, o in zip(rows["frame"], rows["object_id"], strict=True))


def test_hidden_box_has_no_visible_edges(device: str) -> None:
    """A camera behind a van: the car before it has a row, but no pixel."""
    arrays = replace(two_cars(1), poses=np.array([[level(30, 0, 0), level(10, 0, 0), level(0, 0, 1)]], dtype=float))
    rows, _, wanted = rows_of(arrays, device, camera(mount={"rsu": MountConfig()}), [0])
    assert rows["object_id"].tolist() == wanted and rows["pixels"][0] == 0 < rows["pixels"][1]
    assert rows["u_min"].null_count == 1 and rows["u_min"][0].as_py() is None
    np.testing.assert_allclose(rows["distance"], [30.0, 10.3], atol=0.3)


def test_boxes_beside_the_image_are_left_out_early_and_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    random = np.random.default_rng(5)
    count = 4000
    pose = np.concatenate([random.normal(0, 30, (count, 3)), random.normal(0, 1, (count, 4))], axis=1)
    pose[:, 3:] /= np.linalg.norm(pose[:, 3:], axis=1, keepdims=True)
    boxes = boxes_at(pose, random.uniform(0.5, 20, (count, 3)))
    camera = replace(CAMERA, cx=20.0, cy=30.0)
    early, kept = project_boxes(camera, views_at(), boxes), []

    def all_of_them(camera: Intrinsics, middle: np.ndarray, radius: np.ndarray) -> np.ndarray:
        kept.append(may_be_framed(camera, middle, radius).sum())
        return np.ones(len(middle), dtype=bool)

    may_be_framed = boxes_2d._may_be_framed
    monkeypatch.setattr(boxes_2d, "_may_be_framed", all_of_them)
    late = project_boxes(camera, views_at(), boxes)
    for name in ("view", "box", "amodal", "truncation", "distance"):
        np.testing.assert_array_equal(getattr(early, name), getattr(late, name))
    assert 500 < len(early.box) <= kept[0] < count // 2


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
