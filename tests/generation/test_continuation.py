"""A resumed run accepts what the table in `docs/guides/running.md` says, and nothing else."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from mmw.__main__ import main as mmw_main
from mmw.cli.verify import check
from mmw.core.cpu_kind import cpu_kind
from mmw.dataset import open_dataset
from mmw.generation import software
from mmw.storage.manifest import finalize, read_dataset, read_markers
from tests.fixtures.edit_files import edit_bytes, edit_json
from tests.fixtures.recorded_drive import all_files, paint, run, write_drive, write_world

OTHER = "Some CPU (family 6, model 85, AVX2)"


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with a world and its finished dataset `d`; nothing may be changed in it."""
    folder = write_world(tmp_path_factory.mktemp("drive"))
    assert run(folder) == 0
    return folder


@pytest.fixture
def folder(finished: Path, tmp_path: Path) -> Path:
    """Return a copy of it, in another place."""
    return shutil.copytree(finished, tmp_path / "copy")


def lose_a_shard(root: Path, frame: int = 2) -> str:
    """Remove the marker of a shard, as if the run had been killed before it, and return its name."""
    marker = root / "_shards" / f"drive.sunny.{frame:06d}.json"
    marker.unlink()
    return marker.name


def with_code(monkeypatch: pytest.MonkeyPatch, digest: str) -> None:
    """Let this process be a mmw of other code."""
    monkeypatch.setattr(software, "code_digest", lambda: digest)


def test_unchanged_inputs_are_left_alone(folder: Path, capsys: pytest.CaptureFixture) -> None:
    before = all_files(folder / "d")
    assert check(folder / "d", 1) == []
    assert run(folder) == 0
    assert "6 of 6 frames are there already; nothing to make" in capsys.readouterr().err
    after = all_files(folder / "d")
    assert {name for name in before if before[name] != after.get(name)} <= {"_manifest.parquet", "README.md"}
    assert after.keys() == before.keys() and after["README.md"] == before["README.md"]
    assert read_dataset(folder / "d")["inputs"]["drive"].keys() == {
        "drive.csv", "town.usda", "geometry.usda", "images/street.png",
    }  # fmt: skip


def test_a_resumed_shard_has_the_same_bytes(folder: Path) -> None:
    before = all_files(folder / "d")
    lose_a_shard(folder / "d")
    for path in (folder / "d").rglob("part-000002.parquet"):
        path.unlink()
    assert run(folder) == 0
    after = all_files(folder / "d")
    assert [name for name in before if name.endswith("part-000002.parquet") and after[name] != before[name]] == []
    assert check(folder / "d", 1) == []


def change_geometry(folder: Path) -> None:
    path = folder / "town" / "geometry.usda"
    path.write_text(path.read_text().replace("(-50, -50, 0)", "(-51, -50, 0)"))


CHANGES: dict[str, Callable[[Path], None]] = {
    "drive.csv": lambda folder: write_drive(folder / "drive.csv", speed=9.0),
    "geometry.usda": change_geometry,
    "images/street.png": lambda folder: paint(folder / "town" / "images" / "street.png", (91, 90, 90)),
    "town.usda": lambda folder: edit_bytes(folder / "town" / "town.usda", lambda data: data + b"# again\n"),
}
"""Name of an input file -> its change."""


@pytest.mark.parametrize("name", CHANGES)
@pytest.mark.parametrize("is_complete", [True, False])
def test_a_changed_file_is_refused_and_named(
    folder: Path, capsys: pytest.CaptureFixture, name: str, is_complete: bool
) -> None:
    if not is_complete:
        lose_a_shard(folder / "d")
    before = all_files(folder / "d")
    CHANGES[name](folder)
    for more in ((), ("--accept", "versions", "--accept", "machine"), ("--shard", "0/2")):
        assert run(folder, *more) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert f"was made from other input files: drive: {name} has changed; " in line
        assert "put the old content back, use --overwrite to replace the data, or another --out" in line
    assert all_files(folder / "d") == before


def test_a_changed_file_makes_another_dataset_with_overwrite(folder: Path) -> None:
    write_drive(folder / "drive.csv", speed=9.0)
    assert run(folder, "--overwrite") == 0
    speeds = open_dataset(folder / "d").read("poses", agent="cav_1").column("vx").to_pylist()
    assert speeds == pytest.approx([9.0] * 6, abs=0.1)
    assert check(folder / "d", 1) == []


