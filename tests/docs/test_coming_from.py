"""Pages for users of other tools: what they show for mmw runs, agrees with the other tool, and is not longer.

Sionna RT's numbers come from its own code on the page (`tests/reference/sionna_api`). It computes in float32: of a path
it rounds the delay tau, and so the phase 2 pi f tau. What that does to a sum of paths is relative to the sum of their
amplitudes, not to what remains where they cancel.
"""

import contextlib
import json
import re
import shutil
from pathlib import Path

import numpy as np
import pytest

import mmw
from mmw.__main__ import main
from tests.fixtures.doc_pages import ROOT, run_page
from tests.fixtures.side_by_side import Task, count_lines, tasks_of
from tests.fixtures.small_dataset import small_dataset
from tests.reference.sionna_api.generate import PAGE, RESULTS, digest

REFERENCE = ROOT / "tests" / "reference" / "sionna_api"
DEEPMIMO_PAGE = PAGE.parent / "deepmimo.md"
CARLA_PAGE = PAGE.parent / "carla.md"
TASKS = {task.number: task for task in tasks_of(PAGE)}
ROUNDINGS = 4.0
"""Roundings to float32 behind a delay of Sionna RT: its own, those of the vertices, of the phase; design value."""
GAIN = 2e-4
"""Relative difference of a single gain: float32 along the path, and the gases of the air, 1e-4 at 3.5 GHz and 100 m."""


@pytest.fixture(scope="module")
def numbers() -> dict[str, np.ndarray]:
    """Return Sionna RT's results by `TASK/NAME`."""
    with np.load(REFERENCE / "numbers.npz") as file:
        return dict(file)


