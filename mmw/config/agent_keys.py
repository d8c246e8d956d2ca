"""Choose what an agent has: by its own name, or by its role."""

from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from typing import TypeVar

from mmw.config.section import PrimName
from mmw.core.errors import InputError

Value = TypeVar("Value")

AGENT_ROLES = ("cav", "rsu")
"""Roles of agents: connected vehicles and roadside units."""

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
