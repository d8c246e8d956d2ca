"""Scenes from every kind of source: the same world, the same hits; and one clear error for what cannot be loaded."""

import subprocess
import sys
from pathlib import Path
from typing import cast

import numpy as np
import pytest

import mmw
import mmw.scene
from mmw.config.physics_presets import Physics
from mmw.core.errors import InputError
from mmw.physics.weather.weather import PRESETS
from mmw.scene.prepare import prepare_scenario, read_scenario
from tests.fixtures.import_files import write_glb, write_mitsuba, write_obj
from tests.fixtures.osm_files import quarter
from tests.fixtures.own_world import write_own_world
from tests.fixtures.xodr_files import t_town

HOUSE = {"glb": {"*": "itu_concrete"}, "obj": {"*brick": "itu_brick", "*": "itu_concrete"}, "xml": None}
"""Material map that a file of the fixtures' house on level ground needs."""


def test_a_name_is_no_module_after_its_first_use() -> None:
    """A submodule of that name would replace it once it is imported; a fresh process sees the first use."""
    code = "import mmw; first = mmw.load_scene; assert callable(first) and mmw.load_scene is first"
    subprocess.run([sys.executable, "-c", code], check=True)
    for package in (mmw, mmw.scene):
        for name in package.__all__:
            assert getattr(package, name) is getattr(package, name)
            assert type(getattr(package, name)).__name__ != "module", f"{package.__name__}.{name}"


@pytest.mark.parametrize("kind", HOUSE)
def test_files_of_other_tools(kind: str, tmp_path: Path) -> None:
    """A house of 10 x 8 x 6 m about (12, 9) on level ground, in three formats."""
    make = {"glb": lambda: write_glb(tmp_path / "a.glb"), "obj": lambda: write_obj(tmp_path / "a.obj")}
    path = make[kind]() if kind in make else write_mitsuba(tmp_path)
    scene = mmw.load_scene(path, materials=HOUSE[kind], device="cpu")
    hits = scene.cast_rays([(12.0, 9.0, 50.0), (0.0, 0.0, 50.0)], (0.0, 0.0, -1.0))
    np.testing.assert_allclose(hits.distance, (44.0, 50.0), atol=1e-4)
    assert scene.materials_by_id()[hits.material_id[0]].radio.itu in ("itu_concrete", "itu_brick")
    scene.add(mmw.Transmitter("t", (0.0, 0.0, 2.0)))
    scene.add(mmw.Receiver("r", (-5.0, 3.0, 1.5)))
    kinds = mmw.PathSolver(max_depth=1, candidates="exhaustive")(scene).kind.tolist()
    assert kinds[0] == "los" and kinds.count("specular") >= 1


def test_maps_with_roads(tmp_path: Path) -> None:
    pytest.importorskip("shapely")
    (tmp_path / "a.osm").write_text(quarter().text())
    (tmp_path / "b.xodr").write_text(t_town())
    for name in ("a.osm", "b.xodr"):
        scene = mmw.load_scene(tmp_path / name, device="cpu")
        labels = {item.label for item in scene.objects.values()}
        assert "road" in labels and np.isfinite(scene.bounds).all(), labels
    assert not list(tmp_path.glob("*.usd*")), "nothing is written beside the file"


def test_options_of_an_importer(tmp_path: Path) -> None:
    path = write_obj(tmp_path / "a.obj", scale=100.0)
    scene = mmw.load_scene(path, unit="cm", materials={"*": "itu_concrete"}, device="cpu")
    assert scene.cast_rays((12.0, 9.0, 50.0), (0.0, 0.0, -1.0)).distance[0] == pytest.approx(44.0, abs=1e-3)


def test_a_stage_with_actors_at_any_frame(tmp_path: Path) -> None:
    stage = write_own_world(tmp_path) / "mine.usda"
    roles, materials = {"/World/Ego": "cav", "/World/Mast": "rsu"}, {"/World/*": "itu_concrete"}
    scene = mmw.load_scene(stage, actor_roles=roles, materials=materials, frame=4, device="cpu")
    assert scene.frames == range(10) and scene.actors["Ego"].role == "cav"
    assert scene.actors["Ego"].position[0] == pytest.approx(0.4)
    scene.frame = 9
    np.testing.assert_allclose(scene.actors["Ego"].position, (0.9, 0.0, 0.0), atol=1e-12)
    np.testing.assert_allclose(scene.actors["Ego"].velocity, (10.0, 0.0, 0.0), atol=1e-6)
    some = mmw.load_scene(stage, actor_roles=roles, materials=materials, frames=range(2, 5), device="cpu")
    assert some.frames == range(2, 5) and some.frame == 2


