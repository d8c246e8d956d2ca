"""Prisms around objects: the convex outline against SciPy's, outward polygons, and flat objects."""

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from mmw.dataset.export.deepmimo.hulls import (
    ROUNDING_M,
    Polygons,
    convex_outline,
    main_material,
    prism,
    without_small_corners,
)


def area(outline: np.ndarray) -> float:
    """Return the signed area of a polygon by the shoelace formula."""
    x, y = outline.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def volume(corners: np.ndarray, polygons: Polygons) -> float:
    """Return the signed volume within polygons, positive if they face outward (divergence theorem)."""
    triangles = [corners[[side[0], side[i], side[i + 1]]] for side in polygons for i in range(1, len(side) - 1)]
    return sum(float(np.dot(a, np.cross(b, c))) for a, b, c in triangles) / 6.0


@pytest.mark.parametrize("seed", range(5))
def test_the_outline_is_the_convex_hull(seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(200, 2)).round(2)  # some are equal, some on one line
    outline = convex_outline(points)
    assert area(outline) == pytest.approx(ConvexHull(points).volume, rel=1e-12)  # in a plane its volume is the area


def test_a_prism_faces_outward() -> None:
    """A box with a spire: the prism is as high as the spire, as DeepMIMO's own are."""
    box = np.array([[x, y, z] for x in (1.0, 5.0) for y in (2.0, 4.0) for z in (3.0, 6.0)] + [[3.0, 3.0, 10.0]])
    corners, polygons = prism(box)
    assert corners.shape == (8, 3) and [len(side) for side in polygons] == [4] * 6
    assert volume(corners, polygons) == pytest.approx(4 * 2 * 7)


def test_flat_objects_are_one_polygon() -> None:
    plate = np.array([[0, 0, 1], [4, 0, 1], [4, 3, 1], [0, 3, 1.0005]])
    corners, polygons = prism(plate)
    assert polygons == [[0, 1, 2, 3]] and area(corners[:, :2]) == pytest.approx(12)
    wall = np.array([[0, 0, 0], [3, 4, 0], [3, 4, 2], [0, 0, 2], [1.5, 2, 1]])
    corners, polygons = prism(wall)
    assert polygons == [[0, 1, 2, 3]]
    assert np.linalg.norm(corners[1] - corners[0]) == pytest.approx(5)
    assert corners[:, 2].tolist() == [0, 0, 2, 2]


def test_small_corners_are_left_out_and_large_ones_kept() -> None:
    """A regular polygon of n corners on a circle of radius r has corners of height r (1 - cos(2 pi / n)).

    What is left are corners of the circle.
    """
    for radius, count in ((0.1, 16), (3.0, 64), (100.0, 12)):
        angle = np.linspace(0, 2 * np.pi, count, endpoint=False)
        circle = radius * np.column_stack([np.cos(angle), np.sin(angle)])
        kept = without_small_corners(circle)
        is_coarse = bool(radius * (1 - np.cos(2 * np.pi / count)) >= ROUNDING_M)
        assert (len(kept) == count) is is_coarse and len(kept) >= 3
        assert {tuple(corner) for corner in kept} <= {tuple(corner) for corner in circle}


def test_the_material_of_the_largest_area_counts() -> None:
    points = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [9, 0, 0], [0, 9, 0]], dtype=float)
    faces = np.array([[0, 1, 2], [0, 1, 2], [0, 3, 4]])
    assert main_material(points, faces, np.array([2, 2, 5])) == 5
