"""A configuration is told by what it changes, in short, and that means the same."""

from pathlib import Path

import pytest
import yaml

from mmw.cli.run import main
from mmw.config import load_config
from mmw.config.differences import differences, differences_yaml
from mmw.core.resources import shipped_configs

DATA = Path(__file__).parents[1] / "fixtures" / "data"


@pytest.mark.parametrize("path", [*shipped_configs().values(), DATA / "every_sensor.yaml"], ids=lambda path: path.stem)
def test_what_differs_means_the_same(path: Path, tmp_path: Path) -> None:
    config = load_config(path)
    (tmp_path / "short.yaml").write_text(differences_yaml(config))
    assert load_config(tmp_path / "short.yaml").model_dump() == config.model_dump()


def test_a_changed_key_is_there_and_no_other() -> None:
    usual = differences(load_config("quickstart"))
    assert "seed" not in usual and "air" not in usual and "compute" in usual
    changes = ["seed=7", "channel.max_depth=2", "weathers=[rainy, storm]", "air={rainy: {rain_mm_h: 7}, storm: {}}"]
    found = differences(load_config("quickstart", [*changes, "vary={spawn: {radius_m: 90}}"]))
    assert (
        found["seed"] == 7 and found["weathers"] == ["rainy", "storm"] and found["vary"] == {"spawn": {"radius_m": 90}}
    )
    assert found["air"] == {"rainy": {"rain_mm_h": 7}, "storm": {}}
    assert found["channel"] == usual["channel"] | {"max_depth": 2}
    assert found["sensors"][:5] == [{"type": kind} for kind in ("lidar", "depth", "imu", "gnss", "radar")]


def test_the_command_prints_it(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--config", "full", "seed=3", "sweep={grid: {seed: [1]}}", "--diff"]) == 0
    printed = yaml.safe_load(capsys.readouterr().out)
    assert printed["seed"] == 3 and printed["sweep"] == {"grid": {"seed": [1]}} and "sensors" not in printed
