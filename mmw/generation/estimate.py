"""Check the inputs of a configuration, and estimate its frames, rays and bytes before tracing."""

import functools
import math
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mmw.channel.path_solver.scatter_paths import KEPT_SHARE, UNEQUAL_STRENGTHS
from mmw.config import ChannelConfig, Config, ConfigError, ScenarioConfig, SensorConfig
from mmw.config.agent_keys import AGENT_ROLES, AgentIdentity
from mmw.config.sampling import Sampling
from mmw.config.sensor_spec import spec_of
from mmw.config.traffic_engine import check_package
from mmw.core.errors import InputError
from mmw.generation.agent_key_checks import unknown_agent_keys
from mmw.generation.progress import si
from mmw.generation.sample_run import SampledScenario, table_lines, total
from mmw.physics.weather.weather import PRESETS, choose_variant
from mmw.scene.sources import scenario_source, trajectory_file, weather_variants
from mmw.storage.schemas import TABLES
from mmw.usd.actors import FIXED_ROLES, find_actors
from mmw.usd.material_entries import unknown_entries
from mmw.usd.open_stage import open_stage, usd_errors
from mmw.usd.vehicle_catalog import load_catalog

GAIN_BYTES, GEOMETRY_BYTES = 68.0, 90.0
"""Bytes of the gains of one radio path at one carrier, and of its geometry, measured on the sixteen scenarios with
`physics: full`: 62 to 77, and 84 to 103. They and the next are for estimates without a trace."""

PATHS_PER_LINK = 2.5
"""Paths of a link at first order, measured on town03; a link without any counts too. Every order more adds one."""

FINITE_PATHS_PER_LINK = 24.0
"""Further reflections of a link by finite and curved surfaces within `MEASURED_RANGE_DB`, mean of the sixteen
scenarios; every 40 dB more make ten times as many, up to `FINITE_RANGE_DB` (on town03)."""

BENT_PATHS_PER_LINK = 118.0
"""Diffracted paths of a link at first order, measured on town03; every order more makes 3.3 times as many."""

NEAR_BENT_PATHS, MORE_NEAR_BENT_PATHS = 15.0, 35.0
"""Those within `MEASURED_RANGE_DB` at first order, and for every order more, means of the sixteen
scenarios; every 20 dB more make ten times as many (on town03)."""

MEASURED_RANGE_DB, FINITE_RANGE_DB = 40.0, 56.0
"""Dynamic range of the numbers above, and the one beyond which finite surfaces add no more reflections."""

PATCHES_PER_RAY = 0.35
"""Diffuse paths of a link for each ray of an end and order; rough ground below a mast gives 0.38, the sixteen
scenarios with `physics: full` 0.17 to 0.58, 0.34 on average."""

ROW_BYTES = {"poses": 80.0, "boxes": 60.0, "links": 25.0}
"""Bytes of one row of the small tables, measured on town03."""

FILE_BYTES = 12_000.0
"""Bytes of a Parquet file without rows: schema with units and meanings, and statistics; 6 to 27 kB by table."""


def check_inputs(config: Config, base: Path) -> None:
    """Check everything that can be checked before traffic runs: files, weathers of towns, names of materials.

    Raises:
        ConfigError: With one line for each problem.
    """
    problems: list[str] = []

    def attempt(check: Callable[..., Any], *arguments: Any, where: str = "") -> None:
        try:
            check(*arguments)
        except InputError as error:
            problems.append(f"{where}{error}")

    known = {**config.air, **PRESETS}
    problems += unknown_entries("materials", config.materials, known)
    variants_of = functools.cache(weather_variants)  # scenarios share towns
    for scenario in config.scenarios:
        where = f"scenario {scenario.name!r}"
        attempt(_check_source, scenario, base, config, variants_of)
        attempt(trajectory_file, scenario, base)
        if scenario.traffic is not None:
            attempt(check_package, scenario.traffic.engine, where=f"{where}: traffic.")
        problems += unknown_entries(f"{where}: materials", scenario.materials, known)
        if config.channel.enabled and "v2i" in config.channel.links and scenario.town and not scenario.rsus:
            problems.append(
                f"{where}: channel.links = {list(config.channel.link_names)} has v2i but there are no rsus; add one, "
                "or use channel.links: [v2v]"
            )
    if not problems:  # the models that there may be are those of towns and stages, which can be read
        attempt(lambda: problems.extend(unknown_agent_keys(config, base)))
    if problems:
        raise ConfigError(problems)


