"""Radio paths of one link over the map of the town, from above and from the side, in the manner of DeepMIMO."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mmw.core.errors import InputError
from mmw.dataset import Dataset, Frame
from mmw.dataset.link import Link
from mmw.viz.plots.bird_eye import OUTLINE
from mmw.viz.plots.map import TownPlan, read_town_plan
from mmw.viz.plots.style import (
    BLUE,
    BOX_STYLES,
    BUILDING,
    GREY,
    ORANGE,
    PATH_MARKS,
    ROAD,
    box_kind,
    gain_colors,
    label_place,
    new_figure,
    plain_axes,
)  # fmt: skip

if TYPE_CHECKING:
    from mmw.viz.plots.style import Canvas

ANTENNA = "antenna"
"""Type of antennas in table `sensors`."""

MARGIN_M = 15.0
"""Margin of the map around the paths [m]. Design value."""

MAP_RATIO = 1.5
"""Width of the map over its height. Design value."""

SPAN_DB = 60.0
"""Range of the color scale below the strongest path at most [dB]. Design value."""


def plot_paths(
    data: Dataset,
    scenario: str,
    weather: str,
    frame: int,
    tx: str,
    rx: str,
    *,
    carrier_hz: float | None = None,
    town: bool = True,
    strongest: int | None = None,
    figure: "Canvas | None" = None,
) -> "Canvas":
    """Draw the radio paths of a link in one frame over the map: from above, and from the side, colored by gain.

    Args:
        data: The dataset.
        scenario: Scenario name.
        weather: Weather name.
        frame: Frame.
        tx: Transmitter, `peer` of the link.
        rx: Receiver, `agent` of the link.
        carrier_hz: Carrier [Hz]; None means the first.
        town: Draw lanes and buildings; a town is read in some seconds, once.
        strongest: Draw so many of the strongest paths; None draws all.
        figure: Figure or subfigure to draw into; None makes a new one.

    Returns:
        The figure. A link without any path is drawn without paths, and the title says so.

    Raises:
        InputError: If the dataset has no such frame, link or carrier.
        ImportError: If matplotlib is not installed.
    """
    found = data.frame(scenario, weather, frame)
    link = find_link(found, tx, rx, carrier_hz)
    canvas = new_figure(figure, (10.5, 9.0))
    above, aside = canvas.subplots(2, 1, height_ratios=(3.4, 1))
    draw_map(above, found, read_town_plan(data, scenario) if town else TownPlan())
    lines = draw_paths_above(above, found, link, strongest=strongest)
    draw_paths_aside(aside, found, link, strongest=strongest)
    if lines is not None:
        canvas.colorbar(lines, ax=[above, aside], label="path gain |a|² [dB]", shrink=0.85, pad=0.01)
    gain = "no path" if link.gain_db is None else f"{len(link.a)} paths, {link.gain_db:.1f} dB"
    sight = "line of sight" if link.is_los else "blocked"
    canvas.suptitle(
        f"{tx} to {rx} at {link.carrier_hz / 1e9:g} GHz: {gain}, {sight}\n{scenario}, {weather}, frame {frame} "
        f"({found.time_s:.2f} s)", fontsize="medium",
    )  # fmt: skip
    return canvas


def find_link(frame: Frame, tx: str, rx: str, carrier_hz: float | None) -> Link:
    """Return a link of a frame, between the first antennas of both ends.

    Raises:
        InputError: If there is no such link, or no such carrier.
    """
    known = {(link.peer, link.agent, link.carrier_hz): link for link in reversed(frame.links)}
    where = f"{frame.data.root}: frame {frame.frame} of {frame.scenario} {frame.weather}"
    return known[tx, rx, choose_carrier(where, list(known), tx, rx, carrier_hz)]


def choose_carrier(
    where: str, links: Sequence[tuple[str, str, float]], tx: str, rx: str, carrier_hz: float | None
) -> float:
    """Return the carrier of a link [Hz], the lowest if none is given.

    Args:
        where: Part of the dataset, for messages.
        links: Transmitter, receiver and carrier of the links there.
        tx: Transmitter.
        rx: Receiver.
        carrier_hz: Carrier [Hz]; None means the lowest.

    Raises:
        InputError: If there is no such link, or no such carrier.
    """
    carriers = sorted(carrier for *ends, carrier in links if ends == [tx, rx])
    if not carriers:
        known = list(dict.fromkeys(f"{peer} to {agent}" for peer, agent, _ in links))
        listed = ", ".join(known[:8]) + (" and more" if len(known) > 8 else "")
        raise InputError(f"{where} has no link {tx} to {rx}; it has {listed or 'none'}; name one of these")
    if carrier_hz is not None and carrier_hz not in carriers:
        listed = ", ".join(f"{carrier:g}" for carrier in carriers)
        raise InputError(f"{where}: link {tx} to {rx} has no carrier {carrier_hz:g} Hz; it has {listed}; name one")
    return carriers[0] if carrier_hz is None else carrier_hz


def link_ends(frame: Frame, link: Link) -> np.ndarray:
    """Return the places of the transmitting and the receiving antenna in the world [m], shape [2, 3]."""
    ends = ((link.peer, link.peer_antenna), (link.agent, link.antenna))
    return np.stack([frame.agents[agent].sensor_pose(antenna)[:3] for agent, antenna in ends])


def path_lines(frame: Frame, link: Link) -> list[np.ndarray]:
    """Return each path from antenna to antenna in the world [m], shape [2 + interactions, 3] each."""
    ends = link_ends(frame, link)
    return [np.stack([ends[0], *link.vertices(path), ends[1]]) for path in range(len(link.a))]


def draw_map(axes: Any, frame: Frame, plan: TownPlan) -> None:
    """Draw lanes, buildings, and the boxes and agents of a frame in the plan of the world.

    Args:
        axes: matplotlib axes to draw on.
        frame: The frame.
        plan: Lanes and buildings, from `read_town_plan`.
    """
    from matplotlib.collections import PolyCollection

    draw_town_plan(axes, plan)
    rows = frame.boxes
    if len(rows):
        floors = rows.corners[:, OUTLINE, :2]
        for kind in BOX_STYLES:
            own = [box_kind(*pair) == kind for pair in zip(rows["agent"], rows["category"], strict=True)]
            axes.add_collection(
                PolyCollection(
                    list(floors[own]), facecolors=BOX_STYLES[kind][0], edgecolors="0.25", linewidths=0.6, zorder=2
                )
            )


def draw_town_plan(axes: Any, plan: TownPlan) -> None:
    """Draw lanes and buildings in the plan of the world."""
    from matplotlib.collections import LineCollection, PolyCollection

    if plan.lanes:
        areas = [_widened(line, width) for line, width in zip(plan.lanes, plan.widths, strict=True)]
        axes.add_collection(PolyCollection(areas, facecolors=ROAD, edgecolors=ROAD, linewidths=0.3, zorder=0))
        axes.add_collection(LineCollection(list(plan.lanes), colors="white", linewidths=0.5, zorder=0.5))
    if plan.buildings:
        axes.add_collection(
            PolyCollection(list(plan.buildings), facecolors=BUILDING, edgecolors="0.55", linewidths=0.5, zorder=1)
        )


def draw_paths_above(axes: Any, frame: Frame, link: Link, *, strongest: int | None = None) -> Any:
    """Draw the paths of a link in the plan of the world, colored by gain.

    Args:
        axes: matplotlib axes to draw on.
        frame: The frame.
        link: A link of it.
        strongest: Draw so many of the strongest paths; None draws all.

    Returns:
        Mappable for a color bar; None without any path.
    """
    lines = path_lines(frame, link)
    drawn = _draw(axes, link, [line[:, :2] for line in lines], strongest)
    ends = link_ends(frame, link)[:, :2]
    _draw_both_ends(axes, ends, (link.peer, link.agent))
    frame_map(axes, np.concatenate([ends, *(line[:, :2] for line in lines)]))
    path_legend(axes, {int(kind) for kinds in link.paths["interactions"] for kind in kinds}, has_los=link.is_los)
    return drawn


def frame_map(axes: Any, points: np.ndarray) -> None:
    """Set limits and labels of a map around points of the world [m], shape [N, 2], with `MARGIN_M` and `MAP_RATIO`."""
    middle, half = (points.min(axis=0) + points.max(axis=0)) / 2.0, np.ptp(points, axis=0) / 2.0 + MARGIN_M
    half = np.maximum(half, half[::-1] * [MAP_RATIO, 1.0 / MAP_RATIO])
    low, high = middle - half, middle + half
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), xlabel="x east [m]", ylabel="y north [m]", aspect="equal")


def draw_paths_aside(axes: Any, frame: Frame, link: Link, *, strongest: int | None = None) -> Any:
    """Draw the paths of a link from the side: height over the distance along the line from transmitter to receiver.

    Arguments and return value are those of `draw_paths_above`.
    """
    ends = link_ends(frame, link)
    flat = ends[1, :2] - ends[0, :2]
    along = flat / max(float(np.linalg.norm(flat)), 1e-9)

    def side(points: np.ndarray) -> np.ndarray:
        return np.stack([(points[:, :2] - ends[0, :2]) @ along, points[:, 2]], axis=1)

    drawn = _draw(axes, link, [side(line) for line in path_lines(frame, link)], strongest)
    _draw_both_ends(axes, side(ends), ("", ""))
    axes.autoscale_view()
    axes.margins(0.04, 0.12)
    axes.set(xlabel=f"distance from {link.peer} towards {link.agent} [m]", ylabel="height z [m]")
    plain_axes(axes)
    return drawn


def _draw(axes: Any, link: Link, lines: list[np.ndarray], strongest: int | None) -> Any:
    """Draw the paths of a link, or only so many of the strongest."""
    order = np.argsort(gains_db(link.a), kind="stable")
    order = order[max(len(order) - strongest, 0) :] if strongest is not None else order
    interactions = link.paths["interactions"]
    return draw_path_lines(
        axes, [lines[path] for path in order], gains_db(link.a)[order], link.paths["order"][order] == 0,
        [interactions[path] for path in order],
    )  # fmt: skip


def draw_path_lines(
    axes: Any,
    lines: Sequence[np.ndarray],
    gain_db: np.ndarray,
    is_los: np.ndarray,
    interactions: Sequence[Sequence[int]],
) -> Any:
    """Draw paths as lines colored by gain with a mark at each interaction, the strongest on top.

    Args:
        axes: matplotlib axes to draw on.
        lines: Points of each path from transmitter to receiver, in the axes' coordinates [m], shape [2 + n, 2] each.
        gain_db: Gain of each path [dB], shape [P].
        is_los: True for the line of sight, shape [P].
        interactions: Numbers in `PATH_MARKS` of the interactions of each path; another number has no mark.

    Returns:
        Mappable for a color bar; None without any path.
    """
    from matplotlib.collections import LineCollection

    if not len(lines):
        return None
    order = np.argsort(gain_db, kind="stable")
    drawn = LineCollection(
        [lines[path] for path in order], array=gain_db[order], cmap=gain_colors(), zorder=4,
        linewidths=[2.6 if is_los[path] else 1.3 for path in order],
    )  # fmt: skip
    drawn.set_clim(*gain_limits(gain_db))
    axes.add_collection(drawn)
    for marker, _, number in PATH_MARKS.values():
        points = [
            lines[path][1 + step] for path in order for step, kind in enumerate(interactions[path]) if kind == number
        ]
        if points:
            style = {"c": "black"} if marker == "x" else {"c": "white", "edgecolors": "black"}
            axes.scatter(*np.array(points).T, s=22, marker=marker, linewidths=0.9, zorder=5, **style)
    return drawn


def gain_limits(gain_db: np.ndarray) -> tuple[float, float]:
    """Return the ends of the color scale of paths [dB]: the strongest, and the weakest within `SPAN_DB` of it."""
    top = float(gain_db.max())
    low = max(float(gain_db.min()), top - SPAN_DB)
    return (low if low < top else top - 1.0), top


def gains_db(a: np.ndarray) -> np.ndarray:
    """Return the gain of each path, 20 log10 |a| [dB], shape [P]."""
    return 20.0 * np.log10(np.maximum(np.abs(a), 1e-30))


def _draw_both_ends(axes: Any, ends: np.ndarray, names: tuple[str, str]) -> None:
    for place, name, is_tx in zip(ends, names, (True, False), strict=True):
        draw_end(axes, place, name, is_tx=is_tx)


def draw_end(axes: Any, place: np.ndarray, name: str, *, is_tx: bool) -> None:
    """Draw a transmitter or receiver at a place in the axes' coordinates, shape [2], with its name unless empty."""
    color, marker = (BLUE, "^") if is_tx else (ORANGE, "o")
    axes.scatter(*place, s=90, marker=marker, c=color, edgecolors="black", linewidths=1.0, zorder=6)
    if name:
        label_place(axes, name, place, 8.0)


