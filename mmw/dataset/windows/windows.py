"""Find the windows of a dataset, and read one as NumPy arrays."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from mmw.core.errors import InputError
from mmw.dataset import Dataset, open_dataset
from mmw.dataset.windows.channel_sources import link_source
from mmw.dataset.windows.file_sources import OPEN_FILES, Cache, file_source, framed_files
from mmw.dataset.windows.memory_sources import Source, box_source, number_source
from mmw.dataset.windows.tracks import Track, find_tracks
from mmw.dataset.windows.window_spec import WITH_LINK, Feature, WindowSpec

CACHE_BYTES = 256_000_000
"""Size of the cache of decoded images, sweeps and row groups of a process [bytes]. Sweeps and images of four agents
and two seconds at 10 Hz need 110 MB. Design value."""

Sample = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Windows:
    """Windows, sorted by scenario, weather, `now` and agent; `windows[n]` reads one."""

    dataset: Dataset
    spec: WindowSpec
    tracks: tuple[Track, ...]
    """All tracks that windows may come from."""
    sources: Mapping[str, Source]
    """Key of each feature -> source of its samples."""
    track: np.ndarray
    """Track of each window, shape [n], int64."""
    now: np.ndarray
    """Its last past frame, shape [n], int64."""
    first: np.ndarray
    """First frame that it uses, that of its oldest sample included, shape [n], int64."""
    last: np.ndarray
    """Last frame that it uses, shape [n], int64."""
    shard: np.ndarray
    """Number of the shard that its `now` is in, over all scenarios and weathers, shape [n], int64."""
    dropped: Mapping[str, int]
    """Reason -> number of windows dropped for it, among frames that are multiples of the stride."""

    def __len__(self) -> int:
        """Return the number of windows."""
        return len(self.now)

    def __getitem__(self, index: int) -> Sample:
        """Return one window: `now`, `track`, and for each feature its samples and their frames (`KEY_frame`).

        Images are one array, shape [T, H, W, ...]; point clouds and boxes are lists of T arrays. All are the caller's.
        """
        sample = self.load(index)
        for key, value in sample.items():
            if isinstance(value, tuple):
                sample[key] = np.stack(value)
            elif isinstance(value, list):
                sample[key] = [one if one.flags.writeable else one.copy() for one in value]
        return sample

    @cached_property
    def _plan(self) -> list[tuple[str, Source, np.ndarray]]:
        return [(one.key, self.sources[one.key], self.spec.offsets(one)) for one in self.spec.all_features]

    def load(self, index: int) -> Sample:
        """Return one window with arrays that cannot be written where other windows share them; images are a tuple.

        Raises:
            InputError: If a file cannot be read.
        """
        number, now = int(self.track[index]), int(self.now[index])
        found: Sample = {"now": np.array(now), "track": np.array(number)}
        begin = now - self.tracks[number].first
        for key, source, offsets in self._plan:
            latest, at = source.latest[number], offsets + begin
            for suffix, value in source.load(latest.row[at]).items():
                found[key + suffix] = value
            found[f"{key}_frame"] = latest.frame[at]
        return found

    def select(self, which: ArrayLike) -> "Windows":
        """Return a selection of the windows.

        Args:
            which: Their numbers, shape [k], or a mask, shape [n].
        """
        which = np.asarray(which)
        which = np.flatnonzero(which) if which.dtype == bool else which.astype(np.int64)
        arrays = {name: getattr(self, name)[which] for name in ("track", "now", "first", "last", "shard")}
        return replace(self, **arrays)

    def of_track(self, value: Callable[[Track], Any]) -> np.ndarray:
        """Return a value of every window's track, shape [n], such as `lambda track: track.scenario`."""
        values = np.array([value(track) for track in self.tracks])
        return values[self.track]

    def where(
        self,
        *,
        scenarios: Iterable[str] | None = None,
        weathers: Iterable[str] | None = None,
        agents: Iterable[str] | None = None,
    ) -> "Windows":
        """Return the windows of some scenarios, weathers and agents (names, or the roles `cav` and `rsu`).

        Raises:
            InputError: If a name is not among the tracks.
        """
        is_chosen = _choose(self.tracks, scenarios, weathers, agents)
        return self.select(is_chosen[self.track])


def open_windows(
    dataset: Dataset | str | Path,
    spec: WindowSpec,
    *,
    scenarios: Iterable[str] | None = None,
    weathers: Iterable[str] | None = None,
    agents: Iterable[str] | None = None,
    cache: str | Path | None = None,
    cache_bytes: int = CACHE_BYTES,
) -> Windows:
    """Return the windows of a dataset.

    Numbers, boxes and beams are read now into memory, point clouds and images when a window is read. A window exists
    only if all its frames, from the first to the last, are there without a gap and each of its samples exists.

    Args:
        dataset: A dataset, or its folder.
        spec: Features and lengths of a window.
        scenarios: Only these.
        weathers: Only these.
        agents: Only these names or roles (`cav`, `rsu`).
        cache: Folder for the beams found by searches (1.5 ms of a core for each link, carrier and frame), which later
            calls read.
        cache_bytes: Size of each process's cache of images, sweeps and row groups.

    Raises:
        InputError: If a table or a name is not there, the windows are longer than every track, or none is left.

    Examples:
        >>> from mmw.dataset.windows import Feature, WindowSpec
        >>> spec = WindowSpec(["poses", Feature("lidar", every=2)], past=2, future=1)
        >>> windows = open_windows("out/quickstart", spec, weathers=["sunny"], agents=["cav"])
        >>> sample = windows[0]
        >>> sorted(sample), sample["poses"].shape
        (['lidar', 'lidar_frame', 'now', 'poses', 'poses_frame', 'track'], (2, 13))
    """
    data = dataset if isinstance(dataset, Dataset) else open_dataset(dataset)
    _check_tables(data, spec)
    every = find_tracks(data)
    is_chosen = _choose(every, scenarios, weathers, agents)
    tracks = tuple(track for track, chosen in zip(every, is_chosen, strict=True) if chosen)
    longest = max((track.longest_run for track in tracks), default=0)
    if spec.before + spec.after + 1 > longest:
        raise InputError(
            f"{data.root}: windows reach over {spec.before + spec.after + 1} frames; the longest unbroken track has "
            f"{longest}; shorten past, future or step"
        )
    arrays, files = Cache(cache_bytes), Cache(OPEN_FILES)
    folder = None if cache is None else Path(cache)
    sources: dict[str, Source] = {}
    for number, feature in enumerate(spec.all_features):
        known = [other for other in spec.all_features[:number] if other.shares_source_with(feature)]
        sources[feature.key] = sources[known[0].key] if known else _source(data, feature, tracks, arrays, files, folder)
    return _find(data, spec, tracks, sources)


