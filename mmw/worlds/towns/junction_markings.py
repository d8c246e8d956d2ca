"""Paint on a junction pad: where a one-way road runs through, as on a roundabout, its lines go on across the pad."""

import numpy as np

from mmw.worlds.towns.plan_geometry import at_stations, row_stations
from mmw.worlds.towns.section import CrossSection

DASH, SHORT_DASH = 3.0, 1.0
"""Length of a dash between two lanes, and of one along the mouth of a road that joins; each gap is as long [m]."""
MARGIN = 0.3
"""Least distance of paint from the seam between the pad and a road [m]."""
STEP = 1.5
"""Largest distance of the points of a line [m]."""


def through_lines(
    section: CrossSection, xy: np.ndarray, heading: np.ndarray, is_open: tuple[bool, bool]
) -> list[np.ndarray]:
    """Return the outlines of the painted lines on the way of a one-way road across a pad.

    Lines between lanes are dashed. The line along a kerb is solid, the one across the mouth of a joining road is of
    short dashes: there the joining traffic gives way.

    Args:
        section: Cross-section of the road on both sides of the pad.
        xy: Reference line across the pad, in small steps [m], shape [N, 2].
        heading: Its direction [rad], shape [N].
        is_open: Whether roads join on the left and on the right.

    Returns:
        Closed counter-clockwise outlines, none touching another [m], each [K, 2].
    """
    station = row_stations(xy)
    unwrapped = np.unwrap(heading)
    outlines = []
    for low, high, kind in zip(section.breaks[:-1], section.breaks[1:], section.paint, strict=True):
        if not kind:
            continue
        is_border = abs(0.5 * (low + high)) > section.half - section.width
        if kind == "dashed":
            pieces = _dashes(station[-1], DASH)
        elif is_border and is_open[0 if high > 0 else 1]:
            pieces = _dashes(station[-1], SHORT_DASH)
        else:
            pieces = [(MARGIN, station[-1] - MARGIN)]
        for begin, end in pieces:
            s = np.linspace(begin, end, max(2, int(np.ceil((end - begin) / STEP)) + 1))
            angle = np.interp(s, station, unwrapped)
            middle = at_stations(s, station, xy)
            left = np.column_stack([-np.sin(angle), np.cos(angle)])
            outlines.append(np.concatenate([middle + low * left, (middle + high * left)[::-1]]))
    return outlines


def _dashes(length: float, dash: float) -> list[tuple[float, float]]:
    """Return begin and end of dashes with gaps of the same length, evenly over `length` [m]; half a gap at the ends."""
    count = max(1, round((length - 2 * MARGIN) / (2 * dash)))
    pitch = (length - 2 * MARGIN) / count
    return [(MARGIN + (k + 0.25) * pitch, MARGIN + (k + 0.75) * pitch) for k in range(count)]
