"""Street views: eyes stand on streets or on the ground, not on roofs, below buildings or at the end of the world."""

from pathlib import Path

import numpy as np
import pytest

from mmw.core.errors import InputError
from mmw.scene.device_scene import DeviceScene
from mmw.scene.reader import read_stage
from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.viz.stills.street_views import EYE_M, choose_views
from tests.fixtures.circuit import FIELD_Z_M, INNER_M, OUTER_M, add_block, ring_lanes, shown_material, write_circuit
from tests.fixtures.device_rays import loaded
from tests.fixtures.stages import add_box, add_polygons, new_stage


def scene_of(path: Path) -> DeviceScene:
    return loaded(read_stage(path, range(1), ["sunny"]), "cpu", [0])


def test_views_look_along_lanes_and_lie_apart(town: Path) -> None:
    views = choose_views(scene_of(town), LaneGraph(ring_lanes()))
    assert len(views) == 2
    for x, y, z, yaw in views:
        assert np.hypot(x, y) == pytest.approx(30.0, abs=0.05)
        assert z == pytest.approx(EYE_M)
        ahead = np.degrees(np.arctan2(x, -y))
        assert abs((yaw - ahead + 180) % 360 - 180) < 2.5


def test_lanes_that_end_or_pass_below_a_building_give_no_view(tmp_path: Path) -> None:
    stage = write_circuit(tmp_path / "town.usda")
    add_block(stage, "/World/Gate", (30, 60, 6), (-30, 0, 8))  # over the last meters of the lane north
    stage.Save()
    end = Lane("end", np.array([[34.0, 0.0, 0.0], [58.0, 0.0, 0.0]]), 3.5, 10.0)
    views = choose_views(scene_of(tmp_path / "town.usda"), LaneGraph({**ring_lanes(), "end": end}))
    assert [round(x) for x, _, _, _ in views] == [21]  # of the lane south, 24 m before its end at (30, 0)


def test_without_lanes_eyes_stand_on_roads(town: Path) -> None:
    views = choose_views(scene_of(town), None)
    assert len(views) == 3
    for x, y, z, _ in views:
        assert INNER_M < np.hypot(x, y) < OUTER_M
        assert z == pytest.approx(EYE_M, abs=1e-4)


def test_without_labels_eyes_stand_on_the_lowest_ground(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "world.usda")
    field = np.array([(x, y, FIELD_Z_M) for x, y in ((-60.0, -60.0), (60.0, -60.0), (60.0, 60.0), (-60.0, 60.0))])
    concrete = shown_material(stage, "concrete")
    add_polygons(stage, "/World/Field", field, [[0, 1, 2, 3]], concrete)
    for name, x in (("One", -27.0), ("Two", 27.0)):  # roofs are half of what is seen from above
        add_box(stage, f"/World/{name}", (40, 90, 12), (x, 0, 5.8), concrete)
    stage.Save()
    views = choose_views(scene_of(tmp_path / "world.usda"), None)
    assert len(views) == 3
    for x, y, z, _ in views:
        assert z == pytest.approx(FIELD_Z_M + EYE_M, abs=1e-4)
        assert not (7.0 < abs(x) < 47.0 and abs(y) < 45.0)


def test_a_world_without_ground_asks_for_an_eye(tmp_path: Path) -> None:
    stage = new_stage(tmp_path / "wall.usda")
    wall = np.array([(0.0, -5.0, 0.0), (0.0, 5.0, 0.0), (0.0, 5.0, 4.0), (0.0, -5.0, 4.0)])
    add_polygons(stage, "/World/Wall", wall, [[0, 1, 2, 3]], shown_material(stage, "concrete"))
    stage.Save()
    with pytest.raises(InputError, match=r"no level surface.*--at X Y Z YAW"):
        choose_views(scene_of(tmp_path / "wall.usda"), None)
