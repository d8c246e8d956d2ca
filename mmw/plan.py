"""What a configuration asks for, before anything is traced: inputs that must exist, frames, rays and bytes."""

from pathlib import Path

from mmw.config import Config, ConfigError, DepthConfig, ImuConfig, LidarConfig, ScenarioConfig
from mmw.paths import town_path
from mmw.report import si

LIDAR_BYTES_PER_RAY = 2.2
"""Bytes of one LiDAR ray in the tables, misses included; measured on town03 (bench/README.md)."""

DEPTH_BYTES_PER_PIXEL = 0.09
"""Bytes of one depth pixel as 16-bit PNG; measured on town03 (bench/README.md)."""

PATH_BYTES = 160.0
"""Bytes of one radio path for one carrier; measured on town03 (bench/README.md)."""

PATHS_PER_LINK = 8
"""Paths of a link at first order, about what the shipped scenarios have."""


def scenario_source(scenario: ScenarioConfig, base: Path) -> Path:
    """Return the USD file that a scenario starts from: its town asset or the user's own stage.

    A town is a shipped name, or a path relative to `base`, the configuration file's folder.

    Raises:
        ValueError: If the file does not exist.
    """
    if scenario.stage is not None:
        path = base / scenario.stage
        if not path.is_file():
            raise ValueError(
                f"scenario {scenario.name!r}: stage = {scenario.stage!r}: no such file ({path}); give a USD file"
            )
        return path
    town = scenario.town or ""
    if town.endswith((".usd", ".usda", ".usdc", ".usdz")):
        path = base / town
        if not path.is_file():
            raise ValueError(
                f"scenario {scenario.name!r}: town = {town!r}: no such file ({path}); give an existing town asset"
            )
        return path
    try:
        return town_path(town)
    except ValueError as error:
        raise ValueError(f"scenario {scenario.name!r}: {error}") from None


def check_inputs(config: Config, base: Path) -> None:
    """Check everything that can be checked without opening a USD file.

    Raises:
        ConfigError: With one line for each problem.
    """
    problems = []
    for scenario in config.scenarios:
        try:
            scenario_source(scenario, base)
        except ValueError as error:
            problems.append(str(error))
        if config.channel.enabled and "v2i" in config.channel.links and scenario.town and not scenario.rsus:
            problems.append(
                f"scenario {scenario.name!r}: channel.links has v2i but there are no rsus; add one, or use links: [v2v]"
            )
    if problems:
        raise ConfigError(problems)


def agent_counts(config: Config, scenario: ScenarioConfig) -> dict[str, int]:
    """Return how many agents of each role a scenario has, as far as the file says."""
    cavs = len(scenario.traffic.cav_ranks) if scenario.traffic else list(scenario.actor_roles.values()).count("cav")
    return {"cav": cavs, "rsu": len(scenario.rsus)}


def describe_plan(config: Config, base: Path, device: str) -> str:
    """Return the text of `--dry-run`: frames, rays and bytes of every scenario, and where they would go."""
    lines = [
        f"{len(config.scenarios)} scenario(s) x {len(config.weathers)} weather(s) x "
        f"{config.frames.count} frames on {device}"
    ]
    total_rays = total_bytes = 0.0
    for scenario in config.scenarios:
        counts = agent_counts(config, scenario)
        rays, size = {}, 0.0
        for sensor in config.sensors:
            agents = sum(counts[role] for role in sensor.on)
            if isinstance(sensor, LidarConfig):
                rays[sensor.name] = agents * sensor.channels * sensor.points_per_channel
                size += rays[sensor.name] * LIDAR_BYTES_PER_RAY
            elif isinstance(sensor, DepthConfig):
                rays[sensor.name] = agents * sensor.width_px * sensor.height_px
                size += rays[sensor.name] * DEPTH_BYTES_PER_PIXEL
            elif isinstance(sensor, ImuConfig):
                size += agents * 60
        if config.channel.enabled:
            senders, links = 0, 0
            if "v2i" in config.channel.links:
                senders, links = senders + counts["rsu"], links + counts["rsu"] * counts["cav"]
            if "v2v" in config.channel.links:
                senders, links = senders + counts["cav"], links + counts["cav"] * max(counts["cav"] - 1, 0)
            rays["channel"] = senders * config.channel.rays if config.channel.candidates == "launch" else 0
            size += links * len(config.channel.carriers_hz) * PATHS_PER_LINK * PATH_BYTES
        frame_rays = sum(rays.values())
        total_rays += frame_rays * config.frames.count
        total_bytes += size * config.frames.count * len(config.weathers)
        lines.append(
            f"  {scenario.name}: {scenario_source(scenario, base).name}, {counts['cav']} CAV + {counts['rsu']} RSU, "
            f"{si(frame_rays)}rays a frame ("
            + ", ".join(f"{name} {si(count).strip()}" for name, count in rays.items())
            + ")"
        )
    lines.append(
        f"total: {si(total_rays)}rays traced once for all weathers, about {si(total_bytes)}B in {config.output.dir}"
    )
    return "\n".join(lines)
