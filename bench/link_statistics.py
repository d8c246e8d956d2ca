"""Measure how links live in each preset of the physics: outage, paths, births, jumps, spreads, reflections at poles.

    python -m bench.link_statistics --json docs/reference/data/channel_statistics.json
        [--physics paper standard full --frames 40 --bursts 1 --rate-hz 100 --scenarios town03_roundabout ...]

Prints a line of JSON for each scenario, preset and carrier, in dry weather. With `--json` the lines are stored in the
file, in place of its lines of the same scenario, preset, rate and carrier: several calls fill one file, of which
`python -m bench.link_statistics_page` makes `docs/reference/channel-statistics.md`.
"""

import argparse
import json
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock

from mmw import load_config, load_scene
from mmw.channel import statistics as st
from mmw.channel.links import Links, make_links
from mmw.channel.path_solver.solver import solve_paths
from mmw.channel.path_solver.surface_table import make_surface_table
from mmw.channel.path_table import SAMPLE_COLUMNS, CarrierPaths, rows_from_paths
from mmw.channel.path_tracks import LINK_NAMES, PathTracks, tracks_from_rows
from mmw.channel.paths import LOS_STATES, PATH_DIFFUSE, PathSet
from mmw.channel.track_statistics import (
    continues_old_path,
    fine_steps_db,
    level_steps_db,
    median_lifetime,
    sample_rows,
    survival,
)
from mmw.config.physics_presets import PHYSICS_PRESETS
from mmw.core.constants import FRAME_RATE_HZ, SPEED_OF_LIGHT
from mmw.physics.em.interaction import SPECULAR
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData

Record = dict[str, Any]

WEATHER = "sunny"

SAME_LENGTH_M_S = 10.0
"""Largest rate at which the length of what counts as one path changes between two frames [m/s]."""

SAME_WAVE_RAD = np.radians(1.0)
"""Largest change of the directions of departure and arrival of what counts as one wave: 0.2 m at 10 m."""

JUMP_DB = 3.0
"""Change of the level of one path from frame to frame that counts as a jump [dB]."""

GRADUAL_DB = 1.5
"""A jump without a larger change than this between finer frames is gradual [dB]."""

RANGE_DB = 40.0
"""Births and steps of paths weaker than the strongest of their link by more do not count [dB]: the range of presets."""

BELOW_DB = 15.0
"""Lives are those of paths that are weaker by up to this more [dB]: a path that comes above the range is not born."""

STRONG_DB = 20.0
"""Paths within this of the strongest of their link are strong [dB]."""

PERCENTILES = (10, 50, 90)

KEY = ("scenario", "physics", "rate_hz", "carrier_hz")

DIGITS = 4
"""Significant digits of stored numbers."""


def lives(paths: CarrierPaths, path_id: np.ndarray, is_diffuse: np.ndarray, rate_hz: int) -> Record:
    """Return how paths live over successive frames, and with more than `FRAME_RATE_HZ` also as those would show them.

    Diffuse ones, which exist in one frame each, are left out. Births count of paths within `RANGE_DB` of the strongest
    of their link, steps where both levels are. A path that a birth continues was within `BELOW_DB` more.

    Args:
        paths: Paths of one carrier, weaker ones too where a preset leaves them out.
        path_id: Identifier of each, shape [P].
        is_diffuse: Whether each is diffuse, shape [P].
        rate_hz: Frames a second.
    """
    strongest = np.zeros(paths.link_count)
    np.maximum.at(strongest, paths.link, np.abs(paths.a))
    kept = np.flatnonzero(~is_diffuse)
    columns = {name: getattr(paths, name)[kept] for name in SAMPLE_COLUMNS}
    own = replace(paths, link=paths.link[kept], **columns)
    relative = np.abs(own.a) / strongest[own.link]
    tracks, level = _tracks(own, relative, path_id, rate_hz)
    begin, end = tracks.offset[:-1], tracks.offset[1:] - 1
    births = tracks.is_birth & ~_begins_with_link(tracks, paths)
    is_strong = level > 10.0 ** (-STRONG_DB / 20.0)
    ends = (births & is_strong[begin]).sum() + (tracks.is_death & is_strong[end]).sum()
    births &= level[begin] > 10.0 ** (-RANGE_DB / 20.0)
    same_s = SAME_LENGTH_M_S / rate_hz / SPEED_OF_LIGHT
    survivors = survival(tracks, births)
    is_one_wave = continues_old_path(tracks, same_s, SAME_WAVE_RAD)
    out = {
        "births": int(births.sum()),
        "births_per_link_frame": births.sum() / paths.link_count,
        "births_that_continue": _share(continues_old_path(tracks, same_s)[births]),
        "births_of_one_wave": _share(is_one_wave[births]),
        "jumps": _share(np.abs(level_steps_db(tracks))[_is_heard(tracks, level)] > JUMP_DB),
        "strong_ends_per_s": ends / paths.link_count * rate_hz,
        "lives_of_one_frame": 1.0 - survivors[1] if births.any() else None,
        "median_life_s": median_lifetime(tracks, births),
        "survivors_at_end": survivors[-1] if births.any() else None,
    }
    if rate_hz > FRAME_RATE_HZ and rate_hz % FRAME_RATE_HZ == 0:
        out |= thinned_lives(own, relative, path_id, tracks, is_one_wave)
    return out


