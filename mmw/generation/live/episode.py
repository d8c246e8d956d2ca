"""One run of live traffic in a town: what was driven so far, as the scene's arrays at any of its frames."""

from collections import defaultdict
from collections.abc import Mapping, Sequence

import numpy as np

from mmw.core.errors import InputError
from mmw.generation.live.stage_poses import StagePoses, StagePosesPart, joined, parted
from mmw.scene.scene_data import SceneData
from mmw.traffic.live.control import Control
from mmw.traffic.live.live_traffic import LiveTraffic

BEFORE = 4
"""Frames before the present one in the arrays of a frame; late accelerometers look two back, derivatives one."""

FIRST_ROWS = 64
"""Rows of poses that an episode has room for at first; the room doubles. Design value."""


class Episode:
    """Traffic from its start to the present frame.

    Attributes:
        traffic: The actors.
        frame: The present frame; the next one is known too, so that velocities are central differences.
        seed: Seed of traffic and noise.
    """

    def __init__(self, traffic: LiveTraffic, data: SceneData, first: int, seed: int, margin: int) -> None:
        """Go to the first frame, > 0; the frame before it is known too.

        Args:
            traffic: At its start.
            data: The scene with all actors, in a few frames at the start.
            first: The first frame.
            seed: Seed of traffic and noise.
            margin: Frames before the first one that its samples depend on, if there are so many; >= 1.
        """
        self.traffic = traffic
        self.seed = seed
        self.frame = first
        self._begin = max(first - margin, 0)
        self._data = data
        names = {name: column for column, name in enumerate(traffic.names)}
        pairs = [(column, names[actor.name]) for column, actor in enumerate(data.actors) if actor.name in names]
        self._column, self._source = (np.array(side, dtype=np.int64) for side in zip(*pairs, strict=True))
        self._still = data.frame_poses[-1]
        self._rows = np.empty((0, *self._still.shape))
        self._poses = StagePosesPart(StagePoses(len(self._source)), 0, 1)
        self._count = 0
        self._next = 0
        self._layout = self._begin, id(data), self._column.tobytes(), self._source.tobytes()
        self.traffic.advance(rows_at_start(first))

    def step(self, controls: Mapping[str, Control | None]) -> int:
        """Go to the next frame, and return its number; controls hold until the next ones.

        Raises:
            InputError: If a control cannot be obeyed; nothing has changed then.
        """
        self.traffic.command(controls)
        self.go_on()
        return self.frame

    def go_on(self) -> None:
        """Go to the next frame with the controls that the traffic has."""
        self.frame += 1
        self.traffic.advance(self.frame + 2)

    def remove(self, name: str) -> None:
        """Take an actor out of the scene; errors as of `LiveTraffic.remove`, also if it is part of the town."""
        self._check_moving("remove", name)
        self.traffic.remove(name)

    def add(self, name: str, pose: Sequence[float] | None) -> None:
        """Put an actor back into the scene; errors as of `LiveTraffic.add`, also if it is part of the town."""
        self._check_moving("add", name)
        self.traffic.add(name, pose)

    def _check_moving(self, call: str, name: str) -> None:
        """Check that an actor is no part of the town.

        Raises:
            InputError: If it is; the message starts with the call.
        """
        if name not in self.traffic.names and any(actor.name == name for actor in self._data.actors):
            raise InputError(f"{call} {name!r}: belongs to the town and stays; name an actor of the traffic")

    def _kind(self) -> tuple[object, ...]:
        """Return what episodes have in common whose rows are made at once."""
        return *self._layout, len(self.traffic.names), self._next

    def poses_apart(self, frame: int) -> np.ndarray:
        """Return the poses of `arrays`, for a batch of worlds in which none reads those of another one.

        Returns:
            `BEFORE` poses before the frame, that of the frame, the one after it and NaN, shape [BEFORE + 3, V, 7]; NaN
            also before the first frame that is known.
        """
        own = self.arrays(frame).poses
        out = np.full((BEFORE + 3, *own.shape[1:]), np.nan)
        out[len(out) - 1 - len(own) : -1] = own
        return out

    def _keep(self, poses: np.ndarray) -> None:
        """Add rows of poses, shape [n, V, 7]; those that were given away stay as they are."""
        start, stop = self._count, self._count + len(poses)
        if stop > len(self._rows):
            rows = np.empty((max(2 * stop, FIRST_ROWS), *self._still.shape))
            rows[:start] = self._rows[:start]
            self._rows = rows
        self._rows[start:stop] = poses
        self._count = stop

    def arrays(self, frame: int) -> SceneData:
        """Return the scene from `BEFORE` frames before a frame of the episode to the one after it."""
        catch_up([(self, frame)])
        start = max(frame - BEFORE, self._begin)
        own = self._rows[start - self._begin : frame - self._begin + 2]
        return self._data.at(range(start, frame + 2), own)


def rows_at_start(first: int) -> int:
    """Return how many rows of the traffic an episode needs for its first frame."""
    return first + 2


def poses_around(moments: Sequence[tuple[Episode, int]], reach: int) -> np.ndarray:
    """Return poses of all actors of the scene in the frames about one of each episode.

    Returns:
        Shape [F (2 reach + 1), V, 7], episode by episode.
    """
    catch_up([(episode, frame + reach - 1) for episode, frame in moments])
    rows = []
    for episode, frame in moments:
        middle = frame - episode._begin
        rows.append(episode._rows[middle - reach : middle + reach + 1])
    return np.concatenate(rows)


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
    """Make the rows of episodes of one kind; those before the first that is kept are written and not read."""
    one, many = episodes[0], len(episodes)
    known = np.array([episode.traffic.poses[one._next : stop] for episode in episodes])[:, :, one._source]
    poses = known.swapaxes(0, 1).reshape(known.shape[1], -1, 7)
    whole = joined([episode._poses for episode in episodes])
    read = whole.read_back(poses, max(one._begin - one._next, 0))
    rows = np.empty((many, len(read), *one._still.shape))
    rows[:] = one._still
    rows[:, :, one._column] = read.reshape(len(read), many, -1, 7).swapaxes(0, 1)
    for episode, part, own in zip(episodes, parted(whole, many), rows, strict=True):
        episode._poses, episode._next = part, stop
        episode._keep(own)
