"""The skin of a vehicle as one closed loft along x: wheel arches cut out, windows flush in it."""

from itertools import pairwise

import numpy as np

from mmw.worlds.vehicles.models import Body
from mmw.worlds.vehicles.primitives import Shape, join, quads, weld

_LOW, _LIP, _MID, _CHAR, _WAIST, _SHOULDER, _GLASS_LOW, _GLASS_HIGH, _RAIL = range(9)
_ROWS = 9
_ARCH_SAMPLES = 13
_SEAM = 0.004
_COWL = 0.07
"""Width of the dark strip at the foot of the windshield [m]."""
_STEP = 0.2
"""Curved stretches of the center line get a cross-section at least this often [m]."""
_FADE = 0.5
"""Length over which the bow and the lean of nose and tail fade out [m]."""


def build_skin(body: Body) -> Shape:
    """Return the skin of a vehicle: closed, outward, with parts body, glass, gloss and trim.

    A half section (y >= 0) runs from the bottom center outward along the floor, up the side and inward over the top.
    The sections are joined along x, mirrored, and closed by a lattice at the nose and one at the tail. Everything
    between two seams, and between two rows, lies in one plane where the body has no taper, so that doors and windows
    are flat.
    """
    x = _stations(body)
    sections = np.stack([_section(body, value, i in (0, len(x) - 1)) for i, value in enumerate(x)])
    middle = (x[:-1] + x[1:]) / 2
    columns = len(body.columns)
    front = quads(_cap(body, sections[0]), lambda c, r: _part_of_cap(body.nose_parts, c, r))
    rear = quads(_cap(body, sections[-1])[::-1], lambda c, r: _part_of_cap(body.tail_parts, columns - 2 - c, r))
    left = quads(sections, lambda i, k: _part_of_section(body, middle[i], k, ()))
    right = quads(sections, lambda i, k: _part_of_section(body, middle[i], k, body.right_doors))
    skin = weld(join([join([left, front, rear]), join([right, front, rear]).mirrored()]))
    return Shape(_warp(body, skin.points), skin.faces, skin.parts)


def _stations(body: Body) -> np.ndarray:
    """Return the x of every cross-section from nose to tail [m], shape [S]."""
    values = [body.front, body.rear]
    values += [value for key in (body.top, body.belt, body.plan, body.floor) for value, _ in key]
    values += [edge for window in body.windows for edge in window]
    values += [seam + side for seam in body.seams for side in (-_SEAM, _SEAM)]
    values += [screen[0] - _COWL for screen in body.screens[:1]]
    values += _curved(body)
    if body.bed:
        values += [body.bed[0], body.bed[0] - 0.02, body.bed[1], body.bed[1] + 0.02]
    for axle in body.axles:
        angles = np.linspace(0, np.pi, _ARCH_SAMPLES)
        values += list(axle + body.arch_radius * np.cos(angles))
        values += [axle + body.arch_radius + 0.02, axle - body.arch_radius - 0.02]
    values = np.unique(np.round([v for v in values if body.rear <= v <= body.front], 4))
    keep = np.concatenate([[True], np.diff(values) > 0.0015])
    return values[keep][::-1]


def _curved(body: Body) -> list[float]:
    """Return the x of further cross-sections where the center line bends: between its points, but not in a screen."""
    values: list[float] = []
    keys = sorted(x for x, _ in body.top)
    for start, end in pairwise(keys):
        middle, parts = (start + end) / 2, int((end - start) / _STEP) + 1
        linear = (_at(body.top, start) + _at(body.top, end)) / 2
        if parts > 1 and not _inside(middle, body.screens) and abs(_height(body, middle) - linear) > 0.002:
            values += np.linspace(start, end, min(parts, 3) + 1)[1:-1].tolist()
    return values


def _at(table: tuple[tuple[float, float], ...], x: float) -> float:
    keys, values = zip(*sorted(table), strict=True)
    return float(np.interp(x, keys, values))


def _height(body: Body, x: float) -> float:
    """Return the height of the center line [m]: straight in the screens and the load bed, a smooth curve elsewhere.

    Source: Fritsch and Carlson, Monotone Piecewise Cubic Interpolation, SIAM J. Numer. Anal. 17 (1980), 238-246, with
    the harmonic mean of the neighbors as slope: it never overshoots.
    """
    keys, heights = (np.array(column) for column in zip(*sorted(body.top), strict=True))
    if _inside(x, body.screens) or body.bed or not keys[0] < x < keys[-1]:
        return float(np.interp(x, keys, heights))
    secant = np.diff(heights) / np.diff(keys)
    slope = np.zeros(len(keys))
    product = secant[:-1] * secant[1:]
    rising = product > 0.0
    slope[1:-1][rising] = 2.0 * product[rising] / (secant[:-1] + secant[1:])[rising]
    slope[0], slope[-1] = secant[0], secant[-1]
    k = int(np.clip(np.searchsorted(keys, x) - 1, 0, len(keys) - 2))
    width = keys[k + 1] - keys[k]
    share = (x - keys[k]) / width
    blend = share * share * (3.0 - 2.0 * share)
    ends = slope[k] * share * (1.0 - share) ** 2 - slope[k + 1] * share**2 * (1.0 - share)
    return float(heights[k] + blend * (heights[k + 1] - heights[k]) + width * ends)


def _low_edge(body: Body, x: float) -> float:
    """Return the height of the side's lower edge [m]: the floor, or the wheel arch above it."""
    low = _at(body.floor, x)
    for axle in body.axles:
        square = (body.arch_radius + 1e-4) ** 2 - (x - axle) ** 2
        if square > 0:
            low = max(low, body.axle_height + float(np.sqrt(max(body.arch_radius**2 - (x - axle) ** 2, 0.0))))
    return low


