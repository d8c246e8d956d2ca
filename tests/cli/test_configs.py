"""`mmw configs` and `mmw run NAME`: from an installed package to an edited configuration, in an empty folder."""

from pathlib import Path

import pytest

from mmw.__main__ import main
from mmw.config import load_config
from mmw.core.resources import shipped_configs


@pytest.fixture(autouse=True)
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make an empty folder the current one."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_list_says_what_each_generates(capsys: pytest.CaptureFixture) -> None:
    assert main(["configs"]) == 0
    listed = capsys.readouterr().out
    assert main(["configs", "list"]) == 0
    assert capsys.readouterr().out == listed
    lines = dict(line.split(maxsplit=1) for line in listed.split("\n\n")[0].splitlines())
    assert lines.keys() == shipped_configs().keys()
    assert "no GPU" in lines["quickstart"] and all(len(text) > 20 for text in lines.values())


@pytest.mark.parametrize("name", sorted(shipped_configs()))
def test_a_copy_is_the_same_configuration(name: str, elsewhere: Path, capsys: pytest.CaptureFixture) -> None:
    assert main(["configs", "copy", name, "mine/own.yaml"]) == 0
    written = capsys.readouterr().out.split()
    assert written[0] == "mine/own.yaml" and all(Path(path).is_file() for path in written)
    assert load_config("mine/own.yaml") == load_config(name)
    assert "yaml-language-server" not in Path("mine/own.yaml").read_text()
    assert sorted(elsewhere.rglob("*.yaml")) == sorted(elsewhere / path for path in written)


def test_what_exists_is_kept(capsys: pytest.CaptureFixture) -> None:
    Path("quickstart.yaml").write_text("mine")
    assert main(["configs", "copy", "quickstart"]) == 2
    assert "quickstart.yaml: exists; give another FILE, or --overwrite" in capsys.readouterr().err
    assert Path("quickstart.yaml").read_text() == "mine"
    assert main(["configs", "copy", "quickstart", "--overwrite"]) == 0
    assert load_config("quickstart.yaml") == load_config("quickstart")


def test_included_files_are_kept_too(elsewhere: Path) -> None:
    Path("scenarios").mkdir()
    Path("scenarios/town07_crossroad.yaml").write_text("mine")
    assert main(["configs", "copy", "full"]) == 2
    assert [path.name for path in elsewhere.rglob("*.yaml")] == ["town07_crossroad.yaml"]


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["copy", "quikstart"], "did you mean quickstart"),
        (["copy", "mine.yaml"], "mine.yaml: is a file of yours, no shipped configuration"),
        (["copy", "quickstart", "mine.yaml/x.yaml"], "mine.yaml/x.yaml: "),
    ],
)
def test_errors_are_one_line(arguments: list[str], said: str, capsys: pytest.CaptureFixture) -> None:
    Path("mine.yaml").write_text("scenarios: []")
    assert main(["configs", *arguments]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1


def test_run_takes_the_configuration_by_name(capsys: pytest.CaptureFixture) -> None:
    main(["run", "--config", "quickstart", "frames.count=3", "--print-config"])
    told = capsys.readouterr().out
    assert "count: 3" in told
    assert main(["run", "quickstart", "frames.count=3", "--print-config"]) == 0
    assert capsys.readouterr().out == told
    assert main(["configs", "copy", "quickstart", "own.yaml"]) == 0
    capsys.readouterr()
    assert main(["run", "own.yaml", "frames.count=3", "--print-config"]) == 0
    assert capsys.readouterr().out == told


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        ([], "--config FILE is missing; a first one to try is"),
        (["frames.count=3"], "--config FILE is missing"),
        (["quikstart"], "did you mean quickstart"),
        (["--config", "quickstart", "full"], "full"),
    ],
)
def test_run_without_one_says_so(arguments: list[str], said: str, capsys: pytest.CaptureFixture) -> None:
    assert main(["run", *arguments, "--print-config"]) == 2
    assert said in capsys.readouterr().err
