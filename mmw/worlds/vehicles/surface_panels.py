"""Panels on the skin of a vehicle: lamps, grilles, number plates, lettering, wipers, seams.

A panel is a closed plate whose front follows the skin a few millimeters before it and whose back is a point inside the
body, so that it needs no cut in the skin.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

from mmw.core.errors import InputError
from mmw.worlds.vehicles.primitives import Shape, quads, weld

Side = Literal["front", "rear", "left", "right", "top"]

BACK_SHARE = 0.3
"""Depth of the point behind a panel below the middle of its edge, as a share of the panel's length; deep enough that
the walls to it stay behind the face of a curved panel."""

FAR_M = 20.0
"""Distance from which rays to the skin start [m]: outside every vehicle."""


@dataclass(frozen=True)
class Panel:
    """One panel, a quadrilateral seen from one side of the vehicle. Lengths in meters, in the body frame."""

    side: Side
    """Viewing direction."""
    corners: tuple[tuple[float, float], ...]
    """Four corners around, the first two along its foot: (y, z) at front and rear, (x, z) at left and right, (x, y)
    from the top."""
    part: str
    rise: float = 0.004
    """Height of its corners above the skin, along the direction that it is seen in; more where the skin bends between
    them, so that no part of the face lies lower than half of it."""
    round: float = 0.0
    """Radius of its corners."""
    cells: tuple[int, int] = (1, 1)
    """Facets along the foot and upward, without those of the corners."""
    mirror: bool = False
    """True for a second one at -y."""
    wrap: tuple[float, float] | None = None
    """For front and rear: from this y on, `y` runs on around a corner of this radius."""
    picture: tuple[float, float, float, float] | None = None
    """Texture coordinates of lower left and upper right corner, as it is seen."""


def build_panel(panel: Panel, skin: Shape) -> Shape:
    """Return a panel on a skin: closed, turned outward.

    Raises:
        InputError: If a point of the panel lies beyond the skin.
    """
    s, t = _lattice(panel)
    a, b, c, d = (np.array(corner) for corner in panel.corners)
    at = (1 - t)[..., None] * ((1 - s)[..., None] * a + s[..., None] * b)
    at += t[..., None] * ((1 - s)[..., None] * d + s[..., None] * c)
    on, away = _on_skin(panel, at, skin)
    front = on + max(panel.rise, 0.5 * panel.rise + _bulge(panel, at, on, skin)) * away
    outward = np.cross(front[-1, 0] - front[0, 0], front[0, -1] - front[0, 0])
    if outward @ away.mean(axis=(0, 1)) < 0.0:
        front, s, t, at = (grid[::-1] for grid in (front, s, t, at))
    face = quads(front, lambda _, __: panel.part)
    loop = _loop(*s.shape)
    edge = face.points[loop[:-1]]
    back = edge.mean(axis=0) - BACK_SHARE * float(np.ptp(edge, axis=0).max()) * away.mean(axis=(0, 1))
    apex = np.full(len(loop) - 1, len(face.points))
    faces = np.concatenate([face.faces, np.stack([loop[1:], loop[:-1], apex], axis=1)])
    st = np.zeros((len(faces), 3, 2))
    if panel.picture:
        st[: len(face.faces)] = _picture(panel, s, t, at)[face.faces]
    return weld(Shape(np.vstack([face.points, back]), faces, np.full(len(faces), panel.part), st))


def _on_skin(panel: Panel, at: np.ndarray, skin: Shape) -> tuple[np.ndarray, np.ndarray]:
    """Return points of the panel's plane put on the skin, and the direction away from it, shape [A, B, 3] each."""
    start, away = _rays(panel, at.reshape(-1, 2), skin)
    depth = cast(skin, start, -away)
    if not np.isfinite(depth).all():
        raise InputError(
            f"panel {panel.part} at the {panel.side}, corners {panel.corners}: {np.isinf(depth).sum()} points beyond "
            "the skin; needed is a panel on the skin; move its corners"
        )
    return (start - depth[:, None] * away).reshape(*at.shape[:2], 3), away.reshape(*at.shape[:2], 3)


def _bulge(panel: Panel, at: np.ndarray, on: np.ndarray, skin: Shape) -> float:
    """Return how far the skin protrudes before the facets that join points on it, at most [m]."""
    most = 0.0
    for u, v in ((0.5, 0.5), (0.5, 0.02), (0.5, 0.98), (0.02, 0.5), (0.98, 0.5), (0.25, 0.25), (0.75, 0.75),
                 (0.25, 0.75), (0.75, 0.25)):  # fmt: skip
        weights = ((1 - u) * (1 - v), u * (1 - v), u * v, (1 - u) * v)

        def blend(grid: np.ndarray, weights: tuple[float, ...] = weights) -> np.ndarray:
            four = (grid[:-1, :-1], grid[1:, :-1], grid[1:, 1:], grid[:-1, 1:])
            return np.sum([weight * corner for weight, corner in zip(weights, four, strict=True)], axis=0)

        between, away = _on_skin(panel, blend(at), skin)
        most = max(most, float(np.einsum("abi,abi->ab", between - blend(on), away).max()))
    return most


