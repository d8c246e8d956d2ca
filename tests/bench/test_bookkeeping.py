"""The measurement of the bookkeeping lays out a dataset that counts as finished, of as many files as it says."""

import json
from pathlib import Path

import pytest

from bench import bookkeeping
from mmw.cli import status as status_command
from mmw.config import load_config
from mmw.generation.shards import all_work, pending_work
from mmw.storage.manifest import read_markers

pytestmark = pytest.mark.slow  # whoever uses mmw can do without its benchmarks


@pytest.fixture
def config():
    whole = load_config(bookkeeping.FULL)
    return whole.model_copy(update={"scenarios": whole.scenarios[1:3]})


def test_many_have_their_own_names(config) -> None:
    copies = bookkeeping.many(config, 3)
    names = [scenario.name for scenario in copies.scenarios]
    assert len(set(names)) == 6 and names[0] == "town03_gas_station_00000"
    assert copies.frame_total == 3 * config.frame_total


def test_what_is_laid_out_is_finished(config, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    root = tmp_path / "x1"
    bookkeeping.lay_out(config, root)
    assert pending_work(root, all_work(config)) == []
    assert status_command.main([str(root)]) == 0
    assert "5,400/5,400" in capsys.readouterr().out
    markers = read_markers(root)
    assert len(markers) == 54 + 2
    assert all((root / file["path"]).stat().st_size == file["bytes"] for each in markers for file in each["files"])
    steps = bookkeeping.measure(config, 1, root)
    assert {step.step for step in steps} >= {"find what is missing", "read the markers", "mmw status", "mmw finalize"}
    assert all((step.shards, step.files) == (54, 54 * 13 + 2 * 3) for step in steps)
    assert all(step.cpu_s > 0 and step.step in bookkeeping.line(step) for step in steps)
    assert sum(len(marker["files"]) for marker in markers) == steps[0].files
    found = bookkeeping.sizes(root)
    assert found["markers"] == sum(path.stat().st_size for path in (root / "_shards").glob("*.json"))


def test_a_file_gets_new_names_until_it_has_too_many(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bookkeeping, "MAX_LINKS", 2)
    first = tmp_path / "a"
    first.write_text("content")
    links = bookkeeping.Links(tmp_path, {"files": [{"table": "poses", "path": "a"}]})
    for name in "bcde":
        links.add("poses", Path("sub", name))
    paths = [first, *(tmp_path / "sub" / name for name in "bcde")]
    assert {path.read_text() for path in paths} == {"content"}
    assert [path.stat().st_nlink for path in paths] == [2, 2, 2, 2, 1]


def test_the_command_prints_and_cleans_up(
    config, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(bookkeeping, "load_config", lambda _: config)
    monkeypatch.setattr(bookkeeping, "measure", lambda *_: [bookkeeping.Step(1, 54, 708, "markers", 0.1, 0.2, None)])
    bookkeeping.main(["--copies", "1", "--folder", str(tmp_path), "--format", "json"])
    step, described = (json.loads(row) for row in capsys.readouterr().out.splitlines())
    assert step["files"] == 708 and set(described["bytes"]) == {
        "config.yaml", "dataset.json", "_manifest.parquet", "markers",
    }  # fmt: skip
    assert list(tmp_path.iterdir()) == []
