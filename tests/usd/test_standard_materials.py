"""Materials of the library beyond the paper's: what is described, with which source, where it holds, what it gives."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pxr import UsdShade

import mmw
from mmw.core.resources import assets_dir, town_path
from mmw.physics.em.surface_response import material_response
from mmw.physics.materials.material import RadioMaterial
from mmw.physics.weather.weather import PRESETS
from mmw.scene.reader import read_stage
from mmw.scene.scene_data import SceneData
from mmw.sensors.radar.reflectivity import reflectivity_table
from mmw.usd.material_library import LIBRARY
from mmw.usd.standard_materials import FILM, STANDARD, UNCHANGED, WET_GROUND, standard_radio
from mmw.usd.standard_materials_docs import TR38901_DB, penetration_loss_db, standard_materials_page
from tests.fixtures.material_stages import add_quad, stage_in
from tests.fixtures.stages import add_material, saved

TOWNS = ("town07", *(pytest.param(name, marks=pytest.mark.slow) for name in ("town03", "town05", "town10")))
WEATHERS = ("sunny", "rainy", "foggy")
CARRIERS_HZ = (0.9e9, 4.9e9, 28e9, 60e9, 77e9, 140e9)
COSINES = np.cos(np.radians(np.linspace(0.0, 89.0, 60)))
EVERY = [
    (name if radio is entry.radio else f"wet {name}", radio)
    for name, entry in STANDARD.items()
    for radio in (entry.radio, entry.wet)
    if radio is not None
]
PAGE = Path(__file__).parents[2] / "docs" / "reference" / "standard-materials.md"


@pytest.fixture(scope="module", params=TOWNS)
def town(request: pytest.FixtureRequest) -> dict[str, SceneData]:
    """Return a shipped town in every weather, as read for two presets."""
    path = town_path(request.param)
    return {
        "paper": read_stage(path, range(1), WEATHERS),
        "standard": read_stage(path, range(1), WEATHERS, physics="standard"),
    }


def power(radio: RadioMaterial, carrier_hz: float) -> tuple[np.ndarray, np.ndarray]:
    """Return reflected and transmitted power of both polarizations at `COSINES`, shape [2, 60] each."""
    response, ids = material_response(radio, carrier_hz), np.zeros(len(COSINES), dtype=int)
    reflected, transmitted = response.reflection(ids, COSINES), response.transmission(ids, COSINES)
    return np.abs(np.array(reflected)) ** 2, np.abs(np.array(transmitted)) ** 2


def test_every_material_of_the_library_is_described_or_says_why_not() -> None:
    assert set(STANDARD) | set(UNCHANGED) == set(LIBRARY) and not set(STANDARD) & set(UNCHANGED)
    assert all(len(entry.source) > 20 for entry in STANDARD.values()) and all(map(len, UNCHANGED.values()))
    for name, entry in STANDARD.items():
        assert entry.radio != LIBRARY[name].radio, name


def test_the_paper_keeps_its_materials(town: dict[str, SceneData]) -> None:
    for weather in WEATHERS:
        for material in town["paper"].materials[weather]:
            own = LIBRARY[material.name].radio
            assert material.radio in (own, replace(own, model="itu", itu=WET_GROUND)), material.name
            assert material.radar_radio is None and not material.radio.layers and material.radio.rms_height == 0.0


def test_a_preset_changes_the_channel_alone(town: dict[str, SceneData]) -> None:
    paper, standard = town["paper"], town["standard"]
    np.testing.assert_array_equal(paper.material, standard.material)
    for weather in WEATHERS:
        ones, others = paper.materials[weather], standard.materials[weather]
        assert tuple(replace(m, radio=m.seen_by_radar, radar_radio=None) for m in others) == ones
        for one, other in zip(ones, others, strict=True):
            assert other.radio == standard_radio(one.name, one.radio)
            assert (other.radio == one.radio) == (one.name in UNCHANGED)
        tables = [reflectivity_table(found, PRESETS[weather], 77e9) for found in (ones, others)]
        np.testing.assert_array_equal(*tables)


def test_wet_ground_has_a_film_of_water_or_wet_soil(town: dict[str, SceneData]) -> None:
    by_name = {w: {m.name: m.radio for m in town["standard"].materials[w]} for w in WEATHERS}
    for weather, wet in (("sunny", False), ("rainy", True), ("foggy", True)):
        for name in ("asphalt", "road_marking", "concrete_sidewalk", "curb"):
            assert (FILM in [layer.text for layer in by_name[weather][name].layers]) == wet
        assert by_name[weather]["grass"].itu == ("itu_wet_loam" if wet else "itu_moist_loam")
    assert by_name["sunny"]["brick_facade"] == by_name["rainy"]["brick_facade"]


@pytest.mark.parametrize("carrier_hz", CARRIERS_HZ)
@pytest.mark.parametrize(("name", "radio"), EVERY)
def test_no_material_gives_more_than_it_gets(name: str, radio: RadioMaterial, carrier_hz: float) -> None:
    reflected, transmitted = power(radio, carrier_hz)
    assert np.isfinite(reflected).all() and (reflected + transmitted <= 1.0 + 1e-9).all()
    assert (transmitted.max() > 0.0) == radio.transmits
    assert (np.abs(reflected[:, -1]) > 0.15).all()  # at grazing incidence everything reflects
    assert 0.0 <= radio.scattering <= 0.5 and 0.0 <= radio.rms_height <= 0.01 and radio.thickness <= 0.3


def test_water_and_coats_do_what_they_are_known_for() -> None:
    def at_normal(radio: RadioMaterial | None, carrier_hz: float) -> float:
        assert radio is not None
        return float(power(radio, carrier_hz)[0][0, 0])

    asphalt, plain, coated = STANDARD["asphalt"], STANDARD["window_glass"].radio, STANDARD["glass_facade"].radio
    assert at_normal(asphalt.wet, 28e9) > 2.0 * at_normal(asphalt.radio, 28e9)
    for carrier_hz in (2e9, 4.9e9, 10e9, 28e9):
        assert 23.0 < penetration_loss_db(coated, carrier_hz) < 35.0
        assert penetration_loss_db(plain, carrier_hz) < 10.0
        assert at_normal(coated, carrier_hz) > 0.4  # a mirror behind a pane, of which the coat takes a part
    for name in ("concrete_facade", "marble_facade", "wood"):
        losses = [penetration_loss_db(STANDARD[name].radio, hz) for hz in (4.9e9, 10e9, 28e9)]
        assert (np.diff(losses) > 0.0).all(), name
        slanted = [penetration_loss_db(STANDARD[name].radio, 28e9, degrees) for degrees in (0.0, 30.0, 60.0)]
        assert (np.diff(slanted) > 0.0).all(), name


@pytest.mark.parametrize(
    ("name", "carrier_hz", "loss_db", "apart_db"),
    [
        ("window_glass", 4.9e9, 7.9, 5.0), ("window_glass", 28e9, 3.3, 5.0),
        ("glass_facade", 4.9e9, 28.9, 5.0), ("glass_facade", 28e9, 27.9, 5.0),
        ("concrete_facade", 4.9e9, 24.0, 1.0), ("concrete_facade", 28e9, 87.1, 30.0),
        ("wood", 4.9e9, 1.4, 4.5), ("wood", 28e9, 8.2, 1.0),
    ],
)  # fmt: skip
def test_losses_are_about_those_of_tr_38901(name: str, carrier_hz: float, loss_db: float, apart_db: float) -> None:
    _, faces, offset, slope = TR38901_DB[name]
    found = faces * penetration_loss_db(STANDARD[name].radio, carrier_hz)
    assert abs(found - loss_db) < 0.1
    assert abs(found - (offset + slope * carrier_hz / 1e9)) < apart_db


def test_materials_of_a_user_stay(tmp_path: Path) -> None:
    """A material of the library's name that is none of it, one whose values the stage changes, and copies of it."""
    stage = stage_in(tmp_path)
    own = add_material(stage, "/World/own/asphalt", "itu_very_dry_ground", "asphalt")
    shipped = str(assets_dir() / "materials" / "materials.usda")
    materials = [own.GetPrim()]
    for folder in ("library", "changed"):
        prim = stage.DefinePrim(f"/World/{folder}", "Scope")
        prim.GetReferences().AddReference(shipped, "/Materials")
        materials.append(stage.GetPrimAtPath(f"/World/{folder}/asphalt"))
    materials[2].GetAttribute("mmw:radio:scattering").Set(0.25)
    for k, material in enumerate(materials):
        add_quad(stage, f"/World/mesh_{k}", UsdShade.Material(material), 3.0 * k)
    path = saved(stage)
    arrays = read_stage(path, range(1), ["sunny"], physics="standard")
    assert arrays.materials == read_stage(path, range(1), ["sunny"], physics="full").materials
    found = [arrays.materials["sunny"][k].radio for k in arrays.material[::2]]
    assert len(found) == 3
    assert [radio.itu for radio in found] == ["itu_very_dry_ground", "itu_asphalt_concrete", "itu_very_dry_ground"]
    assert found[2].scattering == 0.25


