"""Layout of the viewer: the 3-D view, the links over time, and tabs of images for each agent."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import rerun.blueprint as rrb

from mmw.config.sensor_spec import SENSORS
from mmw.dataset import Dataset
from mmw.dataset.sample_rows import Row
from mmw.viz.plots.samples import drawn_types, label_of
from mmw.viz.rerun.entities import BOXES, PATHS, WORLD, paths_entity, reading_entity, sensor_entity
from mmw.viz.rerun.selection import Scope
from mmw.viz.rerun.sensor_mounts import reading_columns, sampled_rows, sensor_rows

EYE = np.array([-0.45, -0.35, 0.82])
"""Direction of the eye from the point that it looks at, world frame. Design value."""

EYE_M = (80.0, 2.2)
"""Distance of the eye: at least so far [m], and so many times the agents' distance from their middle. Design values."""

RATE_HZ = 100.0
"""Frames a second when the frame numbers play: as time goes in the scenario."""

SERIES_NAMES = {"gain": "Path gain [dB]", "beam_gain": "Best-beam gain [dB]"}
"""Series -> name of its view."""


def blueprint(scope: Scope, *, with_beams: bool) -> rrb.Blueprint:
    """Return how the viewer is laid out for a part of a dataset; `with_beams` if best beams are searched."""
    tables, with_paths, rows = scope.data.tables, "paths" in scope.data.views, sampled_rows(scope, sensor_rows(scope))
    cameras = [row for row in rows if SENSORS[row["type"]].kind == "image"]
    # What has a place can be shown in an image too; it is hidden until it is switched on.
    overlays = [_entity(row) for row in rows if SENSORS[row["type"]].kind == "points"]
    overlays += [BOXES] * ("boxes" in tables) + [PATHS] * with_paths
    first = scope.data.frame(scope.scenario, scope.weather, scope.frames[0])
    places = np.array([first.agents[name].pose[:3] for name in scope.agents if name in first.agents]).reshape(-1, 3)
    carriers_hz = carriers(scope.data)
    left: list[rrb.View | rrb.Container] = [_world(cameras, carriers_hz, places)]
    tabs = _links(with_beams and with_paths) if carriers_hz else []
    tabs += _readings({row["sensor"]: columns for row in rows if (columns := reading_columns(row))})
    if tabs:
        left.append(rrb.Tabs(*tabs, active_tab=0))
    parts: list[rrb.View | rrb.Container] = [rrb.Vertical(*left, row_shares=[5, 2][: len(left)])]
    if cameras:
        parts.append(_images(cameras, overlays))
    return rrb.Blueprint(
        rrb.Horizontal(*parts, column_shares=[3, 2][: len(parts)]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="collapsed", timeline="frame", fps=RATE_HZ, play_state="paused", loop_mode="all"),
        auto_views=False,
    )


def carriers(data: Dataset) -> list[float]:
    """Return the carriers of a dataset [Hz], highest first; none without links.

    Paths of the first are shown, those of the others can be switched on.
    """
    if "links" not in data.tables:
        return []
    return sorted((float(carrier) for carrier in data.info["config"]["channel"]["carriers_hz"]), reverse=True)


def _world(cameras: Sequence[Row], carriers_hz: Sequence[float], places: np.ndarray) -> rrb.Spatial3DView:
    target = places.mean(axis=0) if len(places) else np.zeros(3)
    away = max(EYE_M[0], EYE_M[1] * np.linalg.norm(places - target, axis=1).max(initial=0.0))
    hidden = {f"/{paths_entity(carrier)}": rrb.EntityBehavior(visible=False) for carrier in carriers_hz[1:]}
    flat = [f"- /{_entity(row)}/{row['type']}/**" for row in cameras if not SENSORS[row["type"]].needs_appearance]
    flat += [f"- /{_entity(row)}/boxes_2d/**" for row in cameras]
    return rrb.Spatial3DView(
        origin=f"/{WORLD}",
        name="Town",
        contents=["$origin/**", *flat],
        overrides=hidden,
        background=rrb.Background(color=(18, 20, 26)),
        line_grid=False,
        eye_controls=rrb.EyeControls3D(position=target + away * EYE, look_target=target, eye_up=(0.0, 0.0, 1.0)),
    )


def _links(with_beams: bool) -> list[rrb.View | rrb.Container]:
    views: list[rrb.View | rrb.Container] = [
        rrb.TimeSeriesView(origin=f"/{series}", name=name)
        for series, name in SERIES_NAMES.items()
        if with_beams or series == "gain"
    ]
    views.append(rrb.StateTimelineView(origin="/los", name="Line of sight"))
    if with_beams:
        pair = [rrb.TimeSeriesView(origin=f"/{end}_beam", name=f"Best {end} beam") for end in ("tx", "rx")]
        views.append(rrb.Horizontal(*pair, name="Best beams"))
    return views


def _readings(readings: Mapping[str, Sequence[Any]]) -> list[rrb.View | rrb.Container]:
    """Return a tab for each scalar sensor, a chart for each of its numbers with a line for each agent."""
    return [
        rrb.Grid(
            *(rrb.TimeSeriesView(origin=f"/{reading_entity(sensor, one.name)}", name=label_of(one)) for one in columns),
            name=sensor,
        )
        for sensor, columns in readings.items()
    ]


def _images(cameras: Sequence[Row], overlays: Sequence[str]) -> rrb.Tabs:
    """Return a tab of images for each agent and type of sensor."""
    tabs = []
    order = drawn_types()
    for agent in dict.fromkeys(row["agent"] for row in cameras):
        mine = [row for row in cameras if row["agent"] == agent]
        for type_ in sorted({row["type"] for row in mine}, key=order.index):
            views = [_image(row, overlays) for row in mine if row["type"] == type_]
            name = agent if SENSORS[type_].needs_appearance else f"{agent} {type_}"
            tabs.append(rrb.Grid(*views, grid_columns=1 if len(views) < 4 else 2, name=name))
    return rrb.Tabs(*tabs, active_tab=0)


def _image(row: Row, overlays: Sequence[str]) -> rrb.Spatial2DView:
    others = [f"/{entity}" for entity in overlays] if row["lens"] == "pinhole" else []
    hidden = {entity: rrb.EntityBehavior(visible=False) for entity in others}
    return rrb.Spatial2DView(
        origin=f"/{_entity(row)}",
        name=f"{row['agent']} {row['sensor']}",
        contents=["$origin/**", *(f"+ {entity}/**" for entity in others)],
        overrides=hidden,
    )


def _entity(row: Row) -> str:
    return sensor_entity(row["agent"], row["sensor"])
