"""Agents that a configuration places itself: roadside units, base stations, drones."""

from itertools import pairwise
from typing import Literal

import numpy as np
from pydantic import Field, model_validator

from mmw.config.section import PrimName, Section, Vec3
from mmw.core.errors import InputError
from mmw.core.minimum_snap import minimum_snap

MAX_UAV_SPEED = 19.0
"""Largest speed of a drone by default [m/s]. Source: Commission Delegated Regulation (EU) 2019/945, annex, parts 1 and
2, classes C0 and C1."""

SPEED_SAMPLES = 64
"""Instants of each leg at which its speed is compared with the limit. Design value."""


class RsuConfig(Section):
    """One roadside unit: a fixed agent with sensors and a transmitter."""

    name: PrimName = Field(default="rsu_1", description="agent name of the unit; the `agent` key of its rows (name)")
    position_m: Vec3 = Field(
        default=(0.0, 0.0, 0.0),
        description="foot of the unit in the world frame, x east, y north, z up; with `lat_lon`, from that place and "
        "z = 0; one of both is needed [m]",
    )
    lat_lon: tuple[float, float] | None = Field(
        default=None,
        description="latitude and longitude of the unit, in a town with a geographic origin; none by default [deg]",
    )
    yaw_deg: float = Field(
        default=0.0, ge=-360, le=360, description="heading of the unit, counter-clockwise from east [deg]"
    )

    @model_validator(mode="after")
    def _has_a_place(self) -> "RsuConfig":
        if self.lat_lon is None and "position_m" not in self.model_fields_set:
            raise InputError(
                f"{self.name!r} has no place; give position_m: [x, y, z] or lat_lon: [latitude, longitude]"
            )
        if self.lat_lon is not None and not (abs(self.lat_lon[0]) <= 90 and abs(self.lat_lon[1]) <= 180):
            raise InputError(
                f"{self.name!r}: lat_lon = {list(self.lat_lon)}; latitude -90 to 90 and longitude -180 to 180 are "
                "needed; latitude comes first"
            )
        return self


class BaseStationConfig(RsuConfig):
    """One base station: a fixed agent on a roof or a tower."""

    name: PrimName = Field(default="bs_1", description="agent name of the station; the `agent` key of its rows (name)")
    position_m: Vec3 = Field(
        default=(0.0, 0.0, 0.0),
        description="foot of the mast, x east, y north, z up from where `height_from` says; with `lat_lon`, from that "
        "place; one of both is needed [m]",
    )
    height_from: Literal["world", "roof"] = Field(
        default="world",
        description="what z of `position_m` counts from: the world's zero, or the highest roof at (x, y) (token)",
    )


class WaypointConfig(Section):
    """A place that a drone passes at a time."""

    time_s: float = Field(ge=0.0, description="time after frame 0 [s]")
    position_m: Vec3 = Field(description="middle of the drone, world frame [m]")
    yaw_deg: float | None = Field(
        default=None,
        ge=-360,
        le=360,
        description="heading, counter-clockwise from east; toward the next waypoint if it is not given [deg]",
    )


class UavConfig(Section):
    """One drone: it hovers at a place, or flies through waypoints, at rest before the first and after the last."""

    name: PrimName = Field(default="uav_1", description="agent name of the drone; the `agent` key of its rows (name)")
    position_m: Vec3 | None = Field(
        default=None, description="middle of a drone that hovers, in place of `waypoints`, world frame [m]"
    )
    yaw_deg: float = Field(
        default=0.0, ge=-360, le=360, description="heading of a drone that hovers, counter-clockwise from east [deg]"
    )
    waypoints: tuple[WaypointConfig, ...] = Field(
        default=(), description="places and times of a drone that flies, two or more, in order (list)"
    )
    max_speed_mps: float = Field(
        default=MAX_UAV_SPEED, gt=0.0, le=100.0, description="a path that is faster anywhere is an error [m/s]"
    )

    @property
    def times_s(self) -> np.ndarray:
        """Times of the waypoints [s], shape [N]."""
        return np.array([point.time_s for point in self.waypoints])

    @property
    def points_m(self) -> np.ndarray:
        """Places of the waypoints, world frame [m], shape [N, 3]."""
        return np.array([point.position_m for point in self.waypoints])

    @model_validator(mode="after")
    def _can_fly(self) -> "UavConfig":
        if (self.position_m is None) == (not self.waypoints):
            raise InputError(f"{self.name}: give exactly one of `position_m` and `waypoints`")
        if self.position_m is not None:
            return self
        if self.yaw_deg:
            raise InputError(f"{self.name}: `yaw_deg` goes with `position_m`; give it for each of `waypoints`")
        times = self.times_s
        if len(times) < 2 or not (np.diff(times) > 0.0).all():
            raise InputError(
                f"{self.name}: waypoints have time_s = {times.tolist()}; two or more, growing, are needed; sort them"
            )
        for leg, (start, end) in enumerate(pairwise(times.tolist())):
            _, velocity, _ = minimum_snap(times, self.points_m, np.linspace(start, end, SPEED_SAMPLES))
            speed = float(np.linalg.norm(velocity, axis=1).max())
            if speed > self.max_speed_mps:
                raise InputError(
                    f"{self.name}: the leg from waypoint {leg + 1} at {start:g} s to waypoint {leg + 2} at {end:g} s "
                    f"needs {speed:.1f} m/s; at most max_speed_mps = {self.max_speed_mps:g} is allowed; give it more "
                    "time"
                )
        return self
