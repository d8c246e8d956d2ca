"""PNG files with three channels of 16 bits, which Pillow neither writes nor reads whole: those of optical flow.

Any reader of PNG opens them; `cv2.imread(path, cv2.IMREAD_UNCHANGED)` gives all 16 bits, blue first.

Source: Portable Network Graphics (PNG) Specification, 2nd edition, W3C 2003 (ISO/IEC 15948).
"""

import struct
import zlib

import numpy as np

from mmw.core.errors import InputError

SIGNATURE = b"\x89PNG\r\n\x1a\n"
UP = 2
"""Filter of every row: the difference to the row above, byte by byte."""
FIXED = (16, 2, 0, 0, 0)
"""Rest of the header: bits a channel, color type RGB, compression, filter method, no interlacing."""


def encode_png16(image: np.ndarray, level: int) -> bytes:
    """Return an image of red, green and blue, shape [H, W, 3], uint16, as a PNG of some zlib level."""
    height, width, _ = image.shape
    rows = np.ascontiguousarray(image.astype(">u2")).view(np.uint8).reshape(height, width * 6)
    filtered = np.full((height, 1 + width * 6), UP, dtype=np.uint8)
    filtered[0, 1:] = rows[0]
    np.subtract(rows[1:], rows[:-1], out=filtered[1:, 1:])  # modulo 256
    header = struct.pack(">IIBBBBB", width, height, *FIXED)
    data = zlib.compress(filtered.tobytes(), level)
    return SIGNATURE + _chunk(b"IHDR", header) + _chunk(b"IDAT", data) + _chunk(b"IEND", b"")


def decode_png16(data: bytes) -> np.ndarray:
    """Return an image that `encode_png16` wrote, red, green, blue, shape [H, W, 3], uint16.

    Raises:
        InputError: If it is no such file.
    """
    chunks = _chunks(data)
    if b"IHDR" not in chunks or struct.unpack(">IIBBBBB", chunks[b"IHDR"])[2:] != FIXED:
        raise InputError("PNG image: not one of three 16-bit channels; give the bytes of an image of table `flow`")
    width, height = struct.unpack(">II", chunks[b"IHDR"][:8])
    filtered = np.frombuffer(zlib.decompress(chunks[b"IDAT"]), dtype=np.uint8).reshape(height, 1 + width * 6)
    if (filtered[:, 0] != UP).any():
        raise InputError("PNG image: rows are filtered in another way; this reads what mmw wrote; use OpenCV for it")
    rows = np.cumsum(filtered[:, 1:], axis=0, dtype=np.uint8)  # modulo 256
    return rows.view(">u2").reshape(height, width, 3).astype(np.uint16)


def _chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _chunks(data: bytes) -> dict[bytes, bytes]:
    """Return the contents of a file's chunks by their kind; those of one kind are put together."""
    found: dict[bytes, bytes] = {}
    place = len(SIGNATURE) if data.startswith(SIGNATURE) else len(data)
    while place + 8 <= len(data):
        length, kind = struct.unpack(">I4s", data[place : place + 8])
        found[kind] = found.get(kind, b"") + data[place + 8 : place + 8 + length]
        place += length + 12
    return found
