"""CARLA's encodings of depth, for tools that expect its files: 24-bit color, linear gray and logarithmic gray.

All of them count to 1000 m, which means the sky or anything beyond. Depth is measured along the
optical axis, as in the table `depth`: `mmw.storage.codecs.images.decode_depth` and the column `depth_m` give it in
meters.

    from PIL import Image
    Image.fromarray(encode_log_grey(decode_depth(cell["bytes"]))).save("000000_depth_camera0.png")

Source: CARLA 0.9.15, `ref_sensors.md`, depth camera, and its color converters `Depth` and `LogarithmicDepth`.
"""

import numpy as np

from mmw.core.errors import InputError

FULL_SCALE_M = 1000.0
"""Depth of the largest value, and of the sky [m]. Source: CARLA 0.9.15."""

MAX_VALUE = 2**24 - 1
"""Largest 24-bit value."""

LOG_SPAN = 5.70378
"""Natural logarithm of full scale over the depth that `LogarithmicDepth` shows black: 3.33 m. Source: CARLA 0.9.15."""


def encode_bgra(depth_m: np.ndarray) -> np.ndarray:
    """Return depth as CARLA's camera delivers it: 24 bits over four channels, in steps of 0.06 mm.

    Value = round(depth / 1000 m * (2^24 - 1)), cut off at both ends; red is its low byte, green the middle, blue the
    high one. Channels are in the order blue, green, red, alpha (255), that of CARLA's `raw_data`; for a PNG file as
    CARLA saves it use `encode_bgra(depth)[..., 2::-1]`, which is red, green, blue.

    Args:
        depth_m: Depth along the optical axis [m], inf for nothing, any shape [...].

    Returns:
        Shape [..., 4], uint8.

    Raises:
        InputError: If a depth is negative or not a number.
    """
    value = np.rint(_share(depth_m) * MAX_VALUE).astype(np.uint32)
    channels = [value >> 16, (value >> 8) & 255, value & 255, np.full_like(value, 255)]
    return np.stack(channels, axis=-1).astype(np.uint8)


def decode_bgra(image: np.ndarray) -> np.ndarray:
    """Return depth of CARLA's 24 bits, 1000 * (R + 256 G + 65536 B) / (2^24 - 1) [m], shape [...], float64.

    The sky comes back as 1000 m.

    The image is blue, green, red and perhaps alpha, shape [..., 3 or 4], uint8.

    Raises:
        InputError: If it is not an image of 8-bit colors.
    """
    image = np.asarray(image)
    if image.dtype != np.uint8 or image.ndim < 1 or image.shape[-1] not in (3, 4):
        raise InputError(
            f"depth image: {image.dtype} of shape {image.shape}; CARLA's 24 bits are uint8 [..., 3 or 4] in the order "
            "blue, green, red; give such an array"
        )
    blue, green, red = (image[..., channel].astype(np.uint32) for channel in range(3))
    return FULL_SCALE_M * (red + 256 * green + 65536 * blue) / MAX_VALUE


def encode_grey(depth_m: np.ndarray) -> np.ndarray:
    """Return depth as CARLA's `Depth` converter saves it: gray = depth / 1000 m, in 255 steps of 3.92 m.

    Args and Raises as `encode_bgra`; same shape, uint8, rounded to the nearest step; the sky is 255.
    """
    return np.rint(255.0 * _share(depth_m)).astype(np.uint8)


def decode_grey(grey: np.ndarray) -> np.ndarray:
    """Return depth of a linear gray image [m], same shape, float64; the sky comes back as 1000 m.

    Raises:
        InputError: If it is not an image of 8-bit numbers.
    """
    return FULL_SCALE_M * _bytes(grey) / 255.0


def encode_log_grey(depth_m: np.ndarray) -> np.ndarray:
    """Return depth as CARLA's `LogarithmicDepth` converter saves it: gray = 1 + ln(depth / 1000 m) / 5.70378.

    Neighboring steps differ by 2.26 %; everything nearer than 3.33 m is black, the sky is 255.

    Args and Raises as `encode_bgra`; same shape, uint8, rounded to the nearest step.
    """
    with np.errstate(divide="ignore"):
        grey = 1.0 + np.log(_share(depth_m)) / LOG_SPAN
    return np.rint(255.0 * np.clip(grey, 0.0, 1.0)).astype(np.uint8)


def decode_log_grey(grey: np.ndarray) -> np.ndarray:
    """Return depth of a logarithmic gray image, 1000 * exp((gray / 255 - 1) * 5.70378) [m], same shape, float64.

    Black comes back as 3.33 m, which means anything nearer; the sky as 1000 m.

    Raises:
        InputError: If it is not an image of 8-bit numbers.
    """
    return FULL_SCALE_M * np.exp((_bytes(grey) / 255.0 - 1.0) * LOG_SPAN)


def _share(depth_m: np.ndarray) -> np.ndarray:
    """Return depth over full scale, 0 to 1, float64."""
    depth = np.asarray(depth_m, dtype=np.float64)
    if np.isnan(depth).any() or (depth < 0.0).any():
        worst = np.nanmin(depth) if (depth < 0.0).any() else np.nan
        raise InputError(f"depth image: holds {worst} m; depths are 0 or more, inf for nothing; check what it is")
    return np.minimum(depth / FULL_SCALE_M, 1.0)


def _bytes(grey: np.ndarray) -> np.ndarray:
    grey = np.asarray(grey)
    if grey.dtype != np.uint8:
        raise InputError(f"depth image: {grey.dtype} of shape {grey.shape}; a gray image is uint8; give such an array")
    return grey.astype(np.float64)
