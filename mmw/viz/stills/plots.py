"""Plots of a dataset with matplotlib (extra `plot`): a LiDAR scan, a radar sample, images, a radio link over time."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.dataset as ds
from PIL import Image

from mmw.core.errors import InputError
from mmw.core.transforms import compose, invert, pose_from_ypr, transform_points
from mmw.storage.codecs.images import decode_depth, decode_instance, decode_rgb

RADAR_LABELS = (("object", "o"), ("rain clutter", "s"), ("false alarm", "X"))
"""Names and markers of `radar.label`."""

VELOCITY_M_S = 8.0
"""Radial velocity at the ends of the colour scale [m/s]."""

POSE = ["x", "y", "z", "qx", "qy", "qz", "qw"]
"""Columns of a pose."""

SMALL_BOX_PX = 12
"""Height up to which a 2-D box gets no text [px]."""

FOOTPRINT = np.array([[1, 1, 0], [1, -1, 0], [-1, -1, 0], [-1, 1, 0], [1, 1, 0]]) / 2.0
"""Outline of a box of unit size from above."""


def read_rows(root: Path, table: str, columns: list[str], **where: Any) -> dict[str, list[Any]]:
    """Return columns of the rows of a table whose keys have the given values.

    Args:
        root: Dataset folder.
        table: Table name.
        columns: Columns to read.
        where: Key -> value, such as `scenario="s"`, `frame=3`.

    Raises:
        InputError: If no row has these keys.
    """
    found = find_rows(root, table, columns, **where)
    if not next(iter(found.values())):
        raise InputError(f"{root}: table {table!r} has no row with {where}; give keys that the dataset holds")
    return found


def find_rows(root: Path, table: str, columns: list[str], **where: Any) -> dict[str, list[Any]]:
    """Return the same, empty columns where there is no such row."""
    files = sorted((root / table).rglob("*.parquet"))
    if not files:
        return {name: [] for name in columns}
    condition = None
    for key, value in where.items():
        term = ds.field(key) == value
        condition = term if condition is None else condition & term
    return ds.dataset(files).to_table(columns=columns, filter=condition).to_pydict()


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


def sensor_pose(root: Path, scenario: str, weather: str, frame: int, agent: str, sensor: str) -> np.ndarray:
    """Return the pose of a sensor in a frame, sensor to world, shape [7]."""
    at = read_rows(root, "poses", POSE, scenario=scenario, weather=weather, frame=frame, agent=agent)
    mount = read_rows(root, "sensors", POSE, scenario=scenario, agent=agent, sensor=sensor)
    return compose(*(np.array([values[0] for values in pose.values()]) for pose in (at, mount)))


def draw_radar(root: Path, scenario: str, weather: str, frame: int, agent: str, above: Any, below: Any) -> Any:
    """Draw one radar sample from above and SNR (in `compat` velocity) over range.

    Behind it lie the boxes of the frame and, if the agent has a LiDAR, the surfaces that this one sees.

    Args:
        root: Dataset folder.
        scenario: Scenario name.
        weather: Weather name.
        frame: Frame.
        agent: Whose radar it is.
        above: Axes for the view from above.
        below: Axes for the values over range.

    Returns:
        What a colour bar of the radial velocity needs.
    """
    key = {"scenario": scenario, "weather": weather, "frame": frame}
    names = ["sensor", "range", "azimuth", "elevation", "velocity", "snr_db", "label"]
    sample = read_rows(root, "radar", names, **key, agent=agent)
    distance, azimuth, elevation, velocity = (np.array(sample[name][0]) for name in names[1:5])
    across, label = distance * np.cos(elevation), np.array(sample["label"][0])
    x, y = across * np.cos(azimuth), across * np.sin(azimuth)
    to_sensor = invert(sensor_pose(root, scenario, weather, frame, agent, sample["sensor"][0]))
    if (root / "lidar").is_dir() and agent in read_rows(root, "lidar", ["agent"], **key)["agent"]:
        _draw_surfaces(root, key | {"agent": agent}, to_sensor, above)
    boxes = read_rows(root, "boxes", ["x", "y", "z", "yaw", "pitch", "roll", "length", "width", "height"], **key)
    for *place, yaw, pitch, roll, length, width, height in zip(*boxes.values(), strict=True):
        size = np.array([length, width, height])
        outline = transform_points(compose(to_sensor, pose_from_ypr(place, yaw, pitch, roll)), FOOTPRINT * size)
        above.plot(-outline[:, 1], outline[:, 0], color="tab:green", lw=0.9)
    is_physical = sample["snr_db"][0] is not None
    value = np.array(sample["snr_db" if is_physical else "velocity"][0])
    shade = {"cmap": "coolwarm", "vmin": -VELOCITY_M_S, "vmax": VELOCITY_M_S, "edgecolors": "black", "linewidths": 0.4}
    points = None
    for number, (_, marker) in enumerate(RADAR_LABELS):
        is_it = label == number
        style = {"c": velocity[is_it], "marker": marker, "s": 16 if is_physical else 4, **shade}
        points = above.scatter(-y[is_it], x[is_it], **style)
        below.scatter(distance[is_it], value[is_it], **style)
    above.plot(0, 0, "k^")
    above.set(aspect="equal", xlabel="right [m]", ylabel="forward [m]", xlim=(-70, 70), ylim=(-4, 100))
    counts = [f"{(label == n).sum():,} {name}" for n, (name, _) in enumerate(RADAR_LABELS) if (label == n).any()]
    above.set_title(f"{weather}\n{', '.join(counts)}", fontsize=10)
    below.set(
        xlabel="range [m]", ylabel="SNR [dB]" if is_physical else "radial velocity [m/s]", xscale="log", xlim=(1, 120)
    )
    return points


def _draw_surfaces(root: Path, key: dict[str, Any], to_sensor: np.ndarray, above: Any) -> None:
    sweep = read_rows(root, "lidar", ["sensor", "x", "y", "z", "label"], **key)
    is_surface = np.array(sweep["label"][0]) == 0
    points = np.stack([sweep[axis][0] for axis in "xyz"], axis=1)[is_surface]
    pose = sensor_pose(root, key["scenario"], key["weather"], key["frame"], key["agent"], sweep["sensor"][0])
    x, y, _ = transform_points(compose(to_sensor, pose), points).T
    above.scatter(-y, x, s=0.6, linewidths=0, color="0.75")


def plot_radar(root: Path, scenario: str, weather: str, frame: int, agent: str, out: Path) -> None:
    """Draw one radar sample; see `draw_radar`."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(7, 9), layout="constrained")
    above, below = figure.subplots(2, height_ratios=(1.6, 1))
    points = draw_radar(root, scenario, weather, frame, agent, above, below)
    figure.colorbar(points, ax=above, label="radial velocity, + receding [m/s]", shrink=0.8)
    figure.savefig(out, dpi=100)


