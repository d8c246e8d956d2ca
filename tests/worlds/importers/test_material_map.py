"""Material maps: the first pattern decides, names are checked, and nothing is left without radio material."""

from pathlib import Path

import numpy as np
import pytest
import yaml

from mmw.config import ConfigError, load_config
from mmw.config.load import to_yaml
from mmw.config.material_map import MaterialEntry
from mmw.physics.materials.material import RadioMaterial
from mmw.scene.reader import read_stage
from mmw.usd.material_library import LIBRARY
from mmw.worlds.importers.imported_scene import ImportedMaterial, ImportedScene
from mmw.worlds.importers.material_map import apply_material_map, load_material_map
from mmw.worlds.importers.write_asset import material_spec
from mmw.worlds.towns.mesh_part import MeshPart
from tests.fixtures.stages import add_box, add_material, new_stage

TRIANGLE = (np.array([[0.0, 0, 0], [5, 0, 0], [0, 5, 0]]), np.array([[0, 1, 2]], np.int32))


def entries(text: str) -> dict[str, MaterialEntry]:
    data = yaml.safe_load(text)
    return {key: MaterialEntry.model_validate(value) for key, value in data.items()}


def world(*parts: tuple[str, str], **materials: ImportedMaterial) -> ImportedScene:
    found = [MeshPart(path, *TRIANGLE, material, "unlabeled") for path, material in parts]
    return ImportedScene(found, materials)


MARBLE = RadioMaterial("itu", itu="itu_marble", thickness=0.5)
MIXED = world(
    ("Model/ground", "grey"), ("Model/house/wall", "stone"), ("Model/house/roof", "stone"), ("Model/door", "wood"),
    grey=ImportedMaterial("grey", "Gray 50%", color=(0.5, 0.5, 0.5)),
    stone=ImportedMaterial("stone", "Stein", base="marble", radio=MARBLE),
    wood=ImportedMaterial("wood", "wood", radio=RadioMaterial("itu", itu="itu_wood")),
)  # fmt: skip


def test_the_first_pattern_decides() -> None:
    text = """
    "/Town/*/ground": {material: asphalt, label: road}
    "*/roof": {radio: itu_metal, thickness: 0.01, color: [0.1, 0.2, 0.3], label: building}
    "St*n": {label: building}
    "*": {radio: itu_concrete}
    """
    found = apply_material_map("file", MIXED, entries(text))
    assert [(part.material, part.label) for part in found.parts] == [
        ("asphalt", "road"), ("stone", "building"), ("stone_2", "building"), ("wood", "unlabeled")
    ]  # fmt: skip
    assert found.materials["stone"] == MIXED.materials["stone"]
    metal = found.materials["stone_2"]
    assert metal.radio == RadioMaterial("itu", itu="itu_metal", thickness=0.01)
    assert (metal.color, metal.base, metal.source) == ((0.1, 0.2, 0.3), "", "Stein")
    assert material_spec(metal).base == "aluminum"
    assert found.materials["wood"].radio == RadioMaterial("itu", itu="itu_concrete")
    assert "grey" not in found.materials
    assert found.notes == ()


def test_paths_and_names_all_match_and_what_matches_nothing_is_reported() -> None:
    text = '{"/Model/ground": {radio: itu_brick}, "ston?": {radio: itu_brick}, "Gray*": {radio: itu_brick}}'
    found = apply_material_map("file", MIXED, entries(text))
    assert found.materials["grey"].radio == RadioMaterial("itu", itu="itu_brick")
    assert [note.split(" of ")[0] for note in found.notes] == ["'ston?'", "'Gray*'"]


def test_slabs_and_constants_over_what_the_source_says() -> None:
    text = '{Stein: {thickness: 0.2, scattering: 0.3}, "*": {relative_permittivity: 4, conductivity: 0.1, xpd: 0.5}}'
    found = apply_material_map("file", MIXED, entries(text))
    assert found.materials["stone"].radio == RadioMaterial("itu", itu="itu_marble", thickness=0.2, scattering=0.3)
    assert found.materials["stone"].base == "marble"
    assert found.materials["grey"].radio == RadioMaterial(
        "constant", relative_permittivity=4.0, conductivity=0.1, xpd=0.5
    )


