"""The work that a dataset is cut into: which frames are traced together, and who does which part."""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from mmw.config import Config, ScenarioConfig
from mmw.core.errors import InputError
from mmw.storage.manifest import pending
from mmw.storage.shard_writer import ShardKey
from mmw.storage.store import Root


@dataclass(frozen=True)
class Work:
    """Shards that are traced together: the same frames of a scenario in some weathers."""

    scenario: str
    frame_begin: int
    frame_end: int
    """One past the last frame."""
    weathers: tuple[str, ...]
    """None where only the scenario's static tables are to be made."""

    def __str__(self) -> str:
        return f"{self.scenario}, frames {self.frame_begin} to {self.frame_end - 1}"

    @property
    def frames(self) -> int:
        """Scenario-weather-frames."""
        return (self.frame_end - self.frame_begin) * len(self.weathers)

    @property
    def keys(self) -> list[ShardKey]:
        """Its shards, one a weather."""
        return [ShardKey(self.scenario, weather, self.frame_begin, self.frame_end) for weather in self.weathers]


@dataclass(frozen=True)
class Partition:
    """One of several parts of a dataset, each made by a run of its own."""

    index: int = 0
    count: int = 1

    @classmethod
    def parse(cls, text: str) -> "Partition":
        """Return the part that `i/N` names, i from 0 to N - 1.

        Raises:
            InputError: If it names none.
        """
        index, slash, count = text.partition("/")
        if not (slash and index.isdecimal() and count.isdecimal() and int(index) < int(count)):
            raise InputError(f"--shard {text}: is not i/N with i from 0 to N - 1; the first of four is 0/4")
        return cls(int(index), int(count))

    def __str__(self) -> str:
        return f"{self.index}/{self.count}"

    @property
    def is_whole(self) -> bool:
        """Whether it is the whole dataset."""
        return self.count == 1


def shard_keys(config: Config, scenario: ScenarioConfig) -> list[ShardKey]:
    """Return all shards of a scenario: weathers x pieces of `output.shard_frames` frames."""
    step, frames = config.output.shard_frames, config.frames_of(scenario)
    return [
        ShardKey(scenario.name, weather, begin, min(begin + step, frames.stop))
        for begin in range(frames.start, frames.stop, step)
        for weather in config.weathers
    ]


def all_work(config: Config) -> list[Work]:
    """Return everything that a configuration asks for, scenario by scenario, in the order of the frames."""
    return [work for scenario in config.scenarios for work in _grouped(shard_keys(config, scenario))]


def part_of(work: Sequence[Work], part: Partition) -> list[Work]:
    """Return one part of the work, frames next to each other: parts differ by no more than a piece of work.

    Args:
        work: All of it, whoever has made some already, so that every run cuts the same parts.
        part: Which part.
    """
    total = sum(item.frames for item in work)
    chosen, before = [], 0
    for item in work:
        middle = before + item.frames / 2
        if int(middle * part.count / total) == part.index:
            chosen.append(item)
        before += item.frames
    return chosen


def pending_work(root: Root, work: Iterable[Work]) -> list[Work]:
    """Return what is not finished in a dataset; a scenario's static tables alone are work without weathers."""
    work = list(work)
    begin = {item.scenario: item.frame_begin for item in reversed(work)}
    left = pending(root, [*(key for item in work for key in item.keys), *begin])
    rest = _grouped(key for key in left if isinstance(key, ShardKey))
    busy = {item.scenario for item in rest}
    return rest + [Work(name, begin[name], begin[name], ()) for name in begin if name in left and name not in busy]


def _grouped(keys: Iterable[ShardKey]) -> list[Work]:
    """Return shards of the same frames together, so that they are traced once for all their weathers."""
    weathers: dict[tuple[str, int, int], list[str]] = defaultdict(list)
    for key in keys:
        weathers[key.scenario, key.frame_begin, key.frame_end].append(key.weather)
    return [Work(*frames, tuple(names)) for frames, names in weathers.items()]