def path_legend(axes: Any, present: set[int], *, has_los: bool, place: str = "best") -> None:
    """Add a legend of the ends, of interactions and of the line of sight.

    Args:
        axes: matplotlib axes to draw on.
        present: Interactions that are drawn, numbers in `PATH_MARKS`.
        has_los: True if a line of sight is drawn.
        place: Place of the legend as in matplotlib; `best` takes seconds among many paths.
    """
    from matplotlib.lines import Line2D

    def mark(marker: str, color: str, name: str, edge: str = "black") -> Any:
        return Line2D([], [], ls="", marker=marker, color=color, markeredgecolor=edge, label=name)

    handles = [mark("^", BLUE, "transmitter"), mark("o", ORANGE, "receiver")]
    handles += [
        mark(marker, "white", name) for marker, name, number in PATH_MARKS.values() if number in present
    ]  # fmt: skip
    if has_los:
        handles.append(Line2D([], [], color=GREY, lw=2.6, label="line of sight"))
    axes.legend(handles=handles, loc=place, fontsize="small", framealpha=0.9)


def _widened(line: np.ndarray, width: float) -> np.ndarray:
    """Return the outline of a lane around its center line, shape [2 N, 2]."""
    along = np.gradient(line, axis=0)
    left = np.stack([-along[:, 1], along[:, 0]], axis=1) / np.maximum(np.linalg.norm(along, axis=1), 1e-9)[:, None]
    return np.concatenate([line + left * width / 2.0, (line - left * width / 2.0)[::-1]])
