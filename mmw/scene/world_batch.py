"""Hold the present frames of several worlds side by side, as the frames of one scene that a device traces together."""

from collections.abc import Sequence
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import ArrayLike

from mmw.core.kinematics import Motion, differentiate_row, placed
from mmw.scene.scene_data import SceneData

NEIGHBORS = 1
"""Poses before and after the present one of a world; central differences need no more."""


@dataclass(frozen=True)
class WorldBatch(SceneData):
    """Frame k is the present frame of world k. The worlds have one town and the same actors, in other places.

    `poses` has the pose before the frame, that of the frame and the one after it, world by world; or more, and NaN
    behind them, where derivatives may look farther: at an actor that comes or goes.
    """

    own_numbers: np.ndarray = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    """Number of the frame of each world in its scenario, shape [F], int64."""
    own_seeds: tuple[int, ...] = ()
    """Seed of each world."""
    own_before: int = NEIGHBORS
    """Poses before that of the frame in every world."""
    own_rows: int = 2 * NEIGHBORS + 1
    """Poses of every world."""

    @classmethod
    def of(
        cls,
        data: SceneData,
        poses: np.ndarray,
        numbers: Sequence[int],
        seeds: Sequence[int],
        before: int = NEIGHBORS,
    ) -> "WorldBatch":
        """Return worlds with the meshes and actors of a scene.

        Args:
            data: The scene, at 100 Hz.
            poses: Poses before, at and after the frame of every world, world by world, shape [R F, V, 7].
            numbers: Number of every world's frame.
            seeds: Seed of every world.
            before: Poses before that of the frame.
        """
        shared = {one.name: getattr(data, one.name) for one in fields(SceneData) if one.name not in ("frames", "poses")}
        return cls(
            **shared,
            frames=range(len(numbers)),
            poses=poses,
            own_numbers=np.array(numbers, dtype=np.int64),
            own_seeds=tuple(seeds),
            own_before=before,
            own_rows=len(poses) // len(numbers),
        )

    @property
    def frame_poses(self) -> np.ndarray:
        """The rows of `poses` that are frames, shape [F, V, 7]."""
        return self.poses[self.own_before :: self.own_rows]

    def motion(self) -> Motion:
        """Return the derivatives at the frames of the worlds, shape [R F, V, 3]; NaN in the rows beside them."""
        around = self.poses.reshape(len(self.frames), self.own_rows, *self.poses.shape[1:]).swapaxes(0, 1)
        motion = differentiate_row(around, self.own_before, self.pose_dt)
        return placed(motion, slice(self.own_before, None, self.own_rows), len(self.poses))

    def pose_rows(self, frame_count: int) -> int:
        """Return the rows of poses of a number of worlds."""
        return frame_count * self.own_rows

    def numbers(self, frames: ArrayLike) -> np.ndarray:
        """Return the numbers that the frames of some worlds have in their scenario, int64."""
        return self.own_numbers[np.asarray(frames, dtype=np.int64)]

    def seeds(self, frames: Sequence[int] | np.ndarray, seed: int) -> list[int]:
        """Return the seeds of some worlds."""
        return [self.own_seeds[int(frame)] for frame in frames]

    def frame_row(self, frame: int) -> int:
        """Return the row of `poses` that holds the frame of a world.

        Raises:
            ValueError: If there is no such world.
        """
        if frame not in self.frames:
            raise ValueError(f"world {frame} is not in the batch, which has {len(self.frames)}")
        return frame * self.own_rows + self.own_before

    def frame_rows(self, frames: ArrayLike) -> np.ndarray:
        """Return the rows of `poses` that hold the frames of some worlds, int64; errors as of `frame_row`."""
        found = np.asarray(frames, dtype=np.int64)
        outside = (found < 0) | (found >= len(self.frames))
        if outside.any():
            self.frame_row(int(found[outside][0]))
        return found * self.own_rows + self.own_before
