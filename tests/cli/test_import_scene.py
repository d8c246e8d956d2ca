"""`mmw import`: what is written, what is printed, and what is refused."""

import errno
import os
import shutil
from pathlib import Path

import numpy as np
import pytest
from pxr import Kind, Usd, UsdGeom, UsdShade

from mmw.__main__ import main as mmw
from mmw.cli.import_scene import main
from mmw.config import load_config
from mmw.core.resources import assets_dir
from mmw.physics.materials.material import RadioMaterial
from mmw.scene.input_files import hash_inputs
from mmw.scene.stage.asset_copies import dependencies
from mmw.storage.identity import changed_inputs
from mmw.traffic.roads.lane_graph import Lane, LaneGraph
from mmw.traffic.roads.lane_prims import read_lanes
from mmw.usd import atomic_layers as save
from mmw.usd.materials import MaterialUse, read_material
from mmw.usd.validate import validate_stage
from mmw.worlds.importers.imported_scene import ImportedMaterial, ImportedScene
from mmw.worlds.importers.write_asset import asset_files, write_scene
from mmw.worlds.towns.mesh_part import MeshPart
from tests.fixtures.import_files import HIGH, HOUSE, LOW, write_glb, write_mitsuba, write_obj
from tests.fixtures.scenes import quad_part
from tests.fixtures.xodr_files import t_town

MAP = '"tarmac": {material: asphalt, label: road}\n"red*": {radio: itu_brick, thickness: 0.2, label: building}\n'


@pytest.fixture
def glb(tmp_path: Path) -> tuple[Path, Path]:
    (tmp_path / "map.yaml").write_text(MAP)
    return write_glb(tmp_path / "my world.glb"), tmp_path / "map.yaml"


