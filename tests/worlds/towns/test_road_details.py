"""Arrows, drains and manhole covers: cut out of the asphalt, where they belong, shown the right way round."""

import numpy as np
import pytest
import shapely

from mmw.worlds.towns.picture_uv import picture_coordinates
from mmw.worlds.towns.road_details import DRAIN, KERB_GAP, MANHOLE_RADIUS, arrow
from tests.fixtures import town_checks as checks


def plan(part) -> np.ndarray:
    """Return the triangles of a mesh in plan, shape [M]."""
    return np.asarray(shapely.polygons(part.points[part.faces][:, :, :2]))


@pytest.fixture(scope="module")
def roads():
    return {part.path: part for part in checks.network_of("town10").parts if part.path.startswith("Roads/")}


def test_an_arrow_to_the_left_is_the_mirror_image_of_one_to_the_right() -> None:
    left, right = arrow(["left", "straight"]), arrow(["right", "straight"])
    assert left.is_valid and left.geom_type == "Polygon"
    assert shapely.equals(shapely.transform(left, lambda xy: xy * [1, -1]), right)
    assert shapely.get_coordinates(left)[:, 1].max() > 0.9 > -shapely.get_coordinates(left)[:, 1].min()
    ahead = shapely.get_coordinates(arrow(["straight"]))
    assert ahead[np.argmax(ahead[:, 0])] == pytest.approx([4.0, 0.0]) and ahead[:, 0].min() == 0.0


def test_details_fill_the_holes_in_the_asphalt_exactly(roads) -> None:
    for path, part in roads.items():
        road, name = path.split("/")[1:]
        if name in ("arrows", "drains", "manholes"):
            asphalt = roads[f"Roads/{road}/asphalt"]
            both = shapely.union_all([*plan(part), *plan(asphalt)])
            apart = sum(shapely.area(plan(mesh)).sum() for mesh in (part, asphalt))
            assert apart == pytest.approx(both.area, rel=1e-6), path
            assert shapely.union_all(plan(part)).area == pytest.approx(shapely.area(plan(part)).sum(), rel=1e-6)


def test_there_are_all_three_and_they_have_their_sizes(roads) -> None:
    areas = {"arrows": [], "drains": [], "manholes": []}
    for path, part in roads.items():
        name = path.split("/")[2]
        if name in areas:
            areas[name] += [piece.area for piece in shapely.get_parts(shapely.union_all(plan(part)))]
    assert all(len(found) > 8 for found in areas.values())
    octagon = 2.0 * np.sqrt(2.0) * MANHOLE_RADIUS**2
    assert np.abs(np.array(areas["drains"]) / np.prod(DRAIN) - 1.0).max() < 1e-3
    assert np.abs(np.array(areas["manholes"]) / octagon - 1.0).max() < 1e-3


def test_drains_lie_at_kerbs_and_manholes_do_not(roads) -> None:
    kerb = shapely.boundary(checks.network_of("town10").carriageway)
    for path, part in roads.items():
        away = shapely.distance(shapely.points(part.points[:, :2]), kerb)
        if path.endswith("drains"):
            assert away.min() > 0.5 * KERB_GAP and away.max() < KERB_GAP + DRAIN[1] + 0.05
        if path.endswith("manholes"):
            assert away.min() > 0.7


def test_each_cover_shows_the_whole_picture_and_no_mirror_image(roads) -> None:
    for path, part in roads.items():
        if not path.endswith(("drains", "manholes")):
            continue
        st = picture_coordinates(part)
        assert st is not None and (st.min(), st.max()) == pytest.approx((0.0, 1.0))
        corners = part.points[part.faces][:, :, :2]
        turn = [np.linalg.det(np.stack([own[1] - own[0], own[2] - own[0]])) for own in (*corners, *st)]
        assert min(turn) > 0.0  # counter-clockwise on the road, and in the picture


def test_the_arrow_of_a_lane_points_along_it_and_shows_its_turns(roads) -> None:
    network = checks.network_of("town10")
    arrows = shapely.union_all([area for path, part in roads.items() if path.endswith("arrows") for area in plan(part)])
    seen = set()
    for lane in network.lanes.lanes.values():
        if lane.junction or not (lane.left or lane.right) or lane.length < 40.0:
            continue
        line = shapely.LineString(lane.points[:, :2])
        end = shapely.Point(lane.points[-1, :2])
        own = shapely.intersection(arrows, shapely.intersection(line.buffer(1.4), end.buffer(14.0)))
        if own.is_empty:
            continue
        at = shapely.points(shapely.get_coordinates(own))
        station = shapely.line_locate_point(line, at)
        middle, before = (shapely.line_interpolate_point(line, station - back) for back in (0.0, 0.5))
        ahead = shapely.get_coordinates(middle) - shapely.get_coordinates(before)
        off = shapely.get_coordinates(at) - shapely.get_coordinates(middle)
        reach = (ahead[:, 0] * off[:, 1] - ahead[:, 1] * off[:, 0]) / np.linalg.norm(ahead, axis=1)
        turns = [np.unwrap(network.lanes.lanes[name].headings)[[0, -1]] for name in lane.successors]
        turn = np.array([last - first for first, last in turns])
        turn = turn[np.abs(turn) < np.radians(150)]
        assert (reach.max() > 0.7) == bool((turn > np.radians(35)).any()), lane.name
        assert (reach.min() < -0.7) == bool((turn < -np.radians(35)).any()), lane.name
        seen.add((reach.max() > 0.7, reach.min() < -0.7))
    assert len(seen) >= 3
