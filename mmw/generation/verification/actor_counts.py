"""Check the counts of the table `frames`, on which other counts rest, against the stage and the configuration."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from mmw.config import Config, ScenarioConfig
from mmw.scene.actor_counts import COUNTED, counted_in
from mmw.storage.finding import Finding

ALWAYS_THERE = ("idm", "replay")
"""Traffic engines whose CAVs are there in every frame."""

Counts = Mapping[str, np.ndarray]
"""Column of `frames` -> number in each frame of the scenario."""


def expected_counts(config: Config, scenario: ScenarioConfig, actors: Any, absent: Any = None) -> Counts:
    """Return the counts that a scenario must have.

    Args:
        config: The configuration.
        scenario: One of its scenarios.
        actors: What the marker of the static tables says about the stage, see `mmw.scene.rows.actor_presence`; None if
            an older mmw wrote it: nothing is expected then.
        absent: What the hashes of the stage say about actors that were taken out of a live simulation, see
            `mmw.scene.stage_digests.Spans`; they need not be there then.

    Raises:
        ValueError: If `actors` cannot be understood, or has fewer agents than the configuration.
    """
    if actors is None:
        return {}
    frames = config.frames_of(scenario)
    least = {
        "rsu_count": len(scenario.rsus), "bs_count": len(scenario.base_stations), "uav_count": len(scenario.uavs),
    }  # fmt: skip
    if scenario.traffic is not None:
        least["vru_count"] = scenario.traffic.vru_count
        if scenario.traffic.engine in ALWAYS_THERE:
            least["cav_count"] = scenario.traffic.cav_count
    counts = {name: np.zeros(frames.count, dtype=int) for name in COUNTED}
    try:
        for actor in actors.values():
            names = counted_in(actor["role"], actor.get("label", ""))
            for first, end in actor["frames"]:
                if not names or not frames.start <= first < end <= frames.stop:
                    raise ValueError(f"role {actor['role']!r} in frames {first} to {end - 1}")
                for name in names:
                    counts[name][first - frames.start : end - frames.start] += 1
        missed = {name: np.zeros(frames.count, dtype=int) for name in COUNTED}
        for name, spans in (absent or {}).items():
            for first, end in spans:
                for column in counted_in(actors[name]["role"], actors[name].get("label", "")):
                    missed[column][max(first - frames.start, 0) : max(end - frames.start, 0)] += 1
    except (AttributeError, KeyError, TypeError) as error:
        raise ValueError(f"{type(error).__name__}: {error}") from error
    for name, wanted in least.items():
        if (counts[name] + missed[name] < wanted).any():
            raise ValueError(f"{name} goes down to {counts[name].min()}; the configuration has {wanted}")
    return counts


def actor_kinds(actors: Any) -> dict[str, tuple[str, str]]:
    """Return model and class of the actors of `expected_counts` that have them; none for None."""
    return {name: (actor["model"], actor["label"]) for name, actor in (actors or {}).items() if "model" in actor}


def check_counts(expected: Counts, start: int, rows: Sequence[tuple], path: str) -> Iterator[Finding]:
    """Yield the columns of `frames` whose counts are not those of the scenario.

    Args:
        expected: Counts of the scenario.
        start: Its first frame.
        rows: Frame and values of the columns `COUNTED`.
        path: File, for the findings.
    """
    for column, name in enumerate(COUNTED, start=1):
        if name not in expected:
            continue
        for row in rows:
            index = row[0] - start
            wanted = int(expected[name][index]) if 0 <= index < len(expected[name]) else None
            if row[column] != wanted:
                yield Finding("count", path, f"{name} of frame {row[0]} is {row[column]}; the scenario has {wanted}")
                break
