"""Encode images for the cells of tables, and decode them. `mmw.storage.codecs.carla_depth` has CARLA's formats."""

import io
from collections.abc import Callable
from typing import Any, TypeAlias

import numpy as np
import simplejpeg
from numpy.typing import ArrayLike
from PIL import Image

from mmw.storage.codecs.png16 import decode_png16, encode_png16
from mmw.storage.table_spec import DEPTH_STEP_M

PNG_LEVEL = 1
"""zlib level of PNG images: half the time of level 6 for depth, half as large again; a quarter to a half of it for
colors, a tenth larger."""

NORMAL_STEPS = 127
"""Steps of a unit normal's component from 0 to 1; 128 is 0. Design value: whole axes are exact, 0.4 deg."""

FLOW_STEPS = 64
"""Steps of a pixel of stored flow; 2^15 is 0. Source: KITTI 2015 flow development kit."""

FLOW_ZERO = 2**15
"""See `FLOW_STEPS`."""


def encode_rgb(image: np.ndarray, format_: str, quality: int, subsampling: str = "4:2:0") -> bytes:
    """Return an RGB image as a JPEG file, or as an 8-bit PNG.

    libjpeg-turbo, which works outside Python's lock, transforms fast below quality 96 and accurately from there on;
    `mmw.sensors.render.jpeg` writes the same bytes on a GPU.

    Args:
        image: sRGB values, shape [H, W, 3], uint8.
        format_: `jpeg` or `png`.
        quality: Quality of a JPEG file, 1 to 100.
        subsampling: Of a JPEG file's chroma: `4:2:0` or `4:4:4`.

    Raises:
        ValueError: If the array is not an image of 8-bit colors.
    """
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8:
        raise ValueError(f"RGB image: {image.dtype} of shape {image.shape}; one image is uint8 [H, W, 3]; give that")
    if format_ == "png":
        return _png(image)
    plain = np.ascontiguousarray(image)
    return simplejpeg.encode_jpeg(
        plain, quality, colorspace="RGB", colorsubsampling=subsampling.replace(":", ""), fastdct=False
    )


def _rgb_pixels(image: np.ndarray, format_: str, *_: Any) -> np.ndarray | None:
    return image if format_ == "png" else None


def encode_depth(depth: np.ndarray) -> bytes:
    """Return a depth image as a 16-bit PNG.

    Args:
        depth: Depth along the optical axis [cm], 0 = no return, shape [H, W], uint16.

    Raises:
        ValueError: If the array is not an image of 16-bit numbers.
    """
    return _png(_depth_pixels(depth))


def _depth_pixels(depth: np.ndarray) -> np.ndarray:
    if depth.ndim != 2 or depth.dtype != np.uint16:
        raise ValueError(
            f"depth image: {depth.dtype} of shape {depth.shape}; one image is uint16 [H, W] in centimeters"
        )
    return depth


def encode_instance(object_id: np.ndarray) -> bytes:
    """Return object ids, -1 for nothing, at most 65,534, int32 [H, W], as a 16-bit PNG: id + 1, 0 for nothing."""
    return _png(_instance_pixels(object_id))


def _instance_pixels(object_id: np.ndarray) -> np.ndarray:
    return (object_id + 1).astype(np.uint16)


def encode_semantic(object_id: np.ndarray, tags: np.ndarray) -> bytes:
    """Return object ids, -1 for nothing, int32 [H, W], as an 8-bit PNG of CARLA tags, those of `object_tags`."""
    return _png(_semantic_pixels(object_id, tags))


def _semantic_pixels(object_id: np.ndarray, tags: np.ndarray) -> np.ndarray:
    return tags[object_id]


def encode_normals(normals: np.ndarray) -> bytes:
    """Return an image of surface normals as an 8-bit PNG: value = round(127 n) + 128 for x, y, z; 0, 0, 0 = nothing.

    Normals are unit vectors in the sensor frame (x forward, y left, z up), zero for nothing, float32 [H, W, 3].
    """
    return _png(_normal_pixels(normals))


def _normal_pixels(normals: np.ndarray) -> np.ndarray:
    value = np.rint(normals * NORMAL_STEPS).astype(np.int16) + NORMAL_STEPS + 1
    value[(normals == 0.0).all(axis=2)] = 0
    return value.astype(np.uint8)


