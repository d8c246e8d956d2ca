"""`channel.links`: rules that say which antennas have a radio link, by roles or names of agents."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

from pydantic import Field, field_validator

from mmw.config.agent_keys import AgentIdentity, AgentKey
from mmw.config.antennas import AntennaConfig
from mmw.config.section import Name, Section
from mmw.core.errors import InputError

LinkName = Literal["v2i", "v2v", "v2p", "v2n", "i2i", "i2p", "d2d", "a2g"]
"""Rules that need no definition. Source of V2V, V2I, V2P and V2N: 3GPP TS 22.185, section 3.1."""


class LinkRule(Section):
    """A kind of link: from each antenna of the transmitting agents to each antenna of the receiving ones.

    An agent has no link to itself.
    """

    name: Name = Field(description="key `link` of the rows (name)")
    tx: tuple[AgentKey, ...] = Field(
        min_length=1,
        description="agents that transmit, as `on` of sensors (list)",
    )
    rx: tuple[AgentKey, ...] = Field(
        min_length=1,
        description="agents that receive, as `on` of sensors (list)",
    )
    tx_antennas: tuple[Name, ...] = Field(
        default=(), description="antennas that transmit, of `channel.antennas`; all of the agent by default (list)"
    )
    rx_antennas: tuple[Name, ...] = Field(
        default=(), description="antennas that receive, of `channel.antennas`; all of the agent by default (list)"
    )

    @field_validator("name")
    @classmethod
    def _not_built_in(cls, value: str) -> str:
        if value in LINK_RULES:
            raise InputError(f"{value!r} is a rule that exists; write it without a definition, or choose another name")
        return value


def _built_in(name: str, tx: tuple[str, ...], rx: tuple[str, ...]) -> LinkRule:
    return LinkRule.model_construct(name=name, tx=tx, rx=rx, tx_antennas=(), rx_antennas=())


LINK_RULES = {
    rule.name: rule
    for rule in (
        _built_in("v2i", ("rsu",), ("cav",)),
        _built_in("v2v", ("cav",), ("cav",)),
        _built_in("v2p", ("cav",), ("vru",)),
        _built_in("v2n", ("bs",), ("cav",)),
        _built_in("i2i", ("rsu",), ("rsu",)),
        _built_in("i2p", ("rsu",), ("vru",)),
        _built_in("d2d", ("vru",), ("vru",)),
        _built_in("a2g", ("rsu", "bs"), ("uav",)),
    )
}
"""Name -> rule of the built-in ones; v2i, v2n, i2p and a2g are downlinks."""


class LinkEnds(NamedTuple):
    """One link of agents, the same in every frame."""

    kind: int
    """Number of its rule in `ChannelConfig.link_rules`."""
    tx: int
    """Number of the transmitting agent."""
    rx: int
    tx_antenna: int
    """Number of its antenna in `ChannelConfig.antennas`."""
    rx_antenna: int


def link_ends(
    rules: Sequence[LinkRule], antennas: Sequence[AntennaConfig], agents: Sequence[AgentIdentity]
) -> list[LinkEnds]:
    """Return the links of agents, rule by rule; of several rules that fit, a link is of the first.

    Args:
        rules: The rules.
        antennas: The antennas.
        agents: Role, name, model and class of each actor; those that are no agents have no antenna.
    """
    found: dict[tuple[int, int, int, int], LinkEnds] = {}
    for kind, rule in enumerate(rules):
        senders = _ends(rule.tx, rule.tx_antennas, antennas, agents)
        receivers = _ends(rule.rx, rule.rx_antennas, antennas, agents)
        for tx, tx_antenna in senders:
            for rx, rx_antenna in receivers:
                if tx != rx:
                    ends = LinkEnds(kind, tx, rx, tx_antenna, rx_antenna)
                    found.setdefault(ends[1:], ends)
    return list(found.values())


def _ends(
    keys: Sequence[str], names: Sequence[str], antennas: Sequence[AntennaConfig], agents: Sequence[AgentIdentity]
) -> list[tuple[int, int]]:
    """Return agent and antenna of each end that a rule names."""
    return [
        (agent, number)
        for agent, identity in enumerate(agents)
        if any(key in keys for key in identity.keys)
        for number, antenna in enumerate(antennas)
        if antenna.is_on(*identity) and (not names or antenna.name in names)
    ]
