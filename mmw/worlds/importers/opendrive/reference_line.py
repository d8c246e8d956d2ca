"""The reference line of an OpenDRIVE road in plan: lines, arcs, spirals and parametric cubics."""

import xml.etree.ElementTree as ElementTree
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mmw.core.errors import InputError
from mmw.worlds.importers.opendrive import limits
from mmw.worlds.importers.opendrive.limits import number
from mmw.worlds.importers.opendrive.records import RoadRecord

NODES, WEIGHTS = np.polynomial.legendre.leggauss(10)
CELL = 0.5
"""Length of the cells over which the arc length of a parametric curve is integrated [m]; design value."""
BLOCK = 1_000_000
"""Tangents of a spiral that are in memory at a time."""

Curve = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Arc length from the start of a piece [N] -> local position [N, 2] and local heading [N]."""


@dataclass(frozen=True)
class Piece:
    """One element of a planView."""

    station: float
    origin: np.ndarray
    heading: float
    length: float
    curve: Curve


@dataclass(frozen=True)
class ReferenceLine:
    """A reference line."""

    pieces: tuple[Piece, ...]

    def at(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return positions [m], shape [N, 2], and headings [rad], shape [N], at stations `s` [m], shape [N]."""
        s = np.asarray(s, float)
        starts = np.array([piece.station for piece in self.pieces])
        which = np.clip(np.searchsorted(starts, s, side="right") - 1, 0, len(starts) - 1)
        xy, heading = np.empty((len(s), 2)), np.empty(len(s))
        for k in np.unique(which):
            piece, mask = self.pieces[k], which == k
            local, turn = piece.curve(s[mask] - piece.station)
            cos, sin = np.cos(piece.heading), np.sin(piece.heading)
            xy[mask] = piece.origin + local @ np.array([[cos, sin], [-sin, cos]])
            heading[mask] = piece.heading + turn
        return xy, heading

    def jumps(self) -> list[tuple[float, float]]:
        """Return station [m] and size [m] of every gap between the end of a piece and the start of the next."""
        found = []
        for piece, following in zip(self.pieces, self.pieces[1:], strict=False):
            local, _ = piece.curve(np.array([following.station - piece.station]))
            cos, sin = np.cos(piece.heading), np.sin(piece.heading)
            end = piece.origin + local[0] @ np.array([[cos, sin], [-sin, cos]])
            found.append((following.station, float(np.linalg.norm(end - following.origin))))
        return found


def make_line(road: RoadRecord, where: str, file_origin: np.ndarray) -> ReferenceLine:
    """Return the reference line of a road.

    Args:
        road: The road.
        where: File and road, for messages.
        file_origin: Point of the file that becomes the origin [m], shape [2].

    Raises:
        InputError: If a piece has no known geometry, or one without the attributes that it needs.
    """
    pieces = []
    for element in road.geometry:
        length = number(element, "length", where, limits=limits.STATION)
        if length <= 1e-9:
            continue
        station = number(element, "s", where, limits=limits.STATION)
        origin = np.array([number(element, axis, where, limits=limits.PLACE) for axis in "xy"]) - file_origin
        shapes = [child for child in element if child.tag in SHAPES]
        if not shapes:
            found = ", ".join(f"<{child.tag}>" for child in element) or "nothing"
            raise InputError(
                f"{where}: geometry at s = {station:g} holds {found}; one of {', '.join(SHAPES)} is needed; "
                "export the road with these"
            )
        curve = SHAPES[shapes[0].tag](shapes[0], length, where)
        pieces.append(Piece(station, origin, number(element, "hdg", where, limits=limits.HEADING), length, curve))
    if not pieces:
        raise InputError(f"{where}: every geometry has length 0; a road with a length is needed; correct the file")
    pieces.sort(key=lambda piece: piece.station)
    for piece, end in zip(pieces, [*(piece.station for piece in pieces[1:]), road.length], strict=True):
        missing = end - piece.station - piece.length
        if missing > limits.MAX_GAP:
            raise InputError(
                f"{where}: geometry at s = {piece.station:g} has length {piece.length:g}, and the road goes on at s = "
                f"{end:g}; at most {limits.MAX_GAP:g} m may be missing; correct the length of the geometry or the road"
            )
    return ReferenceLine(tuple(pieces))


def _line(element: ElementTree.Element, length: float, where: str) -> Curve:
    return lambda s: (np.column_stack([s, np.zeros_like(s)]), np.zeros_like(s))


