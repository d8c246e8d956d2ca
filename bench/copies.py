"""Measure how much copies of a dataset by seed repeat each other: `python -m bench.copies --seeds 8 [key=value ...]`.

Traffic only, nothing is traced. For every connected vehicle (CAV) of every copy and scenario: how far it is, frame by
frame, from the nearest CAV of the same scenario in any other copy. Drives that stay within a lane's width of another
one's show models the same places at the same times.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from mmw.config import Config, config_path, load_config
from mmw.scene.prepare import make_tracks
from mmw.scene.sources import scenario_source
from mmw.usd.vehicle_catalog import load_catalog

NEAR_M = 3.0
"""Distance of drives that count as the same [m], about the width of a lane."""


def drives(config: Config, base: Path) -> dict[str, np.ndarray]:
    """Return where the CAVs of each scenario with traffic are: name -> x and y [m], shape [CAVs, F, 2]."""
    catalog = load_catalog()
    found = {}
    for scenario in config.scenarios:
        if scenario.traffic is not None:
            tracks = make_tracks(config, scenario, scenario_source(scenario, base), catalog, base)
            cavs = [track.poses[:, :2] for track in tracks if track.role == "cav"]
            if cavs:
                found[scenario.name] = np.stack(cavs)
    return found


def distances(copies: Sequence[np.ndarray]) -> np.ndarray:
    """Return how far each CAV is from the nearest one of the other copies.

    Args:
        copies: x and y of the CAVs of one scenario [m], shape [CAVs, F, 2] each.

    Returns:
        Metres, shape [CAVs of all copies, F].
    """
    rows = []
    for index, copy in enumerate(copies):
        others = np.concatenate([other for place, other in enumerate(copies) if place != index])
        rows += [np.linalg.norm(others - cav, axis=-1).min(axis=0) for cav in copy]
    return np.stack(rows)


def main(argv: Sequence[str] | None = None) -> None:
    """Drive the copies and print what they repeat."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--config", default="full", help="configuration file, or the name of a shipped one")
    parser.add_argument("--seeds", type=int, default=8, help="copies, of seeds 1, 2...")
    parser.add_argument("overrides", nargs="*", metavar="key=value", help="as of mmw.run; {seed} is the copy's seed")
    options = parser.parse_args(argv)
    if options.seeds < 2:
        parser.error(f"--seeds {options.seeds}: copies are compared with each other; give two or more")
    copies, path = [], config_path(options.config)
    for seed in range(1, options.seeds + 1):
        changes = [f"seed={seed}", *(text.replace("{seed}", str(seed)) for text in options.overrides)]
        copies.append(drives(load_config(path, changes), path.parent))
    if not copies[0]:
        parser.error(f"{options.config}: no scenario has traffic with CAVs; set `traffic.cav_ranks`")
    found = {name: distances([copy[name] for copy in copies]) for name in copies[0]}
    for name, rows in found.items():
        print(f"  {name}: {100 * (rows < NEAR_M).mean():.1f} % of the frames within {NEAR_M:g} m")
    away = list(found.values())
    middle = np.concatenate([np.median(rows, axis=1) for rows in away])
    near = np.concatenate([rows.ravel() < NEAR_M for rows in away])
    print(
        f"{len(middle)} CAVs of {options.seeds} copies: {100 * near.mean():.0f} % of their frames within {NEAR_M:g} m "
        f"of a CAV of another copy, {100 * (middle < NEAR_M).mean():.0f} % of them for half of their drive; median "
        f"distance {np.median(middle):.1f} m"
    )


if __name__ == "__main__":
    main()
