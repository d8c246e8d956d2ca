"""Choose what an agent has: by its own name, or by its role."""

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from typing import TypeVar

from mmw.config.section import PrimName
from mmw.core.errors import InputError

Value = TypeVar("Value")

AGENT_ROLES = ("cav", "rsu", "vru", "uav", "bs")
"""Roles of agents: connected vehicles, roadside units, connected vulnerable road users, drones and base stations.

Source: V-ITS-S, R-ITS-S and VRU of ETSI EN 302 665 and TS 103 300-2; aerial UE of 3GPP TR 36.777; BS of TR 38.901.
"""

ROLE_MOUNTS: Mapping[str, tuple[float, float, float]] = {
    "cav": (0.0, 0.0, 2.5),
    "rsu": (0.0, 0.0, 4.0),
    "vru": (0.2, 0.0, 1.2),
    "uav": (0.0, 0.0, -0.15),
    "bs": (0.0, 0.0, 3.0),
}
"""Role -> place in the open on an agent, in its frame, x forward, y left, z up [m]: on the roof, on the pole, a phone
held in front of the chest, below the drone, on a mast. Design values."""

AgentKey = PrimName
"""A role, or the name of an agent, such as `cav_2`."""


def of_agent(values: Mapping[str, Value], role: str, name: str, default: Value) -> Value:
    """Return the value of an agent: that of its name, else that of its role."""
    return values.get(name, values.get(role, default))


def check_agents(where: str, keys: Iterable[str], agents: Iterable[str]) -> None:
    """Check that keys are roles or names of agents.

    Args:
        where: Key of the configuration, for the message.
        keys: The keys.
        agents: Names of the agents of all scenarios.

    Raises:
        InputError: If one is neither.
    """
    known = (*AGENT_ROLES, *agents)
    for key in keys:
        if key not in known:
            near = get_close_matches(key, known, n=1)
            cure = f"did you mean `{near[0]}`?" if near else f"there are {', '.join(known)}"
            raise InputError(f"{where} names {key!r}, which is no role and no agent; {cure}")
