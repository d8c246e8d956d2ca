"""Promises of `docs/concepts/determinism.md`: the kind of machine is recorded; another one must be accepted."""

import shutil
from pathlib import Path

import pytest

import mmw.cli.regenerate
import mmw.generation.verification.reproducibility
from mmw.__main__ import main as mmw_main
from mmw.cli.run import main
from mmw.core import cpu_kind as cpu
from mmw.core.device import machine_kind
from mmw.storage.file_checks import verify
from mmw.storage.manifest import read_dataset, read_markers
from tests.fixtures.edit_files import edit_json
from tests.fixtures.own_world import assert_same_files, command

OTHER = "Some CPU (family 6, model 85, AVX2)"


@pytest.fixture
def dataset(world: Path) -> Path:
    shutil.rmtree(world / "copy", ignore_errors=True)
    return Path(shutil.copytree(world / "single", world / "copy"))


AMD = """processor\t: 0
cpu family\t: 25
model\t\t: 17
model name\t: AMD EPYC
flags\t\t: fpu sse4_2 avx avx2 fma{more}

processor\t: 1
model name\t: not this one
"""
ARM = """processor\t: 0
Features\t: fp asimd
CPU implementer\t: 0x41
CPU part\t: 0xd40
"""


def test_a_processor_is_named_by_model_and_width(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    more = " avx512f avx512bw avx512dq avx512vl"
    assert cpu.parse_cpu_info(AMD.format(more=more)) == "AMD EPYC (family 25, model 17, AVX-512)"
    assert cpu.parse_cpu_info(AMD.format(more="")) == "AMD EPYC (family 25, model 17, AVX2)"
    assert cpu.parse_cpu_info(AMD.format(more="").replace("avx2 fma", "")) == "AMD EPYC (family 25, model 17, AVX)"
    assert cpu.parse_cpu_info(ARM).endswith(" (implementer 0x41, part 0xd40, NEON)")
    assert cpu.parse_cpu_info("") == cpu.parse_cpu_info("nothing\n") == ""
    monkeypatch.setattr(cpu, "CPU_INFO", tmp_path / "none")
    monkeypatch.setattr(cpu.platform, "processor", lambda: "i386")
    assert cpu.cpu_kind.__wrapped__() == "i386"


def test_every_shard_says_what_made_it(world: Path) -> None:
    made_on = {marker["device"] for marker in read_markers(world / "single")}
    assert made_on == {machine_kind("cpu")} == {cpu.cpu_kind()}
    assert read_dataset(world / "single")["versions"]["device"] == cpu.cpu_kind()


def begun_elsewhere(dataset: Path) -> None:
    """Let a dataset say that another kind of machine made it, and lose a shard."""
    edit_json(dataset / "dataset.json", lambda head: head["versions"].update(device=OTHER))
    for path in (dataset / "_shards").glob("*.json"):
        edit_json(path, lambda marker: marker.update(device=OTHER))
    sorted((dataset / "_shards").glob("*.sunny.*.json"))[1].unlink()


def test_a_run_goes_on_on_another_kind_of_machine(world: Path, dataset: Path, capsys: pytest.CaptureFixture) -> None:
    begun_elsewhere(dataset)
    for more, code in ((), 2), (("--accept", "machine"), 0):
        assert main(command(world, dataset.name, "--workers", "1", *more)) == code
        lines = [line for line in capsys.readouterr().err.splitlines() if OTHER in line]
        assert len(lines) == 1 and f"made on another kind of machine: {OTHER} -> {cpu.cpu_kind()}" in lines[0]
        assert "last bits may differ" in lines[0]
    assert_same_files(world / "single", dataset)  # of one machine, in truth
    (finding,) = verify(dataset)
    assert finding.kind == "mixed" and not finding.is_error
    assert "made on 2 kinds of machine" in finding.text and OTHER in finding.text
    assert mmw_main(["verify", str(dataset)]) == 0
    assert "made on 2 kinds of machine" in capsys.readouterr().out


def test_the_other_kind_of_trees_is_another_version(world: Path, dataset: Path, capsys: pytest.CaptureFixture) -> None:
    own = read_dataset(dataset)["versions"]["bvh"]
    other = {"wide": "warp", "warp": "wide"}[own]
    sorted((dataset / "_shards").glob("*.sunny.*.json"))[1].unlink()
    assert main(command(world, dataset.name, "--workers", "1", f"compute.bvh={other}")) == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert f"was made with other versions: compute.bvh {own} -> {other}; " in line
    assert main(command(world, dataset.name, "--workers", "1", f"compute.bvh={own}")) == 0


@pytest.mark.parametrize("here", [True, False])
def test_rows_that_differ_are_wrong_on_the_same_kind_of_machine_alone(
    dataset: Path, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch, here: bool
) -> None:
    if not here:
        for module in (mmw.generation.verification.reproducibility, mmw.core.device):
            monkeypatch.setattr(module, "machine_kind", lambda device: OTHER)
    monkeypatch.setattr(mmw.generation.verification.reproducibility, "differing_columns", lambda *_: ["x"])
    assert mmw_main(["verify", str(dataset), "--rerender", "2", "--device", "cpu"]) == (1 if here else 0)
    out = capsys.readouterr().out
    assert "made again differs in x" in out and (f"and this is {OTHER}" in out) is not here
    monkeypatch.setattr(mmw.generation.regenerate, "differing_columns", lambda *_: ["x"])
    row = ["regenerate", "imu", str(dataset), "frame=3", "weather=sunny", "--compare", "--device", "cpu"]
    assert mmw_main(row) == 1
    out = capsys.readouterr().out
    assert "rows differ in x" in out and (f"made on {cpu.cpu_kind()}, and this is {OTHER}" in out) is not here
