"""Log a part of a dataset to a Rerun stream; one frame is in memory at a time."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import rerun as rr

from mmw.core.errors import InputError
from mmw.core.progress_bar import Progress
from mmw.dataset import BeamSearch, Dataset
from mmw.viz.rerun.blueprint import blueprint
from mmw.viz.rerun.entities import WORLD
from mmw.viz.rerun.frames import LIDAR_COLORS, FrameLogger
from mmw.viz.rerun.radio_links import RadioLogger
from mmw.viz.rerun.selection import Scope
from mmw.viz.rerun.sensor_mounts import (
    log_sensors,
    missing_tables,
    sampled_rows,
    sensor_notes,
    sensor_rows,
)  # fmt: skip
from mmw.viz.rerun.town import log_town, read_town

FLUSH_EVERY = 10
"""Frames after which the stream is flushed, which limits the memory of this process. Design value."""

APPLICATION = "mmw"
"""Name of the application in Rerun; the viewer stores one layout for it."""


@dataclass(frozen=True)
class Looks:
    """Options of drawing."""

    lidar_color: str = "object"
    """One of `LIDAR_COLORS`."""
    with_town: bool = True
    """Draw the static town."""
    search: BeamSearch | None = None
    """Search for best beams; None leaves them out."""

    def __post_init__(self) -> None:
        if self.lidar_color not in LIDAR_COLORS:
            raise InputError(f"lidar color {self.lidar_color!r}: it is one of {', '.join(LIDAR_COLORS)}; name one")


def record(
    stream: rr.RecordingStream, scope: Scope, looks: Looks, flush: Callable[[], None] | None = None
) -> list[str]:
    """Log a part of a dataset to a stream with a connected sink; returns a line for each omission and its reason.

    Args:
        stream: Stream of Rerun.
        scope: Part of the dataset.
        looks: How it is shown.
        flush: Waits until the sink has what was logged; the stream's own by default, which waits without end.

    Raises:
        InputError: If a file of the dataset is damaged.
    """
    flush, data = flush or stream.flush, scope.data
    notes, rows = list(scope.notes), sensor_rows(scope)
    missing = missing_tables(scope, rows)
    if missing:
        notes.append(f"the dataset has no {', '.join(missing)}: not shown")
    notes += sensor_notes(rows)
    with strict():
        stream.send_blueprint(blueprint(scope, with_beams=looks.search is not None))
        stream.send_recording_name(f"{scope.scenario} {scope.weather}")
        stream.log(WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        log_sensors(stream, scope, rows)
        tags, rate_hz = object_tags(data, scope.scenario), data.frame_rate_hz(scope.scenario)
        frames = FrameLogger(stream, scope, sampled_rows(scope, rows), tags, looks.lidar_color)
        radio = RadioLogger(stream, scope, looks.search)
        with Progress("view", len(scope.frames), 0) as progress:
            for number, frame in enumerate(scope.frames):
                stream.set_time("frame", sequence=frame)
                stream.set_time("time", duration=frame / rate_hz)
                moment = data.frame(scope.scenario, scope.weather, frame)
                frames.log(moment)
                radio.log(moment)
                if number % FLUSH_EVERY == 0:
                    flush()
                progress.advance(f"frame {frame}")
        if looks.with_town:
            try:
                meshes = read_town(scope)
            except InputError as error:
                notes.append(f"the town is not shown: {error}")
            else:
                log_town(stream, meshes)
        flush()
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
