"""Find and split the windows by `mmw.dataset.windows`, with sensors that are slower than the frames."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pyarrow as pa

from examples.beam_prediction.config import FeatureConfig, RadioConfig, WindowConfig
from mmw.core.errors import InputError
from mmw.dataset import Dataset
from mmw.dataset.windows import Feature, Windows, WindowSpec, open_windows, shared_frames, split_windows


def find_windows(dataset: Dataset, radio: RadioConfig, config: WindowConfig, features: FeatureConfig) -> Windows:
    """Return all windows of all vehicles.

    A frame has the latest sensor sample at or before it, one every `every_frames`. So a window uses frames from the
    oldest of its samples, which `first` counts for the split.

    Args:
        dataset: The dataset.
        radio: The link.
        config: Weathers, length and stride of windows.
        features: How often sensors are sampled.
    """
    path_count = Feature("links", columns=("path_count",), carrier_hz=radio.carrier_hz)
    spec = WindowSpec([path_count], config.past, config.future, config.stride)
    return with_oldest_sample(open_windows(dataset, spec, weathers=config.weathers, agents=["cav"]), features)


def with_oldest_sample(windows: Windows, features: FeatureConfig) -> Windows:
    """Return the windows with the frame of their oldest sample as the first one; those without it are left out."""
    first = windows.now - (windows.spec.past - 1)
    oldest = first - first % features.every_frames
    begins = np.array([track.first for track in windows.tracks])[windows.track]
    return replace(windows, first=oldest).select(oldest >= begins)


def split(windows: Windows, config: WindowConfig) -> dict[str, Windows]:
    """Return the windows for `train` and for `val`.

    They share no frame of any scenario, unless they are dealt out singly: then nearly all of what is validated was
    trained, which shows what such a split is worth.

    Raises:
        InputError: If one of them gets no window.
    """
    parts = {"train": config.train, "val": config.val}
    if config.split == "window":
        return deal(windows, parts, config.seed)
    gap = {"gap": config.gap} if config.split == "track" else {}
    found = split_windows(windows, config.split, parts, seed=config.seed, **gap)
    shared = shared_frames(found["train"], found["val"])
    if shared:
        raise RuntimeError(f"split: {len(shared)} frames are in both parts, the first {shared[0]}")
    return found


def deal(windows: Windows, parts: Mapping[str, float], seed: int) -> dict[str, Windows]:
    """Return windows dealt out singly and at random, in shares.

    Raises:
        InputError: If a part gets no window.
    """
    order = np.random.default_rng(seed).permutation(len(windows))
    ends = np.rint(np.cumsum(list(parts.values())) / sum(parts.values()) * len(windows)).astype(int)
    chosen = dict(zip(parts, np.split(order, ends[:-1]), strict=True))
    empty = [name for name, rows in chosen.items() if not len(rows)]
    if empty:
        raise InputError(f"split: part {empty[0]!r} gets none of {len(windows)} windows; give it a larger share")
    return {name: windows.select(np.sort(rows)) for name, rows in chosen.items()}


def window_table(parts: dict[str, Windows], mark: str = "") -> pa.Table:
    """Return `part`, scenario, weather, agent and `now` of the windows of all parts.

    Args:
        parts: The windows of each part.
        mark: What the names of scenarios end with.
    """
    rows: dict[str, list] = {name: [] for name in ("part", "scenario", "weather", "agent", "now")}
    for part, windows in parts.items():
        for number, now in zip(windows.track.tolist(), windows.now.tolist(), strict=True):
            track = windows.tracks[number]
            scenario, weather, agent = track.name
            for name, value in zip(rows, (part, scenario + mark, weather, agent, now), strict=True):
                rows[name].append(value)
    return pa.table(rows)
