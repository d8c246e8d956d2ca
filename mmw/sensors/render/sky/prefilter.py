"""Prefilter the sky for rough surfaces and for planes: an equirectangular map under GGX lobes and under the cosine."""

import functools
import math

import numpy as np

ROWS = 64
"""Rows of a blurred map; it has twice as many columns."""


def directions(rows: int) -> np.ndarray:
    """Return the unit vectors of the texels of a map, scene frame, shape [rows, 2 rows, 3]; see
    `mmw.kernels.shading.sky`."""
    elevation = (0.5 - (np.arange(rows) + 0.5) / rows)[:, None] * math.pi
    azimuth = (np.arange(2 * rows) + 0.5) / rows * math.pi
    level = np.cos(elevation)
    up = np.broadcast_to(np.sin(elevation), (rows, 2 * rows))
    return np.stack((level * np.sin(azimuth), level * np.cos(azimuth), up), axis=-1)


def solid_angles(rows: int) -> np.ndarray:
    """Return the solid angle of a texel in each row of a map [sr], shape [rows]."""
    return -np.diff(np.sin(math.pi * (0.5 - np.arange(rows + 1) / rows))) * math.pi / rows


def ggx_lobe(cosine: np.ndarray, roughness: float) -> np.ndarray:
    """Return the weight of light at an angle from the view, which is the normal and the direction of reflection too.

    Source: B. Karis, "Real Shading in Unreal Engine 4", SIGGRAPH 2013 (D(h) l.n with l.h = sqrt((1 + l.n) / 2));
    D of Walter et al., EGSR 2007, alpha = roughness^2.
    """
    half2 = 0.5 + 0.5 * cosine
    alpha2 = roughness**4
    return np.maximum(cosine, 0.0) / (half2 * (alpha2 - 1.0) + 1.0) ** 2


@functools.lru_cache(maxsize=16)
def kernel(roughness: float | None) -> np.ndarray:
    """Return the Fourier transform along azimuth of a lobe between two rows, weights summing to 1.

    Args:
        roughness: Of `ggx_lobe`; None for the cosine of irradiance.

    Returns:
        Shape [ROWS + 1, ROWS, ROWS], frequency, row out, row in.
    """
    at = directions(ROWS)
    # Row out at column 0 against all texels: the lobe depends on the difference of azimuth alone, and is even in it.
    cosine = np.clip(np.einsum("ok,ick->oic", at[:, 0], at), -1.0, 1.0)
    lobe = np.maximum(cosine, 0.0) if roughness is None else ggx_lobe(cosine, roughness)
    lobe *= solid_angles(ROWS)[None, :, None]
    lobe /= lobe.sum(axis=(1, 2), keepdims=True)
    return np.ascontiguousarray(np.fft.rfft(lobe, axis=2).transpose(2, 0, 1))


def blur(image: np.ndarray, roughness: float | None) -> np.ndarray:
    """Return a map under a lobe: its mean with that weight around every direction.

    Args:
        image: Shape [ROWS, 2 ROWS, K].
        roughness: Of the GGX lobe, above 0; None for the cosine, which gives irradiance over pi.
    """
    spectrum = np.fft.rfft(image, axis=1).transpose(1, 0, 2)
    return np.fft.irfft((kernel(roughness) @ spectrum).transpose(1, 0, 2), n=2 * ROWS, axis=1)


def shrink(image: np.ndarray) -> np.ndarray:
    """Return a map of `ROWS` rows: means of square blocks of texels by solid angle, shape [ROWS, 2 ROWS, K]."""
    rows = image.shape[0]
    factor = rows // ROWS
    weight = solid_angles(rows).reshape(ROWS, factor, 1, 1)
    blocks = image.reshape(ROWS, factor, 2 * ROWS * factor, -1)
    mean = (blocks * weight).sum(axis=1) / weight.sum(axis=1)
    return mean.reshape(ROWS, 2 * ROWS, factor, -1).mean(axis=2)


def octahedral(image: np.ndarray, size: int) -> np.ndarray:
    """Return an equirectangular map as an octahedral one with a border (`mmw.kernels.shading.sky`), bilinear.

    Args:
        image: Shape [rows, 2 rows, 3].
        size: Texels on a side without the border.

    Returns:
        Shape [size + 2, size + 2, 3], float32.
    """
    rows = image.shape[0]
    left, right, fu, fv = _texels_around(size, rows)
    # Beyond the poles a map goes on down its other side.
    around = np.concatenate([np.roll(image[:1], rows, axis=1), image, np.roll(image[-1:], rows, axis=1)])
    texels, line = around.astype(np.float32).reshape(-1, image.shape[2]), 2 * rows
    upper = texels.take(left, axis=0) * (1.0 - fu) + texels.take(right, axis=0) * fu
    lower = texels.take(left + line, axis=0) * (1.0 - fu) + texels.take(right + line, axis=0) * fu
    return upper * (1.0 - fv) + lower * fv


@functools.lru_cache(maxsize=4)
def _texels_around(size: int, rows: int) -> tuple[np.ndarray, ...]:
    """Return where the texels of an octahedral map lie in an equirectangular one that has a line more at either pole.

    Returns:
        The texel up left and that up right of each, counted line after line, shape [size + 2, size + 2]; how far it
        lies to the right of the one and below it, shape [size + 2, size + 2, 1], float32.
    """
    at = octahedral_directions(size)
    u = np.arctan2(at[..., 0], at[..., 1]) * (rows / math.pi) - 0.5
    v = (0.5 - np.arcsin(np.clip(at[..., 2], -1.0, 1.0)) / math.pi) * rows - 0.5
    column, row = np.floor(u).astype(int), np.floor(v).astype(int)
    fu, fv = (u - column)[..., None].astype(np.float32), (v - row)[..., None].astype(np.float32)
    line = (row + 1) * 2 * rows
    return line + column % (2 * rows), line + (column + 1) % (2 * rows), fu, fv


def octahedral_directions(size: int) -> np.ndarray:
    """Return the unit vectors of the texels of an octahedral map with its border, shape [size + 2, size + 2, 3]."""
    middle = (np.arange(-1, size + 1) + 0.5) / size * 2.0 - 1.0
    x, y = np.meshgrid(middle, middle)
    # Beyond an edge the map goes on turned about the edge's middle.
    beyond_x, beyond_y = np.abs(x) > 1.0, np.abs(y) > 1.0
    x, y = np.where(beyond_x, np.sign(x) * (2.0 - np.abs(x)), x), np.where(beyond_x, -y, y)
    x, y = np.where(beyond_y, -x, x), np.where(beyond_y, np.sign(y) * (2.0 - np.abs(y)), y)
    z = 1.0 - np.abs(x) - np.abs(y)
    fold = np.maximum(-z, 0.0)
    at = np.stack([x - np.where(x >= 0.0, fold, -fold), y - np.where(y >= 0.0, fold, -fold), z], axis=-1)
    return at / np.linalg.norm(at, axis=-1, keepdims=True)
