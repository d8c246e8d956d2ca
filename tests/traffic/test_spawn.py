"""Start positions that are drawn by seed: valid, different between seeds, and traffic that stays sound."""

from dataclasses import replace

import numpy as np
import pytest

from mmw.config import VarySpawnConfig
from mmw.core.errors import InputError
from mmw.traffic.demand import TrafficDemand
from mmw.traffic.idm.simulation import simulate_idm
from mmw.traffic.route import endless_lanes
from mmw.traffic.spawn import SAME_PLACE, connected_ranks, draw_starts, drawn_points, spawn_points
from tests.fixtures.traffic_measures import measure
from tests.fixtures.traffic_towns import CATALOG, demand, grid, surface

GRID = grid(3, 80.0)
CENTER = (80.0, 80.0, 0.0)


def varied(seed: int, radius: float = 110.0, **options: object) -> TrafficDemand:
    given = {"cav_ranks": (0, 1, 2), "spawn_center_m": CENTER, "vehicle_count": 24} | options
    return replace(demand(GRID, surface(GRID), seed=seed, **given), spawn=VarySpawnConfig(radius_m=radius))


def test_points_are_spawn_points_within_the_radius_nearest_first() -> None:
    points = spawn_points(GRID, endless_lanes(GRID))
    for seed in range(5):
        found = drawn_points(points, varied(seed), 70.0)
        assert len(found) == 24 and set(found) <= set(points)
        place = np.array([point.position for point in found])
        away = np.linalg.norm(place - CENTER, axis=1)
        assert away.max() <= 70.0 and (np.diff(away) >= 0).all()
        apart = np.linalg.norm(place[:, None] - place[None], axis=2) + 1e3 * np.eye(24)
        assert apart.min() >= SAME_PLACE


def test_every_place_is_drawn_about_as_often() -> None:
    points = spawn_points(GRID, endless_lanes(GRID))
    place = np.array([point.position for point in points])
    inside = np.flatnonzero(np.linalg.norm(place - CENTER, axis=1) <= 70.0)
    count = dict.fromkeys((points[index].position for index in inside), 0)
    for seed in range(400):
        for point in drawn_points(points, varied(seed, vehicle_count=6), 70.0):
            count[point.position] += 1
    share = 6 / len(inside)
    expected, deviation = 400 * share, np.sqrt(400 * share * (1 - share))
    assert np.abs(np.array(list(count.values())) - expected).max() < 5 * deviation


def test_seeds_differ_and_any_vehicle_may_be_a_cav() -> None:
    one, other, again = (draw_starts(varied(seed), endless_lanes(GRID)) for seed in (1, 2, 1))
    assert [start.point for start in one] == [start.point for start in again]
    assert len({start.point for start in one} & {start.point for start in other}) < 24
    drawn = {rank for seed in range(40) for rank in connected_ranks(varied(seed).traffic, seed, is_drawn=True)}
    assert len(drawn) == 24
    pool = {
        rank for seed in range(40) for rank in connected_ranks(varied(seed, cav_pool=5).traffic, seed, is_drawn=True)
    }
    assert pool == set(range(5))


def test_too_small_a_radius_is_an_error() -> None:
    with pytest.raises(InputError, match=r"vehicle_count = 24: there are \d+ spawn points within vary.spawn.radius_m"):
        draw_starts(varied(1, radius=20.0), endless_lanes(GRID))


def test_without_it_the_start_is_that_of_before() -> None:
    given = replace(varied(3), spawn=None)
    ranks = connected_ranks(given.traffic, 3)
    assert ranks == (0, 1, 2)
    assert [start.point for start in draw_starts(given, endless_lanes(GRID))] == [
        start.point for start in draw_starts(replace(given, seed=4), endless_lanes(GRID))
    ]


@pytest.mark.slow
def test_traffic_is_sound() -> None:
    for seed in range(4):
        tracks = simulate_idm(varied(seed)).tracks
        found = measure(tracks, GRID, surface(GRID), CATALOG)
        assert found.min_gap > 0.4 and found.departed == 0 and found.stuck == 0
        start = np.array([track.poses[0, :3] for track in tracks if track.role == "cav"])
        assert len(start) == 3 and np.linalg.norm(start - CENTER, axis=1).max() < 110.0 + 15.0  # 2.5 s of driving
