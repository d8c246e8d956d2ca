"""The report: a table, the two figures of the paper, learning curves, and the analysis page."""

from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from examples.beam_prediction.analysis import write_analysis
from examples.beam_prediction.config import Experiment
from examples.beam_prediction.data import BeamData
from examples.beam_prediction.metrics import drive_interval
from examples.beam_prediction.results import LABELS, Method, drives_of, read_methods, spread_text
from mmw.dataset import Dataset
from mmw.viz.plots.style import BLUE, DARK, GREEN, GREY, ORANGE, PURPLE, RED, SKY, plain_axes

COLORS = {
    "last": GREY, "line": SKY, "known": DARK, "near": GREY, "near_all": GREY, "gru": PURPLE,
    "index": BLUE, "camera": ORANGE, "lidar": GREEN, "all": RED,
}  # fmt: skip
"""Method -> its color."""

MAIN = ("known", "all", "index", "gru", "line", "last")
"""Methods of the first figure: the paper's compares its method with one that knows beam indices alone."""

ABLATION = ("all", "lidar", "camera", "index")
"""The four input sets, of the second figure."""


def write_report(out: Path, experiment: Experiment, data: BeamData, dataset: Dataset | None) -> Path:
    """Write table, figures and analysis of all finished runs and return the page.

    Args:
        out: Folder of the experiment; the report goes to `report/` in it.
        experiment: Its configuration.
        data: Its data.
        dataset: Where images are read for the analysis; None leaves them out.
    """
    folder = out / "report"
    folder.mkdir(parents=True, exist_ok=True)
    methods = read_methods(out, data)
    figures = {
        "gain_per_step.png": gain_figure(methods, MAIN, data.future),
        "ablation.png": gain_figure(methods, ABLATION, data.future),
        "learning.png": learning_figure(methods),
    }
    for name, figure in figures.items():
        figure.savefig(folder / name, dpi=150)
    page = folder / "results.md"
    page.write_text(f"""# Results

{windows_text(experiment, data)}

{table(methods, data)}

Normalised gain and accuracies are means over validation windows and steps, over frames with a path; ± is the standard
deviation over seeds. In brackets: where 95 % of the difference to the last beam would lie with other drives (bootstrap
over the drives of validation, mean of seeds); an interval with 0 inside tells nothing apart.

![Normalised gain of every predicted step](gain_per_step.png)

![Normalised gain of the four input sets](ablation.png)

![Losses of training and validation](learning.png)

{cost_table(methods)}

[Analysis](analysis.md)
""")
    write_analysis(folder, methods, data, dataset)
    return page


def windows_text(experiment: Experiment, data: BeamData) -> str:
    """Return how many windows there are, and how they were split, in a sentence."""
    c = experiment.windows
    counts = " and ".join(f"{len(rows):,} windows for {part}" for part, rows in data.starts.items())
    tracks = len(set(data.track))
    if c.split == "window":
        apart = "windows dealt out singly: nearly every frame of validation is in windows of training too"
    else:
        apart = f"split by {c.split}, no frame of a scenario in both parts"
    return f"{counts}, P = {c.past}, W = {c.future}, of {tracks} vehicles' tracks, {len(data.track):,} frames; {apart}."


