"""Compare the motion of live traffic without controls with that of replayed traffic, for `docs/guides/closed-loop.md`.

`python -m bench.live_motion docs/images/live_motion.png` takes ten seconds on the CPU. `quickstart` with 40 vehicles
over 20 s; with `--scenario` another one of `full`, with `--engine sumo` SUMO (`live_motion_sumo.png`). The curves are
shares of all samples at 100 Hz, ends excluded.
"""

import argparse
from pathlib import Path

import matplotlib as mpl
import numpy as np

import mmw
from mmw.config import Config
from mmw.core.constants import FRAME_DT
from mmw.core.kinematics import differentiate
from mmw.core.transforms import quaternion_to_ypr
from mmw.scene.prepare import make_demand
from mmw.scene.sources import scenario_source
from mmw.traffic.demand import TrafficDemand
from mmw.traffic.engine import simulate_traffic
from mmw.traffic.live.live_traffic import LiveTraffic
from mmw.usd.vehicle_catalog import load_catalog
from mmw.viz.plots.style import GREY, RED

mpl.use("Agg")
from matplotlib import pyplot as plt

QUANTITIES = {
    "acceleration along": "m/s²",
    "acceleration aside": "m/s²",
    "yaw rate": "rad/s",
    "jerk": "m/s³",
}
"""Quantity -> unit; the jerk is the length of the vector, the others have a sign."""


def demand_of(config: Config, scenario: str) -> TrafficDemand:
    """Return the traffic that a configuration asks for in a scenario."""
    chosen = config.scenario(scenario)
    return make_demand(config, chosen, scenario_source(chosen, Path()), load_catalog(), Path())


def motion(poses: np.ndarray) -> dict[str, np.ndarray]:
    """Return the quantities of poses in consecutive frames, shape [F, V, 7], by name, each of shape [F - 4, V]."""
    found, inside = differentiate(poses), slice(2, -2)
    heading = quaternion_to_ypr(poses[..., 3:])[..., 0]
    ax, ay = found.acceleration[..., 0], found.acceleration[..., 1]
    jerk = np.linalg.norm(found.acceleration[2:] - found.acceleration[:-2], axis=-1) / (2 * FRAME_DT)
    return {
        "acceleration along": (ax * np.cos(heading) + ay * np.sin(heading))[inside],
        "acceleration aside": (ay * np.cos(heading) - ax * np.sin(heading))[inside],
        "yaw rate": found.world_rate[inside, :, 2],
        "jerk": jerk[1:-1],
    }


def print_table(live: dict[str, np.ndarray], replay: dict[str, np.ndarray]) -> None:
    """Print range, 99.9 % quantile of the magnitude, and the share of live samples outside the range of replay."""
    print("| | replayed: range, 99.9 % | live: range, 99.9 % | live samples outside, farthest |\n|---|---|---|---|")
    for name, unit in QUANTITIES.items():
        sides = []
        for values in (replay[name], live[name]):
            late = np.quantile(np.abs(values), 0.999)
            sides.append(f"{values.min():.3f} to {values.max():.3f}, {late:.3f}")
        low, high = min(replay[name].min(), 0.0), replay[name].max()
        beyond = np.maximum(live[name] - high, low - live[name])
        share = f"{1e6 * np.mean(beyond > 0):.0f} in 10^6, by {max(beyond.max(), 0.0):.4f}"
        print(f"| {name} [{unit}] | {sides[0]} | {sides[1]} | {share} |")


def draw(live: dict[str, np.ndarray], replay: dict[str, np.ndarray], file: Path) -> None:
    """Draw the share of samples whose magnitude exceeds a value, one panel a quantity."""
    figure, axes = plt.subplots(1, len(QUANTITIES), figsize=(9.6, 2.9), sharey=True, layout="constrained")
    for axis, (name, unit) in zip(axes, QUANTITIES.items(), strict=True):
        for values, style in (
            (replay[name], {"color": GREY, "lw": 4.0, "alpha": 0.6, "label": "replayed"}),
            (live[name], {"color": RED, "lw": 1.2, "label": "live, no controls"}),
        ):
            ordered = np.sort(np.abs(values), axis=None)
            share = 1.0 - np.arange(len(ordered)) / len(ordered)
            kept = np.unique(np.geomspace(1, len(ordered), 2000).astype(int))  # steps from the largest value down
            axis.plot(ordered[-kept], share[-kept], **style)
        axis.set(xlabel=f"{name} [{unit}]", yscale="log", xlim=(0.0, None))
        axis.grid(alpha=0.3)
    axes[0].set_ylabel("share of samples beyond")
    axes[0].legend(fontsize=8, loc="lower left")
    figure.savefig(file, dpi=110)


def main() -> None:
    """Drive the same traffic twice, print the table and draw the figure."""
    parser = argparse.ArgumentParser(
        prog="python -m bench.live_motion", description="Compare live and replayed traffic."
    )
    parser.add_argument("file", type=Path, help="PNG to write")
    parser.add_argument("--scenario", default="town03_roundabout", help="scenario of `full`")
    parser.add_argument("--engine", default="idm", choices=("idm", "sumo"))
    parser.add_argument("--vehicles", type=int, default=40)
    parser.add_argument("--frames", type=int, default=2000, help="frames at 100 Hz")
    options = parser.parse_args()
    changes = [
        f"frames.count={options.frames}",
        f"scenarios.{options.scenario}.traffic.vehicle_count={options.vehicles}",
        f"scenarios.{options.scenario}.traffic.engine={options.engine}",
    ]
    demand = demand_of(mmw.load_config("full", changes), options.scenario)
    tracks = [track for track in simulate_traffic(demand).tracks if track.role in ("cav", "vehicle")]
    traffic = LiveTraffic(demand)
    traffic.advance(options.frames)
    traffic.close()
    recorded = np.stack([track.poses[: options.frames] for track in tracks], axis=1)
    stepped = traffic.poses[:, [traffic.names.index(track.name) for track in tracks]]
    live, replay = motion(stepped), motion(recorded)
    apart = 1e3 * np.linalg.norm(stepped[..., :3] - recorded[..., :3], axis=-1).max()
    print(
        f"{options.scenario}: {len(tracks)} vehicles, {options.frames} frames; places differ by {apart:.2f} mm at most"
    )
    print_table(live, replay)
    draw(live, replay, options.file)


if __name__ == "__main__":
    main()