def test_a_file_that_is_new_or_gone_is_named(folder: Path, capsys: pytest.CaptureFixture) -> None:
    town = folder / "town" / "town.usda"
    (folder / "town" / "more.usda").write_text("#usda 1.0\n")
    text = town.read_text()
    town.write_text(
        text.replace(
            "prepend references = @./geometry.usda@", "prepend references = [@./geometry.usda@, @./more.usda@]"
        )
    )
    assert run(folder) == 2
    assert "drive: more.usda is new; drive: town.usda has changed" in capsys.readouterr().err


def test_a_table_that_is_corrected_before_any_shard_makes_a_new_stage(
    tmp_path: Path, capsys: pytest.CaptureFixture
) -> None:
    folder = write_world(tmp_path)
    write_drive(folder / "drive.csv", lead_x=-6.0)  # around the LiDAR of the other
    assert run(folder) == 2
    assert "is inside" in capsys.readouterr().err
    stage = (folder / "d" / "stages" / "drive.usdc").read_bytes()
    write_drive(folder / "drive.csv")
    assert run(folder) == 0
    assert (folder / "d" / "stages" / "drive.usdc").read_bytes() != stage
    assert check(folder / "d", 1) == []


def test_other_code_before_any_shard_makes_a_new_stage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    folder = write_world(tmp_path)
    write_drive(folder / "drive.csv", lead_x=-6.0)
    with_code(monkeypatch, "old")
    assert run(folder) == 2
    made = (folder / "d" / "stages" / "drive.usdc").stat().st_mtime_ns
    with_code(monkeypatch, "new")
    assert run(folder) == 2
    assert (folder / "d" / "stages" / "drive.usdc").stat().st_mtime_ns > made
    assert "code new" in read_dataset(folder / "d")["versions"]["software"]


def test_an_included_file_counts_by_what_it_says(folder: Path, capsys: pytest.CaptureFixture) -> None:
    outer = (folder / "drive.yaml").read_text()
    start = outer.index("frames:")
    (folder / "inner.yaml").write_text(outer[:start])
    (folder / "outer.yaml").write_text("scenarios: [inner.yaml]\n" + outer[start:])
    assert run(folder, config="outer.yaml") == 0  # the same configuration as that of one file
    assert "nothing to make" in capsys.readouterr().err
    (folder / "inner.yaml").write_text("# a comment\n" + outer[:start])
    assert run(folder, config="outer.yaml") == 0
    (folder / "inner.yaml").write_text(outer[:start].replace("[0, -12, 0]", "[0, -13, 0]"))
    assert run(folder, config="outer.yaml") == 2
    assert "scenarios.0.rsus.0.position_m.1: -12.0 -> -13" in capsys.readouterr().err


