"""Keep the motion of bodies along their paths within limits of acceleration and jerk, a moment after SUMO.

SUMO changes the speed of a vehicle by what its driver wants, at once: it brakes with 6 m/s^2 for one that cuts in, and
obeys the limit of every meter of road. A recorded drive is smoothed with a Gaussian wide enough for the worst moment of
a vehicle, up to 0.6 s; live, that would be 3 s of delay for all. So a body goes where SUMO has it as long as that is
smooth. Where it is not, within the next `LEAD_ROWS`, it goes along the same path at a pace of its own: it brakes before
SUMO's vehicle does, and a little behind or ahead of it until both are at one place again.

The pace is that of a linear-quadratic tracker of a triple integrator with preview: weights for a triple pole -p, whose
kernel (p^2 / (p^2 + w^2))^3 in frequency is positive, so that it does not swing beyond what it follows. Its jerk and
acceleration are cut at the limits, which widen where a body would get too far ahead of SUMO's vehicle: safety counts
more than smoothness. One that SUMO brakes with 6 m/s^2 to a stop stands up to 1 m ahead of it; SUMO keeps 2 m.

Source: linear-quadratic tracking with preview of the disturbance, B. D. O. Anderson, J. B. Moore, Optimal Control:
Linear Quadratic Methods, 1990, chapter 4.
"""

from functools import cache

import numpy as np

from mmw.core.constants import FRAME_DT
from mmw.traffic.idm.driver import ACCELERATION, HARDEST_BRAKING

LEAD_ROWS = 25
"""Rows at 100 Hz that a body's motion is known ahead of the row that is made."""

POLE = 2.5
"""Triple pole of the tracker [1/s]; the standard deviation of its kernel is sqrt(6) / p, 1 s. Design value."""

JERK_LIMIT = 5.2
"""Largest jerk along the path [m/s^3]: with 3 m/s^3 aside the 6 that recorded traffic has; controls stay below."""

DECELERATION_LIMIT = 2.5
"""Largest deceleration of a vehicle that nobody controls [m/s^2]: recorded traffic of SUMO has up to 2.6."""

SURPLUS_M, SURPLUS_M_S = 0.3, 1.2
"""A body that is farther than this ahead of SUMO's vehicle [m], or will be faster than it by more than this at the end
of what is known if it keeps to the limits [m/s], may brake harder. One that cuts in makes SUMO brake for a moment, with
a surplus of about 1 m/s; a braking that lasts must be followed. Design values."""

WIDER_BRAKING, WIDER_JERK = 10.0, 60.0
"""How much harder and sooner, for every meter and meter a second beyond [m/s^2, m/s^3]. Design values."""

MAX_BRAKING, MAX_JERK = 7.0, 30.0
"""Limits that are not widened [m/s^2, m/s^3]: to catch up with SUMO's 6 m/s^2, on a dry road. Design values."""

BEHIND_M, WIDER_ACCELERATION = 0.15, 2.0
"""A body that is farther than this behind SUMO's vehicle [m] may accelerate more, by so much a meter [m/s^2]."""

FADE_M = 4.0
"""Way on which a body that stood beyond the known path comes back to it [m]. Design value."""

HELD_ROWS = 512
"""Rows of paths that are held at first; a body that is far behind holds more."""

NEWTON_STEPS = 6
"""Steps in which the row of a station is found; rows are nearly equally far apart, so that three would do."""

SAME_PLACE = 1e-9
"""Distances below this are none [m]: two differences of them are 1e-5 m/s^2."""


@cache
def _tracker() -> tuple[np.ndarray, np.ndarray]:
    """Return gains of the state (distance ahead, its rate, that of the row before's acceleration) and of the preview.

    The weights of the cost are those whose spectral factor is (s + p)^3: p^6 e^2 + 3 p^4 e'^2 + 3 p^2 e''^2 + jerk^2.
    """
    dt, p = FRAME_DT, POLE
    # a' = a + dt u, d' = d + dt a', e' = e + dt d': the places that three differences give back exactly
    step = np.array([[1.0, dt, dt**2], [0.0, 1.0, dt], [0.0, 0.0, 1.0]])
    push = np.array([dt**3, dt**2, dt])
    weight = np.diag([p**6, 3 * p**4, 3 * p**2])
    cost, gain, before = weight, np.zeros(3), np.ones(3)
    while np.abs(gain - before).max() > 1e-12 * np.abs(gain).max():
        before, share = gain, 1.0 / (1.0 + push @ cost @ push)
        gain = share * (push @ cost @ step)
        cost = weight + step.T @ cost @ (step - np.outer(push, gain))
    closed, share = step - np.outer(push, gain), 1.0 / (1.0 + push @ cost @ push)
    preview, vector = np.zeros(LEAD_ROWS), cost @ push
    for row in range(LEAD_ROWS):
        preview[row] = share * (push @ vector)
        vector = closed.T @ vector
    return gain, preview


