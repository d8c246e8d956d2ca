"""Texture tiles of the material library: small, seamless, made from noise and patterns by this file.

A tile is a field from 0 to 1 over a square of ground or wall, and colours along that field. Its mean is exactly the
material's colour, so that a reader without textures sees the same material from afar.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image

SIZE = 256
"""Side of a tile [px]."""

LEVELS = 64
"""Colours of a tile."""


@dataclass(frozen=True)
class Tile:
    """One texture tile."""

    field: Callable[[], np.ndarray]
    """Makes the field, 0 to 1, shape [SIZE, SIZE], rows upward."""
    tones: tuple[tuple[float, tuple[float, float, float]], ...]
    """Colour along the field: position and relative linear colour, in any scale; linear in between."""
    size_m: float
    """Side of the tile on the surface [m]."""


def noise(seed: int, slope: float, low: float = 0.0) -> np.ndarray:
    """Return seamless noise with a power-law spectrum, spread evenly over 0 to 1, shape [SIZE, SIZE].

    Args:
        seed: Seed.
        slope: Amplitude falls as frequency to the minus `slope`; 0 is white noise.
        low: Frequencies below this many waves a tile are left out.
    """
    white = np.random.default_rng(seed).standard_normal((SIZE, SIZE))
    wave = np.fft.fftfreq(SIZE, 1.0 / SIZE)
    frequency = np.hypot(*np.meshgrid(wave, wave))
    gain = np.where(frequency > low, np.maximum(frequency, 1.0) ** -slope, 0.0)
    gain[0, 0] = 0.0
    return _spread(np.fft.ifft2(np.fft.fft2(white) * gain).real)


def _spread(values: np.ndarray) -> np.ndarray:
    """Return the ranks of the values, 0 to 1; a micro-unit of difference counts as none."""
    flat = np.round(values.ravel(), 6)
    order = np.lexsort((np.arange(flat.size), flat))
    rank = np.empty(flat.size)
    rank[order] = np.arange(flat.size) / (flat.size - 1)
    return rank.reshape(values.shape)


def _grid() -> tuple[np.ndarray, np.ndarray]:
    """Return x to the right and y upward of the pixels' middles, 0 to 1, each [SIZE, SIZE]."""
    middle = (np.arange(SIZE) + 0.5) / SIZE
    return np.meshgrid(middle, middle)


