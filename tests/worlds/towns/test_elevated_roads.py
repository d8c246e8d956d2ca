"""Elevated roads: closed solids, no cracks, clearance, piers, and vehicles above and below."""

from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import shapely
import trimesh

from mmw.core.mesh import merge, separate
from mmw.traffic.idm.simulation import simulate_idm
from mmw.worlds.towns.checks import overlap_gaps
from mmw.worlds.towns.network import RoadNetwork
from tests.fixtures.meshes import corners_of, is_closed, top, volume, welded
from tests.fixtures.road_towns import build, drivable, flyover, ground_frame
from tests.fixtures.traffic_measures import measure
from tests.fixtures.traffic_towns import CATALOG, demand

DECK, PARAPET, WALL = 1.2, 1.1, 0.3


@pytest.fixture(scope="module")
def network() -> RoadNetwork:
    return build(flyover())


def test_structure_and_every_pier_are_closed_solids(network: RoadNetwork) -> None:
    (bridge,) = network.structures
    piers = [part for part in bridge.parts if part.path.endswith("piers")]
    solid = corners_of([part for part in bridge.parts if part not in piers])
    assert is_closed(solid)
    assert volume(separate(solid)) > 0
    assert is_closed(corners_of(piers))
    assert volume(separate(corners_of(piers))) > 0
    labels = {part.path.split("/")[2]: part.label for part in bridge.parts}
    assert labels["structure"] == labels["piers"] == "bridge"
    assert labels["parapet"] == "guard_rail" and labels["asphalt"] == "road"
    assert all(part.path.startswith("Bridges/over/") for part in bridge.parts)


@pytest.mark.parametrize("form", ["round", "square"])
def test_volume_of_a_straight_level_span_is_the_closed_form(form: str) -> None:
    """The section between two stations of the level part: deck, two kerbs, two parapets, the median."""
    network = build(flyover(columns=form))
    (bridge,) = network.structures
    solid = corners_of([part for part in bridge.parts if not part.path.endswith("piers")])
    half = 0.5 * (2.4 + 4 * 3.5) + 0.5
    walk = 0.15 + 1.5
    section = 2 * (half + walk + WALL) * DECK + 2 * 0.14 * (walk + WALL) + 2 * PARAPET * WALL + (2.4 - 0.6) * 0.14
    stations = np.linspace(112.0, 148.0, 5)
    for x in stations:
        assert section_area(solid, x) == pytest.approx(section, rel=1e-6)


def section_area(corners: np.ndarray, x: float) -> float:
    """Return the area of the cut through a closed mesh at one x, beside the rows of vertices."""
    mesh = trimesh.Trimesh(*welded(corners), process=False)
    cut = trimesh.intersections.mesh_plane(mesh, (1.0, 0.0, 0.0), (x + 1e-4, 0.0, 0.0))
    return shapely.polygonize(shapely.set_precision(shapely.linestrings(cut[:, :, 1:]), 1e-6)).area


def test_lanes_lie_on_the_mesh_across_both_ends(network: RoadNetwork) -> None:
    triangles = corners_of(drivable(network))
    lanes = [lane for name, lane in network.lanes.lanes.items() if name.startswith("over_")]
    assert len(lanes) == 4
    for lane in lanes:
        fine = np.concatenate([lane.station, np.linspace(10.0, 40.0, 61), lane.length - np.linspace(10.0, 40.0, 61)])
        points = np.column_stack([np.interp(np.sort(fine), lane.station, lane.points[:, k]) for k in range(3)])
        np.testing.assert_allclose(top(triangles, points[:, :2], points[:, 2] + 1), points[:, 2], atol=1e-6)