@pytest.fixture(scope="module")
def street(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the street, in which the code of the page runs."""
    folder = tmp_path_factory.mktemp("street")
    shutil.copytree(ROOT / "examples" / "coming_from", folder, dirs_exist_ok=True)
    return folder


def run(task: Task, folder: Path) -> dict:
    """Run the code of mmw of a task in a folder, and return its names."""
    names: dict = {"__name__": "__main__"}
    with contextlib.chdir(folder):
        exec(compile(task.mmw, f"task {task.number}", "exec"), names)
    return names


def tolerance(paths: mmw.Paths) -> float:
    """Return the largest error of a sum of the paths of a pair in float32."""
    pair = paths.rx * len(paths.transmitters) + paths.tx
    amplitude = np.bincount(pair, np.abs(paths.a).max(axis=1)).max()
    phase = ROUNDINGS * 2.0 * np.pi * paths.carriers_hz.max() * paths.tau.max() * 2.0**-24
    return float((GAIN + phase) * amplitude)


def test_the_reference_is_of_the_code_on_the_page() -> None:
    made = json.loads((REFERENCE / "manifest.json").read_text())
    assert made["versions"]["sionna-rt"] == "2.2.0"
    assert made["code_sha256"] == {str(task.number): digest(task.other) for task in TASKS.values() if task.other}


@pytest.mark.parametrize("page", [PAGE, DEEPMIMO_PAGE], ids=lambda page: page.stem)
def test_the_table_counts_lines_and_mmw_needs_no_more(page: Path) -> None:
    text, sums = page.read_text(), np.zeros(2, dtype=int)
    for task in tasks_of(page):
        ours = count_lines(task.mmw)
        row = re.search(rf"^\| \[{task.number}\. [^\n]+$", text, re.MULTILINE)
        assert row, f"{page.name}: the table lacks task {task.number}"
        told = [int(number) for number in re.findall(r"\| (\d+)(?: lines)?(?= \|)", row[0])]
        if not task.other:
            assert told == [ours]
            continue
        theirs = count_lines(task.other)
        assert told == [theirs, ours] and ours <= theirs, f"{page.name}: task {task.number}: {theirs} and {ours} lines"
        sums += [theirs, ours]
    total = re.search(r"^\| together, [^|]+\| (\d+) \| (\d+) \|$", text, re.MULTILINE)
    assert total is None or [int(total[1]), int(total[2])] == sums.tolist()


@pytest.mark.parametrize("number", [1, 4, 5, 8, 10])
def test_sums_of_paths_are_those_of_sionna_rt(number: int, street: Path, numbers: dict[str, np.ndarray]) -> None:
    names = run(TASKS[number], street)
    paths = names["paths"] if "paths" in names else names["solver"](names["scene"], carriers_hz=[3.5e9])
    for name in RESULTS[number]:
        wanted, got = numbers[f"{number}/{name}"], np.asarray(names[name])
        assert got.shape == wanted.shape and np.abs(wanted).max() > 20.0 * tolerance(paths)
        np.testing.assert_allclose(got, wanted, rtol=0.0, atol=tolerance(paths), err_msg=name)
    if number == 4:
        assert np.abs(names["after"] - names["before"]).max() > tolerance(paths)  # so the change counts
    if number in (5, 8):
        assert np.abs(np.diff(names["h"], axis=0 if number == 5 else 4)).max() > tolerance(paths)


@pytest.mark.parametrize("number", [2, 6])
def test_single_paths_are_those_of_sionna_rt(number: int, street: Path, numbers: dict[str, np.ndarray]) -> None:
    """Antenna by antenna, paths in the order of their delays."""
    names = run(TASKS[number], street)
    a, tau = names["a"], names["tau"]
    wanted_a, wanted_tau = numbers[f"{number}/a"], numbers[f"{number}/tau"]
    assert a.shape == wanted_a.shape and tau.shape == wanted_tau.shape and tau.min() > 0.0
    ours, theirs = np.argsort(tau.ravel()), np.argsort(wanted_tau.ravel())
    np.testing.assert_allclose(tau.ravel()[ours], wanted_tau.ravel()[theirs], rtol=ROUNDINGS * 2.0**-24)
    difference = np.abs(a[..., ours, :] - wanted_a[..., theirs, :])
    phase = ROUNDINGS * 2.0 * np.pi * 3.5e9 * tau.ravel()[ours] * 2.0**-24
    weakest = 1e-4 * np.abs(a).max()  # a field near a null of a pattern is small, its error is not
    assert (difference <= (GAIN + phase)[:, None] * (np.abs(a[..., ours, :]) + weakest)).all()
    assert (np.abs(a) > 10.0 * weakest).mean() > 0.5


@pytest.mark.slow
def test_the_radio_map_is_that_of_sionna_rt(street: Path, numbers: dict[str, np.ndarray]) -> None:
    """Theirs is of 1e7 rays: a weak cell of 4 m has 0.3 dB of noise. Ours is of 25 points a cell: where walls, and with
    them the ends of shadows, run along the rows of points, a cell may be off by the power of a row or two."""
    radio_map = run(TASKS[3], street)["radio_map"]
    ours, theirs = radio_map.as_grid(radio_map.rss_dbm), numbers["3/rss_dbm"]
    centers = numbers["3/cell_centers"]
    assert np.array_equal(radio_map.as_grid(radio_map.cell_centers.T), np.moveaxis(centers, -1, 0))
    strong = theirs > -70.0
    assert strong.sum() > 300
    off = np.abs(ours[strong] - theirs[strong])
    assert np.quantile(off, 0.9) < 0.4 and off.max() < 3.0
    ours_w, theirs_w = ((10.0 ** (np.where(np.isfinite(rss), rss, -300.0) / 10.0)).sum() for rss in (ours, theirs))
    assert 10.0 * np.log10(ours_w / theirs_w) == pytest.approx(0.0, abs=0.05)


def test_the_table_of_paths_is_that_of_sionna_rt(street: Path, numbers: dict[str, np.ndarray]) -> None:
    table = run(TASKS[9], street)["table"]
    assert list(table.columns) == ["tau", "gain_db"]
    got, wanted = table.to_numpy(), numbers["9/table"]
    np.testing.assert_allclose(got[:, 0], wanted[:, 0], rtol=ROUNDINGS * 2.0**-24)
    np.testing.assert_allclose(got[:, 1], wanted[:, 1], rtol=0.0, atol=0.01)  # the weakest is 19 dB below the first


def test_two_carriers_of_one_trace_are_two_runs_of_sionna_rt(street: Path, numbers: dict[str, np.ndarray]) -> None:
    names = run(TASKS[7], street)
    wanted = numbers["7/h"]
    assert np.shape(names["h"]) == wanted.shape == (2, 1, 1, 1, 1, 1, 1)
    np.testing.assert_allclose(names["h"], wanted, rtol=0.0, atol=tolerance(names["paths"]))
    assert np.abs(wanted).min() > 5.0 * tolerance(names["paths"])


def test_a_lidar_frame_sees_the_street(street: Path) -> None:
    names = run(TASKS[11], street)
    cloud, objects = names["cloud"], names["scene"].objects
    seen = set(cloud.object_id.tolist())
    assert {objects["car"].object_id, objects["ground"].object_id, objects["house_3"].object_id} <= seen
    on_ground = cloud.xyz[cloud.object_id == objects["ground"].object_id]
    assert len(on_ground) > 1000 and np.abs(on_ground[:, 2] + 1.9).max() < 0.1  # the sensor is 1.9 m high


def test_channels_for_sionna_phy_have_its_shapes(street: Path) -> None:
    """The protocol of `CIRDataset`: equal shapes, finite delays, no power where there is no path."""
    names = run(TASKS[12], street)
    samples = list(names["cirs"]())
    assert len(samples) > 3
    for a, tau in samples:
        assert a.shape == (1, 1, 1, 4, 16, 14) and tau.shape == (1, 1, 16) and np.isfinite(tau).all()
        assert np.array_equal(np.abs(a[0, 0, 0]).max(axis=(0, 2)) > 0.0, tau[0, 0] >= 0.0)


def test_deepmimo_gives_what_the_page_says(tmp_path: Path) -> None:
    pytest.importorskip("deepmimo", reason="DeepMIMO is not installed; pip install deepmimo==4.0.5")
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "quickstart").symlink_to(small_dataset())
    command = "out/quickstart out/deepmimo weather=sunny pattern=stored"
    assert f"mmw export deepmimo {command}\n" in DEEPMIMO_PAGE.read_text()
    with contextlib.chdir(tmp_path):
        assert main(["export", "deepmimo", *command.split()]) == 0
    for task in tasks_of(DEEPMIMO_PAGE):
        theirs: dict = {"__name__": "__main__"}
        with contextlib.chdir(tmp_path / "out" / "deepmimo"):
            exec(compile(task.other, f"task {task.number}", "exec"), theirs)
        ours = run(task, tmp_path)
        if "h" in ours:
            wanted = theirs["h"] * 8.0  # the square root of 64 subcarriers
            wanted = np.moveaxis(wanted, 3, -1)  # subcarriers last
            assert np.abs(ours["h"] - wanted).max() < 5e-6 * np.abs(wanted).max()
        if "loss_db" in ours:
            np.testing.assert_allclose(ours["loss_db"], theirs["loss_db"], rtol=0.0, atol=1e-4)
        if "table" in ours:
            np.testing.assert_allclose(ours["table"].to_numpy(), theirs["table"].to_numpy(), rtol=1e-6)
        assert {"h", "loss_db", "table"} & set(ours)


@pytest.mark.slow
def test_the_page_for_users_of_carla_runs(tmp_path: Path) -> None:
    (tmp_path / "configs").symlink_to(ROOT / "configs")
    run_page(CARLA_PAGE, tmp_path)
