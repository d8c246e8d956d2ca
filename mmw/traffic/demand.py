"""Hold what a traffic engine gets and what it returns."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from mmw.config import TrafficConfig, VarySpawnConfig
from mmw.core.errors import InputError
from mmw.traffic.ground_height import Ground
from mmw.traffic.roads.town_asset import Town
from mmw.traffic.vehicle_pose import Shape, make_shape
from mmw.traffic.weather_driving import DriverFactors


@dataclass(frozen=True)
class VehicleTrack:
    """One vehicle, person or drone of a scenario and its pose in every frame."""

    name: str
    role: str
    """`cav`, `vehicle`, `pedestrian`, `vru` or `uav`."""
    model: str
    paint: str
    poses: np.ndarray
    """Body to world (x, y, z, qx, qy, qz, qw) at 100 Hz, shape [F, 7], float64; the body's origin is the ground point
    midway between the axles, or the middle of a drone. NaN in frames in which the vehicle is absent."""
    waits: np.ndarray | None = None
    """Whether it stands with a cause (`mmw.traffic.idm.wait_causes`), shape [F]; None if the engine does not tell."""


@dataclass(frozen=True)
class TrafficDemand:
    """The traffic that a scenario needs."""

    town: Town
    traffic: TrafficConfig
    catalog: Mapping[str, Any]
    """Vehicle models by name, each with `name, label, paints, wheelbase, track, length, width, height, center`."""
    frame_count: int
    """F, frames at 100 Hz; `mmw.traffic.frame_poses` makes those of other rates."""
    seed: int
    """Same seed, same motion."""
    base: Path = Path()
    """Folder that relative paths of `traffic` start from."""
    device: str = "cpu"
    """Warp device of the wheel drops."""
    spawn: VarySpawnConfig | None = None
    """How start positions are drawn by seed; None takes those nearest to `spawn_center_m`."""
    drivers: DriverFactors = field(default_factory=DriverFactors)
    """Factors of the weather on what drivers want."""
    scene_seed: int | None = None
    """Seed of models and paints; None for `seed`."""
    fleet: tuple[tuple[str, str], ...] | None = None
    """Model and paint of `cav_1`, `cav_2`..., `veh_001`...; None draws them."""

    @property
    def seed_of_scene(self) -> int:
        """`scene_seed`, or `seed` without one."""
        return self.seed if self.scene_seed is None else self.scene_seed

    def with_seed(self, seed: int, fleet: tuple[tuple[str, str], ...] | None = None) -> "TrafficDemand":
        """Return the same scenario with other traffic, with given models and paints, or those of its own seed.

        What was computed of town and models is shared.
        """
        if (seed, fleet) == (self.seed, self.fleet):
            return self
        scene_seed = None if fleet is None else self.seed_of_scene
        other = replace(self, seed=seed, scene_seed=scene_seed, fleet=fleet)
        vars(other).update(shapes=self.shapes, ground=self.ground)
        return other

    @cached_property
    def shapes(self) -> list[Shape]:
        """Dimensions of the models that drive, sorted by name.

        Raises:
            InputError: If the configuration names a model that the catalog does not have.
        """
        chosen = self.traffic.models or tuple(self.catalog)
        if unknown := sorted(set(chosen) - set(self.catalog)):
            known = ", ".join(sorted(self.catalog))
            raise InputError(f"models holds {unknown[0]!r}: there are the vehicle models {known}; name some of them")
        return [make_shape(self.catalog[name]) for name in sorted(set(chosen))]

    @cached_property
    def ground(self) -> Ground:
        """The drivable surface on the device."""
        return Ground(self.town.points, self.town.faces, device=self.device)

    @cached_property
    def tried(self) -> dict[tuple[str, str], bool]:
        """Lane, model -> whether the wheels stay on the road, for those that an engine has tried out so far."""
        return {}


@dataclass(frozen=True)
class TrafficResult:
    """The motion of a scenario's vehicles, and the decisions behind it if the engine has any."""

    tracks: list[VehicleTrack]
    """`cav_1`, `cav_2`..., then `veh_001`, `veh_002`..."""
    changes: list[tuple[float, str, str, str]] = field(default_factory=list)
    """Changes of lanes: time of the decision since frame 0 [s], vehicle, lane before, lane after."""
    routes: dict[str, tuple[str, ...]] = field(default_factory=dict)
    """Vehicle -> lanes of its path, those beyond the last frame included."""
    notes: list[str] = field(default_factory=list)
    """Differences from the demand that people should know, such as spawn points that were skipped."""
