"""Drive and trace the shipped scenarios: `python -m bench.scenarios --seeds 3 --out docs/reference/scenarios.md`.

For each scenario: traffic in several seeds at full length (gap, jerk, wheels on the ground, stuck vehicles), and for
its own seed the line of sight, blockers, first-order paths and reflectors of every link from a roadside unit to a CAV,
counted by tracing.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from bench.link_census import LinkCensus, census
from bench.traffic_check import Measures, measure
from mmw.config import Config, load_config
from mmw.scene.prepare import make_tracks, prepare_scenario, read_scenario
from mmw.scene.sources import scenario_source
from mmw.traffic.roads.town_asset import open_town
from mmw.usd.vehicle_catalog import load_catalog

ROOT = Path(__file__).resolve().parent.parent
SCENARIOS = ROOT / "configs" / "scenarios"

EVERY = 10
"""Every so many frames are traced."""


@dataclass(frozen=True)
class ScenarioReport:
    """One scenario, driven and traced."""

    name: str
    description: str
    town: str
    seconds: float
    vehicles: int
    traffic: dict[int, Measures]
    """Seed -> measures."""
    links: list[LinkCensus]


def check_scenario(path: Path, seeds: int, every: int, device: str, is_traced: bool) -> ScenarioReport:
    """Return what a scenario's file gives.

    Args:
        path: Configuration with one scenario.
        seeds: Seeds to drive: the configuration's own and those after it.
        every: Every so many frames are traced.
        device: Warp device.
        is_traced: Whether links are counted too.
    """
    config = load_config(path)
    (scenario,) = config.scenarios
    source, catalog = scenario_source(scenario, path.parent), load_catalog()
    town = open_town(source)
    traffic = {}
    for seed in range(config.seed, config.seed + seeds):
        tracks = make_tracks(config.model_copy(update={"seed": seed}), scenario, source, catalog, path.parent)
        vehicles = [track for track in tracks if track.role != "pedestrian"]
        traffic[seed] = measure(vehicles, town.lanes, (town.points, town.faces), catalog)
    links = trace_scenario(config, path.parent, every, device) if is_traced else []
    assert scenario.traffic is not None
    frames, count = config.frames_of(scenario), scenario.traffic.vehicle_count
    return ScenarioReport(
        scenario.name, scenario.description, str(scenario.town), frames.count / 100, count, traffic, links
    )


def trace_scenario(config: Config, base: Path, every: int, device: str) -> list[LinkCensus]:
    """Return the census of a configuration's first scenario in its first weather."""
    scenario = config.scenarios[0]
    frames = config.frames_of(scenario)
    with tempfile.TemporaryDirectory(prefix="mmw_scenarios_") as folder:
        stage = prepare_scenario(config, scenario, base, Path(folder))
        arrays = read_scenario(config, scenario, stage)
        return census(arrays, config.weathers[0], range(frames.start, frames.stop, every), device)


def percent(share: float) -> str:
    """Return a share as whole percent; `<1` where it is smaller but not nothing."""
    return "<1 %" if 0 < share < 0.005 else f"{100 * share:.0f} %"


def metres(height: float) -> str:
    """Return a height to the decimetre, zero without a sign."""
    return f"{round(height, 1) + 0.0:.1f}"


def shares(found: Mapping[str, float]) -> str:
    """Return shares as text, the largest first."""
    ordered = sorted(found.items(), key=lambda item: (-item[1], item[0]))
    return ", ".join(f"{kind} {percent(share)}" for kind, share in ordered) or "-"


