"""Compute how paths live over the frames of a recording: survival, births that continue an old path, steps of level."""

import numpy as np

from mmw.channel.path_tracks import LINK_NAMES, PathTracks
from mmw.physics.em.vectors import unit_vector

__all__ = [
    "ABRUPT",
    "continues_old_path",
    "fine_steps_db",
    "level_steps_db",
    "median_lifetime",
    "sample_rows",
    "survival",
]

ABRUPT = 2.0
"""A change of amplitude is abrupt if those before and after it are smaller by more than this factor: in a null, where
the amplitude falls to 0 and rises again at one rate, each is like its neighbors. Design value."""


def survival(tracks: PathTracks, births: np.ndarray | None = None) -> np.ndarray:
    """Return the share of tracks that live longer than n samples, n = 0, 1, ..., shape [N + 1]; 1 at n = 0.

    Tracks that the end of the recording cuts off count as long as they are seen. N is the longest life among the
    tracks; NaN from 1 on without any.

    Args:
        tracks: Tracks of paths.
        births: Tracks to count, shape [K], bool; those with a known birth when not given.

    Source: the product-limit estimator, E. L. Kaplan and P. Meier, "Nonparametric estimation from incomplete
    observations", Journal of the American Statistical Association 53, 1958.
    """
    keep = tracks.is_birth if births is None else births
    length, is_death = tracks.length[keep], tracks.is_death[keep]
    if not len(length):
        return np.array([1.0, np.nan])
    ended = np.bincount(length[is_death], minlength=length.max() + 1)
    at_risk = np.cumsum(np.bincount(length, minlength=length.max() + 1)[::-1])[::-1]
    return np.cumprod(1.0 - ended / at_risk)


def median_lifetime(tracks: PathTracks, births: np.ndarray | None = None) -> float:
    """Return the median lifetime of tracks [s]: the time that at most half of them outlive; infinite if more do.

    Args:
        tracks: Tracks of paths.
        births: As in `survival`.
    """
    share = survival(tracks, births)
    if np.isnan(share[-1]):
        return float("nan")
    over = np.flatnonzero(share <= 0.5)
    return float(over[0] * tracks.step_s) if len(over) else float("inf")


def continues_old_path(tracks: PathTracks, max_change_s: float, max_turn_rad: float = np.pi) -> np.ndarray:
    """Return True for tracks that go on where another one of their link ended, shape [K], bool.

    The other one was there in the frame before the birth, and not in that of the birth, and the delays of both there
    differ by less than `max_change_s`: it is the same wave under another `path_id`.

    Args:
        tracks: Tracks of paths.
        max_change_s: Largest change of delay from a frame to the next [s].
        max_turn_rad: Largest change of the directions of departure and of arrival, which tells waves of one delay
            apart [rad].
    """
    begin_delay, end_delay = tracks.tau[tracks.offset[:-1]], tracks.tau[tracks.offset[1:] - 1]
    directions = [
        (unit[tracks.offset[:-1]], unit[tracks.offset[1:] - 1])
        for unit in (
            unit_vector(tracks.theta_t, tracks.phi_t),
            unit_vector(tracks.theta_r, tracks.phi_r),
        )
    ]
    out = np.zeros(len(tracks), dtype=bool)
    ended: dict[tuple[int, int], list[int]] = {}
    for track in np.flatnonzero(tracks.is_death):
        ended.setdefault((int(tracks.link[track]), int(tracks.death[track])), []).append(int(track))
    for track in np.flatnonzero(tracks.is_birth):
        before = ended.get((int(tracks.link[track]), int(tracks.birth[track]) - tracks.step), [])
        fits = np.abs(end_delay[before] - begin_delay[track]) < max_change_s
        for begins, ends in directions:
            fits &= ends[before] @ begins[track] >= np.cos(max_turn_rad)
        out[track] = bool(fits.any())
    return out


def level_steps_db(tracks: PathTracks) -> np.ndarray:
    """Return the change of |a| of each track from a sample to its next one [dB], shape [S - K].

    Infinite where one of both is 0, and 0 where both are.
    """
    level = np.abs(tracks.a)
    is_same = np.ones(max(len(level) - 1, 0), dtype=bool)
    is_same[tracks.offset[1:-1] - 1] = False
    before, after = level[:-1][is_same], level[1:][is_same]
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where((before == 0.0) & (after == 0.0), 0.0, 20.0 * np.log10(after / before))


