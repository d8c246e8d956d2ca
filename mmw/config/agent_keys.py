"""Choose agents: by their names, models, classes or roles."""

from collections.abc import Iterable, Mapping, Sequence
from difflib import get_close_matches
from typing import Annotated, NamedTuple

from pydantic import Field

from mmw.core.errors import InputError

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

AgentKey = Annotated[str, Field(pattern=r"^((model|label):)?[A-Za-z][A-Za-z0-9_]*$", max_length=70)]
"""A role, the name of an agent, such as `cav_2`, or `model:` or `label:` with the vehicle model or semantic class of an
agent, as in `label:bus`."""

MODEL, LABEL = "model:", "label:"
"""Prefixes of keys that go by the model and the semantic class of an agent."""


class Body(NamedTuple):
    """Sides of the body of an agent, in the agent's frame: mounts can start from there."""

    front: float
    """x of its foremost point [m]."""
    rear: float
    """x of its rearmost point [m]."""
    left: float
    """y of its left side [m]."""
    right: float
    """y of its right side [m]."""
    roof: float
    """z of its highest point [m]."""

    @classmethod
    def of_box(cls, size: Sequence[float], center: Sequence[float]) -> "Body | None":
        """Return the body in a box of a length, a width and a height around a middle [m]; None for a box of no size."""
        x, y, z = (0.5 * length for length in size)
        own = cls(center[0] + x, center[0] - x, center[1] + y, center[1] - y, center[2] + z)
        return own if any(size) else None


class AgentIdentity(NamedTuple):
    """Role, name, model and class of an actor: each can choose it. And its body."""

    role: str
    name: str
    model: str = ""
    """Vehicle model, such as `city_bus`; empty if it is not known."""
    label: str = ""
    """Semantic class, such as `bus`; empty if it is not known."""
    body: Body | None = None
    """None if it has none, or if it is not known."""

    @property
    def keys(self) -> tuple[str, ...]:
        """Keys that choose the agent, the most specific first: name, model, class, role."""
        kinds = (MODEL + self.model, LABEL + self.label) if self.role in AGENT_ROLES else ()
        return (self.name, *kinds, self.role)


def check_agent(where: str, key: str, agents: Iterable[str]) -> None:
    """Check that a key is a role or the name of an agent; models and classes are known with their stages only.

    Args:
        where: Place in the configuration, for the message.
        key: The key.
        agents: Names of the agents of all scenarios.

    Raises:
        InputError: If it is neither.
    """
    known = (*AGENT_ROLES, *agents)
    if key not in known and not key.startswith((MODEL, LABEL)):
        near = get_close_matches(key, known, n=1)
        cure = f"did you mean `{near[0]}`?" if near else f"there are {', '.join(known)}"
        raise InputError(f"{where} names {key!r}, which is no role and no agent; {cure}")
