"""Logs a part of a dataset to a Rerun stream, frame by frame: what one frame needs is read, logged and forgotten."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from mmw.core.constants import FRAME_DT
from mmw.core.errors import InputError
from mmw.core.progress_bar import Progress
from mmw.dataset import BeamSearch, Dataset
from mmw.viz.rerun.blueprint import image_overlays, layout
from mmw.viz.rerun.channel import RadioPainter
from mmw.viz.rerun.entities import WORLD
from mmw.viz.rerun.frames import LIDAR_COLORS, FramePainter
from mmw.viz.rerun.selection import Scope
from mmw.viz.rerun.sensors import lens_notes, log_sensors, sensor_rows, shown_cameras
from mmw.viz.rerun.town import log_town, read_town

SHOWN_TABLES = ("lidar", "rgb", "depth", "radar", "boxes", "boxes_2d", "links", "paths", "sensors")
"""Tables that are shown where they are."""

FLUSH_EVERY = 10
"""Frames after which what was logged must have left this process: keeps its memory small. Design value."""

APPLICATION = "mmw"
"""Name of the application in Rerun; the viewer keeps one layout for it."""


@dataclass(frozen=True)
class Looks:
    """Options of drawing."""

    lidar_color: str = "object"
    """One of `LIDAR_COLORS`."""
    with_town: bool = True
    """Whether the static town is drawn."""
    search: BeamSearch | None = None
    """How best beams are searched; None leaves them out."""

    def __post_init__(self) -> None:
        if self.lidar_color not in LIDAR_COLORS:
            raise InputError(f"lidar color {self.lidar_color!r}: it is one of {', '.join(LIDAR_COLORS)}; name one")


def blueprint(scope: Scope, looks: Looks) -> rrb.Blueprint:
    """Return how the viewer is laid out for a part of a dataset."""
    tables, rows = scope.data.tables, sensor_rows(scope)
    lidars = [(row["agent"], row["sensor"]) for row in rows if row["type"] == "lidar" and "lidar" in tables]
    first = scope.data.frame(scope.scenario, scope.weather, scope.frames[0])
    places = np.array([first.agents[name].pose[:3] for name in scope.agents if name in first.agents]).reshape(-1, 3)
    return layout(
        shown_cameras(scope, rows),
        carriers(scope.data),
        image_overlays(lidars, boxes="boxes" in tables, paths="paths" in tables),
        places,
        with_beams=looks.search is not None and "paths" in tables,
    )


def carriers(data: Dataset) -> list[float]:
    """Return the carriers of a dataset [Hz], highest first; none without links."""
    if "links" not in data.tables:
        return []
    return sorted((float(carrier) for carrier in data.info["config"]["channel"]["carriers_hz"]), reverse=True)


def record(stream: rr.RecordingStream, scope: Scope, looks: Looks) -> list[str]:
    """Log a part of a dataset.

    Args:
        stream: Where it goes; a sink is connected already.
        scope: What is shown.
        looks: How it is drawn.

    Returns:
        What is left out and why, one line each.

    Raises:
        InputError: If a file of the dataset is damaged.
    """
    data = scope.data
    notes = list(scope.notes)
    missing = [name for name in SHOWN_TABLES if name not in data.tables]
    if missing:
        notes.append(f"the dataset has no {', '.join(missing)}: not shown")
    with strict():
        rows = sensor_rows(scope)
        cameras = shown_cameras(scope, rows)
        notes += lens_notes(cameras)
        stream.send_blueprint(blueprint(scope, looks))
        stream.send_recording_name(f"{scope.scenario} {scope.weather}")
        stream.log(WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        log_sensors(stream, scope, rows)
        frames = FramePainter(stream, scope, cameras, object_tags(data, scope.scenario), looks.lidar_color)
        radio = RadioPainter(stream, scope, looks.search)
        with Progress("view", len(scope.frames), 0) as progress:
            for number, frame in enumerate(scope.frames):
                stream.set_time("frame", sequence=frame)
                stream.set_time("time", duration=frame * FRAME_DT)
                moment = data.frame(scope.scenario, scope.weather, frame)
                frames.paint(moment)
                radio.paint(moment)
                if number % FLUSH_EVERY == 0:
                    stream.flush()
                progress.advance(f"frame {frame}")
        if looks.with_town:
            try:
                meshes = read_town(scope)
            except InputError as error:
                notes.append(f"the town is not shown: {error}")
            else:
                log_town(stream, meshes)
        stream.flush()
    return notes


def object_tags(data: Dataset, scenario: str) -> np.ndarray:
    """Return CARLA's number of the class of each object of a scenario, shape [objects], uint8; 0 for an unknown one."""
    if "objects" not in data.tables:
        return np.zeros(1, dtype=np.uint8)
    found: dict[str, Any] = data.numpy("objects", columns=["object_id", "tag"], scenario=scenario)
    tags = np.zeros(int(found["object_id"].max()) + 1, dtype=np.uint8)
    tags[found["object_id"]] = found["tag"]
    return tags


@contextmanager
def strict() -> Iterator[None]:
    """Make Rerun raise what it would otherwise only warn of, such as an entity that it drops."""
    before = rr.strict_mode()
    rr.set_strict_mode(True)
    try:
        yield
    finally:
        rr.set_strict_mode(before)
