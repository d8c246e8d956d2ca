"""Names of logged entities, a tree as in `docs/guides/viewer.md`. Parts are escaped, so any agent name will do."""

import rerun as rr

from mmw.viz.plots.style import carrier_name

WORLD = "world"
"""Everything with a place; right-handed, z up, meters."""
TOWN = "world/town"
"""The static town, one mesh a material."""
BOXES = "world/boxes"
"""Boxes of all vehicles and people."""
PATHS = "world/paths"
"""Radio paths."""

SERIES = ("gain", "beam_gain", "los", "tx_beam", "rx_beam")
"""Time series of links, each the root of its own tree."""


def agent_entity(agent: str) -> str:
    """Return the entity of an agent; its transform is agent to world."""
    return rr.new_entity_path([WORLD, "agents", agent]).lstrip("/")


def sensor_entity(agent: str, sensor: str) -> str:
    """Return the entity of a sensor; its transform is sensor to agent."""
    return rr.new_entity_path([WORLD, "agents", agent, sensor]).lstrip("/")


def paths_entity(carrier_hz: float, agent: str = "", peer: str = "") -> str:
    """Return the entity of the paths of a link (receiver, transmitter), or without agents of a carrier's links."""
    return _under(PATHS, carrier_hz, agent, peer)


def series_entity(series: str, carrier_hz: float, agent: str, peer: str) -> str:
    """Return the entity of a time series of a link, see `SERIES`."""
    return _under(series, carrier_hz, agent, peer)


def reading_entity(sensor: str, column: str, agent: str = "") -> str:
    """Return the entity of a number of a scalar sensor over time, or without an agent the root of those of all."""
    return rr.new_entity_path(["readings", sensor, column, *([agent] if agent else [])]).lstrip("/")


def _under(root: str, carrier_hz: float, agent: str, peer: str) -> str:
    link = [f"{agent} from {peer}"] if agent else []
    return rr.new_entity_path([*root.split("/"), carrier_name(carrier_hz).replace(" ", ""), *link]).lstrip("/")
