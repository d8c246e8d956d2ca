"""What holds for every shipped town: its builder, its budget, how it opens, and that everything stands where it may."""

from pathlib import Path

import pytest

from mmw.config import load_config
from mmw.core.resources import assets_dir, configs_dir
from tests.fixtures import town_checks as checks

SCENARIOS = sorted((configs_dir() / "scenarios").glob("*.yaml"))
TOWNS = {"town03": 100, "town05": 120, "town07": 50, "town10": 45}
"""Town -> it has more buildings than this (count)."""


def test_these_are_all() -> None:
    assert sorted(path.parent.name for path in (assets_dir() / "towns").glob("*/*.yaml")) == list(TOWNS)


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.slow] * (name != "town10")) for name in TOWNS])
def test_committed_files_are_what_the_description_builds(name: str, tmp_path: Path) -> None:
    checks.assert_rebuilt(name, tmp_path)


@pytest.mark.parametrize("name", TOWNS)
def test_asset_is_valid_and_within_the_budget(name: str) -> None:
    stage = checks.stage_of(name)
    checks.assert_valid_and_of_size(stage, name)
    assert len(stage.GetPrimAtPath("/Town/Buildings").GetChildren()) > TOWNS[name]


@pytest.mark.parametrize("name", TOWNS)
def test_opens_without_what_is_not_needed(name: str) -> None:
    """The roads, buildings and props come as a payload; without it nothing but the interface and materials is read."""
    checks.assert_opens_light(name)


@pytest.mark.parametrize("name", TOWNS)
def test_every_lane_can_be_reached(name: str) -> None:
    assert len(checks.assert_connected(checks.stage_of(name)).lanes) > 100


@pytest.mark.parametrize("name", TOWNS)
def test_no_building_touches_a_road_or_floats(name: str) -> None:
    checks.assert_buildings_stand(checks.stage_of(name), checks.network_of(name))


@pytest.mark.parametrize("name", TOWNS)
def test_no_prop_stands_in_a_lane_or_floats(name: str) -> None:
    checks.assert_props_stand(checks.stage_of(name), checks.network_of(name))


@pytest.mark.parametrize("path", SCENARIOS, ids=lambda path: path.stem)
def test_units_stand_beside_the_road_in_nothing_solid(path: Path) -> None:
    (scenario,) = load_config(path).scenarios
    assert scenario.name == path.stem and scenario.town is not None and scenario.name.startswith(scenario.town)
    if scenario.name == "town05_ring_road":
        return  # on the parapet: `tests/worlds/towns/test_town05.py`
    stage, network = checks.stage_of(scenario.town), checks.network_of(scenario.town)
    for unit in scenario.rsus:
        checks.assert_unit_stands_free(unit.position_m, stage, network)
