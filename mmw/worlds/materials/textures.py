"""Texture tiles of the material library: small, seamless, made from noise and patterns by this file.

A tile is painted with a tone and a hue, 0 to 1, over a square of ground or wall, and colors along both. Its mean is
exactly the material's color, so that a reader without textures sees the same material from afar. A relief gives the
normals of the same surface.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from PIL import Image

from mmw.core.errors import InputError
from mmw.worlds.materials.noise_fields import by_stone, grid, joints, leaves, lines, noise, slopes, spread

LEVELS = (32, 8)
"""Colors of a tile along its tone and along its hue."""

SLOPE_STEP = 4
"""Normals are rounded to this many of the 255 steps between -1 and 1, for small files."""

Tones = tuple[tuple[float, tuple[float, float, float]], ...]
"""Colors along a field: position and relative linear color, in any scale; linear in between."""

Painting = tuple[np.ndarray, np.ndarray]
"""Tone and hue of every pixel, 0 to 1, each [N, N], rows upward."""


@dataclass(frozen=True)
class Tile:
    """One texture tile."""

    painting: Callable[[], Painting]
    """Makes tone and hue."""
    tones: Tones
    """Color along the tone."""
    hues: Tones
    """Factor of the color, along the hue."""
    size_m: float
    """Side of the tile on the surface [m]."""
    relief: Callable[[], np.ndarray] | None = None
    """Makes the slope of the surface (to the right, upward), shape [2, N, N], rows upward; None for a flat one."""
    relief_m: float = 0.0
    """Side of the relief's tile [m]; 0 for the tile's own."""
    file: str = ""
    """Tile whose files this one reads; empty for its own."""
    tint: tuple[float, float, float] = (1.0, 1.0, 1.0)
    """Factor of the colors of another tile's file."""
    roughness: float = 0.0
    """How much rougher a white spot is than a black one; negative where dark ones are rougher [-]."""


def _grey(dark: float, light: float) -> Tones:
    return ((0.0, (dark, dark, dark)), (1.0, (light, light, light)))


def _with_joints(joint: float, dark: float, light: float) -> Tones:
    """Return the tones of joints, and of stones from dark to light."""
    steps = ((0.0, joint), (0.08, joint), (0.2, dark), (1.0, light))
    return tuple((position, (grey, grey, grey)) for position, grey in steps)


def _fine(seed: int, size: int, slope: float, height: float, size_m: float, low: float = 0.0) -> np.ndarray:
    """Return the slope of a rough surface of `height` [m] from valley to peak."""
    return slopes(height * noise(seed, slope, size, low), size_m)


def _asphalt() -> Painting:
    grain = noise(11, 0.35, 1280, 60)
    stones = noise(12, 0.0, 1280, 190) > 0.985
    crack = lines(13, 1280, 1.7, 1.2, 0.30)
    tone = 0.12 + 0.72 * grain + 0.25 * stones
    tone = tone * (1.0 - 0.6 * crack)
    worn = 0.45 * noise(15, 1.1, 1280, 7) + 0.55 * noise(16, 0.8, 1280, 15)
    return np.clip(tone, 0, 1), worn


def _marking() -> Painting:
    chip = np.clip((noise(131, 0.9, 512, 6) - 0.93) * 30, 0, 1)
    crack = lines(132, 512, 1.5, 1.1, 0.5)
    grain = 0.75 + 0.25 * noise(134, 0.3, 512, 20)
    return grain * (1.0 - 0.8 * np.maximum(chip, 0.6 * crack)), noise(135, 1.5, 512)


def _slabs() -> Painting:
    joint, stone, _ = joints(512, 8, 8, 0.003)
    tone = by_stone(71, stone, 0.45, 0.8) + 0.35 * (noise(72, 0.5, 512, 8) - 0.5)
    gum = noise(74, 0.0, 512) > 0.9993
    gum |= np.roll(gum, 1, 0) | np.roll(gum, 1, 1)
    tone = np.clip(tone - 0.35 * gum, 0.2, 1.0) * (1.0 - joint)
    return tone, noise(73, 1.6, 512, 1)


def _slab_relief() -> np.ndarray:
    joint, stone, _ = joints(512, 8, 8, 0.004)
    lean = np.stack([by_stone(75 + k, stone, -0.012, 0.012) for k in range(2)])
    return slopes(-0.003 * joint, 4.0) * 0.8 + lean


