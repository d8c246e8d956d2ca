"""Write files in the formats that readers of other datasets expect."""

import io
from pathlib import Path
from typing import Any

import yaml
from PIL import Image

_DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)


def png_of(data: bytes) -> bytes:
    """Return an image file as PNG; its pixels are unchanged."""
    stream = io.BytesIO()
    with Image.open(io.BytesIO(data)) as image:
        image.save(stream, "PNG", compress_level=1)  # a quarter of the default level's time, 5 % more bytes
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
