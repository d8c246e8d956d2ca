"""Measure an archive of maps: `python -m bench.maps FOLDER --out FOLDER [--seconds 10] [-- IMPORT OPTIONS]`.

Every map of the folder is imported, checked as by `mmw town check`, and driven with the configuration that its import
prints: vehicles alone, nothing is traced. What stands behind `--` is passed to `mmw import`, such as `--traffic` for
maps of OpenStreetMap. Each map has a process of its own, so that one that dies or takes too long costs its row only.

The folder `--out` gets `maps.json` and `maps.md`, a row a map, and what was imported. Overlaps are pairs of vehicles
whose oriented boxes overlap at some time, seen every 0.1 s from above and in height. A vehicle counts as standing if it
is slower than 0.5 m/s at the end and waits neither for green nor for another vehicle that does or that moves, see
`mmw.traffic.idm.wait_causes`.
"""

import argparse
import contextlib
import io
import json
import resource
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mmw.config import load_config
from mmw.config.yaml_loader import parse_yaml
from mmw.core.errors import InputError
from mmw.scene.prepare import make_tracks
from mmw.scene.sources import scenario_source
from mmw.traffic.demand import VehicleTrack
from mmw.traffic.idm.junctions import boxes_overlap
from mmw.traffic.idm.wait_causes import STANDING
from mmw.usd.vehicle_catalog import VehicleModel, load_catalog

SUFFIXES = (".xodr", ".osm", ".bz2", ".pbf")
"""Files of a folder that are maps."""

RATE_HZ = 100
"""Frames a second of the drive."""

EVERY = 10
"""Boxes are compared every so many frames."""

LIMIT_S = 600
"""A map that takes longer is stopped [s]; an exit code of its own tells it."""


@dataclass
class Row:
    """Figures of one map; None where the map did not get as far."""

    name: str
    import_s: float | None = None
    """Processor time of the import [s], which other work on the machine changes little."""
    memory_mb: float | None = None
    """Largest memory of the process up to the end of the import, Python's own included."""
    lanes: int | None = None
    errors: dict[str, int] | None = None
    """Rule of `mmw town check` -> errors."""
    asked: int | None = None
    """Vehicles of the printed configuration."""
    placed: int | None = None
    """Vehicles that are there in frame 0."""
    entered: int | None = None
    """Vehicles that come later."""
    left: int | None = None
    """Vehicles that are gone before the last frame."""
    overlaps: int | None = None
    """Pairs of vehicles whose boxes overlap."""
    standing: float | None = None
    """Share of the vehicles at the end that stand without a cause."""
    queued: float | None = None
    """Share that stand with one."""
    cavs_gone: int | None = None
    """CAVs that are not there in every frame."""
    rsu_m: float | None = None
    """Least distance of a vehicle's box from the roadside unit, from above [m]."""
    notes: list[str] = field(default_factory=list)
    """Notes of the import and of the traffic."""
    failed: str = ""
    """Reason of a failure; empty if all went well."""


def measure_map(path: Path, out: Path, seconds: float, options: Sequence[str]) -> Row:
    """Import, check and drive one map."""
    row = Row(path.name)
    step = "import"
    try:
        lines = _import(row, path, out, options)
        step = "check"
        _check(row, _written(lines))
        step = "drive"
        if row.lanes:
            _drive(row, lines, seconds)
    except InputError as error:
        row.failed = f"{step}: {error}"
    return row


def _import(row: Row, path: Path, out: Path, options: Sequence[str]) -> list[str]:
    from mmw.cli.import_scene import main as import_main

    printed, said = io.StringIO(), io.StringIO()
    start = time.process_time()
    with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(said):
        code = import_main([str(path), "--out", str(out / path.name.split(".")[0]), "--overwrite", *options])
    row.import_s = time.process_time() - start
    row.memory_mb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024  # kibibytes on Linux
    lines = printed.getvalue().splitlines()
    row.notes = [line.removeprefix("note: ") for line in lines if line.startswith("note: ")]
    if code:
        raise InputError((said.getvalue().strip().splitlines() or [f"exit code {code}"])[-1].removeprefix("mmw: "))
    count = next(line for line in lines if line.startswith("lanes: ")).removeprefix("lanes: ")
    row.lanes = 0 if count == "none" else int(count.replace(",", ""))
    return lines


def _written(lines: Sequence[str]) -> Path:
    return Path(next(line for line in lines if line.startswith("wrote ")).removeprefix("wrote "))


