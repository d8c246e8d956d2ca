"""JPEG files of pictures for documents: as good as a limit of bytes allows."""

import io
from pathlib import Path

from PIL import Image

QUALITIES = (90, 85, 80, 75, 70, 65, 60, 50, 40, 30)
"""Qualities that are tried, best first. Design values."""


def save_jpeg(image: Image.Image, path: Path, most_bytes: int) -> None:
    """Write a picture as JPEG with the best quality that fits; the worst of `QUALITIES` where none does.

    Args:
        image: RGB picture.
        path: File to write.
        most_bytes: Size that the file should stay below [bytes].
    """
    data = b""
    for quality in QUALITIES:
        buffer = io.BytesIO()
        image.save(buffer, format="JPEG", quality=quality, optimize=True)
        data = buffer.getvalue()
        if len(data) < most_bytes:
            break
    path.write_bytes(data)
