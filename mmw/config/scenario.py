"""`scenarios`: world, traffic, agents."""

import re
from collections import Counter
from typing import Annotated, Any, Literal

from pydantic import Field, SerializerFunctionWrapHandler, field_validator, model_serializer, model_validator

from mmw.config.material_map import MaterialEntry
from mmw.config.placed_agents import BaseStationConfig, RsuConfig, UavConfig
from mmw.config.section import InputFile, InputPath, Name, PathText, Section, Vec3, without_empty
from mmw.config.traffic_engine import ENGINE_KEYS, ENGINES, engine_spec
from mmw.core.errors import InputError
from mmw.core.frame_rate import FRAME_RATES, check_frame_rate

TOWN_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")
"""A `town` that ends like this is a file of the user's, any other a shipped town's name."""


class FramesConfig(Section):
    """A stretch of a scenario; frame n is n / `rate_hz` after its start."""

    start: int = Field(default=0, ge=0, description="first frame (frame number)")
    count: int = Field(default=1000, ge=1, le=1_000_000, description="frames to make (count)")
    rate_hz: int | None = Field(
        default=None,
        json_schema_extra={"anyOf": [{"enum": list(FRAME_RATES)}, {"type": "null"}]},
        description="frames a second, a part of 1000; 100 by default. Traffic and noise at an instant do not depend on "
        "it [Hz]",
    )

    @property
    def stop(self) -> int:
        """One past the last frame."""
        return self.start + self.count

    @field_validator("rate_hz", mode="before")
    @classmethod
    def _whole_milliseconds(cls, value: Any) -> Any:
        is_number = isinstance(value, int | float) and not isinstance(value, bool)
        return check_frame_rate(value) if is_number else value

    @model_serializer(mode="wrap")
    def _without_default(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out a rate that is not given, so that configurations of before there were rates keep their hash."""
        return without_empty(handler(self), "rate_hz")


class TrafficConfig(Section):
    """The moving vehicles of a scenario, and which of them are connected."""

    engine: str = Field(
        default="idm",
        json_schema_extra=lambda schema: schema.update(enum=list(ENGINES)),
        description="idm: mmw's own engine; sumo: SUMO, needs the extra sumo; replay: a table of trajectories (token)",
    )
    vehicle_count: int = Field(default=20, ge=1, le=500, description="vehicles in the scenario, CAVs included (count)")
    spawn_center_m: Vec3 = Field(description="x_spawn: vehicles take the spawn points nearest to it, world frame [m]")
    cav_ranks: tuple[int, ...] = Field(
        default=(5, 6, 12),
        description="r: zero-based ranks, by distance to `spawn_center_m`, of the vehicles that become CAVs (rank)",
    )
    cav_pool: int | None = Field(
        default=None,
        ge=1,
        description="as many CAVs as `cav_ranks` names, drawn by `seed` from this many vehicles nearest to "
        "`spawn_center_m`; without it each seed has those of `cav_ranks`; engines idm and sumo (count)",
    )
    cav_models: tuple[str | None, ...] = Field(
        default=(),
        description="vehicle model of each CAV, `cav_1` first, such as `city_bus`; drawn by `seed` where it is null or "
        "left out; engines idm and sumo (names)",
    )
    models: tuple[str, ...] = Field(
        default=(),
        description="vehicle models that drive, such as `sedan`; all if empty; `cav_models` are some of them (names)",
    )
    warmup_s: float = Field(
        default=1.0, ge=1.0, le=60, description="simulated before frame 0; engines idm and sumo [s]"
    )
    lane_changes: bool = Field(default=True, description="whether vehicles change lanes; engines idm and sumo (flag)")
    signals: bool = Field(
        default=False, description="whether traffic lights work; the paper's traffic ignores them; engine idm (flag)"
    )
    driving_weather: Name | None = Field(
        default=None,
        description="weather, one of `weathers` or a preset, in which drivers are slower and keep more distance; every "
        "weather of the dataset shows this drive; engines idm and sumo (name)",
    )
    pedestrian_count: int = Field(default=0, ge=0, le=500, description="people walking on the sidewalks (count)")
    vru_ranks: tuple[int, ...] = Field(
        default=(),
        description="zero-based ranks, by distance to `spawn_center_m`, of the pedestrians that become connected VRUs, "
        "`vru_1` first (rank)",
    )
    cyclist_count: int = Field(
        default=0, ge=0, le=200, description="cyclists at the edge of the road, around the blocks (count)"
    )
    vru_cyclist_ranks: tuple[int, ...] = Field(
        default=(),
        description="zero-based ranks, by distance to `spawn_center_m`, of the cyclists that become connected VRUs, "
        "numbered after those of `vru_ranks` (rank)",
    )
    trajectories: InputPath | None = Field(
        default=None, description="engine replay: Parquet, CSV, SUMO FCD or CommonRoad file of who is where when (path)"
    )
    cav_ids: tuple[str, ...] = Field(
        default=(), description="engine replay: ids of the vehicles that become CAVs; by `cav_ranks` if empty (names)"
    )

    options: dict[str, Any] = Field(
        default_factory=dict, description="keys of an engine of another package, which checks them (map)"
    )

    @model_serializer(mode="wrap")
    def _without_new_keys(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out keys that are not used, so that configurations of before there were such keep their hash."""
        return without_empty(
            handler(self), "vru_ranks", "cyclist_count", "vru_cyclist_ranks", "driving_weather", "models"
        )

    @property
    def cav_count(self) -> int:
        """Number of connected vehicles."""
        return len(self.cav_ids or self.cav_ranks)

    @property
    def vru_count(self) -> int:
        """Number of connected vulnerable road users."""
        return len(self.vru_ranks) + len(self.vru_cyclist_ranks)

    @model_validator(mode="after")
    def _engine_fits(self) -> "TrafficConfig":
        spec = engine_spec(self.engine)
        fields = type(self).model_fields
        for key in ENGINE_KEYS:
            is_default = getattr(self, key) == fields[key].get_default(call_default_factory=True)
            if key in spec.required and is_default:
                raise InputError(f"engine = {self.engine!r} needs `{key}` ({fields[key].description}); give it")
            if key not in spec.keys and not is_default:
                users = " or ".join(name for name, other in ENGINES.items() if key in other.keys)
                users = users or "of a package that is not installed"
                raise InputError(
                    f"`{key}` goes with engine: {users}; engine is {self.engine!r}; remove it, or change engine"
                )
        if len(set(self.cav_ids)) != len(self.cav_ids):
            raise InputError(f"cav_ids = {list(self.cav_ids)} names a vehicle twice; give each id once")
        return self

    @model_validator(mode="after")
    def _ranks_exist(self) -> "TrafficConfig":
        _check_ranks("vru_ranks", self.vru_ranks, "pedestrian", self.pedestrian_count)
        _check_ranks("vru_cyclist_ranks", self.vru_cyclist_ranks, "cyclist", self.cyclist_count)
        if self.cav_ids:  # they set the connected ones
            return self
        _check_ranks("cav_ranks", self.cav_ranks, "vehicle", self.vehicle_count)
        if len(self.cav_models) > len(self.cav_ranks):
            raise InputError(
                f"cav_models names {len(self.cav_models)} models for {len(self.cav_ranks)} CAVs; give at most one each"
            )
        if self.cav_pool is not None and not len(self.cav_ranks) <= self.cav_pool <= self.vehicle_count:
            raise InputError(
                f"cav_pool = {self.cav_pool}: {len(self.cav_ranks)} CAVs are drawn from it, and there are "
                f"{self.vehicle_count} vehicles; choose a number from {len(self.cav_ranks)} to {self.vehicle_count}"
            )
        return self


def _check_ranks(key: str, ranks: tuple[int, ...], what: str, count: int) -> None:
    for rank in ranks:
        if not 0 <= rank < count:
            raise InputError(f"{key} holds {rank}; ranks count from 0 to {what}_count - 1 = {count - 1}")
    if len(set(ranks)) != len(ranks):
        raise InputError(f"{key} = {list(ranks)} names a {what} twice; give each rank once")


class ScenarioConfig(Section):
    """One scenario: either a shipped town with generated traffic, or an animated USD stage of the user's own."""

    name: Name = Field(description="the `scenario` key of every row (name)")
    town: Annotated[PathText, InputFile(TOWN_SUFFIXES)] | None = Field(
        default=None, description="a shipped town, such as `town03`, or the path of a town asset (name or path)"
    )
    stage: InputPath | None = Field(
        default=None, description="an animated USD stage to trace as it is, instead of `town` and `traffic` (path)"
    )
    traffic: TrafficConfig | None = Field(default=None, description="moving vehicles; needed with `town` (section)")
    rsus: tuple[RsuConfig, ...] = Field(default=(), description="roadside units (list)")
    base_stations: tuple[BaseStationConfig, ...] = Field(default=(), description="base stations (list)")
    uavs: tuple[UavConfig, ...] = Field(default=(), description="drones; with `town` (list)")
    frames: FramesConfig | None = Field(
        default=None,
        description="frames of this scenario; `frames` of the configuration wins; 1000 without either (section)",
    )
    actor_roles: dict[str, Literal["cav", "vehicle", "rsu", "pedestrian", "vru", "uav", "bs"]] = Field(
        default_factory=dict,
        description="with `stage`: prim path -> role, where the stage has no `mmw:actor:role` (map)",
    )
    materials: dict[str, MaterialEntry] = Field(
        default_factory=dict,
        description="`materials` of this scenario, before those of the configuration; the first pattern that matches a "
        "mesh counts (map)",
    )
    description: str = Field(default="", description="what is there, for people (text)")

    @model_validator(mode="after")
    def _one_world(self) -> "ScenarioConfig":
        if (self.town is None) == (self.stage is None):
            raise InputError("give exactly one of `town` and `stage`")
        if self.town is not None and self.traffic is None:
            raise InputError("`town` needs `traffic` (vehicle_count, spawn_center_m, cav_ranks)")
        if self.stage is not None and self.traffic is not None:
            raise InputError("`stage` brings its own motion; remove `traffic`")
        for key, example in (("rsus", "rsu_1"), ("base_stations", "bs_1"), ("uavs", "uav_1")):
            names = [agent.name for agent in getattr(self, key)]
            if len(set(names)) != len(names):
                raise InputError(f"{key} = {names} names a unit twice; give each its own name")
            taken = [name for name in names if re.fullmatch(self._generated_names, name)]
            if taken and self.town is not None:
                raise InputError(f"{key} holds {taken[0]!r}, a name of generated traffic; rename it, such as {example}")
        shared = [name for name, count in Counter(self.placed_names).items() if count > 1]
        if shared:
            raise InputError(f"{shared[0]!r} is in two of rsus, base_stations and uavs; agents need names of their own")
        if self.stage is not None and self.uavs:
            raise InputError("`uavs` goes with `town`; a drone of a `stage` is an actor of it; give it the role uav")
        if self.town is not None and self.actor_roles:
            raise InputError("`actor_roles` goes with `stage`; vehicles of generated traffic have roles; remove it")
        return self

    @model_serializer(mode="wrap")
    def _without_new_keys(self, handler: SerializerFunctionWrapHandler) -> dict[str, Any]:
        """Leave out keys that are not used, so that configurations of before there were such keep their hash."""
        return without_empty(handler(self), "base_stations", "uavs")

    @property
    def placed_names(self) -> tuple[str, ...]:
        """Names of the agents that the scenario places itself."""
        return tuple(agent.name for agent in (*self.rsus, *self.base_stations, *self.uavs))

    @property
    def has_units(self) -> bool:
        """Whether it places agents that stand."""
        return bool(self.rsus or self.base_stations)

    @property
    def _generated_names(self) -> str:
        """Pattern of the names that generated traffic gives."""
        kinds = ["cav", "veh"]
        if self.traffic is not None:
            kinds += ["vru"] * bool(self.traffic.vru_count) + ["cyc"] * bool(self.traffic.cyclist_count)
        return rf"({'|'.join(kinds)})_\d+"
