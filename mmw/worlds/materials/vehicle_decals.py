"""Pictures of the material library that are laid once over a face: number plates, lettering, destination signs.

A picture fills the texture coordinates 0 to 1. Its characters are strokes on a grid of 4 x 6, drawn by this file, so
that it has the same pixels on every platform. All names and numbers are made up.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
from PIL import Image

PLATE_CELLS = (2, 4)
"""Columns and rows of number plates in the picture `car_plate`."""

PLATE_TEXTS = ("MW 24 KRX", "TR 81 FHB", "LK 07 ZSE", "VA 63 NDY", "GE 19 PUC", "HB 50 TLM", "RS 42 WAG", "NU 36 EVK")
"""Numbers of the plates, row by row from the upper left; made up."""

GLYPHS: Mapping[str, str] = {
    "0": "10 30 41 45 36 16 05 01 10", "1": "15 26 20/10 30", "2": "05 16 36 45 44 00 40",
    "3": "05 16 36 45 44 33 42 41 30 10 01/33 13", "4": "30 36 02 42", "5": "46 06 04 34 43 41 30 10 01",
    "6": "45 36 16 05 01 10 30 41 42 33 13 02", "7": "06 46 10", "8": "13 04 05 16 36 45 44 33 13 02 01 10 30 41 42 33",
    "9": "01 10 30 41 45 36 16 05 04 13 33 44", "A": "00 26 40/12 32", "B": "00 06 36 45 44 33 03/33 42 41 30 00",
    "C": "45 36 16 05 01 10 30 41", "D": "00 06 26 44 42 20 00", "E": "46 06 00 40/03 33", "F": "46 06 00/03 33",
    "G": "45 36 16 05 01 10 30 41 43 23", "H": "00 06/40 46/03 43", "I": "20 26", "K": "00 06/46 03 40",
    "L": "06 00 40", "M": "00 06 23 46 40", "N": "00 06 40 46", "O": "10 30 41 45 36 16 05 01 10",
    "P": "00 06 36 45 44 33 03", "R": "00 06 36 45 44 33 03/23 40", "S": "45 36 16 05 04 13 33 42 41 30 10 01",
    "T": "06 46/26 20", "U": "06 01 10 30 41 46", "V": "06 20 46", "W": "06 10 23 30 46", "X": "00 46/06 40",
    "Y": "06 23 46/23 20", "Z": "06 46 00 40", " ": "",
}  # fmt: skip
"""Character -> strokes: points `xy` on the grid, x 0 to 4 and y 0 to 6 upward; `/` lifts the pen."""

ADVANCE = 5.6
"""From one character to the next, in units of the grid."""


@dataclass(frozen=True)
class Picture:
    """One picture that a material shows once."""

    draw: Callable[[], np.ndarray]
    """Makes the sRGB pixels, rows downward, shape [H, W, 3], uint8; the same ones each time."""
    shines: bool = False
    """Whether the picture is also the emission, times the material's own."""
    light: Callable[[], np.ndarray] | None = None
    """Makes the sRGB pixels of the emission, times the material's own, where they are not those of the picture."""


def write_text(
    canvas: np.ndarray, text: str, box: tuple[float, float, float, float], color: tuple[int, int, int], weight: float
) -> None:
    """Write one line of characters into a picture, stretched to fill a box.

    Args:
        canvas: Pixels, rows downward, shape [H, W, 3], float64, 0 to 255; changed in place.
        text: Characters of `GLYPHS`.
        box: Left, top, right, bottom of the capital letters [px].
        color: sRGB.
        weight: Width of the strokes, in units of the grid of a character.
    """
    left, top, right, bottom = box
    unit_x, unit_y = (right - left) / (ADVANCE * (len(text) - 1) + 4.0), (bottom - top) / 6.0
    rows, columns = np.mgrid[0 : canvas.shape[0], 0 : canvas.shape[1]] + 0.5
    distance = np.full(canvas.shape[:2], np.inf)
    for place, character in enumerate(text):
        for stroke in GLYPHS[character].split("/"):
            grid = np.array([[float(point[0]), float(point[1])] for point in stroke.split()]).reshape(-1, 2)
            path = np.stack([left + unit_x * (ADVANCE * place + grid[:, 0]), bottom - unit_y * grid[:, 1]], axis=1)
            for start, end in pairwise(path):
                np.minimum(distance, _distance(columns, rows, start, end), out=distance)
    coverage = np.clip(0.5 + 0.5 * weight * min(unit_x, unit_y) - distance, 0.0, 1.0)[..., None]
    canvas += coverage * (np.array(color, dtype=np.float64) - canvas)


