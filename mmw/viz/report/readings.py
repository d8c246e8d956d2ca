"""Scalar sensors over time: a chart for each number of a sample, a line for each agent."""

from mmw.dataset import Dataset
from mmw.viz.plots.readings import draw_reading, read_readings, scalar_sensors
from mmw.viz.plots.samples import label_of
from mmw.viz.report.css import COLORS, DASHES, SERIES_COUNT
from mmw.viz.report.figures import new_chart, svg
from mmw.viz.report.html import card, details, legend, paragraph
from mmw.viz.report.inventory import Inventory
from mmw.viz.report.sampling import sample_range, sampled

MAX_FRAMES = 300
"""Frames of a line at most."""


def readings_section(data: Dataset, inventory: Inventory, scenario: str) -> str:
    """Return charts of the scalar sensors of a scenario in its first weather; empty if it has none."""
    weathers = inventory.weathers(scenario)
    sensors = scalar_sensors(data, scenario)
    if not weathers or not sensors:
        return ""
    frames = sample_range(inventory.frames(scenario, weathers[0]), MAX_FRAMES)
    colors = [COLORS[f"s{number}"] for number in range(SERIES_COUNT)]
    parts = []
    for name, spec in sensors.items():
        readings = read_readings(data, scenario, weathers[0], name, frames=frames)
        charts = []
        for column in readings.columns:
            figure, axes = new_chart("time [s]", "")
            draw_reading(axes, readings, column, colors, DASHES)
            chart = svg(figure, f"{spec.title} {name}: {label_of(column)} over time")
            charts.append(card(label_of(column), chart))
        lines = legend((f"line s{number % SERIES_COUNT}", agent) for number, agent in enumerate(readings.by_agent))
        parts.append(details(f"{spec.title}: {name}", f"{lines}<div class=grid>{''.join(charts)}</div>"))
    note = f"Samples in {weathers[0]}, a line for each agent; of {sampled(frames)} those that there are."
    return "".join(parts) + paragraph(note, "note")
