"""Pictures of towns: rooms behind windows, road signs, signboards of shops. All names are made up.

A picture is a grid of cells; meshes choose theirs by texture coordinates (`cell`). Signs have the shapes and symbols
of the Vienna Convention on Road Signs and Signals of 1968, drawn by this file.
"""

from collections.abc import Callable, Mapping

import numpy as np

from mmw.worlds.materials.vehicle_decals import Picture, tiled, write_text

ROOMS = (8, 8)
"""Columns and rows of rooms of `window_glass` and `glass_facade`; rows go on to the right without an end."""

SIGNS = (
    "stop", "give_way", "speed_30", "speed_50", "priority", "one_way", "parking", "no_entry", "crossing", "mill_street",
    "linden_road", "plain",
)  # fmt: skip
"""Signs of the picture `sign_face`, by cell from the upper left. A sign fills its cell, whatever its shape."""

SIGN_CELLS = (4, 3)
"""Columns and rows of signs."""

SHOPS = (
    ("CORNER BAKERY", (122, 30, 32), (244, 232, 208)), ("NORD OPTICS", (18, 52, 96), (236, 240, 246)),
    ("CAFE LUMEN", (38, 28, 22), (232, 190, 110)), ("GREEN GROCER", (30, 88, 48), (240, 244, 224)),
    ("BOOKS AND MAPS", (200, 168, 60), (40, 34, 24)), ("CITY PHARMACY", (226, 232, 228), (24, 120, 70)),
    ("VELO WORKS", (232, 120, 30), (250, 250, 246)), ("TAILOR KLEIN", (70, 66, 74), (214, 214, 218)),
)  # fmt: skip
"""Signboards of `shop_sign`, from the top: name, sRGB of the board and of the letters."""

SHOP_ASPECT = 12.0
"""Width of a signboard over its height."""

_Draw = Callable[[np.random.Generator, bool], tuple[np.ndarray, np.ndarray]]
_SIGN = 128
_ROOM = 64
_RED, _WHITE, _BLUE, _BLACK = (176, 24, 30), (238, 238, 234), (20, 70, 150), (24, 24, 26)


def _plane(height: int, width: int) -> tuple[np.ndarray, np.ndarray]:
    """Return x to the right and y downward of the pixels' middles [px]."""
    y, x = np.mgrid[0:height, 0:width] + 0.5
    return x, y


def _paint(canvas: np.ndarray, cover: np.ndarray, color: tuple[float, ...] | np.ndarray) -> None:
    canvas += np.clip(cover, 0.0, 1.0)[..., None] * (np.asarray(color, float) - canvas)


def _box(x: np.ndarray, y: np.ndarray, left: float, top: float, right: float, bottom: float) -> np.ndarray:
    """Return how much of each pixel lies in a rectangle."""
    across = np.clip(x - left + 0.5, 0, 1) * np.clip(right - x + 0.5, 0, 1)
    return across * np.clip(y - top + 0.5, 0, 1) * np.clip(bottom - y + 0.5, 0, 1)


def _regular(x: np.ndarray, y: np.ndarray, radius: float, sides: int, turn: float) -> np.ndarray:
    """Return how far inside a regular polygon about the middle of a sign each pixel lies [px]; `turn` of a corner."""
    middle = (np.arange(sides) + 0.5) * 2 * np.pi / sides + turn
    away = (x - 0.5 * _SIGN)[..., None] * np.cos(middle) - (y - 0.5 * _SIGN)[..., None] * np.sin(middle)
    return radius * np.cos(np.pi / sides) - away.max(axis=-1)


