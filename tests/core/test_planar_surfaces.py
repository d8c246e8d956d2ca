"""Surfaces: plane pieces, whatever the triangulation."""

from itertools import product

import numpy as np
import pytest

from mmw.core.planar_surfaces import ANGLE_RAD, PLANE_M, find_surfaces, linked_rows
from tests.fixtures.scenes import box_mesh, quad_part


def surfaces(points: np.ndarray, faces: np.ndarray, object_id=0, material=0) -> np.ndarray:
    shape = len(faces)
    return find_surfaces(points, faces, np.broadcast_to(object_id, shape), np.broadcast_to(material, shape))


def apart(points: np.ndarray, faces: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the same triangles, none of which shares a vertex index with another."""
    return points[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3)


def test_box_has_six_in_order_of_their_first_faces() -> None:
    points, faces = box_mesh((4, 2, 1), (100, -50, 3))
    np.testing.assert_array_equal(surfaces(points, faces), np.repeat(np.arange(6), 2))
    rolled = surfaces(points, np.roll(faces, 1, axis=0))
    np.testing.assert_array_equal(rolled, [0, 1, 1, 2, 2, 3, 3, 4, 4, 5, 5, 0])


def test_cut_up_plane_is_one() -> None:
    part = quad_part("a/b", [(-90, -80, 3), (70, -60, 20), (80, 90, 25), (-80, 70, 8)], cells=30)
    a, b, c = part.points[[0, 30, 930]]
    normal = np.cross(b - a, c - a)
    flat = part.points.copy()
    flat[:, 2] = a[2] - ((flat[:, :2] - a[:2]) @ normal[:2]) / normal[2]
    assert surfaces(flat, part.faces).max() == 0
    assert surfaces(*apart(flat, part.faces)).max() == 0, "vertices are merged by position"
    assert surfaces(*apart(flat.astype(np.float32), part.faces)).max() == 0, "float32 vertices are good enough"


def test_vertices_a_hair_apart_are_one() -> None:
    rng = np.random.default_rng(0)
    part = quad_part("a/b", [(0, 0, 0), (9, 0, 0), (9, 9, 0), (0, 9, 0)], cells=9)
    points, faces = apart(part.points, part.faces)
    assert surfaces(points + rng.uniform(-2e-5, 2e-5, points.shape) * [1, 1, 0], faces).max() == 0


def test_objects_and_materials_divide() -> None:
    part = quad_part("a/b", [(0, 0, 0), (9, 0, 0), (9, 9, 0), (0, 9, 0)], cells=2)
    half = np.repeat([0, 1], 4)
    assert surfaces(part.points, part.faces, object_id=half).max() == 1
    assert surfaces(part.points, part.faces, material=half).max() == 1
    np.testing.assert_array_equal(surfaces(part.points, part.faces, material=half), half)


def test_touching_at_a_corner_is_not_connected() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [-1, 0, 0], [0, -1, 0]], dtype=float)
    np.testing.assert_array_equal(surfaces(points, np.array([[0, 1, 2], [0, 3, 4]])), [0, 1])


def test_same_plane_elsewhere_is_another() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], dtype=float)
    both = np.concatenate([points, points + np.array([5, 0, 0])])
    np.testing.assert_array_equal(surfaces(both, np.arange(6).reshape(2, 3)), [0, 1])


@pytest.mark.parametrize(("angle", "count"), [(0.3 * ANGLE_RAD, 1), (3.0 * ANGLE_RAD, 2)])
def test_fold_divides_beyond_the_tolerance(angle: float, count: int) -> None:
    points = np.array([[0, 0, 0], [0, 4, 0], [-3, 0, 0], [3 * np.cos(angle), 0, 3 * np.sin(angle)]])
    assert surfaces(points, np.array([[0, 1, 2], [1, 0, 3]])).max() + 1 == count


def test_long_faces_divide_by_distance() -> None:
    angle, reach = 0.5 * ANGLE_RAD, 3.0 * PLANE_M / ANGLE_RAD  # the far corner is 1.5 tolerances off the plane
    points = np.array([[0, 0, 0], [0, 4, 0], [-3, 0, 0], [reach, 0, reach * np.sin(angle)]])
    assert surfaces(points, np.array([[0, 1, 2], [1, 0, 3]])).max() == 1


def test_winding_does_not_matter() -> None:
    part = quad_part("a/b", [(0, 0, 0), (9, 0, 0), (9, 9, 0), (0, 9, 0)], cells=4)
    faces = part.faces.copy()
    faces[::3] = faces[::3, ::-1]
    assert surfaces(part.points, faces).max() == 0


def test_slow_curve_is_cut_into_flat_pieces() -> None:
    """Each bend is below the tolerance, but they add up: a road over a hill is not one mirror."""
    x = np.linspace(0.0, 600.0, 1201)
    line = np.stack([x, 0 * x, x**2 / 40_000.0], axis=1)
    points = np.concatenate([line, line + np.array([0, 4, 0])])
    k = np.arange(1200)
    faces = np.concatenate([np.stack([k, k + 1, k + 1202], axis=1), np.stack([k, k + 1202, k + 1201], axis=1)])
    found = surfaces(points, faces)
    assert 5 < found.max() + 1 < 120
    for surface in range(found.max() + 1):
        corner = points[faces[found == surface]].reshape(-1, 3)
        away = corner - corner.mean(axis=0)
        # Both the plane of the mean and the plane of the middle face are allowed, so twice the tolerance is the bound.
        assert np.abs(away @ np.linalg.svd(away, full_matrices=False)[2][2]).max() < 2.0 * PLANE_M


def test_degenerate_faces_stand_alone() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [2, 0, 0]], dtype=float)
    np.testing.assert_array_equal(surfaces(points, np.array([[0, 1, 2], [0, 1, 3], [1, 1, 2]])), [0, 1, 2])


def test_no_faces() -> None:
    assert surfaces(np.zeros((0, 3)), np.zeros((0, 3), int)).shape == (0,)


def test_order_of_the_faces_does_not_matter() -> None:
    rng = np.random.default_rng(4)
    boxes = [box_mesh(rng.uniform(1, 5, 3), rng.uniform(-50, 50, 3)) for _ in range(20)]
    points = np.concatenate([p for p, _ in boxes])
    faces = np.concatenate([f + 8 * k for k, (_, f) in enumerate(boxes)])
    owner = np.repeat(np.arange(20), 12)
    plain = surfaces(points, faces, object_id=owner)
    order = rng.permutation(len(faces))
    mixed = surfaces(points, faces[order], object_id=owner[order])
    assert plain.max() == mixed.max() == 119
    np.testing.assert_array_equal(plain[order][:, None] == plain[order], mixed[:, None] == mixed)


def test_linked_rows_are_those_of_a_plain_search() -> None:
    rng = np.random.default_rng(3)
    values = rng.uniform(-6.0, 6.0, (400, 3))
    values[:50] = values[50:100]  # some are equal
    kind = rng.integers(0, 2, 400)
    expected = np.arange(400)
    grids = [np.column_stack([np.floor(values + shift), kind]) for shift in product((0.19, 0.69), repeat=3)]
    near = np.any([(grid[:, None] == grid[None]).all(axis=2) for grid in grids], axis=0)
    for _ in range(20):
        expected = np.where(near, expected[None], 400).min(axis=1)
    assert 10 < len(np.unique(expected)) < 350
    np.testing.assert_array_equal(linked_rows(values, kind), expected)
    close = (np.abs(values[:, None] - values[None]) < 0.5).all(axis=2) & (kind[:, None] == kind[None])
    first, second = np.nonzero(close)
    np.testing.assert_array_equal(expected[first], expected[second])
    assert len(linked_rows(np.zeros((0, 3)))) == 0
