"""Common section of all sensors: a name, the agents that carry it, and its mount on them."""

from typing import Any

from pydantic import Field, field_validator

from mmw.config.agent_keys import ROLE_MOUNTS, AgentIdentity, AgentKey
from mmw.config.sampling import Sampling
from mmw.config.section import Name, Section, Vec3
from mmw.core.errors import InputError

MAX_OFFSET_M = 1000.0
"""Largest offset of a sensor from its agent along an axis [m]. Design value."""


class MountConfig(Section):
    """Mount of a sensor on its agent: x forward, y left, z up from the agent's origin on the ground."""

    position_m: Vec3 = Field(
        default=(0.0, 0.0, 0.0),
        description="offset in the agent's frame, x forward, y left, z up, at most 1000 each [m]",
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


def mounts_at(**position_m: Vec3) -> Any:
    """Return the field `mount` of a kind of sensor, with the place of the sensor on each role by default [m]."""
    return Field(
        default_factory=lambda: {role: MountConfig(position_m=place) for role, place in position_m.items()},
        description="mount by name of an agent, `model:` or `label:` and its model or class, or role, the first of "
        "these; a role that is left out keeps its default, which is (0.2, 0, 1.2) for vru, (0, 0, -0.15) for uav and "
        "(0, 0, 3) for bs (map)",
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
        return {**cls.model_fields["mount"].get_default(call_default_factory=True), **value}

    def is_on(self, role: str, name: str, model: str = "", label: str = "") -> bool:
        """Return whether an agent carries it, by its name, model, class or role."""
        return any(key in self.on for key in AgentIdentity(role, name, model, label).keys)

    def mount_on(self, role: str, name: str, model: str = "", label: str = "") -> MountConfig:
        """Return the mount on an actor: by its name, else its model, its class, its role; else the place of the role.

        The origin of a CAV or a roadside unit where there is no mount. A vehicle or a pedestrian that is no agent
        carries it where a CAV does.
        """
        role = "cav" if role in ("vehicle", "pedestrian") else role
        keys = AgentIdentity(role, name, model, label).keys
        found = next((self.mount[key] for key in keys if key in self.mount), None)
        if found is None and role in ("vru", "uav", "bs"):
            return MountConfig(position_m=ROLE_MOUNTS[role])
        return found or MountConfig()


class SensorConfig(Sampling, Mounted):
    """One sensor of an agent: the base of every sensor's section."""

    type: str
    name: Name = Field(description="unique among the sensors; the `sensor` or `camera` key of its rows (name)")
