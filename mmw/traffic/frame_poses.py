"""Give the poses of traffic at the frames of any rate.

Every engine makes poses at 100 Hz. Poses at other instants lie on the quintic through two neighbors that has their
velocities and accelerations, so positions, velocities and accelerations are continuous, and poses at multiples of
10 ms are those of the engine, to the bit. The traffic of a scenario is therefore the same at every rate.

Source: quintic Hermite interpolation; derivatives by central differences of fourth order, B. Fornberg, Generation of
finite difference formulas, Math. Comp. 51 (1988), table 1.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from mmw.core.frame_rate import SPAN, instants, pose_stride
from mmw.core.kinematics import extend
from mmw.core.transforms import continuous, normalize
from mmw.traffic.demand import VehicleTrack

FIRST = np.array([1.0, -8.0, 0.0, 8.0, -1.0]) / 12.0
"""Weights of five samples for the first derivative at the middle one."""

SECOND = np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / 12.0
"""The same for the second derivative."""


def sample_tracks(tracks: Sequence[VehicleTrack], frame_count: int, rate_hz: int) -> list[VehicleTrack]:
    """Return tracks at other instants.

    Args:
        tracks: Tracks at 100 Hz that reach the last frame.
        frame_count: Frames of the result.
        rate_hz: Frames a second; each has `pose_stride(rate_hz)` poses.
    """
    stride = pose_stride(rate_hz)
    base, part = instants(np.arange((frame_count - 1) * stride + 1), rate_hz * stride)
    shares = part / SPAN
    return [
        replace(
            track,
            poses=poses_between(track.poses, base, shares),
            waits=None if track.waits is None else track.waits[base],
        )
        for track in tracks
    ]


def poses_between(poses: np.ndarray, row: np.ndarray, share: np.ndarray) -> np.ndarray:
    """Return poses at instants between rows.

    Args:
        poses: Body to world at equally spaced instants, shape [F, 7], float64; NaN where absent.
        row: Row at or before each instant, shape [N].
        share: Share of a row since then, 0 to less than 1, shape [N].

    Returns:
        Shape [N, 7]; the row itself, to the bit, where the share is 0, and NaN where one of both neighbors is absent.
    """
    out = poses[row]
    between = np.flatnonzero(share > 0.0)
    if not len(between):
        return out
    out[between] = np.nan
    presence = np.isfinite(poses).all(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], presence, [False]])))
    for start, stop in edges.reshape(-1, 2):
        some = between[(row[between] >= start) & (row[between] + 1 < stop)]
        if len(some):
            out[some] = _quintic(poses[start:stop], row[some] - start, share[some])
    return out


def _quintic(poses: np.ndarray, row: np.ndarray, share: np.ndarray) -> np.ndarray:
    values = np.concatenate([poses[:, :3], continuous(normalize(poses[:, 3:]))], axis=1)
    padded = extend(extend(values))
    stencil = np.stack([padded[k : k + len(values)] - values for k in range(5)])  # a body at rest stays at rest
    slope, bend = np.tensordot(FIRST, stencil, axes=1), np.tensordot(SECOND, stencil, axes=1)
    s = share[:, None]
    p, q = values[row], values[row + 1]
    v, w, a, b = slope[row], slope[row + 1], bend[row], bend[row + 1]
    gap = q - p - v - 0.5 * a
    turn, rest = w - v - a, b - a
    cubic, fourth, fifth = (
        10.0 * gap - 4.0 * turn + 0.5 * rest,
        -15.0 * gap + 7.0 * turn - rest,
        6.0 * gap - 3.0 * turn + 0.5 * rest,
    )
    found = p + s * (v + s * (0.5 * a + s * (cubic + s * (fourth + s * fifth))))
    return np.concatenate([found[:, :3], normalize(found[:, 3:])], axis=1)
