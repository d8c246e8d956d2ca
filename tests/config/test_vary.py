"""Draws of a seed: weather in ranges, and clear errors."""

from pathlib import Path

import pytest

from mmw.config import ConfigError, load_config
from mmw.config.load import to_yaml

RANGES = "vary={weather: {rainy: {rain_mm_h: [2, 40], wetness: [0.5, 0.5]}}}"


def rain(seed: int) -> float | None:
    return load_config("quickstart", ["weathers=[sunny, rainy]", RANGES, f"seed={seed}"]).air["rainy"].rain_mm_h


def test_a_seed_draws_weather_within_its_range() -> None:
    drawn = [rain(seed) for seed in range(200)]
    assert drawn == [rain(seed) for seed in range(200)]
    values = [value for value in drawn if value is not None]
    assert min(values) < 5 and max(values) > 37 and all(2 <= value <= 40 for value in values)
    assert sum(values) / 200 == pytest.approx(21, abs=5 * 38 / 12**0.5 / 200**0.5)  # five deviations of the mean
    config = load_config("quickstart", ["weathers=[sunny, rainy]", RANGES])
    plain = load_config("quickstart", ["weathers=[sunny, rainy]"])
    assert config.air["rainy"].wetness == 0.5 and config.air["sunny"] == plain.air["sunny"]


def test_the_written_configuration_draws_the_same(tmp_path: Path) -> None:
    config = load_config("quickstart", ["weathers=[rainy]", RANGES, "vary.spawn={}", "vary.rsu={radius_m: 30}"])
    (tmp_path / "c.yaml").write_text(to_yaml(config))
    again = load_config(tmp_path / "c.yaml")
    assert again == config and again.sha256() == config.sha256()
    assert config.vary is not None and config.vary.spawn is not None and config.vary.spawn.radius_m == 150


def test_without_it_the_identity_is_as_before() -> None:
    config = load_config("quickstart")
    assert "vary" not in config.identity() and "sweep" not in config.identity()
    assert load_config("quickstart", ["vary={spawn: {}}"]).sha256() != config.sha256()


@pytest.mark.parametrize(
    ("changes", "told"),
    [
        (["vary={spwan: {}}"], "unknown key; did you mean `spawn`?"),
        (["vary={spawn: {radius: 3}}"], "unknown key; did you mean `radius_m`?"),
        (["vary={weather: {rany: {}}}"], "vary.weather names 'rany', and weathers = ['sunny']"),
        (["vary={weather: {sunny: {rain_mmh: [1, 2]}}}"], "rain_mmh: unknown key; did you mean `rain_mm_h`?"),
        (["vary={weather: {sunny: {rain_mm_h: [3, 2]}}}"], "two values from 0 to 250 are needed"),
        (["vary={weather: {sunny: {rain_mm_h: [1, 2000]}}}"], "two values from 0 to 250 are needed"),
        (["vary={rsu: {}}", "scenarios.0.rsus=[]", "channel.links=[v2v]"], "vary.rsu needs `town` and `rsus`"),
        (
            ["vary={spawn: {}}", "scenarios.0.traffic.engine=replay", "scenarios.0.traffic.trajectories=t.csv"],
            "vary.spawn needs generated traffic",
        ),
    ],
)
def test_mistakes_are_told(changes: list[str], told: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_config("quickstart", changes)
    assert told in str(caught.value)
