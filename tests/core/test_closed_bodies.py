"""Bodies that are inside out are turned, cavities and open sheets are not."""

import numpy as np
import pytest

from mmw.core.closed_bodies import turn_outward
from tests.fixtures.scenes import box_mesh


def boxes(*cubes: tuple[float, float, bool]) -> tuple[np.ndarray, np.ndarray]:
    """Return cubes of an edge length around a place on x, inside out if said so."""
    points, faces = [], []
    for k, (size, x, is_turned) in enumerate(cubes):
        own, triangles = box_mesh((size, size, size))
        points.append(own + np.array([x, 0.0, 0.0]))
        faces.append((triangles[:, ::-1] if is_turned else triangles) + 8 * k)
    return np.concatenate(points), np.concatenate(faces)


def volumes(points: np.ndarray, faces: np.ndarray) -> list[float]:
    """Return the signed volume of every cube [m^3]."""
    a, b, c = np.moveaxis(points[faces], 1, 0)
    return (np.einsum("fk,fk->f", a, np.cross(b, c)).reshape(-1, 12).sum(axis=1) / 6.0).round(6).tolist()


@pytest.mark.parametrize(
    ("cubes", "count", "expected"),
    [
        ([(2.0, 0.0, False)], 0, [8.0]),
        ([(2.0, 0.0, True)], 1, [8.0]),
        ([(2.0, 0.0, True), (1.0, 9.0, False), (3.0, 20.0, True)], 2, [8.0, 1.0, 27.0]),
        ([(4.0, 0.0, False), (2.0, 0.3, True)], 0, [64.0, -8.0]),  # a shell and its cavity
        ([(4.0, 0.0, True), (2.0, 0.3, True)], 1, [64.0, -8.0]),
        ([(4.0, 0.0, False), (2.0, 3.5, True)], 1, [64.0, 8.0]),  # it reaches out
        ([(2.0, 0.0, True), (2.0, 1.1, True)], 2, [8.0, 8.0]),  # they overlap
    ],
)
def test_bodies_look_outward(cubes: list, count: int, expected: list[float]) -> None:
    points, faces = boxes(*cubes)
    turned, found = turn_outward(points, faces)
    assert found == count
    assert volumes(points, turned) == expected


def test_a_body_in_the_corner_of_the_bounds_of_another_is_outside_it() -> None:
    """The bounds of a tetrahedron hold the small cube, the tetrahedron does not."""
    cube, triangles = boxes((0.5, 0.0, True))
    corner = 10.0 * np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]])
    sides = np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]])
    points = np.concatenate([cube + 8.0, corner])
    faces, found = turn_outward(points, np.concatenate([triangles, sides + 8]))
    assert found == 1 and volumes(points - 8.0, faces[:12]) == [0.125]
    np.testing.assert_array_equal(faces[12:], sides + 8)


def test_open_sheets_and_empty_meshes_stay() -> None:
    points, faces = boxes((2.0, 0.0, True))
    for own in (faces[:-1], faces[:0]):
        turned, found = turn_outward(points, own)
        assert found == 0
        np.testing.assert_array_equal(turned, own)
