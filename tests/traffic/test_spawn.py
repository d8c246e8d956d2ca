"""Start positions that are drawn by seed: valid, different between seeds, and traffic that stays sound."""

from dataclasses import replace

import numpy as np
import pytest

from mmw.config import VarySpawnConfig
from mmw.core.errors import InputError
from mmw.traffic.demand import TrafficDemand
from mmw.traffic.idm.simulation import simulate_idm, start_fleet
from mmw.traffic.route import endless_lanes
from mmw.traffic.spawn import (
    BlockedPointError,
    Placed,
    SpawnPoint,
    Start,
    connected_ranks,
    draw_starts,
    drawn_points,
    place_starts,
    spawn_points,
    vehicle_order,
)
from mmw.traffic.spawn_grid import SAME_PLACE
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
        found, ranks = drawn_points(points, varied(seed), 70.0)
        assert len(set(ranks)) == 3 and set(ranks) <= set(range(24)) and list(ranks) == sorted(ranks)
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
        for point in drawn_points(points, varied(seed, vehicle_count=6), 70.0)[0]:
            count[point.position] += 1
    share = 6 / len(inside)
    expected, deviation = 400 * share, np.sqrt(400 * share * (1 - share))
    assert np.abs(np.array(list(count.values())) - expected).max() < 5 * deviation


def test_seeds_differ_and_any_vehicle_may_be_a_cav() -> None:
    (one, _), (other, _), (again, _) = (draw_starts(varied(seed), endless_lanes(GRID)) for seed in (1, 2, 1))
    assert [start.point for start in one] == [start.point for start in again]
    assert len({start.point for start in one} & {start.point for start in other}) < 24
    drawn = [draw_starts(varied(seed), endless_lanes(GRID)) for seed in range(100)]
    assert len({rank for _, ranks in drawn for rank in ranks}) == 24
    for starts, ranks in drawn:
        assert tuple(start.rank for start in starts if start.is_cav) == ranks
    pool = {rank for seed in range(40) for rank in draw_starts(varied(seed, cav_pool=5), endless_lanes(GRID))[1]}
    assert pool == set(range(5))


@pytest.mark.parametrize("first", [0, 7, 1000])
def test_cavs_of_seeds_that_follow_each_other_start_apart(first: int) -> None:
    """As far as half of an even spacing along the lanes, and never at the place of another seed in a round."""
    points = spawn_points(GRID, endless_lanes(GRID))
    near = [point for point in points if np.linalg.norm(np.array(point.position) - CENTER) <= 110.0]
    places = len(near)  # no two of this town are the same place
    round_length = places // 3
    begin = first - first % round_length  # a round's first seed
    starts: dict[int, set[SpawnPoint]] = {}
    for seed in range(begin, begin + round_length):
        found, ranks = drawn_points(points, varied(seed), 110.0)
        starts[seed] = {found[rank] for rank in ranks}
    assert sum(map(len, starts.values())) == len(set().union(*starts.values())) == 3 * round_length
    for count in (2, 4, 8):
        rows = sorted(near.index(point) for seed in range(begin, begin + count) for point in starts[seed])
        gaps = np.diff([*rows, rows[0] + places])
        assert gaps.min() >= places / (2 ** int(np.ceil(np.log2(3 * count))) * 2)


