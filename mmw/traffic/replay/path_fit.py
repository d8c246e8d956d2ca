"""Fit a smooth line on the ground, and distances along it, to the samples of a recorded vehicle."""

from dataclasses import dataclass

import numpy as np

from mmw.core.errors import InputError
from mmw.traffic.polyline import arc_length, sample_polyline
from mmw.traffic.route import PATH_STEP

NODE_STEP = 0.5
"""The line is drawn through samples at least this far apart [m]: less is noise of a vehicle that stands or creeps."""

FAR_NODES = 3.0
"""Distance of the first or last two nodes beyond which the line begins or ends along the heading [m]."""

FIT_S = 0.6
"""Speed and acceleration at the ends are fitted to the samples of this time [s]."""

FIT_MOST = 6.0
"""Largest acceleration at the ends [m/s^2]."""

SHARPEST_TURN = 2.1
"""A line that turns by more than this at one node goes back on itself [rad]; vehicles only drive forward."""


@dataclass(frozen=True)
class FittedPath:
    """A line through samples, and how far along it each of them is."""

    points: np.ndarray
    """Samples at most `PATH_STEP` apart [m], shape [N, 2], N >= 2."""
    station: np.ndarray
    """Distance of every given sample from the first one [m], shape [M], never falling."""


class BacktrackError(InputError):
    """Samples that go back on themselves; `sample` is the index of the one where they turn."""

    def __init__(self, sample: int) -> None:
        super().__init__(f"sample {sample} turns back")
        self.sample = sample


def fit_path(samples: np.ndarray, heading: np.ndarray | None) -> FittedPath:
    """Return a line through a vehicle's samples.

    The line goes through nodes, the samples that are half a meter or more from the node before, as cubic Hermite pieces
    over the chord length. Samples between two nodes are projected on the chord. Samples that do not get away from a
    node stay where it is.

    Args:
        samples: Places over time [m], shape [M, 2], M >= 1.
        heading: Heading of the vehicle at the samples [rad], shape [M]; it is needed if the vehicle stands.

    Raises:
        BacktrackError: If the samples go back on themselves.
        InputError: If the vehicle stands and has no heading.

    Source: tangents of the parabola through three points, de Boor, A Practical Guide to Splines, 1978, chapter 4.
    """
    nodes = _nodes(samples)
    place = samples[nodes]
    if len(nodes) == 1:
        if heading is None:
            raise InputError("stands still and has no heading")
        ahead = np.array([np.cos(heading[0]), np.sin(heading[0])])
        return FittedPath(place + np.arange(2)[:, None] * PATH_STEP * ahead, np.zeros(len(samples)))
    chord = np.diff(place, axis=0)
    length = np.linalg.norm(chord, axis=1)
    slope = chord / length[:, None]
    turn = np.einsum("nk,nk->n", slope[1:], slope[:-1])
    if (turn < np.cos(SHARPEST_TURN)).any():
        raise BacktrackError(int(nodes[1 + np.argmax(turn < np.cos(SHARPEST_TURN))]))
    share = (length[:-1] / (length[:-1] + length[1:]))[:, None]
    inner = (1 - share) * slope[:-1] + share * slope[1:]
    first = 2 * slope[0] - inner[0] if len(inner) else slope[0]
    last = 2 * slope[-1] - inner[-1] if len(inner) else slope[-1]
    tangent = np.concatenate([[first], inner, [last]])
    for node in (0, -1):  # between samples far apart, the heading says more than the parabola
        if heading is not None and length[node] > FAR_NODES:
            angle = heading[nodes[node]]
            tangent[node] = np.cos(angle), np.sin(angle)
    dense, knot = _draw(place, tangent, length)
    along = arc_length(dense)
    count = max(2, int(np.ceil(along[-1] / PATH_STEP)) + 1)
    at = np.linspace(0.0, along[-1], count)
    points = sample_polyline(dense, along, at)
    drawn = arc_length(points)
    return FittedPath(points, _stations(samples, nodes, place, slope, length, np.interp(along[knot], at, drawn)))


def _nodes(samples: np.ndarray) -> np.ndarray:
    """Return the indices of the samples that the line goes through."""
    nodes = [0]
    x0, y0 = samples[0].tolist()
    for index, (x, y) in enumerate(samples.tolist()):
        if (x - x0) ** 2 + (y - y0) ** 2 >= NODE_STEP**2:
            nodes.append(index)
            x0, y0 = x, y
    return np.array(nodes)


