"""Overlaps in one plane against shapely, and pairs of boxes against brute force."""

import numpy as np
import shapely
from hypothesis import example, given, settings
from hypothesis import strategies as st

from mmw.worlds.checks.box_pairs import area_and_centre, box_pairs, clip, own_pairs
from mmw.worlds.checks.coplanar_faces import find_overlaps

size = st.floats(0.3, 6.0)


@settings(max_examples=60, deadline=None)
@given(
    st.tuples(size, size, size, size), st.tuples(*(st.floats(-4.0, 4.0),) * 2), st.floats(0.0, 6.3),
    st.integers(0, 2**32 - 1), st.booleans(),
)  # fmt: skip
@example((4.0, 5.0, 5.03125, 5.5), (0.0, 0.0), 5.5, 1, True)  # three corners of a cut polygon lie in the next plane
def test_common_area_is_that_of_shapely(sides, shift, turn, seed, turned) -> None:
    """Two rectangles in one random plane, each cut into two triangles."""
    a = np.array([[0, 0], [sides[0], 0], [sides[0], sides[1]], [0, sides[1]]])
    spin = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    b = np.array([[0, 0], [sides[2], 0], [sides[2], sides[3]], [0, sides[3]]]) @ spin.T + shift
    basis = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))[0]
    corners = []
    for ring, is_turned in ((a, False), (b, turned)):
        xyz = ring @ basis[:2] + np.array([100.0, -50.0, 7.0])
        for triangle in (xyz[[0, 1, 2]], xyz[[0, 2, 3]]):
            corners.append(triangle[::-1] if is_turned else triangle)
    corners = np.array(corners)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    area = np.linalg.norm(cross, axis=1) / 2
    normal = cross / (2 * area[:, None])
    expected = shapely.Polygon(a).intersection(shapely.Polygon(b))
    found = find_overlaps(corners, normal, area)
    thin = 4 * 1e-3 * 12.0  # four pairs, each let pass where they reach 1 mm into each other
    assert abs(found.area.sum() - expected.area) < thin
    assert (found.is_opposite == turned).all()
    for place in (found.place - [100.0, -50.0, 7.0]) @ basis[:2].T:
        assert shapely.Point(place).distance(expected) < 1e-6
    lifted = corners.copy()
    lifted[2:] += 2.5e-3 * basis[2]
    assert not len(find_overlaps(lifted, normal, area).first)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_pairs_of_boxes_are_those_of_brute_force(seed: int) -> None:
    rng = np.random.default_rng(seed)
    low, high = [], []
    for _ in range(2):
        corner, extent = rng.uniform(-10, 10, (60, 3)), 10.0 ** rng.uniform(-2, 1.5, (60, 3))
        low.append(corner)
        high.append(corner + extent)
    meets = ((low[0][:, None] <= high[1]) & (low[1] <= high[0][:, None])).all(axis=2)
    found = sorted(
        (int(i), int(j)) for a, b in box_pairs(low[0], high[0], low[1], high[1]) for i, j in zip(a, b, strict=True)
    )
    assert found == [tuple(pair) for pair in np.argwhere(meets).tolist()]
    meets = np.triu(((low[0][:, None] <= high[0]) & (low[0] <= high[0][:, None])).all(axis=2), 1)
    own = sorted(
        (min(i, j), max(i, j))
        for a, b in own_pairs(low[0], high[0])
        for i, j in zip(a.tolist(), b.tolist(), strict=True)
    )
    assert own == [tuple(pair) for pair in np.argwhere(meets).tolist()]


def test_clip_cuts_a_square_in_half() -> None:
    square = np.array([[[0, 0], [2, 0], [2, 2], [0, 2]], [[5, 0], [6, 0], [6, 1], [5, 1]]], dtype=float)
    points, count = clip(square, np.array([4, 4]), np.array([1.0, 1.0]), 2.0)
    area, centre = area_and_centre(points, count)
    np.testing.assert_allclose(area, [2.0, 0.0])
    np.testing.assert_allclose(centre[0], [2 / 3, 2 / 3])