def _check_source(
    scenario: ScenarioConfig, base: Path, config: Config, variants_of: Callable[[Path], list[str]]
) -> None:
    """Open a stage or town without its payloads, and look for a variant of a town for each weather."""
    source = scenario_source(scenario, base)
    key, value = ("stage", scenario.stage) if scenario.stage is not None else ("town", scenario.town)
    try:
        known = variants_of(source)
    except InputError as error:
        raise InputError(f"scenario {scenario.name!r}: {key} = {value!r}: {error}") from None
    for weather, names in config.variants.items() if scenario.town is not None and known else ():
        if choose_variant(names, known) is None:
            raise InputError(
                f"weathers holds {weather!r}: {value} has the variants {', '.join(known)}, none of {', '.join(names)}; "
                f"set air.{weather}.variant to one that it has"
            )


FindRoles = Callable[[Path, tuple[tuple[str, str], ...]], list[str]]


def stage_roles(source: Path, given: tuple[tuple[str, str], ...]) -> list[str]:
    """Return the roles of the actors of a stage, of which some are given by prim path.

    Raises:
        InputError: If it cannot be read, or they do not fit it.
    """
    stage = open_stage(source)
    with usd_errors(source):
        return [actor.role for actor in find_actors(stage, dict(given))]


def agent_counts(scenario: ScenarioConfig, base: Path, find_roles: FindRoles = stage_roles) -> dict[str, int]:
    """Return how many agents of each role, vehicles (CAVs included) and boxes a scenario has.

    Raises:
        InputError: If a stage of the user's own cannot be read, or `actor_roles` does not fit it.
    """
    traffic = scenario.traffic
    roles = find_roles(scenario_source(scenario, base), () if traffic else tuple(scenario.actor_roles.items()))
    units = {"rsu": len(scenario.rsus), "bs": len(scenario.base_stations), "uav": len(scenario.uavs)}
    if traffic is None:
        agents = {role: roles.count(role) + units.get(role, 0) for role in AGENT_ROLES}
        vehicles = agents["cav"] + roles.count("vehicle")
        return {**agents, "vehicles": vehicles, "boxes": sum(role not in FIXED_ROLES for role in roles)}
    boxes = traffic.vehicle_count + traffic.pedestrian_count + traffic.cyclist_count + len(scenario.uavs)
    agents = {"cav": traffic.cav_count, "vru": traffic.vru_count, **units}
    return {**agents, "vehicles": traffic.vehicle_count, "boxes": boxes + len(roles)}  # the town has parked vehicles


AgentCounts = Mapping[str, Mapping[str, int]]
"""Scenario -> its `agent_counts`."""


def count_agents(config: Config, base: Path) -> AgentCounts:
    """Return the counts of every scenario; a town of several is opened once.

    Raises:
        InputError: As `agent_counts`.
    """
    find_roles = functools.cache(stage_roles)
    return {scenario.name: agent_counts(scenario, base, find_roles) for scenario in config.scenarios}


@dataclass(frozen=True)
class PlanEstimate:
    """Estimate of the work and the data of a configuration."""

    rays: float
    """Rays of all frames, traced once for all weathers."""
    bytes: float
    """Bytes of all tables."""
    lines: tuple[str, ...]
    """A line for each scenario."""


