"""Methods without a network, and the mean of scores with its interval."""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.stats import t as student_t

from examples.beam_tracking_agent.drives import STEP_S, Drive, features

Policy = Callable[[np.ndarray], np.ndarray]
"""Features of n vehicles, shape [n, features] -> their beams in the next step, shape [n]."""


def held(drive: Drive, period: int) -> np.ndarray:
    """Return the spectral efficiency of the best beam of the last full sweep [bit/s/Hz], shape [T - 1].

    Args:
        drive: A drive; its first frame is swept.
        period: Steps from one sweep to the next. A sweep costs nothing here.
    """
    last = np.arange(len(drive.rates) - 1) // period * period
    return drive.rates[np.arange(1, len(drive.rates)), drive.rates.argmax(axis=1)[last]]


def nearest(drive: Drive, places: np.ndarray, beams: np.ndarray) -> np.ndarray:
    """Return the spectral efficiency of the best beam of the nearest place in a table [bit/s/Hz], shape [T - 1].

    The place that is looked up is that of the next step, by the present velocity.

    Args:
        drive: A drive.
        places: Positions in the table [m], shape [n, 3].
        beams: Best beam of each, shape [n].
    """
    expected = drive.position[:-1] + STEP_S * drive.velocity[:-1]
    apart = np.square(expected[:, None] - places).sum(axis=2)
    return drive.rates[np.arange(1, len(drive.rates)), beams[apart.argmin(axis=1)]]


def baselines(train: Sequence[Drive], test: Sequence[Sequence[Drive]]) -> dict[str, np.ndarray]:
    """Return the mean spectral efficiency [bit/s/Hz] of every method in each test seed, shape [seeds]."""
    places = np.concatenate([drive.position for drive in train])
    beams = np.concatenate([drive.rates.argmax(axis=1) for drive in train])
    methods: dict[str, Callable[[Drive], np.ndarray]] = {
        "exhaustive search": lambda drive: drive.rates[1:].max(axis=1),
        "nearest position": lambda drive: nearest(drive, places, beams),
        "hold-last, sweep every 0.1 s": lambda drive: held(drive, 1),
        "hold-last, sweep every 1 s": lambda drive: held(drive, 10),
        "random beam": lambda drive: drive.rates[1:].mean(axis=1),
    }
    return {
        name: np.array([np.mean([rates(drive) for drive in drives], dtype=np.float64) for drives in test])
        for name, rates in methods.items()
    }


def follow(policy: Policy, test: Sequence[Sequence[Drive]]) -> np.ndarray:
    """Return the mean spectral efficiency of a policy [bit/s/Hz] in each test seed, shape [seeds].

    Every vehicle starts with beam 0, and its own beams are all that is seen of the channel.
    """
    drives = [drive for some in test for drive in some]
    count = drives[0].rates.shape[1]
    beams = np.zeros(len(drives), dtype=np.int64)
    rates = []
    for t in range(len(drives[0].rates) - 1):
        seen = [features(drive.observe(t, beam), count) for drive, beam in zip(drives, beams, strict=True)]
        beams = policy(np.stack(seen))
        rates.append([drive.rates[t + 1, beam] for drive, beam in zip(drives, beams, strict=True)])
    parts = np.split(np.mean(rates, axis=0, dtype=np.float64), np.cumsum([len(some) for some in test])[:-1])
    return np.array([part.mean() for part in parts])


def interval(values: np.ndarray, level: float = 0.95) -> tuple[float, float, float]:
    """Return mean, lower and upper end of its confidence interval, of independent values, shape [n].

    Source: mean and t times s / sqrt(n), Student, "The probable error of a mean", Biometrika 6, 1908.
    """
    mean = float(np.mean(values))
    half = float(student_t.ppf(0.5 + level / 2.0, len(values) - 1) * np.std(values, ddof=1) / np.sqrt(len(values)))
    return mean, mean - half, mean + half
