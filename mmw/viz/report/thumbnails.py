"""Small pictures of what sensors made: images, depth, sweeps and radar samples from above, as JPEG or PNG."""

import io
from typing import Any

import numpy as np
from PIL import Image

from mmw.storage.codecs.images import decode_depth

WIDTH_PX = 320
"""Width of a picture [px]. Design value."""

QUALITY = 70
"""JPEG quality. Design value."""

VIEW_M = 90.0
"""Height of the picture of a sweep or a radar sample [m]. Design value."""

VIEW_PX = (240, 320)
"""Height and width of such a picture [px], as those of the usual images."""

RADAR_BEHIND_M = 8.0
"""Distance shown behind the radar [m]; for a sweep it is half of the picture."""

DEPTH_M = (2.0, 150.0)
"""Ends of the logarithmic depth scale [m]."""

INTENSITY = 0.5
"""LiDAR intensity at the end of the scale."""

VELOCITY_M_S = 8.0
"""Radial velocity at the ends of the scale [m/s]."""

BACKGROUND = (20, 23, 28)

_BRIGHT = ((68, 1, 84), (59, 82, 139), (33, 145, 140), (94, 201, 98), (253, 231, 37))
_DEPTH = ((252, 253, 191), (254, 159, 109), (222, 73, 104), (140, 41, 129), (59, 15, 112), (0, 0, 4))
_VELOCITY = ((86, 180, 233), (235, 235, 235), (230, 130, 30))
"""Colours of the scales, evenly spread. Source: five points of viridis and six of magma (CC0), Okabe-Ito's blue."""


def shade(values: np.ndarray, scale: tuple[tuple[int, int, int], ...]) -> np.ndarray:
    """Return colours of values from 0 to 1, shape [..., 3], uint8."""
    at = np.linspace(0.0, 1.0, len(scale))
    clipped = np.clip(values, 0.0, 1.0)
    channels = [np.interp(clipped, at, [color[k] for color in scale]) for k in range(3)]
    return np.stack(channels, axis=-1).round().astype(np.uint8)


def image_thumb(data: bytes) -> tuple[str, bytes]:
    """Return media type and bytes of a smaller copy of a stored image."""
    with Image.open(io.BytesIO(data)) as image:
        return _jpeg(image.convert("RGB"))


def depth_thumb(data: bytes | None, metres: Any, size: tuple[int, int]) -> tuple[str, bytes]:
    """Return media type and bytes of a picture of depth, near bright and far dark, nothing white.

    Args:
        data: The stored image; None where depth is stored as numbers.
        metres: These numbers, row by row [m], 0 for nothing; None otherwise.
        size: Width and height of the image [px].
    """
    if data is not None:
        depth = decode_depth(data)
    else:
        found = np.asarray(metres, dtype=np.float32).reshape(size[1], size[0])
        depth = np.where(found > 0.0, found, np.float32(np.inf))
    low, high = np.log(DEPTH_M)
    is_there = np.isfinite(depth)
    share = (np.log(np.where(is_there, np.maximum(depth, 1e-3), 1.0)) - low) / (high - low)
    return _jpeg(Image.fromarray(np.where(is_there[..., None], shade(share, _DEPTH), np.uint8(255))))


def sweep_thumb(x: np.ndarray, y: np.ndarray, intensity: np.ndarray) -> tuple[str, bytes]:
    """Return media type and bytes of a sweep from above, ahead up; points x ahead and y left [m], shape [N] each."""
    return _dots(x, y, shade(intensity / INTENSITY, _BRIGHT), 0, VIEW_M / 2.0)


def radar_thumb(distance: np.ndarray, azimuth: np.ndarray, velocity: np.ndarray) -> tuple[str, bytes]:
    """Return media type and bytes of a radar sample from above, blue for approaching and orange for receding.

    Args:
        distance: Ranges [m], shape [N].
        azimuth: Azimuths to the left [rad], shape [N].
        velocity: Radial velocities, receding positive [m/s], shape [N].
    """
    color = shade(velocity / VELOCITY_M_S / 2.0 + 0.5, _VELOCITY)
    return _dots(distance * np.cos(azimuth), distance * np.sin(azimuth), color, 1, RADAR_BEHIND_M)


def _dots(x: np.ndarray, y: np.ndarray, color: np.ndarray, half: int, behind_m: float) -> tuple[str, bytes]:
    """Draw points as squares of 2 half + 1 pixels on a dark ground, the owner as a white cross."""
    tall, wide = VIEW_PX
    image = np.full((tall, wide, 3), BACKGROUND, dtype=np.uint8)
    per_m = tall / VIEW_M
    own = round((VIEW_M - behind_m) * per_m), wide // 2
    row = np.floor((VIEW_M - behind_m - x) * per_m).astype(np.int64)
    column = np.floor(wide / 2.0 - y * per_m).astype(np.int64)
    for down in range(-half, half + 1):
        for right in range(-half, half + 1):
            is_in = (row + down >= 0) & (row + down < tall) & (column + right >= 0) & (column + right < wide)
            image[row[is_in] + down, column[is_in] + right] = color[is_in]
    arm = 5
    image[own[0] - arm : own[0] + arm + 1, own[1]] = 255
    image[own[0], own[1] - arm : own[1] + arm + 1] = 255
    return _png(Image.fromarray(image))


def _jpeg(image: Image.Image) -> tuple[str, bytes]:
    image.thumbnail((WIDTH_PX, WIDTH_PX))
    out = io.BytesIO()
    image.save(out, "JPEG", quality=QUALITY, optimize=True)
    return "image/jpeg", out.getvalue()


def _png(image: Image.Image) -> tuple[str, bytes]:
    out = io.BytesIO()
    image.quantize(64, dither=Image.Dither.NONE).save(out, "PNG", optimize=True)
    return "image/png", out.getvalue()
