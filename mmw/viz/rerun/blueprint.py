"""How the viewer is laid out: the 3-D view, the links over time, and tabs of images for each agent."""

from collections.abc import Sequence

import numpy as np
import rerun.blueprint as rrb

from mmw.viz.rerun.entities import BOXES, PATHS, WORLD, paths_entity, sensor_entity
from mmw.viz.rerun.sensors import ShownCamera

EYE = np.array([-0.45, -0.35, 0.82])
"""Direction of the eye from the point that it looks at, world frame. Design value."""

EYE_M = (80.0, 2.2)
"""Distance of the eye: at least so far [m], and so many times the agents' distance from their middle. Design values."""

RATE_HZ = 100.0
"""Frames a second when the frame numbers play: as time goes in the scenario."""

SERIES_NAMES = {"gain": "Path gain [dB]", "beam_gain": "Best-beam gain [dB]"}
"""Series -> name of its view."""


def layout(
    cameras: Sequence[ShownCamera],
    carriers_hz: Sequence[float],
    overlays: Sequence[str],
    places: np.ndarray,
    *,
    with_beams: bool,
) -> rrb.Blueprint:
    """Return the blueprint.

    Args:
        cameras: Cameras in the order of their tabs.
        carriers_hz: Carriers [Hz]; paths of the first are shown, those of the others can be switched on.
        overlays: LiDARs and other entities with a place that an image can show too, hidden until they are switched on.
        places: Where agents are, which the eye looks at, world frame [m], shape [N, 3].
        with_beams: Whether best beams were searched.
    """
    left: list[rrb.View | rrb.Container] = [_world(cameras, carriers_hz, places)]
    if carriers_hz:
        left.append(_series(with_beams))
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


def _world(cameras: Sequence[ShownCamera], carriers_hz: Sequence[float], places: np.ndarray) -> rrb.Spatial3DView:
    target = places.mean(axis=0) if len(places) else np.zeros(3)
    away = max(EYE_M[0], EYE_M[1] * np.linalg.norm(places - target, axis=1).max(initial=0.0))
    hidden = {f"/{paths_entity(carrier)}": rrb.EntityBehavior(visible=False) for carrier in carriers_hz[1:]}
    flat = [f"- /{camera.entity}/depth/**" for camera in cameras if camera.type == "depth"]
    flat += [f"- /{camera.entity}/boxes_2d/**" for camera in cameras]
    return rrb.Spatial3DView(
        origin=f"/{WORLD}",
        name="Town",
        contents=["$origin/**", *flat],
        overrides=hidden,
        background=rrb.Background(color=(18, 20, 26)),
        line_grid=False,
        eye_controls=rrb.EyeControls3D(position=target + away * EYE, look_target=target, eye_up=(0.0, 0.0, 1.0)),
    )


def _series(with_beams: bool) -> rrb.Tabs:
    views: list[rrb.View | rrb.Container] = [
        rrb.TimeSeriesView(origin=f"/{series}", name=name)
        for series, name in SERIES_NAMES.items()
        if with_beams or series == "gain"
    ]
    views.append(rrb.StateTimelineView(origin="/los", name="Line of sight"))
    if with_beams:
        pair = [rrb.TimeSeriesView(origin=f"/{end}_beam", name=f"Best {end} beam") for end in ("tx", "rx")]
        views.append(rrb.Horizontal(*pair, name="Best beams"))
    return rrb.Tabs(*views, active_tab=0)


def _images(cameras: Sequence[ShownCamera], overlays: Sequence[str]) -> rrb.Tabs:
    tabs = []
    for agent in dict.fromkeys(camera.agent for camera in cameras):
        for type_ in ("rgb", "depth"):
            own = [camera for camera in cameras if (camera.agent, camera.type) == (agent, type_)]
            if own:
                name = agent if type_ == "rgb" else f"{agent} depth"
                columns = 1 if len(own) < 4 else 2
                tabs.append(rrb.Grid(*(_image(camera, overlays) for camera in own), grid_columns=columns, name=name))
    return rrb.Tabs(*tabs, active_tab=0)


def _image(camera: ShownCamera, overlays: Sequence[str]) -> rrb.Spatial2DView:
    others = [f"/{entity}" for entity in overlays] if camera.has_pinhole else []
    hidden = {entity: rrb.EntityBehavior(visible=False) for entity in others}
    return rrb.Spatial2DView(
        origin=f"/{camera.entity}",
        name=f"{camera.agent} {camera.sensor}",
        contents=["$origin/**", *(f"+ {entity}/**" for entity in others)],
        overrides=hidden,
    )


def image_overlays(lidars: Sequence[tuple[str, str]], *, boxes: bool, paths: bool) -> list[str]:
    """Return entities with a place that images can show.

    Args:
        lidars: Agent and name of each LiDAR.
        boxes: Whether there are boxes.
        paths: Whether there are radio paths.
    """
    return [sensor_entity(*lidar) for lidar in lidars] + [BOXES] * boxes + [PATHS] * paths
