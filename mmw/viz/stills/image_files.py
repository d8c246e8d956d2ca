"""Pictures for documents: tiles joined to one image, and JPEG files as good as a limit of bytes allows."""

import io
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

QUALITIES = (90, 85, 80, 75, 70, 65, 60, 50, 40, 30)
"""Qualities that are tried, best first. Design values."""

GAP_PX = 4
"""White between tiles [px]."""


def save_jpeg(image: Image.Image, path: Path, max_bytes: int) -> None:
    """Write a picture as JPEG below a size [bytes], with the best of `QUALITIES` that fits, else with the worst."""
    data = b""
    for quality in QUALITIES:
        buffer = io.BytesIO()
        image.save(buffer, format="JPEG", quality=quality, optimize=True)
        data = buffer.getvalue()
        if len(data) < max_bytes:
            break
    path.write_bytes(data)


def join_tiles(rows: Sequence[Sequence[np.ndarray]]) -> Image.Image:
    """Return images [H, W, 3], uint8, in rows from the top left as one picture, with `GAP_PX` of white between them."""
    height = sum(max(image.shape[0] for image in row) + GAP_PX for row in rows) - GAP_PX
    width = max(sum(image.shape[1] + GAP_PX for image in row) for row in rows) - GAP_PX
    whole, top = np.full((height, width, 3), 255, dtype=np.uint8), 0
    for row in rows:
        left = 0
        for image in row:
            whole[top : top + image.shape[0], left : left + image.shape[1]] = image
            left += image.shape[1] + GAP_PX
        top += max(image.shape[0] for image in row) + GAP_PX
    return Image.fromarray(whole)
