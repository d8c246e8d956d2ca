"""CARLA's weather parameters: its presets against its source, our mapping against a table by hand, bad input."""

import csv
import math
from pathlib import Path
from typing import get_args

import pytest

from mmw.config import Config, ConfigError, load_config
from mmw.config.carla_weather import CarlaPresetName, CarlaWeatherConfig
from mmw.config.load import to_yaml
from mmw.physics.weather.carla import CARLA_PRESETS, RANGES, carla_preset, fog_decay, from_carla
from mmw.physics.weather.weather import PRESETS, Weather

REFERENCE = Path(__file__).parents[2] / "reference" / "weather" / "carla_weather_presets.csv"


def air(folder: Path, *changes: str, names: str = "mine") -> Config:
    path = folder / "c.yaml"
    path.write_text(f"scenarios: [{{name: s, stage: s.usda}}]\nweathers: [{names}]\nsensors: []\n")
    return load_config(path, changes)


def weather(folder: Path, *changes: str, name: str = "mine") -> Weather:
    return air(folder, *changes, names=name).air[name].weather(name)


def test_presets_equal_those_of_carla() -> None:
    rows = list(csv.DictReader(REFERENCE.read_text().splitlines()))
    assert [row.pop("preset") for row in rows] == list(CARLA_PRESETS) == list(get_args(CarlaPresetName))
    assert [{name: float(value) for name, value in row.items()} for row in rows] == list(CARLA_PRESETS.values())
    assert list(rows[0]) == list(RANGES) == list(CarlaWeatherConfig.model_fields)
    assert len(rows) == 23 and len(RANGES) == 14


@pytest.mark.parametrize(
    ("name", "rain", "visibility", "wind", "puddles"),
    [
        ("ClearNoon", 0.0, 8903.0, 2.0, 0.0),
        ("SoftRainNoon", 3.981, 8401.0, 6.0, 0.5),
        ("MidRainyNoon", 15.849, 8401.0, 12.0, 0.6),
        ("HardRainNoon", 100.0, 6659.0, 20.0, 0.9),
        ("HardRainNight", 100.0, 30.0, 20.0, 0.9),
        ("DustStorm", 0.0, 473.4, 20.0, 0.0),
    ],
)
def test_physical_values_of_presets(name: str, rain: float, visibility: float, wind: float, puddles: float) -> None:
    mapped = from_carla(carla_preset(name), Weather())
    assert mapped.rain_mm_h == pytest.approx(rain, rel=1e-3)
    assert mapped.visibility_m == pytest.approx(visibility, rel=1e-3)
    assert (mapped.wind_m_s, mapped.puddles) == pytest.approx((wind, puddles))
    assert mapped.sun_altitude_deg == CARLA_PRESETS[name]["sun_altitude_angle"]
    assert mapped.sun_azimuth_deg == Weather().sun_azimuth_deg  # -1 in every preset


@pytest.mark.parametrize(
    ("density", "metres"), [(10, 5592), (25, 2340), (50, 547.7), (75, 128.2), (90, 53.65), (100, 30)]
)
def test_fog_density(density: float, metres: float) -> None:
    assert from_carla({"fog_density": density}, Weather()).visibility_m == pytest.approx(metres, rel=1e-3)


def test_zero_is_clear_and_rain_alone_wets_no_road() -> None:
    clear = from_carla({"precipitation": 0, "fog_density": 0, "dust_storm": 0}, Weather(rain_mm_h=9, visibility_m=99))
    assert (clear.rain_mm_h, clear.visibility_m, clear.liquid_water_g_m3) == (0.0, 20_000.0, 0.0)
    rain = from_carla({"precipitation": 100}, Weather())
    assert (rain.wetness, rain.puddles, rain.variants("mine")) == (0.0, 0.0, ("mine", "sunny"))
    hard = from_carla(carla_preset("HardRainNoon"), Weather())
    assert hard.wetness == 0.0 and hard.variants("mine") == ("mine", "rainy", "foggy")  # its puddles are wet


def test_unset_parameters_change_nothing() -> None:
    assert from_carla(carla_preset("Default"), PRESETS["rainy"]) == PRESETS["rainy"]
    assert from_carla(dict.fromkeys(RANGES, -1.0), PRESETS["foggy"]) == PRESETS["foggy"]
    assert from_carla({}, PRESETS["foggy"]) == PRESETS["foggy"]


def test_every_parameter_has_an_effect_within_the_limits() -> None:
    base = from_carla(dict.fromkeys(RANGES, 50.0), Weather())
    for name, ends in RANGES.items():
        for end in ends:
            assert from_carla(dict.fromkeys(RANGES, 50.0) | {name: end}, Weather()) != base, name
    assert from_carla({name: high for name, (_, high) in RANGES.items()}, Weather()).visibility_m > 10.0


