"""What stays the same while one scenario is traced, and where its rows are gathered."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any

from mmw.channel.surface_table import SurfaceTable
from mmw.config import Config, ScenarioConfig
from mmw.kinematics import Motion
from mmw.report import Clock
from mmw.scene import Scene
from mmw.scene_arrays import SceneArrays
from mmw.weather import Weather


@dataclass(frozen=True)
class Job:
    """Everything that stays the same while one scenario is traced."""

    config: Config
    scenario: ScenarioConfig
    arrays: SceneArrays
    motion: Motion
    scene: Scene
    surfaces: SurfaceTable | None
    pool: ThreadPoolExecutor
    clock: Clock

    def weather(self, name: str) -> Weather:
        """Return the physical values of a weather by its name."""
        return self.config.air[name].weather(name)


Rows = dict[str, dict[str, list[Any]]]
"""Weather -> table -> columns of each batch, or the future of them where a thread still works on it."""


def collect(collected: Rows, tables: dict[str, Any]) -> None:
    """Add columns that are the same in every weather."""
    for by_table in collected.values():
        for name, columns in tables.items():
            by_table[name].append(columns)
