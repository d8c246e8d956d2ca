"""Base stations on roofs stand on the highest surface at (x, y), which has to be a building's."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mmw.config import Config
from mmw.core.errors import InputError
from mmw.scene.prepare import prepare_scenario
from mmw.scene.reader import read_stage
from mmw.scene.roof_places import station_poses

STAGE = """#usda 1.0
( metersPerUnit = 1
  upAxis = "Z" )
def Cube "House" ( prepend apiSchemas = ["SemanticsLabelsAPI:class"] )
{
    double size = 2
    double3 xformOp:scale = (5, 5, 6)
    double3 xformOp:translate = (10, 0, 6)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    token[] semantics:labels:class = ["building"]
}
def Cube "Tree" ( prepend apiSchemas = ["SemanticsLabelsAPI:class"] )
{
    double size = 2
    double3 xformOp:translate = (-10, 0, 1)
    uniform token[] xformOpOrder = ["xformOp:translate"]
    token[] semantics:labels:class = ["vegetation"]
}
"""


def config(folder: Path, **station: Any) -> Config:
    (folder / "own.usda").write_text(STAGE)
    return Config(
        scenarios=[{"name": "own", "stage": "own.usda", "base_stations": [{"height_from": "roof", **station}]}],
        frames={"count": 1}, sensors=[], channel={"enabled": False}, materials={"*": "itu_concrete"},
    )  # fmt: skip


def poses(folder: Path, **station: Any) -> list[tuple[str, np.ndarray]]:
    made = config(folder, **station)
    return station_poses(made, made.scenarios[0], folder / "own.usda")


def test_foot_is_on_the_roof(tmp_path: Path) -> None:
    ((name, pose),) = poses(tmp_path, position_m=[12, 3, 0.5], yaw_deg=90)
    assert name == "bs_1" and pose[:3] == pytest.approx([12, 3, 12.5], abs=1e-5)
    ((_, pose),) = poses(tmp_path, position_m=[-10, 0, 25], height_from="world")
    assert pose[:3] == pytest.approx([-10, 0, 25])


@pytest.mark.parametrize(("x", "found"), [(-10, "/Tree .vegetation."), (40, "nothing")])
def test_no_building_is_an_error(tmp_path: Path, x: float, found: str) -> None:
    with pytest.raises(InputError, match=rf"'bs_1'.* needs a building below it; .* is {found}; move it"):
        poses(tmp_path, position_m=[x, 0, 0])


def test_own_stages_get_base_stations_in_a_layer(tmp_path: Path) -> None:
    made = config(tmp_path, position_m=[12, 3, 0])
    path = prepare_scenario(made, made.scenarios[0], tmp_path, tmp_path / "out")
    arrays = read_stage(path, range(1), made.variants, material_map=made.materials)
    (actor,) = arrays.actors
    assert (actor.name, actor.role) == ("bs_1", "bs")
    assert arrays.poses[0, 0, :3] == pytest.approx([12, 3, 12], abs=1e-5)
