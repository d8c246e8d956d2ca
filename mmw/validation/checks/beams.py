"""Compare how well beams follow from positions with measurements of DeepSense 6G."""

import tempfile
from typing import Any

import numpy as np

from mmw.dataset.beam_samples import link_samples
from mmw.dataset.deepsense import PUBLISHED
from mmw.dataset.position_beams import look_up_table, score_positions
from mmw.generation.run_config import generate
from mmw.validation.check import Check, Measurement, Source

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


def _top_1(device: str) -> Measurement:
    with tempfile.TemporaryDirectory() as folder:
        data = generate(SCENARIO, folder, overrides=OVERRIDES, device=device, workers=1, progress=False)
        samples = link_samples(data, scenario=SCENARIO, carrier_hz=60e9)
    own, table = score_positions(samples), score_positions(samples, look_up_table)
    published = np.array(list(PUBLISHED.values()))

    def draw(axes: Any) -> None:
        for number, top in PUBLISHED.items():
            axes.plot([1, 2, 3], top, color="#9aa5b1", lw=1.0, label="DeepSense 6G, published" if number == 1 else None)
        axes.plot([1, 2, 3], own.top, "o-", lw=1.5, label="mmw, 5 nearest neighbors")
        axes.plot([1, 2, 3], table.top, "s--", lw=1.5, label="mmw, look-up table")
        axes.set(xlabel="k", ylabel="top-k accuracy by position [%]", xticks=[1, 2, 3], ylim=(0, 100))
        axes.legend(fontsize=8)

    detail = (
        f"{own.samples} samples; top-1, 2, 3 {', '.join(f'{value:.1f}' for value in own.top)} %; published "
        f"{published[:, 0].min():.1f} to {published[:, 0].max():.1f} % for k = 1, easier here: powers have no noise, "
        "vehicles wait, and errors of GNSS are white"
    )
    return Measurement(own.top[0], detail, draw)


CHECKS = (
    Check(
        name="beams.position_top1", title="Best of 64 beams by position alone, top-1",
        computed=f"`{SCENARIO}`, 30 s at 10 Hz, 60 GHz, 16 antennas, GNSS with 1.1 m of white noise; five nearest "
        "neighbors, 80 % for training, mean of five runs", unit="%",
        reference=float(np.mean([top[0] for top in PUBLISHED.values()])), low=20.0, high=90.0,
        tolerance="the least of the scenarios, 21.8 %, to where positions would say nearly all, which none measured",
        sources=(DEEPSENSE,), measure=_top_1,
    ),
)  # fmt: skip
"""Rows of this topic."""