def thinned_lives(
    paths: CarrierPaths, relative: np.ndarray, path_id: np.ndarray, fine: PathTracks, is_one_wave: np.ndarray
) -> Record:
    """Return how paths live over every n-th frame, 1 / `FRAME_RATE_HZ` apart, and what the frames in between tell.

    A jump is gradual where no change from a frame to the next in between is larger than `GRADUAL_DB`, and holds a step
    where one is larger than `JUMP_DB`; it is abrupt where the amplitude does not change like that before or after, as
    it does in a null. A birth that continues an ended wave is a renamed path where it does so from a
    frame to the next, too; the others are paths of their own, that were there at the same time or not at all.

    Args:
        paths: Paths of all frames.
        relative: Level of each over that of the strongest of its link, shape [P].
        path_id: Identifier of the path of each row, see `CarrierPaths.row`.
        fine: Tracks of all frames.
        is_one_wave: Whether each of these goes on from another one, shape [K].
    """
    step = fine.rate_hz // FRAME_RATE_HZ
    change, within, abrupt, born, goes_on, renamed = ([] for _ in range(6))
    for phase in range(step):
        is_own = paths.keys["frame"] % step == phase
        own = paths.take(is_own)
        tracks, level = _tracks(own, relative[is_own[paths.link]], path_id, fine.rate_hz, step)
        heard = _is_heard(tracks, level)
        change.append(np.abs(level_steps_db(tracks))[heard])
        within.append(fine_steps_db(tracks, fine)[heard])
        abrupt.append(fine_steps_db(tracks, fine, abrupt=True)[heard])
        begin = tracks.offset[:-1]
        births = tracks.is_birth & ~_begins_with_link(tracks, own) & (level[begin] > 10.0 ** (-RANGE_DB / 20.0))
        same_s = SAME_LENGTH_M_S / FRAME_RATE_HZ / SPEED_OF_LIGHT
        born.append(births.sum())
        one_wave = np.flatnonzero(continues_old_path(tracks, same_s, SAME_WAVE_RAD) & births)
        row = sample_rows(fine, tracks, one_wave, tracks.birth[one_wave])
        goes_on.append(len(one_wave))
        renamed.append(is_one_wave[fine.track[row]].sum())
    jump, births = np.concatenate(change) > JUMP_DB, sum(born)
    largest = np.concatenate(within)[jump]
    return {
        "thinned_jumps": _share(jump),
        "thinned_jumps_gradual": _share(largest < GRADUAL_DB),
        "thinned_jumps_with_step": _share(largest > JUMP_DB),
        "thinned_jumps_abrupt": _share(np.concatenate(abrupt)[jump] > JUMP_DB),
        "thinned_births_of_one_wave": sum(goes_on) / births if births else None,
        "thinned_births_renamed": sum(renamed) / births if births else None,
    }


def _tracks(
    paths: CarrierPaths, relative: np.ndarray, path_id: np.ndarray, rate_hz: int, step: int = 1
) -> tuple[PathTracks, np.ndarray]:
    """Return the tracks of paths, and the level of each sample over the strongest path of its link."""
    own = path_id[paths.row]
    level = tracks_from_rows(replace(paths, a=relative.astype(complex)), own, rate_hz=rate_hz, step=step).a
    return tracks_from_rows(paths, own, rate_hz=rate_hz, step=step), np.abs(level)