def _sign(name: str) -> np.ndarray:
    """Draw one sign; the plate reaches to the edges of the cell, with its own shape."""
    x, y = _plane(_SIGN, _SIGN)
    half = 0.5 * _SIGN
    ground = {"give_way": _RED, "no_entry": _RED, "one_way": _BLUE, "parking": _BLUE, "crossing": _BLUE}
    canvas = np.full((_SIGN, _SIGN, 3), ground.get(name, _RED if name.startswith("speed") else _WHITE), dtype=float)
    disc = half - np.hypot(x - half, y - half)
    if name == "stop":
        _paint(canvas, _regular(x, y, (half - 5) / np.cos(np.pi / 8), 8, np.pi / 8), _RED)
        write_text(canvas, "STOP", (20, 48, 108, 80), _WHITE, 1.0)
    elif name == "give_way":
        _paint(canvas, np.minimum(y - 17, half - 17 - 0.5 * y - np.abs(x - half)), _WHITE)
    elif name.startswith("speed"):
        _paint(canvas, disc - 15, _WHITE)
        write_text(canvas, name[-2:], (36, 44, 92, 84), _BLACK, 1.15)
    elif name == "priority":
        _paint(canvas, 0.7 * (half - 16 - np.abs(x - half) - np.abs(y - half)), (236, 176, 20))
    elif name == "one_way":
        _paint(canvas, _box(x, y, 56, 50, 72, 108), _WHITE)
        _paint(canvas, np.minimum(y - 20, 0.7 * (y - 18 - 1.1 * np.abs(x - half))) * (y < 54), _WHITE)
    elif name == "parking":
        write_text(canvas, "P", (42, 26, 90, 102), _WHITE, 1.3)
    elif name == "no_entry":
        _paint(canvas, _box(x, y, 20, 52, 108, 76), _WHITE)
    elif name == "crossing":
        _paint(canvas, np.minimum(y - 16, 0.45 * (y - 14 - 2.0 * np.abs(x - half) + 0.0)) * (y < 112), _WHITE)
        for stripe in range(5):
            _paint(canvas, _box(x, y, 27 + 16 * stripe, 100, 36 + 16 * stripe, 110), _BLACK)
        _paint(canvas, 6.5 - np.hypot(x - 63, y - 50), _BLACK)
        limbs = ((63, 58, 61, 78), (61, 78, 52, 96), (61, 78, 71, 95), (62, 62, 74, 72), (62, 62, 52, 74))
        for x0, y0, x1, y1 in limbs:
            along = np.clip(((x - x0) * (x1 - x0) + (y - y0) * (y1 - y0)) / ((x1 - x0) ** 2 + (y1 - y0) ** 2), 0, 1)
            _paint(canvas, 3.6 - np.hypot(x - x0 - along * (x1 - x0), y - y0 - along * (y1 - y0)), _BLACK)
    elif name != "plain":
        _paint(canvas, _box(x, y, 2, 8, _SIGN - 2, _SIGN - 8), _BLUE)
        write_text(canvas, name.upper().replace("_", " "), (10, 36, 118, 92), _WHITE, 0.8)
    return canvas


def _signs() -> np.ndarray:
    return tiled([_sign(name) for name in SIGNS], SIGN_CELLS[0])


def _shops() -> np.ndarray:
    height, width = 40, int(40 * SHOP_ASPECT)
    boards = []
    for name, board, letters in SHOPS:
        canvas = np.full((height, width, 3), board, dtype=float)
        x, y = _plane(height, width)
        _paint(canvas, 1.0 - _box(x, y, 2.5, 2.5, width - 2.5, height - 2.5), 0.7 * np.array(board))
        size = 15.0 * len(name)
        write_text(canvas, name, (0.5 * (width - size), 10, 0.5 * (width + size), 30), letters, 1.0)
        boards.append(canvas)
    return tiled(boards, 1)


def _manhole() -> np.ndarray:
    """Draw a manhole cover: a worn iron disc with rings of bosses, the gap around it, and the frame."""
    size = 128
    x, y = _plane(size, size)
    across, upward = (x / size - 0.5), (0.5 - y / size)
    away, angle = np.hypot(across, upward), np.arctan2(upward, across)
    canvas = np.full((size, size, 3), (84.0, 80.0, 76.0))
    boss = np.zeros_like(x)
    for ring, count in ((0.09, 6), (0.17, 12), (0.25, 18), (0.33, 24)):
        turn = angle * count / (2 * np.pi) + 0.5 * (count % 12 == 0)
        boss += np.clip(3.0 - size * np.hypot(away - ring, (turn - np.round(turn)) * 2 * np.pi * ring / count), 0, 1)
    _paint(canvas, 0.8 * boss, (128, 122, 116))
    _paint(canvas, np.clip(2.0 - size * np.abs(away - 0.40), 0, 1), (22, 21, 20))
    _paint(canvas, np.clip(size * (away - 0.43), 0, 1), (96, 92, 87))
    _paint(canvas, _box(x, y, 58, 16, 70, 20) + _box(x, y, 58, 108, 70, 112), (18, 17, 16))
    return tiled([canvas], 1)


def _grate() -> np.ndarray:
    """Draw a drain grate: a frame, and bars across with dark slots between them."""
    height, width = 64, 100
    x, y = _plane(height, width)
    canvas = np.full((height, width, 3), (92.0, 87.0, 82.0))
    for slot in range(8):
        left = 10 + 10.2 * slot
        _paint(canvas, _box(x, y, left, 8, left + 5.5, 30) + _box(x, y, left, 34, left + 5.5, 56), (10, 10, 10))
    _paint(canvas, 1.0 - _box(x, y, 1.5, 1.5, width - 1.5, height - 1.5), (30, 29, 28))
    return tiled([canvas], 1)