def describe_plan(
    config: Config, base: Path, device: str, counts: AgentCounts, samples: Sequence[SampledScenario] = ()
) -> str:
    """Return the text of `--dry-run`: frames, rays and bytes of every scenario, and where they would go.

    Args:
        config: The configuration.
        base: Folder that relative paths start from.
        device: Device that would trace.
        counts: See `count_agents`.
        samples: Foreseen tables of each scenario, see `mmw.generation.foresee`; without, the bytes are those of the
            shipped scenarios on average.

    Raises:
        InputError: If a town or stage is not there.
    """
    plan = estimate_plan(config, base, counts)
    lines = [
        f"{len(config.scenarios)} scenario(s) x {len(config.weathers)} weather(s), "
        f"{config.frame_total} frames in all on {device}",
        *plan.lines,
    ]
    if config.channel.enabled and config.channel.candidates == "exhaustive":
        lines.append("  channel: no rays for mirrors; every surface is tried for every link")
    size = plan.bytes
    if samples:
        size = sum(total(sample.bytes) for sample in samples)
        lines += [_origin(samples), *table_lines(samples)]
        lines += [f"note: {line}" for line in dict.fromkeys(line for sample in samples for line in sample.notes)]
    else:
        lines.append(
            "no frame was traced: bytes are those of the shipped scenarios on average, which differ by a factor of two "
            "in radio paths, and notes are left out"
        )
    lines.append(
        f"total: {si(plan.rays)}rays traced once for all weathers, tables of about {si(size)}B in {config.output.dir}"
    )
    return "\n".join(lines)


def _origin(samples: Sequence[SampledScenario]) -> str:
    """Return the heading of the tables, which says what was traced and what was inferred."""
    traced = [sample.name for sample in samples if sample.is_traced]
    if len(traced) == len(samples):
        return "tables, from traced frames of each scenario:"
    return (
        f"tables, from traced frames of {len(traced)} of {len(samples)} scenarios ({', '.join(traced)}); the others "
        "are inferred from those of the same town, else from all, by frames, agents, links and vehicles:"
    )


