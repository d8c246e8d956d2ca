"""Draw one window: the latest samples of the sensors, and its past, best and predicted beams."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from examples.beam_prediction.data import BeamData
from examples.beam_prediction.results import LABELS, Method
from mmw.dataset import Dataset
from mmw.viz.plots.style import DARK, GREEN, GREY, ORANGE, PURPLE, RED, SKY, plain_axes

MARKS = {"last": ("x", GREY), "index": ("s", SKY), "camera": ("v", ORANGE), "lidar": ("^", GREEN), "all": ("D", RED)}
"""Method -> its marker and color."""


def draw_case(
    window: int, methods: Mapping[str, Method], subject: str, data: BeamData, dataset: Dataset | None
) -> Figure:
    """Draw a validation window.

    Args:
        window: Its number.
        methods: Whose predictions are drawn, those of their first seeds.
        subject: Whose last prediction is drawn into what the sensors see.
        data: The data.
        dataset: Where the images of the roadside unit are; None leaves them out.
    """
    start = int(data.starts["val"][window])
    now = start + data.past - 1
    held = int(data.frame[now]) - int(data.age[now])
    scenario, weather, agent = data.track[start]
    sources = [source for source, sensor in data.sensors.items() if int(sensor.row[now]) >= 0]
    views = dataset.frame(scenario, weather, held).agents[data.peer[now]].views if dataset else {}
    images = {name: view.rgb for name, view in views.items() if view.rgb is not None}
    panels = len(images) + bool(sources)
    figure = Figure(figsize=(4.4 * panels + 5.4, 3.6), layout="constrained")
    places = list(figure.subplots(1, panels + 1, width_ratios=[1.0] * panels + [1.3], squeeze=False)[0])
    for name, image in images.items():
        axes = places.pop(0)
        axes.imshow(image)
        axes.set_axis_off()
        axes.set_title(f"{data.peer[now]} {name}, {int(data.age[now])} frames ago", fontsize="medium")
    if sources:
        draw_sources(places.pop(0), window, methods[subject], sources, data)
    draw_track(places[0], window, methods, data)
    figure.suptitle(f"{scenario}, {weather}, {agent}, frame {data.frame[now]}")
    return figure


def draw_sources(axes: Any, window: int, method: Method, sources: list[str], data: BeamData) -> None:
    """Draw the last samples of a window one below the other, all columns, with the best and a predicted last beam."""
    now = int(data.starts["val"][window]) + data.past - 1
    pictures = []
    for source in sources:
        sensor = data.sensors[source]
        sample = sensor.samples[int(sensor.row[now])].cpu().numpy()
        picture = np.repeat(sample[1:2], 3, axis=0) if sensor.modality == "lidar" else sample  # of a sweep the spans
        pictures.append(np.roll(picture.transpose(1, 2, 0), sample.shape[2] // 2, axis=1))
    width = max(picture.shape[1] for picture in pictures)
    pictures = [np.repeat(picture, width // picture.shape[1], axis=1) for picture in pictures]
    half = data.beams / 2
    axes.imshow(np.concatenate(pictures), extent=(-half, half, 0, 1), aspect="auto", interpolation="nearest")
    best = int(data.targets(data.starts["val"][window : window + 1])[0, -1])
    for beam, color, style in ((int(method.beams[0, window, -1]), RED, "--"), (best, "white", "-")):
        if beam >= 0:
            axes.axvline((beam + half) % data.beams - half, color=color, ls=style, lw=1.0)
    axes.set_facecolor(DARK)
    axes.set_yticks([])
    axes.set(xlabel="transmit beam, modulo Q (white: best, red: named)")
    axes.set_title(", ".join(sources), fontsize="medium")


def draw_track(axes: Any, window: int, methods: Mapping[str, Method], data: BeamData) -> None:
    """Draw past and best beams of a window over time, its lines of sight, and what was predicted."""
    start = int(data.starts["val"][window])
    frames = np.arange(data.past + data.future)
    step = frames - (data.past - 1)
    beams = data.tx_beam[start : start + len(frames)].cpu().numpy().astype(float)
    beams[beams < 0] = np.nan
    is_los = data.is_los[start : start + len(frames)].cpu().numpy()
    axes.fill_between(step, 0, 1, where=is_los, transform=axes.get_xaxis_transform(), color="0.93", step="mid", lw=0)
    axes.plot(step, beams, "o", color=PURPLE, markersize=3.5, label="best beam")
    for label, (marker, color) in MARKS.items():
        if label in methods:
            named = methods[label].beams[0, window]
            style = {"marker": marker, "color": color, "ms": 4, "mfc": "none", "lw": 0}
            axes.plot(step[data.past :], named, label=LABELS[label], **style)
    axes.axvline(0.5, color="0.5", lw=0.8)
    axes.set(xlabel="frames after now (gray: line of sight)", ylabel="transmit beam", ylim=(-1, data.beams))
    axes.legend(fontsize="x-small", loc="best")
    plain_axes(axes)