def segmented_cameras(root: Path, **where: Any) -> list[tuple[str, str]]:
    """Return agent and name of the depth cameras that have a segmentation too, among rows with the given keys."""
    found = [find_rows(root, table, ["agent", "sensor"], **where) for table in ("depth", "segmentation")]
    depth, segmentation = (list(zip(rows["agent"], rows["sensor"], strict=True)) for rows in found)
    return [camera for camera in depth if camera in segmentation]


def plot_camera(root: Path, scenario: str, weather: str, frame: int, agent: str, out: Path) -> None:
    """Draw one depth image, its instance image and the 2-D boxes; solid: visible pixels, dashed: the whole body."""
    from matplotlib.colors import LogNorm, hsv_to_rgb
    from matplotlib.figure import Figure
    from matplotlib.patches import Rectangle

    key: dict[str, Any] = {"scenario": scenario, "weather": weather, "frame": frame, "agent": agent}
    key["sensor"] = segmented_cameras(root, **key)[0][1]
    depth = decode_depth(read_rows(root, "depth", ["image"], **key)["image"][0]["bytes"])
    instance = decode_instance(read_rows(root, "segmentation", ["instance"], **key)["instance"][0]["bytes"])
    # Steps of the golden ratio give neighbours in number unlike hues.
    hue = np.stack([instance * 0.618034 % 1.0, 0.35 + instance * 0.7548777 % 0.5, 0.55 + instance * 0.569841 % 0.4], -1)
    figure = Figure(figsize=(13, 5.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    image = left.imshow(np.where(np.isfinite(depth), depth, np.nan), cmap="magma_r", norm=LogNorm(2, 150))
    figure.colorbar(image, ax=left, label="depth along the optical axis [m]", location="left", shrink=0.8)
    right.imshow(np.where(instance[..., None] < 0, 1.0, hsv_to_rgb(hue)), interpolation="nearest")
    sides = ["u_min", "v_min", "u_max", "v_max"]
    columns = ["pixels", "distance", *sides, *(f"amodal_{side}" for side in sides)]
    framed = find_rows(root, "boxes_2d", columns, **key)  # a view may frame nobody
    for pixels, distance, *corners in zip(*framed.values(), strict=True):
        if not pixels:
            continue
        for (u0, v0, u1, v1), style in ((corners[:4], "-"), (corners[4:], "--")):
            for axes, color in ((left, "tab:cyan"), (right, "black")):
                # Pixel (0, 0) is drawn around (0, 0); boxes count from its corner.
                corner = (u0 - 0.5, v0 - 0.5)
                axes.add_patch(Rectangle(corner, u1 - u0, v1 - v0, fill=False, ec=color, ls=style, lw=1.2))
        if corners[3] - corners[1] > SMALL_BOX_PX:
            plate = {"facecolor": "white", "edgecolor": "none", "alpha": 0.8, "pad": 1.0}
            right.text(max(corners[0], 6), corners[1] - 8, f"{distance:.0f} m", fontsize=8, va="bottom", bbox=plate)
    left.set_title(f"depth: {scenario}, {agent}, frame {frame}")
    right.set_title("instances; boxes: seen pixels (solid), 3-D box (dashed)")
    figure.savefig(out, dpi=80)


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


def plot_rgb(root: Path, scenario: str, weathers: Sequence[str], frame: int, agent: str, out: Path) -> None:
    """Write the images of all RGB cameras of an agent side by side, a row for each weather, as they are stored.

    Args:
        root: Dataset folder.
        scenario: Scenario name.
        weathers: Weathers from top to bottom.
        frame: Frame; where a camera has none, its last image before it is taken, or else its first.
        agent: Whose cameras.
        out: PNG file.

    Raises:
        InputError: If the agent has no RGB image in a weather.
    """
    rows = []
    for weather in weathers:
        key = {"scenario": scenario, "weather": weather, "agent": agent}
        taken = read_rows(root, "rgb", ["sensor", "frame"], **key)
        of_sensor: dict[str, list[int]] = {}
        for sensor, number in zip(taken["sensor"], taken["frame"], strict=True):
            of_sensor.setdefault(sensor, []).append(number)
        images = []
        for sensor, frames in of_sensor.items():
            number = max((n for n in frames if n <= frame), default=min(frames))
            cell = read_rows(root, "rgb", ["image"], **key, sensor=sensor, frame=number)["image"][0]
            images.append(Image.fromarray(decode_rgb(cell["bytes"])))
        rows.append(images)
    width = max(sum(image.width for image in images) for images in rows)
    heights = [max(image.height for image in images) for images in rows]
    sheet = Image.new("RGB", (width, sum(heights)))
    for images, top in zip(rows, np.cumsum([0, *heights[:-1]]).tolist(), strict=True):
        left = 0
        for image in images:
            sheet.paste(image, (left, top))
            left += image.width
    sheet.save(out)


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