def test_an_asset_like_the_shipped_towns(glb: tuple[Path, Path], tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    file, materials = glb
    assert mmw(["import", str(file), "--out", str(tmp_path / "town"), "--materials", str(materials)]) == 0
    path = tmp_path / "town" / "my_world.usda"
    printed = capsys.readouterr().out
    for part in (
        "bounds: (-20.00, -15.00, 0.00) to (20.00, 15.00, 6.00) m, 40.00 x 30.00 x 6.00 m",
        "14 triangles in 2 meshes", "material red_brick: 12 triangles, itu_brick, slab of 0.2 m",
        "material asphalt: 2 triangles, of the library", "labels: road 1, building 1", "lanes: none",
        f"wrote {path}", f"mmw town check {path}", "engine: replay",
    ):  # fmt: skip
        assert part in printed
    stage = Usd.Stage.Open(str(path))
    assert validate_stage(stage) == []
    root = stage.GetDefaultPrim()
    assert (root.GetPath(), Usd.ModelAPI(root).GetKind()) == ("/Town", "assembly")
    assert (UsdGeom.GetStageUpAxis(stage), UsdGeom.GetStageMetersPerUnit(stage)) == ("Z", 1.0)
    hint = UsdGeom.ModelAPI(root).GetExtentsHint()
    assert np.allclose(hint, (LOW, HIGH))
    kinds = {str(prim.GetPath()): Usd.ModelAPI(prim).GetKind() for prim in stage.Traverse()}
    assert (kinds["/Town/Model"], kinds["/Town/Model/block"]) == (Kind.Tokens.group, Kind.Tokens.component)
    mesh = stage.GetPrimAtPath("/Town/Model/block/house")
    bound = UsdShade.MaterialBindingAPI(mesh).ComputeBoundMaterial()[0].GetPrim()
    assert bound.GetPath() == "/Town/Materials/red_brick"
    assert bound.GetAttribute("mmw:radio:thickness").Get() == pytest.approx(0.2)
    assert bound.GetAttribute("omni:simready:nonvisual:base").Get() == "brick"
    assert len(stage.GetPrimAtPath("/Town/Materials").GetChildren()) == 2


def test_rain_wets_the_library_ground_and_nothing_else(glb: tuple[Path, Path], tmp_path: Path) -> None:
    file, materials = glb
    assert main([str(file), "--out", str(tmp_path / "t"), "--materials", str(materials)]) == 0
    stage = Usd.Stage.Open(str(tmp_path / "t" / "my_world.usda"))
    weather = stage.GetDefaultPrim().GetVariantSet("weather")
    assert weather.GetVariantNames() == ["foggy", "rainy", "sunny"]
    rows = {}
    for name in weather.GetVariantNames():
        weather.SetVariantSelection(name)
        rows[name] = [
            stage.GetPrimAtPath(f"/Town/Materials/{m}").GetAttribute("mmw:radio:itu").Get()
            for m in ("asphalt", "red_brick")
        ]
    assert rows == {
        "sunny": ["itu_very_dry_ground", "itu_brick"],
        "rainy": ["itu_wet_ground", "itu_brick"],
        "foggy": ["itu_wet_ground", "itu_brick"],
    }


def test_the_same_file_gives_the_same_bytes(tmp_path: Path) -> None:
    file = write_mitsuba(tmp_path)
    for out in ("a", "b"):
        assert main([str(file), "--out", str(tmp_path / out / "x.usda")]) == 0
    one, two = asset_files(tmp_path / "a" / "x.usda", "x"), asset_files(tmp_path / "b" / "x.usda", "x")
    assert [path.name for path in one] == ["x.usda", "x_geometry.usdc"]
    assert [path.read_bytes() for path in one] == [path.read_bytes() for path in two]


def test_files_that_are_there_stay(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    file, out = write_mitsuba(tmp_path), tmp_path / "out"
    assert main([str(file), "--out", str(out)]) == 0
    (out / "scene.usda").write_text("mine")
    assert main([str(file), "--out", str(out)]) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert (out / "scene.usda").read_text() == "mine"
    assert main([str(file), "--out", str(out), "--overwrite"]) == 0
    assert validate_stage(Usd.Stage.Open(str(out / "scene.usda"))) == []
    again = [str(out / "scene.usda"), "--out", str(out / "scene.usda"), "--overwrite"]
    assert main(again) == 2
    assert "would replace the file that is imported" in capsys.readouterr().err


def test_a_full_disk_leaves_nothing_half_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    file, out, calls = write_mitsuba(tmp_path), tmp_path / "out", []

    def full(descriptor: int) -> None:
        calls.append(descriptor)
        if len(calls) == 2:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "disk")

    monkeypatch.setattr(save.os, "fsync", full)
    assert main([str(file), "--out", str(out)]) == 1
    assert "No space left" in capsys.readouterr().err
    assert list(out.iterdir()) == []


def test_an_import_of_an_import_is_the_same_world(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    assert main([str(write_mitsuba(tmp_path)), "--out", str(tmp_path / "a")]) == 0
    first = capsys.readouterr().out.splitlines()[:4]
    assert main([str(tmp_path / "a" / "scene.usda"), "--out", str(tmp_path / "b")]) == 0
    assert capsys.readouterr().out.splitlines()[:4] == first


def test_lanes_are_written(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    lane = Lane("a", np.array([[-9.0, 0, 0], [9, 0, 0]]), 3.5, 8.0, successors=("a",))
    road = quad_part("Roads/a", [(-10, -4, 0), (10, -4, 0), (10, 4, 0), (-10, 4, 0)])
    path = write_scene(ImportedScene([road], lanes=LaneGraph({"a": lane})), tmp_path, "town")
    stage = Usd.Stage.Open(str(path))
    assert validate_stage(stage) == []
    assert read_lanes(stage, "/Town/Lanes").lanes["a"].successors == ("a",)
    assert main([str(path), "--out", str(tmp_path / "again")]) == 0
    printed = capsys.readouterr().out
    assert "lanes: 1" in printed
    assert "no lane is long enough for simulated traffic (21 m are needed)" in printed
    assert "traffic: {engine: replay, trajectories: drives.csv, spawn_center_m: [0, 0, 0]}" in printed


def test_a_world_is_a_folder_that_opens_anywhere(glb: tuple[Path, Path], tmp_path: Path) -> None:
    file, materials = glb
    assert main([str(file), "--out", str(tmp_path / "town"), "--materials", str(materials)]) == 0
    place = shutil.copytree(tmp_path / "town", tmp_path / "elsewhere" / "town")
    shutil.rmtree(tmp_path / "town")
    found = dependencies(place / "my_world.usda")
    assert (found.missing, found.is_movable) == ([], True)
    names = {path.relative_to(place.resolve()).as_posix() for path in found.files}
    textures = {f"my_world_materials/textures/{name}.png" for name in ("asphalt", "asphalt_normal")}
    assert names == {"my_world.usda", "my_world_geometry.usdc", "my_world_materials/materials.usda", *textures}
    assert {path for path in place.rglob("*") if path.is_file()} == {place / name for name in names}
    stage = Usd.Stage.Open(str(place / "my_world.usda"))
    assert validate_stage(stage) == []
    shipped = Usd.Stage.Open(str(assets_dir() / "materials" / "materials.usda"))
    use = MaterialUse("asphalt", "/Town/Materials/asphalt", None)
    original = MaterialUse("asphalt", "/Materials/asphalt", None)
    for physics in ("paper", "standard"):  # `standard` asks whether a material is one of the library
        copied = read_material(stage, use, physics=physics)
        other = read_material(shipped, original, physics=physics)
        assert (copied.radio, copied.radar_radio) == (other.radio, other.radar_radio)
        pictures = [[Path(texture.file).name for texture in one.appearance.textures] for one in (copied, other)]
        assert pictures[0] == pictures[1]


def test_another_import_under_a_dataset_is_told(glb: tuple[Path, Path], tmp_path: Path) -> None:
    file, materials = glb
    (tmp_path / "c.yaml").write_text("scenarios: [{name: s, stage: town/my_world.usda}]\n")

    def hashed(*options: str) -> dict[str, dict[str, str]]:
        command = [str(file), "--out", str(tmp_path / "town"), "--materials", str(materials), *options]
        assert main([*command, "--overwrite"]) == 0
        return hash_inputs(load_config(tmp_path / "c.yaml"), tmp_path)

    first = hashed()
    assert len(first["s"]) == 5
    assert changed_inputs({"inputs": first}, hashed()) == []
    moved = changed_inputs({"inputs": first}, hashed("--origin", "1", "0", "0"))
    assert "s: my_world_geometry.usdc has changed" in moved
    hashed()
    texture = tmp_path / "town" / "my_world_materials" / "textures" / "asphalt.png"
    texture.write_bytes(texture.read_bytes() + b"0")
    after = hash_inputs(load_config(tmp_path / "c.yaml"), tmp_path)
    assert changed_inputs({"inputs": first}, after) == ["s: my_world_materials/textures/asphalt.png has changed"]


def test_labels_stand_as_high_as_they_hold(tmp_path: Path) -> None:
    brick = ImportedMaterial("brick", "brick", radio=RadioMaterial("itu", itu="itu_brick"))
    parts = [
        MeshPart(path, *HOUSE, "brick", label)
        for path, label in (
            ("A/one/wall", "building"), ("A/one/roof", "building"), ("A/two/wall", "wall"), ("B/x/y/z", "pole"),
            ("B/x/flag", "pole"), ("C/free", "unlabeled"), ("D", "car"),
        )
    ]  # fmt: skip
    world = ImportedScene(parts, {"brick": brick}, components=frozenset({"B/x", "D"}))
    stage = Usd.Stage.Open(str(write_scene(world, tmp_path, "town")))
    assert validate_stage(stage) == []
    labels = {
        str(prim.GetPath())[6:]: list(prim.GetAttribute("semantics:labels:class").Get())
        for prim in stage.Traverse()
        if prim.HasAttribute("semantics:labels:class")
    }
    assert labels == {"A/one": ["building"], "A/two": ["wall"], "B": ["pole"], "D": ["car"]}
    kinds = {
        str(prim.GetPath())[6:]: Usd.ModelAPI(prim).GetKind()
        for prim in stage.Traverse()
        if prim.GetParent().GetParent()
    }
    assert {path: kind for path, kind in kinds.items() if kind} == {
        "A": "group", "A/one": "component", "A/two": "component", "B": "group", "B/x": "component", "C": "group",
        "D": "component",
    }  # fmt: skip


def test_centimetres_taken_for_metres_are_noted(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    source = write_obj(tmp_path / "w.obj", scale=100.0)
    (tmp_path / "map.yaml").write_text('"*": itu_concrete')
    for unit, is_noted in (("m", True), ("cm", False)):
        options = ["--materials", str(tmp_path / "map.yaml"), "--unit", unit]
        assert main([str(source), "--out", str(tmp_path / unit), *options]) == 0
        assert ("note: 600 m high; if its unit is no meter" in capsys.readouterr().out) == is_noted


@pytest.mark.parametrize(
    ("options", "part"),
    [
        (["a.blend"], ".blend is not read; give one of .xml"),
        (["a.xodr", "--up", "y"], "remove --up"),
        (["a.obj", "--strict"], "remove --strict"),
        (["a.osm.xml", "--unit", "cm"], "remove --unit"),
        (["a.usda", "--up", "y"], "remove --up"),
        (["nowhere.xml"], "cannot be read"),
        (["nowhere.glb"], "no such file"),
        (["w.obj", "--unit", "km"], "larger than 20 km"),
        (["w.obj", "--unit", "mm"], "smaller than 1 m"),
        (["w.obj"], "no radio material"),
        (["w.obj", "--materials", "nowhere.yaml"], "no such file"),
        (["w.obj", "--origin", "0", "0", "30000"], "30000.*--origin|--origin 0 0 -30000"),
    ],
)
def test_what_cannot_be_imported_is_exit_code_2(
    tmp_path: Path, options: list[str], part: str, capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    write_obj(tmp_path / "w.obj")
    assert main([*options, "--out", str(tmp_path / "out")]) == 2
    text = capsys.readouterr().err
    assert text.startswith("mmw: ")
    assert any(wanted in text for wanted in part.split("|"))
    assert not (tmp_path / "out").exists()


def test_buildings_along_the_roads_of_a_file(tmp_path: Path, capsys: pytest.CaptureFixture) -> None:
    (tmp_path / "town.xodr").write_text(t_town())
    command = [str(tmp_path / "town.xodr"), "--out", str(tmp_path / "town")]
    assert main([*command, "--buildings", "suburb", "--seed", "4"], "mmw import") == 0
    assert "made for --buildings, seed 4: " in capsys.readouterr().out
    stage = Usd.Stage.Open(str(tmp_path / "town" / "town.usda"))
    assert validate_stage(stage) == []
    assert len(stage.GetPrimAtPath("/Town/Buildings").GetChildren()) > 10
    for more, message in {
        ("--seed", "3"): "goes with --buildings",
        ("--buildings", "hamlet"): "is no mix; give city, suburb or a YAML file",
        ("--terrain", "x.tif"): "--terrain: no option of .xodr files",
    }.items():
        assert main([*command, "--overwrite", *more], "mmw import") == 2
        assert message in capsys.readouterr().err