def _draw(place: np.ndarray, tangent: np.ndarray, length: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return points of the Hermite pieces about 5 cm apart, and the row of every node."""
    pieces, knot = [place[:1]], [0]
    for index, size in enumerate(length.tolist()):
        count = max(2, int(np.ceil(size / (0.5 * PATH_STEP))))
        t = (np.arange(1, count + 1) / count)[:, None]
        a, b, u, v = place[index], place[index + 1], tangent[index] * size, tangent[index + 1] * size
        pieces.append(a + t * u + t**2 * (3 * (b - a) - 2 * u - v) + t**3 * (2 * (a - b) + u + v))
        knot.append(knot[-1] + count)
    return np.concatenate(pieces), np.array(knot)


def _stations(
    samples: np.ndarray, nodes: np.ndarray, place: np.ndarray, slope: np.ndarray, length: np.ndarray, at: np.ndarray
) -> np.ndarray:
    """Return how far along the line the samples are [m]; beyond the last node they go on straight."""
    owner = np.searchsorted(nodes, np.arange(len(samples)), side="right") - 1
    chord = np.minimum(owner, len(slope) - 1)
    ahead = np.einsum("nk,nk->n", samples - place[owner], slope[chord])
    room = np.append(length, np.inf)[owner]
    scale = np.append(np.diff(at) / length, 1.0)[owner]
    station = at[owner] + np.clip(ahead, 0.0, room) * scale
    return np.maximum.accumulate(station)


def fill_stations(time: np.ndarray, station: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return the distance at any time: monotone cubic pieces, so that a vehicle that stands does not move.

    Args:
        time: Times of the samples [s], shape [M], strictly rising, M >= 2.
        station: Distance at the samples [m], shape [M], never falling.
        at: Times to fill in [s], shape [F]; beyond the ends the acceleration stays as it is there.

    Returns:
        Distance [m], shape [F].

    Source: F. N. Fritsch, J. Butland, A method for constructing local monotone piecewise cubic interpolants, SIAM J.
    Sci. Stat. Comput. 5 (1984), 300-304: weighted harmonic means of the neighboring speeds.
    """
    step = np.diff(time)
    speed = np.diff(station) / step
    before, after = speed[:-1], speed[1:]
    w1, w2 = 2 * step[1:] + step[:-1], step[1:] + 2 * step[:-1]
    moves = (before > 0) & (after > 0)
    harmonic = (w1 + w2) / (w1 / np.where(moves, before, 1.0) + w2 / np.where(moves, after, 1.0))
    slope = np.concatenate([speed[:1], np.where(moves, harmonic, 0.0), speed[-1:]])
    piece = np.clip(np.searchsorted(time, at, side="right") - 1, 0, len(step) - 1)
    t = (np.clip(at, time[0], time[-1]) - time[piece]) / step[piece]
    a, b = station[piece], station[piece + 1]
    u, v = slope[piece] * step[piece], slope[piece + 1] * step[piece]
    fine = a + t * u + t**2 * (3 * (b - a) - 2 * u - v) + t**3 * (2 * (a - b) + u + v)
    early, late = at < time[0], at > time[-1]
    fine[early] -= _onward(time[0] - time, -station, time[0] - at[early])
    fine[late] += _onward(time[::-1] - time[-1], station[::-1], at[late] - time[-1])
    return fine


def _onward(time: np.ndarray, station: np.ndarray, after: np.ndarray) -> np.ndarray:
    """Return how far a vehicle goes beyond the end of its samples [m]: at the speed and acceleration that it has there.

    Args:
        time: Times of the samples relative to the end, from 0 into the past [s].
        station: Distance at the samples [m].
        after: Times after the end [s].
    """
    near = time >= -FIT_S
    if near.sum() < 4:
        near = np.arange(len(time)) < 2
        speed, acceleration = (station[0] - station[1]) / (time[0] - time[1]), 0.0
    else:
        columns = np.column_stack([np.ones(near.sum()), time[near], 0.5 * time[near] ** 2])
        _, speed, acceleration = np.linalg.lstsq(columns, station[near], rcond=None)[0]
    speed = max(float(speed), 0.0)
    acceleration = float(np.clip(acceleration, -FIT_MOST, FIT_MOST)) if speed > 0.0 else 0.0
    if acceleration < 0.0:  # until it stands
        after = np.minimum(after, -speed / acceleration)
    return speed * after + 0.5 * acceleration * after**2
