"""Write files in the formats that readers of other datasets expect."""

import io
from pathlib import Path
from typing import Any

import yaml
from PIL import Image, UnidentifiedImageError

from mmw.core.errors import InputError

_DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)


def png_of(data: bytes) -> bytes:
    """Return an image file as PNG; its pixels are unchanged.

    Raises:
        InputError: If it cannot be decoded.
    """
    stream = io.BytesIO()
    try:
        with Image.open(io.BytesIO(data)) as image:
            image.save(stream, "PNG", compress_level=1)  # a quarter of the default level's time, 5 % more bytes
    except (OSError, SyntaxError, ValueError, Image.DecompressionBombError) as error:  # nothing is written to a disk
        text = "it is no image" if isinstance(error, UnidentifiedImageError) else str(error)
        raise InputError(f"an image in a table cannot be decoded ({text}); `mmw verify` names the file") from error
    return stream.getvalue()


def write_file(path: Path, data: bytes) -> None:
    """Write a file, and make its folder."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


def write_yaml(path: Path, content: dict[str, Any], *, flow: bool | None = False) -> None:
    """Write plain values as YAML, and make the folder; `flow=None` writes a list or mapping of values in one line."""
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("w", encoding="utf-8") as file:
        yaml.dump(content, file, Dumper=_DUMPER, default_flow_style=flow, sort_keys=False)
