"""Find the places of roadside units and base stations that are given by latitude and longitude."""

from pathlib import Path
from typing import TypeVar

from mmw.config import ScenarioConfig
from mmw.config.placed_agents import RsuConfig
from mmw.core.georeference import Georeference, locate
from mmw.usd.georeference import read_georeference
from mmw.usd.open_stage import open_stage

Unit = TypeVar("Unit", bound=RsuConfig)


def place_units(scenario: ScenarioConfig, source: Path) -> ScenarioConfig:
    """Return a scenario whose units all have places in the world frame.

    Args:
        scenario: The scenario.
        source: Its town asset or stage.

    Raises:
        InputError: If a unit has latitude and longitude, and the town has no geographic origin or is far from there.
    """
    if not any(unit.lat_lon for unit in (*scenario.rsus, *scenario.base_stations)):
        return scenario
    reference = read_georeference(open_stage(source))
    rsus, stations = (
        tuple(_placed(scenario.name, unit, reference) for unit in units)
        for units in (scenario.rsus, scenario.base_stations)
    )
    return scenario.model_copy(update={"rsus": rsus, "base_stations": stations})


def _placed(scenario: str, unit: Unit, reference: Georeference | None) -> Unit:
    if unit.lat_lon is None:
        return unit
    x, y = locate(reference, [unit.lat_lon], f"scenario {scenario!r}: {unit.name!r}")[0].tolist()
    dx, dy, dz = unit.position_m
    return unit.model_copy(update={"position_m": (x + dx, y + dy, dz), "lat_lon": None})
