"""The physical weather: derived values against tables, and the section `air` of the configuration."""

import csv
import re
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import get_args

import pytest
import yaml

from mmw.config import ConfigError, load_config
from mmw.config.air import PresetName
from mmw.config.load import to_yaml
from mmw.core.resources import town_path
from mmw.generation.estimate import check_inputs
from mmw.physics.weather.optics import rain_visibility, visibility
from mmw.physics.weather.weather import FOG_WATER_G_M2, PRESETS, FogType, Weather, choose_variant
from mmw.scene.reader import read_stage
from mmw.worlds.towns.block_description import SHIPPED_WEATHER
from tests.fixtures.stages import write_town

FOG = Path(__file__).parents[2] / "reference" / "weather" / "mie_fog_water.csv"
GUIDE = Path(__file__).parents[3] / "docs" / "concepts" / "weather.md"


def test_liquid_water_of_fog_equals_mie_theory() -> None:
    rows = list(csv.DictReader(FOG.read_text().splitlines()))
    seen = set()
    for row in rows:
        fog = {"moderate_spray_radiation": "radiation"}.get(row["fog_type"], row["fog_type"])
        visibility = float(row["MOR_m"])
        if 10 <= visibility < 1000:
            assert Weather(visibility_m=visibility, fog_type=fog).liquid_water_g_m3 == pytest.approx(
                float(row["LWC_g_m3"]), rel=1e-3
            )
            seen.add(fog)
    assert seen == set(FOG_WATER_G_M2) == set(get_args(FogType))


def test_haze_holds_no_liquid_water_and_a_given_content_counts() -> None:
    assert Weather(visibility_m=1000.0).liquid_water_g_m3 == 0.0
    assert Weather(visibility_m=999.0).liquid_water_g_m3 > 0.03
    assert Weather(visibility_m=20_000.0, lwc_g_m3=0.2).liquid_water_g_m3 == 0.2


@pytest.mark.parametrize(("celsius", "density"), [(-10, 2.36), (0, 4.85), (10, 9.41), (20, 17.3), (30, 30.4)])
def test_saturated_vapour_equals_meteorological_tables(celsius: float, density: float) -> None:
    weather = Weather(temperature_c=celsius, relative_humidity=1.0)
    assert weather.water_vapour_g_m3 == pytest.approx(density, rel=6e-3)
    half = Weather(temperature_c=celsius, relative_humidity=0.5)
    assert half.water_vapour_g_m3 == pytest.approx(weather.water_vapour_g_m3 / 2)
    assert half.dry_pressure_hpa + half.vapour_pressure_hpa == pytest.approx(1013.25)


def test_clear_air_is_the_standard_air_of_itu() -> None:
    assert PRESETS["sunny"] == Weather()
    assert Weather().water_vapour_g_m3 == pytest.approx(7.5, rel=5e-3)


def test_presets_are_ordered_and_agree_with_the_towns() -> None:
    assert PRESETS["light_rain"].rain_mm_h < PRESETS["rainy"].rain_mm_h < PRESETS["heavy_rain"].rain_mm_h
    assert PRESETS["light_fog"].visibility_m > PRESETS["foggy"].visibility_m > PRESETS["heavy_fog"].visibility_m
    towns = {name: (t.rain_rate_mm_h, t.visibility_m) for name, t in SHIPPED_WEATHER.items()}
    assert towns == {"sunny": (0, 20_000), "rainy": (25, 1080), "foggy": (0, 75)}  # as built into them
    assert [t.ground_itu for t in SHIPPED_WEATHER.values()] == ["", "itu_wet_ground", "itu_wet_ground"]
    assert get_args(PresetName) == tuple(PRESETS)


