"""Make JPEG files of many images at once, on the GPU that rendered them.

A core makes 700 files of 640 x 480 a second, and a GPU renders thousands: the cores beside it would be its limit. The
files are those of `mmw.storage.codecs.images.encode_rgb`, byte for byte, which libjpeg-turbo writes: with its fast
transform below quality 96, with its accurate one from there on.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import simplejpeg
import warp as wp

from mmw.core.transfer import to_host
from mmw.kernels.camera import jpeg

END = b"\xff\xd9"
"""Marker of a file's end. Source: ITU-T T.81, table B.1, as are the others."""

ACCURATE_FROM = 96
"""Quality from which libjpeg-turbo's TurboJPEG interface takes the accurate transform; below it, the fast one, whatever
`fastdct` says."""


@dataclass(frozen=True)
class Tables:
    """Header of a file: its coding, in its first bytes."""

    header: bytes
    """All that comes before the coded blocks."""
    steps: np.ndarray
    """Steps of the values of a block, row by row, of lightness and colors, shape [2, 64], int32."""
    codes: np.ndarray
    """Code, and its length in the upper 16 bits, of every symbol: means and then others of lightness, then the same of
    colors, shape [4, 256], uint32."""


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
    return Tables(file[:at], steps[:, zigzag()], codes)


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


def accurate_divisors(steps: np.ndarray) -> np.ndarray:
    """Return what the accurate transform's values are divided by: it makes all of them eight times too large.

    Args:
        steps: Steps of the quality, row by row, shape [..., 64], int32.
    """
    return 8 * steps


def fast_divisors(steps: np.ndarray) -> np.ndarray:
    """Return what the fast transform's values are divided by, integers as libjpeg has them.

    Its value k of a row or column is 1 (k = 0) or sqrt(2) cos(k pi / 16) times as large as the accurate one's; factors
    of both axes together have 14 bits behind the point. Source: Y. Arai, T. Agui and M. Nakajima, "A fast DCT-SQ scheme
    for images", Trans. IEICE E-71(11), 1988.

    Args:
        steps: Steps of the quality, row by row, shape [..., 64], int32.
    """
    axis = np.where(np.arange(8) > 0, np.sqrt(2.0) * np.cos(np.arange(8) * np.pi / 16.0), 1.0)
    factor = np.rint(2.0**14 * np.outer(axis, axis)).astype(np.int32).ravel()
    return (steps * factor + 2**10) >> 11