def encode_flow(flow: np.ndarray) -> bytes:
    """Return optical flow as KITTI's 16-bit PNG: red = 64 u + 2^15, green = 64 v + 2^15, blue = 1; 0, 0, 0 = none.

    Flow is the motion of each pixel's point to the next frame, u to the right and v down [px], float32 [H, W, 2]; not
    finite or 512 px and more, which the file cannot hold, counts as none.
    """
    return encode_png16(_flow_pixels(flow), PNG_LEVEL)


def _flow_pixels(flow: np.ndarray) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        steps = np.rint(flow * FLOW_STEPS) + FLOW_ZERO
        is_told = ((steps >= 1) & (steps <= 65_535)).all(axis=2)
    value = np.zeros((*flow.shape[:2], 3), dtype=np.uint16)
    value[is_told, :2] = steps[is_told]
    value[is_told, 2] = 1
    return value


Stored: TypeAlias = bytes | np.ndarray
"""An image file, or the values of the pixels that it would have (`lossless_pixels`)."""

_PIXELS: dict[Callable[..., bytes], Callable[..., np.ndarray | None]] = {
    encode_rgb: _rgb_pixels,
    encode_depth: _depth_pixels,
    encode_instance: _instance_pixels,
    encode_semantic: _semantic_pixels,
    encode_normals: _normal_pixels,
    encode_flow: _flow_pixels,
}


def lossless_pixels(encode: Callable[..., bytes], *args: Any) -> np.ndarray | None:
    """Return the values of the pixels of the file `encode(*args)`, without making it; None if it is with loss.

    The decoders of this module take them for the file.
    """
    return _PIXELS[encode](*args) if encode in _PIXELS else None


def _values(data: Stored) -> np.ndarray:
    return data if isinstance(data, np.ndarray) else np.asarray(Image.open(io.BytesIO(data)))


def decode_rgb(data: Stored) -> np.ndarray:
    """Return a stored RGB image, sRGB values, uint8 [H, W, 3]."""
    if isinstance(data, np.ndarray):
        return data.copy()
    return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), dtype=np.uint8)


def decode_normals(data: Stored) -> np.ndarray:
    """Return stored normals in the sensor frame, unit length, zero where nothing was hit, float32 [H, W, 3]."""
    value = _values(data).astype(np.float32)
    normals = np.where(value.any(axis=2, keepdims=True), (value - NORMAL_STEPS - 1) / NORMAL_STEPS, np.float32(0.0))
    length = np.linalg.norm(normals, axis=2, keepdims=True)
    return (normals / np.where(length > 0.0, length, 1.0)).astype(np.float32)


def decode_flow(data: Stored) -> np.ndarray:
    """Return stored flow, u to the right and v down [px], NaN where there is none, float32 [H, W, 2].

    Raises:
        ValueError: If it is no image of the table `flow`.
    """
    value = data if isinstance(data, np.ndarray) else decode_png16(data)
    flow = (value[..., :2].astype(np.float32) - FLOW_ZERO) / FLOW_STEPS
    return np.where(value[..., 2:] > 0, flow, np.float32(np.nan))


def decode_depth(data: Stored) -> np.ndarray:
    """Return a stored depth image in meters, float32 [H, W], inf where nothing was hit."""
    values = _values(data).astype(np.float32)
    return np.where(values > 0, values * np.float32(DEPTH_STEP_M), np.float32(np.inf))


def decode_metres(data: Stored, depth_m: ArrayLike | None) -> np.ndarray:
    """Return a depth image [m], inf for nothing, float32 [H, W]: unrounded where the column `depth_m` has it."""
    image = decode_depth(data)
    if depth_m is None:
        return image
    metres = np.asarray(depth_m, dtype=np.float32).reshape(image.shape)
    return np.where(metres > 0.0, metres, np.float32(np.inf))


def decode_instance(data: Stored) -> np.ndarray:
    """Return the object id in each pixel of a stored instance image, -1 where nothing was hit, int32 [H, W]."""
    return _values(data).astype(np.int32) - 1


def decode_semantic(data: Stored) -> np.ndarray:
    """Return the CARLA tag in each pixel of a stored semantic image, uint8 [H, W]."""
    return _values(data).astype(np.uint8)


def _png(image: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, format="PNG", compress_level=PNG_LEVEL)
    return buffer.getvalue()
