"""What a Rerun recording holds, read back by Rerun's own reader."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rerun.chunk


@dataclass(frozen=True)
class Recording:
    """Rows of an .rrd file: entity -> frame (None: static) -> component -> values."""

    rows: dict[str, dict[int | None, dict[str, list[Any]]]]
    times: dict[int, float]
    """Frame -> time [s], of all rows that have both."""
    timelines: frozenset[str]

    def at(self, entity: str, frame: int | None, component: str) -> list[Any]:
        """Return the values that were logged at a frame."""
        return self.rows["/" + entity][frame][component]

    def array(self, entity: str, frame: int | None, component: str) -> np.ndarray:
        """Return the same as numbers."""
        return np.array(self.at(entity, frame, component), dtype=np.float64)

    def frames(self, entity: str) -> list[int]:
        """Return the frames at which an entity was logged."""
        return sorted(frame for frame in self.rows.get("/" + entity, {}) if frame is not None)

    def under(self, entity: str) -> Iterator[str]:
        """Yield the entities under one."""
        return (name[1:] for name in self.rows if name.startswith(f"/{entity}/"))

    def is_cleared(self, entity: str, frame: int) -> bool:
        """Return whether an entity was cleared at a frame."""
        return "Clear:is_recursive" in self.rows.get("/" + entity, {}).get(frame, {})


def read_recording(path: Path) -> Recording:
    """Read an .rrd file."""
    rows: dict[str, dict[int | None, dict[str, list[Any]]]] = {}
    times, timelines = {}, set()
    for chunk in rerun.chunk.RrdReader(path).stream().to_chunks():
        timelines |= set(chunk.timeline_names)
        batch = chunk.to_record_batch()
        columns = {name: batch.column(name).to_pylist() for name in batch.schema.names if ":" in name}
        frames = batch.column("frame").to_pylist() if "frame" in batch.schema.names else [None] * batch.num_rows
        seconds = batch.column("time").cast("int64").to_pylist() if "time" in batch.schema.names else []
        times |= {frame: second * 1e-9 for frame, second in zip(frames, seconds, strict=False)}
        for index, frame in enumerate(frames):
            here = rows.setdefault(chunk.entity_path, {}).setdefault(frame, {})
            here |= {name: values[index] for name, values in columns.items() if values[index] is not None}
    return Recording(rows, times, frozenset(timelines))


def matrix(recording: Recording, entity: str, frame: int | None) -> np.ndarray:
    """Return the transform of an entity to its parent, shape [4, 4], by the textbook formula of quaternions."""
    (x, y, z, w), (place,) = (
        recording.array(entity, frame, "Transform3D:quaternion")[0],
        recording.array(entity, frame, "Transform3D:translation"),
    )
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    found = np.eye(4)
    found[:3, :3], found[:3, 3] = turn, place
    return found


AXES = {1: (1, 1.0), 2: (1, -1.0), 3: (0, -1.0), 4: (0, 1.0), 5: (2, 1.0), 6: (2, -1.0)}
"""Rerun's number of a direction (up, down, right, left, forward, back) -> axis of left, up, forward, and sign.
Source: definition of rerun.components.ViewCoordinates."""


def rerun_pixels(recording: Recording, camera: str, points: np.ndarray) -> np.ndarray:
    """Return where points in a camera's frame lie in its image as Rerun defines it, shape [N, 2]; NaN behind it.

    Args:
        recording: The recording.
        camera: Entity with the pinhole.
        points: Points in the camera's frame, shape [N, 3].
    """
    named = np.zeros((len(points), 3))  # left, up, forward
    for axis, direction in enumerate(recording.at(camera, None, "Pinhole:camera_xyz")[0]):
        place, sign = AXES[direction]
        named[:, place] = sign * points[:, axis]
    right_down_forward = named * (-1.0, -1.0, 1.0)
    image_from_camera = (
        recording.array(camera, None, "Pinhole:image_from_camera")[0].reshape(3, 3).T
    )  # column by column
    u, v, w = image_from_camera @ right_down_forward.T
    return np.where(w > 0.0, np.stack([u, v]) / np.where(w > 0.0, w, 1.0), np.nan).T
