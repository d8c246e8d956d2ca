"""Compute the clouds of a sky and their light: heaps for a broken sky, a soft sheet for an overcast one."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

import functools
import math

import numpy as np
import warp as wp

from mmw.kernels.shading.clouds import HEAP_GROWTH, HEAP_HEIGHT, Clouds, clouds_kernel

BOTTOM_M, DEPTH_M = 1_500.0, 900.0
"""Height of the bottoms of the heaps and from there to the highest tops [m]. Source: fair-weather cumulus, WMO
International Cloud Atlas."""

EXTINCTION_PER_M = 0.03
"""Extinction inside a heap [1/m]. Source: 0.01 to 0.1 in cumulus, Hess et al. 1998 (OPAC)."""

COVER_CELLS, COVER_M = 256, 20_000.0
"""Cells along a side of the pattern of clouds, and its side [m]. Design values."""

DETAIL_CELLS, DETAIL_M = 64, 2_000.0
"""The same of the pattern of their lumps."""

OFFSETS = 64
"""Places in the pattern where the viewer may be; the first is used from which the sun is freest of clouds."""


def ranks(values: np.ndarray) -> np.ndarray:
    """Return the rank of every value, 0 to 1, same shape: evenly spread, so that a threshold is a share."""
    order = np.empty(values.size)
    order[np.argsort(values, axis=None, kind="stable")] = (np.arange(values.size) + 0.5) / values.size
    return order.reshape(values.shape)


def random_field(shape: tuple[int, ...], low: float, high: float, slope: float, seed: int) -> np.ndarray:
    """Return ranks of a repeating random field whose amplitude falls as frequency to minus `slope`.

    Args:
        shape: Of the field.
        low: Frequency below which there is little [cycles a side].
        high: Frequency above which there is nothing [cycles a side].
        slope: Of the spectrum.
        seed: Of the random numbers.
    """
    axes = [np.fft.fftfreq(n, 1.0 / n) for n in shape]
    frequency = np.sqrt(sum(axis**2 for axis in np.meshgrid(*axes, indexing="ij")))
    amplitude = np.where(frequency > 0.0, (frequency**2 + low**2) ** (-0.5 * slope), 0.0)
    amplitude *= np.exp(-((frequency / high) ** 4))
    noise = np.fft.fftn(np.random.Generator(np.random.Philox(seed)).standard_normal(shape))
    return ranks(np.fft.ifftn(noise * amplitude).real)


@functools.lru_cache(maxsize=4)
def fields(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the patterns of clouds and of their lumps by a seed, shapes [COVER_CELLS] * 2 and [DETAIL_CELLS] * 3."""
    cover = random_field((COVER_CELLS,) * 2, 9.0, 90.0, 2.6, 2 * seed)
    detail = random_field((DETAIL_CELLS,) * 3, 3.0, 20.0, 2.2, 2 * seed + 1)
    return cover.astype(np.float32), detail.astype(np.float32)


def viewpoint(cover: np.ndarray, to_sun: np.ndarray) -> tuple[float, float]:
    """Return the place of the viewer in the pattern [m], where no cloud hides the sun if there is one."""
    if to_sun[2] < 0.05:
        return 0.0, 0.0
    places = (np.arange(OFFSETS) * 0.7548776662466927 % 1.0, np.arange(OFFSETS) * 0.5698402909980532 % 1.0)
    near = np.arange(-400.0, 401.0, 100.0)
    worst = np.zeros(OFFSETS)
    for height in (BOTTOM_M, BOTTOM_M + 0.5 * DEPTH_M):
        x, y = to_sun[:2] * (height / to_sun[2])
        i = np.floor((places[0] * COVER_M + x + near[:, None]) / COVER_M * COVER_CELLS).astype(int) % COVER_CELLS
        j = np.floor((places[1] * COVER_M + y + near[:, None]) / COVER_M * COVER_CELLS).astype(int) % COVER_CELLS
        worst = np.maximum(worst, cover[j[:, None], i[None]].max(axis=(0, 1)))
    best = int(np.argmin(worst))
    return float(places[0][best] * COVER_M), float(places[1][best] * COVER_M)


def heaps(directions: np.ndarray, to_sun: np.ndarray, cover: float, seed: int) -> np.ndarray:
    """Return the light of heaped clouds in directions, shape [R, C, 4]; see `mmw.kernels.shading.clouds.clouds_kernel`.

    Args:
        directions: Unit vectors, scene frame, shape [R, C, 3].
        to_sun: Unit vector to the sun.
        cover: Share of the sky under clouds, 0 to 1.
        seed: Of the pattern.
    """
    pattern, detail = fields(seed)
    clouds = Clouds()
    clouds.cover = wp.array(pattern, dtype=float, device="cpu")
    clouds.detail = wp.array(detail, dtype=float, device="cpu")
    clouds.cover_size, clouds.detail_size = COVER_M, DETAIL_M
    clouds.offset = wp.vec2(*viewpoint(pattern, to_sun))
    clouds.threshold = 1.0 - cover**0.85  # lumps remove some
    clouds.bottom, clouds.depth, clouds.extinction = BOTTOM_M, DEPTH_M, EXTINCTION_PER_M
    highest = HEAP_HEIGHT * (1.0 - math.exp(-HEAP_GROWTH * (1.0 - clouds.threshold)))  # of the highest rank, 1
    clouds.highest = 1.0001 * highest  # float32 rounds
    clouds.sun_direction = wp.vec3(*to_sun)
    at = wp.array(directions.astype(np.float32), dtype=wp.vec3, device="cpu")
    light = wp.empty(directions.shape[:2], dtype=wp.vec4, device="cpu")
    wp.launch(clouds_kernel, directions.shape[:2], inputs=[clouds, at], outputs=[light], device="cpu")
    return light.numpy()


def sheet(directions: np.ndarray, seed: int) -> np.ndarray:
    """Return the soft pattern of an overcast sky in directions, -1 to 1, mean about 0, fading to 0 at the horizon.

    Args:
        directions: Unit vectors of the upper half, scene frame, shape [R, C, 3].
        seed: Of the pattern.
    """
    cover, _ = fields(seed)
    z = np.maximum(directions[..., 2], 0.02)
    out = np.zeros(directions.shape[:2])
    for share, size in ((0.6, 1.0), (0.4, 0.37)):
        scale = BOTTOM_M * 0.7 / z / (COVER_M * size) * COVER_CELLS
        x, y = directions[..., 0] * scale, directions[..., 1] * scale
        i, j = np.floor(x).astype(int), np.floor(y).astype(int)
        u, v = x - i, y - j
        i0, i1, j0, j1 = i % COVER_CELLS, (i + 1) % COVER_CELLS, j % COVER_CELLS, (j + 1) % COVER_CELLS
        upper = cover[j0, i0] * (1.0 - u) + cover[j0, i1] * u
        lower = cover[j1, i0] * (1.0 - u) + cover[j1, i1] * u
        out += share * (2.0 * (upper * (1.0 - v) + lower * v) - 1.0)
    return out * np.clip((directions[..., 2] - 0.02) / 0.25, 0.0, 1.0)