def _is_heard(tracks: PathTracks, level: np.ndarray) -> np.ndarray:
    """Return which changes of `level_steps_db` are between two samples within `RANGE_DB` of the strongest, [S - K]."""
    is_heard = level > 10.0 ** (-RANGE_DB / 20.0)
    is_step = np.ones(max(len(level) - 1, 0), dtype=bool)
    is_step[tracks.offset[1:-1] - 1] = False
    return (is_heard[:-1] & is_heard[1:])[is_step]


def _begins_with_link(tracks: PathTracks, paths: CarrierPaths) -> np.ndarray:
    """Return True for tracks that begin in the first frame of their link, whose paths before are not known."""
    first: dict[tuple[str, ...], int] = {}
    for key in paths.keys:
        name = tuple(key[part] for part in LINK_NAMES)
        first[name] = min(int(key["frame"]), first.get(name, int(key["frame"])))
    names = list(zip(*(getattr(tracks, part) for part in LINK_NAMES), strict=True))
    return tracks.birth == np.array([first[name] for name in names], dtype=np.int64)[tracks.link]


def dispersion(paths: CarrierPaths) -> Record:
    """Return percentiles over the links that have a path: number of paths, K-factors, spreads of delay and angles."""
    values = {
        "paths": paths.path_count,
        "k_los_db": _db(st.k_factor(paths)),
        "k_strongest_db": _db(st.k_factor_of_strongest(paths)),
        "k_moments_db": _db(st.k_factor_by_moments(paths)),
        "delay_spread_ns": 1e9 * st.rms_delay_spread(paths),
        "azimuth_departure_deg": np.degrees(st.azimuth_spread(paths, "tx")),
        "azimuth_arrival_deg": np.degrees(st.azimuth_spread(paths, "rx")),
        "zenith_departure_deg": np.degrees(st.zenith_spread(paths, "tx")),
        "zenith_arrival_deg": np.degrees(st.zenith_spread(paths, "rx")),
    }
    is_heard = np.isfinite(st.path_loss_db(paths))
    out: Record = {"links": int(is_heard.sum())}
    if is_heard.any():  # a percentile that is itself a value: between a number and infinity there is none
        for name, each in values.items():
            out[name] = np.percentile(each[is_heard], PERCENTILES, method="inverted_cdf").tolist()
    return out


def _db(ratio: np.ndarray) -> np.ndarray:
    with np.errstate(divide="ignore"):
        return 10.0 * np.log10(ratio)


def _share(values: np.ndarray) -> float | None:
    return float(values.mean()) if len(values) else None


def pole_levels(data: SceneData, paths: PathSet, carrier: int) -> np.ndarray:
    """Return the levels of reflections at poles and traffic lights over free space of their length [dB]."""
    labels = np.array([item.label for item in data.objects])
    own = (paths.order == 1) & (paths.interaction[:, 0] == SPECULAR)
    own &= np.isin(labels[np.maximum(paths.object_id[:, 0], 0)], ("pole", "traffic_light"))
    free = SPEED_OF_LIGHT / paths.carriers_hz[carrier] / (4.0 * np.pi * paths.tau[own] * SPEED_OF_LIGHT)
    level = np.abs(paths.transfer[WEATHER][own, carrier]).max(axis=(1, 2))
    return 20.0 * np.log10(np.maximum(level / free, 1e-12))


def statistics_of(data: SceneData, links: Links, paths: PathSet, wide: PathSet, rate_hz: int) -> list[Record]:
    """Return the statistics of links at each carrier.

    Args:
        data: The scene.
        links: Links of successive frames.
        paths: Their paths.
        wide: These and weaker ones, whose lives count.
        rate_hz: Frames a second.
    """
    state = paths.los_state(WEATHER)
    shares = {name: float((state == row).mean()) for row, name in enumerate(LOS_STATES)}
    has_sight = state != LOS_STATES.index("blocked")
    out = []
    for number, carrier in enumerate(paths.carriers_hz):
        rows, all_rows = (rows_from_paths(links, own, WEATHER, carrier) for own in (paths, wide))
        poles = pole_levels(data, paths, number)
        out.append(
            {
                "carrier_hz": float(carrier),
                "links": len(links),
                "without_path": float((paths.count == 0).mean()),
                **shares,
                "distance_m": float(np.median(np.linalg.norm((links.rx.position - links.tx.position)[:, :2], axis=1))),
                **lives(all_rows, wide.path_id, wide.kind == PATH_DIFFUSE, rate_hz),
                "los": dispersion(rows.take(has_sight)),
                "nlos": dispersion(rows.take(~has_sight)),
                "pole_paths": len(poles),
                "pole_level_db": float(np.median(poles)) if len(poles) else None,
            }
        )
    return out


