"""One run of live traffic in a town: what was driven so far, as the scene's arrays at any of its frames."""

from collections import defaultdict
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
        self._layout = first, id(data), self._column.tobytes(), self._source.tobytes()
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

    def _kind(self) -> tuple[object, ...]:
        """Return what episodes have in common whose rows are made at once."""
        return *self._layout, self._next, self._turn is None, not self._rows

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
    alike: dict[tuple[object, ...], list[Episode]] = defaultdict(list)
    for episode, frame in moments:
        if episode._next < frame + 2:
            alike[*episode._kind(), frame].append(episode)
    for (*_, frame), episodes in alike.items():
        assert isinstance(frame, int)
        _make_rows(episodes, frame + 2)


def _make_rows(episodes: Sequence[Episode], stop: int) -> None:
    """Make the rows of episodes of one kind; those before the frame before the first only turn quaternions."""
    one = episodes[0]
    start = one._next
    poses = np.stack([episode.traffic.poses[start:stop, one._source] for episode in episodes], axis=1)
    turns = normalize(poses[..., 3:])
    if one._turn is not None:
        turns = np.concatenate([np.stack([episode._turn for episode in episodes])[None], turns])
    turns = continuous(turns)[-len(poses) :]
    seen = np.concatenate([poses[..., :3], turns], axis=-1)[max(one.first - 1 - start, 0) :]
    rows = np.tile(one._still, (*seen.shape[:2], 1, 1))
    rows[:, :, one._column] = poses_read_back(seen.reshape(-1, 7)).reshape(seen.shape)
    before = [np.stack([episode._rows[-1][:, 3:] for episode in episodes])] if one._rows else []
    rows[..., 3:] = continuous(np.stack([*before, *rows[..., 3:]]))[len(before) :]
    for index, episode in enumerate(episodes):
        episode._turn, episode._next = turns[-1, index].copy(), stop
        episode._rows += list(rows[:, index].copy())
