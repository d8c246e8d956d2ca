"""Write the analysis page: where gain is lost and won, by scenario, line of sight and motion, and cases to look at."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from examples.beam_prediction.data import BeamData
from examples.beam_prediction.pictures import draw_case
from examples.beam_prediction.results import LABELS, Method, drives_of
from mmw.dataset import Dataset
from mmw.viz.plots.style import BLUE, GREEN, ORANGE, RED, plain_axes

CASES = 4
"""Windows that are drawn of each kind. Design value."""

APART = 50
"""Frames between two drawn windows of one scenario at least, so that they show different moments. Design value."""

SMALL = 2
"""Beams that a beam may move within a window without having jumped. Design value."""

COLORS = {"camera": ORANGE, "lidar": GREEN, "all": RED}


def write_analysis(folder: Path, methods: Mapping[str, Method], data: BeamData, dataset: Dataset | None) -> None:
    """Write `analysis.md` and its pictures into a folder.

    Args:
        folder: Where they go.
        methods: What is compared.
        data: Its data.
        dataset: Where images are read for the cases; None leaves them out.
    """
    groups = {
        "scenario": scenarios_of(data),
        "line of sight": sight_of(data),
        "motion of the best beam": motion_of(data),
    }
    pages = ["# Analysis", "All numbers are normalized gains of validation windows, mean over steps and seeds."]
    for name, group in groups.items():
        pages += [f"## By {name}", group_table(methods, group, data)]
    if "index" in methods and set(COLORS) & set(methods):
        difference_figure(methods, groups["scenario"]).savefig(folder / "by_scenario.png", dpi=150)
        pages += ["## What sensors add, by scenario", "![Gain over index only by scenario](by_scenario.png)"]
    subject = next((label for label in ("all", "lidar", "camera", "index") if label in methods), "last")
    gain = window_mean(methods[subject])
    pages += [
        f"## Failure cases of {LABELS[subject]}",
        *_cases(folder, "failure", gain, methods, subject, data, dataset),
    ]
    if subject != "index" and "index" in methods:
        won = gain - window_mean(methods["index"])
        pages += ["## Where sensors helped most", *_cases(folder, "helped", -won, methods, subject, data, dataset)]
    (folder / "analysis.md").write_text("\n\n".join(pages) + "\n")


def scenarios_of(data: BeamData) -> dict[str, np.ndarray]:
    """Return the validation windows of each scenario, masks of shape [n]."""
    names = np.array([data.track[start][0] for start in data.starts["val"].tolist()])
    return {name: names == name for name in sorted(set(names))}


def sight_of(data: BeamData) -> dict[str, np.ndarray]:
    """Return the validation windows by the change of the line of sight, masks of shape [n]."""
    starts = data.starts["val"]
    now = data.is_los[starts + data.past - 1].cpu().numpy()
    later = data.is_los[data.future_frames(starts)].cpu().numpy()
    return {
        "kept": now & later.all(axis=1),
        "lost": now & ~later.all(axis=1),
        "gained": ~now & later.any(axis=1),
        "none": ~now & ~later.any(axis=1),
    }


def motion_of(data: BeamData) -> dict[str, np.ndarray]:
    """Return the validation windows by the largest shift of the best beam from the last known one, masks [n]."""
    starts, size = data.starts["val"], data.beams
    last = data.tx_beam[starts + data.past - 1].cpu().numpy()[:, None]
    later = data.targets(starts).cpu().numpy()
    shift = np.abs((later - last + size // 2) % size - size // 2)
    shift = np.where((later >= 0) & (last >= 0), shift, 0).max(axis=1)
    is_there = (later >= 0).any(axis=1) & (last[:, 0] >= 0)
    return {
        "stays": is_there & (shift == 0),
        f"moves by 1 or {SMALL} beams": is_there & (shift > 0) & (shift <= SMALL),
        "jumps": is_there & (shift > SMALL),
        "no path now or later": ~is_there,
    }


def group_table(methods: Mapping[str, Method], groups: Mapping[str, np.ndarray], data: BeamData) -> str:
    """Return the mean gain of every method in every group of windows as a Markdown table.

    Windows count where a predicted frame has a path; drives are vehicles that have such windows.
    """
    drive = drives_of(data)
    lines = [["", "windows", "drives", *(LABELS[label] for label in methods)]]
    lines.append(["---"] * len(lines[0]))
    is_scored = np.isfinite(methods["last"].window_gain).any(axis=1)
    for name, mask in groups.items():
        gains = [_mean(method.window_gain[mask]) for method in methods.values()]
        counts = (mask & is_scored).sum(), len(set(drive[mask & is_scored]))
        lines.append([name, *(f"{count:,}" for count in counts), *("" if np.isnan(g) else f"{g:.4f}" for g in gains)])
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def difference_figure(methods: Mapping[str, Method], groups: Mapping[str, np.ndarray]) -> Figure:
    """Return what each sensor adds to index only in every scenario, in hundredths of gain, a dot a seed."""
    names = [name for name, mask in groups.items() if np.isfinite(_mean(methods["index"].window_gain[mask]))]
    figure = Figure(figsize=(7.5, 1.2 + 0.36 * len(names)), layout="constrained")
    axes = figure.subplots()
    shown = [label for label in COLORS if label in methods]
    for number, label in enumerate(shown):
        place = np.arange(len(names)) + 0.26 * (number - (len(shown) - 1) / 2)
        added = np.array([_added(methods, label, groups[name]) for name in names])
        axes.barh(place, added.mean(axis=1), height=0.24, color=COLORS[label], alpha=0.6, label=LABELS[label])
        axes.plot(added.T, np.tile(place, (added.shape[1], 1)), "o", color=COLORS[label], markersize=2.5)
    axes.axvline(0.0, color=BLUE, lw=1.0)
    axes.set_yticks(np.arange(len(names)), names)
    axes.invert_yaxis()
    axes.set_xlabel("normalized gain over index only [hundredths]")
    axes.legend(fontsize="small")
    plain_axes(axes)
    return figure


def window_mean(method: Method) -> np.ndarray:
    """Return the mean gain of every window over its steps with a path, NaN for a window without any, shape [n]."""
    gain = method.window_gain
    count = np.isfinite(gain).sum(axis=1)
    return np.where(count > 0, np.nansum(gain, axis=1) / np.maximum(count, 1), np.nan)


def pick_cases(score: np.ndarray, data: BeamData) -> list[int]:
    """Return the validation windows with the lowest scores, of different moments.

    Args:
        score: One for each window, shape [n]; NaN is left out.
        data: The data.
    """
    starts = data.starts["val"].tolist()
    chosen: list[int] = []
    for window in np.argsort(np.where(np.isnan(score), np.inf, score), kind="stable"):
        own = data.track[starts[window]][0], data.frame[starts[window]]
        others = [(data.track[starts[one]][0], data.frame[starts[one]]) for one in chosen]
        if not np.isnan(score[window]) and all(o[0] != own[0] or abs(o[1] - own[1]) >= APART for o in others):
            chosen.append(int(window))
        if len(chosen) == CASES:
            break
    return chosen


def _cases(
    folder: Path,
    kind: str,
    score: np.ndarray,
    methods: Mapping[str, Method],
    subject: str,
    data: BeamData,
    dataset: Dataset | None,
) -> list[str]:
    """Draw the windows with the lowest scores and return the lines of the page about them."""
    lines = []
    for number, window in enumerate(pick_cases(score, data), start=1):
        name = f"{kind}_{number}.png"
        draw_case(window, methods, subject, data, dataset).savefig(folder / name, dpi=110)
        start = int(data.starts["val"][window])
        scenario, weather, agent = data.track[start]
        now = data.frame[start] + data.past - 1
        gains = ", ".join(f"{LABELS[one]} {_mean(method.window_gain[window]):.3f}" for one, method in methods.items())
        lines += [f"**{scenario}, {weather}, {agent}, frame {now}**: {gains}.", f"![{kind} {number}]({name})"]
    return lines


def _added(methods: Mapping[str, Method], label: str, mask: np.ndarray) -> Sequence[float]:
    """Return what each seed of a method gains over the mean of index only in some windows [hundredths]."""
    base = _mean(methods["index"].window_gain[mask])
    return [100.0 * (_mean(one.gain[mask]) - base) for one in methods[label].scores]


def _mean(gain: np.ndarray) -> float:
    """Return the mean of gains that are there, NaN if none is."""
    there = gain[np.isfinite(gain)]
    return float(there.mean()) if len(there) else float("nan")