def _joints(columns: int, rows: int, width: float, shift: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return where the joints of a wall of stones are, and the number of the stone, each [SIZE, SIZE].

    Args:
        columns: Stones a row.
        rows: Rows of stones; even if every second one is shifted.
        width: Width of a joint, as a share of the tile.
        shift: Shift of every second row, as a share of a stone.
    """
    x, y = _grid()
    row = np.floor(y * rows).astype(int)
    along = x * columns + shift * (row % 2)
    column = np.floor(along).astype(int) % columns
    across = np.minimum((along % 1.0), 1.0 - along % 1.0) / columns
    upward = np.minimum((y * rows) % 1.0, 1.0 - (y * rows) % 1.0) / rows
    return np.minimum(across, upward) < 0.5 * width, row * columns + column


def _stones(seed: int, columns: int, rows: int, width: float, shift: float, grain: float) -> np.ndarray:
    """Return stones of different tone (0.2 to 1) with fine grain, and joints (0)."""
    joint, stone = _joints(columns, rows, width, shift)
    tone = np.random.default_rng(seed).uniform(0.3, 0.9, columns * rows)[stone]
    tone = np.clip(tone + grain * (noise(seed + 1, 0.6) - 0.5), 0.2, 1.0)
    return np.where(joint, 0.0, tone)


def _asphalt() -> np.ndarray:
    return _spread(0.75 * noise(11, 0.1, 12) + 0.35 * noise(12, 1.2))


def _grass() -> np.ndarray:
    return _spread(noise(21, 0.4, 6) + 0.8 * noise(22, 1.4))


def _marble() -> np.ndarray:
    joint, slab = _joints(2, 4, 0.008, 0.5)
    cloud = noise(31, 1.7)
    vein = np.exp(-((np.abs(noise(32, 1.8) - 0.5) / 0.02) ** 2))
    tone = 0.55 + 0.35 * cloud - 0.25 * vein
    tone += np.random.default_rng(33).uniform(-0.08, 0.08, 8)[slab]
    return np.where(joint, 0.0, np.clip(tone, 0.1, 1.0))


def _panels() -> np.ndarray:
    joint, _ = _joints(1, 2, 0.012)
    x, y = _grid()
    holes = np.zeros_like(x, dtype=bool)
    for u in (0.15, 0.85):
        for v in (0.12, 0.38, 0.62, 0.88):
            holes |= np.hypot(x - u, y - v) < 0.012
    tone = 0.4 + 0.35 * noise(41, 1.3) + 0.2 * noise(42, 0.3, 8)
    return np.where(joint | holes, 0.0, np.clip(tone, 0.1, 1.0))


def _boards() -> np.ndarray:
    x, y = _grid()
    board = np.floor(x * 12).astype(int)
    seam = np.minimum((x * 12) % 1.0, 1.0 - (x * 12) % 1.0) < 0.03
    stretched = np.roll(noise(51, 0.8), 3, axis=0)
    grain = 0.5 * stretched + 0.5 * stretched[np.floor(y * SIZE / 8).astype(int), np.floor(x * SIZE).astype(int)]
    tone = np.random.default_rng(52).uniform(0.35, 0.75, 12)[board] + 0.25 * (grain - 0.5)
    return np.where(seam, 0.05, np.clip(tone, 0.1, 1.0))


def _roof_tiles() -> np.ndarray:
    x, y = _grid()
    row = np.floor(y * 8).astype(int)
    along = (x * 8 + 0.5 * (row % 2)) % 1.0
    curve = 0.5 + 0.5 * np.cos(2 * np.pi * (along - 0.5))
    edge = (y * 8) % 1.0
    tone = 0.25 + 0.5 * curve * (0.6 + 0.4 * edge) + 0.2 * (noise(61, 0.5) - 0.5)
    return np.clip(np.where(edge < 0.1, 0.1, tone), 0.0, 1.0)


def _slabs() -> np.ndarray:
    return _stones(71, 4, 4, 0.012, 0.0, 0.5)


def _bricks() -> np.ndarray:
    return _stones(81, 4, 14, 0.012, 0.5, 0.4)


def _kerbstones() -> np.ndarray:
    return _stones(91, 2, 1, 0.01, 0.0, 0.6)


def _leaves() -> np.ndarray:
    return _spread(noise(101, 0.3, 10) + 0.5 * noise(102, 1.0))


def _rough(seed: int, slope: float) -> Callable[[], np.ndarray]:
    return lambda: noise(seed, slope)


def _grey(dark: float, light: float) -> tuple[tuple[float, tuple[float, float, float]], ...]:
    return ((0.0, (dark, dark, dark)), (1.0, (light, light, light)))


Tones = tuple[tuple[float, tuple[float, float, float]], ...]


def _with_joints(joint: tuple[float, float, float], dark: float, light: float) -> Tones:
    """Tones of stones from dark to light, and of the joints between them."""
    return ((0.0, joint), (0.1, joint), (0.15, (dark, dark, dark)), (1.0, (light, light, light)))


TILES: Mapping[str, Tile] = {
    "asphalt": Tile(_asphalt, _grey(0.55, 1.5), 2.0),
    "road_marking": Tile(_rough(13, 0.9), _grey(0.8, 1.1), 2.0),
    "concrete_sidewalk": Tile(_slabs, _with_joints((0.45, 0.45, 0.45), 0.8, 1.1), 2.0),
    "curb": Tile(_kerbstones, _with_joints((0.5, 0.5, 0.5), 0.85, 1.08), 2.0),
    "grass": Tile(_grass, ((0.0, (0.45, 0.5, 0.5)), (0.6, (1.0, 1.0, 1.0)), (1.0, (1.9, 1.5, 1.6))), 4.0),
    "soil": Tile(_rough(23, 1.0), ((0.0, (0.6, 0.6, 0.6)), (1.0, (1.4, 1.35, 1.3))), 4.0),
    "marble_facade": Tile(_marble, _with_joints((0.4, 0.38, 0.35), 0.75, 1.1), 4.0),
    "concrete_facade": Tile(_panels, _with_joints((0.35, 0.35, 0.35), 0.8, 1.15), 4.0),
    "brick_facade": Tile(_bricks, ((0.1, (1.7, 3.6, 4.6)), (0.2, (0.6, 0.55, 0.5)), (1.0, (1.25, 1.1, 1.0))), 1.0),
    "concrete_roof": Tile(_rough(43, 0.4), _grey(0.7, 1.3), 2.0),
    "tile_roof": Tile(_roof_tiles, ((0.0, (0.4, 0.4, 0.4)), (1.0, (1.5, 1.4, 1.3))), 2.4),
    "concrete_structure": Tile(_boards, _grey(0.7, 1.3), 3.0),
    "wood": Tile(_boards, ((0.0, (0.35, 0.3, 0.3)), (1.0, (1.6, 1.6, 1.5))), 1.5),
    "bark": Tile(_rough(53, 0.7), _grey(0.4, 1.6), 1.0),
    "foliage": Tile(_leaves, ((0.0, (0.35, 0.4, 0.4)), (1.0, (1.7, 1.55, 1.5))), 2.0),
}
"""Material -> its tile. Tones and sizes are design values; bricks are 250 x 71 mm with joints."""


def tile_pixels(tile: Tile, color: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return a tile as palette image.

    Args:
        tile: The tile.
        color: Mean linear colour that it shall have.

    Returns:
        Palette index of every pixel, rows downward, shape [SIZE, SIZE], uint8, and sRGB colours, shape [LEVELS, 3].
    """
    index = np.minimum((tile.field()[::-1] * LEVELS).astype(int), LEVELS - 1).astype(np.uint8)
    where = (np.arange(LEVELS) + 0.5) / LEVELS
    positions = [position for position, _ in tile.tones]
    tones = np.stack([np.interp(where, positions, [tone[k] for _, tone in tile.tones]) for k in range(3)], axis=1)
    share = np.bincount(index.ravel(), minlength=LEVELS) / index.size
    linear = np.clip(tones / (share @ tones) * np.asarray(color), 0.0, 1.0)
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)  # IEC 61966-2-1
    return index, np.rint(255.0 * encoded).astype(np.uint8)


def write_tile(path: Path, tile: Tile, color: tuple[float, float, float]) -> None:
    """Write a tile as PNG with a palette."""
    index, palette = tile_pixels(tile, color)
    image = Image.frombytes("P", (SIZE, SIZE), index.tobytes())
    image.putpalette(palette.tobytes())
    path.parent.mkdir(parents=True, exist_ok=True)
    image.save(path, optimize=True)
