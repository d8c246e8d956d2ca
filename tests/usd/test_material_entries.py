"""Entries of a material map override what a stage says, mesh by mesh and weather by weather."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import Usd

import mmw
from mmw.config import ConfigError, MaterialEntry, load_config
from mmw.config.material_map import merged_maps
from mmw.generation.estimate import check_inputs
from mmw.physics.materials.layers import Layer
from mmw.physics.materials.material import LIDAR_REFLECTANCE_905NM, Material, RadioMaterial
from mmw.scene.reader import read_stage
from mmw.scene.scene_data import SceneData
from mmw.usd.material_entries import overridden
from tests.fixtures.material_stages import stage_in
from tests.fixtures.stages import add_box, add_material, label, saved

WALL = Material("wall", RadioMaterial("itu", itu="itu_glass", thickness=0.006), "concrete", 0.37, (0.4, 0.4, 0.4))


@pytest.fixture
def stage(tmp_path: Path) -> Usd.Stage:
    return stage_in(tmp_path)


def read(stage: Usd.Stage, *weathers: str, **options) -> SceneData:
    """Return the first frame of a stage."""
    return read_stage(saved(stage), range(1), weathers, **options)


def town(stage: Usd.Stage) -> None:
    """Add a ground, a house and a kiosk whose materials say all about themselves; the ground is wet in rain."""
    for name, row, kind in (("ground", "very_dry_ground", "road"), ("house", "concrete", "building")):
        material = add_material(stage, f"/World/m/{name}", f"itu_{row}")
        box = add_box(stage, f"/World/{name}", (1, 1, 1), material=material)
        label(box.GetPrim(), kind)
    box = add_box(stage, "/World/kiosk", (1, 1, 1), material=add_material(stage, "/World/m/tin", "itu_metal"))
    label(box.GetPrim(), "building")
    variants = stage.GetPrimAtPath("/World").GetVariantSets().AddVariantSet("weather")
    row = stage.GetPrimAtPath("/World/m/ground").GetAttribute("mmw:radio:itu")
    row.Clear()
    for weather, name in (("sunny", "itu_very_dry_ground"), ("rainy", "itu_wet_ground")):
        variants.AddVariant(weather)
        variants.SetVariantSelection(weather)
        with variants.GetVariantEditContext():
            stage.OverridePrim("/World/m/ground").GetAttribute("mmw:radio:itu").Set(name)


CHANGED = {"thickness": 0.1, "scattering": 0.3, "scattering_pattern": "directive", "alpha_r": 7}


def rows(arrays, weather: str = "sunny") -> dict[str, str]:
    return {one.prim_path[7:]: by_name(arrays, weather, one.materials[0]).radio.itu for one in arrays.objects}


def by_name(arrays, weather: str, name: str) -> Material:
    return next(material for material in arrays.materials[weather] if material.name == name)


@pytest.mark.parametrize(
    ("pattern", "changed"),
    [
        ("label:building", {"house", "kiosk"}),
        ("label:b*", {"house", "kiosk"}),
        ("/World/kiosk", {"kiosk"}),
        ("*/k*", {"kiosk"}),
        ("t?n", {"kiosk"}),
        ("ground", {"ground"}),
        ("*", {"ground", "house", "kiosk"}),
    ],
)
def test_a_pattern_is_a_class_a_path_or_a_name(stage: Usd.Stage, pattern: str, changed: set[str]) -> None:
    town(stage)
    before = rows(read(stage, "sunny", "rainy"))
    arrays = read(stage, "sunny", "rainy", material_map={pattern: "itu_brick"})
    for weather in ("sunny", "rainy"):  # a substance holds in rain too
        found = rows(arrays, weather)
        assert {name for name, row in found.items() if row == "itu_brick"} == changed
    assert {n: r for n, r in rows(arrays).items() if n not in changed} == {
        n: r for n, r in before.items() if n not in changed
    }
    assert arrays.material_notes == ()


def test_the_first_pattern_counts_and_idle_ones_are_told(stage: Usd.Stage) -> None:
    town(stage)
    given = {"/World/house": "itu_wood", "label:building": "itu_brick", "tin": "itu_glass", "*tower*": "itu_wood"}
    arrays = read(stage, "sunny", "rainy", material_map=given)
    assert rows(arrays) == {"ground": "itu_very_dry_ground", "house": "itu_wood", "kiosk": "itu_brick"}
    assert [note.split(":")[0] for note in arrays.material_notes] == [
        f"materials[{pattern!r}] decides nothing" for pattern in ("tin", "*tower*")
    ]
    assert "materials here are ground, house, tin" in arrays.material_notes[1]


def test_properties_alone_leave_the_substance_of_each_weather(stage: Usd.Stage) -> None:
    town(stage)
    entry = MaterialEntry(scattering=0.3, scattering_pattern="directive", alpha_r=7, roughness=0.2)
    arrays = read(stage, "sunny", "rainy", material_map={"ground": entry})
    for weather, row in (("sunny", "itu_very_dry_ground"), ("rainy", "itu_wet_ground")):
        found = by_name(arrays, weather, "ground")
        assert found.radio == RadioMaterial("itu", row, **CHANGED)
        assert found.appearance.roughness == 0.2
    assert by_name(arrays, "rainy", "house").radio.scattering == 0


def test_a_weather_has_changes_of_its_own(stage: Usd.Stage) -> None:
    town(stage)
    wet = {"relative_permittivity": 6.0, "conductivity": 0.3, "lidar_reflectance": 0.1}
    entry = MaterialEntry(radio="itu_brick", thickness=0.2, scattering=0.4, weathers={"rainy": wet})
    arrays = read(stage, "sunny", "rainy", material_map={"label:building": entry})
    assert by_name(arrays, "sunny", "house").radio == RadioMaterial("itu", "itu_brick", thickness=0.2, scattering=0.4)
    rainy = by_name(arrays, "rainy", "house")
    assert rainy.radio == RadioMaterial(
        "constant", relative_permittivity=6.0, conductivity=0.3, thickness=0.2, scattering=0.4
    )
    assert rainy.lidar_reflectance == 0.1 != by_name(arrays, "sunny", "house").lidar_reflectance


def test_layers_and_roughness_come_from_text_and_stay_in_a_weather(stage: Usd.Stage) -> None:
    town(stage)
    config = load_config(
        "quickstart",
        [
            "materials={'label:building': {radio: itu_glass, thickness: 0.004, rms_height: 0.001, layers: [itu_glass "
            "0.004, sheet 5, itu_vacuum 0.016], weathers: {rainy: {radio: itu_brick}}}, ground: {layers: [sheet 9]}}"
        ],
    )
    arrays = read(stage, "sunny", "rainy", material_map=config.materials)
    wanted = RadioMaterial(
        "itu", "itu_glass", thickness=0.004, rms_height=0.001,
        layers=(Layer("itu_glass", thickness=0.004), Layer.sheet(5.0), Layer("itu_vacuum", thickness=0.016)),
    )  # fmt: skip
    assert by_name(arrays, "sunny", "house").radio == wanted
    assert by_name(arrays, "rainy", "house").radio == replace(wanted, itu="itu_brick")
    ground = by_name(arrays, "rainy", "ground").radio
    assert ground == RadioMaterial("itu", "itu_wet_ground", thickness=0.1, layers=(Layer.sheet(9.0),))
    again = json.dumps(config.model_dump(mode="json")["materials"])
    assert load_config("quickstart", [f"materials={again}"]) == config


def test_a_class_of_the_map_takes_the_place_of_the_stage_s(stage: Usd.Stage) -> None:
    town(stage)
    arrays = read(stage, "sunny", "rainy", material_map={"/World/kiosk": MaterialEntry(label="pole")})
    assert {one.prim_path: one.label for one in arrays.objects}["/World/kiosk"] == "pole"
    assert rows(arrays)["kiosk"] == "itu_metal"


def test_values_that_follow_from_others() -> None:
    """A substance brings a half-space; a base gives the reflectance; what the picture has is replaced one by one."""
    brick = overridden(WALL, MaterialEntry(radio="itu_brick"), "sunny")
    assert brick.radio == RadioMaterial("itu", "itu_brick")
    assert brick.lidar_reflectance == WALL.lidar_reflectance
    brick = overridden(WALL, MaterialEntry(base="brick"), "sunny")
    assert (brick.nonvisual_base, brick.lidar_reflectance) == ("brick", LIDAR_REFLECTANCE_905NM["brick"])
    assert brick.radio == WALL.radio
    given = overridden(WALL, MaterialEntry(base="brick", lidar_reflectance=0.5, color=(0.1, 0.2, 0.3)), "sunny")
    assert given.lidar_reflectance == 0.5 and given.color == given.appearance.color == (0.1, 0.2, 0.3)
    assert overridden(WALL, MaterialEntry(weathers={"rainy": {"xpd": 0.2}}), "sunny") == WALL


def test_maps_of_a_scenario_come_before_those_of_the_configuration() -> None:
    brick, wood = MaterialEntry(radio="itu_brick"), MaterialEntry(radio="itu_wood")
    merged = merged_maps({"a": wood, "b": brick}, {"c": brick, "a": brick})
    assert list(merged.items()) == [("a", wood), ("b", brick), ("c", brick)]


@pytest.mark.parametrize(
    ("entry", "message"),
    [
        ("{scattering: 1.5}", r"materials\.\S+scattering = 1\.5"),
        ("{relative_permittivity: -3}", r"relative_permittivity = -3"),
        ("{thickness: -0.1}", r"thickness = -0\.1"),
        ("{rms_height: -0.001}", r"rms_height = -0\.001"),
        ("{layers: [itu_glass 4 mm]}", r"layers.*layer 'itu_glass 4 mm': `itu_glass 0\.004` \(row, m\)"),
        ("{layers: [itu_cheese 0.1]}", r"layers.*itu = 'itu_cheese'; a row, one of itu_vacuum"),
        ("{layers: [sheet -5]}", r"layers.*layer 'sheet -5': a sheet resistance above 0"),
        ("{weathers: {rainy: {layers: [sheet 0]}}}", "layers.*a sheet resistance above 0"),
        ("{scatering: 0.1}", "did you mean `scattering`"),
        ("{radio: itu_brick, relative_permittivity: 3}", "keep one"),
        ("{conductivity: 3}", "needs `relative_permittivity`"),
        ("{}", "says nothing"),
        ("{scattering_pattern: lambert}", "scattering_pattern = 'lambert' is unknown; use one of backscattering"),
        ("{radio: itu_cheese}", "radio = 'itu_cheese' is unknown"),
        ("{material: cheese}", "material = 'cheese' is unknown; use one of asphalt"),
        ("{base: cheese}", "base = 'cheese' is unknown; use one of aluminum"),
        ("{label: cheese}", "label = 'cheese' is unknown; use one of"),
        ("{weathers: {hail: itu_brick}}", "weathers.hail: there is no such weather; name one of sunny"),
        ("{weathers: {rainy: {radio: itu_cheese}}}", "weathers.rainy: radio = 'itu_cheese' is unknown"),
    ],
)
@pytest.mark.parametrize("place", ["materials", "scenarios.0.materials"])
def test_wrong_entries_are_one_line_each(place: str, entry: str, message: str) -> None:
    with pytest.raises(ConfigError, match=message) as caught:
        config = load_config("quickstart", [f'{place}={{"label:building": {entry}}}'])
        check_inputs(config, Path())
    assert len(caught.value.problems) == 1
    assert "label:building" in caught.value.problems[0]


def test_a_class_that_does_not_exist_is_an_error() -> None:
    with pytest.raises(ConfigError, match=r"materials\['label:bilding'\]: no class matches; use one of .*building"):
        check_inputs(load_config("quickstart", ["materials={label:bilding: itu_brick}"]), Path())


@pytest.mark.slow
def test_a_shipped_town_takes_overrides() -> None:
    scene = mmw.load_scene(
        "town03", weather=["sunny", "rainy"], materials={"label:building": "itu_brick"}, device="cpu"
    )
    data = scene.data if hasattr(scene, "data") else scene.device_scene.arrays
    is_wall = np.isin(data.object_id, [one.object_id for one in data.objects if "/Buildings/" in one.prim_path])
    for weather in ("sunny", "rainy"):
        walls = {data.materials[weather][k] for k in np.unique(data.material[is_wall]).tolist()}
        assert {wall.radio.itu for wall in walls if wall.name != "concrete_sidewalk"} == {"itu_brick"}
        others = {data.materials[weather][k] for k in np.unique(data.material[~is_wall]).tolist()}
        assert "itu_marble" in {other.radio.itu for other in others}  # that of a monument
        assert ("itu_wet_ground" in {other.radio.itu for other in others}) == (weather == "rainy")
