"""Track paths over frames: birth and death of each, the rate of its delay, and the channel between frames.

Between two frames of a track the delay is the cubic that has the delays and rates of both, so the carrier's phase and
the Doppler shift are continuous over frames. Coefficients hold no carrier phase, change slowly and are interpolated
linearly. `docs/guides/csi.md` says how far that is from the truth.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from mmw.channel.links import Links
from mmw.channel.path_interpolation import cubic_between, direction_between
from mmw.channel.path_table import (
    KEY_TYPE,
    NEEDED_COLUMNS,
    PATH_COLUMNS,
    SAMPLE_COLUMNS,
    CarrierPaths,
    PathSamples,
    read_column,
    rows_from_paths,
)
from mmw.channel.paths import PathSet
from mmw.core.constants import FRAME_RATE_HZ
from mmw.core.errors import InputError
from mmw.physics.em.vectors import times

Edges = Literal["hold", "fade", "drop"]
"""Treatment of a track between its last frame and the next one, and before its first; see `PathTracks.at`."""

TRACK_COLUMNS = (*PATH_COLUMNS, "path_id")
"""Columns of the view `paths` that `tracks_from_table` reads."""

LINK_NAMES = ("agent", "peer", "antenna", "peer_antenna")
"""Fields of `PathTracks` that together name a link."""

TIME_DECIMALS = 8
"""Times are rounded to this many decimals of a frame (0.1 ns), so that n / rate in floating point is frame n."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PathTracks(PathSamples):
    """Tracks of one scenario, weather and carrier: L links, K tracks, S samples (P = S).

    A track is one path of one link over consecutive frames of the channel, `step` frames apart. A path that is away for
    one of them comes back as a new track.
    Tracks are sorted by (link, path_id, birth); the samples of track k are `offset[k]` to `offset[k + 1]`, in the order
    of frames.
    """

    scenario: str
    weather: str
    agent: np.ndarray
    """Receiver of each link, shape [L]."""
    peer: np.ndarray
    """Transmitter of each link, shape [L]; links are sorted by agent, peer, antenna and peer_antenna."""
    antenna: np.ndarray
    """Antenna of the receiver of each link, shape [L]."""
    peer_antenna: np.ndarray
    """Antenna of the transmitter of each link, shape [L]."""
    frames: np.ndarray
    """Frames that were recorded, growing, shape [F], int64."""
    link: np.ndarray
    """Link of each track, shape [K], int64."""
    path_id: np.ndarray
    """Identifier of the path in every frame, shape [K], int64; several tracks of a link may share it, one after
    another."""
    offset: np.ndarray
    """First sample of each track, and S behind the last, shape [K + 1], int64."""
    frame: np.ndarray
    """Frame of each sample, shape [S], int64."""
    rate_hz: int = FRAME_RATE_HZ
    """Frames a second."""
    step: int = 1
    """Frames from one sample of the channel to the next."""

    @property
    def step_s(self) -> float:
        """Time from one sample of the channel to the next [s]."""
        return self.step / self.rate_hz

    def __len__(self) -> int:
        """Return the number of tracks."""
        return len(self.link)

    @property
    def link_count(self) -> int:
        """Number of links L, with and without tracks."""
        return len(self.agent)

    @property
    def length(self) -> np.ndarray:
        """Number of frames of each track, shape [K], int64."""
        return np.diff(self.offset)

    @property
    def birth(self) -> np.ndarray:
        """First frame of each track, shape [K], int64."""
        return self.frame[self.offset[:-1]]

    @property
    def death(self) -> np.ndarray:
        """Last frame of each track, shape [K], int64."""
        return self.frame[self.offset[1:] - 1]

    @cached_property
    def track(self) -> np.ndarray:
        """Track of each sample, shape [S], int64."""
        return np.repeat(np.arange(len(self)), self.length)

    @property
    def is_birth(self) -> np.ndarray:
        """True where the frame before the birth was recorded, so the path is known not to be there, shape [K]."""
        return np.isin(self.birth - self.step, self.frames)

    @property
    def is_death(self) -> np.ndarray:
        """True where the frame after the death was recorded, so the path is known to be gone, shape [K]."""
        return np.isin(self.death + self.step, self.frames)

    @property
    def tau_rate(self) -> np.ndarray:
        """Rate of change of the delay by the stored Doppler shift, d(tau)/dt = -f_D / f [s/s], shape [S]."""
        return -self.doppler_hz / self.carrier_hz

    def lifetimes(self, complete: bool = True) -> np.ndarray:
        """Return the lifetimes of tracks [s], shape [n]: samples times `step_s`, wrong by up to one sample.

        Args:
            complete: Only tracks whose birth and death are in the record; the others last longer.
        """
        keep = self.is_birth & self.is_death if complete else np.ones(len(self), dtype=bool)
        return self.length[keep] * self.step_s

    def births(self) -> np.ndarray:
        """Return the number of tracks born in each of `frames`, shape [F], int64."""
        return self._counted(self.birth[self.is_birth])

    def deaths(self) -> np.ndarray:
        """Return the number of tracks that end with each of `frames`, shape [F], int64."""
        return self._counted(self.death[self.is_death])

    def alive(self) -> np.ndarray:
        """Return the number of paths in each of `frames`, shape [F], int64."""
        return self._counted(self.frame)

    def _counted(self, frame: np.ndarray) -> np.ndarray:
        return np.bincount(np.searchsorted(self.frames, frame), minlength=len(self.frames))

    def at(self, time_s: ArrayLike, edges: Edges = "hold") -> CarrierPaths:
        """Return the paths at any time in the recording, as rows of a frame are returned by `CarrierPaths.from_table`.

        On a frame these are the stored values, to the bit. Between frames a track that is there on both sides has its
        delay and Doppler shift by the cubic, its angles along the arc, and `transfer` and `a` linearly (a transfer in
        bases that are carried along the arc, so azimuths may run fast near the zenith).

        Args:
            time_s: Times after the start of the scenario, frame / rate on a frame [s]; one, or shape [T].
            edges: Tracks that are there on one side only. `hold`: go on for half a frame, at their own Doppler shift
                and with the coefficients of that frame; every instant belongs to exactly one frame, so a path that
                changes its name is there once, and diffuse paths, which live in one frame, keep their power. `fade`:
                the same for a whole frame, with coefficients that go linearly to 0, so the channel has no jumps.
                `drop`: not there at all.

        Returns:
            Paths of T times L links; the row of link l at time t is t L + l, so a response of shape [T L, ...] becomes
            [T, L, ...] by `reshape`. A link that has no path then, or whose agents are not there, has no path. In
            `keys`, `frame` is the nearest frame; `row` is that of the sample there, or of the only one.

        Raises:
            InputError: If a time is not in the recording, or lies between two frames of which one is missing.
        """
        if edges not in ("hold", "fade", "drop"):
            raise InputError(f"PathTracks.at: edges = {edges!r}; it is hold, fade or drop")
        time = np.atleast_1d(np.asarray(time_s, dtype=np.float64))
        if time.ndim != 1:
            raise InputError(f"PathTracks.at: time_s has shape {time.shape}; give one time, or shape [T]")
        frame, share = self._locate(time)
        moment, first = self._samples_in(frame)
        s, has_next = share[moment], first + 1 < self.offset[self.track[first] + 1]
        next_moment, next_sample = self._samples_in(frame + self.step)
        new = (next_sample == self.offset[self.track[next_sample]]) & (share[next_moment] > 0.0)
        keep = has_next | (s == 0.0)
        if edges == "drop":
            new[:] = False
        else:
            keep |= (s < 0.5) | (edges == "fade")
            new &= (share[next_moment] >= 0.5) | (edges == "fade")
        moment, first, s, has_next = moment[keep], first[keep], s[keep], has_next[keep]
        next_moment, next_sample = next_moment[new], next_sample[new]
        sample = np.concatenate([first, next_sample])
        beyond = np.concatenate([s, share[next_moment] - 1.0])  # samples from this one to the time
        both = np.concatenate([has_next & (s > 0.0), np.zeros(len(next_sample), dtype=bool)])
        moment = np.concatenate([moment, next_moment])
        order = np.lexsort((self.track[sample], moment))
        moment, sample, beyond, both = moment[order], sample[order], beyond[order], both[order]
        link = moment * self.link_count + self.link[self.track[sample]]
        keys = self._keys(frame + self.step * (share >= 0.5))
        values = self._values(sample, beyond, both, edges)
        return CarrierPaths(carrier_hz=self.carrier_hz, keys=keys, link=link, **values)

    def _locate(self, time: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the sampled frame at or before each time, and the share of a step since then."""
        first = int(self.frames[0]) if len(self.frames) else 0
        position = (np.round(time * self.rate_hz, TIME_DECIMALS) - first) / self.step
        is_there = np.isfinite(position)
        sample = np.floor(np.where(is_there, position, -1.0)).astype(np.int64)
        share = np.where(is_there, position - sample, 0.0)
        frame = first + self.step * sample
        is_there &= np.isin(frame, self.frames) & (np.isin(frame + self.step, self.frames) | (share == 0.0))
        if not is_there.all():
            wrong = int(np.argmin(is_there))
            raise InputError(
                f"PathTracks.at: time_s = {time[wrong]:g}; it needs frames {frame[wrong]} and "
                f"{frame[wrong] + self.step}, and there are {len(self.frames)} frames from {self.frames[0]} to "
                f"{self.frames[-1]}; give times between "
                "recorded frames, or the rows of table links if a frame is missing that has no path"
            )
        return frame, share

    @cached_property
    def _by_frame(self) -> tuple[np.ndarray, np.ndarray]:
        order = np.argsort(self.frame, kind="stable")
        return order, self.frame[order]

    def _samples_in(self, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return all samples of some frames, shape [n], and which of the frames each is of, shape [n]."""
        order, sorted_frame = self._by_frame
        begin = np.searchsorted(sorted_frame, frame, side="left")
        count = np.searchsorted(sorted_frame, frame, side="right") - begin
        moment = np.repeat(np.arange(len(frame)), count)
        return moment, order[np.repeat(begin - np.cumsum(count) + count, count) + np.arange(len(moment))]

    def _keys(self, frame: np.ndarray) -> np.ndarray:
        keys = np.empty((len(frame), self.link_count), dtype=KEY_TYPE)
        keys["scenario"], keys["weather"], keys["frame"] = self.scenario, self.weather, frame[:, None]
        for name in LINK_NAMES:
            keys[name] = getattr(self, name)
        return keys.reshape(-1)

    def _values(self, sample: np.ndarray, beyond: np.ndarray, both: np.ndarray, edges: Edges) -> dict[str, np.ndarray]:
        """Return the columns at `beyond` steps after samples; `both` where the next one counts too."""
        values = {name: getattr(self, name)[sample] for name in SAMPLE_COLUMNS}
        values["tau"] = values["tau"] - beyond * self.step_s * values["doppler_hz"] / self.carrier_hz
        if edges == "fade":
            weight = np.where(both, 1.0, 1.0 - np.abs(beyond))
            values["a"], values["transfer"] = values["a"] * weight, values["transfer"] * weight[:, None, None]
        s, ends = beyond[both], (sample[both], sample[both] + 1)

        def pair(name: str) -> tuple[np.ndarray, np.ndarray]:
            column = getattr(self, name)
            return column[ends[0]], column[ends[1]]

        first, second = (-self.step_s / self.carrier_hz * doppler for doppler in pair("doppler_hz"))
        values["tau"][both], change = cubic_between(pair("tau"), (first, second), s)
        values["doppler_hz"][both] = -self.carrier_hz / self.step_s * change
        departure, tx_turn = direction_between(pair("theta_t"), pair("phi_t"), s)
        arrival, rx_turn = direction_between(pair("theta_r"), pair("phi_r"), s)
        values["theta_t"][both], values["phi_t"][both] = departure
        values["theta_r"][both], values["phi_r"][both] = arrival
        parts = [times(times(rx_turn[k], self.transfer[ends[k]]), tx_turn[k].swapaxes(1, 2)) for k in (0, 1)]
        values["transfer"][both] = (1.0 - s)[:, None, None] * parts[0] + s[:, None, None] * parts[1]
        values["a"][both] = (1.0 - s) * self.a[ends[0]] + s * self.a[ends[1]]
        nearest = ends[0] + (s >= 0.5)
        for name in ("row", "interaction", "edge", "curvature"):
            values[name][both] = getattr(self, name)[nearest]
        for name in ("vertex", "first_segment_m"):  # a track has the same interactions all the time
            share = s.reshape(-1, *(1,) * (values[name].ndim - 1))
            values[name][both] = (1.0 - share) * getattr(self, name)[ends[0]] + share * getattr(self, name)[ends[1]]
        return values


def tracks_from_table(
    table: Any, carrier_hz: float | None = None, links: Any = None, *, rate_hz: int = FRAME_RATE_HZ, step: int = 1
) -> PathTracks:
    """Return the tracks of rows of the view `paths` of one scenario and weather.

    Args:
        table: Rows in any order with `TRACK_COLUMNS`: a pyarrow Table, a pandas DataFrame or a mapping.
        carrier_hz: Carrier [Hz]; None selects the only one there is.
        links: Rows of table `links`, of any of those kinds. They say which frames and links there are besides those
            that have paths.
        rate_hz: Frames a second, `Dataset.frame_rate_hz`.
        step: Frames from one sample of the channel to the next, where `channel.rate_hz` is lower than the frames' rate.

    Raises:
        InputError: As `CarrierPaths.from_table`; or if there are several scenarios or weathers, or a path is twice in a
            frame of a link.

    Examples:
        >>> import mmw
        >>> data, one = mmw.open_dataset("out/quickstart"), {"weather": "sunny", "frames": range(0, 4)}
        >>> tracks = tracks_from_table(data.read("paths", **one), 28e9, data.read("links", **one))
        >>> tracks.alive().tolist()  # paths in each frame
        [7, 7, 7, 7]
        >>> tracks.at([0.005, 0.015]).link_count == 2 * tracks.link_count  # between frames
        True
    """
    paths = CarrierPaths.from_table(table, carrier_hz, links)
    path_id = read_column(table, "paths", "path_id", (*NEEDED_COLUMNS, "path_id")).to_numpy(zero_copy_only=False)
    if path_id.dtype.kind not in "iu" and len(path_id):
        raise InputError(f"table paths, column path_id: holds {path_id.dtype}; it needs whole numbers of 64 bits")
    return tracks_from_rows(paths, path_id.astype(np.int64)[paths.row], rate_hz=rate_hz, step=step)


def tracks_from_paths(links: Links, paths: PathSet, *args: Any, **names: Any) -> PathTracks:
    """Return the tracks of paths in memory, of one weather and carrier; the arguments are those of `rows_from_paths`.

    Raises:
        InputError: If weather or carrier are not there, or a path is twice in a frame of a link.
    """
    return tracks_from_rows(rows_from_paths(links, paths, *args, **names), paths.path_id)


def tracks_from_rows(
    paths: CarrierPaths, path_id: np.ndarray, *, rate_hz: int = FRAME_RATE_HZ, step: int = 1
) -> PathTracks:
    """Return the tracks of paths of one scenario and weather.

    Args:
        paths: Paths of links, a link for each frame, agent, peer and their antennas. Frames without links are taken
            as not recorded.
        path_id: What each path is in every frame, shape [P], int64.
        rate_hz: Frames a second.
        step: Frames from one sample of the channel to the next.

    Raises:
        InputError: If there is not exactly one scenario and weather, or a path is twice in a frame of a link.
    """
    names = set(zip(paths.keys["scenario"], paths.keys["weather"], strict=True))
    if len(names) != 1:
        listed = ", ".join(f"{scenario} {weather}" for scenario, weather in sorted(names)[:8])
        raise InputError(
            f"tracks: {listed or 'no links'}; tracks need one scenario and weather; select the rows of one"
        )
    ((scenario, weather),) = names
    ends = sorted(set(zip(*(paths.keys[name] for name in LINK_NAMES), strict=True)))
    number = {names: index for index, names in enumerate(ends)}
    link_of = np.array([number[names] for names in zip(*(paths.keys[n] for n in LINK_NAMES), strict=True)], np.int64)
    link, frame = link_of[paths.link], paths.keys["frame"][paths.link]
    order = np.lexsort((frame, path_id, link))
    link, path_id, frame = link[order], path_id[order], frame[order]
    is_same, gap = (np.diff(link) == 0) & (np.diff(path_id) == 0), np.diff(frame)
    twice = np.flatnonzero(is_same & (gap == 0))
    if len(twice):
        agent, peer, *_ = ends[link[twice[0]]]
        raise InputError(
            f"tracks: {len(twice)} paths are twice in a frame of a link, the first {path_id[twice[0]]} from {peer} "
            f"to {agent} in frame {frame[twice[0]]}; give each row once, and one path_id a path"
        )
    first = np.flatnonzero(np.concatenate([np.ones(min(len(frame), 1), dtype=bool), ~is_same | (gap != step)]))
    return PathTracks(
        carrier_hz=paths.carrier_hz,
        scenario=scenario,
        weather=weather,
        **{
            name: np.array(column, dtype=object)
            for name, column in zip(LINK_NAMES, zip(*ends, strict=True), strict=True)
        },
        frames=np.unique(paths.keys["frame"]),
        link=link[first],
        path_id=path_id[first],
        offset=np.append(first, len(frame)),
        frame=frame,
        rate_hz=rate_hz,
        step=step,
        **{name: getattr(paths, name)[order] for name in SAMPLE_COLUMNS},
    )
