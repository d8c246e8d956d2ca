"""Output of a run before and after: the bytes that it estimates, and the tables that it wrote."""

import builtins
import logging
import re
import sys
from io import StringIO
from typing import Any

import pytest

from mmw.cli.run import main
from mmw.config import Config, load_config
from mmw.core.resources import configs_dir
from mmw.core.timing import StageTimer
from mmw.generation.progress import Console, closing_summary

FULL_BYTES = 77_648e6
"""Tables of all of configs/full.yaml, made on an H100; `bench.pipeline`, bench/README.md."""


def summary(workers: int, tables: dict[str, dict[str, Any]], seconds: dict[str, float]) -> list[str]:
    timer = StageTimer()
    timer.seconds.update(seconds)
    timer.rays["front, back, left, right, depth"] = 62_000_000_000
    config: Config = load_config(configs_dir() / "quickstart.yaml")
    totals = {"rows": sum(t["rows"] for t in tables.values()), "bytes": sum(t["bytes"] for t in tables.values())}
    return closing_summary("out/here", config, "a GPU", workers, {"tables": tables, **totals}, timer, 9600).splitlines()


def test_columns_stand_below_each_other() -> None:
    tables = {"frames": {"rows": 3, "bytes": 7_560}, "box_visibility": {"rows": 23_642_420, "bytes": 35_490_000}}
    seconds = {"scene": 122.03, "front, back, left, right, depth": 341.8}
    lines = summary(8, tables, seconds)
    assert re.fullmatch(r"9600 frames in \d+\.\d s on 8 workers, a GPU -> out/here", lines[0])
    assert lines[2:6] == [
        "  table                 rows     bytes",
        "  frames                   3   7.56 kB",
        "  box_visibility  23,642,420  35.49 MB",
        "  all             23,642,423  35.50 MB",
    ]
    assert lines[7:10] == [
        "  stage                            seconds of 8 workers          rays/s",
        "  scene                                          122.03",
        "  front, back, left, right, depth                341.80  181.39 Mrays/s",
    ]


def test_one_worker_is_not_counted() -> None:
    lines = summary(1, {"frames": {"rows": 3, "bytes": 7_560}}, {"scene": 1.0})
    assert " s on a GPU -> out/here" in lines[0]
    assert lines[6].split() == ["stage", "seconds", "rays/s"]


def test_the_whole_dataset_is_foreseen(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--config", str(configs_dir() / "full.yaml"), "--device", "cpu", "--dry-run", "--quick"]) == 0
    found = re.search(r"tables of about ([\d.]+) GB", capsys.readouterr().out)
    assert found
    assert float(found[1]) * 1e9 == pytest.approx(FULL_BYTES, rel=0.02)


class Stream(StringIO):
    """Stream that is a terminal, or none."""

    def __init__(self, *, is_terminal: bool) -> None:
        super().__init__()
        self._is_terminal = is_terminal

    def isatty(self) -> bool:
        return self._is_terminal


def show(console: Console) -> None:
    """Show a short run."""
    with console:
        console.warn_once("mind this")
        console.begin(4, 0)
        console.advance(2, "town")
        console.advance(2, "town")
        console.summary("all done")


@pytest.mark.parametrize("is_terminal", [False, True])
def test_a_quiet_console_prints_nothing_and_logs_all(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, is_terminal: bool
) -> None:
    out, err = Stream(is_terminal=is_terminal), Stream(is_terminal=is_terminal)
    monkeypatch.setattr(sys, "stdout", out)
    monkeypatch.setattr(sys, "stderr", err)
    with caplog.at_level(logging.INFO, "mmw"):
        show(Console(is_quiet=True))
    assert (out.getvalue(), err.getvalue()) == ("", "")
    said = [record.getMessage() for record in caplog.records]
    assert said[0] == "mind this" and said[-1] == "all done" and said[2].startswith("town: 4/4 frames, ")


def test_a_notebook_has_plain_lines(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    """Its streams say that they are terminals. Rich knows it by this function and the class of its shell."""
    shell = type("ZMQInteractiveShell", (), {})()
    monkeypatch.setattr(builtins, "get_ipython", lambda: shell, raising=False)
    err = Stream(is_terminal=True)
    monkeypatch.setattr(sys, "stderr", err)
    show(Console())
    assert capsys.readouterr().out == "all done\n"
    assert re.fullmatch(r"note: mind this\n(town: [24]/4 frames, .* s left\n){2}", err.getvalue())
