"""Images as a cell of a table holds them, and back. `mmw.tables.depth_codes` has CARLA's encodings of depth."""

import io

import numpy as np
from PIL import Image

from mmw.sensors.segmentation import instance_image, semantic_image
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
    return _png(depth)


def encode_instance(object_id: np.ndarray) -> bytes:
    """Return an instance image as a 16-bit PNG: object id + 1, 0 where nothing was hit.

    Args:
        object_id: Object in each pixel, -1 for nothing, at most 65,534, shape [H, W], int32.
    """
    return _png(instance_image(object_id))


def encode_semantic(object_id: np.ndarray, tags: np.ndarray) -> bytes:
    """Return a semantic image as an 8-bit PNG of CARLA tags.

    Args:
        object_id: Object in each pixel, -1 for nothing, shape [H, W], int32.
        tags: What `mmw.sensors.segmentation.object_tags` returns.
    """
    return _png(semantic_image(object_id, tags))


def decode_depth(data: bytes) -> np.ndarray:
    """Return a stored depth image in metres, float32 [H, W], inf where nothing was hit."""
    values = np.asarray(Image.open(io.BytesIO(data)), dtype=np.float32)
    return np.where(values > 0, values * np.float32(DEPTH_STEP_M), np.float32(np.inf))


def decode_instance(data: bytes) -> np.ndarray:
    """Return the object id in each pixel of a stored instance image, -1 where nothing was hit, int32 [H, W]."""
    return np.asarray(Image.open(io.BytesIO(data)), dtype=np.int32) - 1


def decode_semantic(data: bytes) -> np.ndarray:
    """Return the CARLA tag in each pixel of a stored semantic image, uint8 [H, W]."""
    return np.asarray(Image.open(io.BytesIO(data)), dtype=np.uint8)


def _png(image: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, format="PNG", compress_level=PNG_LEVEL)
    return buffer.getvalue()
