"""Maps of the ways of vehicles and the places of roadside units, over lanes and buildings where there are some."""

import math
from collections import defaultdict

import numpy as np

from mmw.dataset import Dataset
from mmw.viz.plots.map import TownPlan
from mmw.viz.report.css import SERIES_COUNT
from mmw.viz.report.html import legend, paragraph, plural, text
from mmw.viz.report.inventory import Inventory
from mmw.viz.report.sampling import sample_range, sampled
from mmw.viz.report.svg import nice_step

MAX_FRAMES = 200
"""Frames of a way that are read at most."""

OTHER_FRAMES = 30
"""Frames of the ways of other vehicles and people that are read at most."""

MARGIN_M = 25.0
"""Margin of the map around the agents' trajectories [m]. Design value."""

RATIO = 1.7
"""Width of a map over its height at least."""


def trajectory_map(data: Dataset, inventory: Inventory, scenario: str, plan: TownPlan) -> str:
    """Return the map of a scenario; empty if it has no pose.

    Args:
        data: The dataset.
        inventory: What there is.
        scenario: Scenario name.
        plan: Lanes and buildings of its town; empty if they are not known.
    """
    weathers = inventory.weathers(scenario)
    if "poses" not in data.tables or not weathers:
        return ""
    frames = sample_range(inventory.frames(scenario, weathers[0]), MAX_FRAMES)
    where = {"scenario": scenario, "weather": weathers[0]}
    poses = data.numpy("poses", columns=["frame", "agent", "role", "x", "y"], frames=frames, **where)
    if not len(poses["frame"]):
        return ""
    ways = _ways(poses, "agent")
    units = {str(name): ways[name][-1] for name in np.unique(poses["agent"][poses["role"] == "rsu"])}
    cavs = {name: way for name, way in ways.items() if name not in units}
    points = np.concatenate(list(ways.values()))
    low, high = points.min(axis=0) - MARGIN_M, points.max(axis=0) + MARGIN_M
    middle, half = (low + high) / 2.0, (high - low) / 2.0
    half[0] = max(half[0], half[1] * RATIO)
    low, high = middle - half, middle + half
    wide, tall = high - low
    parts = [*_town(plan.within(low, high)), *_others(data, inventory, scenario, where)]
    parts += _scale(low, wide, tall)
    for number, (name, way) in enumerate(cavs.items()):
        parts += _way(name, way, number % SERIES_COUNT, wide)
    for name, (x, y) in units.items():
        side = wide / 70.0
        corners = f"{x:.1f},{-y - side:.1f} {x - side:.1f},{-y + side * 0.7:.1f} {x + side:.1f},{-y + side * 0.7:.1f}"
        parts.append(f'<polygon class=r points="{corners}"/>{_label(name, x, y, wide)}')
    box = f"{low[0]:.1f} {-high[1]:.1f} {wide:.1f} {tall:.1f}"
    svg = (
        f'<svg class=m style="--u:{wide / 58.0:.1f}px" viewBox="{box}" role=img '
        f'aria-label="Ways of the agents of {text(scenario)}">'
        f"{''.join(parts)}</svg>"
    )
    entries = [(f"s{number % SERIES_COUNT}", name) for number, name in enumerate(cavs)]
    entries += [("unit", "roadside unit")] * bool(units) + [("line dashed", "other vehicles and people")]
    note = (
        f"Ways of {plural(len(cavs), 'connected vehicle')} from the dot to the arrow, {sampled(frames)}; north is up, "
        f"x east {low[0]:.0f} to {high[0]:.0f} m, y north {low[1]:.0f} to {high[1]:.0f} m. "
        + (
            "Lanes and buildings from the stage."
            if plan.lanes or plan.buildings
            else "No lanes and buildings are known."
        )
    )
    return f"<div class=card>{legend(entries)}{svg}</div>{paragraph(note, 'note')}"


def _ways(rows: dict[str, np.ndarray], by: str) -> dict[str, np.ndarray]:
    """Return the places of each thing over time, shape [T, 2] each."""
    order = np.lexsort((rows["frame"], rows[by].astype(str)))
    found: dict[str, list[tuple[float, float]]] = defaultdict(list)
    for index in order:
        found[rows[by][index]].append((rows["x"][index], rows["y"][index]))
    return {name: np.array(way) for name, way in found.items()}


def _others(data: Dataset, inventory: Inventory, scenario: str, where: dict[str, str]) -> list[str]:
    if "boxes" not in data.tables:
        return []
    frames = sample_range(inventory.frames(scenario, where["weather"]), OTHER_FRAMES)
    rows = data.numpy("boxes", columns=["frame", "object_id", "agent", "x", "y"], frames=frames, **where)
    is_other = np.array([name is None for name in rows["agent"]], dtype=bool)
    ways = _ways({name: values[is_other] for name, values in rows.items()}, "object_id")
    return [f'<path class=o d="{_path(way)}"/>' for way in ways.values()]


def _town(plan: TownPlan) -> list[str]:
    parts = []
    for line, width in zip(plan.lanes, plan.widths, strict=True):
        parts.append(f'<path class=road stroke-width="{width + 0.4:.1f}" d="{_path(line)}"/>')
    parts += [f'<path class=lane d="{_path(line)}"/>' for line in plan.lanes]
    parts += [f'<path class=b d="{_path(outline)}Z"/>' for outline in plan.buildings]
    return parts


def _way(name: str, way: np.ndarray, number: int, wide: float) -> list[str]:
    radius = wide / 160.0
    parts = [
        f'<path class="t s{number}" d="{_path(way)}"/>',
        f'<circle class=f{number} cx="{way[0][0]:.1f}" cy="{-way[0][1]:.1f}" r="{radius:.2f}"/>',
    ]
    step = way[-1] - way[max(len(way) - 5, 0)]
    if np.hypot(*step) > 0.05:
        turn = -math.degrees(math.atan2(step[1], step[0]))
        place = f"translate({way[-1][0]:.1f} {-way[-1][1]:.1f}) rotate({turn:.0f}) scale({radius * 2.4:.2f})"
        parts.append(f'<path class=f{number} transform="{place}" d="M1 0L-.6 .7V-.7Z"/>')
    return [*parts, _label(name, *way[-1], wide)]


def _label(name: str, x: float, y: float, wide: float) -> str:
    size = wide / 58.0
    return f'<text x="{x + size:.1f}" y="{-y - size * 0.6:.1f}">{text(name)}</text>'


def _scale(low: np.ndarray, wide: float, tall: float) -> list[str]:
    """Return a bar of a round length in the lower left corner."""
    length = nice_step(wide / 8.0)
    x, y, size = low[0] + wide * 0.03, -(low[1] + tall * 0.05), wide / 60.0
    return [
        f'<path class=k d="M{x:.1f} {y - size / 3:.1f}v{size / 3:.1f}h{length:.1f}v-{size / 3:.1f}"/>',
        f'<text x="{x + length / 2:.1f}" y="{y - size / 2:.1f}" text-anchor=middle>{length:g} m</text>',
    ]


def _path(points: np.ndarray) -> str:
    """Return a line through points; those closer than 10 cm to the one before are left out."""
    rounded = np.round(points, 1)
    kept = np.concatenate([[True], (np.diff(rounded, axis=0) != 0.0).any(axis=1)])
    return "M" + "L".join(f"{x:g} {-y + 0.0:g}" for x, y in rounded[kept])
