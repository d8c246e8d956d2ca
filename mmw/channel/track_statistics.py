"""Compute how paths live over the frames of a recording: survival, births that continue an old path, steps of level."""

import numpy as np

from mmw.channel.path_tracks import PathTracks
from mmw.physics.em.vectors import unit_vector

__all__ = ["continues_old_path", "level_steps_db", "median_lifetime", "survival"]


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
