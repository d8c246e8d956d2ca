"""Cross-sections: where a carriageway's paint lies, where its lanes run, and how its kerb and sidewalk rise."""

from dataclasses import dataclass

import numpy as np

from mmw.worlds.towns.description import Profile

LINE_WIDTH = 0.15
"""Width of a painted line [m]; design value, within the 0.10 to 0.20 m that road authorities use."""
BAR_WIDTH = 0.5
"""Width of a bar of a zebra crossing, and of the gap between two [m]; design value."""
MEDIAN_GAP = 0.3
"""From the middle of the line along a raised median to its kerb [m]; design value."""
MEDIAN_TOP = {"grass": "grass", "concrete": "concrete_sidewalk"}
"""Material of the top of a raised median."""
EDGE_STRIPS = (("curb", "curb"), ("curb", "curb"), ("walk", "concrete_sidewalk"), ("verge", "grass"))
"""Strips outward from the kerb line (face, top, sidewalk, verge): name and material."""


@dataclass(frozen=True)
class CrossSection:
    """A profile as numbers; lateral positions are positive to the left of the reference line."""

    profile: str
    half: float
    """Half the width of the carriageway [m]."""
    breaks: np.ndarray
    """Lateral positions where paint begins or ends, ascending; first and last are the kerb lines [m], shape [K]."""
    paint: tuple[str, ...]
    """Of every strip between two breaks: empty, `solid` or `dashed`."""
    bars: np.ndarray
    """Breaks of a zebra crossing; every second strip, beginning with the second, is painted [m]."""
    forward: tuple[float, ...]
    """Lateral positions of the lanes along the reference line, from the middle outward [m]."""
    backward: tuple[float, ...]
    """Lateral positions of the lanes against the reference line, from the middle outward [m]."""
    width: float
    """Width of a lane [m]."""
    edge: np.ndarray
    """Offset outward from the kerb line and height above the road of the edge strips' borders [m], shape [5, 2]."""
    island: np.ndarray
    """Lateral positions of the borders of a raised median's top, ascending, first and last at its kerbs [m], shape [4];
    shape [0] without one. The kerbs are also among `breaks`."""
    island_height: float = 0.0
    """Height of the raised median above the road [m]."""
    island_top: str = ""
    """Material of its top; empty without one."""

    @property
    def island_breaks(self) -> tuple[int, int]:
        """Positions among `breaks` of the right and of the left kerb of the raised median."""
        right, left = np.searchsorted(self.breaks, self.island[[0, -1]])
        return int(right), int(left)


def make_section(name: str, profile: Profile) -> CrossSection:
    """Return the cross-section of a profile."""
    n, w, line = profile.lanes, profile.width, LINE_WIDTH
    lanes = n if profile.oneway else 2 * n
    paved = lanes * w + (0.0 if profile.oneway else profile.centre)
    half = 0.5 * paved + profile.shoulder
    if profile.oneway:
        forward = tuple(0.5 * paved - w * (k + 0.5) for k in range(n))  # lane 0 is the left one
        backward: tuple[float, ...] = ()
        lines = [(0.5 * paved - w * k, "dashed") for k in range(1, n)]
    else:
        forward = tuple(-0.5 * profile.centre - w * (k + 0.5) for k in range(n))
        backward = tuple(-t for t in forward)
        lines = [(side * (0.5 * profile.centre + w * k), "dashed") for side in (-1, 1) for k in range(1, n)]
        if profile.centre > 0:
            lines += [(side * 0.5 * profile.centre, "solid") for side in (-1, 1)]
        elif n > 1:
            lines += [(side * line, "solid") for side in (-1, 1)]
        else:
            lines += [(0.0, "dashed")]
    lines += [(side * (0.5 * paved), "solid") for side in (-1, 1)]
    breaks, paint = [-half], []
    for t, kind in sorted(lines):
        breaks += [t - 0.5 * line, t + 0.5 * line]
        paint += ["", kind]
    breaks.append(half)
    paint.append("")
    island = np.zeros(0)
    if profile.median != "painted":
        foot, top = 0.5 * profile.centre - MEDIAN_GAP, 0.5 * profile.centre - MEDIAN_GAP - profile.kerb_width
        island = np.array([-foot, -top, top, foot])
        middle = int(np.searchsorted(breaks, 0.0))
        breaks[middle:middle] = [-foot, foot]
        paint[middle:middle] = ["", ""]
    count = int((2 * half - 0.4) / (2 * BAR_WIDTH)) * 2 - 1  # bars and the gaps between them
    inner = BAR_WIDTH * (np.arange(count + 1) - 0.5 * count)
    offset = np.cumsum([0.0, 0.0, profile.kerb_width, profile.walk, profile.verge])
    height = np.array([0.0] + 4 * [profile.kerb_height])
    return CrossSection(
        name,
        half,
        np.array(breaks),
        tuple(paint),
        np.concatenate([[-half], inner, [half]]),
        forward,
        backward,
        w,
        np.stack([offset, height], axis=1),
        island,
        profile.kerb_height if len(island) else 0.0,
        MEDIAN_TOP.get(profile.median, ""),
    )
