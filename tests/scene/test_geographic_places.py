"""Units given by latitude and longitude stand where an imported town has that place."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Sdf

from mmw.config import Config
from mmw.core.errors import InputError
from mmw.core.georeference import Georeference
from mmw.scene.geographic_places import place_units
from mmw.scene.prepare import prepare_scenario
from mmw.scene.reader import read_stage
from mmw.usd.georeference import read_georeference, write_georeference
from mmw.usd.open_stage import open_stage

STAGE = """#usda 1.0
( metersPerUnit = 1
  upAxis = "Z" )
def Cube "House"
{
    double size = 10
}
"""
PLACE = Georeference(48.1, 11.6, 0.01, 0.9996)


def config(**unit: Any) -> Config:
    scenario = {"name": "own", "stage": "own.usda", "rsus": [{"yaw_deg": 90, **unit}]}
    return Config(
        scenarios=[scenario], frames={"count": 1}, sensors=[], channel={"enabled": False},
        materials={"*": "itu_concrete"},
    )  # fmt: skip


def write_stage(folder: Path, place: Georeference | None = PLACE) -> Path:
    (folder / "own.usda").write_text(STAGE)
    layer = Sdf.Layer.FindOrOpen(str(folder / "own.usda"))
    write_georeference(layer, place)
    layer.Save()
    return folder / "own.usda"


def test_a_unit_stands_at_its_latitude_and_longitude(tmp_path: Path) -> None:
    source = write_stage(tmp_path)
    assert read_georeference(open_stage(source)) == PLACE
    lat_lon = PLACE.degrees([[25.0, -7.0]])[0].tolist()
    made = config(lat_lon=lat_lon, position_m=[0, 0, 6])
    stage = prepare_scenario(made, made.scenarios[0], tmp_path, tmp_path / "out")
    arrays = read_stage(stage, range(1), made.variants, material_map=made.materials)
    assert [actor.name for actor in arrays.actors] == ["rsu_1"]
    np.testing.assert_allclose(arrays.poses[0, 0, :3], (25.0, -7.0, 6.0), atol=1e-5)
    placed = place_units(made.scenarios[0], source).rsus[0]
    np.testing.assert_allclose(placed.position_m, (25.0, -7.0, 6.0), atol=1e-6)
    assert placed.lat_lon is None


def test_towns_without_an_origin_and_units_without_a_place(tmp_path: Path) -> None:
    source = write_stage(tmp_path, None)
    scenario = config(lat_lon=[48.1, 11.6]).scenarios[0]
    with pytest.raises(InputError, match=r"scenario 'own': 'rsu_1': .*need a town with a geographic origin"):
        place_units(scenario, source)
    with pytest.raises(ValueError, match=r"has no place; give position_m: \[x, y, z\] or lat_lon"):
        config()
    with pytest.raises(ValueError, match="latitude comes first"):
        config(lat_lon=[111.6, 48.1])
