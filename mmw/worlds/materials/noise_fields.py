"""Make the fields of texture tiles: seamless noise, stones with joints, cracks, leaves. Square arrays, 0 to 1.

Rows run upward, so row 0 is the lower edge of a tile.
"""

import numpy as np


def noise(seed: int, slope: float, size: int, low: float = 0.0, stretch: float = 1.0) -> np.ndarray:
    """Return seamless noise with a power-law spectrum, spread evenly over 0 to 1, shape [size, size].

    Args:
        seed: Seed.
        slope: Amplitude falls as frequency to the minus `slope`; 0 is white noise.
        size: Side [px].
        low: Frequencies below this many waves a tile are left out.
        stretch: How many times longer blots are upward than across.
    """
    white = np.random.default_rng(seed).standard_normal((size, size))
    wave = np.fft.fftfreq(size, 1.0 / size)
    across, upward = np.meshgrid(wave, wave * stretch)
    frequency = np.hypot(across, upward)
    gain = np.where(frequency > low, np.maximum(frequency, 1.0) ** -slope, 0.0)
    gain[0, 0] = 0.0
    return spread(np.fft.ifft2(np.fft.fft2(white) * gain).real)


def spread(values: np.ndarray) -> np.ndarray:
    """Return the ranks of the values, 0 to 1; a micro-unit of difference counts as none."""
    count = values.size
    # One number for value and place, so that equal values keep their order; sorting numbers is fast.
    keys = np.sort(np.rint(1e6 * values.ravel()).astype(np.int64) * count + np.arange(count))
    rank = np.empty(count)
    rank[keys % count] = np.arange(count) / (count - 1)
    return rank.reshape(values.shape)


def grid(size: int) -> tuple[np.ndarray, np.ndarray]:
    """Return x to the right and y upward of the pixels' middles, 0 to 1, each [size, size]."""
    middle = (np.arange(size) + 0.5) / size
    x, y = np.meshgrid(middle, middle)
    return x, y


def joints(
    size: int, columns: int, rows: int, width: float, shift: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return how deep in a joint each pixel of a wall of stones lies, and which stone it belongs to.

    Args:
        size: Side [px].
        columns: Stones a row.
        rows: Rows of stones; even if every second one is shifted.
        width: Width of a joint, as a share of the tile.
        shift: Shift of every second row, as a share of a stone.

    Returns:
        Depth of the joint, 0 on a stone, 1 in a joint, with a soft edge of one pixel; the number of the stone; the
        distance to the nearest edge of the stone, as a share of the tile; each [size, size].
    """
    x, y = grid(size)
    row = np.floor(y * rows).astype(int)
    along = x * columns + shift * (row % 2)
    column = np.floor(along).astype(int) % columns
    across = np.minimum((along % 1.0), 1.0 - along % 1.0) / columns
    upward = np.minimum((y * rows) % 1.0, 1.0 - (y * rows) % 1.0) / rows
    edge = np.minimum(across, upward)
    return np.clip((0.5 * width - edge) * size + 0.5, 0.0, 1.0), row * columns + column, edge


def by_stone(seed: int, stone: np.ndarray, low: float = 0.0, high: float = 1.0) -> np.ndarray:
    """Return a random number for every stone, shape of `stone`."""
    return np.random.default_rng(seed).uniform(low, high, int(stone.max()) + 1)[stone]


def lines(seed: int, size: int, slope: float, width: float, share: float = 1.0) -> np.ndarray:
    """Return winding lines: where noise passes its median, 1 in a line and 0 away from it, shape [size, size].

    Args:
        seed: Seed.
        size: Side [px].
        slope: Slope of the noise; steeper winds less.
        width: Width of a line, in pixels.
        share: Part of the area in which lines may lie.
    """
    values = noise(seed, slope, size)
    up, right = np.roll(values, -1, axis=0) - values, np.roll(values, -1, axis=1) - values
    steep = np.maximum(np.hypot(up, right), 1e-6)
    line = np.clip(0.5 * width + 0.5 - np.abs(values - 0.5) / steep, 0.0, 1.0)
    return line * (noise(seed + 1, 2.0, size) > 1.0 - share) if share < 1.0 else line


def leaves(
    seed: int, size: int, count: int, length: tuple[float, float], slim: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Lay leaves over each other on a tile without a seam.

    Args:
        seed: Seed.
        size: Side [px].
        count: Number of leaves.
        length: Shortest and longest leaf, as a share of the tile.
        slim: Width over length.

    Returns:
        Lightness: dark gaps, lighter the higher a leaf lies; a random number a leaf; slope of the surface (right, up),
        shapes [size, size], [size, size] and [2, size, size].
    """
    rng = np.random.default_rng(seed)
    tone, hue, slope = np.zeros((size, size)), np.zeros((size, size)), np.zeros((2, size, size))
    for k in range(count):
        x, y, turn = *(rng.uniform(0, size, 2)), rng.uniform(0, 2 * np.pi)
        half = 0.5 * size * rng.uniform(*length)
        tilt, shade, own = rng.normal(0.0, 0.45, 2), rng.uniform(-0.12, 0.12), rng.uniform()
        reach = int(np.ceil(half)) + 1
        columns, rows = int(x) + np.arange(-reach, reach + 1), int(y) + np.arange(-reach, reach + 1)
        dx, dy = np.meshgrid(columns + 0.5 - x, rows + 0.5 - y)
        along, aside = (dx * np.cos(turn) + dy * np.sin(turn)) / half, (dy * np.cos(turn) - dx * np.sin(turn)) / half
        outline = slim * (1.0 - along**2) * (1.0 - 0.35 * along)  # pointed at both ends, wider near the stalk
        inside = np.abs(aside) < outline
        at = np.ix_(rows % size, columns % size)
        height = 0.25 + 0.55 * (k + 1) / count + shade
        lit = height - 0.10 * (np.abs(aside) < 0.06) + 0.08 * aside / np.maximum(outline, 0.05)
        tone[at] = np.where(inside, lit, tone[at])
        hue[at] = np.where(inside, own, hue[at])
        for axis in (0, 1):
            fold = np.sign(aside) * 0.25 * (-np.sin(turn) if axis == 0 else np.cos(turn))
            slope[axis][at] = np.where(inside, tilt[axis] - fold, slope[axis][at])
    return np.clip(tone, 0.0, 1.0), hue, slope


def slopes(height: np.ndarray, size_m: float) -> np.ndarray:
    """Return the slope (to the right, upward) of a height field [m] on a tile of `size_m`, shape [2, N, N]."""
    step = 2.0 * size_m / len(height)
    right = (np.roll(height, -1, axis=1) - np.roll(height, 1, axis=1)) / step
    up = (np.roll(height, -1, axis=0) - np.roll(height, 1, axis=0)) / step
    return np.stack([right, up])
