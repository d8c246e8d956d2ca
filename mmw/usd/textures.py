"""Decode images that a stage refers to, through USD's asset resolver, to linear values with mip levels."""

import io
import math
import warnings
from dataclasses import dataclass
from pathlib import PurePath

import numpy as np
import PIL.Image
from pxr import Ar

from mmw.core.errors import InputError

LARGEST_PX = 2048
"""Longest side of a texture [px]; larger images are made smaller. Design value: at 640 x 480 no surface shows more."""

NOT_READ = (".exr", ".hdr", ".ktx", ".ktx2", ".dds", ".tx", ".tex")
"""Formats that USD files name and that are not read."""

_CHANNELS = {1: (0, 0, 0), 2: (0, 0, 0, 1), 3: (0, 1, 2), 4: (0, 1, 2, 3)}
"""Number of channels -> which of them are r, g, b and a."""

_STEPS = np.arange(256, dtype=np.float64) / 255.0

RAW = _STEPS.astype(np.float32)
"""8-bit code -> its value, 0 to 1."""

SRGB = np.where(_STEPS <= 0.04045, _STEPS / 12.92, ((_STEPS + 0.055) / 1.055) ** 2.4).astype(np.float32)
"""8-bit sRGB code -> linear value. Source: IEC 61966-2-1."""

RAW_16 = np.arange(65536, dtype=np.float32) / np.float32(65535.0)
"""16-bit code -> its value, 0 to 1. Images of 16 bits hold no sRGB."""


class MissingImageError(Exception):
    """A missing image, or one of a format that is not read: a picture can be made without it."""


@dataclass(frozen=True)
class Image:
    """An image as a surface shows it."""

    values: np.ndarray
    """Linear r, g, b and a, rows upward (row 0 is v = 0), shape [H, W, 4], float32; a is 1 where the file has none."""
    halves: np.ndarray
    """The same as half floats."""
    note: str = ""
    """Note for the user; empty for none."""


def decode_image(file: str, is_srgb: bool | None, where: str) -> Image:
    """Return an image.

    Args:
        file: Resolved asset path; inside a package, `file.usdz[image.png]`.
        is_srgb: Whether r, g and b are sRGB values; None: if the file has 8 bits and three or four channels, which is
            how UsdUVTexture's `auto` reads files that say nothing else.
        where: Prim that refers to it, for messages.

    Raises:
        MissingImageError: If there is no such file, or its format is not read.
        InputError: If the file cannot be decoded.
    """
    suffix = PurePath(file.rstrip("]")).suffix.lower()
    if suffix in NOT_READ:
        raise MissingImageError(f"{where}: texture {file} is {suffix[1:].upper()}; PNG and JPEG are read; convert it")
    content = _content(file, where)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", PIL.Image.DecompressionBombWarning)
            image = PIL.Image.open(io.BytesIO(content))
            width, height = image.size
            image.draft("RGB", (LARGEST_PX, LARGEST_PX))  # JPEG: decode at a half, a quarter or an eighth of the size
            pixels, palette = _pixels(image)
    except Exception as error:  # Pillow's decoders raise what they like
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(
            f"{where}: texture {file} cannot be decoded ({reason}); an intact PNG or JPEG is needed; export it again"
        ) from None
    codes = pixels if palette is None else palette
    raw = RAW if codes.dtype == np.uint8 else RAW_16
    holds_srgb = codes.shape[-1] >= 3 if is_srgb is None else is_srgb
    table = SRGB if holds_srgb and raw is RAW else raw
    if max(width, height) > LARGEST_PX:
        scale = LARGEST_PX / max(width, height)
        size = max(round(width * scale), 1), max(round(height * scale), 1)
        note = f"{where}: texture {file} has {width} x {height} px; it is drawn with {size[0]} x {size[1]}"
        values = _shrunk(pixels if palette is None else palette[pixels], table, raw, size)
        return Image(values, values.astype(np.float16), note)
    values = _linear(codes[::-1] if palette is None else codes, table, raw)
    halves = values.astype(np.float16)
    if palette is None:
        return Image(values, halves)
    return Image(values.take(pixels[::-1], axis=0), halves.take(pixels[::-1], axis=0))


