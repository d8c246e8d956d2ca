"""The gallery of scenarios: one picture, weathers in rows and cameras in columns."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mmw.cli.scenario_gallery import main
from mmw.viz.stills import scenario_gallery
from mmw.viz.stills.image_files import GAP_PX, join_tiles
from mmw.viz.stills.scenario_gallery import draw_scenarios

NAME = "town07_single_lane"


def test_tiles_are_in_rows_and_columns() -> None:
    tiles = [[np.full((3, 5, 3), 10 * (2 * i + k), dtype=np.uint8) for k in range(2)] for i in range(3)]
    whole = np.asarray(join_tiles(tiles))
    assert whole.shape == (3 * 3 + 2 * GAP_PX, 2 * 5 + GAP_PX, 3)
    for i in range(3):
        for k in range(2):
            top, left = i * (3 + GAP_PX), k * (5 + GAP_PX)
            np.testing.assert_array_equal(whole[top : top + 3, left : left + 5], tiles[i][k])
    assert (whole[3 : 3 + GAP_PX] == 255).all() and (whole[:, 5 : 5 + GAP_PX] == 255).all()


@pytest.mark.slow
def test_a_scenario_is_drawn_in_three_weathers_by_five_cameras(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(scenario_gallery, "TILE_PX", (48, 32))
    (path,) = draw_scenarios(tmp_path, [NAME], frame=2, samples=1, device="cpu")
    assert path == tmp_path / f"{NAME}.jpg" and str(path) in capsys.readouterr().out
    with Image.open(path) as image:
        whole = np.asarray(image).astype(float)
    assert whole.shape == (3 * 32 + 2 * GAP_PX, 5 * 48 + 4 * GAP_PX, 3)
    rows = [whole[i * (32 + GAP_PX) :][:32] for i in range(3)]
    tiles = [[row[:, k * (48 + GAP_PX) :][:, :48] for k in range(5)] for row in rows]
    for row in tiles:
        for tile in row:
            assert tile.std() > 4
    blue = [max(float((tile[:6, :, 2] - tile[:6, :, 0]).mean()) for tile in row) for row in tiles]
    assert blue[0] > 30 > 15 > max(blue[1:])  # only the sun has a blue sky
    for k in range(5):
        sunny, rainy, foggy = (row[k] for row in tiles)
        assert min(np.abs(sunny - rainy).mean(), np.abs(rainy - foggy).mean()) > 5
    assert all(np.abs(tiles[0][0] - tiles[0][k]).mean() > 5 for k in range(1, 5))


def test_impossible_pictures_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["atlantis", "--out", str(tmp_path), "--device", "cpu"]) == 2
    assert "'atlantis': is not shipped; those are town03_crossroad_slope" in capsys.readouterr().err
