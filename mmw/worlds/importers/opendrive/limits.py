"""Limits of what an OpenDRIVE file may say: absurd numbers would ask for all memory there is, or never end.

They are design values, an order of magnitude beyond real roads, and listed in `docs/guides/import.md`.
"""

import math
import xml.etree.ElementTree as ElementTree

import numpy as np

from mmw.core.errors import InputError
from mmw.worlds.importers.mesh_cleanup import MAX_SIZE_M

Range = tuple[float, float]

ANY: Range = (-math.inf, math.inf)
MAX_ROAD = 50e3
"""Length of a road [m]."""
MIN_ROAD = 0.05
"""A shorter road is not built, and what it links is linked directly [m]: a tenth of the gap that lanes may have."""
STATION: Range = (-1.0, MAX_ROAD + 1.0)
"""Stations and offsets along a road [m]; exporters write -1e-9 for 0."""
PLACE: Range = (-1e8, 1e8)
"""Coordinates, such as those of a national grid [m]."""
HEADING: Range = (-1e3, 1e3)
"""Headings [rad]."""
CURVATURE: Range = (-100.0, 100.0)
"""Curvature [1/m]: a radius of a centimeter."""
MAX_TURN = 100.0
"""Curvature times length of one geometry [rad]: 16 full turns."""
LANE: Range = (-100.0, 100.0)
"""Numbers of lanes."""
WIDTH: Range = (-100.0, 100.0)
"""Width of a lane, and of its border from the middle [m]."""
OFFSET: Range = (-1e3, 1e3)
"""Lane offset [m]."""
HEIGHT: Range = (-10e3, 10e3)
"""Elevation of a road [m]."""
KERB: Range = (-100.0, 100.0)
"""Height of a lane above the road [m]."""
ROLL: Range = (-1.0, 1.0)
"""Superelevation [rad]."""
PAINT: Range = (0.0, 5.0)
"""Width of a road mark [m]."""
DASH: Range = (0.0, 1e3)
"""Length of a dash, and of a gap [m]."""
MIN_DASH = 0.05
"""A dash and its gap together are at least twice this long [m]."""
SPEED: Range = (-1.0, 1e3)
"""Speed limit, in its unit; not above 0 is none."""
MAX_JUNCTION = 3e3
"""Extent of a junction [m]."""
MAX_GAP = 1.0
"""A piece of the reference line ends at most this far before the next one, or the road, goes on [m]."""
SAMPLES = 17
"""Places at which a cubic is held against its limits."""


def number(
    element: ElementTree.Element, name: str, where: str, default: float | None = None, limits: Range = ANY
) -> float:
    """Return an attribute as a number.

    Raises:
        InputError: If it is missing and has no default, is not a finite number, or is beyond its limits.
    """
    text = element.get(name)
    if text is None and default is not None:
        return default
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    low, high = limits
    if not math.isfinite(value) or not low <= value <= high:
        short = repr(text if text is None or len(text) <= 40 else f"{text[:40]}...")
        found = "is missing" if text is None else f"is {short}"
        needed = f"a number from {low:g} to {high:g}" if math.isfinite(value) else "a number"
        raise InputError(f"{where}: <{element.tag}> attribute {name} {found}; {needed} is needed; correct the file")
    return value


def check_cubics(
    where: str, what: str, pieces: tuple[np.ndarray, np.ndarray], span: tuple[float, float], limits: Range
) -> None:
    """Hold a piecewise cubic against its limits over a stretch of road.

    Args:
        where: File, road and lane.
        what: What the cubic describes, as the file calls it.
        pieces: Stations where the pieces begin [m], shape [K], and a, b, c, d of each, shape [K, 4].
        span: Begin and end of the stretch [m].
        limits: Least and greatest value.

    Raises:
        InputError: If a value is beyond the limits.
    """
    start, coefficients = pieces
    if not len(start):
        return
    first = np.clip(start, *span)
    first[0] = span[0]  # it also holds before its start
    last = np.append(first[1:], span[1])
    s = first[:, None] + (last - first)[:, None] * np.linspace(0.0, 1.0, SAMPLES)
    ds = s - start[:, None]
    a, b, c, d = coefficients.T[:, :, None]
    with np.errstate(over="ignore", invalid="ignore"):
        value = a + ds * (b + ds * (c + ds * d))
    low, high = limits
    wrong = ~((value >= low) & (value <= high)) & (last > first)[:, None]
    if wrong.any():
        k = int(np.argmax(wrong))
        raise InputError(
            f"{where}: <{what}> reaches {value.flat[k]:.4g} at s = {s.flat[k]:.4g} m; {low:g} to {high:g} is needed; "
            "correct its a, b, c, d"
        )


def check_extent(where: str, points: np.ndarray, largest: float = MAX_SIZE_M) -> None:
    """Raise InputError if points [N, D] are not finite or reach farther than `largest` [m]."""
    if not len(points):
        return
    size = float(np.ptp(points, axis=0).max())
    if not size <= largest:  # NaN too
        raise InputError(
            f"{where}: reaches over {size:.4g} m; at most {largest:g} m are read; correct the shape of the road, or "
            "cut out a smaller area"
        )
