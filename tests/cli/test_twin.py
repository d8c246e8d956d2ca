"""`mmw twin`: an extract becomes a world that runs, with pictures, in one command; what is refused, and how."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from mmw.__main__ import main
from mmw.cli.first_scenario import FirstScenario
from mmw.cli.twin import START, config_text
from mmw.config import load_config
from mmw.config.shipped import config_path
from mmw.core.georeference import Georeference
from mmw.dataset import open_dataset
from mmw.worlds.importers.imported_scene import ImportedScene
from mmw.worlds.importers.sumo import netconvert
from tests.fixtures.osm_files import ORIGIN, Map, needs_netconvert, quarter


def write(path: Path, town: Map) -> Path:
    path.write_text(town.text(), encoding="utf-8")
    return path


@pytest.mark.slow
def test_one_command_makes_a_world_that_runs(
    tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    needs_netconvert()
    monkeypatch.chdir(tmp_path)
    write(tmp_path / "quarter.osm", quarter())
    given = ["twin", "quarter.osm", "--out", "twins/quarter"]
    assert main([*given, "--samples", "1", "--device", "cpu"]) == 0
    printed = capsys.readouterr().out.splitlines()
    config = Path("twins/quarter/quarter.yaml")
    assert f"next: mmw run --config {config} frames.count=2" in printed
    pictures = {path.name: path for path in Path("twins/quarter/pictures").iterdir()}
    views = ("above.jpg", "lanes.png", "rsu.jpg", "street1.jpg", "street2.jpg", "street3.jpg")
    assert sorted(pictures) == [f"quarter_{view}" for view in views]
    for path in pictures.values():
        with Image.open(path) as image:
            assert np.asarray(image.convert("L"), dtype=float).std() > 5, path
    assert main(["run", "--config", str(config), "frames.count=2", "sensors=[{type: lidar}]", "--device", "cpu"]) == 0
    frames = open_dataset("out/quarter").numpy("frames")
    assert set(frames["frame"]) == {0, 1}
    capsys.readouterr()
    assert main(given) == 2  # nothing is replaced unasked
    assert "is there already; give --overwrite to replace it" in capsys.readouterr().err


def test_the_configuration_is_that_of_the_quickstart_in_another_place(tmp_path: Path) -> None:
    first = FirstScenario((4.0, -2.0, 0.5), 12, 3, (10.5, -8.0, 0.2), 126.0)
    scene = ImportedScene([], georeference=Georeference(*ORIGIN), notice="comes from somewhere")
    path = tmp_path / "place.yaml"
    path.write_text(config_text(scene, first, tmp_path / "place.usda", "place"))
    assert path.read_text().splitlines()[1] == "# The town comes from somewhere."
    config, start = load_config(path), load_config(config_path(START))
    scenario = config.scenario("place")
    traffic = scenario.traffic
    assert traffic is not None and (scenario.town, traffic.vehicle_count) == ("place.usda", 12)
    assert (traffic.spawn_center_m, traffic.cav_ranks) == (first.center, (0, 1, 2))
    assert [(unit.name, unit.position_m, unit.yaw_deg) for unit in scenario.rsus] == [("rsu_1", first.mast, 126.0)]
    gnss = next(sensor for sensor in config.sensors if sensor.type == "gnss")
    assert (gnss.reference_latitude_deg, gnss.reference_longitude_deg) == ORIGIN
    assert config.output.dir == "out/place"
    same = ("weathers", "frames", "channel", "compute")
    assert all(getattr(config, key) == getattr(start, key) for key in same)
    assert [sensor.name for sensor in config.sensors] == [sensor.name for sensor in start.sensors]


def test_without_a_place_for_a_mast_there_is_no_roadside_unit(tmp_path: Path) -> None:
    first = FirstScenario((0.0, 0.0, 0.0), 2, 1, None, 0.0)
    path = tmp_path / "place.yaml"
    path.write_text(config_text(ImportedScene([]), first, tmp_path / "place.usda", "place"))
    assert load_config(path).scenario("place").rsus == ()


def houses() -> Map:
    town = Map()
    town.box(0, 0, 10, 10, building="yes")
    return town


def alley() -> Map:
    town = houses()
    town.way([(-8, -10), (8, -10)], {"highway": "residential"})
    return town


@pytest.mark.parametrize(
    ("town", "options", "message"),
    [
        (houses(), [], "has no road that cars may use"),
        (alley(), [], "no lane is long enough for a vehicle (21 m are needed); choose another area"),
        (quarter(), ["--bbox=11,48"], "bbox"),
        (quarter(), ["windows=stained"], "windows"),
    ],
)
def test_worlds_without_traffic_and_wrong_options_write_nothing(
    town: Map, options: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    needs_netconvert()
    source = write(tmp_path / "place.osm", town)
    assert main(["twin", str(source), "--out", str(tmp_path / "out"), *options]) == 2
    assert message in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_files_in_the_way_and_other_formats_are_refused_first(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    source, out = write(tmp_path / "place.osm", quarter()), tmp_path / "out"
    assert main(["twin", str(tmp_path / "town.xodr"), "--out", str(out)]) == 2
    assert "is no OpenStreetMap extract" in capsys.readouterr().err
    for other in (source, tmp_path / "town.usda"):
        assert main(["twin", str(source), "--out", str(other)]) == 2
        assert "is no folder; give another --out" in capsys.readouterr().err
    out.mkdir()
    (out / "place.yaml").write_text("mine")
    assert main(["twin", str(source), "--out", str(out)]) == 2
    assert "place.yaml: is there already; give --overwrite" in capsys.readouterr().err
    assert [path.name for path in out.iterdir()] == ["place.yaml"]
    assert (out / "place.yaml").read_text() == "mine"


def test_a_missing_netconvert_is_named_with_the_extra(
    tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(netconvert, "PROGRAM", "netconvert-that-is-not-there")
    source = write(tmp_path / "place.osm", quarter())
    assert main(["twin", str(source), "--out", str(tmp_path / "out")]) == 1
    error = capsys.readouterr().err
    assert "netconvert" in error and "[osm]" in error
    assert not (tmp_path / "out").exists()