def test_dust_is_dry() -> None:
    dust = from_carla({"dust_storm": 100}, PRESETS["sunny"])
    assert dust.visibility_m == pytest.approx(1 / (1 / 500 + 1 / 20_000))
    assert dust.liquid_water_g_m3 == 0.0
    both = from_carla({"dust_storm": 50, "fog_density": 75}, Weather())
    fog = from_carla({"fog_density": 75}, Weather())
    assert both.visibility_m == pytest.approx(1 / (1 / 1000 + 1 / fog.visibility_m))
    assert both.liquid_water_g_m3 == fog.liquid_water_g_m3 > 0.2


def test_fog_thins_out_as_in_unreal_and_the_sun_stands_in_the_south() -> None:
    assert math.exp(-10.0 * fog_decay(1.0)) == pytest.approx(0.5)
    assert math.exp(-2.0 * fog_decay(5.0)) == pytest.approx(0.5)
    assert fog_decay(0.0) == 0.0
    sun = from_carla({"sun_azimuth_angle": 180, "sun_altitude_angle": 65}, Weather(sun_azimuth_deg=10))
    assert (sun.sun_azimuth_deg, sun.sun_altitude_deg) == (180.0, 65.0)


def test_names_and_parameters_in_a_configuration(tmp_path: Path) -> None:
    named = weather(tmp_path, "air.mine={carla: MidRainyNoon}")
    assert named == from_carla(carla_preset("MidRainyNoon"), Weather())
    part = weather(tmp_path, "air.mine={carla: {cloudiness: 60, precipitation: 60, wetness: -1}}")
    assert part == Weather(10 ** (60 / 50), cloudiness=0.6)
    over = weather(tmp_path, "air.rainy={carla: {precipitation: 30}}", name="rainy")
    assert over == from_carla({"precipitation": 30}, PRESETS["rainy"]) and over.wetness == 1.0
    beside = weather(tmp_path, "air.mine={preset: foggy, carla: {wetness: 100}}")
    assert (beside.visibility_m, beside.wetness, beside.temperature_c) == (75.0, 1.0, 10.0)


def test_physical_keys_win(tmp_path: Path) -> None:
    mine = weather(tmp_path, "air.mine={carla: HardRainNight, rain_mm_h: 7, wetness: 0.3, fog_type: radiation}")
    assert (mine.rain_mm_h, mine.wetness, mine.visibility_m) == (7.0, 0.3, pytest.approx(30.0))
    assert mine.liquid_water_g_m3 == pytest.approx(5.427 / 30)
    dusty = weather(tmp_path, "air.mine={carla: {dust_storm: 100}, visibility_m: 100}")
    assert dusty == Weather(visibility_m=100.0) and dusty.liquid_water_g_m3 > 0.3
    dense = weather(tmp_path, "air.mine={carla: {dust_storm: 50, fog_density: 75}, fog_type: radiation}")
    assert dense.liquid_water_g_m3 == pytest.approx(5.427 / 128.2, rel=1e-3)


def test_the_resolved_section_reads_back(tmp_path: Path) -> None:
    config = air(
        tmp_path, "air={mine: {carla: DustStorm}, sky: {carla: {mie_scattering_scale: 0.5}}}", names="mine, sky"
    )
    again = tmp_path / "again.yaml"
    again.write_text(to_yaml(config))
    assert load_config(again) == config
    assert config.air["mine"].carla is None and config.air["mine"].lwc_g_m3 == 0.0
    assert config.air["sky"].mie_scattering_scale == 0.5


@pytest.mark.parametrize(
    ("entry", "part"),
    [
        ("carla: HardNoon", "air.mine.carla = \"HardNoon\": is no preset of CARLA's; it has Default, ClearNoon"),
        ("carla: {percipitation: 3}", "air.mine.carla.percipitation = 3: unknown key; did you mean `precipitation`?"),
        ("carla: {precipitation: -3}", "air.mine.carla.precipitation = -3: 0 to 100, or -1 for unset, is needed"),
        ("carla: {wetness: 100.5}", "air.mine.carla.wetness = 100.5: 0 to 100, or -1 for unset"),
        ("carla: {sun_altitude_angle: 91}", "-90 to 90, or -1"),
        ("carla: {dust_storm: much}", "air.mine.carla.dust_storm = \"much\": a number is needed"),
        ("carla: 3", "air.mine.carla = 3: a section of keys is needed"),
        ("rain_mm_h: -0.5", "air.mine.rain_mm_h = -0.5: must be greater than or equal to 0; rain rate [mm/h]"),
        ("preset: HardRainNoon", "air.mine.preset = \"HardRainNoon\": must be 'sunny', 'light_rain'"),
    ],
)  # fmt: skip
def test_bad_entries_give_one_clear_line(tmp_path: Path, entry: str, part: str) -> None:
    with pytest.raises(ConfigError) as error:
        air(tmp_path, f"air.mine={{{entry}}}")
    (problem,) = error.value.problems
    assert part in problem and "\n" not in problem


def test_bad_values_from_code() -> None:
    with pytest.raises(ValueError, match=r"carla.precipitation = -2: 0 to 100, or -1 for unset, is needed"):
        from_carla({"precipitation": -2.0}, Weather())
    with pytest.raises(ValueError, match="is no preset of CARLA's"):
        carla_preset("Monsoon")
