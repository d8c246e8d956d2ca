"""Hashes of all files that a configuration names, and of those that these refer to."""

import hashlib
import shutil
from pathlib import Path

import pytest

from mmw.config import load_config
from mmw.core.errors import InputError
from mmw.core.resources import assets_dir
from mmw.scene.input_files import MISSING, Inputs, hash_inputs
from mmw.storage.identity import changed_inputs, inputs_sha256

STAGE = """#usda 1.0
(
    defaultPrim = "World"
    subLayers = [@./layers/below.usda@]
)
def Xform "World" (
    prepend references = @./ref.usda@
    variants = { string look = "a" }
    prepend variantSets = "look"
)
{
    asset inputs:file = @./images/a.png@
    asset inputs:tiles = @./images/tile.<UDIM>.png@
    asset inputs:gone = @./images/gone.png@
    asset clip.timeSamples = { 0: @./images/time.png@ }
    variantSet "look" = {
        "a" {}
        "b" ( payload = @./heavy.usda@ ) {}
    }
}
"""
FILES = (
    "layers/below.usda", "ref.usda", "heavy.usda", "images/a.png", "images/tile.1001.png", "images/tile.1002.png",
    "images/time.png",
)  # fmt: skip


@pytest.fixture
def world(tmp_path: Path) -> Path:
    """Write a stage with all kinds of references, and its configuration."""
    for name in FILES:
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text("#usda 1.0\n" if path.suffix == ".usda" else name)
    (tmp_path / "mine.usda").write_text(STAGE)
    (tmp_path / "c.yaml").write_text("scenarios: [{name: s, stage: mine.usda}, {name: t, stage: mine.usda}]\n")
    return tmp_path


def hashed(world: Path) -> Inputs:
    return hash_inputs(load_config(world / "c.yaml"), world)


def test_every_file_of_a_stage_is_an_input(world: Path, capfd: pytest.CaptureFixture) -> None:
    found = hashed(world)
    assert found["s"].keys() == {"mine.usda", *FILES, "images/gone.png"}
    assert found["s"] == found["t"] and found["s"]["images/gone.png"] == MISSING
    assert found["s"]["heavy.usda"] == hashlib.sha256(b"#usda 1.0\n").hexdigest()
    assert "Warning" not in capfd.readouterr().err  # USD's own, about the missing file


@pytest.mark.parametrize("name", [*FILES, "mine.usda", "images/gone.png"])
def test_a_change_of_any_file_is_told(world: Path, name: str) -> None:
    before = hashed(world)
    path = world / name
    path.write_text((path.read_text() if path.exists() else "") + "# more\n")
    after = hashed(world)
    assert changed_inputs({"inputs": before}, after) == [f"s: {name} has changed", f"t: {name} has changed"]
    assert inputs_sha256(before) != inputs_sha256(after)


def test_the_place_of_the_files_does_not_count(world: Path, tmp_path_factory: pytest.TempPathFactory) -> None:
    other = shutil.copytree(world, tmp_path_factory.mktemp("other") / "place")
    assert hashed(world) == hashed(other)
    link = tmp_path_factory.mktemp("link") / "place"
    link.symlink_to(world)
    assert hashed(link) == hashed(world)


def test_files_of_mmw_belong_to_its_version(tmp_path: Path) -> None:
    shipped = assets_dir() / "materials" / "materials.usda"
    (tmp_path / "mine.usda").write_text(f"#usda 1.0\n(\n    subLayers = [@{shipped.as_posix()}@]\n)\n")
    (tmp_path / "c.yaml").write_text("scenarios: [{name: s, stage: mine.usda}]\n")
    assert hashed(tmp_path)["s"].keys() == {"mine.usda"}


def test_a_file_or_folder_that_options_of_an_engine_name_is_an_input(tmp_path: Path) -> None:
    config = load_config("quickstart")
    (tmp_path / "model").mkdir()
    (tmp_path / "model" / "a.bin").write_bytes(b"1")
    scenario = config.scenarios[0]
    assert scenario.traffic is not None
    traffic = scenario.traffic.model_copy(update={"options": {"folder": "model", "text": "no file"}})
    config = config.model_copy(update={"scenarios": (scenario.model_copy(update={"traffic": traffic}),)})
    assert hash_inputs(config, tmp_path) == {scenario.name: {"model/a.bin": hashlib.sha256(b"1").hexdigest()}}


def test_files_that_cannot_be_used_are_named(world: Path) -> None:
    (world / "mine.usda").write_text("no usd")
    with pytest.raises(InputError, match=r"scenarios\.0\.stage = 'mine\.usda': USD cannot read it"):
        hashed(world)
    (world / "mine.usda").unlink()
    with pytest.raises(InputError, match=r"scenarios\.0\.stage = 'mine\.usda': no such file .*; give an existing one"):
        hashed(world)
