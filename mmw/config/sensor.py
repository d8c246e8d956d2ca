"""Common section of all sensors: a name, the agents that carry it, and its mount on them."""

from typing import Any, Literal

from pydantic import Field, field_validator

from mmw.config.agent_keys import ROLE_MOUNTS, AgentIdentity, AgentKey, Body
from mmw.config.sampling import Sampling
from mmw.config.section import Name, Section, Vec3
from mmw.core.errors import InputError

MAX_OFFSET_M = 1000.0
"""Largest offset of a sensor from its agent along an axis [m]. Design value."""


AXIS_OF_SIDE = {"front": 0, "rear": 0, "left": 1, "right": 1, "roof": 2}
"""Side of a body -> axis along which it is."""

LARGE_VEHICLES = ("label:bus", "label:truck")
"""Keys of vehicles whose bodies are around the place where a CAV has a sensor by default."""

ROOF_CLEARANCE_M, SIDE_CLEARANCE_M = 1.05, 0.25
"""How far above the roof and off the sides of a large vehicle a sensor is by default [m]. Design values: those of the
shipped sedan, 1.45 m high, with a LiDAR at 2.5 m, and 2.27 m to its front, with a radar at 2.5 m."""


class MountConfig(Section):
    """Mount of a sensor on its agent: x forward, y left, z up from the agent's origin on the ground."""

    position_m: Vec3 = Field(
        default=(0.0, 0.0, 0.0),
        description="offset in the agent's frame, x forward, y left, z up, at most 1000 each [m]",
    )
    relative_to: Literal["origin", "roof", "front", "rear", "left", "right"] = Field(
        default="origin",
        description="where one part of `position_m` counts from, the others from the origin: z from the agent's "
        "`roof`, x from its `front` or `rear`, y from its `left` or `right` side (name)",
    )
    yaw_deg: float = Field(
        default=0.0, ge=-360, le=360, description="turn about z, counter-clockwise seen from above [deg]"
    )
    pitch_deg: float = Field(default=0.0, ge=-90, le=90, description="turn about y after yaw, nose down positive [deg]")
    roll_deg: float = Field(default=0.0, ge=-180, le=180, description="turn about x after pitch [deg]")

    @field_validator("position_m")
    @classmethod
    def _near(cls, value: Vec3) -> Vec3:
        if any(abs(part) > MAX_OFFSET_M for part in value):
            raise InputError(
                f"{list(value)} is more than {MAX_OFFSET_M:g} m from the agent; meters are needed; lower it"
            )
        return value

    def on_body(self, body: Body | None) -> "MountConfig":
        """Return the mount with its place from the origin of an agent, whose body is given.

        Raises:
            InputError: If it counts from a body and there is none.
        """
        if self.relative_to == "origin":
            return self
        if body is None:
            raise InputError(f"relative_to = {self.relative_to} needs an agent with a body; use relative_to: origin")
        place = list(self.position_m)
        place[AXIS_OF_SIDE[self.relative_to]] += getattr(body, self.relative_to)
        return self.model_copy(update={"position_m": tuple(place), "relative_to": "origin"})


ON_ROOF = MountConfig(position_m=(0.0, 0.0, ROOF_CLEARANCE_M), relative_to="roof")
"""Mount of LiDARs and antennas on large vehicles."""


def at_side(side: Literal["front", "rear", "left", "right"], height_m: float) -> MountConfig:
    """Return the mount of a sensor at a side of large vehicles, where it looks to, so high above the ground [m]."""
    x, y, yaw_deg = {"front": (1, 0, 0), "rear": (-1, 0, 180), "left": (0, 1, 90), "right": (0, -1, -90)}[side]
    place = (x * SIDE_CLEARANCE_M, y * SIDE_CLEARANCE_M, height_m)
    return MountConfig(position_m=place, relative_to=side, yaw_deg=yaw_deg)


def mounts_at(large: MountConfig | None = None, **position_m: Vec3) -> Any:
    """Return the field `mount` of a kind of sensor.

    Args:
        large: Its mount on large vehicles by default; that of all CAVs where it is left out.
        position_m: Role -> place of the sensor by default [m].
    """
    vehicles = dict.fromkeys(LARGE_VEHICLES, large) if large is not None else {}
    return Field(
        default_factory=lambda: {role: MountConfig(position_m=at) for role, at in position_m.items()} | vehicles,
        description="mount by name of an agent, `model:` or `label:` and its model or class, or role, the first of "
        "these; a role that is left out keeps its default, which is (0.2, 0, 1.2) for vru, (0, 0, -0.15) for uav and "
        "(0, 0, 3) for bs; buses and trucks keep theirs where `cav` is left out (map)",
    )


class Mounted(Section):
    """A section of what agents carry: which agents, and where on them."""

    on: tuple[AgentKey, ...] = Field(
        description="agents that carry it: roles `cav`, `rsu`, `vru`, `uav`, `bs`, names, or `model:` or `label:` and "
        "a model or class (list)"
    )
    mount: dict[AgentKey, MountConfig] = mounts_at()

    @field_validator("on")
    @classmethod
    def _once(cls, value: tuple[AgentKey, ...]) -> tuple[AgentKey, ...]:
        if len(set(value)) != len(value):
            raise InputError(f"{list(value)} names one twice; name each once")
        return value

    @field_validator("mount")
    @classmethod
    def _every_role(cls, value: dict[AgentKey, MountConfig]) -> dict[AgentKey, MountConfig]:
        own = cls.model_fields["mount"].get_default(call_default_factory=True)
        kept = {key: mount for key, mount in own.items() if "cav" not in value or key not in LARGE_VEHICLES}
        return {**kept, **value}

    def is_on(self, role: str, name: str, model: str = "", label: str = "", body: Body | None = None) -> bool:
        """Return whether an agent carries it, by its name, model, class or role."""
        return any(key in self.on for key in AgentIdentity(role, name, model, label, body).keys)

    def mount_on(self, role: str, name: str, model: str = "", label: str = "", body: Body | None = None) -> MountConfig:
        """Return the mount on an actor: by its name, else its model, its class, its role; else the place of the role.

        The origin of a CAV or a roadside unit where there is no mount. A vehicle or a pedestrian that is no agent
        carries it where a CAV does. The place counts from the actor's origin, whatever `relative_to` says.

        Raises:
            InputError: If the mount counts from a body and the actor has none.
        """
        role = "cav" if role in ("vehicle", "pedestrian") else role
        keys = AgentIdentity(role, name, model, label).keys
        key = next((key for key in keys if key in self.mount), None)
        if key is None:
            return MountConfig(position_m=ROLE_MOUNTS[role]) if role in ("vru", "uav", "bs") else MountConfig()
        try:
            return self.mount[key].on_body(body)
        except InputError as error:
            raise InputError(f"{name}: mount.{key}: {error}") from None


class SensorConfig(Sampling, Mounted):
    """One sensor of an agent: the base of every sensor's section."""

    type: str
    name: Name = Field(description="unique among the sensors; the `sensor` or `camera` key of its rows (name)")

    @property
    def late_frames(self) -> int:
        """Frames by which a reading is late: derivatives of so many frames before its own are read."""
        return 0
