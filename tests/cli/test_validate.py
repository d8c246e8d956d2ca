"""`mmw validate`: exit codes, selection, numbers as JSON."""

import json
from pathlib import Path

import pytest

from mmw.cli.validate import main


def test_rows_can_be_chosen_and_written(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "rows.json"
    assert main(["materials.wood_28ghz", "--device", "cpu", "--json", str(file)]) == 0
    assert "1 of 1 rows are green" in capsys.readouterr().out
    (row,) = json.loads(file.read_text())
    assert row["name"] == "materials.wood_28ghz"
    assert row["low"] <= row["value"] <= row["high"]


def test_an_unknown_row_is_refused_with_the_known_ones(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["materials.gold"]) == 2
    error = capsys.readouterr().err
    assert "unknown row 'materials.gold'" in error
    assert "materials.wood_28ghz" in error


def test_a_topic_with_a_row_known_to_be_red_ends_well(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["materials", "--device", "cpu"]) == 0
    assert "red    materials.concrete_facade_28ghz" in capsys.readouterr().out