def burst_frames(frames: np.ndarray, length: int, bursts: int) -> list[int]:
    """Return bursts of successive frames, spread evenly over a scenario.

    Args:
        frames: Frames of the scenario, growing, shape [F].
        length: Frames of a burst.
        bursts: Number of bursts; the first begins with the scenario, the last of several ends with it.

    Raises:
        ValueError: If the scenario has too few frames.
    """
    if length * bursts > len(frames):
        raise ValueError(f"{bursts} bursts of {length} frames; the scenario has {len(frames)}: ask for fewer")
    begins = np.linspace(0, len(frames) - length, bursts).astype(int)
    return [int(frame) for begin in begins for frame in frames[begin : begin + length]]


def measure(scenario: str, physics: str, length: int, bursts: int, device: str, rate_hz: int = 100) -> list[Record]:
    """Return the statistics of a scenario of the paper over bursts of successive frames, a record for each carrier."""
    whole = load_config("full", [f"channel.physics={physics}", f"frames.rate_hz={rate_hz}"])
    scene = load_scene(whole, scenario=scenario, weather=[WEATHER], device=device)
    data = scene.arrays
    frames = burst_frames(data.frames, length, bursts)
    on_device = DeviceScene(data, scene.device, len(frames))
    on_device.load_batch(frames)
    config = whole.channel
    links = make_links(data, frames, config)
    table = make_surface_table(on_device, **config.surface_options)

    range_db = None if config.diffuse_reflection else config.dynamic_range_db
    own = config if range_db is None else config.model_copy(update={"dynamic_range_db": range_db + BELOW_DB})
    began = time.perf_counter()
    wide = solve_paths(on_device, links, own, data.materials, table, air=scene.weathers)
    seconds = {"solve_s": time.perf_counter() - began}
    paths = wide if range_db is None else wide.take(wide.rows_within(range_db))  # the same as of a solve to that range
    head = {"scenario": scenario, "physics": physics, "rate_hz": rate_hz, "frames": length, "bursts": bursts}
    return [_plain({**head, **own, **seconds}) for own in statistics_of(data, links, paths, wide, rate_hz)]


def _plain(value: Any) -> Any:
    """Return a value as JSON has it: floats of a few digits, `inf` and `-inf` as text, NaN as null."""
    if isinstance(value, dict):
        return {name: _plain(own) for name, own in value.items()}
    if isinstance(value, list):
        return [_plain(own) for own in value]
    if isinstance(value, float):
        if np.isnan(value):
            return None
        return float(f"{value:.{DIGITS}g}") if np.isfinite(value) else str(float(value))
    return value


def store(file: Path, records: list[Record]) -> None:
    """Write records into a file, in place of those of the same scenario, preset, rate and carrier, sorted by these."""
    with FileLock(Path(tempfile.gettempdir()) / f"{file.name}.lock"):  # several calls may fill one file
        old = json.loads(file.read_text())["records"] if file.exists() else []
        by_key = {tuple(own[name] for name in KEY): own for own in [*old, *records]}
        lines = ",\n".join(json.dumps(by_key[key]) for key in sorted(by_key))
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(f'{{"records": [\n{lines}\n]}}\n')


def main() -> None:
    """Print the statistics, and store them."""
    names = [scenario.name for scenario in load_config("full").scenarios]
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--physics", nargs="+", default=list(PHYSICS_PRESETS), choices=list(PHYSICS_PRESETS))
    parser.add_argument("--scenarios", nargs="+", default=names, choices=names, metavar="NAME")
    parser.add_argument("--frames", type=int, default=40, help="successive frames of a burst")
    parser.add_argument("--bursts", type=int, default=1, help="bursts, spread over each scenario")
    parser.add_argument("--rate-hz", type=int, default=100, help="frames a second")
    parser.add_argument("--device", default="auto", help="auto, cpu or cuda:N")
    parser.add_argument("--json", type=Path, help="file that the statistics are stored in")
    options = parser.parse_args()
    for scenario in options.scenarios:
        for physics in options.physics:
            records = measure(scenario, physics, options.frames, options.bursts, options.device, options.rate_hz)
            for record in records:
                print(json.dumps(record), flush=True)
            if options.json is not None:
                store(options.json, records)


if __name__ == "__main__":
    main()
