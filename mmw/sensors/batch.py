"""Hold the context of one scenario's sensors: constant inputs, and the lists that gather its rows."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from mmw.channel.path_solver.surface_table import SurfaceTable
from mmw.config import Config, ScenarioConfig
from mmw.core.kinematics import Motion
from mmw.core.timing import StageTimer
from mmw.kernels.shading import structs as shading
from mmw.physics.weather.weather import Weather
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData
from mmw.sensors.image_encoder import Encoder
from mmw.sensors.render.appearance_buffers import AppearanceArrays
from mmw.sensors.rgb.config import RgbCamera
from mmw.sensors.rgb.simulate import RgbRenderer


@dataclass(frozen=True)
class Batch:
    """Everything that stays the same while one scenario is traced."""

    config: Config
    scenario: ScenarioConfig
    arrays: SceneData
    motion: Motion
    scene: DeviceScene
    surfaces: SurfaceTable | None
    pool: ThreadPoolExecutor
    clock: StageTimer
    _rgb: dict[bool, RgbRenderer] = field(default_factory=dict)

    @cached_property
    def encoder(self) -> Encoder:
        """Encoder that submits images to the pool."""
        return Encoder(self.pool)

    @property
    def rgb_sensors(self) -> tuple[RgbCamera, ...]:
        """The RGB cameras."""
        return tuple(sensor for sensor in self.config.sensors if isinstance(sensor, RgbCamera))

    def weather(self, name: str) -> Weather:
        """Return the physical values of a weather by its name."""
        return self.config.air[name].weather(name)

    def rgb_camera(self, debug: bool) -> RgbRenderer:
        """Return what renders RGB images in all weathers; textures and skies are made at the first call."""
        if debug not in self._rgb:
            weathers = {name: self.weather(name) for name in self.config.weathers}
            with self.clock.stage("textures and skies"):
                self._rgb[debug] = RgbRenderer(self.scene, weathers, seed=self.config.seed, debug=debug)
        return self._rgb[debug]

    @cached_property
    def alpha_cutouts(self) -> "shading.AppearanceTable | None":
        """Appearance of a scene with cut-out textures, whose holes the rays of all cameras pass; None without any."""
        if self.rgb_sensors:
            return self.rgb_camera(self.rgb_sensors[0].debug).alpha_cutouts
        first = self.config.weathers[0]
        found = [material.appearance for material in self.arrays.materials[first]]
        if not any(entry.opacity_threshold > 0.0 and entry.opacity_texture for entry in found):
            return None
        appearance = AppearanceArrays(self.scene).for_weather(first)
        return appearance if appearance.has_holes else None

    def texture_notes(self) -> list[str]:
        """Return the notes for the user on textures, one line each; nothing without RGB cameras."""
        return [line for debug in {s.debug for s in self.rgb_sensors} for line in self.rgb_camera(debug).notes]


TableRows = dict[str, dict[str, list[Any]]]
"""Weather -> table -> columns of each batch, or the future of them where a thread still works on it."""


def collect(collected: TableRows, tables: dict[str, Any]) -> None:
    """Add columns that are the same in every weather."""
    for by_table in collected.values():
        for name, columns in tables.items():
            by_table[name].append(columns)
