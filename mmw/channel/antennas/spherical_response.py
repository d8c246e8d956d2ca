"""Compute what arrays send and receive under the spherical waves of `wavefronts`."""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from mmw.channel.antennas.curved_waves import CurvedEnd
from mmw.channel.antennas.wavefronts import Wavefronts
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.physics.em.vectors import dot, unrotate

CHUNK = 1 << 17
"""Pairs of elements that are computed at once, so that they stay in the cache. Design value."""


@dataclass(frozen=True)
class ArrayEnd:
    """Elements of an array at one end of P paths."""

    offset: np.ndarray
    """Offsets of the elements from the phase center [m], device frame, shape [N, 3]."""
    turn: np.ndarray
    """Device-to-world rotation at each path, shape [P, 3, 3]."""

    @property
    def radius(self) -> float:
        """Largest distance of an element from the phase center [m]."""
        return float(np.sqrt((self.offset**2).sum(axis=1).max()))

    def take(self, rows: np.ndarray) -> "ArrayEnd":
        """Return those of some paths."""
        return ArrayEnd(self.offset, self.turn[rows])

    def along(self, direction: np.ndarray) -> np.ndarray:
        """Return the offsets along a direction of each path [m], shapes [P, 3] -> [P, N]."""
        return unrotate(self.turn, direction) @ self.offset.T


