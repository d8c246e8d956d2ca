"""Hostile input ends in success or in one clear error; `python -m tests.fuzz` throws more of it."""

import contextlib
import io
import random
import time
from pathlib import Path

import pytest

from tests.fuzz import runner
from tests.fuzz.cases import run_step
from tests.fuzz.kinds import KINDS, make_kind

SEED = 0
BOUND_S = 3.0
"""Time for the inputs of a kind, after their sound files are made [s]; what does not fit is left out."""


@pytest.mark.parametrize("name", KINDS)
def test_hostile_input_ends_well(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    kind = make_kind(name)
    (tmp_path / "sound").mkdir()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        kind.prepare(tmp_path / "sound")
    end, number = time.monotonic() + BOUND_S, 0
    while number < 3 or (number < 40 and time.monotonic() < end):
        folder = tmp_path / f"case-{number}"
        folder.mkdir()
        monkeypatch.chdir(folder)
        for step in kind.make(random.Random(f"{name} {SEED} {number}"), folder):
            assert run_step(step) == "", f"{step.text}: python -m tests.fuzz --kind {name} --first {number} --count 1"
        number += 1


@pytest.mark.slow
@pytest.mark.parametrize("name", KINDS)
def test_more_of_it_in_a_process_of_its_own(name: str, tmp_path: Path) -> None:
    result = runner.run(name, SEED, 0, 60, seconds=30.0)
    places = [str(runner.save(fault, tmp_path)) for fault in result.faults]
    assert [fault.signature for fault in result.faults] == [], places
    assert result.cases > 0


@pytest.mark.slow
def test_what_is_forbidden_is_noticed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runner, "CPU_S", 1.0)
    result = runner.run("broken", SEED, 0, 8)
    assert result.cases == 8
    found = {fault.number: fault for fault in result.faults}
    assert list(found) == [2, 3, 4, 5]
    assert "KeyError: 'a bug'" in found[2].what
    assert "Segmentation fault" in found[3].what
    assert "_hang" in found[4].what
    assert "MemoryError" in found[5].what
    place = runner.save(found[3], tmp_path)
    assert (place / "input.txt").read_text() == "crash"
    assert "--kind broken --seed 0 --first 3 --count 1" in (place / "FAULT.txt").read_text()