def test_no_drop_falls_between_road_structure_and_terrain(network: RoadNetwork) -> None:
    """Beside and across the ends: whatever falls meets road, sidewalk, parapet, or ground within a wall's height."""
    every = corners_of([*network.parts, *network.structure_parts, *network.terrain])
    rng = np.random.default_rng(3)
    for x in (28.0, 232.0):
        points = np.column_stack([rng.uniform(x - 1.5, x + 1.5, 400), rng.uniform(66, 94, 400), np.full(400, 5.0)])
        z = top(every, points[:, :2], points[:, 2] + 1)
        assert z.min() > -1e-6 and z.max() < 0.5 + PARAPET  # NaN, a miss, fails too
        inner = points[np.abs(points[:, 1] - 80) < 8]
        walks = [p for p in network.parts if "median" in p.path]
        walks += [p for p in network.structure_parts if p.label == "sidewalk"]
        ground = top(corners_of([*drivable(network), *walks]), inner[:, :2], inner[:, 2] + 1)
        assert not np.any(np.isnan(ground))


def test_ground_closes_around_the_structure(network: RoadNetwork) -> None:
    """Every free edge of roads, sidewalks and terrain lies on the frame, at a wall, or across an end of the bridge."""
    points, free, on_frame = ground_frame(network)
    ends = free[~on_frame[free].all(axis=1)]
    (bridge,) = network.structures
    fill = shapely.intersection(bridge.supports, bridge.plan).boundary
    away = shapely.distance(fill, shapely.points(points[ends.ravel(), :2]))
    across = np.isin(points[ends.ravel(), 0], np.float32([28.0, 232.0]))
    assert len(ends) > 40
    assert np.all((away < 1e-4) | across)


def test_terrain_runs_level_below_and_the_street_passes(network: RoadNetwork) -> None:
    (bridge,) = network.structures
    x, y = np.meshgrid(np.linspace(85, 175, 60), np.linspace(70, 90, 9))
    z = network.height(x, y)
    assert np.all((z > -0.01) & (z < 0.15))
    assert shapely.contains_xy(network.carriageway, 130, 80)
    assert not shapely.contains_xy(network.carriageway, 100, 80)
    assert not shapely.contains_xy(network.corridor, 100, 80)
    assert shapely.contains_xy(network.corridor, 40, 80)  # the fill
    assert network.overhead.contains(bridge.plan.buffer(-0.01))
    gap, _ = overlap_gaps(corners_of([part for part in network.parts if part.label == "road"]), bridge.underside)
    assert gap.min() == pytest.approx(7.4 - DECK, abs=1e-6)


def test_piers_stand_clear_of_the_street(network: RoadNetwork) -> None:
    (bridge,) = network.structures
    columns = [part for part in shapely.get_parts(bridge.supports) if part.area < 10]
    assert len(columns) >= 9
    street = shapely.box(130 - 6.75, 20, 130 + 6.75, 140)
    assert min(shapely.distance(street, column) for column in columns) >= 0.2
    piers = next(part for part in bridge.parts if part.path.endswith("piers"))
    assert piers.points[:, 2].min() < -0.8


def along() -> dict[str, Any]:
    """Let the street turn below a narrow bridge and run along with it for a while."""
    town = flyover(top=8.4)
    town["profiles"]["deck"] = {"lanes": 1, "walk": 0}
    town["nodes"] |= {"S": [95, 0, 0], "N": [165, 160, 0]}
    street = next(road for road in town["roads"] if road["id"] == "sn")
    street["via"] = [[95, 80, 15], [165, 80, 15]]
    return town


def test_a_street_along_the_bridge_gets_beams_between_columns_beside_the_deck() -> None:
    network = build(along())
    (bridge,) = network.structures
    columns = [part for part in shapely.get_parts(bridge.supports) if part.area < 10]
    street = shapely.buffer(network.corridor, 0.4)
    assert not any(shapely.intersects(street, column) for column in columns)
    beside = [column for column in columns if not shapely.intersects(bridge.plan, column)]
    assert len(beside) >= 4  # two piers on either side of the street
    assert network.overhead.contains(shapely.union_all(beside))
    heads = np.isclose(bridge.underside[:, :, 2], 8.4 - DECK - 1.0).all(axis=1)
    assert heads.sum() >= 2  # a head over the level part
    roads = corners_of([part for part in network.parts if part.label in ("road", "road_line")])
    assert overlap_gaps(roads, bridge.underside)[0].min() >= 5