def _check(row: Row, stage: Path) -> None:
    from mmw.core.device import choose_device
    from mmw.worlds.checks.check import check_stage

    choose_device("cpu")
    found = check_stage(stage, {}).findings
    row.errors = dict(Counter(finding.rule for finding in found if finding.severity == "error"))


def _drive(row: Row, lines: Sequence[str], seconds: float) -> None:
    start = next(k for k, line in enumerate(lines) if line.strip() == "scenarios:")
    content = parse_yaml("\n".join(lines[start:]))
    frames = round(seconds * RATE_HZ)
    config = load_config({**content, "frames": {"count": frames, "rate_hz": RATE_HZ}})
    scenario = config.scenarios[0]
    if scenario.traffic is None or scenario.traffic.engine == "replay":
        raise InputError("no lane is long enough for simulated traffic")
    row.asked = scenario.traffic.vehicle_count
    catalog = load_catalog()
    tracks = make_tracks(config, scenario, scenario_source(scenario, Path()), catalog, Path(), row.notes.append)
    tracks = [track for track in tracks if track.role in ("cav", "vehicle")]
    for name, value in motion_figures(tracks, catalog).items():
        setattr(row, name, value)
    if scenario.rsus:
        place = np.array(scenario.rsus[0].position_m)
        row.rsu_m = round(nearest_box(tracks, catalog, place), 2)


def motion_figures(tracks: Sequence[VehicleTrack], catalog: Mapping[str, VehicleModel]) -> dict[str, Any]:
    """Return the figures of a drive by the names of `Row`."""
    there = np.stack([np.isfinite(track.poses).all(axis=1) for track in tracks])
    last = np.stack([track.poses[-1, :2] for track in tracks])
    speed = RATE_HZ * np.linalg.norm(last - np.stack([track.poses[-2, :2] for track in tracks]), axis=1)
    waits = np.array([track.waits is not None and bool(track.waits[-1]) for track in tracks])
    stands = there[:, -1] & (speed < STANDING)
    present = max(int(there[:, -1].sum()), 1)
    is_cav = np.array([track.role == "cav" for track in tracks])
    return {
        "placed": int(there[:, 0].sum()),
        "entered": int((~there[:, 0]).sum()),
        "left": int((~there[:, -1]).sum()),
        "overlaps": count_overlaps(tracks, catalog),
        "standing": round(float((stands & ~waits).sum() / present), 3),
        "queued": round(float((stands & waits).sum() / present), 3),
        "cavs_gone": int((is_cav & ~there.all(axis=1)).sum()),
    }


