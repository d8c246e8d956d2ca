"""Keep what the rays of transmitters at rest hit of the town, which stays as it is from frame to frame."""

from collections import Counter
from collections.abc import Callable, Hashable, Sequence, Set
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import warp as wp

from mmw.kernels.channel.ray_launch import TownHits

KEPT_BYTES = {"cuda": 1 << 28, "cpu": 1 << 27}
"""Most memory of the kept hits of one number of rays and depth [bytes]: 24 MB are the 10^6 rays of a transmitter at
depth 3. Design value."""

MIN_RAYS = 1 << 12
"""Fewest rays of a transmitter that are worth to be kept. Design value."""

MAX_SOURCES = 1 << 12
"""Most transmitters of a search whose places are compared. Design value."""

MAX_ROWS = 256
"""Most combinations of rows that are kept on the device. Design value."""

Rows = tuple[int, ...]
"""Row of the kept hits of each transmitter, -1 for one without; empty if none has any."""


@dataclass
class KeptHits:
    """Hits of the town by the rays of some transmitters, for one number of rays and depth.

    Attributes:
        device: Warp device.
        threads: Threads of a transmitter in a launch.
        depth: Surfaces that a ray follows.
    """

    device: str
    threads: int
    depth: int
    _row: dict[bytes, int] = field(default_factory=dict)
    """Place of a transmitter -> its row."""
    _last: frozenset[bytes] = frozenset()
    """Places of the search before."""
    _known: tuple[bytes, Rows] | None = None
    """Places of a search all of which have rows, and these."""
    _capacity: int = 0
    _on_device: dict[Rows, wp.array] = field(default_factory=dict)
    """Rows that were asked for, on the device."""
    _version: int = 0
    """Number of times that arrays were replaced, which records of launches must not outlive."""

    @cached_property
    def _most(self) -> int:
        kind = "cuda" if wp.get_device(self.device).is_cuda else "cpu"
        return KEPT_BYTES[kind] // (8 * self.threads * self.depth)

    def prepare(self, origins: np.ndarray, fill: Callable[[np.ndarray, TownHits], None]) -> Rows:
        """Return the rows of transmitters, after rows for those were filled that are where one was before.

        Args:
            origins: Where their rays start, scene frame [m], float32, shape [A, 3].
            fill: Launches the rays from some origins, shape [n, 3], on hits with a row for each.
        """
        if self._known is not None and self._known[0] == origins.tobytes():
            return self._known[1]
        places = [place.tobytes() for place in origins]
        if len(self._on_device) > MAX_ROWS:
            self._on_device.clear()
            self._version += 1
        known, here = self._row, Counter(places)
        new = [place for place, count in here.items() if place not in known and (count > 1 or place in self._last)]
        self._last = frozenset(here)
        if new:
            self._known = None
            self._make_room(len(new), here.keys())
            new = new[: self._most - len(known)]
        if new:
            free = sorted(set(range(self._capacity)) - set(known.values()))[: len(new)]
            fill(np.frombuffer(b"".join(new), dtype=np.float32).reshape(-1, 3), self._hits(tuple(free), False))
            known.update(zip(new, free, strict=True))
        rows = self.rows(places)
        if rows and min(rows) >= 0:
            self._known = origins.tobytes(), rows
        return rows

    def rows(self, places: Sequence[bytes]) -> Rows:
        """Return the rows of places, which are three coordinates in float32 each."""
        rows = tuple(self._row.get(place, -1) for place in places)
        return rows if max(rows, default=-1) >= 0 else ()

    def hits(self, rows: Rows) -> TownHits:
        """Return the argument of the kernel for transmitters of these rows."""
        return self._hits(rows, True)

    def key(self, rows: Rows) -> Hashable:
        """Return what tells apart the arguments for rows."""
        return (rows, self._version) if rows else ()

    def _hits(self, rows: Rows, is_filled: bool) -> TownHits:
        hits = TownHits()
        if rows not in self._on_device:
            self._on_device[rows] = wp.array(rows, dtype=wp.int32, device=self.device)
        hits.row = self._on_device[rows]
        hits.face, hits.t, hits.is_filled = self._face, self._t, is_filled
        return hits

    def _make_room(self, count: int, here: Set[bytes]) -> None:
        """Have rows for some more places, as far as memory goes; what is not here gives way where it ends."""
        known = self._row
        if len(known) + count > self._most:
            for place in known.keys() - here:
                del known[place]
        needed = min(len(known) + count, self._most)
        if needed > self._capacity:
            shape = needed, self.depth, self.threads
            face, t = (wp.empty(shape, dtype=kind, device=self.device) for kind in (wp.int32, wp.float32))
            if self._capacity:
                wp.copy(face[: self._capacity], self._face)
                wp.copy(t[: self._capacity], self._t)
            self._face, self._t, self._capacity = face, t, needed
            self._version += 1
