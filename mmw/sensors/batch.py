"""Hold the context of one scenario's sensors: constant inputs, and the lists that gather its rows."""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from mmw.channel.path_solver.surface_table import SurfaceTable
from mmw.config import Config, ScenarioConfig, SensorConfig
from mmw.config.air import AirConfig
from mmw.core.kinematics import Motion
from mmw.core.later import Later, Waiting
from mmw.core.recorded_work import DirectWork, RecordedWork, Work, can_record
from mmw.core.remember import remembered
from mmw.core.timing import StageTimer
from mmw.kernels.shading import structs as shading
from mmw.physics.weather.weather import Weather
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData
from mmw.scene.views import SensorViews, Views
from mmw.sensors.image_encoder import Encoder
from mmw.sensors.render.appearance_buffers import alpha_cutouts
from mmw.sensors.rgb.config import RgbCamera
from mmw.sensors.rgb.simulate import RgbRenderer, rgb_renderer
from mmw.sensors.sensor_input import SensorInput


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
    cache: dict[Any, Any] = field(default_factory=dict)
    """See `SensorInput.cached`."""
    puts_off: bool = False
    """True: what threads of the pool would make waits until it is asked for, as in a live frame: most of it is never
    looked at. And launches are recorded, as the same ones come again with every frame."""
    _views: dict[tuple[int, ...], SensorViews] = field(default_factory=dict, init=False, repr=False)
    """Views of the last frames that were asked for."""

    def views(self, frames: Sequence[int], sensor: SensorConfig) -> Views:
        """Return `mmw.scene.views.sample_views` of a sensor; those of all sensors are composed at the first call."""
        made = self._views.get(tuple(frames))
        if made is None:
            self._views.clear()
            made = self._views[tuple(frames)] = SensorViews(self.arrays, frames, self.config.sensors)
        return made.of(sensor)

    @cached_property
    def encoder(self) -> Encoder:
        """Encoder that submits images to the pool."""
        return Encoder(self.pool, puts_off=self.puts_off)

    @property
    def work(self) -> Work:
        """Runs the launches of cameras; in a live frame they are recorded, as they come again with every step."""
        key = "work of cameras", self.puts_off
        if key not in self.cache:
            is_recorded = self.puts_off and can_record(self.scene.device)
            self.cache[key] = (RecordedWork if is_recorded else DirectWork)(self.scene.device)
        return self.cache[key]

    def submit(self, call: Callable[..., Any], *args: Any) -> Waiting:
        """Return the future of `call(*args)`, which a thread makes."""
        return Later(self.pool, call, *args) if self.puts_off else self.pool.submit(call, *args)

    @property
    def rgb_sensors(self) -> tuple[RgbCamera, ...]:
        """The RGB cameras."""
        return tuple(sensor for sensor in self.config.sensors if isinstance(sensor, RgbCamera))

    def weather(self, name: str) -> Weather:
        """Return the physical values of a weather by its name."""
        return _weather(self.config.air[name], name)

    def sensor_input(self, views: Views, weathers: Iterable[str]) -> SensorInput:
        """Return the input of a sensor with these views in some weathers."""
        air = {name: self.weather(name) for name in weathers}
        return SensorInput(
            self.scene.optical,
            self.motion,
            views,
            air,
            self.config.seed,
            self.scenario.name,
            cache=self.cache,
            radio_scene=self.scene,
            scene_seed=self.config.seed_of_scene,
        )

    def rgb_camera(self, debug: bool) -> RgbRenderer:
        """Return what renders RGB images in all weathers; textures and skies are made at the first call."""
        weathers = {name: self.weather(name) for name in self.config.weathers}
        with self.clock.stage("textures and skies"):
            return rgb_renderer(self.cache, self.scene.optical, weathers, self.config.seed_of_scene, debug)

    @cached_property
    def alpha_cutouts(self) -> "shading.AppearanceTable | None":
        """Appearance of a scene with cut-out textures, whose holes the rays of all cameras pass; None without any."""
        if self.rgb_sensors:
            return self.rgb_camera(self.rgb_sensors[0].debug).alpha_cutouts
        return alpha_cutouts(self.scene.optical)

    def texture_notes(self) -> list[str]:
        """Return the notes for the user on textures, one line each; nothing without RGB cameras."""
        return [line for debug in {s.debug for s in self.rgb_sensors} for line in self.rgb_camera(debug).notes]


@remembered()
def _weather(air: AirConfig, name: str) -> Weather:
    return air.weather(name)


TableRows = dict[str, dict[str, list[Any]]]
"""Weather -> table -> columns of each batch, or the future of them where a thread still works on it."""


def collect(collected: TableRows, tables: dict[str, Any]) -> None:
    """Add columns that are the same in every weather."""
    for by_table in collected.values():
        for name, columns in tables.items():
            by_table[name].append(columns)
