"""Shipped configurations by name: the same in any folder, and every command with `--config` takes them."""

from pathlib import Path

import pytest

from mmw.__main__ import main
from mmw.config import ConfigError, config_path, load_config
from mmw.core.resources import configs_dir, shipped_configs


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make an empty folder the current one."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_every_shipped_file_has_a_name_of_its_own() -> None:
    files = sorted(configs_dir().rglob("*.yaml"))
    assert sorted(shipped_configs().values()) == files
    assert {"quickstart", "full", "town03_roundabout", "town10_wide_skybridge"} <= set(shipped_configs())


def test_a_name_is_the_shipped_file(elsewhere: Path) -> None:
    for name, path in shipped_configs().items():
        assert config_path(name) == path and path.is_absolute()
    assert load_config("quickstart") == load_config(configs_dir() / "quickstart.yaml")
    assert len(load_config("full").scenarios) == 16  # includes start from the shipped folder
    (elsewhere / "quickstart").mkdir()  # a folder, such as a dataset of that name, is no configuration
    assert config_path("quickstart") == configs_dir() / "quickstart.yaml"


def test_a_file_that_exists_wins(elsewhere: Path) -> None:
    (elsewhere / "quickstart").write_text("scenarios: [{name: mine, stage: s.usda}]")
    assert config_path("quickstart") == Path("quickstart")
    assert load_config("quickstart").scenarios[0].name == "mine"
    (elsewhere / "full.yaml").write_text("scenarios: [{name: mine, stage: s.usda}]")
    assert config_path("full.yaml") == Path("full.yaml")
    assert config_path(Path("quickstart").resolve()) == elsewhere / "quickstart"


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ("quikstart", "quikstart: no such file, and no shipped configuration; did you mean quickstart; name one"),
        ("town03_roundabot", "did you mean town03_roundabout"),
        ("zzz", "shipped ones are full, quickstart, .*town03_crossroad_slope, "),
        ("quickstart.yaml", "quickstart.yaml: no such file; give an existing YAML file, or .* by name: quickstart"),
        ("configs/scenarios/town07_crossroad.yaml", "or the shipped configuration by name: town07_crossroad"),
        ("mine/quikstart.yaml", "mine/quikstart.yaml: no such file; give an existing YAML file$"),
        (".", "[Ii]s a directory"),
    ],
)
def test_what_is_neither_is_one_line(given: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said) as error:
        load_config(given)
    assert len(error.value.problems) == 1 and "\n" not in str(error.value)


def test_every_command_takes_names(capsys: pytest.CaptureFixture) -> None:
    assert main(["run", "--config", "quickstart", "--print-config"]) == 0
    assert "town03_roundabout" in capsys.readouterr().out
    assert main(["run", "--config", "quickstart", "--dry-run", "--quick", "--device", "cpu"]) == 0
    assert "3 CAV + 1 RSU" in capsys.readouterr().out
    for command in (["radiomap"], ["view", "--still", "a.png"]):
        assert main([*command, "--config", "town07_crossroad", "--scenario", "x", "--device", "cpu"]) == 2
        assert "town07_crossroad" in capsys.readouterr().err, command
        assert main([*command, "--config", "quikstart"]) == 2
        assert "did you mean quickstart" in capsys.readouterr().err


def test_what_a_user_is_told_first_works_in_any_folder(capsys: pytest.CaptureFixture) -> None:
    assert main(["run"]) == 2
    assert capsys.readouterr().err == (
        "mmw: --config FILE is missing; a first one to try is --config quickstart; `mmw configs` lists more\n"
    )
    with pytest.raises(SystemExit):
        main(["run", "--help"])
    told = " ".join(capsys.readouterr().out.split())
    assert "mmw run --config quickstart --out out/first" in told and "configs/" not in told
