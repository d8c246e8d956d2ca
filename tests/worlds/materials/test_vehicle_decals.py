"""Pictures of the material library: the same each time, as bright as their materials, each in its own place."""

import numpy as np
import pytest
from pxr import Usd, UsdShade

from mmw.core.resources import assets_dir
from mmw.worlds.materials.vehicle_decals import GLYPHS, PICTURES, PLATE_CELLS, PLATE_TEXTS, cell, write_text

FOLDER = assets_dir() / "materials"


@pytest.mark.parametrize("name", PICTURES)
def test_picture_is_read_once_over_st(name: str) -> None:
    stage = Usd.Stage.Open(str(FOLDER / "materials.usda"))
    shader = UsdShade.Material(stage.GetPrimAtPath(f"/Materials/{name}")).ComputeSurfaceSource()[0]
    for channel, is_connected in (("diffuseColor", True), ("emissiveColor", PICTURES[name].shines)):
        sources, _ = shader.GetInput(channel).GetConnectedSources()
        assert bool(sources) == is_connected
        if sources:
            texture = UsdShade.Shader(sources[0].source.GetPrim())
            assert texture.GetIdAttr().Get() == "UsdUVTexture"
            reader = UsdShade.Shader(texture.GetInput("st").GetConnectedSources()[0][0].source.GetPrim())
            assert reader.GetIdAttr().Get() == "UsdPrimvarReader_float2"


def test_plates_do_not_overlap_and_differ() -> None:
    sheet = PICTURES["car_plate"].draw().astype(float)
    height, width = sheet.shape[:2]
    cut = []
    for index in range(len(PLATE_TEXTS)):
        left, low, right, high = cell(index, PLATE_CELLS)
        rows = slice(round((1 - high) * height), round((1 - low) * height))
        cut.append(sheet[rows, round(left * width) : round(right * width)])
    assert sum(one.size for one in cut) == sheet.size and len(set(PLATE_TEXTS)) == len(PLATE_TEXTS)
    for a, one in enumerate(cut):
        assert all(np.abs(one - other).mean() > 5.0 for other in cut[a + 1 :])


def test_every_character_looks_different() -> None:
    drawn = {}
    for character in set(GLYPHS) - {" ", "0"}:  # O and 0 are alike
        canvas = np.zeros((32, 24, 3))
        write_text(canvas, character, (4, 4, 20, 28), (255, 255, 255), 0.8)
        drawn[character] = canvas[..., 0]
    for a, one in drawn.items():
        assert 0.05 < (one > 128).mean() < 0.6
        assert all(np.abs(one - other).mean() > 5.0 for b, other in drawn.items() if b != a)