def markdown(reports: Sequence[ScenarioReport]) -> str:
    """Return the page `docs/reference/scenarios.md`."""
    lines = [
        "# Scenarios",
        "",
        "Sixteen places, each with the physical feature that names it. `mmw run --config NAME` runs one, "
        "`--config full` all of them in three weathers.",
        "This page is made by `python -m bench.scenarios --seeds 3 --out docs/reference/scenarios.md`: the traffic is "
        "driven at full length, and every tenth frame",
        "is traced (every surface for every link, first order).",
        "",
        "## What the links meet",
        "",
        "Share of the frames with line of sight (LOS), what blocks it first as seen from the unit, first-order paths "
        "a frame (least / mean / most),",
        "share of the frames with at least one path off a kind of thing, and the height of the road under the CAV.",
        "",
        "| scenario | link | LOS | blocked by | paths | reflected by | height [m] |",
        "|---|---|---|---|---|---|---|",
    ]
    for report in reports:
        for number, link in enumerate(report.links):
            low, mean, high = link.path_count
            lines.append(
                f"| {report.name if number == 0 else ''} | {link.rsu} - {link.cav} | {percent(link.los_share)} | "
                f"{shares(link.blockers)} | {low} / {mean:.1f} / {high} | {shares(link.reflectors)} | "
                f"{metres(link.height_m[0])} to {metres(link.height_m[1])} |"
            )
    lines += [
        "",
        "## How the traffic drives",
        "",
        "Worst values over the seeds: least distance of two vehicles, largest jerk of a body, largest distance of a "
        "tyre from the ground, vehicles that stand for",
        "more than 8 s without cause, and the mean speed.",
        "",
        "| scenario | town | seconds | vehicles | seeds | gap [m] | jerk [m/s3] | tyre [mm] | stuck | speed [m/s] |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    for report in reports:
        rows = list(report.traffic.values())
        lines.append(
            f"| {report.name} | {report.town} | {report.seconds:g} | {report.vehicles} | {len(rows)} | "
            f"{min(row.min_gap for row in rows):.2f} | {max(row.max_jerk for row in rows):.1f} | "
            f"{1000 * max(row.max_wheel_error for row in rows):.0f} | {sum(row.stuck for row in rows)} | "
            f"{sum(row.mean_speed for row in rows) / len(rows):.1f} |"
        )
    lines += ["", "## What is there", "", "| scenario | |", "|---|---|"]
    lines += [f"| {report.name} | {report.description} |" for report in reports]
    return "\n".join(lines) + "\n"


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the check, print one line a scenario and write the page."""
    parser = argparse.ArgumentParser(prog="python -m bench.scenarios", description=__doc__)
    parser.add_argument("names", nargs="*", help="scenarios; all of configs/scenarios by default")
    parser.add_argument("--seeds", type=int, default=3, help="seeds to drive, the configuration's own first")
    parser.add_argument("--every", type=int, default=EVERY, help="trace every so many frames")
    parser.add_argument("--device", default="cpu", help="Warp device")
    parser.add_argument("--no-trace", action="store_true", help="traffic only")
    parser.add_argument("--out", type=Path, help="page to write")
    parser.add_argument("--json", type=Path, help="file for all numbers")
    options = parser.parse_args(arguments)
    paths = [SCENARIOS / f"{name}.yaml" for name in options.names] or sorted(SCENARIOS.glob("*.yaml"))
    reports = []
    for path in paths:
        start = time.perf_counter()
        report = check_scenario(path, options.seeds, options.every, options.device, not options.no_trace)
        reports.append(report)
        print(f"{report.name} ({time.perf_counter() - start:.0f} s)", flush=True)
        for seed, row in report.traffic.items():
            print(f"  seed {seed}: {_plain(row)}", flush=True)
        for link in report.links:
            low, mean, high = link.path_count
            print(
                f"  {link.rsu} - {link.cav}: LOS {percent(link.los_share)}; blocked by {shares(link.blockers)}; "
                f"paths {low} / {mean:.1f} / {high}; off {shares(link.reflectors)}; "
                f"height {link.height_m[0]:.1f} to {link.height_m[1]:.1f} m",
                flush=True,
            )
    if options.out:
        options.out.write_text(markdown(reports))
    if options.json:
        options.json.write_text(json.dumps([asdict(report) for report in reports], indent=1))


def _plain(row: Any) -> str:
    return ", ".join(f"{name} {value:g}" for name, value in asdict(row).items() if isinstance(value, (int, float)))


if __name__ == "__main__":
    main()