def test_other_versions_are_refused_or_recorded(
    folder: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = folder / "d"
    own = software.code_digest()
    with_code(monkeypatch, "0ther")
    assert run(folder) == 0  # nothing to make, nothing to mix
    assert f"was made with other versions: code {own} -> 0ther; it is complete" in capsys.readouterr().err
    name = lose_a_shard(root)
    lose_a_shard(root, 4)
    before = all_files(root)
    assert run(folder) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"code {own} -> 0ther" in line and "allow it by --accept versions, or use --overwrite" in line
    assert run(folder, "--accept", "machine") == 2
    assert all_files(root) == before
    capsys.readouterr()
    assert run(folder, "--accept", "versions") == 0
    assert f"code {own} -> 0ther; accepted" in capsys.readouterr().err
    marker = json.loads((root / "_shards" / name).read_text())
    assert "code 0ther" in marker["software"] and marker["accepted"] == "versions"
    assert mmw_main(["verify", str(root)]) == 0
    out = capsys.readouterr().out
    assert "mixed: _shards: made by 2 versions of the software" in out and "code 0ther" in out
    assert "see above what its shards are mixed of" in out
    assert mmw_main(["status", str(root)]) == 0
    assert "mixed: made by 2 versions of the software" in capsys.readouterr().out
    lose_a_shard(root)
    assert run(folder) == 0  # another shard has been accepted
    assert json.loads((root / "_shards" / name).read_text())["accepted"] == "versions"
    assert [finding.kind for finding in check(root, 1)] == ["mixed"]


def test_a_shard_that_nobody_accepted_is_an_error(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where a shard of another dataset, of the same configuration and other code, was copied into this one."""
    other = shutil.copytree(folder / "d", folder / "other")
    with_code(monkeypatch, "0ther")
    assert run(folder, "--overwrite", out="other") == 0
    for path in [*other.rglob("part-000002.parquet"), other / "_shards" / "drive.sunny.000002.json"]:
        shutil.copy(path, folder / "d" / path.relative_to(other))
    finalize(folder / "d")
    found = {finding.kind: finding.text for finding in check(folder / "d", 1)}
    assert found.keys() == {"mixed", "versions"}
    assert "code 0ther" in found["versions"] and "no run was told to --accept versions" in found["versions"]
    lose_a_shard(folder / "d")
    assert run(folder) == 2  # it does not count as accepted


def test_another_machine_is_refused_or_recorded(
    folder: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = folder / "d"
    lose_a_shard(root)
    monkeypatch.setattr("mmw.generation.executors.executor.machine_kind", lambda device: OTHER)
    monkeypatch.setattr("mmw.generation.worker.machine_kind", lambda device: OTHER)
    assert run(folder) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"on another kind of machine: {cpu_kind()} -> {OTHER}" in line and "allow it by --accept machine" in line
    assert run(folder, "--shard", "1/2") == 2
    assert f"remove {root} to make it again" in capsys.readouterr().err
    assert run(folder, "--shard", "1/2", "--accept", "machine") == 0
    assert {marker["device"] for marker in read_markers(root)} == {cpu_kind(), OTHER}
    assert mmw_main(["verify", str(root)]) == 0
    assert "mixed: _shards: made on 2 kinds of machine" in capsys.readouterr().out


def test_a_worker_on_another_kind_of_device_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As where a machine has two kinds of GPU, or a cluster two kinds of node."""
    folder = write_world(tmp_path)
    monkeypatch.setattr("mmw.generation.worker.machine_kind", lambda device: OTHER)
    assert run(folder) == 2
    assert f"cpu: is another kind of machine than the dataset has: {cpu_kind()} -> {OTHER}" in capsys.readouterr().err
    assert run(folder, "--accept", "machine") == 0
    assert {marker["device"] for marker in read_markers(folder / "d")} == {OTHER}


def test_parts_of_several_runs_have_one_identity(tmp_path: Path) -> None:
    folder = write_world(tmp_path)
    assert run(folder, "--shard", "1/2") == run(folder, "--shard", "0/2") == 0
    assert run(folder, "--shard", "1/2") == run(folder) == 0
    assert check(folder / "d", 1) == []


def test_verify_needs_no_input_file(folder: Path, capsys: pytest.CaptureFixture) -> None:
    for name in ("drive.csv", "town", "drive.yaml"):
        (folder / name).rename(folder / f"old-{name}")
    assert check(folder / "d", 1) == []
    assert mmw_main(["status", str(folder / "d")]) == 0
    (folder / "old-drive.yaml").rename(folder / "drive.yaml")
    assert run(folder) == 2
    assert "no such file" in capsys.readouterr().err


def test_a_dataset_of_an_older_mmw_goes_on_if_told_to(folder: Path, capsys: pytest.CaptureFixture) -> None:
    """Datasets of 0.2.0 record neither their inputs nor their code."""
    root = folder / "d"
    files = read_dataset(root)["inputs"]["drive"]

    def older(head: dict) -> None:
        del head["inputs"], head["inputs_sha256"], head["versions"]["software"], head["versions"]["code"]
        head["versions"]["sources"] = {"drive": {name: files[name] for name in ("drive.csv", "town.usda")}}

    edit_json(root / "dataset.json", older)
    for path in (root / "_shards").glob("*.json"):
        edit_json(path, lambda marker: [marker.pop(key) for key in ("inputs_sha256", "software", "accepted")])
    assert run(folder) == 0
    assert "code unknown -> " in capsys.readouterr().err
    lose_a_shard(root)
    assert run(folder) == 2
    assert "code unknown -> " in capsys.readouterr().err
    write_drive(folder / "drive.csv", speed=9.0)
    assert run(folder, "--accept", "versions") == 2
    assert "drive: drive.csv has changed" in capsys.readouterr().err
    write_drive(folder / "drive.csv")
    assert run(folder, "--accept", "versions") == 0
    finalize(root)
    assert read_markers(root)[0]["config_sha256"] == read_dataset(root)["config_sha256"]