def cast(skin: Shape, start: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Return how far along each ray the skin begins, infinity where it is missed before `FAR_M` [m], shape [N]."""
    corners = skin.corners
    ends = np.concatenate([start, start + FAR_M * direction])
    is_near = (corners.max(axis=1) >= ends.min(axis=0) - 1e-6) & (corners.min(axis=1) <= ends.max(axis=0) + 1e-6)
    corners = corners[is_near.all(axis=1)]
    edges = corners[:, 1:] - corners[:, :1]
    nearest = np.full(len(start), np.inf)
    for row, (origin, along) in enumerate(zip(start, direction, strict=True)):
        frame = np.concatenate([edges, np.broadcast_to(-along, (len(edges), 1, 3))], axis=1).swapaxes(1, 2)
        faces_it = np.abs(np.linalg.det(frame)) > 1e-12
        u, v, t = np.linalg.solve(frame[faces_it], (origin - corners[faces_it, 0])[..., None])[..., 0].T
        nearest[row] = t[(u > -1e-9) & (v > -1e-9) & (u + v < 1.0 + 1e-9) & (t > 0.0)].min(initial=np.inf)
    return nearest


def _lattice(panel: Panel) -> tuple[np.ndarray, np.ndarray]:
    """Return the lattice of a panel over the unit square, its corners rounded: s along the foot, t upward, [A, B]."""
    a, b, c, d = (np.array(corner) for corner in panel.corners)
    width = 0.5 * (np.linalg.norm(b - a) + np.linalg.norm(c - d))
    height = 0.5 * (np.linalg.norm(d - a) + np.linalg.norm(c - b))
    radius = min(panel.round, 0.49 * width, 0.49 * height)
    columns, rows = panel.cells
    if radius <= 0.0:
        along, inset = np.linspace(0.0, 1.0, columns + 1), np.zeros(columns + 1)
    else:
        bend = radius * np.array([0.0, 0.293]) / width
        inner = np.linspace(radius / width, 1.0 - radius / width, columns + 1)
        along = np.concatenate([bend, inner, 1.0 - bend[::-1]])
        step = radius * np.array([1.0, 0.293]) / height
        inset = np.concatenate([step, np.zeros(columns + 1), step[::-1]])
    share = np.linspace(0.0, 1.0, rows + 1)
    t = inset[:, None] + share * (1.0 - 2.0 * inset[:, None])
    return np.broadcast_to(along[:, None], t.shape), t


def _rays(panel: Panel, at: np.ndarray, skin: Shape) -> tuple[np.ndarray, np.ndarray]:
    """Return, for points of a panel's plane, a point outside and the unit direction away from the vehicle, [N, 3]."""
    zero, one = np.zeros(len(at)), np.ones(len(at))
    if panel.side == "top":
        away = np.stack([zero, zero, one], axis=1)
        return np.stack([at[:, 0], at[:, 1], FAR_M * one], axis=1), away
    if panel.side in ("left", "right"):
        sign = 1.0 if panel.side == "left" else -1.0
        away = np.stack([zero, sign * one, zero], axis=1)
        return np.stack([at[:, 0], sign * FAR_M * one, at[:, 1]], axis=1), away
    sign = 1.0 if panel.side == "front" else -1.0
    knee, radius = panel.wrap or (np.inf, 1.0)
    end = skin.points[:, 0].max() if sign > 0 else skin.points[:, 0].min()
    turn = np.maximum(at[:, 0] - knee, 0.0) / radius
    away = np.stack([sign * np.cos(turn), np.sin(turn), zero], axis=1)
    base = np.stack([(end - sign * radius) * one, np.minimum(at[:, 0], knee), at[:, 1]], axis=1)
    return base + FAR_M * away, away


def _loop(columns: int, rows: int) -> np.ndarray:
    """Return the points around a lattice, the first one again at the end."""
    index = np.arange(columns * rows).reshape(columns, rows)
    around = [index[:-1, 0], index[-1, :-1], index[:0:-1, -1], index[0, :0:-1], index[:1, 0]]
    return np.concatenate(around)


def _picture(panel: Panel, s: np.ndarray, t: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return the texture coordinates of the lattice's points, shape [A * B, 2]."""
    assert panel.picture is not None
    rightward = at[..., 0].ravel() * (1.0 if panel.side in ("front", "right") else -1.0)
    is_reversed = (rightward @ (s - s.mean()).ravel()) < 0.0
    left, low, right, high = panel.picture
    u = 1.0 - s if is_reversed else s
    return np.stack([left + (right - left) * u.ravel(), low + (high - low) * t.ravel()], axis=1)