def boxes(
    tracks: Sequence[VehicleTrack], catalog: Mapping[str, VehicleModel]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the boxes of vehicles every `EVERY` frames.

    Returns:
        Middles [m], shape [K, V, 3]; headings [rad], shape [K, V]; length, width and height [m], shape [V, 3].
    """
    poses = np.stack([track.poses[::EVERY] for track in tracks], axis=1)
    x, y, z, w = np.moveaxis(poses[..., 3:], -1, 0)
    heading = np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
    models = [catalog[track.model] for track in tracks]
    offset = np.array([model.center for model in models])
    size = np.array([(model.length, model.width, model.height) for model in models])
    middle = poses[..., :3].copy()
    cos, sin = np.cos(heading), np.sin(heading)
    middle[..., 0] += offset[:, 0] * cos - offset[:, 1] * sin
    middle[..., 1] += offset[:, 0] * sin + offset[:, 1] * cos
    middle[..., 2] += offset[:, 2]
    return middle, heading, size


def count_overlaps(tracks: Sequence[VehicleTrack], catalog: Mapping[str, VehicleModel]) -> int:
    """Return how many pairs of vehicles overlap at some time."""
    middle, heading, size = boxes(tracks, catalog)
    found = 0
    for i in range(len(tracks)):
        for j in range(i + 1, len(tracks)):
            half = [(0.5 * float(size[k, 0]), 0.5 * float(size[k, 1])) for k in (i, j)]
            both = boxes_overlap(middle[:, i, :2], heading[:, i], half[0], middle[:, j, :2], heading[:, j], half[1])
            both &= np.abs(middle[:, i, 2] - middle[:, j, 2]) < 0.5 * (size[i, 2] + size[j, 2])
            found += bool(both.any())
    return found


def nearest_box(tracks: Sequence[VehicleTrack], catalog: Mapping[str, VehicleModel], place: np.ndarray) -> float:
    """Return the least distance of a place [3] from the boxes of vehicles, seen from above [m]; 0 inside."""
    middle, heading, size = boxes(tracks, catalog)
    away = place[:2] - middle[..., :2]
    along = np.abs(away[..., 0] * np.cos(heading) + away[..., 1] * np.sin(heading)) - 0.5 * size[:, 0]
    across = np.abs(away[..., 1] * np.cos(heading) - away[..., 0] * np.sin(heading)) - 0.5 * size[:, 1]
    return float(np.nanmin(np.hypot(np.maximum(along, 0.0), np.maximum(across, 0.0))))


def measure_folder(folder: Path, out: Path, seconds: float, options: Sequence[str], only: str = "*") -> list[Row]:
    """Measure every map of a folder, one after another, each in a process of its own."""
    rows = []
    for path in sorted(folder.glob(only)):
        if path.suffix not in SUFFIXES:
            continue
        command = [sys.executable, "-m", "bench.maps", str(path), "--out", str(out), "--seconds", str(seconds)]
        try:
            done = subprocess.run([*command, "--", *options], capture_output=True, text=True, timeout=LIMIT_S)
            lines = done.stdout.splitlines()
            if done.returncode or not lines:
                last = (done.stderr.strip().splitlines() or ["nothing was said"])[-1]
                rows.append(Row(path.name, failed=f"stopped with exit code {done.returncode}: {last}"))
            else:
                rows.append(Row(**json.loads(lines[-1])))
        except subprocess.TimeoutExpired:
            rows.append(Row(path.name, failed=f"took longer than {LIMIT_S} s"))
        print(table_line(rows[-1]), flush=True)
    return rows


HEADER = (
    "| map | import [s] | memory [MB] | lanes | errors | asked | placed | entered | left | overlaps | standing | "
    "queued | RSU [m] | failed |\n|---|---|---|---|---|---|---|---|---|---|---|---|---|---|"
)


def table_line(row: Row) -> str:
    """Return a row of the Markdown table."""
    errors = None if row.errors is None else ", ".join(f"{rule} {n}" for rule, n in sorted(row.errors.items())) or "0"
    cells = [
        row.name, _text(row.import_s, ".1f"), _text(row.memory_mb, ".0f"), _text(row.lanes), _text(errors),
        _text(row.asked), _text(row.placed), _text(row.entered), _text(row.left), _text(row.overlaps),
        _text(row.standing, ".0%"), _text(row.queued, ".0%"), _text(row.rsu_m, ".1f"), row.failed.replace("|", "\\|"),
    ]  # fmt: skip
    return f"| {' | '.join(cells)} |"


def _text(value: Any, form: str = "") -> str:
    return "-" if value is None else format(value, form)


def summary(rows: Sequence[Row]) -> str:
    """Return the counts of a table in one line."""
    driven = [row for row in rows if row.placed is not None]
    clean = sum(row.errors == {} for row in rows)
    return (
        f"{len(rows)} maps: {sum(row.lanes is not None for row in rows)} import, {clean} without errors of the check; "
        f"{len(driven)} drive, {sum(not row.overlaps for row in driven)} without overlaps, "
        f"{sum((row.standing or 0.0) <= 0.1 for row in driven)} with at most 10 % standing; "
        f"{sum(bool(row.failed) for row in rows)} failed"
    )


def main(argv: Sequence[str] | None = None) -> None:
    """Measure a folder of maps, or print the row of one map as JSON."""
    arguments = list(sys.argv[1:] if argv is None else argv)
    cut = arguments.index("--") if "--" in arguments else len(arguments)
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("maps", type=Path, help="folder of maps, or one map")
    parser.add_argument("--out", type=Path, required=True, help="folder for tables and imported maps")
    parser.add_argument("--seconds", type=float, default=10.0, help="length of the drive")
    parser.add_argument("--only", default="*", metavar="GLOB", help="names of the maps")
    given = parser.parse_args(arguments[:cut])
    options = arguments[cut + 1 :]
    given.out.mkdir(parents=True, exist_ok=True)
    if given.maps.is_file():
        print(json.dumps(asdict(measure_map(given.maps, given.out, given.seconds, options))))
        return
    print(HEADER)
    rows = measure_folder(given.maps, given.out, given.seconds, options, given.only)
    text = "\n".join([HEADER, *map(table_line, rows), "", summary(rows), ""])
    (given.out / "maps.json").write_text(json.dumps([asdict(row) for row in rows], indent=1))
    (given.out / "maps.md").write_text(text)
    print(summary(rows))


if __name__ == "__main__":
    main()