def _distance(x: np.ndarray, y: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Return the distance of points from a segment, in the unit of the points."""
    along = end - start
    share = np.clip(((x - start[0]) * along[0] + (y - start[1]) * along[1]) / (along @ along), 0.0, 1.0)
    return np.sqrt((x - start[0] - share * along[0]) ** 2 + (y - start[1] - share * along[1]) ** 2)


def _plates() -> np.ndarray:
    """Draw number plates: dark characters on white, a blue field at the left, a dark rim."""
    plates = []
    for text in PLATE_TEXTS:
        plate = np.full((64, 256, 3), 236.0)
        plate[:, :24] = (22, 62, 148)
        write_text(plate, text, (38, 14, 240, 50), (20, 20, 22), 1.0)
        for edge in (plate[:2], plate[-2:], plate[:, :2], plate[:, -2:]):
            edge[:] = 40
        plates.append(plate)
    return tiled(plates, PLATE_CELLS[0])


def _lettering() -> np.ndarray:
    """Draw the side of a lorry's box: white, two slanted stripes at the rear, and the word FREIGHT."""
    height, width = 192, 512
    canvas = np.full((height, width, 3), 232.0)
    rows, columns = np.mgrid[0:height, 0:width] + 0.5
    slant = columns + 0.55 * rows
    for start, end, color in ((28, 92, (24, 76, 150)), (104, 134, (232, 128, 28))):
        cover = np.clip(slant - start, 0, 1) * np.clip(end - slant, 0, 1)
        canvas += cover[..., None] * (np.array(color) - canvas)
    canvas[172:180] = (24, 76, 150)
    write_text(canvas, "CITY FREIGHT", (160, 56, 484, 104), (24, 76, 150), 1.15)
    write_text(canvas, "DAY AND NIGHT", (160, 126, 364, 146), (90, 94, 100), 0.8)
    return np.rint(canvas).astype(np.uint8)


def _destination() -> np.ndarray:
    """Draw the destination sign of a bus: amber dots on black."""
    height, width, dot = 48, 320, 4
    text = np.zeros((height // dot, width // dot, 3))
    write_text(text, "24 CENTRAL", (8, 2, 72, 10), (255, 255, 255), 0.9)
    lit = np.repeat(np.repeat(np.minimum(text[..., 0] / 140.0, 1.0), dot, axis=0), dot, axis=1)
    rows, columns = np.mgrid[0:height, 0:width]
    is_dot = (rows % dot > 0) & (columns % dot > 0)
    return np.rint(10.0 + (lit * is_dot)[..., None] * (np.array([255.0, 150.0, 20.0]) - 10.0)).astype(np.uint8)


PICTURES: Mapping[str, Picture] = {
    "car_plate": Picture(_plates),
    "truck_lettering": Picture(_lettering),
    "bus_sign": Picture(_destination, shines=True),
}
"""Material -> the picture that it shows."""


def cell(index: int, cells: tuple[int, int]) -> tuple[float, float, float, float]:
    """Return where a cell lies in a picture of columns and rows: u, v of its lower left and upper right corner."""
    columns, rows = cells
    row, column = divmod(index % (columns * rows), columns)
    return column / columns, 1.0 - (row + 1) / rows, (column + 1) / columns, 1.0 - row / rows


def tiled(images: Sequence[np.ndarray], columns: int) -> np.ndarray:
    """Return images of one size in rows of some columns, from the upper left, as bytes."""
    rows = [np.concatenate(images[k : k + columns], axis=1) for k in range(0, len(images), columns)]
    return np.clip(np.rint(np.concatenate(rows)), 0, 255).astype(np.uint8)


def write_picture(path: Path, picture: Picture) -> None:
    """Write a picture as PNG, and its light beside it as `<name>_light.png`."""
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(picture.draw()).save(path, optimize=True)
    if picture.light:
        Image.fromarray(picture.light()).save(path.with_name(f"{path.stem}_light.png"), optimize=True)
