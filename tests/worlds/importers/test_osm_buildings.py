"""Windows of imported buildings, and buildings that overlap each other or the carriageway."""

from dataclasses import replace

import numpy as np
import pytest
import shapely

from mmw.core.mesh import merge
from mmw.worlds.importers.osm.building_overlaps import HEADROOM, keep_apart
from mmw.worlds.importers.osm.buildings import Body, build_body
from mmw.worlds.importers.osm.windows import LAYOUT, PANE, window_frames
from tests.fixtures.meshes import area, corners_of, is_closed, volume
from tests.fixtures.plans import TOUCHING


def body(name: str, x0: float, y0: float, x1: float, y1: float, low: float, high: float, storeys: int = 0) -> Body:
    plan = shapely.orient_polygons(shapely.box(x0, y0, x1, y1))
    return Body(name, plan, low, high, 0.0, "flat", "concrete_facade", "concrete_roof", storeys)


def solid(bodies: list[Body]) -> float:
    return sum(each.plan.area * (each.eaves - each.bottom) for each in bodies)


@pytest.mark.parametrize("storeys", [1, 4])
@pytest.mark.parametrize("windows", ["single", "bands"])
def test_glass_has_the_area_of_the_windows_and_the_solid_stays_closed(storeys: int, windows: str) -> None:
    tower = replace(body("w1", 0, 0, 18, 9, -0.5, 3.0 * storeys), storeys=storeys)
    parts = build_body(tower, {}, windows)
    glass = [part for part in parts if part.material == PANE]
    if windows == "single":  # 4 and 2 bays, the window's share of a wall's width is the same for all
        wide = LAYOUT.window_fraction * 54
    else:
        wide = 54 - 4 * 2 * 0.5
    high = 3.0 - min(LAYOUT.sill_m, 1.05) - min(LAYOUT.head_m, 0.75)
    assert area(merge(glass)) == pytest.approx(storeys * wide * high, rel=1e-6)
    assert is_closed(corners_of(parts))
    assert volume(merge(parts)) == pytest.approx(solid([tower]), rel=1e-6)
    count = sum(len(part.faces) for part in parts)
    assert count <= 8 * (storeys * 12 + 2) + 4


def test_walls_too_narrow_or_storeys_too_low_have_no_windows() -> None:
    assert len(window_frames(1.0, 0, 3, 1, bands=False)) == 0
    assert len(window_frames(10.0, 0, 3, 2, bands=False)) == 0
    assert len(window_frames(10.0, 0, 30, 1, bands=False)) == 0


def test_what_two_buildings_share_is_taken_from_the_lower() -> None:
    low, high = body("w1", 0, 0, 10, 10, 0, 6), body("w2", 6, -2, 16, 8, 0, 12)
    apart, notes = keep_apart([low, high], None)
    assert solid(apart) == pytest.approx(100 * 6 + 100 * 12 - 4 * 8 * 6)  # the union of two boxes
    assert high in apart and len(notes) == 1
    assert max(shapely.intersection(a.plan, b.plan).area for a in apart for b in apart if a is not b) < 1e-6


def test_a_part_above_keeps_what_is_below_it() -> None:
    base, top = body("w1", 0, 0, 10, 10, 0, 6), body("w2", 2, 2, 8, 8, 4, 12)
    apart, _ = keep_apart([base, top], None)
    assert solid(apart) == pytest.approx(100 * 6 + 36 * 8 - 36 * 2)
    names = [each.name for each in apart]
    assert len(set(names)) == len(names)


def test_a_building_over_lanes_gets_a_passage_and_one_beside_them_is_trimmed() -> None:
    road = shapely.box(-50, 4, 50, 11)
    over, beside = body("w1", 0, 0, 10, 15, -0.5, 12, 4), body("w2", 20, 10.5, 30, 20, -0.5, 9, 3)
    apart, notes = keep_apart([over, beside], road)
    assert "2 buildings" in notes[0]
    for each in apart:
        assert each.bottom >= HEADROOM or shapely.intersection(each.plan, road).area < 1e-6
    assert solid(apart) == pytest.approx(solid([over, beside]) - 70 * (HEADROOM + 0.5) - 10 * 0.5 * 9.5)


def test_buildings_that_touch_or_lie_apart_stay() -> None:
    every = [body("w1", 0, 0, 10, 10, 0, 6), body("w2", 10, 0, 20, 10, 0, 9), body("w3", 40, 0, 50, 10, 0, 9)]
    apart, notes = keep_apart(every, shapely.box(-50, -20, 50, -10))
    assert apart == every and not notes
    np.testing.assert_equal(len(keep_apart([], None)[0]), 0)


def test_a_building_that_touches_a_carriageway_gets_no_passage() -> None:
    """A wall and a kerb that are one line but for a last bit."""
    plan, road = map(shapely.Polygon, TOUCHING)
    beside = replace(body("w1", 0, 0, 1, 1, -0.5, 9), plan=shapely.orient_polygons(plan))
    assert keep_apart([beside], road) == ([beside], [])