def test_library_and_foreign_materials_of_one_name_stay_apart() -> None:
    found = apply_material_map("file", MIXED, entries('{"*ground": {material: wood}}'))
    assert [part.material for part in found.parts] == ["wood", "stone", "stone", "wood_2"]
    assert set(found.materials) == {"stone", "wood_2"}


def test_a_library_material_can_be_changed() -> None:
    plain = world(("Roads/a", "asphalt"), ("Roads/b", "asphalt"))
    found = apply_material_map("file", plain, entries('{"*/b": {thickness: 0.1}}'))
    assert [part.material for part in found.parts] == ["asphalt", "asphalt_2"]
    changed = found.materials["asphalt_2"]
    assert changed.radio == RadioMaterial("itu", itu="itu_very_dry_ground", thickness=0.1)
    assert (changed.base, changed.roughness) == ("asphalt", 0.9)
    for same, part in zip(apply_material_map("file", plain, {}).parts, plain.parts, strict=True):
        assert (same.path, same.material, same.label) == (part.path, part.material, part.label)
        assert same.points is part.points and same.faces is part.faces  # `==` of the parts compares arrays: an error


def test_a_material_that_is_called_after_a_row_is_that_row() -> None:
    source = world(("Model/a", "m"), m=ImportedMaterial("m", "mat-itu_brick.001"))
    assert apply_material_map("file", source, {}).materials["m"].radio == RadioMaterial("itu", itu="itu_brick")


def test_everything_without_radio_material_is_listed_with_a_map_to_paste(tmp_path: Path) -> None:
    bare = world(
        ("Model/a", "odd"), ("Model/b", "odd"), ("Model/c", "none"), ("Model/d", "none"), ("Model/e", "stone"),
        odd=ImportedMaterial("odd", 'a"b*[1]'), none=ImportedMaterial("none", ""), stone=MIXED.materials["stone"],
    )  # fmt: skip
    with pytest.raises(ValueError, match="file: 4 meshes have no radio material") as caught:
        apply_material_map("file", bare, {})
    text = str(caught.value)
    assert all(f"/Town/Model/{name}" in text for name in "abcd")
    assert "Model/e" not in text
    (tmp_path / "map.yaml").write_text("\n".join(text.splitlines()[1:]))
    pasted = load_material_map(tmp_path / "map.yaml")
    assert len(pasted) == 3
    found = apply_material_map("file", bare, pasted)
    assert found.notes == ()
    assert {material.radio.itu for material in found.materials.values() if material.radio} == {
        "itu_concrete", "itu_marble"
    }  # fmt: skip


@pytest.mark.parametrize(
    "material", [ImportedMaterial("m", "m", unknown_row="itu_cheese"), ImportedMaterial("m", "mat-itu_cheese.001")]
)
def test_a_row_that_does_not_exist_needs_an_entry_of_the_map(material: ImportedMaterial) -> None:
    source = world(("Model/a", "m"), m=material)
    message = "'itu_cheese' does not exist; use one of itu_asphalt_concrete, itu_brick"
    for bare in ({}, entries('{"*": {thickness: 0.1}}')):
        with pytest.raises(ValueError, match=message):
            apply_material_map("file", source, bare)
    found = apply_material_map("file", source, entries('{"*": {radio: itu_brick, thickness: 0.1}}'))
    assert [found.materials[part.material].radio for part in found.parts] == [
        RadioMaterial("itu", itu="itu_brick", thickness=0.1)
    ]


