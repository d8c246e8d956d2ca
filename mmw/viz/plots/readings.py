"""Scalar sensors over time: one chart for each number of a sample, a line for each agent."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pyarrow as pa

from mmw.config.sensor_spec import SENSORS, SensorSpec
from mmw.core.errors import InputError
from mmw.core.frame_rate import seconds
from mmw.dataset import Dataset
from mmw.viz.plots.samples import label_of
from mmw.viz.plots.style import AGENT_COLORS, at_least, new_figure, plain_axes

if TYPE_CHECKING:
    from mmw.viz.plots.style import Canvas

COLUMNS = 2
"""Charts side by side."""

MIN_SPAN = 1e-6
"""Least span of a y axis, in the number's unit: 0.1 m of latitude, and no rounding errors. Design value."""

MARKED = 50
"""Samples up to which each has a marker. Design value."""


@dataclass(frozen=True)
class Readings:
    """Samples of the sensors of one name, which several agents may carry."""

    columns: tuple[pa.Field, ...]
    """Numbers of a sample."""
    by_agent: dict[str, dict[str, np.ndarray]]
    """Agent -> `frame`, `time_s` and `columns`, by frame, shape [T] each."""


def scalar_columns(spec: SensorSpec) -> tuple[pa.Field, ...]:
    """Return the numbers that are drawn of a sample: those of its learning windows, else all."""
    table = spec.tables[0]
    names = spec.window.columns if spec.window is not None and spec.window.kind == "numbers" else ()
    return tuple(
        column for column in table.columns
        if (column.name in names if names else column.name not in table.key and _is_number(column.type))
    )  # fmt: skip


def _is_number(type_: pa.DataType) -> bool:
    return pa.types.is_floating(type_) or pa.types.is_integer(type_) or pa.types.is_boolean(type_)


def scalar_sensors(data: Dataset, scenario: str) -> dict[str, SensorSpec]:
    """Return the scalar sensors of a scenario by name; their tables are in the dataset."""
    if "sensors" not in data.tables:
        return {}
    rows = data.read("sensors", columns=["sensor", "type"], scenario=scenario).to_pylist()
    found = {row["sensor"]: SENSORS.get(row["type"]) for row in rows}
    return {
        name: spec for name, spec in found.items()
        if spec is not None and spec.kind == "scalar" and spec.tables[0].name in data.tables
    }  # fmt: skip


def read_readings(
    data: Dataset, scenario: str, weather: str, sensor: str, *, agents: Sequence[str] = (), frames: range | None = None
) -> Readings:
    """Return the samples of a scalar sensor over time, of all agents that carry it unless some are named.

    Raises:
        InputError: If the scenario has no such scalar sensor.
    """
    known = scalar_sensors(data, scenario)
    if sensor not in known:
        raise InputError(
            f"{data.root}: {scenario} has no scalar sensor {sensor!r}; it has {', '.join(known) or 'none'}; name one"
        )
    columns, found = scalar_columns(known[sensor]), {}
    names = ["frame", "agent", "sensor", *(column.name for column in columns)]
    rows = data.numpy(
        known[sensor].tables[0].name, columns=names, scenario=scenario, weather=weather, frames=frames, sensor=sensor
    )
    for agent in dict.fromkeys(rows["agent"].tolist()):
        if not agents or agent in agents:
            own = np.flatnonzero(rows["agent"] == agent)
            own = own[np.argsort(rows["frame"][own], kind="stable")]
            found[agent] = {name: rows[name][own] for name in names}
            found[agent]["time_s"] = seconds(found[agent]["frame"], data.frame_rate_hz(scenario))
    return Readings(columns, found)


def plot_readings(
    data: Dataset, scenario: str, weather: str, sensor: str, *,
    agents: Sequence[str] = (), frames: range | None = None, figure: "Canvas | None" = None,
) -> "Canvas":  # fmt: skip
    """Draw the numbers of a scalar sensor over time, a line for each agent.

    Args:
        data: The dataset.
        scenario: Scenario name.
        weather: Weather name.
        sensor: Sensor name, such as `imu`.
        agents: Agents; all that carry it if empty.
        frames: Frames; None draws all.
        figure: Figure or subfigure to draw into; None makes a new one.

    Returns:
        The figure.

    Raises:
        InputError: If the scenario has no such scalar sensor.
        ImportError: If matplotlib is not installed.

    Examples:
        >>> import mmw
        >>> data = mmw.open_dataset("out/quickstart")
        >>> plot_readings(data, "town03_roundabout", "sunny", "imu").savefig("imu.png")
    """
    readings = read_readings(data, scenario, weather, sensor, agents=agents, frames=frames)
    count = min(COLUMNS, len(readings.columns))
    rows = -(-len(readings.columns) // count)
    canvas = new_figure(figure, (5.4 * count + 0.6, 1.9 * rows + 0.9))
    grid = canvas.subplots(rows, count, squeeze=False, sharex=True)
    for axes, column in zip(grid.T.ravel(), readings.columns, strict=False):
        draw_reading(axes, readings, column, AGENT_COLORS)
        axes.set_ylabel(label_of(column))
        plain_axes(axes)
    for axes in grid[-1]:
        axes.set_xlabel("time [s]")
    for axes in grid.T.ravel()[len(readings.columns) :]:
        axes.set_axis_off()
    canvas.align_ylabels(list(grid.ravel()))
    if len(readings.by_agent) > 1:
        grid[0, 0].legend(loc="best", fontsize="x-small", framealpha=0.9)
    canvas.suptitle(f"{sensor}: {scenario}, {weather}", fontsize="large")
    return canvas


def draw_reading(
    axes: Any, readings: Readings, column: pa.Field, colors: Sequence[str], dashes: Sequence[Any] = ("-",)
) -> None:
    """Draw one number of a sample over time, a line for each agent, in given colors and dashes, which repeat."""
    for number, (agent, rows) in enumerate(readings.by_agent.items()):
        axes.plot(
            rows["time_s"], rows[column.name].astype(float), color=colors[number % len(colors)],
            ls=dashes[number % len(dashes)], lw=1.4, label=agent, marker="o" if len(rows["frame"]) <= MARKED else "",
            markersize=3.0,
        )  # fmt: skip
    axes.ticklabel_format(axis="y", useOffset=False)
    axes.locator_params(axis="x", nbins=6)
    at_least(axes, MIN_SPAN)