def test_a_configuration_is_what_a_run_reads(tmp_path: Path) -> None:
    """Weathers that are not asked for are read too, so that material ids are those of the run."""
    path = write_own_world(tmp_path) / "mine.yaml"
    config = mmw.load_config(path, ["weathers=[sunny, rainy]"])
    for source in (config, path):
        scene = mmw.load_scene(source, frame=3, base=tmp_path, device="cpu")
        assert list(scene.weathers) == ["sunny"] and scene.frame == 3 and scene.name == "mine"
    scene = mmw.load_scene(config, weather="rainy", base=tmp_path, device="cpu")
    scenario = config.scenarios[0]
    expected = read_scenario(config, scenario, prepare_scenario(config, scenario, tmp_path, tmp_path / "out"))
    for name in ("points", "faces", "material", "object_id", "surface", "poses"):
        np.testing.assert_array_equal(getattr(scene.arrays, name), getattr(expected, name), err_msg=name)
    assert scene.arrays.materials == expected.materials and scene.weathers == {"rainy": PRESETS["rainy"]}
    assert scene.seed == config.seed


def test_weathers_by_name_value_and_both(tmp_path: Path) -> None:
    stage = write_own_world(tmp_path) / "mine.usda"

    def names(weather: object) -> list[str]:
        scene = mmw.load_scene(stage, materials={"*": "itu_concrete"}, weather=weather, device="cpu")
        return [f"{name} {values.rain_mm_h:g}" for name, values in scene.weathers.items()]

    assert names("rainy") == ["rainy 25"] and names(["rainy", "sunny"]) == ["rainy 25", "sunny 0"]
    assert names(mmw.Weather(rain_mm_h=7.0)) == ["custom 7"]
    assert names({"monsoon": mmw.Weather(rain_mm_h=99.0)}) == ["monsoon 99"]


ERRORS = {
    "no such town": (("town99",), {}, "'town99': no such file, and no shipped town; towns are town03, town05"),
    "no such file": (("missing.usda",), {}, "missing.usda: no such file"),
    "no such format": (("own.dae",), {}, "own.dae: .dae is not read"),
    "no material": (("mine.usda",), {}, "3 prims have no radio material"),
    "unknown material": (("mine.usda",), {"materials": {"*": "itu_gold"}}, "radio = 'itu_gold' is unknown"),
    "material key": (("mine.usda",), {"materials": {"*": {"colour": 3}}}, r"materials\['\*'\]: colour"),
    "weather": (("mine.usda",), {"weather": "misty"}, "weather 'misty': is not known; name one of sunny"),
    "no weather": (("mine.usda",), {"weather": []}, "weather: is empty"),
    "frame": (("mine.usda",), {"materials": {"*": "itu_brick"}, "frame": 10}, "frame = 10; it has frames 0 to 9"),
    "scenario of a stage": (("mine.usda",), {"scenario": "a"}, "scenario = 'a': does not go with"),
    "option of a stage": (("mine.usda",), {"up": "y"}, "up: a USD stage has no such option"),
    "option of a town": (("town03",), {"up": "y"}, "up: a USD stage has no such option"),
    "option of a file": (("a.obj",), {"materials": {"*": "itu_brick"}, "lanes": 3}, "no option of .glb"),
    "role of a config": (("mine.yaml",), {"actor_roles": {"/a": "cav"}}, "actor_roles = .* does not go with"),
    "unknown scenario": (("mine.yaml",), {"scenario": "yours"}, "scenario = yours: there are mine"),
    "device": (("mine.usda",), {"materials": {"*": "itu_brick"}, "device": "cuda:99"}, "cuda:99"),
}


@pytest.mark.parametrize("case", ERRORS)
def test_bad_input_is_one_clear_error(case: str, tmp_path: Path) -> None:
    write_own_world(tmp_path)
    write_obj(tmp_path / "a.obj")
    (tmp_path / "own.dae").write_text("<COLLADA/>")
    (name,), options, message = ERRORS[case]
    source = name if "." not in name else tmp_path / name
    with pytest.raises(InputError, match=message):
        mmw.load_scene(source, **options)


def test_the_materials_of_a_preset() -> None:
    """Walls of a shipped town have a thickness beyond the paper's preset, as in a configuration; others are errors."""
    thick = []
    for physics in (None, "paper", "standard"):
        scene = mmw.load_scene("town07", physics=physics, device="cpu")
        thick.append({m.name for m in scene.arrays.materials["sunny"] if m.radio.transmits})
    assert thick[0] == thick[1] < thick[2] and any("brick" in name for name in thick[2] - thick[1])
    with pytest.raises(InputError, match="load_scene: physics = 'best'; one of paper, standard, full is needed"):
        mmw.load_scene("town07", physics=cast(Physics, "best"))
    with pytest.raises(InputError, match="load_scene: physics = 'full': does not go with"):
        mmw.load_scene(mmw.load_config("quickstart"), physics="full")
