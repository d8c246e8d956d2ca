"""Lines of edges and posts against shapes whose lengths and neighbors are known."""

import numpy as np
import pytest

from mmw.channel.path_solver.edge_lines import LONGEST_M, join_edges


def edges_of(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the edges of a polyline, all of which face up."""
    return points[:-1].copy(), points[1:].copy(), np.tile([0.0, 0.0, 1.0], (len(points) - 1, 1))


def test_a_straight_line_goes_on_whichever_way_its_edges_run() -> None:
    """Three edges in a row, the middle one turned around, and one around a corner."""
    begin, end, away = edges_of(np.array([[0, 0, 0], [1, 0, 0], [3, 0, 0], [6, 0, 0], [6, 2, 0.0]]))
    begin[1], end[1] = end[1].copy(), begin[1].copy()
    lines = join_edges(begin, end, away)
    assert lines.name.tolist() == [0, 0, 0, 3]
    np.testing.assert_allclose(lines.ahead, [[0, 5], [3, 1], [3, 0], [0, 0]])
    assert (lines.post == -1).all()


def test_a_ring_goes_on_without_end() -> None:
    """Thirty-six edges that turn by 10 degrees each."""
    turn = np.linspace(0, 2 * np.pi, 37)
    lines = join_edges(*edges_of(np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)))
    assert set(lines.name) == {0}
    np.testing.assert_array_equal(lines.ahead, LONGEST_M)


def test_edges_that_face_another_way_do_not_join() -> None:
    """One edge of a roof and one of its underside, end to end."""
    begin, end, away = edges_of(np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0.0]]))
    away[1] = [0, 0, -1]
    assert join_edges(begin, end, away).name.tolist() == [0, 1]


def test_at_a_fork_the_straightest_goes_on() -> None:
    """Of two edges behind an end the straight one joins, the other one begins a line."""
    begin = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 0.0]])
    end = np.array([[1, 0, 0], [2, 0.4, 0], [2, 0.1, 0]])
    lines = join_edges(begin, end, np.tile([0.0, 0.0, 1.0], (3, 1)))
    assert lines.name.tolist() == [0, 1, 0]
    assert lines.ahead[0] == pytest.approx([0, np.hypot(1, 0.1)])


def test_the_corners_of_a_post_are_one_post() -> None:
    """Four upright edges 0.2 m apart, of one object; those of another object and of a wall 3 m wide are none."""
    corner = np.array([[0, 0], [0.2, 0], [0.2, 0.2], [0, 0.2], [5, 0], [5.1, 0], [9, 0], [12, 0]])
    begin = np.column_stack([corner, np.zeros(8)])
    end = begin + np.array([0, 0, 4.0])
    away = np.column_stack([corner - 0.1, np.zeros(8)])
    lines = join_edges(begin, end, away / np.linalg.norm(away, axis=1)[:, None], np.array([1, 1, 1, 1, 2, 3, 4, 4]))
    assert lines.post.tolist() == [0, 0, 0, 0, -1, -1, -1, -1]
