"""Draw the errors of GNSS receivers that trace satellites along two streets of town10, for `docs/sensors/gnss.md`.

`python -m bench.gnss_street docs/images/gnss_street.png` takes about three minutes on two cores.
"""

import argparse
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np

import mmw
from mmw.core.geodesy import world_from_wgs84
from mmw.sensors import Gnss

mpl.use("Agg")
from matplotlib import pyplot as plt

STREETS = {"x = -42 m, between houses": -42.0, "x = 46.5 m, below a skybridge": 46.5}
"""Title -> place of a street that runs to the north [m]."""

SOUTH_M, NORTH_M = -108.0, 45.0

ANTENNA_M = 1.8
"""Height above the road, which is level [m]."""


def drive(scene: mmw.Scene, x: float, config: Gnss) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return places along a street [m], errors to the east, north and up [m], and satellites tracked and in sight."""
    along = np.arange(SOUTH_M, NORTH_M)
    poses = np.zeros((len(along), 7))
    poses[:, 0], poses[:, 1], poses[:, 2], poses[:, 6] = x, along, ANTENNA_M, 1.0
    samples = scene.capture(config, pose=poses, velocity=(0.0, 10.0, 0.0))
    error = np.array([world_from_wgs84(s.geodetic, config.reference) if s.has_fix else [np.nan] * 3 for s in samples])
    satellites = [s.satellites for s in samples]
    counts = np.array([(own.is_tracked.sum(), (own.is_tracked & own.is_los).sum()) for own in satellites])
    return along, error - poses[:, :3], counts


def draw(results: dict[str, Any], file: Path) -> None:
    """Write the figure."""
    figure, axes = plt.subplots(
        2, len(results), figsize=(9.6, 4.4), sharex=True, sharey="row", layout="constrained", height_ratios=(2, 1)
    )
    for column, (title, (along, error, counts)) in enumerate(results.items()):
        upper, lower = axes[:, column]
        for axis, color in zip(range(3), ("#c0392b", "#1f4e79", "#9aa5b1"), strict=True):
            upper.plot(along, error[:, axis], color=color, lw=1.1, label=("east", "north", "up")[axis])
        lost = np.isnan(error[:, 0])
        upper.fill_between(along, -60, 60, where=lost, color="#f4d6d2", step="mid", lw=0, label="no fix")
        lower.step(along, counts[:, 0], where="mid", color="#1f4e79", label="tracked")
        lower.step(along, counts[:, 1], where="mid", color="#2e8b57", label="of these in sight")
        upper.set(title=f"town10, {title}", ylim=(-60.0, 60.0))
        lower.set(xlabel="y [m]", ylim=(0.0, 8.5))
    axes[0, 0].set_ylabel("error [m]")
    axes[1, 0].set_ylabel("satellites")
    axes[0, 0].legend(fontsize=7, ncols=4, loc="upper left")
    axes[1, 0].legend(fontsize=7, ncols=2, loc="lower left")
    figure.savefig(file, dpi=110)


def main() -> None:
    """Trace both streets and draw them."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("file", type=Path, help="PNG file")
    parser.add_argument("--device", default="auto")
    arguments = parser.parse_args()
    scene = mmw.load_scene("town10", device=arguments.device)
    draw({title: drive(scene, x, Gnss(mode="ray_traced")) for title, x in STREETS.items()}, arguments.file)


if __name__ == "__main__":
    main()
