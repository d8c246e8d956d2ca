"""Stripes of marked crossings of OpenStreetMap: areas by hand."""

from pathlib import Path

import numpy as np
import pytest
import shapely

from mmw.worlds.importers.osm.crossings import ACROSS, BEFORE, stripe_crossings
from mmw.worlds.importers.osm.read_osm import read_osm
from mmw.worlds.importers.osm.xml import read_extract
from mmw.worlds.importers.sumo.plan import STOP_LINE, ZEBRA
from tests.fixtures.osm_files import ORIGIN, Map, needs_netconvert

ROAD = {"highway": "residential", "lanes": "2", "sidewalk": "separate"}
ASPHALT = shapely.box(-100.0, -4.0, 100.0, 4.0)


def tagged(town: Map, text: str, at: tuple[float, float], **tags: str) -> str:
    """Return the text of a town whose node at a place has tags."""
    inner = "".join(f'<tag k="{k.replace("__", ":")}" v="{v}"/>' for k, v in tags.items())
    end = text.index("/>", text.index(f'<node id="{town.node(*at)}" '))
    return f"{text[:end]}>{inner}</node>{text[end + 2 :]}"


def striped(tmp_path: Path, town: Map, at: tuple[float, float], made: tuple = (), **tags: str) -> tuple:
    """Return the stripes of a town, and their number, whose node at a place has tags besides `highway=crossing`."""
    path = tmp_path / "crossing.osm"
    path.write_text(tagged(town, town.text(), at, highway="crossing", **tags))
    return stripe_crossings(read_extract(path, ORIGIN), ASPHALT, made)


def street() -> Map:
    town = Map()
    town.way([(-100, 0), (10, 0), (100, 0)], ROAD)
    return town


def test_a_node_is_striped_across_its_road(tmp_path: Path) -> None:
    # 8 m of asphalt hold 8 stripes of 0.5 m with gaps of 0.5 m, 0.25 m to both edges
    area, count = striped(tmp_path, street(), (10, 0), crossing="zebra")
    assert count == 1 and len(area.geoms) == 8
    assert area.area == pytest.approx(8 * ZEBRA * ACROSS, rel=1e-3)
    np.testing.assert_allclose(area.bounds, (8.0, -3.75, 12.0, 3.75), atol=0.01)


@pytest.mark.parametrize(
    "tags", [{"crossing": "unmarked"}, {"crossing": "traffic_signals", "crossing__markings": "no"}]
)
def test_without_markings_there_are_no_stripes(tmp_path: Path, tags: dict[str, str]) -> None:
    area, count = striped(tmp_path, street(), (10, 0), **tags)
    assert count == 0 and area.is_empty


def test_a_crossing_of_netconvert_nearby_counts_first(tmp_path: Path) -> None:
    near, far, along = ([(x, -4.0), (x, 4.0)] for x in (15.0, 40.0, 10.0))
    assert striped(tmp_path, street(), (10, 0), (np.array(near),))[1] == 0
    assert striped(tmp_path, street(), (10, 0), (np.array(far),))[1] == 1
    assert striped(tmp_path, street(), (10, 0), (np.array(along)[:, ::-1],))[1] == 1  # another direction


def test_a_way_is_striped_along_its_line(tmp_path: Path) -> None:
    town = street()
    town.way([(4, -6), (10, 0), (16, 6)], {"highway": "footway", "footway": "crossing", "width": "3"})
    area, count = striped(tmp_path, town, (10, 0), crossing="marked")
    assert count == 1
    (x0, y0), (x1, y1) = np.split(np.array(area.bounds), 2)
    assert (x0 + x1, y0 + y1) == pytest.approx((20.0, 0.0), abs=0.1)
    assert area.area == pytest.approx(0.5 * 8 * np.sqrt(2) * 3, rel=0.1)  # half of what the way covers
    spine = shapely.LineString([(6, -4), (14, 4)])
    assert all(stripe.distance(spine) < 1e-6 for stripe in area.geoms)


@pytest.mark.parametrize("x", [-14.0, -7.0])
def test_vehicles_stop_before_a_crossing(tmp_path: Path, x: float) -> None:
    """Half a crossing and 1 m before its middle, also where it lies in netconvert's junction."""
    needs_netconvert()
    town = Map()
    town.way([(-100, 0), (x, 0), (0, 0), (100, 0)], ROAD)
    town.way([(0, -80), (0, 0), (0, 80)], ROAD)
    text = tagged(town, town.text(), (0.0, 0.0), highway="traffic_signals")
    path = tmp_path / "lights.osm"
    path.write_text(tagged(town, text, (x, 0.0), highway="crossing", crossing="traffic_signals"))
    scene = read_osm(path, ORIGIN, traffic=True)
    assert scene.lanes is not None
    lane = next(lane for lane in scene.lanes.lanes.values() if lane.points[0, 0] < -99)
    assert lane.points[-1, 0] == pytest.approx(x - 0.5 * ACROSS - BEFORE, abs=0.02) and len(lane.successors) == 3
    paint = [part.points[part.faces][:, :, :2] for part in scene.parts if part.label == "road_line"]
    stop = shapely.union_all(shapely.polygons(np.concatenate(paint)), grid_size=1e-4)
    stop = shapely.intersection(stop, shapely.box(-30.0, -4.0, x - 0.5 * ACROSS - 0.5 * BEFORE, -0.5))
    np.testing.assert_allclose(np.array(stop.bounds)[[0, 2]], lane.points[-1, 0] + np.array([-STOP_LINE, 0]), atol=0.02)
    for name in lane.successors:
        through = scene.lanes.lanes[name]
        np.testing.assert_array_equal(through.points[0], lane.points[-1])
        assert through.signal and np.diff(through.station).max() <= 0.51