def _kerbstones() -> Painting:
    joint, stone, _ = joints(512, 2, 1, 0.006)
    tone = by_stone(91, stone, 0.5, 0.7) + 0.5 * (noise(92, 0.4, 512, 10) - 0.5)
    return np.clip(tone, 0.2, 1.0) * (1.0 - joint), noise(93, 1.5, 512)


def _grass() -> Painting:
    blades = 0.6 * noise(21, 0.1, 1152, 150) + 0.4 * noise(22, 0.5, 1152, 55, 2.0)
    clumps = noise(23, 1.0, 1152, 16)
    patches = 0.35 * noise(24, 1.2, 1152, 7) + 0.65 * noise(25, 0.9, 1152, 14)
    return spread(0.75 * blades + 0.3 * clumps), spread(patches)


def _soil() -> Painting:
    return spread(0.6 * noise(26, 0.4, 512, 24) + 0.35 * noise(27, 1.0, 512, 8)), noise(28, 1.2, 512, 7)


def _marble() -> Painting:
    joint, slab, _ = joints(512, 2, 4, 0.004, 0.5)
    vein = np.exp(-((np.abs(noise(32, 1.8, 512) - 0.5) / 0.012) ** 2))
    tone = 0.62 + 0.25 * (noise(31, 1.6, 512) - 0.5) - 0.10 * vein + 0.12 * (noise(34, 0.3, 512, 20) - 0.5)
    tone += by_stone(33, slab, -0.1, 0.1)
    streaks = 0.6 * noise(35, 1.3, 512, 1, 9.0) + 0.4 * by_stone(36, slab)
    return np.clip(tone, 0.2, 1.0) * (1.0 - joint), streaks


def _marble_relief() -> np.ndarray:
    joint, slab, _ = joints(512, 2, 4, 0.006, 0.5)
    lean = np.stack([by_stone(37 + k, slab, -0.006, 0.006) for k in range(2)])
    return slopes(-0.004 * joint, 4.0) * 0.7 + lean


def _panel_holes(size: int) -> np.ndarray:
    x, y = grid(size)
    holes = np.zeros_like(x)
    for u in (0.15, 0.85):
        for v in (0.12, 0.38, 0.62, 0.88):
            holes = np.maximum(holes, np.clip((0.009 - np.hypot(x - u, y - v)) * size + 0.5, 0, 1))
    return holes


def _panels() -> Painting:
    joint, panel, _ = joints(512, 1, 2, 0.008)
    tone = 0.35 + 0.30 * noise(41, 1.3, 512) + 0.25 * noise(42, 0.4, 512, 8) + by_stone(44, panel, 0.0, 0.1)
    pits = noise(45, 0.3, 512, 30) > 0.994
    tone = np.clip(tone - 0.3 * pits, 0.2, 1.0) * (1.0 - np.maximum(joint, _panel_holes(512)))
    return tone, noise(43, 1.2, 512, 1, 10.0)


def _panel_relief() -> np.ndarray:
    joint, _, _ = joints(512, 1, 2, 0.010)
    groove = -0.012 * joint - 0.008 * _panel_holes(512)
    return np.clip(slopes(groove, 4.0), -0.8, 0.8) + _fine(46, 512, 2.0, 0.012, 4.0, 3)


def _bricks() -> Painting:
    joint, stone, _ = joints(512, 8, 28, 0.0048, 0.5)
    tone = by_stone(81, stone, 0.45, 0.9) + 0.3 * (noise(82, 0.5, 512, 10) - 0.5)
    return np.clip(tone, 0.3, 1.0) * (1.0 - joint), 0.75 * by_stone(83, stone) + 0.25 * noise(84, 1.4, 512)


def _brick_relief() -> np.ndarray:
    joint, stone, _ = joints(512, 8, 28, 0.0052, 0.5)
    lean = np.stack([by_stone(85 + k, stone, -0.05, 0.05) for k in range(2)])
    return np.clip(slopes(-0.006 * joint, 2.0), -0.7, 0.7) + lean * (1.0 - joint)


def _gravel() -> Painting:
    return spread(noise(47, 0.2, 512, 25) + 0.3 * noise(48, 1.2, 512)), noise(49, 1.6, 512)


