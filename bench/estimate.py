"""Compare what `--dry-run` foresees with what a run makes, for varied configurations: `python -m bench.estimate`.

Rows and bytes of all tables, over those of the run; each must be within 20 %. Twelve frames each, four of each of the
sixteen scenarios, on any device; at 1 Hz they are a whole drive. The time is that of the estimate alone, without the
start of Python and its imports.
"""

import argparse
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

from mmw.config import Config, load_config
from mmw.core.device import choose_device
from mmw.generation.estimate import count_agents
from mmw.generation.foresee import foresee
from mmw.generation.run_config import RunOptions, run_config
from mmw.generation.sample_run import total
from mmw.storage.manifest import manifest_rows, read_markers

RADIO = "sensors=[]"
CASES: dict[str, tuple[str, ...]] = {
    "all sensors": ("quickstart",),
    "lidar in rain": ("quickstart", "sensors=[{type: lidar}]", "weathers=[sunny, rainy]", "channel.enabled=false"),
    "radio": ("quickstart", RADIO),
    "radio, diffuse without rough material": ("quickstart", RADIO, "channel.diffuse_reflection=true"),
    "radio, rough walls": (
        "quickstart", RADIO, "channel={diffuse_reflection: true, diffuse_samples: 500}",
        "materials={'label:building': {scattering: 0.4}}",
    ),
    "radio, diffraction": ("quickstart", RADIO, "channel.diffraction=true"),
    "radio, two bounces by rays": (
        "quickstart", RADIO, "channel={candidates: launch, samples_per_tx: 100000, max_depth: 2, links: [v2i, v2v]}"
    ),
    "crossroad, dense, v2v": (
        "town10_crossroad", RADIO, "channel={samples_per_tx: 100000, links: [v2v]}",
        "scenarios.0.traffic.cav_ranks=[0, 1, 2, 3, 4, 5]",
    ),
    "radio, full, whole drive": ("town10_crossroad", RADIO, "channel.physics=full", "frames.rate_hz=1"),
    "radio, standard, V2V, whole drive": (
        "town07_crossroad", RADIO, "channel={physics: standard, links: [v2i, v2v]}", "frames.rate_hz=1",
    ),
    "small pictures": (
        "town07_crossroad", "channel.enabled=false", "sensors=[{type: rgb, width_px: 320, height_px: 180, rate_hz: 50}]"
    ),
    "brick at three carriers": (
        "town05_cbd_crossroad", RADIO, "channel={candidates: exhaustive, carriers_hz: [2.0e9, 39.0e9, 140.0e9]}",
        "materials={'label:building': itu_brick}", "weathers=[sunny, rainy, foggy]",
    ),
    "sixteen scenarios, all sensors": (
        "full", "weathers=[sunny, rainy]", "channel.samples_per_tx=100000",
        "sensors=[{type: lidar}, {type: depth}, {type: imu}, {type: gnss}, {type: radar}, {type: rgb, rate_hz: 10}]",
    ),
}  # fmt: skip
"""Name -> shipped configuration and changes."""

MANY, MANY_FRAMES = 4, 4
"""A configuration of more scenarios than the first number has the second number of frames."""


def compare(config: Config, base: Path, device: str, out: Path) -> tuple[float, float, float, float, float]:
    """Return foreseen and true rows, foreseen and true bytes, and the seconds of the estimate."""
    begin = time.perf_counter()
    samples = foresee(config, base, device, count_agents(config, base))
    seconds = time.perf_counter() - begin
    run_config(config, base, "bench", RunOptions(is_quiet=True))
    made = manifest_rows(read_markers(out)).to_pylist()
    true_rows, true_size = (sum(row[key] for row in made) for key in ("rows", "bytes"))
    rows, size = sum(total(sample.rows) for sample in samples), sum(total(sample.bytes) for sample in samples)
    return rows, true_rows, size, true_size, seconds


def main(argv: Sequence[str] | None = None) -> int:
    """Print one line for each case, and return 1 if one is off by more than 20 %."""
    parser = argparse.ArgumentParser(description="Compare what --dry-run foresees with what a run makes.")
    parser.add_argument("--device", default="auto")
    parser.add_argument("--frames", type=int, default=12, help="frames of each case")
    parser.add_argument("--only", default="", help="cases whose name has this text")
    options = parser.parse_args(argv)
    device, worst = choose_device(options.device), 0.0
    print(f"{'case':40} {'rows':>10} {'true':>10} {'ratio':>6} {'MB':>9} {'true':>9} {'ratio':>6} {'s':>6}")
    for name, (source, *changes) in CASES.items():
        if options.only not in name:
            continue
        with tempfile.TemporaryDirectory() as folder:
            out = Path(folder) / "d"
            given = {"output.dir": str(out), "compute.device": device, "compute.workers": 1}
            is_many = len(load_config(source).scenarios) > MANY
            frames = min(options.frames, MANY_FRAMES) if is_many else options.frames
            config = load_config(source, [*changes, f"frames.count={frames}"], given)
            rows, true_rows, size, true_size, seconds = compare(config, Path(folder), device, out)
        ratios = rows / true_rows, size / true_size
        worst = max(worst, *(max(ratio, 1 / ratio) for ratio in ratios))
        numbers = (
            f"{rows:10,.0f} {true_rows:10,} {ratios[0]:6.2f} {size / 1e6:9.2f} {true_size / 1e6:9.2f} {ratios[1]:6.2f} "
            f"{seconds:6.1f}"
        )
        print(f"{name:40} {numbers}", flush=True)
    print(f"worst: a factor of {worst:.2f}")
    return int(worst > 1.2)


if __name__ == "__main__":
    raise SystemExit(main())
