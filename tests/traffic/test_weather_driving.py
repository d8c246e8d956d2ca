"""Drivers in rain and fog: published reductions, and traffic that is slower by them."""

from dataclasses import replace

import numpy as np
import pytest

from mmw.config import Config
from mmw.core.errors import InputError
from mmw.physics.weather.weather import PRESETS, Weather
from mmw.scene.prepare import scenario_drivers
from mmw.traffic.engine import simulate_traffic
from mmw.traffic.spawn import draw_starts
from mmw.traffic.weather_driving import DriverFactors, driver_factors
from tests.fixtures.traffic_towns import crossroad, demand

SCENARIO = {
    "name": "s", "town": "town03",
    "traffic": {"vehicle_count": 2, "spawn_center_m": [0, 0, 0], "cav_ranks": [0], "driving_weather": "rainy"},
}  # fmt: skip


def test_factors_are_those_of_the_sources() -> None:
    assert driver_factors(Weather()) == (1.0, 1.0)
    heavy = driver_factors(Weather(rain_mm_h=16.0))
    assert 0.91 <= heavy.speed <= 0.94 and heavy.headway == pytest.approx(1 / 0.8587)
    light = driver_factors(Weather(rain_mm_h=0.1))
    assert 0.964 <= light.speed <= 0.98 and light.headway == pytest.approx(1 / 0.9799)
    assert driver_factors(Weather(rain_mm_h=5.0)).headway == pytest.approx(1 / 0.9276)
    assert driver_factors(Weather(visibility_m=300.0)) == (pytest.approx(0.98), 1.0)
    rates = [driver_factors(Weather(rain_mm_h=rate)) for rate in np.linspace(0, 60, 121)]
    assert (np.diff([one.speed for one in rates]) <= 0).all() and (np.diff([one.headway for one in rates]) >= 0).all()
    assert rates[-1].speed == heavy.speed


def test_a_configuration_names_the_weather() -> None:
    config = Config(scenarios=[SCENARIO], weathers=["sunny"])
    assert scenario_drivers(config, config.scenarios[0].traffic) == driver_factors(PRESETS["rainy"])
    own = Config(scenarios=[SCENARIO], weathers=["rainy"], air={"rainy": {"rain_mm_h": 1.0}})
    assert scenario_drivers(own, own.scenarios[0].traffic) == driver_factors(Weather(rain_mm_h=1.0, visibility_m=5000))
    plain = {**SCENARIO, "traffic": {**SCENARIO["traffic"], "driving_weather": None}}
    unused = Config(scenarios=[plain])
    assert scenario_drivers(unused, unused.scenarios[0].traffic) == (1.0, 1.0)
    assert "driving_weather" not in unused.model_dump(mode="json")["scenarios"][0]["traffic"]
    with pytest.raises(InputError, match=r"driving_weather = 'snowy'; there are sunny, .* name one of them"):
        Config(scenarios=[{**SCENARIO, "traffic": {**SCENARIO["traffic"], "driving_weather": "snowy"}}])
    replayed = {"vehicle_count": 2, "spawn_center_m": [0, 0, 0], "cav_ranks": [0], "engine": "replay"}
    with pytest.raises(InputError, match="`driving_weather` goes with engine: idm or sumo"):
        Config(scenarios=[{**SCENARIO, "traffic": {**replayed, "trajectories": "t.csv", "driving_weather": "rainy"}}])


def test_traffic_in_rain_is_slower_with_the_same_people_at_the_same_places() -> None:
    sun = demand(crossroad(), vehicle_count=1, frame_count=600, warmup_s=1.0)
    assert sun.drivers == (1.0, 1.0)
    rain = replace(sun, drivers=DriverFactors(0.9, 1.2))
    starts = [draw_starts(one, frozenset(sun.town.lanes.lanes))[0] for one in (sun, rain)]
    for fair, wet in zip(*starts, strict=True):
        assert (wet.factor, wet.headway) == (0.9 * fair.factor, 1.2 * fair.headway) and wet.point == fair.point
    tracks = [simulate_traffic(one).tracks for one in (sun, rain)]
    for fair, wet in zip(*tracks, strict=True):
        assert (fair.name, fair.model, fair.paint) == (wet.name, wet.model, wet.paint)
    ahead = tracks[0][0].poses[:, 0] - tracks[1][0].poses[:, 0]  # the vehicle drives east, then turns
    assert (ahead > 0.0).all() and ahead[0] > 1.0
