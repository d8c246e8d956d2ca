"""Predict beams from positions alone, by the protocol of DeepSense 6G, and score them.

Latitude and longitude are scaled to 0 to 1 over the scenario, samples are dealt out at random, 60 % for training, 20 %
for validation and 20 % for test, and five such runs are averaged. Neither predictor validates anything, so both train
on 80 %, as the authors' do. Samples of one drive are in all parts, so this measures how well a place is known that has
been driven through before.

Source: J. Morais, A. Behboodi, H. Pezeshki, A. Alkhateeb, "Position-aided beam prediction in the real world: how useful
GPS locations actually are?", IEEE ICC 2023, arXiv 2205.09054.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mmw.core.errors import InputError
from mmw.dataset.beam_samples import BeamSamples

__all__ = ["BeamAccuracy", "look_up_table", "nearest_neighbors", "score_positions"]

TOP = (1, 2, 3)
"""k of the top-k accuracies."""

RUNS = 5
"""Runs that are averaged."""

TEST_SHARE = 0.2
"""Share of the samples that are tested. Training and validation have the others."""

NEIGHBORS = 5
"""Neighbors that vote."""

BINS = 25
"""Cells of the look-up table along each axis."""

MIN_SAMPLES = 5
"""Samples that a score needs, so that one is tested."""

Predictor = Callable[[np.ndarray, np.ndarray, np.ndarray, np.random.Generator], np.ndarray]
"""Positions [n, 2] and beams [n] of training, positions [m, 2] to predict for -> beams, the likeliest first, [m, 3]; -1
where there is no further one."""


@dataclass(frozen=True)
class BeamAccuracy:
    """Accuracy of beams that were predicted for the test samples, over the runs."""

    top: tuple[float, ...]
    """Share of samples whose best beam is among the k likeliest, mean for k = 1, 2, 3 [%]."""
    spread: tuple[float, ...]
    """Standard deviation over the runs [%]."""
    samples: int
    """Samples of the scenario."""


def score_positions(samples: BeamSamples, predict: Predictor | None = None, *, runs: int = RUNS) -> BeamAccuracy:
    """Return how well beams follow from positions.

    Args:
        samples: Samples of one scenario.
        predict: `nearest_neighbors` if None, `look_up_table`, or another function.
        runs: Divisions of the samples.

    Raises:
        InputError: If there are fewer than five samples, or they all have one latitude or longitude.
    """
    if len(samples) < MIN_SAMPLES or runs < 1:
        raise InputError(
            f"{samples.name}: {len(samples)} samples, {runs} runs; at least {MIN_SAMPLES} and 1 are needed"
        )
    place, beams, method = scaled_positions(samples), samples.beams, predict or nearest_neighbors
    scores = []
    for run in range(runs):
        rng = np.random.default_rng(run)
        order = rng.permutation(len(samples))
        tested = round(TEST_SHARE * len(samples))
        train, test = order[tested:], order[:tested]
        is_hit = method(place[train], beams[train], place[test], rng) == beams[test, None]
        scores.append([100.0 * is_hit[:, :k].any(axis=1).mean() for k in TOP])
    mean, spread = np.mean(scores, axis=0), np.std(scores, axis=0)
    return BeamAccuracy(tuple(mean.tolist()), tuple(spread.tolist()), len(samples))


def scaled_positions(samples: BeamSamples) -> np.ndarray:
    """Return latitude and longitude scaled to 0 to 1 over the samples, shape [N, 2].

    Raises:
        InputError: If all samples have one latitude or longitude.
    """
    low, high = samples.position_deg.min(axis=0), samples.position_deg.max(axis=0)
    if not (high > low).all():
        raise InputError(f"{samples.name}: positions do not differ in both axes; take a scenario that moves")
    return (samples.position_deg - low) / (high - low)


def nearest_neighbors(
    train: np.ndarray, beams: np.ndarray, test: np.ndarray, rng: np.random.Generator, neighbors: int = NEIGHBORS
) -> np.ndarray:
    """Return the beams that most of the nearest training samples have, shape [m, 3]; see `Predictor`."""
    apart = np.square(test[:, None] - train).sum(axis=2)
    nearest = np.argsort(apart, axis=1, kind="stable")[:, :neighbors]
    return np.array([most_frequent(beams[rows]) for rows in nearest])


def look_up_table(
    train: np.ndarray, beams: np.ndarray, test: np.ndarray, rng: np.random.Generator, bins: int = BINS
) -> np.ndarray:
    """Return the beams that are most frequent in the cell of each position, shape [m, 3]; see `Predictor`.

    In a cell without training samples the beam is a random one of those of training.
    """
    own, wanted = (np.minimum((place * bins).astype(np.int64), bins - 1) @ [bins, 1] for place in (train, test))
    table = {cell: most_frequent(beams[own == cell]) for cell in np.unique(own)}
    guesses = rng.integers(0, beams.max() + 1, len(test))
    return np.array([table.get(cell, np.array([guess, -1, -1])) for cell, guess in zip(wanted, guesses, strict=True)])


def most_frequent(beams: np.ndarray) -> np.ndarray:
    """Return the three most frequent beams, of equal ones the largest first, -1 where there are fewer, shape [3]."""
    values, counts = np.unique(beams, return_counts=True)
    found = values[np.argsort(counts, kind="stable")[::-1]][: max(TOP)]
    return np.concatenate([found, np.full(max(TOP) - len(found), -1)])
