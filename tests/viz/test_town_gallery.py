"""Pictures of a town: the files, their sizes, and that they show what is there."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pxr import Gf, Sdf, UsdGeom

from mmw.__main__ import main
from mmw.viz.plots.lane_map import scenarios_of
from mmw.viz.stills.town_gallery import draw_town, selected_weather
from tests.fixtures.circuit import add_block, write_circuit
from tests.fixtures.stages import write_town

MAX_BYTES = 200_000


def pixels(path: Path) -> np.ndarray:
    """Return the gray values of a picture, shape [height, width]."""
    with Image.open(path) as image:
        return np.asarray(image.convert("L"), dtype=float)


@pytest.fixture(scope="module")
def pictures(town: Path, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    return draw_town(town, tmp_path_factory.mktemp("pictures"), samples=1, device="cpu")


def test_every_picture_exists_and_has_contrast(pictures: list[Path]) -> None:
    sizes = {path.name: pixels(path).shape[::-1] for path in pictures}
    assert sizes == {
        "circuit_above.jpg": (1200, 1200), "circuit_street1.jpg": (1200, 675), "circuit_street2.jpg": (1200, 675),
        "circuit_lanes.png": (1200, 1200),
    }  # fmt: skip
    for path in pictures:
        assert pixels(path).std() > 5, path
        assert path.stat().st_size < MAX_BYTES


def test_the_same_town_gives_the_same_pictures(town: Path, pictures: list[Path], tmp_path: Path) -> None:
    again = draw_town(town, tmp_path, samples=1, device="cpu")
    assert [path.read_bytes() for path in again] == [path.read_bytes() for path in pictures]


def test_a_given_view_is_used_and_parked_cars_show(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    images = []
    for name, x in (("near", 15.0), ("away", -15.0)):
        stage = write_circuit(tmp_path / f"{name}.usda")
        car = UsdGeom.Xform.Define(stage, "/World/Car")
        car.AddTranslateOp().Set(Gf.Vec3d(x, 0, -0.2))
        car.GetPrim().CreateAttribute("mmw:actor:role", Sdf.ValueTypeNames.Token).Set("vehicle")
        add_block(stage, "/World/Car/body", (4, 2, 1.5), (0, 0, 0.75), "car")
        stage.Save()
        command = ["town", "render", str(tmp_path / f"{name}.usda"), "--out", str(tmp_path), "--samples", "1"]
        assert main([*command, "--at", "30", "0", "1.6", "180", "--device", "cpu"]) == 0
        files = [Path(line) for line in capsys.readouterr().out.splitlines()]
        assert [file.name for file in files] == [f"{name}_{part}" for part in ("above.jpg", "street1.jpg", "lanes.png")]
        images.append(pixels(files[1]))
    changed = np.abs(images[0] - images[1]) > 5
    rows, columns = np.nonzero(changed)
    assert changed.mean() > 0.002
    assert abs(columns.mean() - 600) < 40  # straight ahead
    assert rows.min() > 300  # below the horizon


def test_scenarios_of_a_town_are_those_of_its_configurations() -> None:
    found = {name: (centre, rsus) for name, centre, rsus in scenarios_of("town03")}
    assert found["town03_roundabout"][0] == (-0.5, -0.5)
    assert found["town03_roundabout"][1].shape == (1, 2)
    assert scenarios_of("atlantis") == []


def test_the_selected_weather_is_drawn(tmp_path: Path, town: Path) -> None:
    assert selected_weather(write_town(tmp_path / "town.usda")) == "sunny"
    assert selected_weather(town) == "sunny"


@pytest.mark.parametrize(
    ("arguments", "part"),
    [(["--device", "cuda:99"], "cuda:99"), (["--at", "0", "0", "2", "0"] * 4, "4 views")],
)
def test_impossible_pictures_are_refused(
    town: Path, tmp_path: Path, arguments: list[str], part: str, capsys: pytest.CaptureFixture
) -> None:
    assert main(["town", "render", str(town), "--out", str(tmp_path), *arguments]) == 2
    assert part in capsys.readouterr().err
