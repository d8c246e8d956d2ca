"""Unpack the contents of tiles: glTF alone, batched 3D models (.b3dm) and composites (.cmpt) of them.

Source: 3D Tiles 1.1 (OGC 22-025r4), with the tile formats of 1.0.
"""

import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mmw.core.errors import InputError

CURE = "convert the tiles (npx 3d-tiles-tools upgrade)"
MAX_TILES = 10_000
"""Largest number of tiles in a composite."""


@dataclass(frozen=True)
class Model:
    """One binary glTF of a tile."""

    glb: bytes
    center: np.ndarray
    """`RTC_CENTER`: place of its origin in the frame of the tile [m], shape [3]."""


def models_of(data: bytes, where: str, depth: int = 0) -> Iterator[Model | str]:
    """Yield the models of a content, and the name of each format that is not read.

    Raises:
        InputError: If a length does not fit, or a table is no JSON.
    """
    magic = data[:4]
    if magic == b"glTF":
        yield Model(data, np.zeros(3))
    elif magic == b"b3dm":
        yield _batched(data, where)
    elif magic == b"cmpt" and depth < 4:
        (count,) = struct.unpack("<I", _cut(data, 12, 4, where))
        start = 16
        for _ in range(min(count, MAX_TILES)):
            (size,) = struct.unpack("<I", _cut(data, start + 8, 4, where))
            if size < 12:
                raise InputError(f"{where}: a tile of {size} bytes in a composite; {CURE}")
            yield from models_of(_cut(data, start, size, where), where, depth + 1)
            start += size
    elif magic in (b"i3dm", b"pnts", b"cmpt"):
        yield magic.decode()
    else:
        raise InputError(f"{where}: begins with {magic!r}; a glb, b3dm or cmpt is needed; {CURE}")


def _batched(data: bytes, where: str) -> Model:
    table, binary, batch, batch_binary = struct.unpack("<4I", _cut(data, 12, 16, where))
    text = _cut(data, 28, table, where)
    try:
        given = json.loads(text).get("RTC_CENTER") if text.strip() else None
        center = np.zeros(3) if given is None else np.array(given, np.float64)
    except (ValueError, TypeError, AttributeError, OverflowError, RecursionError):
        center = np.zeros(0)
    if center.shape != (3,) or not np.isfinite(center).all():
        raise InputError(f"{where}: its feature table is no JSON with an RTC_CENTER of three numbers; {CURE}")
    start = 28 + table + binary + batch + batch_binary
    glb = data[start:]
    if glb[:4] != b"glTF":
        raise InputError(f"{where}: no glTF after {start} bytes of header and tables; {CURE}")
    return Model(glb, center)


def _cut(data: bytes, start: int, size: int, where: str) -> bytes:
    piece = data[start : start + size]
    if len(piece) != size:
        raise InputError(f"{where}: ends after {len(data)} bytes; {start + size} are needed; copy the file again")
    return piece