def jpeg_files(pictures: Sequence[wp.array], quality: int, subsampling: str) -> list[list[bytes]]:
    """Return images as JPEG files.

    `mmw.storage.codecs.images.encode_rgb`, for images in the machine's memory, writes the same bytes. The device is
    waited for three times, however many images there are: beside other processes each wait takes some milliseconds.

    Args:
        pictures: sRGB values, in arrays of one shape [A, H, W, 3], uint8. An image of 27 million pixels and an array
            of 80 million surely fit into numbers of 32 bits, with 26 bits for each value and a 0 behind each byte.
        quality: 1 to 100.
        subsampling: Of the chroma: `4:2:0` or `4:4:4`.

    Returns:
        The files of each array.
    """
    if not pictures or not len(pictures[0]):
        return [[] for _ in pictures]
    _, height, width, _ = pictures[0].shape
    tables = read_tables(width, height, quality, subsampling)
    layout = jpeg.Layout()
    layout.width, layout.height, layout.step = width, height, 2 if subsampling == "4:2:0" else 1
    layout.columns = -(-width // (8 * layout.step))
    layout.blocks = layout.columns * -(-height // (8 * layout.step)) * (layout.step**2 + 2)
    device = pictures[0].device
    is_fast = quality < ACCURATE_FROM
    divisors = fast_divisors(tables.steps) if is_fast else accurate_divisors(tables.steps)
    transform = is_fast, *(wp.array(values, dtype=int, device=device) for values in (divisors, zigzag()))
    codes = wp.array(tables.codes, dtype=wp.uint32, device=device)
    blocks = [_blocks(images, layout, transform, codes) for images in pictures]
    word_counts = to_host([some.words_up_to[-1:] for some in blocks])
    bits = [_bits(some, layout, codes, int(count[0])) for some, count in zip(blocks, word_counts, strict=True)]
    spans = to_host([some.spans for some in bits])
    bodies = to_host([_bytes(some, int(span[-1, 1])) for some, span in zip(bits, spans, strict=True)])
    return [
        [b"".join((tables.header, memoryview(body)[begin:end], END)) for begin, end in span.tolist()]
        for body, span in zip(bodies, spans, strict=True)
    ]


@dataclass(frozen=True)
class _Blocks:
    """Blocks of all images of an array, not yet written."""

    values: wp.array
    """Transformed, divided, in the file's order, shape [A x blocks, 64], int16."""
    bits_up_to: wp.array
    """Bits up to each block, shape [A x blocks], int64."""
    words_up_to: wp.array
    """Words of 32 bits up to each image, shape [A], int32."""


@dataclass(frozen=True)
class _Bits:
    """Coded blocks of all images of an array, without the zeros behind full bytes."""

    words: wp.array
    """Bits, the first of a word is its highest, shape [words], uint32."""
    full_up_to: wp.array
    """Full bytes up to each word, shape [words], int32."""
    spans: wp.array
    """First byte of each image's file and the one behind its last, zeros counted, shape [A, 2], int32."""


def _blocks(
    images: wp.array, layout: "jpeg.Layout", transform: tuple[bool, wp.array, wp.array], codes: wp.array
) -> _Blocks:
    """Transform and count; `transform` is whether it is the fast one, divisors and places in the file."""
    is_fast, *tables = transform
    device, count = images.device, len(images)
    total = count * layout.blocks
    rows, values = (wp.empty((total, 64), dtype=wp.int16, device=device) for _ in range(2))
    wp.launch(jpeg.rows_kernel, (count, layout.blocks, 8), [images, layout, is_fast], [rows], device=device)
    wp.launch(jpeg.columns_kernel, (total, 8), [rows, layout, is_fast, *tables], [values], device=device)
    bits, words = wp.empty(total, dtype=wp.int64, device=device), wp.empty(count, dtype=int, device=device)
    nowhere = wp.empty(0, dtype=wp.uint32, device=device)
    wp.launch(jpeg.count_bits_kernel, dim=total, inputs=[values, layout, codes, nowhere], outputs=[bits], device=device)
    wp.utils.array_scan(bits, bits)
    wp.launch(jpeg.count_words_kernel, dim=count, inputs=[bits, layout], outputs=[words], device=device)
    wp.utils.array_scan(words, words)
    return _Blocks(values, bits, words)


def _bits(blocks: _Blocks, layout: "jpeg.Layout", codes: wp.array, word_count: int) -> _Bits:
    device = blocks.values.device
    words = wp.zeros(word_count, dtype=wp.uint32, device=device)
    inputs = [blocks.values, layout, codes, blocks.bits_up_to, blocks.words_up_to]
    wp.launch(jpeg.write_bits_kernel, len(blocks.values), inputs, [words], device=device)
    full = wp.empty(word_count, dtype=int, device=device)
    wp.launch(jpeg.count_full_kernel, dim=word_count, inputs=[words], outputs=[full], device=device)
    wp.utils.array_scan(full, full)
    count = len(blocks.words_up_to)
    spans = wp.empty((count, 2), dtype=int, device=device)
    wp.launch(jpeg.spans_kernel, count, [blocks.bits_up_to, blocks.words_up_to, full, layout], [spans], device=device)
    return _Bits(words, full, spans)


def _bytes(bits: _Bits, end: int) -> wp.array:
    """Return the files' bytes; the last word may have three more than the last file."""
    body = wp.empty(end + 3, dtype=wp.uint8, device=bits.words.device)
    wp.launch(jpeg.write_bytes_kernel, len(bits.words), [bits.words, bits.full_up_to], [body], device=body.device)
    return body