def _roof_shape(size: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the curve across a roof tile (1 at its middle), the height on it (0 at its lower edge), and its number."""
    x, y = grid(size)
    row = np.floor(y * 8).astype(int)
    along = x * 8 + 0.5 * (row % 2)
    curve = 0.5 + 0.5 * np.cos(2 * np.pi * (along % 1.0 - 0.5))
    return curve, (y * 8) % 1.0, row * 8 + np.floor(along).astype(int) % 8


def _roof_tiles() -> Painting:
    curve, way, number = _roof_shape(512)
    tone = 0.5 + 0.22 * curve + by_stone(61, number, -0.15, 0.15) + 0.25 * (noise(62, 0.5, 512, 6) - 0.5)
    shadow = np.clip((way - 0.90) * 12, 0, 1)  # below the lower edge of the next row
    moss = np.clip((noise(64, 1.0, 512, 3) - 0.8) * 5, 0, 1)
    return np.clip(tone * (1.0 - 0.75 * shadow) * (0.35 + 0.65 * np.sqrt(curve)), 0, 1), np.where(
        moss > 0.3, 0.0, 0.15 + 0.85 * by_stone(63, number)
    )


def _roof_relief() -> np.ndarray:
    curve, way, _ = _roof_shape(512)
    height = 0.03 * curve - 0.03 * way
    return np.clip(slopes(height, 2.4), -0.9, 0.9)


def _boards(seed: int, boards: int, seam: float) -> Painting:
    x, _ = grid(512)
    board = np.floor(x * boards).astype(int)
    edge = np.minimum((x * boards) % 1.0, 1.0 - (x * boards) % 1.0) / boards
    gap = np.clip((0.5 * seam - edge) * 512 + 0.5, 0, 1)
    shift = np.random.default_rng(seed).integers(0, 512, boards)[board]
    rows, columns = np.meshgrid(np.arange(512), np.arange(512), indexing="ij")
    grain = noise(seed + 1, 0.8, 512, 3, 20.0)[(rows + shift) % 512, columns]
    tone = by_stone(seed + 2, board, 0.40, 0.70) + 0.6 * (grain - 0.5)
    return np.clip(tone, 0.05, 1.0) * (1.0 - 0.9 * gap), by_stone(seed + 3, board)


def _planks() -> Painting:
    return _boards(51, 12, 0.006)


def _shuttering() -> Painting:
    joint, panel, _ = joints(512, 2, 4, 0.005)
    cast = 0.35 * noise(152, 1.0, 512, 6) + 0.45 * noise(153, 0.4, 512, 30) + by_stone(154, panel, 0.0, 0.2)
    pores = noise(155, 0.3, 512, 40) > 0.996
    return np.clip(0.2 + 0.8 * cast - 0.3 * pores, 0.2, 1.0) * (1.0 - joint), noise(156, 1.3, 512, 4)


def _plank_relief() -> np.ndarray:
    tone, hue = _planks()
    lean = np.stack([0.06 * (hue - 0.5), np.zeros_like(hue)])
    return np.clip(slopes(0.004 * np.minimum(tone, 0.3), 1.5), -0.6, 0.6) + lean


@cache
def _bark_height() -> np.ndarray:
    ridges = 1.0 - 2.0 * np.abs(noise(53, 1.2, 256, 4, 4.5) - 0.5)
    return spread(ridges + 0.35 * noise(54, 0.8, 256, 10, 2.0))


def _bark() -> Painting:
    return 1.0 - _bark_height(), noise(55, 1.5, 256)


def _bark_relief() -> np.ndarray:
    return np.clip(slopes(-0.018 * _bark_height(), 1.0), -1.2, 1.2)


@cache
def _leaves() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return leaves(101, 512, 1900, (0.06, 0.10), 0.42)


def _foliage() -> Painting:
    tone, hue, _ = _leaves()
    deep = np.clip(1.6 * (noise(102, 2.0, 512, 2) - 0.15), 0.0, 1.0)
    return np.clip(tone * (0.35 + 0.65 * deep), 0, 1), 0.75 * hue + 0.25 * noise(103, 2.0, 512)


def _foliage_relief() -> np.ndarray:
    return np.clip(_leaves()[2], -1.0, 1.0)


_TILES: dict[str, Tile] = {
    "asphalt": Tile(
        _asphalt, _grey(0.35, 1.75), ((0.0, (0.78, 0.78, 0.79)), (0.4, (0.96, 0.96, 0.96)), (1.0, (1.18, 1.175, 1.16))),
        12.0, lambda: _fine(14, 256, 0.25, 0.006, 1.5, 12), 1.5, roughness=1.2,
    ),
    "road_marking": Tile(
        _marking, ((0.0, (0.12, 0.12, 0.12)), (0.6, (0.85, 0.85, 0.85)), (1.0, (1.1, 1.1, 1.1))),
        ((0.0, (0.9, 0.89, 0.86)), (1.0, (1.0, 1.0, 1.0))), 2.0, roughness=-0.25,
    ),
    "concrete_sidewalk": Tile(
        _slabs, _with_joints(0.35, 0.72, 1.22), ((0.0, (0.84, 0.83, 0.81)), (1.0, (1.08, 1.08, 1.08))), 4.0,
        _slab_relief,
    ),
    "curb": Tile(
        _kerbstones, _with_joints(0.4, 0.75, 1.15), ((0.0, (0.85, 0.84, 0.82)), (1.0, (1.05, 1.05, 1.06))), 2.0
    ),
    "grass": Tile(
        _grass, ((0.0, (0.35, 0.38, 0.42)), (0.55, (1.0, 1.0, 1.0)), (1.0, (1.9, 1.7, 1.7))),
        ((0.0, (0.72, 0.82, 0.78)), (0.45, (0.95, 1.0, 0.95)), (0.8, (1.15, 1.08, 1.08)), (1.0, (1.5, 1.18, 1.4))),
        16.0, lambda: _fine(29, 256, 0.3, 0.03, 3.0, 12), 3.0,
    ),
    "soil": Tile(
        _soil, ((0.0, (0.5, 0.5, 0.5)), (1.0, (1.5, 1.45, 1.4))), ((0.0, (0.8, 0.8, 0.82)), (1.0, (1.15, 1.12, 1.1))),
        8.0, lambda: _fine(30, 256, 0.8, 0.05, 4.0, 4), 4.0,
    ),
    "marble_facade": Tile(
        _marble, _with_joints(0.45, 0.78, 1.12), ((0.0, (0.88, 0.86, 0.82)), (1.0, (1.05, 1.05, 1.06))), 4.0,
        _marble_relief, roughness=-0.15,
    ),
    "concrete_facade": Tile(
        _panels, _with_joints(0.3, 0.75, 1.2), ((0.0, (0.82, 0.81, 0.78)), (1.0, (1.1, 1.1, 1.1))), 4.0, _panel_relief,
    ),
    "brick_facade": Tile(
        _bricks, ((0.05, (1.55, 3.2, 4.0)), (0.2, (0.62, 0.58, 0.55)), (1.0, (1.3, 1.15, 1.05))),
        ((0.0, (0.66, 0.72, 0.85)), (0.5, (1.0, 1.0, 1.0)), (1.0, (1.25, 1.35, 1.3))), 2.0, _brick_relief,
    ),
    "concrete_roof": Tile(_gravel, _grey(0.6, 1.45), _grey(0.8, 1.1), 3.0),
    "tile_roof": Tile(
        _roof_tiles, ((0.0, (0.25, 0.25, 0.27)), (1.0, (1.6, 1.5, 1.45))),
        ((0.0, (0.62, 1.25, 1.0)), (0.12, (0.7, 0.85, 0.9)), (0.5, (1.0, 1.0, 1.0)), (1.0, (1.2, 1.4, 1.5))), 2.4,
        _roof_relief,
    ),
    "concrete_structure": Tile(_shuttering, _with_joints(0.6, 0.86, 1.13), _grey(0.95, 1.04), 4.0),
    "wood": Tile(
        _planks, ((0.0, (0.22, 0.2, 0.2)), (1.0, (1.65, 1.65, 1.6))),
        ((0.0, (0.85, 0.87, 0.9)), (1.0, (1.12, 1.1, 1.05))), 1.5, _plank_relief,
    ),
    "bark": Tile(_bark, _grey(0.3, 1.7), ((0.0, (0.85, 0.88, 0.9)), (1.0, (1.1, 1.08, 1.05))), 1.0, _bark_relief),
    "foliage": Tile(
        _foliage, ((0.0, (0.10, 0.12, 0.12)), (0.5, (0.9, 0.9, 0.9)), (1.0, (2.2, 2.0, 1.9))),
        ((0.0, (0.75, 0.85, 0.9)), (0.5, (1.0, 1.0, 1.0)), (1.0, (1.45, 1.2, 1.1))), 2.0, _foliage_relief,
    ),
}  # fmt: skip
TILES: Mapping[str, Tile] = {
    **_TILES,
    "foliage_light": replace(_TILES["foliage"], file="foliage", tint=(1.4, 1.2, 1.0)),
    "foliage_dark": replace(_TILES["foliage"], file="foliage", tint=(0.7, 0.75, 1.0)),
}
"""Material -> its tile. Tones and sizes are design values; bricks are 250 x 71 mm with joints of 10 mm, paving slabs
0.5 m, roof tiles 0.3 m, leaves 12 to 20 cm."""


def _along(tones: Tones, levels: int) -> np.ndarray:
    """Return the colors of the middles of `levels` steps along tones, shape [levels, 3]."""
    where, positions = (np.arange(levels) + 0.5) / levels, [position for position, _ in tones]
    return np.stack([np.interp(where, positions, [tone[k] for _, tone in tones]) for k in range(3)], axis=1)


@cache
def tile_pixels(tile: Tile, color: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return a tile as palette image; the same arrays every time.

    Returns:
        Palette index of every pixel, rows downward, shape [N, N], uint8, and sRGB colors, shape [256, 3].
    """
    count, hues = LEVELS
    steps = [np.clip(np.floor(f[::-1] * n), 0, n - 1) for f, n in zip(tile.painting(), LEVELS, strict=True)]
    index = (steps[0] * hues + steps[1]).astype(np.uint8)
    mixed = (_along(tile.tones, count)[:, None] * _along(tile.hues, hues)[None]).reshape(-1, 3)
    share = np.bincount(index.ravel(), minlength=count * hues) / index.size
    linear = mixed
    for _ in range(8):  # what is lost where a color is too bright comes back to all others
        linear = np.clip(linear / (share @ linear) * np.asarray(color), 0.0, 1.0)
    return index, srgb(linear)


def srgb(linear: np.ndarray) -> np.ndarray:
    """Return linear colors, 0 to 1, as sRGB bytes. Source: IEC 61966-2-1."""
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 1e-9) ** (1 / 2.4) - 0.055)
    return np.rint(255.0 * encoded).astype(np.uint8)