def _section(body: Body, x: float, is_end: bool) -> np.ndarray:
    """Return the half section at x, bottom center to top center [m], shape [K, 3]."""
    top = _height(body, x)
    shoulder = min(_at(body.belt, x), top - body.crown)
    low, floor = _low_edge(body, x), _at(body.floor, x)
    plan = _at(body.plan, x)
    fractions = np.array(body.columns)

    rows = np.empty((_ROWS, 2))
    heights = [low, low + body.lip, body.mid_z, body.char_z, max(body.char_z, (body.char_z + shoulder) / 2), shoulder]
    for row, z in enumerate(np.maximum.accumulate(np.clip(heights, low, shoulder))):
        rows[row] = plan * _at(body.side, z) * body.half_width, z
    rise = max(top - shoulder - body.crown, 0.0)
    ledge = min(body.ledge, rise)
    crown = min(body.roof_crown, 0.5 * rise) if rise else body.crown
    rail = max(top - crown, shoulder)
    sill_y = rows[_SHOULDER, 0] - ledge
    for row, z in (
        (_GLASS_LOW, min(shoulder + ledge, rail)),
        (_GLASS_HIGH, max(min(shoulder + ledge, rail), rail - body.frame)),
        (_RAIL, rail),
    ):
        rows[row] = sill_y - body.tumblehome * max(z - shoulder - ledge, 0.0), z

    roof_y = fractions[::-1] * rows[_RAIL, 0]
    drop = np.maximum((fractions[::-1] - fractions[1]) / (1.0 - fractions[1]), 0.0) ** 2
    roof_z = top - (top - rail) * drop
    if body.bed and body.bed[1] + 0.01 < x < body.bed[0] - 0.01:
        roof_z[2:] = body.bed[2]
        if low > floor:
            roof_z[2:4] = max(body.bed[2], low + 0.03)

    edge_y = rows[_LOW, 0]
    floor_y = edge_y * fractions
    floor_z = np.full(len(fractions), floor)
    floor_z[-2:] = low
    if not is_end:
        well = min(body.well_y, edge_y)
        floor_y[1:-1] = well

    y = np.concatenate([floor_y[:-1], rows[:, 0], roof_y[1:]])
    z = np.concatenate([floor_z[:-1], rows[:, 1], roof_z[1:]])
    return np.stack([np.full(len(y), x), y, z], axis=1)


def _cap(body: Body, section: np.ndarray) -> np.ndarray:
    """Return the lattice that closes an end, columns from the center outward, rows upward [m], shape [C, R, 3]."""
    columns = len(body.columns)
    bottom, side, top = section[:columns], section[columns - 1 : columns - 1 + _ROWS], section[-columns:][::-1]
    height = side[-1, 2] - side[0, 2]
    share = (side[:, 2] - side[0, 2]) / height
    cap = np.empty((columns, _ROWS, 3))
    cap[..., 0] = section[0, 0]
    cap[..., 1] = np.array(body.columns)[:, None] * side[:, 1]
    cap[..., 2] = bottom[:, 2][:, None] * (1 - share) + top[:, 2][:, None] * share
    return cap


def _warp(body: Body, points: np.ndarray) -> np.ndarray:
    """Return the points with nose and tail bowed in plan and leaned in profile [m], shape [N, 3]."""
    x, y, z = points.T
    across = np.maximum(np.abs(y) / body.half_width - 0.45, 0.0) / 0.55
    warped = x.copy()
    for end, sign, bow, lean in ((body.front, 1.0, *body.nose), (body.rear, -1.0, *body.tail)):
        share = np.clip(1.0 - sign * (end - x) / _FADE, 0.0, 1.0)
        heights, setbacks = zip(*lean, strict=True)
        warped -= sign * share * (bow * across**2 + np.interp(z, heights, setbacks))
    return np.stack([warped, y, z], axis=1)


def _inside(x: float, spans: tuple[tuple[float, float], ...]) -> bool:
    return any(min(span) < x < max(span) for span in spans)


def _part_of_section(body: Body, x: float, segment: int, doors: tuple[tuple[float, float], ...]) -> str:
    """Return the part of the strip above half-section point `segment`, between two stations around x."""
    columns = len(body.columns)
    row = segment - (columns - 1)
    if row < 0:
        return "trim"
    if row < _ROWS - 1:
        if row == _LOW or (row < _SHOULDER and any(abs(x - seam) < _SEAM for seam in body.seams)):
            return "trim"
        if _LIP < row < _GLASS_HIGH and _inside(x, doors):
            return "glass"
        if row == _GLASS_LOW:
            if _inside(x, body.windows):
                return "glass"
            return "gloss" if _inside(x, body.pillars) else "body"
        if row == _SHOULDER and _inside(x, body.windows + body.pillars):
            return "gloss"
        return "body"
    column = columns - 2 - (row - (_ROWS - 1))
    if body.bed and body.bed[1] < x < body.bed[0] and column < columns - 2:
        return "trim"
    is_screen = column < columns - 2 and _inside(x, body.screens)
    if is_screen and x > body.screens[0][0] - _COWL:
        return "gloss"
    return "glass" if is_screen else "body"


def _part_of_cap(parts: tuple[tuple[int, int, int, int, str], ...], column: int, row: int) -> str:
    """Return the part of one quad of the nose or tail: that of the last entry of `parts` that holds it."""
    name = "body"
    for first_column, last_column, first_row, last_row, part in parts:
        if first_column <= column < last_column and first_row <= row < last_row:
            name = part
    return name
