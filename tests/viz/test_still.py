"""`mmw view --still`: the very image of a run, any eye, any weather; each bad argument is one line."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mmw.__main__ import main
from mmw.cli.run import main as run
from mmw.dataset import open_dataset
from tests.fixtures.stages import write_scenario

CONFIG = """
scenarios: [{name: street, stage: scenario.usda}]
weathers: [rainy, mist]
air: {mist: {visibility_m: 150, variant: rainy}}
frames: {start: 1, count: 2}
channel: {enabled: false}
sensors:
  - {type: rgb, name: front, on: [cav], width_px: 64, height_px: 48, format: png, image: {noise: {enabled: true}},
     mount: {cav: {position_m: [2.6, 0, 1.2]}}}
  - {type: depth, name: depth, width_px: 16, height_px: 16}
"""
SMALL = ["--width", "64", "--height", "48", "--samples", "1", "--device", "cpu"]


def pixels(path: Path) -> np.ndarray:
    with Image.open(path) as image:
        return np.asarray(image.convert("RGB")).astype(int)


@pytest.fixture(scope="module")
def config(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("still")
    write_scenario(folder)
    (folder / "c.yaml").write_text(CONFIG)
    return folder / "c.yaml"


def test_an_agents_camera_gives_the_image_of_the_run(
    config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(["--config", str(config), "--out", str(tmp_path / "d"), "--device", "cpu"]) == 0
    capsys.readouterr()
    out = tmp_path / "new" / "a.png"
    command = ["view", "--still", str(out), "--config", str(config), "--device", "cpu"]
    for weather in ("rainy", "mist"):
        view = ["--agent", "cav_1", "--camera", "front", "--frame", "2", "--weather", weather]
        assert main([*command, *view]) == 0
        assert capsys.readouterr().out == f"{out}\n"
        view = open_dataset(tmp_path / "d").frame("street", weather, 2).agents["cav_1"].views["front"]
        np.testing.assert_array_equal(pixels(out), view.rgb)
        assert pixels(out).std() > 5


def test_views_of_a_scenario(config: Path, tmp_path: Path) -> None:
    """The first CAV is followed by default, in the first weather and frame; a preset is a weather of any scenario."""
    images = {}
    for name, arguments in {
        "default": [], "cav": ["--follow", "cav_1", "--frame", "1", "--weather", "rainy"], "later": ["--frame", "2"],
        "other": ["--follow", "veh_003"], "fog": ["--weather", "heavy_fog"],
        "eye": ["--eye", "-20", "2.5", "3", "--look-at", "20", "0", "0"], "wide": ["--width", "96"],
    }.items():  # fmt: skip
        out = tmp_path / f"{name}.png"
        assert main(["view", "--still", str(out), "--config", str(config), *SMALL, *arguments]) == 0
        images[name] = pixels(out)
    np.testing.assert_array_equal(images["default"], images["cav"])
    assert images["wide"].shape == (48, 96, 3)
    for name in ("later", "other", "fog", "eye"):
        assert np.abs(images[name] - images["default"]).max() > 20, name
    far = slice(18, 28)  # rows below the horizon
    assert images["fog"][far].std() < 0.5 * images["default"][far].std()


def test_a_town_is_seen_from_its_best_view_and_any_eye(town: Path, tmp_path: Path) -> None:
    out = tmp_path / "a.jpg"
    assert main(["view", "--still", str(out), "--town", str(town), *SMALL]) == 0
    assert pixels(out).shape == (48, 64, 3) and pixels(out).std() > 5
    eye = ["--eye", "30", "20", "9", "--look-at", "45", "20", "9"]
    assert main(["view", "--still", str(tmp_path / "b.png"), "--town", str(town), *SMALL, *eye]) == 0
    middle, corner = pixels(tmp_path / "b.png")[20:28, 28:36], pixels(tmp_path / "b.png")[:4, :4]
    assert middle[..., 2].mean() < corner[..., 2].mean() - 20  # a gray tower before a blue sky


@pytest.mark.parametrize(
    ("arguments", "part"),
    [
        (["--config", "c.yaml"], "--still OUT.png is needed"),
        (["--still", "a.gif", "--config", "c.yaml"], "must end in .png"),
        (["--still", "a.png"], "exactly one of --config FILE and --town NAME"),
        (["--still", "a.png", "--config", "c.yaml", "--town", "town03"], "exactly one of"),
        (["--still", "a.png", "--town", "town03", "--scenario", "x"], "--scenario x"),
        (["--still", "a.png", "--town", "atlantis"], "atlantis"),
        (["--still", "a.png", "--town", "town03", "--agent", "cav_1", "--camera", "front"], "--camera front"),
        (["--still", "a.png", "--town", "town03", "--weather", "snow"], "--weather snow"),
        (["--still", "a.png", "--config", "none.yaml"], "none.yaml"),
        (["--still", "a.png", "--config", "c.yaml", "--scenario", "x"], "scenario = x: there are street"),
        (["--still", "a.png", "--config", "c.yaml", "--weather", "snow"], "(rainy, mist)"),
        (["--still", "a.png", "--config", "c.yaml", "--agent", "cav_1"], "without --camera"),
        (["--still", "a.png", "--config", "c.yaml", "--eye", "0", "0", "1"], "without --look-at"),
        (["--still", "a.png", "--config", "c.yaml", "--look-at", "0", "0", "1"], "without --eye"),
        (["--still", "a.png", "--config", "c.yaml", "--follow", "cav_1", "--agent", "a", "--camera", "b"], "one view"),
        (["--still", "a.png", "--config", "c.yaml", "--agent", "cav_1", "--camera", "depth"], "it has front"),
        (["--still", "a.png", "--config", "c.yaml", "--agent", "rsu_1", "--camera", "front"], "those that do: cav_1"),
        (["--still", "a.png", "--config", "c.yaml", "--follow", "cav_7"], "no actor 'cav_7' in frame 1; it has cav_1"),
        (["--still", "a.png", "--config", "c.yaml", "--frame", "-1"], "--frame -1"),
        (["--still", "a.png", "--config", "c.yaml", "--frame", "77"], "frame 77 is outside"),
        (["--still", "a.png", "--config", "c.yaml", "--width", "3"], "width_px"),
        (["--still", "a.png", "--config", "c.yaml", "--device", "cuda:99"], "cuda:99"),
        (["--still", "a.png", "--config", "c.yaml", "--eye", "1", "2", "3", "--look-at", "1", "2", "3"], "both"),
    ],
)
def test_each_bad_argument_is_one_line(
    config: Path, arguments: list[str], part: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(config.parent)
    assert main(["view", *arguments]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1 and part in lines[0], lines
    assert not (config.parent / "a.png").exists()
