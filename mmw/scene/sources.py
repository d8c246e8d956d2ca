"""Find the files that a scenario starts from."""

from pathlib import Path

from pxr import Usd

from mmw.config import ScenarioConfig
from mmw.config.scenario import TOWN_SUFFIXES
from mmw.core.errors import InputError
from mmw.core.resources import town_path
from mmw.usd.notices import read_notices
from mmw.usd.open_stage import open_stage, reads_usd


def scenario_source(scenario: ScenarioConfig, base: Path) -> Path:
    """Return the USD file that a scenario starts from: its town asset or the user's own stage.

    A town is a shipped name, or a path relative to `base`, the configuration file's folder.

    Raises:
        InputError: If the file does not exist.
    """
    if scenario.stage is not None:
        return _existing(scenario, base, "stage", scenario.stage, "a USD file")
    town = scenario.town or ""
    if is_town_file(scenario):
        return _existing(scenario, base, "town", town, "an existing town asset")
    try:
        return town_path(town)
    except InputError as error:
        raise InputError(f"scenario {scenario.name!r}: {error}") from None


def _existing(scenario: ScenarioConfig, base: Path, key: str, value: str, needed: str) -> Path:
    path = base / value
    if not path.is_file():
        raise InputError(f"scenario {scenario.name!r}: {key} = {value!r}: no such file ({path}); give {needed}")
    return path


def is_town_file(scenario: ScenarioConfig) -> bool:
    """Return whether a scenario's town is a file of the user's rather than a shipped town's name."""
    return scenario.town is not None and scenario.town.endswith(TOWN_SUFFIXES)


def trajectory_file(scenario: ScenarioConfig, base: Path) -> Path | None:
    """Return the table of a scenario's recorded vehicles; None if its traffic is generated.

    Raises:
        InputError: If the file does not exist.
    """
    if scenario.traffic is None or scenario.traffic.trajectories is None:
        return None
    value = scenario.traffic.trajectories
    return _existing(scenario, base, "traffic.trajectories", value, "a .parquet, .csv or .xml table")


@reads_usd
def source_notices(source: Path) -> list[str]:
    """Return what has to be named with a stage or a town: the notices that imports wrote into its layers.

    Raises:
        InputError: If USD cannot read the file.
    """
    return read_notices(open_stage(source))


@reads_usd
def weather_variants(source: Path) -> list[str]:
    """Return the weather variants of a town or stage; none if its default prim has no such variant set.

    Raises:
        InputError: If USD cannot read the file.
    """
    stage = open_stage(source, Usd.Stage.LoadNone)  # its prims are valid as long as it is
    root = stage.GetDefaultPrim()
    return root.GetVariantSet("weather").GetVariantNames() if root else []
