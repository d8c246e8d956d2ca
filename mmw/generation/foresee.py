"""Foresee the tables of all scenarios: trace frames of a few, and carry what they have over to the others.

Rows follow from counts that are known of every scenario, such as samples of a sensor, links and vehicles. What a traced
scenario has for each of them, and the bytes of a row, hold for others of its town.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median

from mmw.config import Config, ScenarioConfig
from mmw.config.agent_keys import AGENT_ROLES
from mmw.generation.estimate import AgentCounts, carrier_count, link_count
from mmw.generation.sample_run import (
    CHANNEL,
    FRAMES,
    SAMPLE_PLACES,
    STATIC,
    SampledScenario,
    SampledTable,
    sample_scenario,
)

MAX_SAMPLED = 12
"""Most scenarios of which frames are traced. Design value: scenarios of a town differ by a factor of up to 2.5 in paths
of a link. With `channel.physics: standard` or `full`, the twelve of the sixteen in `configs/full.yaml` that are chosen
have the paths of all within 4 %, four within 21 %; each takes some ten seconds of a CPU."""

FEW_PLACES, ONE_PLACE = (0.25, 0.75), (0.5,)
"""Places of the traced frames where more than two, and more than four scenarios are traced, as shares of their length.
Design values."""

EXTENT: Mapping[str, str] = {
    "poses": "agents", "sensors": "agents", "boxes": "boxes", "box_visibility": "boxes", "boxes_2d": "boxes",
}  # fmt: skip
"""Tables with a row for each agent, or for each actor with a box, of a frame or sample."""


@dataclass(frozen=True)
class ScenarioLoad:
    """Hold the counts of a scenario that are known before it is traced."""

    scenario: ScenarioConfig
    samples: Mapping[str, float]
    """Sensor, `CHANNEL`, `FRAMES` or `STATIC` -> samples, links or frames of the whole scenario."""
    extents: Mapping[str, int]
    """Agents, and boxes of actors."""
    shards: int

    @property
    def place(self) -> str | None:
        """Town or stage."""
        return self.scenario.town or self.scenario.stage

    def expected(self, table: str, source: str) -> float:
        """Return a number that the rows of a table from a source are proportional to."""
        count = self.samples.get(source, self.samples[FRAMES])
        return count * self.extents.get(EXTENT.get(table, ""), 1)


def foresee(config: Config, base: Path, device: str, counts: AgentCounts) -> list[SampledScenario]:
    """Return the tables of every scenario, from traced frames of up to `MAX_SAMPLED` of them.

    Args:
        config: The configuration.
        base: Folder that relative paths start from.
        device: Warp device.
        counts: Agents of each scenario, see `mmw.generation.estimate.count_agents`.

    Raises:
        InputError: If one of these scenarios cannot be prepared, read or traced.
    """
    loads = [scenario_load(config, scenario, counts[scenario.name]) for scenario in config.scenarios]
    chosen = choose_scenarios(loads, MAX_SAMPLED)
    places = SAMPLE_PLACES if len(chosen) < 3 else FEW_PLACES if len(chosen) < 5 else ONE_PLACE
    traced = {index: sample_scenario(config, loads[index].scenario, base, device, places) for index in sorted(chosen)}
    known = [(loads[index], sample) for index, sample in traced.items()]
    return [traced[index] if index in traced else infer_scenario(load, known) for index, load in enumerate(loads)]


def scenario_load(config: Config, scenario: ScenarioConfig, counts: Mapping[str, int]) -> ScenarioLoad:
    """Return what is known of a scenario with so many agents."""
    frames, rate_hz = config.frames_of(scenario), config.frame_rate_of(scenario)
    every = range(frames.start, frames.stop)
    samples = {FRAMES: float(frames.count), STATIC: 1.0}
    for sensor in config.sensors:
        samples[sensor.name] = carrier_count(sensor, counts, scenario) * float(sensor.is_due(every, rate_hz).sum())
    if config.channel.enabled:
        due = float(config.channel.is_due(every, rate_hz).sum())
        samples[CHANNEL] = link_count(config.channel, counts, scenario) * len(config.channel.carriers_hz) * due
    agents = sum(counts.get(role, 0) for role in AGENT_ROLES)
    extents = {"agents": agents, "boxes": counts["boxes"]}
    return ScenarioLoad(scenario, samples, extents, -(-frames.count // config.output.shard_frames))


def choose_scenarios(loads: Sequence[ScenarioLoad], count: int) -> list[int]:
    """Return which scenarios stand for all, in the order of choice: up to `count` of them, or all.

    Each has what no earlier one has: first a sensor or links, then a town, where the median number of boxes stands for
    the others; then the number of boxes and agents that differs most.
    """
    chosen: list[int] = []

    def gain(index: int) -> tuple[int, bool, float]:
        load = loads[index]
        covered = {name for other in chosen for name, value in loads[other].samples.items() if value}
        new = sum(value > 0 and name not in covered for name, value in load.samples.items())
        others = [loads[other] for other in chosen if loads[other].place == load.place]
        if not others:
            town = [other.extents["boxes"] for other in loads if other.place == load.place]
            return new, True, -abs(load.extents["boxes"] - median(town))
        return new, False, min(_difference(load, other) for other in others)

    while len(chosen) < min(count, len(loads)):
        chosen.append(max((index for index in range(len(loads)) if index not in chosen), key=gain))
    return chosen


def _difference(load: ScenarioLoad, other: ScenarioLoad) -> float:
    """Return how much boxes and agents of two scenarios differ, relative to the larger numbers."""
    pairs = [(load.extents[name], other.extents[name]) for name in load.extents]
    return sum(abs(one - two) / max(one, two, 1) for one, two in pairs)


def infer_scenario(load: ScenarioLoad, known: Sequence[tuple[ScenarioLoad, SampledScenario]]) -> SampledScenario:
    """Return the tables of a scenario that was not traced: what others have for each sample, frame, link or box.

    Args:
        load: What is known of it.
        known: The traced scenarios. Those of the same town count; all do for what none of these has.
    """
    same = [pair for pair in known if pair[0].place == load.place] or known
    tables: dict[str, SampledTable] = {}
    for name in dict.fromkeys(table for _, sample in known for table in sample.tables):
        found = [sample.tables[name] for _, sample in known if name in sample.tables]
        own = [sample.tables[name] for _, sample in same if name in sample.tables] or found
        rows = {
            source: load.expected(name, source) * (_rate(name, source, same) or _rate(name, source, known))
            for source in dict.fromkeys(source for table in found for source in table.rows)
        }
        shard_bytes = sum(table.shard_bytes for table in own) / len(own)
        tables[name] = SampledTable(rows, shard_bytes, _row_bytes(own) or _row_bytes(found))
    return SampledScenario(load.scenario.name, tables, load.shards, is_traced=False)


def _rate(name: str, source: str, group: Sequence[tuple[ScenarioLoad, SampledScenario]]) -> float:
    """Return the rows of a table from a source over what is expected of it, in some traced scenarios together."""
    expected = sum(load.expected(name, source) for load, _ in group)
    tables = [sample.tables[name] for _, sample in group if name in sample.tables]
    return sum(table.rows.get(source, 0.0) for table in tables) / expected if expected else 0.0


def _row_bytes(tables: Sequence[SampledTable]) -> float:
    """Return the bytes of a row in some tables together; 0 without any row."""
    rows = sum(table.row_count for table in tables)
    return sum(table.row_count * table.row_bytes for table in tables) / rows if rows else 0.0