class MotionLimits:
    """Limits of the bodies of a simulation, row by row.

    Attributes:
        hardest: Deceleration of every vehicle that is within the limits [m/s^2], shape [V].
        fastest: Acceleration of every vehicle that is within the limits [m/s^2], shape [V].
    """

    def __init__(self, count: int) -> None:
        """Take `count` bodies; nothing is known of them yet."""
        self.hardest = np.full(count, DECELERATION_LIMIT)
        self.fastest = np.full(count, ACCELERATION)
        self._path = np.zeros((HELD_ROWS, count, 0))
        self._station = np.zeros((HELD_ROWS, count))
        self._count = 0
        """Rows of both that are known."""
        self._own = np.zeros(count, dtype=bool)
        """Bodies that go at a pace of their own; the following is theirs, in the present row."""
        self._place, self._before, self._acceleration = np.zeros((3, count))
        """Station in this row and in the one before [m], acceleration in the one before [m/s^2]."""
        self._row = np.zeros(count, dtype=np.int64)
        """Last row of the path that is not beyond the place."""
        self._calm = np.zeros(count, dtype=np.int64)
        """Rows since the motion that is known was beyond the limits."""
        self._beyond = np.zeros(count, dtype=bool)
        """Bodies that are farther than the path is known: SUMO stops harder than they may."""
        self._aside, self._since = np.zeros((count, 0)), np.full(count, -np.inf)
        """Distance of such a body from the path when that became known, and its station then [m]."""

    def lift(self, body: int) -> None:
        """Allow a vehicle all that a control may ask for, from now on."""
        self.hardest[body] = self.fastest[body] = HARDEST_BRAKING

    def take(self, columns: np.ndarray) -> np.ndarray | None:
        """Take what SUMO makes of the bodies in one more row.

        Args:
            columns: Middle x, y, heading, height [m, m, rad, m], slopes forward and to the left, shape [V, 6].

        Returns:
            The same for the row `LEAD_ROWS` before, within the limits, shape [V, 6]; None for the first rows, of which
            too little is known.
        """
        self._know(columns)
        now = self._count - 1 - LEAD_ROWS
        if now < 2:
            return None
        is_rough = self._is_rough()
        self._calm = np.where(is_rough, 0, self._calm + 1)
        begins = is_rough & ~self._own
        if begins.any():
            s0, s1, s2 = self._station[now - 2 : now + 1, begins]
            self._place[begins], self._before[begins], self._row[begins] = s2, s1, now
            self._acceleration[begins] = (s2 - 2 * s1 + s0) / FRAME_DT**2
            self._own |= begins
        if not self._own.any():
            return self._path[now].copy()
        out, some = self._path[now].copy(), np.flatnonzero(self._own)
        out[some] = self._at(some)
        self._advance(some, now)
        apart = np.abs(np.stack([self._before, self._place]) - self._station[now : now + 2])
        self._own &= (self._calm <= LEAD_ROWS + 3) | (apart.max(axis=0) > SAME_PLACE)
        return out

    def _know(self, columns: np.ndarray) -> None:
        """Add a row of the paths."""
        if self._count == 0:
            self._path, self._aside = np.zeros((HELD_ROWS, *columns.shape)), np.zeros_like(columns)
        if self._count == len(self._path):
            needed = min(self._count - LEAD_ROWS, int(self._row[self._own].min(initial=self._count))) - 3
            room = np.zeros_like(self._path[: self._count - needed if needed < HELD_ROWS // 2 else 0])
            self._path = np.concatenate([self._path[needed:], room, np.zeros_like(self._path[:needed])])
            self._station = np.concatenate(
                [self._station[needed:], room[..., 0], np.zeros_like(self._station[:needed])]
            )
            self._count, self._row = self._count - needed, self._row - needed
        before = max(self._count - 1, 0)
        self._path[self._count] = columns
        way = np.hypot(*(self._path[self._count] - self._path[before])[:, :2].T)
        self._station[self._count] = self._station[before] + way
        self._count += 1

    def _is_rough(self) -> np.ndarray:
        """Return whether the last row that is known ends a motion beyond the limits, shape [V]."""
        s0, s1, s2, s3 = self._station[self._count - 4 : self._count]
        acceleration = (s3 - 2 * s2 + s1) / FRAME_DT**2
        jerk = (s3 - 3 * s2 + 3 * s1 - s0) / FRAME_DT**3
        is_hard = (acceleration < -self.hardest) | (acceleration > self.fastest)
        return is_hard | (np.abs(jerk) > JERK_LIMIT)

    def _advance(self, some: np.ndarray, now: int) -> None:
        """Move some bodies on by a row, along their paths."""
        gain, preview = _tracker()
        hardest, place, last = self.hardest[some], self._place[some], self._acceleration[some]
        known = self._station[now - 2 : self._count, some]
        sumo = np.diff(known, n=2, axis=0) / FRAME_DT**2
        speed = (place - self._before[some]) / FRAME_DT
        ahead = place - known[2]
        state = np.stack([ahead, speed - (known[2] - known[1]) / FRAME_DT, last - sumo[0]])
        jerk = preview @ (np.diff(sumo, axis=0) / FRAME_DT) - gain @ state
        beyond = np.maximum(ahead - SURPLUS_M, 0.0) + _surplus(known, speed, last, hardest)
        most = np.minimum(JERK_LIMIT + WIDER_JERK * beyond, MAX_JERK)
        lowest = -np.minimum(hardest + WIDER_BRAKING * beyond, MAX_BRAKING)
        # sqrt(2 j v): the jerk j ends a stop without a jump
        lowest = np.maximum(lowest, -np.sqrt(2 * np.minimum(most, 2 * JERK_LIMIT) * np.maximum(speed, 0.0)))
        highest = self.fastest[some] + WIDER_ACCELERATION * np.maximum(-ahead - BEHIND_M, 0.0)
        wanted = np.clip(last + np.clip(jerk, -most, most) * FRAME_DT, lowest, highest)
        wanted = np.clip(wanted, last - most * FRAME_DT, last + most * FRAME_DT)
        after = np.maximum(place + (speed + wanted * FRAME_DT) * FRAME_DT, place)
        self._acceleration[some] = ((after - place) / FRAME_DT - speed) / FRAME_DT
        self._before[some], self._place[some] = place, after

    def _at(self, some: np.ndarray) -> np.ndarray:
        """Return the columns of some bodies at their places, shape [N, 6]: on the cubic through four rows."""
        place, row = self._place[some], self._row[some]
        last = self._count - 3
        while (on := (row < last) & (self._station[row + 1, some] <= place)).any():
            row = row + on
        self._row[some] = row
        rows = row + np.arange(-1, 3)[:, None]
        station = self._station[rows, some]
        low, step = station[1], station[2] - station[1]
        wanted, moves = place - low, step > 0.0
        share = np.clip(np.where(moves, wanted / np.where(moves, step, 1.0), wanted > 0.0), 0.0, 1.0)
        for _ in range(NEWTON_STEPS):
            weights, slopes = _cubic(share)
            slope = np.sum(slopes * (station - low), axis=0)
            miss = np.sum(weights * (station - low), axis=0) - wanted
            share = np.clip(share - np.where(slope > 0.0, miss / np.where(slope > 0.0, slope, 1.0), 0.0), 0.0, 1.0)
        weights, _ = _cubic(share)
        path = self._path[rows, some]
        out = path[1] + np.sum(weights[..., None] * (path - path[1]), axis=0)
        return self._off_path(some, out)

    def _off_path(self, some: np.ndarray, columns: np.ndarray) -> np.ndarray:
        """Return columns of some bodies, which go straight on beyond the known path and come back to it gently."""
        top, place = self._count - 2, self._place[some]  # four rows make a cubic between the two in the middle
        is_beyond = place > self._station[top, some]
        back = self._beyond[some] & ~is_beyond
        if back.any():
            who = some[back]
            self._aside[who] = self._straight(top - 1, who) - columns[back]
            self._since[who] = place[back]
        self._beyond[some] = is_beyond
        t = np.clip((place - self._since[some]) / FADE_M, 0.0, 1.0)
        out = columns + ((1 - t) ** 3 * (1 + 3 * t + 6 * t**2))[:, None] * self._aside[some]
        out[is_beyond] = self._straight(top, some[is_beyond])
        return out

    def _straight(self, row: int, some: np.ndarray) -> np.ndarray:
        """Return the columns of some bodies on the straight line from a row of their paths, shape [N, 6]."""
        last = self._path[row, some]
        change = np.zeros_like(last)
        change[:, 0], change[:, 1], change[:, 3] = np.cos(last[:, 2]), np.sin(last[:, 2]), last[:, 4]
        return last + (self._place[some] - self._station[row, some])[:, None] * change


def _surplus(known: np.ndarray, speed: np.ndarray, last: np.ndarray, hardest: np.ndarray) -> np.ndarray:
    """Return by how much too fast bodies are at the end of what is known if they brake within the limits, shape [V].

    Args:
        known: Stations of SUMO's vehicles, shape [N, V] [m].
        speed: Speeds of the bodies now, shape [V] [m/s].
        last: Their accelerations, shape [V] [m/s^2].
        hardest: Limits of their decelerations, shape [V] [m/s^2].
    """
    rest = LEAD_ROWS * FRAME_DT
    until = np.clip((last + hardest) / JERK_LIMIT, 0.0, rest)
    end = speed + last * until - 0.5 * JERK_LIMIT * until**2 - hardest * (rest - until)
    return np.maximum(np.maximum(end, 0.0) - (known[-1] - known[-2]) / FRAME_DT - SURPLUS_M_S, 0.0)


def _cubic(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return weights of four values, one a row from -1 on, of their cubic at `t` from 0 to 1, and of its slope."""
    weights = -t * (t - 1) * (t - 2) / 6, (t + 1) * (t - 1) * (t - 2) / 2, -(t + 1) * t * (t - 2) / 2, (t**3 - t) / 6
    slopes = -(3 * t**2 - 6 * t + 2) / 6, (3 * t**2 - 4 * t - 1) / 2, -(3 * t**2 - 2 * t - 2) / 2, (3 * t**2 - 1) / 6
    return np.stack(weights), np.stack(slopes)