def _content(file: str, where: str) -> bytes:
    """Return the bytes of an asset."""
    resolver = Ar.GetResolver()
    path = resolver.Resolve(file) if file else ""
    asset = resolver.OpenAsset(Ar.ResolvedPath(str(path))) if path else None
    if asset is None:
        raise MissingImageError(f"{where}: texture {file or 'without path'} is not there; correct the path, or add it")
    with asset as opened:
        return bytes(opened.GetBuffer() or b"")


def _pixels(image: PIL.Image.Image) -> tuple[np.ndarray, np.ndarray | None]:
    """Return the codes of an image, shape [H, W, 1 to 4], uint8 or uint16, rows downward, and no palette.

    An image with a palette gives the row of each pixel, shape [H, W], and the codes of its colors, [256, 3 or 4].
    """
    if image.mode.startswith("I"):  # one channel of 16 bits
        return np.asarray(image).astype(np.uint16)[..., None], None
    if image.mode == "F":
        raise InputError("its pixels are floats")
    if image.mode == "P":
        colors = image.crop((0, 0, 256, 1))
        colors.putdata(range(256))
        return np.asarray(image), np.asarray(colors.convert("RGBA" if "transparency" in image.info else "RGB"))[0]
    if image.mode not in ("L", "LA", "RGB", "RGBA"):
        image = image.convert({"1": "L", "PA": "RGBA", "RGBa": "RGBA", "La": "LA"}.get(image.mode, "RGB"))
    codes = np.asarray(image)
    return codes.reshape(*codes.shape[:2], -1), None


def _linear(codes: np.ndarray, table: np.ndarray, raw: np.ndarray) -> np.ndarray:
    """Return codes [..., C] as linear r, g, b and a: colors by `table`, alpha by `raw`."""
    values = np.ones((*codes.shape[:-1], 4), dtype=np.float32)
    for k, channel in enumerate(_CHANNELS[codes.shape[-1]]):
        values[..., k] = (raw if k == 3 else table)[codes[..., channel]]
    return values


def _shrunk(codes: np.ndarray, table: np.ndarray, raw: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """Return an image made smaller by averaging linear values, a row at a time so that it needs little memory."""
    width, height = size
    values = np.empty((height, width, 4), dtype=np.float32)
    for row in range(height):
        start, stop = row * len(codes) / height, (row + 1) * len(codes) / height
        first, last = int(start), min(math.ceil(stop), len(codes))
        share = np.minimum(np.arange(first, last) + 1, stop) - np.maximum(np.arange(first, last), start)
        line = np.tensordot(share / share.sum(), _linear(codes[first:last], table, raw), axes=1)
        values[height - 1 - row] = area_shrink(line, width)
    return values


def area_shrink(line: np.ndarray, count: int) -> np.ndarray:
    """Return values [n, ...] averaged to fewer, [count, ...]: each is the mean over its share of the length."""
    if len(line) == count:
        return line
    if len(line) == 2 * count:
        return 0.5 * (line[0::2] + line[1::2])
    total = np.concatenate([np.zeros((1, *line.shape[1:])), np.cumsum(line, axis=0, dtype=np.float64)])
    edge = np.arange(count + 1) * (len(line) / count)
    low = np.minimum(edge.astype(int), len(line) - 1)
    share = (edge - low).reshape(-1, *(1,) * (line.ndim - 1))
    return np.diff(total[low] + share * (total[low + 1] - total[low]), axis=0) * (count / len(line))


def mip_levels(values: np.ndarray) -> list[np.ndarray]:
    """Return an image and its mip levels down to one texel, each [max(H >> k, 1), max(W >> k, 1), 4], of equal mean."""
    levels = [values]
    while levels[-1].shape[:2] != (1, 1):
        height, width = (max(side // 2, 1) for side in levels[-1].shape[:2])
        shrunk = area_shrink(levels[-1], height)
        levels.append(area_shrink(shrunk.swapaxes(0, 1), width).swapaxes(0, 1).astype(np.float32))
    return levels
