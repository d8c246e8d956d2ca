"""Score predicted beams step by step: top-k accuracy and normalized gain."""

from dataclasses import dataclass

import numpy as np

TOP = (1, 3, 5)
"""k of the top-k accuracies."""

LIKELY = max(TOP)
"""Beams stored of every prediction."""

DRAWS = 2000
"""Draws of a bootstrap. Design value."""


@dataclass(frozen=True, eq=False)
class Scores:
    """Scores of n windows and W steps; NaN where the frame has no path, so that no beam is right or wrong."""

    hits: dict[int, np.ndarray]
    """k -> 1 where the best beam is among the k likeliest, else 0, shape [n, W]."""
    gain: np.ndarray
    """Normalized gain of the likeliest beam, 0 to 1, shape [n, W]."""

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
        gains: Normalized gain of every beam in these frames, shape [n, W, Q].
    """
    is_there = target >= 0
    is_hit = predicted == target[..., None]
    hits = {k: np.where(is_there, is_hit[..., :k].any(axis=2), np.nan) for k in TOP}
    gain = np.take_along_axis(gains, predicted[..., :1].astype(np.int64), axis=2)[..., 0]
    return Scores(hits, np.where(is_there, gain, np.nan))


def drive_interval(difference: np.ndarray, drive: np.ndarray, level: float = 0.95) -> tuple[float, float]:
    """Return where the mean of a difference lies if other drives of the same kind had been validated.

    Windows of a drive say nearly the same, so whole drives are drawn, with replacement (cluster bootstrap, percentiles:
    A. C. Davison and D. V. Hinkley, Bootstrap Methods and their Application, 1997, 3.8 and 5.3).

    Args:
        difference: Of each window and step, NaN for none, shape [n, W].
        drive: Drive of each window, shape [n], numbers from 0.
        level: Share of draws inside.
    """
    size = int(drive.max()) + 1
    there = np.isfinite(difference)
    total = np.bincount(drive, np.where(there, difference, 0.0).sum(axis=1), size)
    count = np.bincount(drive, there.sum(axis=1), size)
    drawn = np.random.default_rng(0).multinomial(size, np.full(size, 1.0 / size), DRAWS)
    with_any = (drawn @ count) > 0
    means = (drawn @ total)[with_any] / (drawn @ count)[with_any]
    low, high = np.quantile(means, [(1.0 - level) / 2.0, (1.0 + level) / 2.0])
    return float(low), float(high)