def spherical_response(
    element: np.ndarray, waves: Wavefronts, tx: ArrayEnd, rx: ArrayEnd, carrier_hz: float
) -> np.ndarray:
    """Return the coefficients of paths between all elements, without the carrier phase of the phase centers.

    Amplitudes fall with the length of the path as in free space: 1 / L, 1 / sqrt(s L) behind an edge at s, 1 / s behind
    a diffuse point. Those of both ends multiply, which is 1e-3 at most off where arrays are smaller than L / 10. Phases
    are float64; their cosines float32, 2e-7 at most off.

    Args:
        element: Coefficients between the polarizations of elements at the phase centers, shape [P, Q_r, Q_t].
        waves: Waves of the paths.
        tx: Array of the transmitters.
        rx: Array of the receivers.
        carrier_hz: Carrier [Hz].

    Returns:
        Shape [P, Q_r, N_r, Q_t, N_t], complex128.

    Raises:
        InputError: If rows of a path do not tell its waves.
    """
    waves.check()
    per_m = carrier_hz / SPEED_OF_LIGHT
    at_tx, at_rx = _end(waves, tx, "tx"), _end(waves, rx, "rx")
    count, (tx_count, rx_count) = len(element), (len(tx.offset), len(rx.offset))
    out = np.empty((count, element.shape[1], rx_count, element.shape[2], tx_count), dtype=np.complex128)
    is_apart = waves.is_point | (tx.radius == 0.0) | (rx.radius == 0.0)
    rows = np.flatnonzero(is_apart)
    if len(rows):
        of_tx, of_rx = (_phasors(per_m * end.more[rows], end.scale[rows]) for end in (at_tx, at_rx))
        own = element[rows][:, :, None, :, None] * of_rx[:, None, :, None, None]
        out[rows] = own * of_tx[:, None, None, None, :]
    coupled = np.flatnonzero(~is_apart)
    step = min(max(1, CHUNK // (tx_count * rx_count)), len(coupled))
    turns = np.empty((step, rx_count, tx_count))  # memory that is used again costs no page faults
    scale, scratch = np.empty(turns.shape, dtype=np.float32), Scratch.of(turns.shape)
    phasor = np.empty(turns.shape, dtype=np.complex128)
    for first in range(0, len(coupled), max(step, 1)):
        rows = coupled[first : first + step]
        some, now = slice(len(rows)), slice(first, first + len(rows))
        _coupled(waves.take(rows), *(end.take(rows) for end in (tx, rx, at_tx, at_rx)), per_m, turns[some])
        np.multiply(at_rx.scale[rows, :, None], at_tx.scale[rows, None, :], out=scale[some], casting="same_kind")
        back = element[rows] * np.exp(2j * np.pi * per_m * waves.length[rows])[:, None, None]
        own = out[now, 0, :, 0] if len(coupled) == count else phasor[some]
        scratch.phasor(turns[some], scale[some], own)
        for q, p in reversed(list(np.ndindex(*element.shape[1:]))):  # the first, which `own` may be, comes last
            if len(coupled) == count:
                np.multiply(own, back[:, q, p, None, None], out=out[now, q, :, p])
            else:
                out[rows, q, :, p] = own * back[:, q, p, None, None]
    return out


def transmit_phasors(waves: Wavefronts, tx: ArrayEnd, carrier_hz: float) -> np.ndarray:
    """Return the phasors of the transmitters' elements at single receiving antennas, shape [P, N_t], complex128.

    Args:
        waves: Waves of the paths.
        tx: Array of the transmitters.
        carrier_hz: Carrier [Hz].

    Raises:
        InputError: If rows of a path do not tell its waves.
    """
    waves.check()
    at_tx = _end(waves, tx, "tx")
    return _phasors(carrier_hz / SPEED_OF_LIGHT * at_tx.more, at_tx.scale)


@dataclass(frozen=True)
class _EndLengths:
    """Paths from the elements of one end to the phase center of the other."""

    more: np.ndarray
    """Length that is added to that between the phase centers [m], shape [P, N]."""
    scale: np.ndarray
    """Amplitude against that of the phase center, shape [P, N]."""
    couple: np.ndarray
    """Part of the vector whose length is that of the path, of elements at edges and curved surfaces: what couples them
    to those of the other end [m]; 0 for others, shape [P, N, 3]."""

    def take(self, rows: np.ndarray) -> "_EndLengths":
        return _EndLengths(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


def _end(waves: Wavefronts, end: ArrayEnd, side: Literal["tx", "rx"]) -> _EndLengths:
    """Return the paths from the elements of one end."""
    source, direction, axis = waves.tx_source, waves.departure, waves.tx_axis
    if side == "rx":
        source, direction, axis = waves.rx_source, waves.arrival, waves.rx_axis
    square, toward = (end.offset**2).sum(axis=1), end.along(direction)
    from_source = np.where(waves.is_point, source, waves.length)[:, None]
    change = square - 2.0 * from_source * toward
    couple = np.zeros((*change.shape, 3))
    rows = np.flatnonzero(waves.is_edge)
    if len(rows):
        cosine = dot(direction[rows], axis[rows])[:, None]
        sine = np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
        away, own = source[rows, None], end.take(rows).along(axis[rows])
        across = square - own**2 - 2.0 * away * (toward[rows] - cosine * own)
        more = _longer(away * sine, across)
        change[rows] = 2.0 * waves.length[rows, None] * (sine * more - cosine * own) + more**2 + own**2
        couple[rows, :, 0], couple[rows, :, 1] = more, own if side == "tx" else -own
    more = _longer(from_source, change)
    curved = np.flatnonzero(waves.is_curved)
    if len(curved):
        more[curved], couple[curved] = _curved(waves.take(curved), end.take(curved), side)
    scale = from_source / (from_source + more)
    if len(rows):
        scale[rows] = np.sqrt(scale[rows] * source[rows, None] / (source[rows, None] + more[rows]))
    return _EndLengths(more, scale, couple)


def _curved(waves: Wavefronts, end: ArrayEnd, side: Literal["tx", "rx"]) -> tuple[np.ndarray, np.ndarray]:
    """Return what elements of one end add to paths over curved surfaces [m], [P, N], and `couple`, [P, N, 3]."""
    ends = (waves.tx_source, waves.departure), (waves.rx_source, waves.arrival)
    (source, direction), (other, other_direction) = ends if side == "tx" else ends[::-1]
    surface = CurvedEnd(source, other, direction, other_direction, waves.curvature)
    offset = end.offset @ end.turn.swapaxes(1, 2)
    more, shifts = surface.longer(offset), surface.shifts(offset)
    if side == "rx":
        shifts = -np.linalg.solve(surface.hessian()[:, None], shifts[..., None])[..., 0]
        shifts *= waves.length[:, None, None]
    # |v + a + b| = L + f_t + f_r + c, c about -g_t H^-1 g_r (L + f_t) (L + f_r) / L^2
    shifts *= 1.0 + (more / waves.length[:, None])[..., None]
    return more, np.concatenate([more[..., None], shifts], axis=2)


def _coupled(
    waves: Wavefronts,
    tx: ArrayEnd,
    rx: ArrayEnd,
    at_tx: _EndLengths,
    at_rx: _EndLengths,
    per_m: float,
    out: np.ndarray,
) -> None:
    """Compute the length of paths between elements of both ends in wavelengths, shape [P, N_r, N_t].

    The length is that of a vector v + a + b with parts of both ends, whose square is |v + a|^2 + |v + b|^2 - |v|^2
    + 2 a . b: a product of matrices with five columns.

    Args:
        waves: Waves of the paths.
        tx: Array of the transmitters.
        rx: Array of the receivers.
        at_tx: Paths from its elements to the receivers' phase centers.
        at_rx: The same for the receivers.
        per_m: Wavelengths in a meter.
        out: The lengths.
    """
    one, two = np.ones((*at_rx.more.shape, 5)), np.ones((*at_tx.more.shape, 5))
    turned = tx.turn.swapaxes(1, 2) @ waves.mirror.swapaxes(1, 2) @ rx.turn  # offsets of rx in the axes of tx
    one[..., :3], two[..., :3] = -(rx.offset @ turned.swapaxes(1, 2)), tx.offset
    rows = np.flatnonzero(waves.is_edge | waves.is_curved)
    one[rows, :, :3], two[rows, :, :3] = at_rx.couple[rows], at_tx.couple[rows]
    length = waves.length[:, None]
    one[..., :3] *= 2.0
    one[..., 3] = at_rx.more * (2.0 * length + at_rx.more)
    two[..., 4] = (length + at_tx.more) ** 2
    one *= per_m**2
    np.matmul(one, two.swapaxes(1, 2), out=out)
    np.sqrt(out, out=out)


def _longer(length: np.ndarray, change: np.ndarray) -> np.ndarray:
    """Return sqrt(length^2 + change) - length without a difference of lengths."""
    return change / (length + np.sqrt(np.maximum(length**2 + change, 0.0)))


@dataclass(frozen=True)
class Scratch:
    """Memory for phasors, which is used again."""

    whole: np.ndarray
    angle: np.ndarray
    part: np.ndarray

    @classmethod
    def of(cls, shape: tuple[int, ...]) -> "Scratch":
        """Return memory for phasors of a shape."""
        return cls(np.empty(shape), *(np.empty(shape, dtype=np.float32) for _ in range(2)))

    def phasor(self, turns: np.ndarray, scale: np.ndarray, out: np.ndarray) -> None:
        """Compute scale exp(-2 pi j turns) with float32 cosines.

        Args:
            turns: Phases [turns], float64, shape [n, ...] with n rows at most.
            scale: Amplitudes, the same shape.
            out: The phasors, complex128.
        """
        whole, angle, part = (memory[: len(turns)] for memory in (self.whole, self.angle, self.part))
        np.rint(turns, out=whole)
        np.subtract(turns, whole, out=angle, casting="same_kind")
        np.multiply(angle, np.float32(-2.0 * np.pi), out=angle)
        np.multiply(np.cos(angle, out=part), scale, out=out.real)
        np.multiply(np.sin(angle, out=part), scale, out=out.imag)


def _phasors(turns: np.ndarray, scale: np.ndarray) -> np.ndarray:
    """Return scale exp(-2 pi j turns), complex128, see `Scratch.phasor`."""
    out = np.empty(turns.shape, dtype=np.complex128)
    Scratch.of(turns.shape).phasor(turns, scale, out)
    return out
