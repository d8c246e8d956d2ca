"""Maps of the trajectories of agents that move and the places of those that stand, over lanes and buildings."""

from typing import TYPE_CHECKING, Any

import numpy as np

from mmw.dataset import Dataset
from mmw.viz.plots.map import TownPlan
from mmw.viz.plots.paths import draw_town_plan
from mmw.viz.plots.style import label_place, new_figure
from mmw.viz.report.css import COLORS, DASHES, SERIES_COUNT
from mmw.viz.report.figures import svg
from mmw.viz.report.html import legend, paragraph, plural
from mmw.viz.report.inventory import Inventory
from mmw.viz.report.sampling import sample_range, sampled

if TYPE_CHECKING:
    from matplotlib.figure import Figure

MAX_FRAMES = 200
"""Frames of a trajectory that are read at most."""

OTHER_FRAMES = 30
"""Frames of the trajectories of other vehicles and people that are read at most."""

UNIT_NAMES = {"rsu": "roadside unit", "bs": "base station"}
"""Role of agents that stand -> words of the legend."""

MARGIN_M = 25.0
"""Border around the agents' trajectories [m]. Design value."""

RATIO = 1.7
"""Width of a map over its height at least."""

HEIGHT_IN = 6.4
"""Height of a map [inch]."""


def trajectory_map(data: Dataset, inventory: Inventory, scenario: str, plan: TownPlan) -> str:
    """Return the map of a scenario over lanes and buildings of its town; empty if it has no pose."""
    weathers = inventory.weathers(scenario)
    if "poses" not in data.tables or not weathers:
        return ""
    frames = sample_range(inventory.frames(scenario, weathers[0]), MAX_FRAMES)
    where = {"scenario": scenario, "weather": weathers[0]}
    poses = data.numpy("poses", columns=["frame", "agent", "role", "x", "y"], frames=frames, **where)
    if not len(poses["frame"]):
        return ""
    places = _trajectories(poses, "agent")
    role_of = dict(zip(poses["agent"].tolist(), poses["role"].tolist(), strict=True))
    units = {name: line[-1] for name, line in places.items() if role_of[name] in UNIT_NAMES}
    cavs = {name: line for name, line in places.items() if name not in units}
    figure = draw_trajectories(plan, cavs, units, _others(data, inventory, scenario, where))
    entries = [(f"s{number % SERIES_COUNT}", name) for number, name in enumerate(cavs)]
    kinds = [words for role, words in UNIT_NAMES.items() if role in role_of.values()]
    entries += [("unit", " or ".join(kinds))] * bool(units) + [("line dashed", "other vehicles and people")]
    moving = "connected vehicle" if {role_of[name] for name in cavs} <= {"cav"} else "agent"
    is_known = bool(plan.lanes or plan.buildings)
    note = (
        f"Trajectories of {plural(len(cavs), moving)} from the dot to the arrow, {sampled(frames)}; north "
        f"is up. {'Lanes and buildings from the stage.' if is_known else 'No lanes and buildings are known.'}"
    )
    picture = svg(figure, f"Trajectories of the agents of {scenario}")
    return f"<div class=card>{legend(entries)}{picture}</div>{paragraph(note, 'note')}"


def draw_trajectories(
    plan: TownPlan, cavs: dict[str, np.ndarray], units: dict[str, np.ndarray], others: list[np.ndarray]
) -> "Figure":
    """Return a map.

    Args:
        plan: Lanes and buildings of the town.
        cavs: Agent that moves -> its places over time [m], shape [T, 2].
        units: Agent that stands -> its place [m], shape [2].
        others: Places of every other vehicle or person over time [m], shape [T, 2] each.
    """
    points = np.concatenate([*cavs.values(), *(place[None] for place in units.values())])
    low, high = points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
    middle, half = (low + high) / 2.0, (high - low) / 2.0
    half[0] = max(half[0], half[1] * RATIO)
    low, high = middle - half, middle + half
    figure: Any = new_figure(None, (HEIGHT_IN * half[0] / half[1] + 0.6, HEIGHT_IN + 0.5))
    axes = figure.subplots()
    draw_town_plan(axes, plan.within(low, high))
    for line in others:
        axes.plot(*line.T, color=COLORS["other"], lw=1.0, ls=(0, (3, 3)), zorder=2)
    for number, (name, line) in enumerate(cavs.items()):
        color = COLORS[f"s{number % SERIES_COUNT}"]
        axes.plot(*line.T, color=color, lw=2.4, ls=DASHES[number % SERIES_COUNT], label=name, zorder=3)
        axes.plot(*line[0], color=color, marker="o", markersize=5, zorder=3)
        step = line[-1] - line[max(len(line) - 5, 0)]
        if np.hypot(*step) > 0.05:
            turn = float(np.degrees(np.arctan2(step[1], step[0]))) - 90.0
            axes.plot(*line[-1], color=color, marker=(3, 0, turn), markersize=10, zorder=3)
        label_place(axes, name, line[-1], fontweight="bold", bbox=None)
    for name, place in units.items():
        axes.plot(*place, color=COLORS["ink"], marker="^", markersize=10, ls="", label=name, zorder=4)
        label_place(axes, name, place, fontweight="bold", bbox=None)
    axes.set(
        xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal", xlabel="x east [m]", ylabel="y north [m]",
    )  # fmt: skip
    return figure


def _trajectories(rows: dict[str, np.ndarray], by: str) -> dict[str, np.ndarray]:
    """Return the places of each agent or object over time, shape [T, 2] each."""
    order = np.lexsort((rows["frame"], rows[by].astype(str)))
    names, places = rows[by][order], np.stack([rows["x"], rows["y"]], axis=1)[order]
    return {name: places[names == name] for name in dict.fromkeys(names.tolist())}


def _others(data: Dataset, inventory: Inventory, scenario: str, where: dict[str, str]) -> list[np.ndarray]:
    if "boxes" not in data.tables:
        return []
    frames = sample_range(inventory.frames(scenario, where["weather"]), OTHER_FRAMES)
    rows = data.numpy("boxes", columns=["frame", "object_id", "agent", "x", "y"], frames=frames, **where)
    is_other = np.array([name is None for name in rows["agent"]], dtype=bool)
    return list(_trajectories({name: values[is_other] for name, values in rows.items()}, "object_id").values())
