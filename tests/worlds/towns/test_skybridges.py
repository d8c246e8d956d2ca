"""Skybridges: closed shells with exact panes, on columns or buildings, over roads."""

import numpy as np
import pytest
import shapely

from mmw.core.mesh import merge
from mmw.worlds.towns.ground_height import Ground
from mmw.worlds.towns.place_description import Skybridge
from mmw.worlds.towns.skybridges import SUNK, Span, build_skybridge, find_span
from tests.fixtures.meshes import area, by_name, open_edges, volume
from tests.fixtures.places_town import LEVEL, sheet


def bridge(**keys) -> Skybridge:
    return Skybridge.model_validate({"name": "s", "from": [-15, 0], "to": [15, 0]} | keys)


ROAD = shapely.box(-8, -100, 8, 100)


def span(buildings: tuple[shapely.Polygon, ...] = (), **keys) -> Span:
    return find_span(bridge(**keys), ROAD, buildings, LEVEL)


@pytest.mark.parametrize("keys", [{}, {"width": 25, "soffit": 7, "storeys": 2, "bay_m": 2.5}, {"to": [14, 9]}])
def test_skybridge_is_one_closed_shell_of_its_size(keys):
    found = span(**keys)
    meshes = by_name(build_skybridge(found, LEVEL))
    columns = meshes.pop("columns")
    shell = merge(meshes.values())
    assert open_edges(shell) == 0 and open_edges(columns) == 0
    low, high = shell.points[:, 2].min(), shell.points[:, 2].max()
    assert low == pytest.approx(found.description.soffit)
    assert volume(shell) == pytest.approx(found.length * found.description.width * (high - low))
    assert volume(columns) > 0
    for plan in found.column_plans:
        assert plan.distance(ROAD) >= 0.3 and found.plan.buffer(1e-6).contains(plan)
    assert columns.points[:, 2].min() < -0.5 and columns.points[:, 2].max() == pytest.approx(low + SUNK)


def test_glass_of_a_skybridge_is_exact_and_lies_in_two_planes():
    """Ten panes between eleven posts of 0.2 m on 30 m, 4 - 0.35 - 0.35 m high, in two storeys and two sides."""
    glass = by_name(build_skybridge(span(storeys=2, storey_m=4.0, mullion_m=0.2), LEVEL))["glass"]
    assert area(glass) == pytest.approx(2 * 2 * (30 - 11 * 0.2) * (4.0 - 0.7), rel=1e-9)
    assert sorted({round(float(y), 6) for y in glass.points[:, 1]}) == [-4.0, 4.0]
    assert {tuple(np.round(n, 6) + 0.0) for n in glass.normals} == {(0.0, 1.0, 0.0), (0.0, -1.0, 0.0)}


def test_buildings_carry_the_ends_that_they_touch():
    west = shapely.box(-40, -10, -15, 10)
    one = span((west,))
    assert one.on_columns == (False, True) and all(x > 0 for x, _ in one.columns)
    shell = by_name(build_skybridge(one, LEVEL))["frame"].points
    assert shell[:, 0].min() == pytest.approx(-15 - SUNK) and shell[:, 0].max() == pytest.approx(15)
    both = span((west, shapely.box(15, -10, 40, 10)))
    assert both.columns == () and "columns" not in by_name(build_skybridge(both, LEVEL))
    assert span((west,), supports="both").on_columns == (True, True)


def test_piers_stand_on_a_median():
    median = shapely.difference(ROAD, shapely.box(-1, -100, 1, 100))
    found = find_span(bridge(width=20, piers=[15]), median, (), LEVEL)
    middle = [column for column in found.columns if abs(column[0]) < 5]
    assert sorted(round(y, 6) for _, y in middle) == pytest.approx([-9.2, -9.2 + 18.4 / 3, 9.2 - 18.4 / 3, 9.2])
    with pytest.raises(ValueError, match=r"a column at \(3\.0, -9\.2\) stands on a road"):
        find_span(bridge(width=20, piers=[18]), median, (), LEVEL)


def test_soffit_counts_from_the_highest_point_of_the_road():
    found = find_span(bridge(), ROAD, (), Ground([sheet()]))
    highest = 0.03 * 7.75 + 0.02 * 4  # a quarter of a meter off the kerbs, whose top is no road
    assert found.soffit == pytest.approx(highest + 6.5, abs=1e-3)


@pytest.mark.parametrize(
    ("keys", "buildings", "message"),
    [
        ({"soffit": 4.9}, (), "greater than or equal to 5"),
        ({"from": [-8.5, 0]}, (), r"a column at \(-7\.7, -3\.2\) stands on a road"),
        ({}, (shapely.box(-40, -10, -13, 10),), "a building placed by hand stands in its way"),
        ({"to": [400, 0]}, (), "reaches beyond the terrain"),
        ({"to": [-14, 0]}, (), r"1\.0 m long; 3 m or more"),
    ],
)
def test_skybridges_that_cannot_be_are_refused(keys, buildings, message):
    with pytest.raises(ValueError, match=message):
        span(buildings, **keys)