@pytest.mark.parametrize(("rain", "metres"), [(5.0, 2968), (25.0, 1078), (50.0, 697), (100.0, 450)])
def test_rain_veil(rain: float, metres: float) -> None:
    assert rain_visibility(rain) == pytest.approx(metres, rel=1e-3)  # Mie theory over Marshall and Palmer's drops
    both = visibility(Weather(rain, visibility_m=500.0))
    assert both == pytest.approx(1 / (1 / metres + 1 / 500), rel=1e-3)
    assert visibility(Weather(visibility_m=75.0)) == pytest.approx(75.0) and rain_visibility(0.0) == float("inf")


@pytest.mark.parametrize(
    ("weather", "candidates"),
    [
        (Weather(), ("mine", "sunny")),
        (Weather(rain_mm_h=4.0, wetness=0.2), ("mine", "sunny")),
        (Weather(rain_mm_h=4.0, wetness=0.25), ("mine", "rainy", "foggy")),
        (Weather(puddles=0.3), ("mine", "foggy", "rainy")),
        (PRESETS["heavy_fog"], ("mine", "foggy", "rainy")),
        (Weather(wetness=1.0, variant="snowy"), ("snowy",)),
    ],
)
def test_variants_follow_from_the_state(weather: Weather, candidates: Sequence[str]) -> None:
    assert weather.variants("mine") == candidates


def test_the_first_variant_that_is_there_is_chosen() -> None:
    assert choose_variant(("mine", "rainy", "foggy"), ["sunny", "foggy", "rainy"]) == "rainy"
    assert choose_variant(("mine", "rainy", "foggy"), ["mine", "rainy"]) == "mine"
    assert choose_variant(("mine", "sunny"), ["dry", "wet"]) is None


def test_every_preset_reads_a_shipped_town() -> None:
    arrays = read_stage(town_path("town10"), range(1), {name: w.variants(name) for name, w in PRESETS.items()})
    assert tuple(arrays.materials) == tuple(PRESETS)
    ground = {name: next(m for m in made if m.name == "asphalt").radio.itu for name, made in arrays.materials.items()}
    assert {name for name, itu in ground.items() if itu == "itu_very_dry_ground"} == {"sunny"}
    assert {itu for name, itu in ground.items() if name != "sunny"} == {"itu_wet_ground"}


def test_a_stage_without_a_fitting_variant_names_the_cure(tmp_path: Path) -> None:
    town = write_town(tmp_path / "town.usda")  # sunny and rainy
    arrays = read_stage(town, range(1), {"mist": PRESETS["foggy"].variants("mist")})
    assert arrays.materials["mist"][0].radio.itu == "itu_wet_ground"
    with pytest.raises(ValueError, match=r"'polar' .* none of snowy; set air.polar.variant to one that it has"):
        read_stage(town, range(1), {"sunny": ("sunny",), "polar": ("snowy",)})
    path = tmp_path / "c.yaml"
    traffic = "{vehicle_count: 2, spawn_center_m: [0, 0, 0], cav_ranks: [1]}"
    path.write_text(f"scenarios: [{{name: s, town: town.usda, traffic: {traffic}}}]\nchannel: {{enabled: false}}\n")
    check_inputs(load_config(path, ["weathers=[mist]", "air.mist={preset: foggy}"]), tmp_path)
    with pytest.raises(ConfigError, match=r"weathers holds 'polar'.* set air.polar.variant to one that it has"):
        check_inputs(load_config(path, ["weathers=[polar]", "air.polar={variant: snowy}"]), tmp_path)
    check_inputs(load_config(path, ["weathers=[polar]", "air.polar={variant: rainy}"]), tmp_path)


