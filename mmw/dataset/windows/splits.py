"""Splits of windows for training and test that share no frame.

All agents and all weathers of a frame show the same place, traffic and geometry, so a frame of a scenario belongs to
one part whatever the agent and the weather; only a split by weather shares frames, by definition.
What a window uses reaches from its oldest sample to its last future frame.
"""

import zlib
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np

from mmw.core.errors import InputError
from mmw.dataset import Dataset
from mmw.dataset.windows.windows import Windows

Parts = Mapping[str, float | Sequence[str]]
"""Name of each part -> its share (above 0), or its scenarios, towns or weathers."""


def split_windows(
    windows: Windows,
    by: Literal["track", "time", "scenario", "town", "weather"],
    parts: Parts,
    *,
    seed: int = 0,
    gap: int | None = None,
    blocks: int = 1,
) -> dict[str, Windows]:
    """Return the windows of each part; the same arguments give the same parts.

    Args:
        windows: The windows to split.
        by: `track`: the frames of every scenario are cut into blocks, in an order that the seed decides; windows that
            reach out of their block are dropped. `time`: the same in the order of `parts`, so that of two parts the
            one that is named later is later in time too. `scenario`, `town`, `weather`: these go as a whole.
        parts: Shares, which are scaled to 1; or, but by track and time, the names of a part (those of no part
            are dropped).
        seed: Seed of the order; by time it decides nothing.
        gap: By track and time: frames that no part uses between two blocks; None: as many as the longest window uses.
        blocks: By track and time: blocks that every part has in a scenario; by time they take turns.

    Raises:
        InputError: If a part gets no window, or an argument is out of range.

    Examples:
        >>> from mmw.dataset.windows import WindowSpec, open_windows
        >>> spec = WindowSpec(["poses"], past=1)
        >>> windows = open_windows("out/quickstart", spec, weathers=["sunny"], agents=["cav"])
        >>> parts = split_windows(windows, by="track", parts={"train": 0.5, "test": 0.5}, gap=0)
        >>> shared_frames(parts["train"], parts["test"])
        []
    """
    if by not in ("track", "time", "scenario", "town", "weather"):
        raise InputError(f"split_windows: by = {by!r}; it is track, time, scenario, town or weather")
    if not parts or not len(windows):
        raise InputError(f"split_windows: {len(windows)} windows, {len(parts)} parts; both are needed")
    shares = {name: float(share) for name, share in parts.items() if isinstance(share, int | float)}
    if shares and len(shares) < len(parts):
        raise InputError("split_windows: parts mix shares and names; give shares alone or names alone")
    if any(not (share > 0.0 and np.isfinite(share)) for share in shares.values()):
        raise InputError(f"split_windows: shares {shares}; each is above 0")
    if by in ("track", "time"):
        if not shares:
            raise InputError(f"split_windows: by {by} needs shares, such as {{'train': 0.8, 'test': 0.2}}")
        chosen = _by_time(windows, shares, seed if by == "track" else None, gap, blocks)
    else:
        if gap is not None or blocks != 1:
            raise InputError(
                f"split_windows: gap and blocks are of a split by track or time; by {by} has no use for them"
            )
        values = _values(windows, by)
        names = _assign(values, shares, seed) if shares else _named(values, parts, by)
        chosen = {part: np.isin(values, some) for part, some in names.items()}
    for part, mask in chosen.items():
        if not mask.any():
            raise InputError(
                f"split_windows: part {part!r} gets no window of {len(windows)} by {by}; shorten the windows or the "
                "gap, use fewer parts or blocks, a larger share, or split by something else"
            )
    return {part: windows.select(chosen[part]) for part in parts}


def shared_frames(one: Windows, other: Windows) -> list[tuple[str, int]]:
    """Return the scenarios and frames that windows of both use, in whatever weather and for whatever agent."""
    found = []
    sides = [(part, part.of_track(lambda track: track.scenario)) for part in (one, other)]
    for scenario in np.unique(np.concatenate([names for _, names in sides])):
        used = []
        for part, names in sides:
            own = np.flatnonzero(names == scenario)
            frames = [np.arange(first, last + 1) for first, last in zip(part.first[own], part.last[own], strict=True)]
            used.append(np.unique(np.concatenate([np.zeros(0, dtype=np.int64), *frames])))
        found += [(str(scenario), int(frame)) for frame in np.intersect1d(*used)]
    return found


