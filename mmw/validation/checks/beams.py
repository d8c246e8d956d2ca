"""Compare how well beams follow from positions with measurements of DeepSense 6G."""

import tempfile
from collections.abc import Callable
from functools import cache, partial
from typing import Any

import numpy as np

from mmw.dataset.beam_samples import link_samples
from mmw.dataset.deepsense import PUBLISHED
from mmw.dataset.position_beams import BeamAccuracy, score_positions
from mmw.generation.run_config import generate
from mmw.validation.check import Check, Measurement, Reference, Source

DEEPSENSE = Source(
    "DeepSense 6G, leaderboard of position-aided beam prediction; Morais et al., Position-aided beam prediction in the "
    "real world, arXiv 2205.09054", "scenarios 1 to 9, top-1", "https://deepsense6g.net/position-aided-beam-prediction",
    "document",
)  # fmt: skip

SCENARIO = "town03_roundabout"
OVERRIDES = (
    "frames.count=300", "frames.rate_hz=10", "sensors=[{type: gnss}]", "channel.carriers_hz=[60e9]", "weathers=[sunny]",
    "channel.candidates=exhaustive",
)  # fmt: skip
"""30 s at the rate of DeepSense 6G, in its band."""


SNR_DB = 15.0
"""Best beam over noise of a receiver in the median sample [dB]. Design value: theirs is not published."""


@cache
def _accuracy(device: str) -> dict[float | None, BeamAccuracy]:
    """Return the accuracy by SNR, None without noise."""
    with tempfile.TemporaryDirectory() as folder:
        data = generate(SCENARIO, folder, overrides=OVERRIDES, device=device, workers=1, progress=False)
        return {
            snr_db: score_positions(link_samples(data, scenario=SCENARIO, carrier_hz=60e9, snr_db=snr_db))
            for snr_db in (None, 20.0, SNR_DB, 10.0)
        }


def _draw(device: str, axes: Any) -> None:
    for number, top in PUBLISHED.items():
        axes.plot([1, 2, 3], top, color="#9aa5b1", lw=1.0, label="DeepSense 6G, published" if number == 1 else None)
    for snr_db, own in _accuracy(device).items():
        label = "without noise" if snr_db is None else f"SNR {snr_db:g} dB"
        axes.plot([1, 2, 3], own.top, "o-", lw=1.5, ms=4.0, label=f"mmw, {label}")
    axes.set(xlabel="k", ylabel="top-k accuracy by position [%]", xticks=[1, 2, 3], ylim=(0, 100))
    axes.legend(fontsize=8, ncols=2)


def _top_1(snr_db: float | None) -> Callable[[str], Measurement]:
    def measure(device: str) -> Measurement:
        own = _accuracy(device)[snr_db]
        text = f"{own.samples} samples; top-1, 2, 3 {', '.join(f'{value:.1f}' for value in own.top)} %"
        if snr_db is None:
            easier = "above every scenario: powers have no noise, and vehicles that wait repeat their samples"
            return Measurement(own.top[0], f"{text}; {easier}", partial(_draw, device))
        return Measurement(own.top[0], text)

    return measure


LEAST, MOST = (float(pick(top[0] for top in PUBLISHED.values())) for pick in (min, max))
MEAN = float(np.mean([top[0] for top in PUBLISHED.values()]))
COMPUTED = (
    f"`{SCENARIO}`, 30 s at 10 Hz, 60 GHz, 16 antennas, GNSS with 1.1 m of white noise; five nearest neighbors, 80 % "
    "for training, mean of five runs"
)

CHECKS = (
    Check(
        name="beams.position_top1", title="Best of 64 beams by position alone, top-1", computed=COMPUTED, unit="%",
        reference=Reference(MEAN, 20.0, 90.0),
        tolerance="from the least of the scenarios, 21.8 %, to where positions would say nearly all, which was "
        "measured nowhere",
        sources=(DEEPSENSE,), measure=_top_1(None),
    ),
    Check(
        name="beams.position_top1_noisy", title=f"Best of 64 beams by position alone, top-1, SNR {SNR_DB:g} dB",
        computed=f"{COMPUTED}; powers with the noise of a receiver", unit="%", reference=Reference(MEAN, LEAST, MOST),
        tolerance="the scenarios that were measured; of 10 and 20 dB the figure above has the accuracy",
        sources=(DEEPSENSE,), measure=_top_1(SNR_DB),
    ),
)  # fmt: skip
"""Rows of this topic."""