def test_a_pier_without_a_place_is_refused() -> None:
    town = flyover(top=8.4, piers_every=12)
    town["profiles"]["street"] = {"lanes": 3, "shoulder": 2.6, "walk": 6.0, "centre": 3.5}
    town["profiles"]["deck"] = {"lanes": 1, "walk": 0}
    town["roads"][-1] |= {"z": [[40, 0], [98, 8.4], [162, 8.4], [220, 0]]}
    town["roads"][-1]["bridge"] |= {"from": 36, "to": 224}
    with pytest.raises(ValueError, match=r"road 'over': no place for a pier near station 1\d\d m"):
        build(town)


def test_clearance_is_measured_everywhere_not_on_the_centre_lines() -> None:
    """A street beside the center line, below the edge of a bridge that is lower there, is found by its overlap."""
    low = np.array([[[0, 0, 0], [4, 0, 0], [0, 4, 0.4]]], float)
    high = np.array([[[1, 1, 6], [9, 1, 6], [1, 9, 4]]], float)
    gap, xy = overlap_gaps(low, high)
    x, y = np.meshgrid(np.linspace(1, 3, 401), np.linspace(1, 3, 401))
    inside = x + y <= 4
    brute = (6 - 0.25 * (y - 1)) - 0.1 * y  # the planes of the two triangles
    assert gap.min() == pytest.approx(brute[inside].min())
    assert gap.max() == pytest.approx(brute[inside].max())
    np.testing.assert_allclose(xy[np.argmin(gap)], (1, 3))
    assert not len(overlap_gaps(low, high + np.array([10.0, 0, 0]))[0])


@pytest.mark.parametrize(
    ("town", "message"),
    [
        (flyover(top=6.0), r"bridge of road 'over': 4\.80 m of clearance above 'sn' at \(1\d\d\.\d, \d+\.\d\); 5\.0 m"),
        (flyover(top=2.5), r"rises to 2\.5 m above the ground; more than fill_below = 3\.0 m"),
        (flyover() | {"nodes": flyover()["nodes"] | {"W": [0, 80, 0]}, "roads": [
            *flyover()["roads"][:-1], flyover()["roads"][-1] | {"bridge": {"from": 70, "to": 232}}]},
         r"bridge\.from: the road is 2\.\d m above the ground around station 70\.0 m"),
        (flyover(**{"from": 5}), r"bridge\.from = 5\.0; needed: between \d+\.\d and \d+\.\d m"),
        (flyover(**{"from": 100, "to": 102}), "it ends well after it begins"),
    ],
    ids=["clearance", "low", "start", "junction", "order"],
)  # fmt: skip
def test_what_cannot_be_built_is_refused(town: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        build(town)


def drives(network: RoadNetwork) -> Iterator[Any]:
    whole = merge(part.mesh for part in drivable(network))
    mesh = whole.points, whole.faces
    for seed, center in ((1, (130.0, 80.0, 7.4)), (2, (130.0, 80.0, 0.0))):
        options = {"frame_count": 1000, "vehicle_count": 20, "spawn_center_m": center, "seed": seed}
        tracks = simulate_idm(demand(network.lanes, mesh, **options)).tracks
        yield tracks, measure(tracks, network.lanes, mesh, CATALOG)


def test_vehicles_drive_smoothly_over_and_below(network: RoadNetwork) -> None:
    high = low = 0
    for tracks, found in drives(network):
        assert found.max_jerk < 10
        assert found.max_wheel_error < 0.02
        assert found.min_gap > 0
        poses = np.stack([track.poses for track in tracks])
        below = np.hypot(poses[..., 0] - 130, poses[..., 1] - 80) < 9
        high += int(np.any(below & (poses[..., 2] > 7), axis=1).sum())
        low += int(np.any(below & (poses[..., 2] < 1), axis=1).sum())
    assert high >= 2 and low >= 1