def estimate_plan(config: Config, base: Path, counts: AgentCounts) -> PlanEstimate:
    """Return about how many rays and bytes the scenarios of a configuration with these agents would take."""
    lines: list[str] = []
    total_rays = total_bytes = 0.0
    framed_tables = [table for table in TABLES.values() if table.framed]
    for scenario in config.scenarios:
        own = counts[scenario.name]
        rays, size = frame_cost(config, own, scenario)
        frame_rays = sum(rays.values())
        frame_count = config.frames_of(scenario).count
        shards = -(-frame_count // config.output.shard_frames)
        total_rays += frame_rays * frame_count
        files = sum(len(config.weathers) if table.by_weather else 1 for table in framed_tables)
        total_bytes += size * frame_count * len(config.weathers) + shards * files * FILE_BYTES
        each = ", ".join(f"{name} {si(count).strip()}" for name, count in rays.items())
        lines.append(
            f"  {scenario.name}: {scenario_source(scenario, base).name}, {_agent_words(own)} "
            f"among {own['vehicles']} vehicles, {si(frame_rays)}rays a frame" + (f" ({each})" if each else "")
        )
    return PlanEstimate(total_rays, total_bytes, tuple(lines))


def frame_cost(config: Config, counts: Mapping[str, int], scenario: ScenarioConfig) -> tuple[dict[str, int], float]:
    """Return the rays of each sensor and of the channel, and the bytes of rows in one weather, a frame on average.

    Rows that are the same in all weathers count in equal shares.
    """
    frames, rate_hz = config.frames_of(scenario), config.frame_rate_of(scenario)

    def share(sampled: Sampling) -> float:
        return float(sampled.is_due(range(frames.start, frames.stop), rate_hz).mean())

    rays: dict[str, int] = {}
    size = sum(counts.get(role, 0) for role in AGENT_ROLES) * ROW_BYTES["poses"] + counts["boxes"] * ROW_BYTES["boxes"]
    for sensor in config.sensors:
        samples = carrier_count(sensor, counts, scenario) * share(sensor)
        cost = spec_of(sensor).estimate(sensor)
        if cost.rays:
            rays[sensor.name] = round(samples * cost.rays)
        size += samples * (cost.bytes + cost.bytes_per_box * counts["boxes"])
    if config.channel.enabled:
        channel = config.channel
        half = 0.5 if channel.is_reciprocal else 1.0  # the ends of a pair share the rays
        ends = channel.link_ends(_agents(counts, scenario))
        mutual = {(end.tx, end.rx) for end in ends} & {(end.rx, end.tx) for end in ends}
        sent: dict[tuple[int, int], list[tuple[int, int]]] = defaultdict(list)
        for end in ends:
            sent[end.tx, end.tx_antenna].append((end.tx, end.rx))
        senders = sum(half if mutual.issuperset(own) else 1.0 for own in sent.values())
        if channel.candidates == "launch":
            rays["channel"] = int(senders * channel.samples_per_tx * share(channel))
        link_size = len(channel.carriers_hz) * (ROW_BYTES["links"] + _paths(channel) * GAIN_BYTES)
        link_size += _paths(channel) * GEOMETRY_BYTES / len(config.weathers)
        size += len(ends) * link_size * share(channel)
    return rays, size


def carrier_count(sensor: SensorConfig, counts: Mapping[str, int], scenario: ScenarioConfig) -> int:
    """Return how many agents carry a sensor."""
    agents = _agents(counts, scenario)
    known = {key for agent in agents for key in agent.keys}
    others = [key for key in sensor.on if scenario.stage is not None and key not in known and key not in AGENT_ROLES]
    return sum(sensor.is_on(*agent) for agent in agents) + len(others)


def _agents(counts: Mapping[str, int], scenario: ScenarioConfig) -> list[AgentIdentity]:
    """Return the agents of a scenario; with the model where the configuration gives it, as of the names of a stage."""
    names = {"rsu": scenario.rsus, "bs": scenario.base_stations, "uav": scenario.uavs}
    chosen = scenario.traffic.cav_models if scenario.traffic else ()
    catalog = load_catalog() if any(chosen) else {}
    found = []
    for role in AGENT_ROLES:
        placed = [agent.name for agent in names.get(role, ())]
        for number in range(counts.get(role, 0)):
            name = placed[number] if number < len(placed) else f"{role}_{number + 1}"
            model = (chosen[number] if role == "cav" and number < len(chosen) else None) or ""
            label = catalog[model].label if model in catalog else ""
            found.append(AgentIdentity(role, name, model, label))
    return found


def _agent_words(counts: Mapping[str, int]) -> str:
    """Return the numbers of agents; those of roles beside CAV and RSU only if there are any."""
    shown = [role for role in AGENT_ROLES if role in ("cav", "rsu") or counts.get(role, 0)]
    return " + ".join(f"{counts[role]} {role.upper()}" for role in shown)


def link_count(channel: ChannelConfig, counts: Mapping[str, int], scenario: ScenarioConfig) -> int:
    """Return how many links a frame has at one carrier."""
    return len(channel.link_ends(_agents(counts, scenario)))


def _paths(channel: ChannelConfig) -> float:
    """Return how many paths a link has, about."""
    order = channel.max_depth
    more_db = math.inf if channel.dynamic_range_db is None else channel.dynamic_range_db - MEASURED_RANGE_DB
    count = PATHS_PER_LINK + max(order - 1, 0)
    if channel.finite_surfaces and order:
        count += FINITE_PATHS_PER_LINK * 10.0 ** (min(more_db, FINITE_RANGE_DB - MEASURED_RANGE_DB) / 40.0)
    if channel.diffraction and order:
        bent = BENT_PATHS_PER_LINK * 3.3 ** (order - 1)
        if channel.dynamic_range_db is not None:
            near = NEAR_BENT_PATHS + MORE_NEAR_BENT_PATHS * (order - 1)
            bent = min(bent, near * 10.0 ** (more_db / 20.0))
        count += bent
    error = channel.diffuse_relative_error
    if channel.diffuse_reflection:
        patches = PATCHES_PER_RAY * channel.expected_diffuse_rays * order
        count += patches if error is None else min(2 * patches, KEPT_SHARE * UNEQUAL_STRENGTHS / error**2)
    return count