def _source(
    data: Dataset, feature: Feature, tracks: Sequence[Track], arrays: Cache, files: Cache, folder: Path | None
) -> Source:
    if feature.modality in WITH_LINK:
        return link_source(data, feature, tracks, folder)
    if feature.kind == "numbers":
        return number_source(data, feature, tracks)
    if feature.kind == "boxes":
        return box_source(data, tracks, feature)
    return file_source(data, feature, tracks, arrays, files)


def _find(data: Dataset, spec: WindowSpec, tracks: tuple[Track, ...], sources: Mapping[str, Source]) -> Windows:
    """Return all windows.

    Raises:
        InputError: If there is none.
    """
    dropped = dict.fromkeys(("frames", *sources), 0)
    found: list[np.ndarray] = []
    for number, track in enumerate(tracks):
        runs = track.runs
        at = np.flatnonzero((runs >= 0) & ((np.arange(len(runs)) + track.first) % spec.stride == 0))
        fits = (at >= spec.before) & (at + spec.after < len(runs))
        fits[fits] = runs[at[fits] - spec.before] == runs[at[fits] + spec.after]
        dropped["frames"] += int((~fits).sum())
        at = at[fits]
        first = at + track.first - spec.before
        for feature in spec.all_features:
            own = sources[feature.key].latest[number].frame[at[:, None] + spec.offsets(feature)]
            is_there = (own >= 0).all(axis=1)
            dropped[feature.key] += int((~is_there).sum())
            at, first, own = at[is_there], first[is_there], own[is_there]
            first = np.minimum(first, own.min(axis=1, initial=np.iinfo(np.int64).max))
        now = at + track.first
        found.append(np.stack([np.full(len(now), number), now, first, now + spec.after]))
    track, now, first, last = np.concatenate(found, axis=1)
    if not len(now):
        reasons = ", ".join(f"{name}: {count}" for name, count in dropped.items() if count)
        raise InputError(
            f"{data.root}: no window is left; without frames or samples are {reasons}; use fewer features, shorten "
            "the window, or choose agents that have the sensors and links"
        )
    shard, part = np.zeros(len(now), dtype=np.int64), np.zeros(len(now), dtype=np.int64)
    count = 0
    for number, ((scenario, weather), begins) in enumerate(sorted(_shards(data).items())):
        of_part = np.array([t.scenario == scenario and t.weather == weather for t in tracks])[track]
        part[of_part] = number
        shard[of_part] = np.searchsorted(begins, now[of_part], side="right") - 1 + count
        count += len(begins)
    order = np.lexsort((track, now, part))
    arrays = (values[order] for values in (track, now, first, last, shard))
    return Windows(data, spec, tracks, sources, *arrays, dropped)


def _shards(data: Dataset) -> dict[tuple[str, str], list[int]]:
    """Return the first frames of the shards of each scenario and weather."""
    found: dict[tuple[str, str], list[int]] = {}
    for scenario, weather, begin, _ in framed_files(data, "poses"):
        found.setdefault((scenario, weather), []).append(begin)
    return found


def _check_tables(data: Dataset, spec: WindowSpec) -> None:
    for feature in spec.all_features:
        needed = {feature.table, "poses"} | ({"links"} if feature.modality in WITH_LINK else set())
        missing = sorted(needed - {*data.tables, *data.views})
        if missing:
            raise InputError(
                f"{data.root}: Feature({feature.modality!r}) needs table {' and '.join(missing)}, which has no file; "
                f"it {data.content}; choose other features or record it"
            )


def _choose(
    tracks: Sequence[Track],
    scenarios: Iterable[str] | None,
    weathers: Iterable[str] | None,
    agents: Iterable[str] | None,
) -> np.ndarray:
    """Return whether each track is chosen, shape [tracks].

    Raises:
        InputError: If a name is no track's.
    """
    is_chosen = np.ones(len(tracks), dtype=bool)
    for kind, names in (("scenario", scenarios), ("weather", weathers), ("agent", agents)):
        if names is None:
            continue
        given = {names} if isinstance(names, str) else set(names)
        own = [{getattr(track, kind)} | ({track.role} if kind == "agent" else set()) for track in tracks]
        known = sorted(set().union(*own))
        wrong = sorted(given - set(known))
        if wrong or not given:
            raise InputError(f"windows: {kind} {', '.join(wrong) or 'none'}; there are {', '.join(known)}; name these")
        is_chosen &= [bool(given & some) for some in own]
    return is_chosen