def write_tile(path: Path, tile: Tile, color: tuple[float, float, float]) -> None:
    """Write a tile as PNG with a palette, and its normals beside it as `<name>_normal.png`."""
    index, palette = tile_pixels(tile, color)
    image = Image.frombytes("P", index.shape[::-1], np.ascontiguousarray(index).tobytes())
    image.putpalette(palette.tobytes())
    path.parent.mkdir(parents=True, exist_ok=True)
    image.save(path, optimize=True)
    if tile.relief:
        Image.fromarray(normal_pixels(tile)).save(path.with_name(f"{path.stem}_normal.png"), optimize=True)


def normal_pixels(tile: Tile) -> np.ndarray:
    """Return the normals of a tile as bytes (n + 1) 127.5, rows downward, shape [N, N, 3].

    Raises:
        InputError: If the tile has no relief.
    """
    if tile.relief is None:
        raise InputError("texture: the tile has no relief; give it one, or write no normals")
    right, up = tile.relief()[:, ::-1]
    length = np.sqrt(1.0 + right**2 + up**2)
    bent = np.stack([-right / length, -up / length], axis=-1)
    xy = 128.0 + SLOPE_STEP * np.rint(bent * 127.5 / SLOPE_STEP)  # 128 is level
    z = np.sqrt(np.maximum(1.0 - ((xy - 128.0) / 127.5) ** 2 @ np.ones((2, 1)), 0.0))
    return np.concatenate([xy, np.rint(127.5 * (z + 1.0))], axis=-1).astype(np.uint8)


def roughness_scale(tile: Tile, color: tuple[float, float, float], mean: float) -> tuple[float, float]:
    """Return scale and bias that make roughness of the red channel of a tile's file, so that its mean is `mean`."""
    index, palette = tile_pixels(tile, color)
    share = np.bincount(index.ravel(), minlength=len(palette)) / index.size
    return tile.roughness, round(mean - tile.roughness * float(share @ palette[:, 0]) / 255.0, 4)
