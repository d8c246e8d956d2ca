"""Pages for users of other tools: what they show in mmw runs, agrees with the other tool, and is not longer.

Sionna RT's numbers come from its own code on the page (`tests/reference/sionna_api`). It computes in float32, also the
phase 2 pi f tau. Its error there is that of tau, a few times 2^-24 tau, times 2 pi f, for each path alone: relative to
the sum of the paths' amplitudes, not to what remains where they cancel.
"""

import contextlib
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

from tests.fixtures.doc_pages import ROOT
from tests.fixtures.side_by_side import Task, count_lines, tasks_of
from tests.reference.sionna_api.generate import PAGE, RESULTS, digest

REFERENCE = ROOT / "tests" / "reference" / "sionna_api"
EXAMPLES = ROOT / "examples" / "coming_from"
TASKS = {task.number: task for task in tasks_of(PAGE)}
ROUNDINGS = 8.0
"""Roundings to float32 that the delays of Sionna RT have behind them; design value, twice what was seen."""


@pytest.fixture(scope="module")
def numbers() -> dict[str, np.ndarray]:
    """Return Sionna RT's results by `TASK/NAME`."""
    with np.load(REFERENCE / "numbers.npz") as file:
        return dict(file)


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the street, in which the code of the page runs."""
    folder = tmp_path_factory.mktemp("street")
    shutil.copytree(EXAMPLES, folder, dirs_exist_ok=True)
    return folder


def run(task: Task, folder: Path) -> dict:
    names: dict = {"__name__": "__main__"}
    with contextlib.chdir(folder):
        exec(compile(task.mmw, f"task {task.number}", "exec"), names)
    return names


def tolerance(carrier_hz: float, tau_s: float, amplitudes: float) -> float:
    """Return the error of float32 phases: of a sum of paths, each with a delay of at most tau."""
    return ROUNDINGS * 2 * np.pi * carrier_hz * tau_s * 2.0**-24 * amplitudes


def amplitudes_of(names: dict) -> float:
    """Return the largest sum of the amplitudes of the paths of a pair."""
    paths = names["paths"]
    pair = paths.rx * len(paths.transmitters) + paths.tx
    return float(np.bincount(pair, np.abs(paths.a).max(axis=1)).max())
