"""Choose the one scenario and weather of a configuration that a simulation has, and the device that traces it."""

import os
from dataclasses import dataclass
from pathlib import Path

from mmw.config import Config, ScenarioConfig
from mmw.config.load import Source, base_folder, in_config, load_config, place_of
from mmw.core.device import choose_device
from mmw.core.errors import InputError
from mmw.generation.estimate import check_inputs


@dataclass(frozen=True)
class ChosenScenario:
    """Configuration, scenario, weather and device of a simulation."""

    config: Config
    scenario: ScenarioConfig
    weather: str
    base: Path
    """Folder that relative paths of input files start from."""
    place: Path | str
    """Place of the configuration, for messages."""
    device: str
    """Warp device."""


def choose_scenario(
    config: Source, scenario: str | None, weather: str | None, base: str | os.PathLike[str] | None, device: str
) -> ChosenScenario:
    """Return a checked configuration and what is chosen of it; arguments as of `mmw.Simulation`.

    Raises:
        ConfigError: If the configuration or a file that it names cannot be used; one line for each problem.
        InputError: If there is no such scenario, weather or device.
    """
    found = load_config(config, base=base)
    found.check_single("a simulation")
    chosen = found.scenario(scenario or "")
    own = found.weathers[0] if weather is None else weather
    if own not in found.weathers:
        raise InputError(f"weather = {own}: there are {', '.join(found.weathers)}; name one of them")
    where, place = base_folder(config, base), place_of(config)
    with in_config(place):
        check_inputs(found.model_copy(update={"scenarios": (chosen,)}), where)
    return ChosenScenario(
        found, chosen, own, where, place, choose_device(found.compute.device if device == "auto" else device)
    )