def test_an_entry_may_be_only_a_name(tmp_path: Path) -> None:
    (tmp_path / "map.yaml").write_text('"*wall": itu_brick\n"*": {radio: itu_concrete, thickness: 0.2}\n')
    found = load_material_map(tmp_path / "map.yaml")
    assert list(found) == ["*wall", "*"]
    assert found["*wall"] == MaterialEntry(radio="itu_brick")
    assert found["*"].thickness == 0.2


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "holds nothing"),
        ("just text", "holds only text"),
        ("a: [", "not valid YAML"),
        ('"*": {radio: itu_brick}\n"*": {radio: itu_wood}', "given twice"),
        ("a: 7", "a section of keys is needed"),
        ("a: {}", "says nothing"),
        ("a: {radio: itu_cheese}", "radio = 'itu_cheese' is unknown; use one of itu_asphalt_concrete, itu_brick"),
        ("a: itu_cheese", "itu_cheese"),
        ("a: {material: gold}", "material = 'gold' is unknown; use one of asphalt"),
        ("a: {label: hous}", "label = 'hous' is unknown; use one of bicycle"),
        ("a: {radioo: itu_brick}", "did you mean `radio`"),
        ("a: {radio: itu_brick, material: asphalt}", "remove radio"),
        ("a: {radio: itu_brick, relative_permittivity: 3}", "keep one"),
        ("a: {conductivity: 3}", "needs `relative_permittivity`"),
        ("a: {radio: itu_brick, thickness: -1}", "thickness"),
        ("a: {radio: itu_brick, color: [1, 2, 3]}", "three numbers from 0 to 1"),
    ],
)
def test_a_wrong_map_is_an_error(tmp_path: Path, text: str, part: str) -> None:
    (tmp_path / "map.yaml").write_text(text)
    with pytest.raises(ValueError, match=r"map\.yaml") as caught:
        load_material_map(tmp_path / "map.yaml")
    assert part in str(caught.value)
    with pytest.raises(ValueError, match="no such file"):
        load_material_map(tmp_path / "nowhere.yaml")


def test_a_scenario_takes_the_same_entries(tmp_path: Path) -> None:
    """For a stage as it is: radio where prims say nothing, the library's look and class, and colors."""
    stage = new_stage(tmp_path / "a.usda")
    said = add_material(stage, "/World/Looks/said", "itu_marble")
    plain = add_material(stage, "/World/Looks/plain_stuff")
    add_box(stage, "/World/ground", (9, 9, 1))
    add_box(stage, "/World/said", (1, 1, 1), material=said)
    add_box(stage, "/World/plain", (1, 1, 1), material=plain)
    add_box(stage, "/World/foam", (1, 1, 1))
    stage.Save()
    (tmp_path / "c.yaml").write_text(
        """
scenarios:
  - name: mine
    stage: a.usda
    materials:
      "*ground": {material: asphalt, label: road}
      "plain*": {radio: itu_brick, thickness: 0.2, color: [0.1, 0.2, 0.3], label: building}
      "*/said": itu_concrete
      "*": {relative_permittivity: 1.5, conductivity: 0.01}
"""
    )
    config = load_config(tmp_path / "c.yaml")
    (tmp_path / "again.yaml").write_text(to_yaml(config))
    assert load_config(tmp_path / "again.yaml") == config
    arrays = read_stage(tmp_path / "a.usda", range(1), ["sunny"], material_map=config.scenarios[0].materials)
    found = {material.name: material for material in arrays.materials["sunny"]}
    of = {thing.prim_path: (thing.label, *thing.materials) for thing in arrays.objects}
    assert of == {
        "/World/ground": ("road", "asphalt"), "/World/said": ("unlabeled", "said"),
        "/World/plain": ("building", "plain_stuff"), "/World/foam": ("unlabeled", "mapped"),
    }  # fmt: skip
    assert found["asphalt"].radio == LIBRARY["asphalt"].radio
    assert (found["asphalt"].nonvisual_base, found["asphalt"].color) == ("asphalt", LIBRARY["asphalt"].color)
    assert found["said"].radio.itu == "itu_concrete"  # an entry counts before what the prim says itself
    assert found["plain_stuff"].radio == RadioMaterial("itu", itu="itu_brick", thickness=0.2)
    assert found["plain_stuff"].color == (0.1, 0.2, 0.3)
    assert found["mapped"].radio == RadioMaterial("constant", relative_permittivity=1.5, conductivity=0.01)


@pytest.mark.parametrize("entry", ["{radioo: itu_brick}", "7", "{material: asphalt, thickness: 1}"])
def test_a_wrong_entry_of_a_scenario_is_one_line(tmp_path: Path, entry: str) -> None:
    (tmp_path / "c.yaml").write_text(f'scenarios:\n  - {{name: a, stage: a.usda, materials: {{"*": {entry}}}}}\n')
    with pytest.raises(ConfigError, match=r"c\.yaml: scenarios\[0\]\.materials") as caught:
        load_config(tmp_path / "c.yaml")
    assert len(caught.value.problems) == 1
