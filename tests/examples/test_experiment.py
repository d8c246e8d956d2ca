"""The smoke run of beam prediction, from the command line to the report: what it learns, writes, and resumes."""

import json
import shutil
import time
from pathlib import Path

import numpy as np
import pytest

torch = pytest.importorskip("torch", reason="PyTorch is not installed: pip install 'multimodal-wireless[torch]'")
pytest.importorskip("transformers", reason="transformers is not installed: pip install 'multimodal-wireless[torch]'")

from examples.beam_prediction.__main__ import main  # noqa: E402
from examples.beam_prediction.config import Experiment, load_experiment  # noqa: E402
from examples.beam_prediction.data import BeamData, load_data  # noqa: E402
from examples.beam_prediction.labels import average_channels, beam_search  # noqa: E402
from examples.beam_prediction.results import LABELS, read_methods  # noqa: E402
from examples.beam_prediction.training import Run, runs_of, train  # noqa: E402
from mmw.channel import beam_gains, normalized_gain, rotations_from_poses  # noqa: E402
from mmw.dataset import open_dataset  # noqa: E402
from tests.fixtures.learn_data import FOLDER, smoke_dataset  # noqa: E402

CONFIG = str(FOLDER / "smoke.yaml")
CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of the whole experiment in small."""
    torch.set_num_threads(1)  # threads that wait for each other take longer than these small products
    folder = tmp_path_factory.mktemp("beam") / "out"
    code = main(
        ["--config", CONFIG, "--data", str(smoke_dataset()), "--out", str(folder), "--workers", "1", "--device", "cpu"]
    )
    assert code == 0
    return folder


@pytest.fixture(scope="module")
def experiment() -> Experiment:
    return load_experiment(CONFIG)


@pytest.fixture(scope="module")
def data(out: Path, experiment: Experiment) -> BeamData:
    return load_data(out / "cache", experiment, CPU)


def metrics_of(out: Path, name: str) -> dict:
    return json.loads((out / "runs" / name / "metrics.json").read_text())


def test_every_run_learns(out: Path, experiment: Experiment) -> None:
    names = [run.name for run in runs_of(experiment)]
    assert names == ["gru-0", "index-0", "lidar-0", "camera-0", "all-0"]
    for name in names:
        history = metrics_of(out, name)["history"]
        assert history[-1]["loss"] < 0.6 * history[0]["loss"], name
        assert len(history) == experiment.training.epochs and (out / "runs" / name / "weights.pt").is_file()
        assert not (out / "runs" / name / "checkpoint.pt").exists()


def test_scores_come_from_the_stored_channels(out: Path, data: BeamData, experiment: Experiment) -> None:
    """The gains of a run are computed again from paths of the dataset, with the utilities of mmw alone."""
    predicted = np.load(out / "runs" / "all-0" / "predictions.npz")["beams"]
    starts = data.starts["val"].numpy()
    assert predicted.shape == (len(starts), data.future, 5)
    dataset = open_dataset(smoke_dataset())
    scenario, weather, _ = data.track[0]
    paths = dataset.paths(28e9, scenario=scenario, weather=weather)
    poses = dataset.read("poses", scenario=scenario, weather=weather)
    search = beam_search(experiment.radio)
    h = average_channels(
        paths, rotations_from_poses(poses, paths, "tx"), rotations_from_poses(poses, paths, "rx"), search
    )
    gains = beam_gains(h, *search.codebooks)
    link = {(key["agent"], int(key["frame"])): n for n, key in enumerate(paths.keys)}
    found = np.full(predicted.shape[:2], np.nan)
    for window, start in enumerate(starts.tolist()):
        for step in range(data.future):
            row = start + data.past + step
            n = link[data.track[row][2], int(data.frame[row])]
            found[window, step] = normalized_gain(gains[n : n + 1], predicted[window, step, :1].astype(int))[0]
    assert np.isfinite(found).any()
    np.testing.assert_allclose(metrics_of(out, "all-0")["scores"]["gain"], np.nanmean(found, axis=0), rtol=1e-5)


def test_a_run_that_was_stopped_goes_on_to_the_same_numbers(
    out: Path, data: BeamData, experiment: Experiment, tmp_path: Path
) -> None:
    run = Run("all", 0)
    assert not train(run, experiment, data, tmp_path, deadline=time.monotonic())  # one epoch, then time is up
    assert len((tmp_path / "all-0" / "history.jsonl").read_text().splitlines()) == 1
    assert train(run, experiment, data, tmp_path)
    again, whole = (json.loads((folder / "all-0" / "metrics.json").read_text()) for folder in (tmp_path, out / "runs"))
    assert again["scores"] == whole["scores"]
    losses = [[row["loss"] for row in one["history"]] for one in (again, whole)]
    assert losses[0] == losses[1]
    weights = [torch.load(folder / "all-0" / "weights.pt", weights_only=True) for folder in (tmp_path, out / "runs")]
    assert all(torch.equal(weights[0][name], weights[1][name]) for name in weights[0])


def test_the_report_has_table_figures_and_cases(out: Path, data: BeamData) -> None:
    report = out / "report"
    page = (report / "results.md").read_text()
    for label in LABELS.values():
        assert f"| {label} |" in page
    for name in ("gain_per_step.png", "ablation.png", "learning.png"):
        assert f"({name})" in page and (report / name).stat().st_size > 5_000
    analysis = (report / "analysis.md").read_text()
    assert "## By scenario" in analysis and "## By line of sight" in analysis and "| town03_roundabout |" in analysis
    pictures = [line.split("(")[1].rstrip(")") for line in analysis.splitlines() if line.startswith("![")]
    assert "failure_1.png" in pictures and all((report / name).is_file() for name in pictures)
    methods = read_methods(out, data)
    gain = methods["all"].per_step("gain")
    assert gain.shape == (1, data.future) and f"{gain.mean():.4f}" in page
    assert np.allclose(gain[0], metrics_of(out, "all-0")["scores"]["gain"])


def test_a_cache_needs_no_dataset(out: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    cache = tmp_path / "cache"
    shutil.copytree(out / "cache", cache)
    options = ["--config", CONFIG, "--cache", str(cache), "--out", str(tmp_path / "out")]
    few = ["inputs=[index]", "gru=false", "training.epochs=1"]
    assert main([*options, *few]) == 0
    assert (tmp_path / "out" / "report" / "analysis.md").is_file()
    assert main([*options, *few]) == 0  # nothing is left to do
    assert main([*options, *few, "training.batch=8"]) == 2
    assert "holds a run with other training; give another --out" in capsys.readouterr().err


def test_further_datasets_train_alone(out: Path, data: BeamData, tmp_path: Path) -> None:
    cache, more = tmp_path / "cache", str(smoke_dataset())
    shutil.copytree(out / "cache", cache)
    (cache / "cache.json").unlink()  # it was made of one dataset
    options = ["--config", CONFIG, "--data", more, "--more", more, "--cache", str(cache), "--out", str(tmp_path / "o")]
    assert main([*options, "--steps", "prepare", "--workers", "1", "inputs=[index]"]) == 0
    both = load_data(cache, load_experiment(CONFIG, ["inputs=[index]"]), CPU)
    assert len(both.starts["val"]) == len(data.starts["val"])
    scenarios = {part: {both.track[start][0] for start in rows.tolist()} for part, rows in both.starts.items()}
    assert scenarios == {"train": {"town03_roundabout", "town03_roundabout+1"}, "val": {"town03_roundabout"}}
    assert len(both.frame) == 2 * len(data.frame)
    assert len(both.starts["train"]) > 2 * len(data.starts["train"])  # none of it is for validation


def test_time_that_is_up_leaves_the_rest_for_later(
    out: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ["--config", CONFIG, "--cache", str(out / "cache"), "--out", str(tmp_path), "--minutes", "0"]
    assert main(options) == 3
    assert "0 of 5 runs are finished; the same command goes on" in capsys.readouterr().out
    assert "extrapolated angle" in (tmp_path / "report" / "results.md").read_text()  # baselines need no training


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--cache", "{tmp}/none"], "no cache is there; give the dataset as --data"),
        (["features.ranges=16"], "was made with another features"),
        (["windows.past=4"], "was made with another windows"),
        (["--steps", "train,report", "windows.split=window"], "give --data, and the step prepare finds them anew"),
        (["--data", "{tmp}"], "dataset.json"),
        (["features.lidar=[cav/lidar]"], "nothing is there; make it with --data"),
        (["--device", "cuda"], "PyTorch sees no GPU; give cpu"),
    ],
)
def test_wrong_input_is_one_clear_line(
    more: list[str], said: str, out: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if said.startswith("PyTorch") and torch.cuda.is_available():
        pytest.skip("there is a GPU")
    options = ["--config", CONFIG, "--out", str(tmp_path / "out")]
    if "--cache" not in more:
        options += ["--cache", str(out / "cache")]
    assert main([*options, *(word.format(tmp=tmp_path) for word in more)]) == 2
    told = capsys.readouterr().err
    assert said in told and len(told.splitlines()) == 1


def test_a_sensor_that_no_agent_has_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--config", CONFIG, "--data", str(smoke_dataset()), "--out", str(tmp_path), "--workers", "1"]
    assert main([*options, "features.camera=[rsu/rear]", "inputs=[camera]"]) == 2
    assert "no window is left" in capsys.readouterr().err