def test_rounds_differ() -> None:
    points = spawn_points(GRID, endless_lanes(GRID))
    found = set()
    for turn in range(20):
        chosen, ranks = drawn_points(points, varied(turn * (len(points) // 3)), 110.0)
        found.add(tuple(chosen[rank].position for rank in ranks))
    assert len(found) > 15


def test_too_small_a_radius_is_an_error() -> None:
    with pytest.raises(InputError, match=r"vehicle_count = 24: there are \d+ spawn points within vary.spawn.radius_m"):
        draw_starts(varied(1, radius=20.0), endless_lanes(GRID))


def test_without_it_the_start_is_that_of_before() -> None:
    given = replace(varied(3), spawn=None)
    ranks = connected_ranks(given.traffic, 3)
    assert ranks == (0, 1, 2)
    (one, own), (other, _) = (draw_starts(replace(given, seed=seed), endless_lanes(GRID)) for seed in (3, 4))
    assert own == (0, 1, 2) and [start.point for start in one] == [start.point for start in other]


def place_beside(given: TrafficDemand, blocked: set[SpawnPoint]) -> Placed[Start]:
    """Return the starts of a demand in a town where no vehicle can start at some points."""

    def add(start: Start) -> Start:
        if start.point in blocked:
            raise BlockedPointError(start.point, "the bend is too tight", "widen the road there")
        return start

    return place_starts(given, endless_lanes(GRID), add)


def test_blocked_points_are_skipped_and_named() -> None:
    """The vehicles are those of a town without these points: nearest first, the rank's own driver at each."""
    given = replace(varied(3), spawn=None)
    before, _ = draw_starts(given, endless_lanes(GRID))
    blocked = {before[0].point, before[5].point}
    placed = place_beside(given, blocked)
    points = [point for point in spawn_points(GRID, endless_lanes(GRID)) if point not in blocked]
    place = np.linalg.norm(np.array([point.position for point in points]) - CENTER, axis=1)
    nearest = [points[index] for index in np.argsort(place, kind="stable")[:24]]
    assert [start.point for start in placed.vehicles] == nearest
    assert [start.rank for start in placed.vehicles] == list(range(24)) and placed.cav_ranks == (0, 1, 2)
    assert [(s.factor, s.headway, s.is_cav) for s in placed.vehicles] == [
        (s.factor, s.headway, s.is_cav) for s in before
    ]
    (note,) = placed.notes
    assert note.startswith("2 spawn points skipped") and f"lane {before[0].point.lane!r} at (" in note
    assert note.count("the bend is too tight") == 2


def test_drawn_points_are_replaced_within_the_radius() -> None:
    given = varied(3)
    before, ranks = draw_starts(given, endless_lanes(GRID))
    placed = place_beside(given, {before[2].point})
    assert len(placed.vehicles) == 24 and placed.cav_ranks == ranks
    place = np.array([start.point.position for start in placed.vehicles])
    assert np.linalg.norm(place - CENTER, axis=1).max() <= 110.0
    apart = np.linalg.norm(place[:, None] - place[None], axis=2) + 1e3 * np.eye(24)
    assert apart.min() >= SAME_PLACE


def test_vehicles_without_a_point_are_left_out_but_no_cav() -> None:
    given = replace(varied(3), spawn=None)
    points = spawn_points(GRID, endless_lanes(GRID))
    few = set(points[:5])
    placed = place_beside(given, set(points) - few)
    assert len(placed.vehicles) == 5 and {start.point for start in placed.vehicles} == few
    assert placed.notes[0].endswith(f"; and {len(points) - 5 - 6} more")
    assert placed.notes[1] == "5 of 24 vehicles drive: no spawn point is left for the others"
    with pytest.raises(
        InputError, match=r"cav_ranks = \[0, 1, 2\]: vehicles can start at 2 spawn points only, .* rank 2"
    ):
        place_beside(given, set(points[2:]))
    with pytest.raises(
        BlockedPointError, match=r"spawn point on lane .*: the bend is too tight; .*widen the road there"
    ):
        place_beside(given, set(points))


def test_a_hole_in_the_road_costs_its_point() -> None:
    """No wheel stands over a hole of 3 m about the spawn point nearest to the center; the others drive."""
    given = demand(GRID, surface(GRID), seed=3, cav_ranks=(0,), spawn_center_m=CENTER, vehicle_count=4, frame_count=10)
    hole = draw_starts(given, endless_lanes(GRID))[0][0].point
    points, faces = surface(GRID)
    away = np.linalg.norm(points[faces].mean(axis=1)[:, :2] - hole.position[:2], axis=1)
    found = simulate_idm(
        demand(
            GRID,
            (points, faces[away > 3.0]),
            seed=3,
            cav_ranks=(0,),
            spawn_center_m=CENTER,
            vehicle_count=4,
            frame_count=10,
        )
    )
    assert len(found.tracks) == 4 and found.tracks[0].role == "cav"
    assert any(f"lane {hole.lane!r} at (" in note and "leaves the drivable surface" in note for note in found.notes)


@pytest.mark.slow
def test_traffic_is_sound() -> None:
    for seed in range(4):
        tracks = simulate_idm(varied(seed)).tracks
        found = measure(tracks, GRID, surface(GRID), CATALOG)
        assert found.min_gap > 0.4 and found.departed == 0 and found.stuck == 0
        start = np.array([track.poses[0, :3] for track in tracks if track.role == "cav"])
        assert len(start) == 3 and np.linalg.norm(start - CENTER, axis=1).max() < 110.0 + 15.0  # 2.5 s of driving


def test_seed_of_the_scene_keeps_models_and_paints_while_places_routes_and_drivers_change() -> None:
    drawn = start_fleet(varied(3))[0].cars
    fleets, headways = [], []
    for seed in (3, 4, 5):
        engine, placed = start_fleet(replace(varied(seed), scene_seed=3))
        order = vehicle_order(placed.cav_ranks, len(engine.cars))
        fleets.append([(engine.cars[rank].shape.name, engine.cars[rank].paint) for rank in order])
        headways.append([car.headway for car in engine.cars])
    assert len(set(fleets[0])) > 2 and fleets[0] == fleets[1] == fleets[2]
    assert headways[0] == [car.headway for car in drawn] and headways[1] != headways[0] != headways[2]
    own = start_fleet(varied(4))[0].cars
    assert sorted(fleets[1]) != sorted((car.shape.name, car.paint) for car in own)
