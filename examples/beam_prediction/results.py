"""Read the predictions of runs and baselines, and score them window by window."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor

from examples.beam_prediction.baselines import extrapolate, hold_last, recall
from examples.beam_prediction.data import BeamData
from examples.beam_prediction.metrics import Scores, score
from examples.beam_prediction.training import METRICS, PREDICTIONS
from mmw.core.errors import InputError

LABELS = {
    "last": "last beam",
    "line": "extrapolated angle",
    "known": "extrapolated true angle",
    "near": "nearest window, index only",
    "near_all": "nearest window, all inputs",
    "gru": "GRU, index only",
    "index": "index only",
    "camera": "index + camera",
    "lidar": "index + LiDAR",
    "all": "index + LiDAR + camera",
}
"""Method -> its name, in the order of tables and legends."""

BASELINES = ("last", "line", "known", "near", "near_all")
"""Keys of `LABELS` that are not learned. `known` is told past directions to a part of a beam, as no method is: what is
left of it to 1 is what the future brings that no straight line foresees. `near` remembers windows of training."""


@dataclass(frozen=True, eq=False)
class Method:
    """One compared method on the validation windows."""

    label: str
    """A key of `LABELS`."""
    seeds: tuple[int, ...]
    """Seeds of its runs; (0,) where nothing is learned."""
    beams: np.ndarray
    """Likeliest beam of every seed, window and step, shape [seeds, n, W], int64."""
    scores: tuple[Scores, ...]
    """One for each seed."""
    metrics: tuple[dict[str, Any], ...]
    """`metrics.json` of its runs; empty where nothing is learned."""

    def per_step(self, name: str) -> np.ndarray:
        """Return the mean of a score (`top1`, `top3`, `top5`, `gain`) over windows, shape [seeds, W]."""
        return np.array([one.rows()[name] for one in self.scores])

    @property
    def window_gain(self) -> np.ndarray:
        """Normalized gain of every window and step, mean over seeds, shape [n, W]."""
        return np.mean([one.gain for one in self.scores], axis=0)


def read_methods(out: Path, data: BeamData) -> dict[str, Method]:
    """Return the baselines and all finished runs of a folder, in the order of `LABELS`.

    Args:
        out: The folder.
        data: Whose validation windows were predicted.

    Raises:
        InputError: If a run predicted other windows.
    """
    frames = data.future_frames(data.starts["val"])
    target, gains = data.tx_beam[frames].cpu().numpy(), data.gains[frames].cpu().numpy()
    found: dict[str, list[tuple[int, np.ndarray, dict]]] = {}
    for label in BASELINES:
        found[label] = [(0, baseline(label, data).cpu().numpy()[..., None], {})]
    for file in sorted((out / "runs").glob(f"*/{METRICS}")):
        metrics = json.loads(file.read_text())
        beams = np.load(file.with_name(PREDICTIONS))["beams"]
        if beams.shape[:2] != target.shape:
            raise InputError(f"{file.parent}: predicted {beams.shape[0]} windows, there are {len(target)}; train anew")
        found.setdefault(metrics["label"], []).append((metrics["seed"], beams, metrics))
    methods = {}
    for label in LABELS:
        runs = sorted(found.get(label, []), key=lambda run: run[0])
        if runs:
            scores = tuple(score(beams, target, gains) for _, beams, _ in runs)
            first = np.stack([beams[..., 0].astype(np.int64) for _, beams, _ in runs])
            learned = tuple(metrics for _, _, metrics in runs if metrics)
            methods[label] = Method(label, tuple(seed for seed, _, _ in runs), first, scores, learned)
    return methods


def drives_of(data: BeamData) -> np.ndarray:
    """Return the drive, a vehicle in a scenario and weather, of each validation window as numbers from 0, shape [n]."""
    number: dict[tuple[str, str, str], int] = {}
    return np.array([number.setdefault(data.track[start], len(number)) for start in data.starts["val"].tolist()])


def baseline(label: str, data: BeamData) -> Tensor:
    """Return the beams that a baseline names for the validation windows, shape [n, W], int64.

    Args:
        label: One of `BASELINES`.
        data: The data.
    """
    starts = data.starts["val"]
    past = data.batch(starts, ()).beams
    if label == "last":
        return hold_last(past, data.future, data.beams)
    if label in ("near", "near_all"):
        return recall(data, tuple(data.sensors) if label == "near_all" else ())
    frames = starts[:, None] + torch.arange(data.past, device=data.device)
    return extrapolate(past, data.future, data.beams, data.angle[frames] if label == "known" else None)


def spread_text(values: np.ndarray, digits: int = 4) -> str:
    """Return the mean over seeds and, of several, the standard deviation of a single one.

    Args:
        values: One for each seed.
        digits: Digits after the point.
    """
    text = f"{np.mean(values):.{digits}f}"
    return text if len(values) < 2 else f"{text} ± {np.std(values, ddof=1):.{digits}f}"
