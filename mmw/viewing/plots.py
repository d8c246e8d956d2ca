"""Plots of a dataset with matplotlib (extra `plot`): a LiDAR scan, a depth image, a radio link over time."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.dataset as ds

from mmw.tables.encode import decode_depth


def read_rows(root: Path, table: str, columns: list[str], **where: Any) -> dict[str, list[Any]]:
    """Return columns of the rows of a table whose keys have the given values.

    Args:
        root: Dataset folder.
        table: Table name.
        columns: Columns to read.
        where: Key -> value, such as `scenario="s"`, `frame=3`.

    Raises:
        ValueError: If no row has these keys.
    """
    files = sorted((root / table).rglob("*.parquet"))
    condition = None
    for key, value in where.items():
        term = ds.field(key) == value
        condition = term if condition is None else condition & term
    found = ds.dataset(files).to_table(columns=columns, filter=condition)
    if not found.num_rows:
        raise ValueError(f"{root}: table {table!r} has no row with {where}; give keys that the dataset holds")
    return found.to_pydict()


def plot_lidar(root: Path, scenario: str, weather: str, frame: int, agent: str, out: Path) -> None:
    """Draw one sweep from above: returns coloured by intensity, those on vehicles in red."""
    from matplotlib.figure import Figure

    key = {"scenario": scenario, "weather": weather, "frame": frame}
    sweep = read_rows(root, "lidar", ["x", "y", "z", "intensity", "object_id"], **key, agent=agent)
    x, y, intensity, thing = (np.array(sweep[name][0]) for name in ("x", "y", "intensity", "object_id"))
    vehicles = np.isin(thing, read_rows(root, "boxes", ["object_id"], **key)["object_id"])
    figure = Figure(figsize=(9, 9), layout="constrained")
    axes = figure.subplots()
    axes.set_facecolor("black")
    axes.scatter(x[~vehicles], y[~vehicles], s=0.6, c=intensity[~vehicles], cmap="viridis", vmin=0, vmax=0.5)
    axes.scatter(x[vehicles], y[vehicles], s=2.0, c="red")
    axes.plot(0, 0, "w^")
    axes.set(xlim=(-60, 60), ylim=(-60, 60), aspect="equal", xlabel="x forward [m]", ylabel="y left [m]")
    axes.set_title(f"{scenario}, {weather}, {agent}, frame {frame}: {len(x):,} returns; red: on vehicles")
    figure.savefig(out, dpi=100)


def plot_depth(root: Path, scenario: str, weather: str, frame: int, agent: str, out: Path) -> None:
    """Draw one depth image on a logarithmic scale."""
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure

    row = read_rows(root, "depth", ["image"], scenario=scenario, weather=weather, frame=frame, agent=agent)
    depth = decode_depth(row["image"][0]["bytes"])
    figure = Figure(figsize=(9, 6.6), layout="constrained")
    axes = figure.subplots()
    image = axes.imshow(np.where(np.isfinite(depth), depth, np.nan), cmap="magma_r", norm=LogNorm(2, 150))
    figure.colorbar(image, ax=axes, label="depth along the optical axis [m]", shrink=0.8)
    axes.set_title(f"{scenario}, {weather}, {agent}, frame {frame}")
    figure.savefig(out, dpi=100)


def plot_link(root: Path, scenario: str, weather: str, agent: str, carrier_hz: float, out: Path) -> None:
    """Draw one link over time: gain with its line of sight, and delay and Doppler shift of every path."""
    from matplotlib.figure import Figure

    key = {"scenario": scenario, "weather": weather, "agent": agent, "carrier_hz": carrier_hz}
    links = read_rows(root, "links", ["frame", "peer", "gain_db", "is_los"], **key)
    paths = read_rows(root, "paths", ["frame", "tau_s", "a_re", "a_im", "doppler_hz"], **key)
    time = np.array(links["frame"]) / 100
    gain = np.array([np.nan if value is None else value for value in links["gain_db"]])
    is_los = np.array(links["is_los"])
    path_time, power = np.array(paths["frame"]) / 100, np.hypot(paths["a_re"], paths["a_im"])
    shade = {"c": 20 * np.log10(np.maximum(power, 1e-12)), "s": 4, "cmap": "plasma", "vmin": -130, "vmax": -80}
    figure = Figure(figsize=(10, 8), layout="constrained")
    top, middle, bottom = figure.subplots(3, sharex=True)
    order = np.argsort(time)
    top.plot(time[order], gain[order], lw=1, color="0.4")
    top.scatter(time[is_los], gain[is_los], s=5, color="tab:green", label="line of sight")
    top.scatter(time[~is_los], gain[~is_los], s=5, color="tab:red", label="blocked")
    top.set(ylabel="path gain [dB]")
    top.legend(loc="lower left")
    points = middle.scatter(path_time, np.array(paths["tau_s"]) * 1e9, **shade)
    middle.set(ylabel="delay [ns]")
    bottom.scatter(path_time, paths["doppler_hz"], **shade)
    bottom.set(ylabel="Doppler shift [Hz]", xlabel="time [s]")
    figure.colorbar(points, ax=[middle, bottom], label="path gain [dB]")
    top.set_title(f"{scenario}, {weather}: {links['peer'][0]} -> {agent} at {carrier_hz / 1e9:g} GHz")
    figure.savefig(out, dpi=100)
