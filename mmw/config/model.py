"""The whole configuration."""

import hashlib
import json
from typing import Any

from pydantic import Field, ValidationInfo, field_validator, model_validator

from mmw.config.agent_keys import check_agent
from mmw.config.air import AirConfig, resolve_air
from mmw.config.channel import ChannelConfig
from mmw.config.compute import ComputeConfig
from mmw.config.foliage import FoliageModel
from mmw.config.material_map import MaterialEntry, merged_maps
from mmw.config.output import OutputConfig
from mmw.config.sampling import Sampling
from mmw.config.scenario import FramesConfig, ScenarioConfig
from mmw.config.section import Name, Section
from mmw.config.sensors import AnySensor, default_sensors
from mmw.config.sweep import SweepConfig
from mmw.config.vary import VaryConfig, draw_air
from mmw.core.constants import FRAME_RATE_HZ
from mmw.core.errors import InputError
from mmw.physics.weather.weather import PRESETS


class Config(Section):
    """One configuration file."""

    scenarios: tuple[ScenarioConfig, ...] = Field(description="worlds, traffic and agents (list)")
    weathers: tuple[Name, ...] = Field(default=("sunny",), description="weathers to make (list)")
    frames: FramesConfig | None = Field(
        default=None, description="frames of every scenario; each scenario's own `frames` if absent (section)"
    )
    seed: int = Field(default=42, ge=0, lt=2**31, description="seeds traffic and sensor noise (number)")
    scene_seed: int | None = Field(
        default=None,
        ge=0,
        lt=2**31,
        description="seeds what a scene is made of: models and paints of vehicles and people, drawn roadside units and "
        "weather, clouds, patches of fog; traffic and noise keep `seed`, which is also this one's if null; engine idm "
        "(number)",
    )
    vary: VaryConfig | None = Field(
        default=None, description="what is drawn by `seed` besides models, drivers, routes and noise (section)"
    )
    air: dict[Name, AirConfig] = Field(
        default_factory=dict,
        validate_default=True,
        description="weather -> its physical values; presets need no entry, other names do (map)",
    )
    sensors: tuple[AnySensor, ...] = Field(default_factory=default_sensors, description="the agents' sensors (list)")
    materials: dict[str, MaterialEntry] = Field(
        default_factory=dict,
        description="glob of prim path or material name, or `label:` and a class -> material that the meshes get in "
        "every scenario: a radio material (`itu_brick`), or properties (map)",
    )
    foliage: FoliageModel = Field(
        default="hull",
        description="crowns of trees to sensors: `hull`, a solid body; `leaves`, leaves that light and radar pass "
        "between. Radio waves meet the hull in both (name)",
    )
    channel: ChannelConfig = Field(default_factory=ChannelConfig, description="radio links (section)")
    output: OutputConfig = Field(default_factory=OutputConfig, description="the dataset folder (section)")
    compute: ComputeConfig = Field(default_factory=ComputeConfig, description="device and batches (section)")
    sweep: SweepConfig | None = Field(
        default=None, description="several datasets that differ in some keys, one below `output.dir` each (section)"
    )

    @field_validator("scenarios")
    @classmethod
    def _scenario_names(cls, value: tuple[ScenarioConfig, ...]) -> tuple[ScenarioConfig, ...]:
        if not value:
            raise InputError("an empty list makes nothing; describe at least one scenario")
        names = [scenario.name for scenario in value]
        if len(set(names)) != len(names):
            raise InputError(f"{names} names a scenario twice; give each its own name")
        return value

    @field_validator("air")
    @classmethod
    def _known_weathers(cls, value: dict[str, AirConfig], info: ValidationInfo) -> dict[str, AirConfig]:
        weathers = info.data.get("weathers")  # absent if it is wrong itself, which is reported elsewhere
        vary, seed = info.data.get("vary"), info.data.get("seed")
        if weathers is None:
            return value
        scene_seed = info.data.get("scene_seed")
        if vary is not None and seed is not None:
            value = draw_air(value, vary, weathers, seed if scene_seed is None else scene_seed)
        return resolve_air(value, weathers)

    @model_validator(mode="after")
    def _unique(self) -> "Config":
        sensors = [sensor.name for sensor in self.sensors]
        if len(set(sensors)) != len(sensors):
            raise InputError(f"sensors are named {sensors}; give each its own name")
        names = [*sensors, *self.channel.antenna_names]
        if len({name.replace("-", "_") for name in names}) != len(names):  # their names in the USD stage
            raise InputError(
                f"sensors are named {', '.join(sensors)}, and antennas {', '.join(self.channel.antenna_names)}; each "
                "needs a name of its own, and `-` counts as `_`; rename one"
            )
        if not self.weathers:
            raise InputError("weathers is empty; name at least one, for example [sunny]")
        if len(set(self.weathers)) != len(self.weathers):
            raise InputError(f"weathers = {list(self.weathers)} names one twice; name each once")
        return self

    @model_validator(mode="after")
    def _agents_are_there(self) -> "Config":
        agents = self.agent_names
        if agents is None:
            return self
        for where, key in self.agent_keys:
            check_agent(where, key, agents)
        return self

    @model_validator(mode="after")
    def _samples_fall_on_frames(self) -> "Config":
        rates = {self.frame_rate_of(scenario) for scenario in self.scenarios}
        if len(rates) == 1:  # with several, a sensor without a rate has that of each scenario
            (rate,) = rates
            object.__setattr__(self, "sensors", tuple(sensor.with_rate(rate) for sensor in self.sensors))
        sampled: list[tuple[str, Sampling]] = [(f"sensors[{n}]", one) for n, one in enumerate(self.sensors)]
        if self.channel.enabled:
            sampled.append(("channel", self.channel))
        for scenario in self.scenarios:
            frames = self.frames_of(scenario)
            for where, one in sampled:
                one.check_frames(where, range(frames.start, frames.stop), self.frame_rate_of(scenario))
        return self

    @property
    def seed_of_scene(self) -> int:
        """`scene_seed`, or `seed` without one."""
        return self.seed if self.scene_seed is None else self.scene_seed

    @model_validator(mode="after")
    def _scene_seed_fits(self) -> "Config":
        for scenario in self.scenarios:
            engine = scenario.traffic.engine if scenario.traffic else None
            if self.scene_seed is not None and engine not in (None, "idm"):
                raise InputError(
                    f"scenario {scenario.name!r}: traffic.engine = {engine!r}: `scene_seed` gives vehicles of the "
                    "engine idm their models; change engine, or remove scene_seed"
                )
        return self

    @model_validator(mode="after")
    def _driving_weather_exists(self) -> "Config":
        known = tuple(dict.fromkeys((*self.air, *PRESETS)))
        for scenario in self.scenarios:
            name = scenario.traffic.driving_weather if scenario.traffic else None
            if name is not None and name not in known:
                raise InputError(
                    f"scenario {scenario.name!r}: traffic.driving_weather = {name!r}; there are {', '.join(known)}; "
                    "name one of them"
                )
        return self

    @model_validator(mode="after")
    def _vary_fits(self) -> "Config":
        for key, needed in (
            ("spawn", "generated traffic: `town`, and engine idm or sumo"),
            ("rsu", "`town` and `rsus`"),
        ):
            if self.vary is None or getattr(self.vary, key) is None:
                continue
            for scenario in self.scenarios:
                engine = scenario.traffic.engine if scenario.traffic else None
                if engine is None or (key == "spawn" and engine == "replay") or (key == "rsu" and not scenario.rsus):
                    raise InputError(f"vary.{key} needs {needed}; scenario {scenario.name!r} has none; remove one")
        return self

    def scenario(self, name: str) -> ScenarioConfig:
        """Return a scenario by its name, the first one for an empty name.

        Raises:
            InputError: If no scenario has this name.
        """
        found = {scenario.name: scenario for scenario in self.scenarios}
        if name and name not in found:
            raise InputError(f"scenario = {name}: there are {', '.join(found)}; name one of them")
        return found[name] if name else self.scenarios[0]

    @property
    def agent_keys(self) -> list[tuple[str, str]]:
        """Places of the configuration that choose agents, and their keys there."""
        mounted = [(f"sensors[{index}]", one) for index, one in enumerate(self.sensors)]
        mounted += [(f"channel.antennas[{index}]", one) for index, one in enumerate(self.channel.antennas)]
        places = [(f"{where}.{name}", getattr(one, name)) for where, one in mounted for name in ("on", "mount")]
        for index, rule in enumerate(self.channel.links):
            if not isinstance(rule, str):
                places += [(f"channel.links[{index}].{name}", getattr(rule, name)) for name in ("tx", "rx")]
        return [(where, key) for where, keys in places for key in keys]

    @property
    def agent_names(self) -> tuple[str, ...] | None:
        """Names of the agents of all scenarios; None if a stage or an engine of another package gives some."""
        engines = [scenario.traffic.engine if scenario.traffic else "" for scenario in self.scenarios]
        if not {*engines} <= {"idm", "sumo", "replay"}:
            return None
        cavs = max(one.traffic.cav_count for one in self.scenarios if one.traffic)
        vrus = max(one.traffic.vru_count for one in self.scenarios if one.traffic)
        placed = dict.fromkeys(name for scenario in self.scenarios for name in scenario.placed_names)
        numbered = [f"{role}_{number + 1}" for role, count in (("cav", cavs), ("vru", vrus)) for number in range(count)]
        return (*numbered, *placed)

    def check_single(self, use: str) -> None:
        """Check that this is the configuration of one dataset.

        Args:
            use: What needs one, for the message.

        Raises:
            InputError: If it has a sweep.
        """
        if self.sweep is not None:
            raise InputError(
                f"sweep: makes {self.sweep.count} datasets, and {use} needs one; remove the section, or give the "
                "config.yaml of one of its datasets"
            )

    def frames_of(self, scenario: ScenarioConfig) -> FramesConfig:
        """Return the frames of a scenario."""
        return self.frames or scenario.frames or FramesConfig()

    def materials_of(self, scenario: ScenarioConfig) -> dict[str, MaterialEntry]:
        """Return the material map of a scenario: its own entries, then those of the whole configuration."""
        return merged_maps(scenario.materials, self.materials)

    def frame_rate_of(self, scenario: ScenarioConfig) -> int:
        """Return the frames a second of a scenario: of `frames`, else of the scenario's own `frames`, else 100 Hz."""
        given = [frames.rate_hz for frames in (self.frames, scenario.frames) if frames is not None]
        return next((rate for rate in given if rate is not None), FRAME_RATE_HZ)

    @property
    def variants(self) -> dict[str, tuple[str, ...]]:
        """Weather -> variants of a stage's materials that can represent it, the best first."""
        return {name: air.weather(name).variants(name) for name, air in self.air.items()}

    @property
    def frame_total(self) -> int:
        """Frames of all scenarios and weathers together."""
        return len(self.weathers) * sum(self.frames_of(scenario).count for scenario in self.scenarios)

    def identity(self) -> dict[str, Any]:
        """Return what decides the bytes of the data: all but where they go, their license, and `compute`."""
        data = self.model_dump(mode="json")
        del data["compute"], data["sweep"]
        for key in ("dir", "staging", "license", "notices"):
            del data["output"][key]
        if self.vary is None:
            del data["vary"]  # as before there was such a key
        if self.foliage == "hull":
            del data["foliage"]  # likewise
        return data

    def sha256(self) -> str:
        """Return the SHA-256 of the identity, as sorted compact JSON."""
        return hashlib.sha256(json.dumps(self.identity(), sort_keys=True, separators=(",", ":")).encode()).hexdigest()
