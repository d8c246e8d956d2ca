"""One run of live traffic in a town: what was driven so far, as the scene's arrays at any of its frames."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from mmw.core.transforms import continuous, normalize
from mmw.scene.scene_data import SceneData
from mmw.traffic.live.control import Control
from mmw.traffic.live.live_traffic import LiveTraffic
from mmw.usd.actors import poses_read_back

BEFORE = 4
"""Frames before the present one in the arrays of a frame; late accelerometers look two back, derivatives one."""


class Episode:
    """Traffic from its start to the present frame.

    Attributes:
        traffic: The actors.
        frame: The present frame; the next one is known too, so that velocities are central differences.
        seed: Seed of traffic and noise.
    """

    def __init__(self, traffic: LiveTraffic, data: SceneData, first: int, seed: int) -> None:
        """Go to the first frame, > 0; the frame before it is known too.

        Args:
            traffic: At its start.
            data: The scene with all actors, in a few frames at the start.
            first: The first frame.
            seed: Seed of traffic and noise.
        """
        self.traffic = traffic
        self.seed = seed
        self.frame = first
        self.first = first
        self._data = data
        names = {name: column for column, name in enumerate(traffic.names)}
        pairs = [(column, names[actor.name]) for column, actor in enumerate(data.actors) if actor.name in names]
        self._column, self._source = (np.array(side, dtype=np.int64) for side in zip(*pairs, strict=True))
        self._still = data.frame_poses[-1]
        self._rows: list[np.ndarray] = []
        self._turn: np.ndarray | None = None
        self._next = 0
        self.traffic.advance(first + 2)

    def step(self, controls: Mapping[str, Control | None]) -> int:
        """Go to the next frame, and return its number; controls hold until the next ones.

        Raises:
            InputError: If a control cannot be obeyed; nothing has changed then.
        """
        self.traffic.command(controls)
        self.frame += 1
        self.traffic.advance(self.frame + 2)
        return self.frame

    def _due(self, frame: int) -> np.ndarray:
        """Return the poses of the traffic up to the frame after one, without those that have rows, shape [n, V, 7]."""
        if self._next >= frame + 2:
            return np.zeros((0, len(self._source), 7))
        poses = self.traffic.poses[self._next : frame + 2, self._source]
        turns = normalize(poses[..., 3:])
        turns = continuous(turns if self._turn is None else np.concatenate([self._turn[None], turns]))[-len(poses) :]
        poses, self._turn = np.concatenate([poses[..., :3], turns], axis=-1), turns[-1]
        seen = poses[max(self.first - 1 - self._next, 0) :]
        self._next = frame + 2
        return seen

    def _keep(self, poses: np.ndarray) -> None:
        """Keep rows with poses of the traffic, shape [n, V, 7]."""
        if not len(poses):
            return
        rows = np.repeat(self._still[None], len(poses), axis=0)
        rows[:, self._column] = poses
        before = [self._rows[-1][:, 3:]] if self._rows else []
        rows[..., 3:] = continuous(np.stack([*before, *rows[..., 3:]]))[-len(rows) :]
        self._rows += list(rows)

    def poses_around(self, frame: int, reach: int) -> np.ndarray:
        """Return poses of all actors of the scene in the frames about one, shape [2 reach + 1, V, 7]."""
        catch_up([(self, frame + reach - 1)])
        middle = frame - self.first + 1
        return np.stack(self._rows[middle - reach : middle + reach + 1])

    def arrays(self, frame: int) -> SceneData:
        """Return the scene from `BEFORE` frames before a frame of the episode to the one after it."""
        catch_up([(self, frame)])
        start = max(frame - BEFORE, self.first - 1)
        own = self._rows[start - self.first + 1 : frame - self.first + 3]
        return replace(self._data, frames=range(start, frame + 2), poses=np.stack(own))


def catch_up(moments: Sequence[tuple[Episode, int]]) -> None:
    """Make the rows of episodes up to the frame after one, as the stage of a saved episode will give them.

    They are made when a frame is looked at, all at once since the last such frame, and of all episodes at once.
    """
    due = [episode._due(frame) for episode, frame in moments]
    if any(map(len, due)):
        whole = poses_read_back(np.concatenate([poses.reshape(-1, 7) for poses in due]))
        ends = np.cumsum([poses.shape[0] * poses.shape[1] for poses in due])
        for (episode, _), poses, own in zip(moments, due, np.split(whole, ends[:-1]), strict=True):
            episode._keep(own.reshape(poses.shape))
