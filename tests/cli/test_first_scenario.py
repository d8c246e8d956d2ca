"""The configuration that an import prints: a busy place, a count that fits, a mast with a view beside the road."""

import numpy as np

from mmw.cli.first_scenario import busiest_place, first_scenario
from mmw.cli.mast_place import mast_place
from mmw.core.mesh import TriangleMesh
from mmw.worlds.importers.imported_scene import ImportedScene
from mmw.worlds.towns.mesh_part import MeshPart
from tests.fixtures.traffic_towns import make_town

NODES = {"X": (0.0, 0.0), "E": (130.0, 0.0), "N": (0.0, 130.0), "W": (-130.0, 0.0), "Y": (130.0, 130.0)}
TOWN = make_town(NODES, [("X", "E", 1, False, [], 0), ("X", "N", 1, False, [], 0), ("X", "W", 1, False, [], 0),
                         ("E", "Y", 1, False, [], 0)])  # fmt: skip


def box(path: str, label: str, low: tuple[float, float, float], high: tuple[float, float, float]) -> MeshPart:
    """Return a box without a bottom or, of no height, a plate."""
    (x, y, z), (u, v, w) = low, high
    points = np.array([(x, y, z), (u, y, z), (u, v, z), (x, v, z), (x, y, w), (u, y, w), (u, v, w), (x, v, w)], float)
    faces = [(4, 5, 6), (4, 6, 7)]
    for a, b in ((0, 1), (1, 2), (2, 3), (3, 0)) if w > z else ():
        faces += [(a, b, b + 4), (a, b + 4, a + 4)]
    return MeshPart.of(path, TriangleMesh(points, np.array(faces)), "asphalt", label)


ROADS = [box("a", "road", (-130, -4, 0), (134, 4, 0)), box("b", "road", (-4, -4, 0), (4, 130, 0)),
         box("c", "road", (126, -4, 0), (134, 130, 0))]  # fmt: skip


def test_center_is_the_junction_with_the_most_lanes() -> None:
    places = np.concatenate([lane.points[::12] for lane in TOWN.lanes.values() if not lane.junction])
    assert np.linalg.norm(busiest_place(TOWN, places)[:2]) < 4.0


def test_scenario_fits_the_roads() -> None:
    first = first_scenario(ImportedScene(ROADS, lanes=TOWN))
    assert first is not None
    assert first.vehicles == 20 and first.cavs == 3
    assert np.hypot(*first.center[:2]) < 4.0
    assert first.mast is not None
    x, y, z = first.mast
    assert z == 0.0 and np.hypot(x, y) < 12.0
    assert min(abs(x), abs(y)) >= 5.0 or y <= -5.0, "at least 1 m from the roads, which are 8 m wide"
    assert np.isclose(np.radians(first.yaw), np.arctan2(first.center[1] - y, first.center[0] - x), atol=0.02)


def test_few_places_few_vehicles() -> None:
    short = make_town({"A": (0.0, 0.0), "B": (60.0, 0.0)}, [("A", "B", 1, True, [], 0)])
    first = first_scenario(ImportedScene([box("a", "road", (0, -4, 0), (60, 4, 0))], lanes=short))
    assert first is not None
    assert (first.vehicles, first.cavs) == (1, 1)
    tiny = make_town({"A": (0.0, 0.0), "B": (40.0, 0.0)}, [("A", "B", 1, True, [], 0)])
    assert first_scenario(ImportedScene([], lanes=tiny)) is None
    assert first_scenario(ImportedScene([])) is None


def test_mast_avoids_buildings_and_looks_past_them() -> None:
    """A house in the quarter where the mast would stand, and a wall that hides half of the lanes from another."""
    free = mast_place(ROADS, TOWN, np.zeros(3))
    assert free is not None
    house = box("house", "building", (free[0] - 4, free[1] - 4, 0), (free[0] + 4, free[1] + 4, 9))
    other = mast_place([*ROADS, house], TOWN, np.zeros(3))
    assert other is not None
    assert max(abs(other[:2] - free[:2])) > 5.0


def test_no_place_no_mast() -> None:
    everywhere = [box("a", "road", (-400, -400, 0), (400, 400, 0))]
    assert mast_place(everywhere, TOWN, np.zeros(3)) is None
