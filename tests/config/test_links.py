"""Rules of links and lists of antennas: what they mean, and what is refused."""

from typing import Any

import pytest

from mmw.config import ChannelConfig, Config, LinkRule
from mmw.config.agent_keys import AGENT_ROLES, AgentIdentity
from mmw.config.links import LINK_RULES
from mmw.core.errors import InputError
from tests.fixtures.antennas import antenna_at

EVERYBODY = [
    AgentIdentity(role, f"{role}_{number}") for role in (*AGENT_ROLES, "vehicle", "pedestrian") for number in (1, 2)
]


@pytest.mark.parametrize("name", LINK_RULES)
def test_built_in_rules_link_all_agents_of_their_roles(name: str) -> None:
    channel = ChannelConfig(links=(name,))
    found = {(EVERYBODY[end.tx][0], EVERYBODY[end.rx][0]) for end in channel.link_ends(EVERYBODY)}
    rule = LINK_RULES[name]
    assert found == {(tx, rx) for tx in rule.tx for rx in rule.rx}
    pairs = {(end.tx, end.rx) for end in channel.link_ends(EVERYBODY)}
    assert len(pairs) == sum(2 if tx == rx else 4 for tx, rx in found) and all(tx != rx for tx, rx in pairs)


def test_antennas_go_by_name_or_role() -> None:
    antennas = (*antenna_at(name="all"), *antenna_at(name="one", on=("cav_2", "bs")))
    ends = ChannelConfig(links=("v2v", "v2n"), antennas=antennas).link_ends(EVERYBODY)
    assert [end[3:] for end in ends if end.kind == 0] == [(0, 0), (0, 1), (0, 0), (1, 0)]
    assert len(ends) == 4 + 2 * 2 * 3  # each of two base stations has two antennas, and the CAVs three


@pytest.mark.parametrize(
    ("channel", "message"),
    [
        ({"links": ["v2x"]}, "v2x"),
        ({"links": ["v2i", "v2i"]}, "links are named v2i, v2i; give each its own name"),
        ({"links": [{"name": "v2v", "tx": ["rsu"], "rx": ["cav"]}]}, "'v2v' is a rule that exists"),
        ({"links": [{"name": "up", "tx": [], "rx": ["rsu"]}]}, "tx"),
        ({"links": [{"name": "up", "tx": ["cav"], "rx": ["rsu"], "rx_antennas": ["panel"]}]},
         "rule 'up' names antenna 'panel'; there are antenna"),
        ({"antennas": []}, "antennas is an empty list"),
        ({"antennas": [{"name": "a"}, {"name": "a"}]}, "antennas are named a, a; give each its own name"),
        ({"antennas": [{"pattern": "horn"}]}, "pattern"),
        ({"antennas": [{"num_cols": 0}]}, "num_cols"),
        ({"antennas": [{"mount": {"rsu": {"pitch_deg": 95}}}]}, "pitch_deg"),
        ({"antennas": [{"name": "lidar"}]}, "needs a name of its own"),
    ],
)  # fmt: skip
def test_what_is_refused(channel: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        Config(scenarios=[{"name": "s", "stage": "s.usda"}], sensors=[{"type": "lidar"}], channel=channel)


def test_a_file_keeps_names_and_definitions() -> None:
    rule = LinkRule(name="up", tx=("cav",), rx=("rsu",))
    channel = ChannelConfig(links=("v2i", rule))
    assert channel.link_names == ("v2i", "up")
    assert ChannelConfig.model_validate_json(channel.model_dump_json()) == channel
