"""License and notices travel with a dataset, into its card and its exports."""

from pathlib import Path

import pytest
import yaml
from pxr import Usd

from mmw.cli.run import main
from mmw.core.licenses import license_of
from mmw.dataset.export.exporter import export
from mmw.generation.verification.completeness import check_plan, read_plan
from mmw.storage.store import store_of
from mmw.usd.notices import read_notices, write_notice
from mmw.worlds.importers.formats import read_scene
from mmw.worlds.importers.material_map import apply_material_map
from mmw.worlds.importers.write_asset import write_scene
from tests.fixtures.own_world import command, write_own_world

OURS = "(c) 2026 the authors"


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = write_own_world(tmp_path_factory.mktemp("licensed"))
    stage = Usd.Stage.Open(str(folder / "mine.usda"))
    write_notice(stage.GetRootLayer(), "contains a map of somebody, ODbL 1.0")
    stage.Save()
    return folder


@pytest.fixture(scope="module")
def root(world: Path) -> Path:
    more = ("output.license=cc-by-sa-4.0", f"output.notices=['{OURS}']", "frames.count=2", "sensors=[{type: imu}]")
    assert main(command(world, "data", *more, "channel.carriers_hz=[77e9]", "channel.diffuse_reflection=true")) == 0
    return world / "data"


def problems(root: Path) -> list[tuple[str, str]]:
    store = store_of(root)
    config, findings = read_plan(store)
    assert config is not None and not findings
    return [(found.kind, found.path) for found in check_plan(store, config)]


def front_matter(path: Path) -> dict:
    return yaml.safe_load(path.read_text().split("---")[1])


def test_files_and_card(root: Path) -> None:
    assert license_of((root / "LICENSE").read_text()) == "CC-BY-SA-4.0"
    notice = (root / "NOTICE").read_text()
    assert "Made with mmw" in notice and "Scenario mine: contains a map of somebody, ODbL 1.0" in notice
    assert OURS in notice
    card = (root / "README.md").read_text()
    assert front_matter(root / "README.md")["license"] == "cc-by-sa-4.0"
    assert "License: CC-BY-SA-4.0, see `LICENSE` and `NOTICE`" in card
    assert "## Notes" in card and "channel.diffuse_reflection finds nothing" in card
    assert problems(root) == []


def test_another_license_of_the_same_data(world: Path, root: Path) -> None:
    more = ("output.license=CC0-1.0", "frames.count=2", "sensors=[{type: imu}]")
    before = {path: path.stat().st_mtime_ns for path in root.rglob("part-*.parquet")}
    assert main(command(world, "data", *more, "channel.carriers_hz=[77e9]", "channel.diffuse_reflection=true")) == 0
    assert license_of((root / "LICENSE").read_text()) == "CC0-1.0"
    assert front_matter(root / "README.md")["license"] == "cc0-1.0"
    assert OURS not in (root / "NOTICE").read_text()
    assert {path: path.stat().st_mtime_ns for path in before} == before


@pytest.mark.parametrize("name", ["LICENSE", "NOTICE"])
def test_verify_misses_them(root: Path, name: str) -> None:
    text = (root / name).read_text()
    try:
        (root / name).unlink()
        assert problems(root) == [("missing", name)]
        (root / name).write_text("do as you like\n")
        assert problems(root) == ([("license", name)] if name == "LICENSE" else [])
    finally:
        (root / name).write_text(text)


def test_exports_have_them(root: Path, tmp_path: Path) -> None:
    export(root, "huggingface", tmp_path / "hub")
    assert front_matter(tmp_path / "hub" / "README.md")["license"] == front_matter(root / "README.md")["license"]
    for name in ("LICENSE", "NOTICE"):
        assert (tmp_path / "hub" / name).read_text() == (root / name).read_text()
    export(root, "huggingface", tmp_path / "own", options={"license": "mit"})
    assert front_matter(tmp_path / "own" / "README.md")["license"] == "mit"


def test_an_import_of_openstreetmap_names_it(tmp_path: Path) -> None:
    (tmp_path / "a.osm").write_text(
        '<osm><bounds minlat="0" minlon="0" maxlat="0.001" maxlon="0.001"/>'
        + "".join(
            f'<node id="{k}" lat="{y}" lon="{x}"/>'
            for k, (x, y) in enumerate(((2e-4, 2e-4), (4e-4, 2e-4), (4e-4, 4e-4), (2e-4, 4e-4)), 1)
        )
        + '<way id="9">'
        + "".join(f'<nd ref="{k}"/>' for k in (1, 2, 3, 4, 1))
        + '<tag k="building" v="yes"/></way></osm>'
    )
    scene = apply_material_map("a.osm", read_scene(tmp_path / "a.osm"), {})
    path = write_scene(scene, tmp_path / "asset", "a")
    (notice,) = read_notices(Usd.Stage.Open(str(path)))
    assert "OpenStreetMap contributors" in notice and "ODbL" in notice
    again = read_scene(path)  # a USD asset that is imported once more
    assert again.notice == notice