def sample_rows(fine: PathTracks, tracks: PathTracks, track: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """Return the samples that paths of other tracks have in frames, -1 where a path is not there, shape [n], int64.

    Args:
        fine: Tracks whose samples are asked for.
        tracks: Tracks of the same recording.
        track: Row of `tracks`, shape [n].
        frame: Shape [n].

    Raises:
        ValueError: If a link of `tracks` is not among those of `fine`.
    """
    number = {names: index for index, names in enumerate(_link_names(fine))}
    missing = [names for names in _link_names(tracks) if names not in number]
    if missing:
        raise ValueError(f"sample_rows: link {missing[0]} is not among the finer tracks; give those of the same links")
    link = np.array([number[names] for names in _link_names(tracks)], dtype=np.int64)[tracks.link[track]]
    known = fine.link[fine.track], fine.path_id[fine.track], fine.frame
    both = [np.concatenate(pair) for pair in zip(known, (link, tracks.path_id[track], frame), strict=True)]
    key = np.unique(np.column_stack(both), axis=0, return_inverse=True)[1].reshape(-1)
    row = np.full(len(key), -1, dtype=np.int64)
    row[key[: len(fine.frame)]] = np.arange(len(fine.frame))
    return row[key[len(fine.frame) :]]


def fine_steps_db(tracks: PathTracks, fine: PathTracks, *, abrupt: bool = False) -> np.ndarray:
    """Return, for each change of `level_steps_db`, the largest one between two of the finer samples in between [dB].

    A change that a channel makes little by little has small ones in between, a step has itself. Infinite where the path
    is away in between.

    Args:
        tracks: Tracks of paths, with K tracks and S samples.
        fine: Tracks of the same recording with samples closer to each other.
        abrupt: Count only changes of amplitude that are `ABRUPT`: a fade through a null has large ones in dB, too.

    Returns:
        Absolute values, shape [S - K].

    Raises:
        ValueError: If `tracks` have samples that are not among the finer ones, or lie no whole number of them apart.
    """
    ratio = tracks.step // fine.step
    if ratio * fine.step != tracks.step or not np.isin(tracks.frames, fine.frames).all():
        raise ValueError(
            f"fine_steps_db: samples of {tracks.step} and {fine.step} frames; give tracks of every n-th frame, and "
            "those of all frames"
        )
    is_last = np.zeros(len(tracks.frame), dtype=bool)
    is_last[tracks.offset[1:] - 1] = True
    track, frame = tracks.track[~is_last], tracks.frame[~is_last]
    level, out = np.abs(fine.a), np.zeros(len(track))
    counts = _is_abrupt(fine) if abrupt else np.ones(len(level), dtype=bool)
    before = sample_rows(fine, tracks, track, frame)
    for k in range(1, ratio + 1):
        after = sample_rows(fine, tracks, track, frame + k * fine.step)
        one, two = (np.where(rows < 0, np.nan, level[rows]) for rows in (before, after))
        with np.errstate(divide="ignore", invalid="ignore"):
            step = np.where((one == 0.0) & (two == 0.0), 0.0, np.abs(20.0 * np.log10(two / one)))
        step[~np.isnan(step) & ~counts[before]] = 0.0
        out = np.maximum(out, np.where(np.isnan(step), np.inf, step))
        before = after
    return out


def _is_abrupt(tracks: PathTracks) -> np.ndarray:
    """Return whether the amplitude changes abruptly from each sample to the next one of its track, shape [S]."""
    change = np.abs(np.diff(np.abs(tracks.a), append=0.0))
    change[tracks.offset[1:] - 1] = 0.0  # to another track
    before, after = np.roll(change, 1), np.roll(change, -1)
    before[tracks.offset[:-1]] = 0.0
    return change > ABRUPT * np.maximum(before, after)


def _link_names(tracks: PathTracks) -> list[tuple[str, ...]]:
    return list(zip(*(getattr(tracks, name) for name in LINK_NAMES), strict=True))
