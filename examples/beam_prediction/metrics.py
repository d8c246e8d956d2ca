"""How good predicted beams are: top-k accuracy and normalised gain, a step at a time."""

from dataclasses import dataclass

import numpy as np

TOP = (1, 3, 5)
"""k of the top-k accuracies."""

LIKELY = max(TOP)
"""Beams that are kept of every prediction."""


@dataclass(frozen=True, eq=False)
class Scores:
    """Scores of n windows and W steps; NaN where the frame has no path, so that no beam is right or wrong."""

    hits: dict[int, np.ndarray]
    """k -> 1 where the best beam is among the k likeliest, else 0, shape [n, W]."""
    gain: np.ndarray
    """Normalised gain of the likeliest beam, 0 to 1, shape [n, W]."""

    def rows(self) -> dict[str, list[float]]:
        """Return the mean of every score over windows, a list of W steps each."""
        named = {**{f"top{k}": hit for k, hit in self.hits.items()}, "gain": self.gain}
        return {name: [float(value) for value in np.nanmean(score, axis=0)] for name, score in named.items()}


def score(predicted: np.ndarray, target: np.ndarray, gains: np.ndarray) -> Scores:
    """Score predictions.

    Args:
        predicted: Beams of each window and step, the likeliest first, shape [n, W, k]; fewer than five are told apart
            only as far as they go.
        target: Best beams, -1 without any path, shape [n, W].
        gains: Normalised gain of every beam in these frames, shape [n, W, Q].
    """
    is_there = target >= 0
    is_hit = predicted == target[..., None]
    hits = {k: np.where(is_there, is_hit[..., :k].any(axis=2), np.nan) for k in TOP}
    gain = np.take_along_axis(gains, predicted[..., :1].astype(np.int64), axis=2)[..., 0]
    return Scores(hits, np.where(is_there, gain, np.nan))