def test_examples_of_the_guide_load(tmp_path: Path) -> None:
    blocks = re.findall(r"```yaml\n(.*?)```", GUIDE.read_text(), re.DOTALL)
    assert len(blocks) >= 2
    for block in blocks:
        path = tmp_path / "c.yaml"
        path.write_text("scenarios: [{name: s, stage: s.usda}]\n" + block)
        config = load_config(path)
        assert set(yaml.safe_load(block)["air"]) <= set(config.air)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"rain_mm_h": -1.0}, "rain_mm_h = -1; 0 to 250 is needed"),
        ({"visibility_m": float("nan")}, "visibility_m = nan"),
        ({"relative_humidity": 58.0}, "relative_humidity = 58; 0 to 1"),
        ({"lwc_g_m3": -0.1}, "lwc_g_m3"),
        ({"fog_type": "pea_soup"}, "'pea_soup'; one of strong_advection, .*radiation"),
    ],
)
def test_impossible_weather(values: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        Weather(**values)


@pytest.fixture
def config_file(tmp_path: Path) -> Path:
    path = tmp_path / "c.yaml"
    path.write_text("scenarios: [{name: s, stage: s.usda}]\nweathers: [sunny, rainy]\n")
    return path


def test_presets_need_no_section(config_file: Path) -> None:
    config = load_config(config_file)
    assert {name: air.weather(name) for name, air in config.air.items()} == {
        name: PRESETS[name] for name in ("sunny", "rainy")
    }


def test_given_values_replace_those_of_the_preset(config_file: Path) -> None:
    config = load_config(
        config_file,
        [
            "weathers=[rainy, sunny, monsoon, night_fog, haze]",
            "air.rainy.rain_mm_h=40",
            "air.monsoon={preset: heavy_rain, temperature_c: 28}",
            "air.night_fog={preset: foggy, fog_type: radiation}",
            "air.haze={visibility_m: 3000}",
        ],
    )
    weathers = {name: air.weather(name) for name, air in config.air.items()}
    assert tuple(weathers) == config.weathers
    assert weathers["rainy"] == replace(PRESETS["rainy"], rain_mm_h=40.0)
    assert weathers["monsoon"] == replace(PRESETS["heavy_rain"], temperature_c=28.0)
    assert (weathers["monsoon"].wetness, weathers["monsoon"].rain_mm_h) == (1.0, 50.0)
    assert weathers["night_fog"].liquid_water_g_m3 == pytest.approx(5.427 / 75)
    assert weathers["haze"] == Weather(visibility_m=3000.0)


def test_the_resolved_section_says_everything_and_reads_back(config_file: Path, tmp_path: Path) -> None:
    config = load_config(config_file, ["air.rainy.lwc_g_m3=0.1"])
    again = tmp_path / "again.yaml"
    again.write_text(to_yaml(config))
    assert load_config(again) == config
    assert load_config(again).sha256() == config.sha256()
    assert config.identity()["air"]["sunny"]["rain_mm_h"] == 0.0
    assert config.identity()["air"]["rainy"]["lwc_g_m3"] == 0.1
    assert load_config(again, ["weathers=[sunny]"]).air.keys() == {"sunny"}


@pytest.mark.parametrize(
    ("changes", "part"),
    [
        (["weathers=[sunny, snowy]"], "weathers holds 'snowy', of which nothing is known; presets are sunny, "),
        (["air.rany.rain_mm_h=40"], "'rany' is described, but weathers = ['sunny', 'rainy']; add it there, or remove"),
        (["air.rainy.rain_mm_h=-3"], "air.rainy.rain_mm_h = -3: must be greater than or equal to 0"),
        (["air.rainy.rainrate=3"], "air.rainy.rainrate = 3: unknown key"),
        (["air.rainy.preset=wet"], "'heavy_rain'"),
        (["air.rainy.fog_type=thick"], "'moderate_advection'"),
        (["air.rainy=25"], "a section of keys is needed"),
        (["weathers=[3]", "air.monsoon={rain_mm_h: 60}"], "weathers[0] = 3"),
    ],
)
def test_bad_sections_give_one_clear_line(config_file: Path, changes: list[str], part: str) -> None:
    with pytest.raises(ConfigError) as error:
        load_config(config_file, changes)
    (problem,) = error.value.problems
    assert part in problem and "\n" not in problem
