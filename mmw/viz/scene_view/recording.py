"""Log a scene to a Rerun stream: surfaces, actors, antennas, paths, coverage and a legend."""

from collections.abc import Sequence

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from mmw.viz.plots.style import BLUE, ORANGE, scale_colors
from mmw.viz.rerun.blueprint import EYE
from mmw.viz.rerun.entities import WORLD, paths_entity
from mmw.viz.rerun.recording import strict
from mmw.viz.rerun.town import log_town, mesh_shape
from mmw.viz.scene_view.content import Antenna, SceneContent
from mmw.viz.scene_view.legend import bars_of, legend_image

APPLICATION = "mmw scene"
"""Name of the application in Rerun; the viewer stores one layout for it."""

ACTORS, COVERAGE, LEGEND = "world/actors", "world/coverage", "legend"
"""Entities of the actors, of the coverage, and of the legend, which has no place."""

LINE_POINTS = (0.3, 2.0)
"""Width on the screen of the line of the weakest and of the strongest path, in Rerun's points. Design values."""

ANTENNA_POINTS = 8.0
"""Size of an antenna on the screen, in Rerun's points. Design value."""

AXES_M = 1.5
"""Length of the axes of an antenna [m]. Design value."""

MAX_NAMES = 40
"""Names of actors that are shown from the start; of more, one is shown where the pointer is. Design value."""

LEGEND_SCALE = 2.0
"""Size of the legend's image; the viewer scales it to its view."""

AWAY = 1.1
"""Distance of the eye from what it looks at, in its extents [-]. Design value."""


def antenna_entity(kind: str, name: str) -> str:
    """Return the entity of a transmitter or receiver; `kind` is `transmitters` or `receivers`."""
    return rr.new_entity_path([WORLD, kind, name]).lstrip("/")


def log_scene(stream: rr.RecordingStream, content: SceneContent) -> None:
    """Log a scene to a stream, all of it without time."""
    with strict():
        stream.send_blueprint(blueprint(content))
        stream.send_recording_name(content.name)
        stream.log(WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        log_town(stream, content.town)
        _log_actors(stream, content)
        for kind, found, color in (
            ("transmitters", content.transmitters, BLUE),
            ("receivers", content.receivers, ORANGE),
        ):
            for name, antenna in found.items():
                _log_antenna(stream, antenna_entity(kind, name), name, antenna, color)
        _log_paths(stream, content)
        if len(content.coverage_triangles):
            stream.log(COVERAGE, _coverage_shape(content), static=True)
        legend = _legend(content)
        if legend is not None:
            stream.log(LEGEND, legend, static=True)


def _log_actors(stream: rr.RecordingStream, content: SceneContent) -> None:
    for name, meshes in content.actors.items():
        for mesh in meshes:
            stream.log([*ACTORS.split("/"), name, mesh.name], mesh_shape(mesh), static=True)
    if content.places:
        names = rr.Points3D(
            np.array(list(content.places.values())),
            radii=rr.Radius.ui_points(0.0),
            colors=(255, 255, 255),
            labels=list(content.places),
            show_labels=len(content.places) <= MAX_NAMES,
        )
        stream.log(ACTORS, names, static=True)


def _log_antenna(stream: rr.RecordingStream, entity: str, name: str, antenna: Antenna, color: str) -> None:
    rgb = tuple(bytes.fromhex(color.lstrip("#")))
    stream.log(
        entity,
        rr.Transform3D(translation=antenna.position, mat3x3=antenna.rotation),
        rr.TransformAxes3D(AXES_M),
        rr.Points3D(
            [(0.0, 0.0, 0.0)], radii=rr.Radius.ui_points(ANTENNA_POINTS), colors=rgb, labels=[name], show_labels=True
        ),
        static=True,
    )


def _log_paths(stream: rr.RecordingStream, content: SceneContent) -> None:
    """Log the paths of each link as lines in an entity of its own."""
    paths = content.paths
    if paths is None:
        return
    colors, labels = scale_colors(paths.share, 0.0, 1.0), paths.labels
    points = LINE_POINTS[0] + (LINE_POINTS[1] - LINE_POINTS[0]) * paths.share
    links: dict[tuple[str, str], list[int]] = {}
    for path, link in enumerate(zip(paths.rx.tolist(), paths.tx.tolist(), strict=True)):
        links.setdefault(link, []).append(path)
    for (rx, tx), own in links.items():
        shape = rr.LineStrips3D(
            [paths.lines[path] for path in own],
            colors=colors[own],
            radii=rr.Radius.ui_points(points[own]),
            labels=[labels[path] for path in own],
            show_labels=False,
        )
        stream.log(paths_entity(paths.carrier_hz, rx, tx), shape, static=True)


def _coverage_shape(content: SceneContent) -> rr.Mesh3D:
    count = len(content.coverage_triangles)
    return rr.Mesh3D(
        vertex_positions=content.coverage_triangles.reshape(-1, 3),
        vertex_colors=np.repeat(content.coverage_colors, 3, axis=0),
        triangle_indices=np.arange(3 * count).reshape(-1, 3),
    )


def _legend(content: SceneContent) -> rr.Image | None:
    bars, lines = bars_of(content.paths, content.coverage)
    if not bars and not lines:
        return None
    image = legend_image(bars, [*lines, *content.notes], LEGEND_SCALE)
    return rr.Image(np.asarray(image.convert("RGB")))


def blueprint(content: SceneContent) -> rrb.Blueprint:
    """Return the layout: the scene in 3-D, and the legend beside it if there is one."""
    position, target = eye(content)
    world = rrb.Spatial3DView(
        origin=f"/{WORLD}",
        name=content.name,
        background=rrb.Background(color=(18, 20, 26)),
        line_grid=False,
        eye_controls=rrb.EyeControls3D(position=position, look_target=target, eye_up=(0.0, 0.0, 1.0)),
    )
    parts: Sequence[rrb.View] = [world]
    if content.paths is not None or content.coverage is not None:
        parts = [world, rrb.Spatial2DView(origin=f"/{LEGEND}", name="Legend")]
    return rrb.Blueprint(
        rrb.Horizontal(*parts, column_shares=[5, 1][: len(parts)]),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        rrb.TimePanel(state="hidden"),
        auto_views=False,
    )


def eye(content: SceneContent) -> tuple[np.ndarray, np.ndarray]:
    """Return position and target of the eye [m], shape [3] each: antennas and paths in view, else the whole scene."""
    focus = content.focus
    low, high = (focus.min(axis=0), focus.max(axis=0)) if len(focus) > 1 else content.bounds
    target = 0.5 * (low + high)
    away = max(20.0, AWAY * float(np.linalg.norm(high - low)))
    return target + away * EYE, target
