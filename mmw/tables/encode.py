"""Images as a cell of a table holds them."""

import io

import numpy as np
from PIL import Image

from mmw.tables.schema.columns import DEPTH_STEP_M

PNG_LEVEL = 1
"""zlib level of depth images: half the time of level 6, half as large again."""


def encode_depth(depth: np.ndarray) -> bytes:
    """Return a depth image as a 16-bit PNG.

    Args:
        depth: Depth along the optical axis [cm], 0 = no return, shape [H, W], uint16.

    Raises:
        ValueError: If the array is not an image of 16-bit numbers.
    """
    if depth.ndim != 2 or depth.dtype != np.uint16:
        raise ValueError(
            f"depth image: {depth.dtype} of shape {depth.shape}; one image is uint16 [H, W] in centimetres"
        )
    buffer = io.BytesIO()
    Image.fromarray(depth).save(buffer, format="PNG", compress_level=PNG_LEVEL)
    return buffer.getvalue()


def decode_depth(data: bytes) -> np.ndarray:
    """Return a stored depth image in metres, float32 [H, W], inf where nothing was hit."""
    values = np.asarray(Image.open(io.BytesIO(data)), dtype=np.float32)
    return np.where(values > 0, values * np.float32(DEPTH_STEP_M), np.float32(np.inf))