def test_what_a_user_says_stands_above(tmp_path: Path) -> None:
    stage = stage_in(tmp_path)
    prim = stage.DefinePrim("/World/library", "Scope")
    prim.GetReferences().AddReference(str(assets_dir() / "materials" / "materials.usda"), "/Materials")
    names = ("brick_facade", "window_glass", "wood", "asphalt")
    for k, name in enumerate(names):
        add_quad(stage, f"/World/mesh_{k}", UsdShade.Material(stage.GetPrimAtPath(f"/World/library/{name}")), 3.0 * k)
    entries = {
        "brick_facade": {"scattering": 0.1}, "window_glass": "itu_metal", "wood": {"material": "marble_facade"},
        "asphalt": {"layers": ["itu_fresh_water 0.001"], "rms_height": 0.001},
    }  # fmt: skip
    arrays = read_stage(saved(stage), range(1), ["sunny"], physics="standard", material_map=entries)
    brick, window, wood, asphalt = (arrays.materials["sunny"][k] for k in arrays.material[::2])
    assert brick.radio == replace(STANDARD["brick_facade"].radio, scattering=0.1)
    assert brick.seen_by_radar == replace(LIBRARY["brick_facade"].radio, scattering=0.1)
    assert window.radio == RadioMaterial("itu", itu="itu_metal") and window.radar_radio is None
    assert wood.radio == STANDARD["marble_facade"].radio and wood.seen_by_radar == LIBRARY["marble_facade"].radio
    assert asphalt.radio.itu == "itu_asphalt_concrete" and asphalt.radio.rms_height == 0.001
    assert [layer.text for layer in asphalt.radio.layers] == ["itu_fresh_water 0.001"]


