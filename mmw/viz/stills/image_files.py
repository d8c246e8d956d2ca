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
    """Return images [H, W, 3], uint8, all of one size, in rows from the top left, with `GAP_PX` of white between."""
    space = ((0, GAP_PX), (0, GAP_PX), (0, 0))
    whole = [np.concatenate([np.pad(tile, space, constant_values=255) for tile in row], axis=1) for row in rows]
    return Image.fromarray(np.concatenate(whole)[:-GAP_PX, :-GAP_PX])
