"""The physical weather: derived values against tables, and the section `air` of the configuration."""

import csv
from pathlib import Path
from typing import get_args

import pytest

from mmw.config import ConfigError, load_config
from mmw.config.load import to_yaml
from mmw.config.weather import PresetName
from mmw.town.block_description import SHIPPED_WEATHER
from mmw.weather import FOG_WATER_G_M2, PRESETS, FogType, Weather

FOG = Path(__file__).parent / "reference" / "weather" / "mie_fog_water.csv"


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
    assert set(SHIPPED_WEATHER) <= set(PRESETS)
    for name, town in SHIPPED_WEATHER.items():
        assert PRESETS[name].rain_mm_h == town.rain_rate_mm_h
    assert PRESETS["foggy"].visibility_m == SHIPPED_WEATHER["foggy"].visibility_m
    assert get_args(PresetName) == tuple(PRESETS)


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
    assert weathers["rainy"] == Weather(40.0, temperature_c=10.0, relative_humidity=1.0)
    assert weathers["monsoon"] == Weather(50.0, temperature_c=28.0, relative_humidity=1.0)
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
        (
            ["weathers=[sunny, snowy]"],
            "weathers holds 'snowy', of which nothing is known; presets are sunny, ",
        ),
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
    assert len(error.value.problems) == 1
    assert part in error.value.problems[0]
    assert "\n" not in error.value.problems[0]
