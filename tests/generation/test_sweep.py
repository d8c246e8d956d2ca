"""Sweeps are made as single datasets are, share stages, resume, and are told apart by an index."""

import json
from pathlib import Path

import duckdb
import pytest

import mmw
from mmw.cli.run import main
from mmw.cli.status import main as status
from mmw.cli.verify import main as verify
from mmw.core.resources import configs_dir
from mmw.generation import generate
from tests.fixtures.own_world import assert_same_files, run_own, table_files

SWEEP = "sweep={grid: {seed: [1, 2], sensors.imu.rate_hz: [100, 50]}}"
NAMES = [f"seed-{seed},rate_hz-{rate}" for seed in (1, 2) for rate in (100, 50)]
FEW = ("channel.enabled=false", "sensors=[{type: imu}]", "frames.count=4")
TOWN = (*FEW, "scenarios.0.traffic.vehicle_count=5", "scenarios.0.traffic.cav_ranks=[1]")


@pytest.fixture(scope="module")
def swept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a sweep, and the datasets that Python opened, by their names."""
    folder = tmp_path_factory.mktemp("sweep")
    for path in (Path(__file__).parents[1] / "fixtures" / "data").glob("mine.*"):
        (folder / path.name).write_bytes(path.read_bytes())
    assert run_own(folder, "all", *FEW, SWEEP) == 0
    return folder


def test_each_dataset_is_that_of_a_run_of_its_own(swept: Path) -> None:
    assert sorted(path.name for path in (swept / "all").iterdir()) == sorted([*NAMES, "sweep.json"])
    assert run_own(swept, "alone", *FEW, "seed=2", "sensors.imu.rate_hz=50") == 0
    assert_same_files(swept / "all" / NAMES[3], swept / "alone")
    assert len(table_files(swept / "alone")) > 3


def test_python_returns_the_datasets_by_name(swept: Path, capfd: pytest.CaptureFixture[str]) -> None:
    before = {name: (swept / "all" / name / "dataset.json").stat().st_mtime_ns for name in NAMES}
    how = {"overrides": [*FEW, SWEEP], "device": "cpu", "workers": 1, "progress": False}
    found = mmw.generate(swept / "mine.yaml", swept / "all", **how)
    assert list(found) == NAMES and "".join(capfd.readouterr()) == ""
    assert found[NAMES[1]].sweep == {"seed": 1, "sensors.imu.rate_hz": 50}
    assert [found[name].read("imu").num_rows for name in NAMES] == [4, 2, 4, 2]
    assert before == {name: (swept / "all" / name / "dataset.json").stat().st_mtime_ns for name in NAMES}
    assert found[NAMES[0]].info["sweep"]["name"] == NAMES[0]


def test_the_index_finds_datasets_by_their_values(swept: Path) -> None:
    rows = duckdb.sql(f"SELECT name, seed FROM read_json('{swept}/all/sweep.json') WHERE rate_hz = 50").fetchall()
    assert rows == [(NAMES[1], 1), (NAMES[3], 2)]
    assert mmw.connect(swept / "all" / NAMES[3]).execute("SELECT count(*) FROM imu").fetchall() == [(2,)]


def test_dry_run_sums_up(swept: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    traced: list[object] = []
    monkeypatch.setattr("mmw.generation.foresee.sample_scenario", lambda *scenario: traced.append(scenario))
    assert run_own(swept, "none", *FEW, SWEEP, "--dry-run") == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == f"4 dataset(s) below {swept}/none:" and len(lines) == 6
    assert all(line.startswith(f"  {name}: 4 frames, ") for line, name in zip(lines[1:5], NAMES, strict=True))
    assert lines[5].startswith("total: 16 frames, ") and not (swept / "none").exists()
    assert not traced


def test_status_verify_and_resume_after_an_end(
    own_world: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    begun = []
    finalize = generate.finalize

    def interrupted(root: object, plan: object) -> dict:
        begun.append(str(root))
        if len(begun) == 2:
            raise KeyboardInterrupt
        return finalize(root, plan)

    with monkeypatch.context() as patch:
        patch.setattr(generate, "finalize", interrupted)
        assert run_own(own_world, "all", *FEW, SWEEP) == 1
    root = str(own_world / "all")
    capsys.readouterr()
    assert status([root]) == 1
    told = capsys.readouterr().out
    assert told.splitlines()[0].split() == [NAMES[0], "4/4", "frames"]
    assert told.count("not complete") == 1 and told.count("missing") == 2
    assert "1 of 4 datasets are complete" in told
    assert verify([root]) == 1
    ended = capsys.readouterr()
    assert "1 of 4 datasets of the sweep are complete" in ended.out and ended.err.count("has no dataset.json") == 2
    assert run_own(own_world, "all", *FEW, SWEEP) == 0
    resumed = capsys.readouterr()
    assert resumed.err.count("nothing to make") == 2
    assert (status([root]), verify([root])) == (0, 0)
    assert "4 of 4 datasets of the sweep are complete" in capsys.readouterr().out
    (own_world / "all" / NAMES[2] / "README.md").unlink()
    assert verify([root]) == 1


def test_more_values_add_datasets_and_the_index_keeps_the_others(own_world: Path) -> None:
    assert run_own(own_world, "all", *FEW, "sweep={grid: {seed: [1]}}") == 0
    assert run_own(own_world, "all", *FEW, "sweep={list: [{name: other, seed: 5}]}") == 0
    records = json.loads((own_world / "all" / "sweep.json").read_text())
    assert [(record["name"], record["seed"]) for record in records] == [("other", 5), ("seed-1", 1)]


def test_a_folder_is_one_dataset_or_several(own_world: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_own(own_world, "d", *FEW) == 0
    assert run_own(own_world, "d", *FEW, SWEEP) == 2
    assert "is one dataset, and a sweep makes a folder of several" in capsys.readouterr().err
    assert run_own(own_world, "all", *FEW, SWEEP) == 0
    assert run_own(own_world, "all", *FEW) == 2
    with pytest.raises(mmw.InputError, match=r"is a sweep of 4 datasets; give the folder of one, such as .*seed-1"):
        mmw.open_dataset(own_world / "all")
    with pytest.raises(mmw.InputError, match="makes 4 datasets, and a simulation needs one"):
        mmw.Simulation(mmw.load_config(own_world / "mine.yaml", [*FEW, SWEEP]), base=own_world)
    with pytest.raises(mmw.InputError, match="makes 4 datasets, and a scene needs one"):
        mmw.load_scene(mmw.load_config(own_world / "mine.yaml", [*FEW, SWEEP]), base=own_world)
    (own_world / "all" / "sweep.json").write_text('[{"name": "a", "folder": "../a"}]')
    assert status([str(own_world / "all")]) == 2


@pytest.mark.slow
def test_datasets_with_the_same_traffic_share_a_stage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    from mmw.scene import prepare

    made = []
    tracks = prepare.make_tracks
    monkeypatch.setattr(prepare, "make_tracks", lambda *given: made.append(given[0].seed) or tracks(*given))
    given = ["--config", str(configs_dir() / "quickstart.yaml"), *TOWN, "--device", "cpu", "--workers", "1"]
    sweep = "sweep={grid: {seed: [1, 2], weathers: [[sunny], [sunny, rainy]]}}"
    assert main([*given, sweep, "--out", str(tmp_path / "all")]) == 0
    assert made == [1, 2]
    assert main([*given, "seed=2", "weathers=[sunny, rainy]", "--out", str(tmp_path / "alone")]) == 0
    shared = tmp_path / "all" / "seed-2,weathers-sunny+rainy"
    assert_same_files(shared, tmp_path / "alone")
    for name in ("stages/town03_roundabout.usdc", "stages/town03_roundabout.json"):
        assert (shared / name).read_bytes() == (tmp_path / "alone" / name).read_bytes()
    assert verify([str(tmp_path / "all")]) == 0


@pytest.mark.parametrize(
    ("content", "part"),
    [
        ("[{", "is damaged"),
        ("[" * 100_000, "is damaged"),
        ("{}", "is no list of datasets"),
        ("[]", "is no list of datasets"),
        ("[1]", "is no list of datasets"),
        ('[{"name": "a"}]', "is no list of datasets"),
        ('[{"name": "a", "folder": "../b"}]', "is no list of datasets"),
    ],
)
def test_a_damaged_index_is_one_line(
    tmp_path: Path, content: str, part: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "sweep.json").write_text(content)
    assert status([str(tmp_path)]) == 2
    text = capsys.readouterr().err
    assert f"sweep.json: {part}" in text and "run the sweep again" in text