def _by_time(
    windows: Windows, shares: Mapping[str, float], seed: int | None, gap: int | None, blocks: int
) -> dict[str, np.ndarray]:
    """Return a mask of the windows in the blocks of each part, in an order by the seed; None: that of the parts."""
    gap = int((windows.last - windows.first).max()) + 1 if gap is None else gap
    if gap < 0 or blocks < 1:
        raise InputError(f"split_windows: gap = {gap}, blocks = {blocks}; gap is at least 0, blocks 1")
    chosen = {part: np.zeros(len(windows), dtype=bool) for part in shares}
    names = windows.of_track(lambda track: track.scenario)
    for scenario in sorted({track.scenario for track in windows.tracks}):
        tracks = [track.frames for track in windows.tracks if track.scenario == scenario]
        frames = np.unique(np.concatenate(tracks))
        of_scenario = names == scenario
        rng = None if seed is None else np.random.default_rng([seed, zlib.crc32(scenario.encode())])
        for part, first, last in _blocks(frames, shares, rng, gap, blocks):
            chosen[part] |= of_scenario & (windows.first >= first) & (windows.last <= last)
    return chosen


def _blocks(
    frames: np.ndarray, shares: Mapping[str, float], rng: np.random.Generator | None, gap: int, blocks: int
) -> list[tuple[str, int, int]]:
    """Return part, first and last frame of each block of one scenario's frames; nothing if it is too short."""
    parts = list(shares)
    numbers = range(len(parts))
    order = [parts[n] for _ in range(blocks) for n in (numbers if rng is None else rng.permutation(len(parts)))]
    joined: list[tuple[str, float]] = []  # neighbors of one part are one block
    for part in order:
        if joined and joined[-1][0] == part:
            joined[-1] = part, joined[-1][1] + shares[part]
        else:
            joined.append((part, shares[part]))
    left = len(frames) - gap * (len(joined) - 1)
    if left < len(joined):
        return []
    ends = np.rint(np.cumsum([share for _, share in joined]) / (sum(shares.values()) * blocks) * left).astype(int)
    found = []
    for number, (part, _) in enumerate(joined):
        first, last = (ends[number - 1] if number else 0) + gap * number, ends[number] + gap * number - 1
        if first <= last:
            found.append((part, int(frames[first]), int(frames[last])))
    return found


def _values(windows: Windows, by: str) -> np.ndarray:
    """Return scenario, town or weather of every window, shape [n]."""
    if by == "weather":
        return windows.of_track(lambda track: track.weather)
    if by == "scenario":
        return windows.of_track(lambda track: track.scenario)
    towns = town_names(windows.dataset)
    lost = sorted({track.scenario for track in windows.tracks} - set(towns))
    if lost:
        raise InputError(
            f"{windows.dataset.root}: dataset.json has no town of {', '.join(lost)}; split by scenario instead"
        )
    return windows.of_track(lambda track: towns[track.scenario])


def town_names(dataset: Dataset) -> dict[str, str]:
    """Return the town of every scenario, or its stage where that is the user's own, as in `dataset.json`."""
    scenarios = dataset.info["config"].get("scenarios") or []
    return {one["name"]: str(one.get("stage") or one.get("town")) for one in scenarios}


def _assign(values: np.ndarray, shares: Mapping[str, float], seed: int) -> dict[str, list[str]]:
    """Return the names of each part: one for each, by chance, then each name where most windows are missing.

    Raises:
        InputError: If there are fewer names than parts.
    """
    names, counts = np.unique(values, return_counts=True)
    if len(names) < len(shares):
        listed = ", ".join(names.tolist())
        raise InputError(f"split_windows: {len(shares)} parts of {len(names)} names ({listed}); use fewer parts")
    order = np.random.default_rng(seed).permutation(len(names))
    found: dict[str, list[str]] = {part: [] for part in shares}
    missing = {part: share / sum(shares.values()) * len(values) for part, share in shares.items()}
    largest = sorted(shares, key=lambda part: -shares[part])
    for place, number in enumerate(order):
        part = largest[place] if place < len(largest) else max(missing, key=lambda part: missing[part])
        found[part].append(str(names[number]))
        missing[part] -= counts[number]
    return found


def _named(values: np.ndarray, parts: Parts, by: str) -> dict[str, list[str]]:
    """Return the names of each part as they are given.

    Raises:
        InputError: If a name is not there, or in two parts.
    """
    found = {part: [some] if isinstance(some, str) else list(some) for part, some in parts.items()}
    given = [name for some in found.values() for name in some]
    known = np.unique(values).tolist()
    wrong = sorted({name for name in given if name not in known or given.count(name) > 1})
    if wrong:
        raise InputError(
            f"split_windows: {by} {', '.join(wrong)} is not there or in two parts; there are {', '.join(known)}; name "
            "each of these at most once"
        )
    return found