def test_the_page_is_current() -> None:
    if os.environ.get("MMW_UPDATE_GOLDEN") == "1":
        PAGE.write_text(standard_materials_page(), encoding="utf-8")
    assert PAGE.read_text(encoding="utf-8") == standard_materials_page(), (
        "MMW_UPDATE_GOLDEN=1 pytest tests/usd/test_standard_materials.py"
    )


@pytest.mark.slow
def test_a_run_finds_waves_through_glass_and_off_rough_walls(tmp_path: Path) -> None:
    """A street of town03 with the preset, against the same drive with the paper's materials."""
    changes = [
        "frames.count=1", "channel.carriers_hz=[4.9e9]", "compute.device=cpu", "sensors=[]", "channel.max_depth=3",
        "channel.candidates=launch", "channel.samples_per_tx=100000", "channel.diffuse_reflection=true",
        "channel.refraction=true", "channel.diffuse_samples=2000", "channel.diffraction=false",
        "scenarios.0.rsus=[{name: rsu_1, position_m: [60.0, -60.0, 0.14]}]",
    ]  # fmt: skip
    counts = {}
    for physics in ("paper", "standard"):
        data = mmw.generate(
            mmw.load_config("quickstart", [*changes, f"channel.physics={physics}"]), out=tmp_path / physics
        )
        kinds = data.read("path_geometry").column("kind").to_pylist()
        counts[physics] = {kind: kinds.count(kind) for kind in ("transmission", "diffuse")}
        rows = {row["name"]: row for row in data.read("materials", weather="sunny").to_pylist()}
        is_standard = physics == "standard"
        assert rows["window_glass"]["layers"] == (["itu_glass 0.004", "itu_vacuum 0.016"] if is_standard else [])
        assert rows["brick_facade"]["scattering"] == (0.3 if is_standard else 0.0)
        assert rows["asphalt"]["rms_height"] == (0.0004 if is_standard else 0.0)
    assert counts["paper"]["diffuse"] == 0 and counts["standard"]["diffuse"] > 500
    assert counts["standard"]["transmission"] > counts["paper"]["transmission"]