def _room(rng: np.random.Generator, lit: bool) -> tuple[np.ndarray, np.ndarray]:
    """Draw a room behind a window of a house with its frame, and the light that comes out of it at night."""
    x, y = _plane(_ROOM, _ROOM)
    depth = np.clip(y / _ROOM, 0, 1)[..., None]
    wall = rng.uniform(22, 44) * np.array([1.0, 0.97, 0.92]) * rng.uniform(0.9, 1.1, 3)
    canvas = np.ones((_ROOM, _ROOM, 3)) * wall * (0.75 + 0.5 * depth)  # daylight falls on what is low
    back = _box(x, y, rng.uniform(8, 20), 10, rng.uniform(44, 56), 50)
    _paint(canvas, 0.5 * back, 0.7 * wall)
    if rng.uniform() < 0.5:  # something dark in the room
        left = rng.uniform(6, 40)
        _paint(canvas, 0.8 * _box(x, y, left, rng.uniform(30, 44), left + rng.uniform(10, 20), 60), 0.45 * wall)
    cloth = rng.uniform(60, 105) * np.array(((1, 0.98, 0.93), (0.92, 0.95, 1), (1, 0.92, 0.8))[int(rng.integers(3))])
    folds = (0.86 + 0.14 * np.sin(x * rng.uniform(0.7, 1.1)))[..., None] * cloth
    form, part = rng.uniform(), rng.uniform(8, 20)
    if form < 0.45:  # drawn to the sides
        _paint(canvas, _box(x, y, 0, 0, part, 64) + _box(x, y, 64 - part, 0, 64, 64), folds)
    elif form < 0.68:  # blinds, some way down
        slats = (0.80 + 0.20 * np.sin(y * 1.6))[..., None] * cloth
        _paint(canvas, _box(x, y, 0, 0, 64, rng.uniform(16, 62)), slats)
    elif form < 0.78:  # net curtain
        _paint(canvas, 0.75 * _box(x, y, 0, 0, 64, 64), folds)
    light = np.zeros_like(canvas)
    if lit:
        warm = np.array((1.0, rng.uniform(0.66, 0.84), rng.uniform(0.34, 0.62)))
        light = 255.0 * warm * np.clip(canvas / 110.0 + 0.42 * (1.0 - 0.4 * depth), 0, 1)
    frame = 1.0 - _box(x, y, 2.2, 2.2, 61.8, 61.8) + _box(x, y, 30.6, 0, 33.4, 64)
    if rng.uniform() < 0.5:
        frame += _box(x, y, 0, 18.4, 64, 20.6)
    _paint(canvas, frame, (150, 148, 142))
    _paint(light, frame, (0, 0, 0))
    return canvas, light


def _office(rng: np.random.Generator, lit: bool) -> tuple[np.ndarray, np.ndarray]:
    """Draw an office behind a curtain wall: a ceiling with lamps, desks, blinds, and its light at night."""
    x, y = _plane(_ROOM, _ROOM)
    tint = np.array((0.72, 0.95, 1.10))
    canvas = np.ones((_ROOM, _ROOM, 3)) * rng.uniform(46, 60) * tint * (0.8 + 0.4 * (y / _ROOM))[..., None]
    _paint(canvas, _box(x, y, 0, 0, 64, 9), 52 * tint)
    lamps = _box(x, y, 8, 3, 26, 5) + _box(x, y, 38, 3, 56, 5)
    _paint(canvas, 0.6 * _box(x, y, 0, rng.uniform(40, 50), 64, 60), rng.uniform(24, 36) * tint)
    if rng.uniform() < 0.35:
        slats = (0.85 + 0.15 * np.sin(y * 1.6))[..., None] * rng.uniform(80, 104) * tint
        _paint(canvas, _box(x, y, 0, 0, 64, rng.uniform(10, 60)), slats)
    light = np.zeros_like(canvas)
    if lit:
        light = 255.0 * np.array((1.0, 0.93, 0.80)) * np.clip(canvas.mean(axis=2, keepdims=True) / 110.0 + 0.15, 0, 1)
        _paint(light, lamps, (255, 250, 235))
    rim = 1.0 - _box(x, y, 0.9, 0.9, 63.1, 63.1)
    _paint(canvas, rim, (40, 46, 50))
    _paint(light, rim, (0, 0, 0))
    _paint(canvas, _box(x, y, 0, 60, 64, 64), 36 * tint)
    return canvas, light


def _sheet(seed: int, draw: _Draw, share: float, layer: int) -> np.ndarray:
    """Draw all rooms; layer 0 is what is seen by day, layer 1 the light of the share that is lit at night."""
    rng = np.random.default_rng(seed)
    columns, rows = ROOMS
    lit = rng.permutation(columns * rows) < share * columns * rows
    rooms = [draw(np.random.default_rng([seed, k]), bool(lit[k]))[layer] for k in range(columns * rows)]
    return tiled(rooms, columns)


TOWN_PICTURES: Mapping[str, Picture] = {
    "window_glass": Picture(lambda: _sheet(7, _room, 0.3, 0), light=lambda: _sheet(7, _room, 0.3, 1)),
    "glass_facade": Picture(lambda: _sheet(8, _office, 0.35, 0), light=lambda: _sheet(8, _office, 0.35, 1)),
    "sign_face": Picture(_signs),
    "shop_sign": Picture(_shops, shines=True),
    "manhole_cover": Picture(_manhole),
    "drain_grate": Picture(_grate),
}
"""Material -> the picture that it shows."""