def table(methods: dict[str, Method], data: BeamData) -> str:
    """Return the scores of everything as a Markdown table.

    Args:
        methods: The compared methods.
        data: Whose validation windows were predicted.
    """
    shown = sorted({1, (data.future + 1) // 2, data.future})
    heads = ["", "seeds", "G", "G over last beam", *(f"G, step {step}" for step in shown), "top-1", "top-3", "top-5"]
    lines = [heads, ["---"] * len(heads)]
    for label, method in methods.items():
        gain = method.per_step("gain")
        hits = [spread_text(method.per_step(name).mean(axis=1), 3) for name in ("top1", "top3", "top5")]
        is_list = bool(method.metrics)  # a baseline names one beam, no list of likely ones
        lines.append([
            LABELS[label], str(len(method.seeds)) if is_list else "", spread_text(gain.mean(axis=1)),
            "" if label == "last" else over_text(method, methods["last"], data),
            *(spread_text(gain[:, step - 1]) for step in shown), hits[0], *(hits[1:] if is_list else ("", "")),
        ])  # fmt: skip
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def over_text(method: Method, base: Method, data: BeamData) -> str:
    """Return what a method gains over another, and the interval of that over drives."""
    difference = method.window_gain - base.window_gain
    low, high = drive_interval(difference, drives_of(data))
    return f"{np.nanmean(difference):+.4f} [{low:+.4f}, {high:+.4f}]"


def cost_table(methods: dict[str, Method]) -> str:
    """Return losses, sizes and times of what was trained as a Markdown table."""
    lines = ["| | training loss | validation loss | parameters | epochs | s a run | windows/s |"]
    lines.append("|---|---|---|---|---|---|---|")
    for label, method in methods.items():
        if method.metrics:
            history = [row for metrics in method.metrics for row in metrics["history"]]
            losses = {
                key: np.array([metrics["history"][-1][key] for metrics in method.metrics])
                for key in ("loss", "val_loss")
            }
            lines.append(
                f"| {LABELS[label]} | {spread_text(losses['loss'], 3)} | {spread_text(losses['val_loss'], 3)} | "
                f"{method.metrics[0]['parameters']:,} | {len(method.metrics[0]['history'])} | "
                f"{np.mean([metrics['seconds'] for metrics in method.metrics]):.1f} | "
                f"{np.median([row['windows_per_s'] for row in history]):,.0f} |"
            )
    return "\n".join(lines)


def gain_figure(methods: dict[str, Method], labels: tuple[str, ...], steps: int) -> Figure:
    """Return normalised gain against the predicted step, with the spread over seeds.

    Args:
        methods: The compared methods.
        labels: Those that are drawn.
        steps: Future frames W.
    """
    figure = Figure(figsize=(5.2, 3.9), layout="constrained")
    axes = figure.subplots()
    step = np.arange(1, steps + 1)
    for label in labels:
        if label in methods:
            gain = methods[label].per_step("gain")
            axes.plot(step, gain.mean(axis=0), color=COLORS[label], marker="o", markersize=3, label=LABELS[label])
            if len(gain) > 1:
                low, high = (gain.mean(axis=0) + sign * gain.std(axis=0, ddof=1) for sign in (-1, 1))
                axes.fill_between(step, low, high, color=COLORS[label], alpha=0.15, linewidth=0)
    axes.set(xlabel="predicted step (10 ms each)", ylabel="normalised gain G")
    if axes.lines:
        axes.legend(fontsize="small")
    plain_axes(axes)
    return figure


def learning_figure(methods: dict[str, Method]) -> Figure:
    """Return training loss, validation loss and gain against the epoch, a line a run."""
    figure = Figure(figsize=(10.0, 3.4), layout="constrained")
    panels = figure.subplots(1, 3)
    titles = {"loss": "training loss", "val_loss": "validation loss", "gain": "normalised gain, validation"}
    for axes, (key, title) in zip(panels, titles.items(), strict=True):
        for label, method in methods.items():
            for number, metrics in enumerate(method.metrics):
                draw_history(axes, metrics, key, COLORS[label], LABELS[label] if number == 0 else None)
        axes.set(xlabel="epoch", title=title)
        plain_axes(axes)
    if panels[0].lines:
        panels[0].legend(fontsize="x-small")
    return figure


def draw_history(axes: Any, metrics: dict[str, Any], key: str, color: str, label: str | None) -> None:
    """Draw one column of a run's history."""
    rows = metrics["history"]
    axes.plot([row["epoch"] for row in rows], [row[key] for row in rows], color=color, lw=1.0, label=label)