def _arc(element: ElementTree.Element, length: float, where: str) -> Curve:
    kappa = _curvature(element, "curvature", length, where)

    def curve(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        half = 0.5 * kappa * s
        chord = s * np.sinc(half / np.pi)  # the chord of an arc is 2 sin(angle / 2) / curvature
        return np.column_stack([chord * np.cos(half), chord * np.sin(half)]), 2 * half

    return curve


def _curvature(element: ElementTree.Element, name: str, length: float, where: str) -> float:
    kappa = number(element, name, where, limits=limits.CURVATURE)
    if abs(kappa) * length > limits.MAX_TURN:
        raise InputError(
            f"{where}: <{element.tag}> attribute {name} is {kappa:g} over {length:g} m, {abs(kappa) * length:.4g} rad; "
            f"at most {limits.MAX_TURN:g} rad are read; correct the curvature or the length"
        )
    return kappa


def _spiral(element: ElementTree.Element, length: float, where: str) -> Curve:
    """Clothoid: curvature linear in arc length, position by Gauss-Legendre quadrature of the tangent.

    Source: Abramowitz and Stegun, section 25.4.30; ten nodes on cells of at most half a radian leave less than 1e-12.
    """
    first, last = (_curvature(element, name, length, where) for name in ("curvStart", "curvEnd"))
    rate = (last - first) / length

    def curve(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        cells = 1 + int(2 * max(abs(first), abs(last)) * max(length, float(np.max(np.abs(s), initial=0.0))))
        node = ((np.arange(cells)[:, None] + 0.5 * (NODES + 1)) / cells).ravel()
        weight = np.tile(0.5 * WEIGHTS / cells, cells)
        xy = np.zeros((len(s), 2))
        for k in range(0, len(s), block := max(1, BLOCK // len(node))):
            at = s[k : k + block, None] * node
            angle = at * (first + 0.5 * rate * at)
            xy[k : k + block] = np.stack([np.cos(angle) @ weight, np.sin(angle) @ weight], axis=1)
        return xy * s[:, None], s * (first + 0.5 * rate * s)

    return curve


def _poly3(element: ElementTree.Element, length: float, where: str) -> Curve:
    v = np.array([number(element, key, where) for key in "abcd"])
    return _parametric(np.array([0.0, 1.0, 0.0, 0.0]), v, length, length, is_whole=False)


def _param_poly3(element: ElementTree.Element, length: float, where: str) -> Curve:
    u, v = (np.array([number(element, key + axis, where) for key in "abcd"]) for axis in "UV")
    span = element.get("pRange", "normalized")
    if span not in ("arcLength", "normalized"):
        raise InputError(f"{where}: paramPoly3 pRange {span!r}; arcLength or normalized is needed; correct the file")
    return _parametric(u, v, length if span == "arcLength" else 1.0, length, is_whole=True)


def _parametric(u: np.ndarray, v: np.ndarray, last: float, length: float, *, is_whole: bool) -> Curve:
    """Return the curve (u(p), v(p)), p from 0 to `last`, by arc length."""
    powers = np.arange(4)
    du, dv = u[1:] * powers[1:], v[1:] * powers[1:]

    def tangent(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        q = p[..., None] ** powers[:3]
        return q @ du, q @ dv

    cells = 1 + int(np.ceil(length / CELL))
    borders = np.linspace(0.0, last, cells + 1)
    node = borders[:-1, None] + 0.5 * (NODES + 1) * (last / cells)
    speed = np.hypot(*tangent(node))
    arc = np.concatenate([[0.0], np.cumsum(speed @ WEIGHTS * 0.5 * last / cells)])
    scale = arc[-1] / length if is_whole else 1.0

    def curve(s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        wanted = s * scale
        cell = np.clip(np.searchsorted(arc, wanted, side="right") - 1, 0, cells - 1)
        start = borders[cell]
        p = start + (wanted - arc[cell]) / np.maximum(arc[cell + 1] - arc[cell], 1e-12) * (last / cells)
        for _ in range(4):  # Newton: the derivative of arc length is the speed
            half = 0.5 * (p - start)
            nodes = start[:, None] + half[:, None] * (NODES + 1)
            error = arc[cell] + np.hypot(*tangent(nodes)) @ WEIGHTS * half - wanted
            p = p - error / np.maximum(np.hypot(*tangent(p)), 1e-9)
        q = p[:, None] ** powers
        direction = tangent(p)
        return np.stack([q @ u, q @ v], axis=1), np.arctan2(direction[1], direction[0])

    return curve


SHAPES: dict[str, Callable[[ElementTree.Element, float, str], Curve]] = {
    "line": _line, "arc": _arc, "spiral": _spiral, "poly3": _poly3, "paramPoly3": _param_poly3,
}  # fmt: skip
"""Geometry element -> maker of its curve."""
