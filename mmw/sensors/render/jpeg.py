"""Make JPEG files of many images at once, on the GPU that rendered them.

A core makes 700 files of 640 x 480 a second, and a GPU renders thousands: the cores beside it would be its limit. The
files are those of `mmw.storage.codecs.images.encode_rgb`, byte for byte, which libjpeg-turbo writes: with its fast
transform below quality 96, with its accurate one from there on.
"""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import simplejpeg
import warp as wp

from mmw.core.recorded_work import DirectWork, NewArrays, Work
from mmw.kernels.camera import jpeg
from mmw.sensors.render.row_lists import ListShares, RowLists

END = b"\xff\xd9"
"""Marker of a file's end. Source: ITU-T T.81, table B.1, as are the others."""

ACCURATE_FROM = 96
"""Quality from which libjpeg-turbo's TurboJPEG interface takes the accurate transform; below it, the fast one, whatever
`fastdct` says."""

BLOCK_WORDS = 53
"""Most words of 32 bits that a block takes: 26 bits for each of 64 values, and what its image ends with."""


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


@dataclass(frozen=True)
class _Coding:
    """Constants of the coding of images of one size, on a device."""

    layout: "jpeg.Layout"
    header: bytes
    is_fast: bool
    divisors: wp.array
    """Of lightness and colors, shape [2, 64], int32."""
    place: wp.array
    """`zigzag`."""
    codes: wp.array
    """`Tables.codes`."""


@lru_cache(maxsize=16)
def _coding(width: int, height: int, quality: int, subsampling: str, device: str) -> _Coding:
    tables = read_tables(width, height, quality, subsampling)
    layout = jpeg.Layout()
    layout.width, layout.height, layout.step = width, height, 2 if subsampling == "4:2:0" else 1
    layout.columns = -(-width // (8 * layout.step))
    layout.blocks = layout.columns * -(-height // (8 * layout.step)) * (layout.step**2 + 2)
    is_fast = quality < ACCURATE_FROM
    divisors = fast_divisors(tables.steps) if is_fast else accurate_divisors(tables.steps)
    divided, place = (wp.array(values, dtype=int, device=device) for values in (divisors, zigzag()))
    codes = wp.array(tables.codes, dtype=wp.uint32, device=device)
    return _Coding(layout, tables.header, is_fast, divided, place, codes)


@dataclass(frozen=True)
class CodedImages:
    """Bytes of the files of all images of an array, on the device; they hold if the lists of the launch fit."""

    coding: _Coding
    body: wp.array
    """The files without their headers and ends; there is room for more. uint8."""
    spans: wp.array
    """First byte of each image's file and the one behind its last, shape [A, 2], int32."""


def code_images(images: wp.array, quality: int, subsampling: str, lists: RowLists) -> CodedImages:
    """Launch what codes images, without a wait; `jpeg_files` says what they are and what comes out.

    Args:
        images: sRGB values, shape [A, H, W, 3], uint8; A > 0.
        quality: 1 to 100.
        subsampling: `4:2:0` or `4:4:4`.
        lists: Lists of the launch, one of which is that of the words of the files.
    """
    count, height, width, _ = images.shape
    coding = _coding(width, height, quality, subsampling, str(images.device))
    arrays, layout, device = lists.arrays, coding.layout, images.device
    total = count * layout.blocks
    rows, values = (arrays.empty((total, 64), wp.int16) for _ in range(2))
    inputs = [images, layout, coding.is_fast]
    wp.launch(jpeg.rows_kernel, (count, layout.blocks, 8), inputs, [rows], device=device)
    inputs = [rows, layout, coding.is_fast, coding.divisors, coding.place]
    wp.launch(jpeg.columns_kernel, (total, 8), inputs, [values], device=device)
    bits, words_up_to = arrays.empty(total, wp.int64), arrays.empty(count, int)
    nowhere = arrays.empty(0, wp.uint32)
    wp.launch(jpeg.count_bits_kernel, total, [values, layout, coding.codes, nowhere], [bits], device=device)
    wp.utils.array_scan(bits, bits)
    wp.launch(jpeg.count_words_kernel, count, [bits, layout], [words_up_to], device=device)
    wp.utils.array_scan(words_up_to, words_up_to)
    room = lists.room("words", BLOCK_WORDS * total)
    lists.count("words", room, words_up_to, count - 1)
    words = arrays.full(room, 0, wp.uint32)
    inputs = [values, layout, coding.codes, bits, words_up_to]
    wp.launch(jpeg.write_bits_kernel, total, inputs, [words], device=device)
    full = arrays.empty(room, int)
    wp.launch(jpeg.count_full_kernel, room, [words], [full], device=device)
    wp.utils.array_scan(full, full)
    spans = arrays.empty((count, 2), int)
    wp.launch(jpeg.spans_kernel, count, [bits, words_up_to, full, layout], [spans], device=device)
    body = arrays.empty(8 * room, wp.uint8)  # each byte may have a 0 behind it
    wp.launch(jpeg.write_bytes_kernel, room, [words, full], [body], device=device)
    return CodedImages(coding, body, spans)


@dataclass(frozen=True)
class CodedFiles:
    """Files of the images of an array, on the host."""

    header: bytes
    body: np.ndarray
    """`CodedImages.body`, as far as it is filled."""
    spans: np.ndarray
    """`CodedImages.spans`."""

    def files(self) -> list[bytes]:
        """Return each image's file."""
        body = memoryview(self.body)
        return [b"".join((self.header, body[begin:end], END)) for begin, end in self.spans.tolist()]


def file_bytes(spans: np.ndarray) -> int:
    """Return the bytes of all files without their headers and ends, given `CodedImages.spans`."""
    return int(spans[-1, 1])


def read_files(
    coded: Sequence[CodedImages], spans: Sequence[np.ndarray], work: Work, ahead: Sequence[np.ndarray] = ()
) -> list[CodedFiles]:
    """Return the files of each of some coded images, after one wait for the device at most.

    Args:
        coded: The coded images.
        spans: Their spans, on the host.
        work: What launched them.
        ahead: First bytes of their bodies, if they are on the host already; where these are all, nothing is waited for.
    """
    needed = list(map(file_bytes, spans))
    if len(ahead) == len(needed) and all(len(body) >= count for body, count in zip(ahead, needed, strict=True)):
        bodies = [body[:count] for body, count in zip(ahead, needed, strict=True)]
    else:
        bodies = work.to_host([some.body[:count] for some, count in zip(coded, needed, strict=True)])
    parts = zip(coded, bodies, spans, strict=True)
    return [CodedFiles(some.coding.header, body, own) for some, body, own in parts]


def jpeg_files(pictures: Sequence[wp.array], quality: int, subsampling: str) -> list[list[bytes]]:
    """Return images as JPEG files.

    `mmw.storage.codecs.images.encode_rgb`, for images in the machine's memory, writes the same bytes. The device is
    waited for twice, however many images there are: beside other processes each wait takes some milliseconds.

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
    count, height, width, _ = pictures[0].shape
    work, shares = DirectWork(str(pictures[0].device)), ListShares()
    while True:
        lists = RowLists(NewArrays(work.device), shares, count * height * width)
        coded = [code_images(images, quality, subsampling, lists) for images in pictures]
        counts, *spans = work.to_host([lists.counts, *(some.spans for some in coded)])
        if lists.fit(counts):
            return [one.files() for one in read_files(coded, spans, work)]
