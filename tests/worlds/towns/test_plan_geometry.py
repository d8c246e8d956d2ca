"""Areas in plan: what is left of one where another is taken away, and what two share."""

import numpy as np
import pytest
import shapely

from mmw.worlds.towns.plan_geometry import intersect_areas, subtract_area
from tests.fixtures.plans import TOUCHING


def test_what_collapses_on_the_grid_is_dropped() -> None:
    """A strip of 30 micrometers is a line on a grid of 0.1 mm; the rest is 100 - 4 m2 and goes into another overlay."""
    spiked = shapely.Polygon([(0, 0), (10, 0), (10, 5), (20, 5), (20, 5.00003), (10, 5.00003), (10, 10), (0, 10)])
    rest = subtract_area(spiked, shapely.box(-5, -5, 2, 2), 1e-4)
    assert {part.geom_type for part in shapely.get_parts(rest)} == {"Polygon"}
    assert rest.area == pytest.approx(96.0, abs=1e-3)
    assert subtract_area(rest, shapely.box(4, 4, 5, 5), 1e-4).area == pytest.approx(95.0, abs=1e-3)


def test_nothing_is_left_of_a_line() -> None:
    """A sliver that collapses as a whole leaves an empty area."""
    assert subtract_area(shapely.box(0, 0, 10, 3e-5), shapely.box(2, -1, 3, 1), 1e-4).is_empty


def test_areas_that_touch_share_nothing() -> None:
    first, second = map(shapely.Polygon, TOUCHING)
    assert intersect_areas(first, second).area == 0.0
    toward = 0.1 * np.subtract(TOUCHING[0][0], TOUCHING[0][3])  # 0.25 m into the first
    moved = shapely.Polygon(np.array(TOUCHING[1]) + toward)
    assert intersect_areas(first, moved).area == pytest.approx(5.0 * 0.25, abs=1e-5)
