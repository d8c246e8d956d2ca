"""Lines of edges, and those that run side by side, against shapes whose lengths and neighbors are known."""

from itertools import combinations

import numpy as np
import pytest

from mmw.channel.path_solver.edge_lines import BESIDE_M, LONGEST_M, PARALLEL_COS, edges_side_by_side, join_edges


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


def test_a_ring_goes_on_without_end() -> None:
    """Thirty-six edges that turn by 10 degrees each."""
    turn = np.linspace(0, 2 * np.pi, 37)
    lines = join_edges(*edges_of(np.stack([np.cos(turn), np.sin(turn), 0 * turn], axis=1)))
    assert set(lines.name) == {0}
    np.testing.assert_array_equal(lines.ahead, LONGEST_M)


def test_edges_that_face_another_way_do_not_go_on() -> None:
    """One edge of a roof and one of its underside, end to end: neither is longer for the other."""
    begin, end, away = edges_of(np.array([[0, 0, 0], [1, 0, 0], [2, 0, 0.0]]))
    away[1] = [0, 0, -1]
    lines = join_edges(begin, end, away, np.array([1, 2]))
    assert lines.name.tolist() == [0, 1]
    np.testing.assert_array_equal(lines.ahead, 0.0)


def test_at_a_fork_the_straightest_goes_on() -> None:
    """Of two edges behind an end the straight one joins, the other one, of another body, begins a line."""
    begin = np.array([[0, 0, 0], [1, 0, 0], [1, 0, 0.0]])
    end = np.array([[1, 0, 0], [2, 0.4, 0], [2, 0.1, 0]])
    lines = join_edges(begin, end, np.tile([0.0, 0.0, 1.0], (3, 1)), np.array([1, 2, 1]))
    assert lines.name.tolist() == [0, 1, 0]
    assert lines.ahead[0] == pytest.approx([0, np.hypot(1, 0.1)])


def test_lines_side_by_side_share_a_name_within_a_body() -> None:
    """Four upright edges of a post 0.15 m wide are one line; not those of another body or farther off."""
    corner = np.array([[0, 0], [0.15, 0], [0.15, 0.15], [0, 0.15], [0.15, 0.3], [9, 0], [12, 0], [0.05, 0.05]])
    begin = np.column_stack([corner, np.zeros(8)])
    end = begin + np.array([0, 0, 4.0])
    end[7] = begin[7] + [2.0, 0.0, 1.0]
    away = np.column_stack([corner - 0.1, np.ones(8)])
    lines = join_edges(begin, end, away / np.linalg.norm(away, axis=1)[:, None], np.array([1, 1, 1, 1, 2, 1, 1, 1]))
    assert lines.name.tolist() == [0, 0, 0, 0, 4, 5, 6, 7]
    np.testing.assert_array_equal(lines.ahead, 0.0)


def distance_by_samples(one: np.ndarray, other: np.ndarray) -> float:
    """Return the least distance between points of two edges, from begin to end, by 201 points on each."""
    t = np.linspace(0.0, 1.0, 201)[:, None]
    points = [edge[0] + t * (edge[1] - edge[0]) for edge in (one, other)]
    return float(np.linalg.norm(points[0][:, None] - points[1], axis=2).min())


def test_pairs_of_edges_are_those_that_brute_force_finds(device: str) -> None:
    """Of 60 random edges, each near pair in nearly one direction is found; those near a limit may be either."""
    rng = np.random.default_rng(5)
    begin = rng.uniform(0.0, 1.0, (60, 3)) + np.array([2e3, 0.0, 0.0])  # as far out as a town
    along = np.array([1.0, 0.0, 0.0]) + rng.normal(0.0, 0.4, (60, 3))
    end = begin + rng.choice([-1.0, 1.0], 60)[:, None] * along * rng.uniform(0.1, 0.6, 60)[:, None]
    found = set(zip(*(side.tolist() for side in edges_side_by_side(begin, end, device=device)), strict=True))
    unit = (end - begin) / np.linalg.norm(end - begin, axis=1)[:, None]
    checked = 0
    for a, b in combinations(range(60), 2):
        apart = distance_by_samples(np.stack([begin[a], end[a]]), np.stack([begin[b], end[b]]))
        cosine = abs(unit[a] @ unit[b])
        if abs(apart - BESIDE_M) < 5e-3 or abs(cosine - PARALLEL_COS) < 1e-9:
            continue
        assert ((a, b) in found) == (apart < BESIDE_M and cosine > PARALLEL_COS)
        checked += 1
    assert checked > 1600
    assert len(found) > 40
