"""Train a beam-tracking agent, and draw its curve beside methods that search, hold, look up and guess.

    python -m examples.beam_tracking_agent --out out/beam_tracking_agent

Traffic of the training and of the tests has other seeds. Writes `curve.png` and `curve.json`, and keeps what it traces
in OUT/drives. See `docs/guides/closed-loop.md`.
"""

import argparse
import json
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from examples.beam_tracking_agent.drives import read_drives
from examples.beam_tracking_agent.methods import baselines, interval
from mmw.core.errors import InputError, MissingPackageError
from mmw.viz.plots.style import BLUE, GREEN, GREY, ORANGE, PURPLE, RED, plain_axes

FIRST_TEST = 1001
"""First traffic seed of the tests; those of the training count from 1."""

AGENT = "agent"


def draw(taken: np.ndarray, scores: np.ndarray, others: Mapping[str, np.ndarray]) -> Figure:
    """Draw the curve of the agent, and all methods beside it.

    Args:
        taken: Steps of each evaluation, shape [looks].
        scores: Mean spectral efficiency [bit/s/Hz], shape [training seeds, looks, traffic seeds].
        others: That of each other method, shape [traffic seeds].
    """
    figure = Figure(figsize=(8.0, 4.2), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=[3.2, 1.0], sharey=True)
    mean, low, high = np.transpose([interval(column) for column in scores.mean(axis=2).T])
    left.fill_between(taken / 1e3, low, high, color=RED, alpha=0.2, lw=0)
    left.plot(taken / 1e3, mean, "o-", color=RED, ms=3.5, label=f"{AGENT}, {len(scores)} training seeds")
    for curve in scores.mean(axis=2):
        left.plot(taken / 1e3, curve, color=RED, lw=0.6, alpha=0.5)
    colors = dict(zip(others, (BLUE, PURPLE, GREEN, ORANGE, GREY), strict=True))
    finals = {**others, AGENT: scores[:, -1].mean(axis=0)}
    for place, (name, values) in enumerate(finals.items()):
        color = colors.get(name, RED)
        mean, low, high = interval(values)
        if name != AGENT:
            left.axhline(mean, color=color, ls="--", lw=1.3, label=name)
        right.errorbar(place, mean, [[mean - low], [high - mean]], fmt="o", color=color, capsize=4)
    left.set(xlabel="training steps [thousands]", ylabel="mean spectral efficiency [bit/s/Hz]", xlim=(0, None))
    left.set_ylim(bottom=0)
    left.legend(fontsize="small", loc="center right", bbox_to_anchor=(1.0, 0.44))
    left.set_title("95 % intervals over training seeds", fontsize="medium")
    right.set_title("over traffic seeds", fontsize="medium")
    right.set_xticks([])
    right.set_xlim(-0.7, len(finals) - 0.3)
    plain_axes(left)
    plain_axes(right)
    return figure


def summary(taken: np.ndarray, scores: np.ndarray, others: Mapping[str, np.ndarray]) -> dict:
    """Return the numbers of the picture, and the agent's lead over each method in the same drives."""
    final = scores[:, -1].mean(axis=0)
    return {
        "steps": taken.tolist(),
        "agent": np.round([interval(column) for column in scores.mean(axis=2).T], 3).tolist(),
        "agent_each_seed": np.round(scores.mean(axis=2), 3).tolist(),
        "traffic_seeds": {name: np.round(interval(one), 3).tolist() for name, one in {**others, AGENT: final}.items()},
        "lead": {name: np.round(interval(final - one), 3).tolist() for name, one in others.items()},
    }


def main(argv: Sequence[str] | None = None) -> None:
    """Trace, train, compare, draw."""
    parser = argparse.ArgumentParser(prog="python -m examples.beam_tracking_agent")
    parser.add_argument("--out", type=Path, required=True, help="folder of drives, picture and numbers")
    parser.add_argument("--steps", type=int, default=80_000, help="steps of a training")
    parser.add_argument("--looks", type=int, default=10, help="evaluations of a training")
    parser.add_argument("--seeds", type=int, default=5, help="trainings, at least 2")
    parser.add_argument("--train", type=int, default=12, help="traffic seeds of the training")
    parser.add_argument("--test", type=int, default=8, help="traffic seeds of the tests, at least 2")
    parser.add_argument("--frames", type=int, default=1000, help="frames of 10 ms of a drive")
    given = parser.parse_args(argv)
    if min(given.seeds, given.test) < 2 or given.train < 1:
        raise InputError(
            f"--seeds {given.seeds} --test {given.test} --train {given.train}; an interval needs 2 or more, and a "
            "training 1"
        )
    from examples.beam_tracking_agent.training import train  # PyTorch takes seconds to load

    folder = given.out / "drives"
    known = [drive for some in read_drives(range(1, 1 + given.train), given.frames, folder) for drive in some]
    unseen = read_drives(range(FIRST_TEST, FIRST_TEST + given.test), given.frames, folder)
    others, curves, taken = baselines(known, unseen), [], np.zeros(0)
    for seed in range(given.seeds):
        began, used = time.perf_counter(), time.process_time()
        taken, scores, agent = train(known, unseen, steps=given.steps, looks=given.looks, seed=seed)
        agent.save(given.out / f"agent_{seed}.zip")
        curves.append(scores)
        spent, used = time.perf_counter() - began, time.process_time() - used
        print(f"training seed {seed}: {scores[-1].mean():.2f} bit/s/Hz in {spent:.0f} s (CPU {used:.0f} s)", flush=True)
    numbers = summary(taken, np.array(curves), others)
    (given.out / "curve.json").write_text(json.dumps(numbers) + "\n")
    draw(taken, np.array(curves), others).savefig(given.out / "curve.png", dpi=110)
    for name, (mean, low, high) in numbers["traffic_seeds"].items():
        lead = "agent - method {:+.2f} ({:+.2f} to {:+.2f})".format(*numbers["lead"][name]) if name != AGENT else ""
        print(f"{name:30} {mean:6.2f} ({low:.2f} to {high:.2f}) bit/s/Hz   {lead}")


if __name__ == "__main__":
    try:
        main(sys.argv[1:])
    except (InputError, MissingPackageError) as error:
        sys.exit(str(error))
