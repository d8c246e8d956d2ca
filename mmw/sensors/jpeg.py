"""JPEG files of many images at once, made on the GPU that rendered them.

A core makes 700 files of 640 x 480 a second, and a GPU renders thousands: the cores beside it would be its limit. The
files are those of libjpeg with its accurate integer transform, byte for byte.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import simplejpeg
import warp as wp

from mmw.kernels import jpeg
from mmw.sensors.host import to_host

MOST_PIXELS = 16_000_000
"""Pixels that are encoded at a time: their bits are counted with 32 bits, and a pixel takes at most three values of 26
bits each."""

END = b"\xff\xd9"
"""Marker of a file's end. Source: ITU-T T.81, table B.1, as are the others."""


@dataclass(frozen=True)
class Tables:
    """What a file says of its coding, in its first bytes."""

    header: bytes
    """All that comes before the coded blocks."""
    steps: np.ndarray
    """Steps of the values of a block, of lightness and colours, in zigzag order, shape [2, 64], int32."""
    codes: np.ndarray
    """Code, and its length in the upper 16 bits, of every symbol: means and then others of lightness, then the same of
    colours, shape [4, 256], uint32."""


@lru_cache(maxsize=16)
def read_tables(width: int, height: int, quality: int, subsampling: str) -> Tables:
    """Return what libjpeg-turbo writes before the blocks of an image.

    Args:
        width: Of the image [px].
        height: Of the image [px].
        quality: 1 to 100.
        subsampling: `4:2:0` or `4:4:4`.
    """
    black = np.zeros((height, width, 3), dtype=np.uint8)
    file = simplejpeg.encode_jpeg(black, quality, "RGB", subsampling.replace(":", ""), fastdct=False)
    steps, codes = np.zeros((2, 64), dtype=np.int32), np.zeros((4, 256), dtype=np.uint32)
    at, marker = 2, 0
    while marker != 0xDA:  # start of scan: the blocks come behind it
        marker, length = file[at + 1], int.from_bytes(file[at + 2 : at + 4])
        body, at = file[at + 4 : at + 2 + length], at + 2 + length
        while marker == 0xDB and body:  # quantisation tables, of 8 bits
            steps[body[0]] = np.frombuffer(body[1:65], dtype=np.uint8)
            body = body[65:]
        while marker == 0xC4 and body:  # Huffman tables: class and number, how many codes of each length, their symbols
            table, counts = 2 * (body[0] & 15) + (body[0] >> 4), body[1:17]
            symbols, body = body[17 : 17 + sum(counts)], body[17 + sum(counts) :]
            lengths = np.repeat(np.arange(1, 17), list(counts))
            codes[table, list(symbols)] = _codes(lengths) | lengths << 16
    return Tables(file[:at], steps, codes)


def _codes(lengths: np.ndarray) -> np.ndarray:
    """Return the codes of some lengths, the shortest first: ITU-T T.81, C.2."""
    found, code = [], 0
    for k, length in enumerate(lengths.tolist()):
        code <<= length - lengths[k - 1] if k else length
        found.append(int(code))
        code += 1
    return np.array(found, dtype=np.int64)


def zigzag() -> np.ndarray:
    """Return the place in a file of each of a block's values, row by row, shape [64], int32: ITU-T T.81, figure A.6."""
    row, column = np.divmod(np.arange(64), 8)
    along = np.where((row + column) % 2, row, column)  # diagonals go down and up in turn
    place = np.empty(64, dtype=np.int32)
    place[np.lexsort((along, row + column))] = np.arange(64)
    return place


def jpeg_files(images: wp.array, quality: int, subsampling: str) -> list[bytes]:
    """Return images as JPEG files.

    `mmw.tables.encode.encode_rgb`, for images in the machine's memory, writes the same from quality 96 on; below it,
    libjpeg-turbo takes a transform that is a little faster and less accurate.

    Args:
        images: sRGB values, shape [A, H, W, 3], uint8.
        quality: 1 to 100.
        subsampling: Of the chroma: `4:2:0` or `4:4:4`.
    """
    count, height, width, _ = images.shape
    tables = read_tables(width, height, quality, subsampling)
    layout = jpeg.Layout()
    layout.width, layout.height, layout.step = width, height, 2 if subsampling == "4:2:0" else 1
    layout.columns = -(-width // (8 * layout.step))
    layout.blocks = layout.columns * -(-height // (8 * layout.step)) * (layout.step**2 + 2)
    place = zigzag()
    on_device = (
        wp.array(tables.steps[:, place], dtype=int, device=images.device),
        wp.array(place, dtype=int, device=images.device),
        wp.array(tables.codes, dtype=wp.uint32, device=images.device),
    )
    step = max(MOST_PIXELS // (width * height), 1)
    files = []
    for first in range(0, count, step):
        body, spans = _encode(images[first : min(first + step, count)], layout, *on_device)
        files += [b"".join((tables.header, body[begin:end], END)) for begin, end in spans.tolist()]
    return files


def _encode(
    images: wp.array, layout: "jpeg.Layout", steps: wp.array, place: wp.array, codes: wp.array
) -> tuple[memoryview, np.ndarray]:
    """Return coded blocks, and the first byte of each image and the one behind its last, shape [A, 2]."""
    device, count = images.device, len(images)
    blocks = count * layout.blocks
    rows, values = (wp.empty((blocks, 64), dtype=wp.int16, device=device) for _ in range(2))
    wp.launch(jpeg.rows_kernel, dim=(count, layout.blocks, 8), inputs=[images, layout], outputs=[rows], device=device)
    wp.launch(
        jpeg.columns_kernel, dim=(blocks, 8), inputs=[rows, layout, steps, place], outputs=[values], device=device
    )
    bits = wp.empty(blocks, dtype=int, device=device)
    nowhere = wp.empty(0, dtype=wp.uint32, device=device)
    wp.launch(
        jpeg.count_bits_kernel, dim=blocks, inputs=[values, layout, codes, nowhere], outputs=[bits], device=device
    )
    wp.utils.array_scan(bits, bits)
    words_up_to = wp.empty(count, dtype=int, device=device)
    wp.launch(jpeg.count_words_kernel, dim=count, inputs=[bits, layout], outputs=[words_up_to], device=device)
    wp.utils.array_scan(words_up_to, words_up_to)
    words = wp.zeros(int(words_up_to[-1:].numpy()[0]), dtype=wp.uint32, device=device)
    wp.launch(
        jpeg.write_bits_kernel, dim=blocks, inputs=[values, layout, codes, bits, words_up_to],
        outputs=[words], device=device,
    )  # fmt: skip
    full = wp.empty(len(words), dtype=int, device=device)
    wp.launch(jpeg.count_full_kernel, dim=len(words), inputs=[words], outputs=[full], device=device)
    wp.utils.array_scan(full, full)
    spans = wp.empty((count, 2), dtype=int, device=device)
    wp.launch(jpeg.spans_kernel, dim=count, inputs=[bits, words_up_to, full, layout], outputs=[spans], device=device)
    body = wp.empty(4 * len(words) + int(full[-1:].numpy()[0]), dtype=wp.uint8, device=device)
    wp.launch(jpeg.write_bytes_kernel, dim=len(words), inputs=[words, full], outputs=[body], device=device)
    on_host, ends = to_host([body, spans])
    return memoryview(on_host), ends
