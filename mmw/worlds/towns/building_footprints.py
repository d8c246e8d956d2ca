"""Plans of buildings: closed counter-clockwise rings about the origin whose first edge is the street front."""

from dataclasses import dataclass

import numpy as np

NOTCH = (0.45, 0.40)
"""Part of width and depth that is missing at the back of an L-shaped plan (fractions); design values."""
CUT = (0.18, 6.0)
"""Length of a cut corner: part of the shorter side (fraction), and the most [m]; design values."""


def rectangle(width: float, depth: float, inset: float = 0.0) -> np.ndarray:
    """Return the corners of a rectangle about the origin, counter-clockwise, its sides moved in by `inset` [m]."""
    x, y = 0.5 * width - inset, 0.5 * depth - inset
    return np.array([[-x, -y], [x, -y], [x, y], [-x, y]])


@dataclass(frozen=True)
class Plan:
    """Outline of one storey of a building."""

    form: str
    """`rectangle`, `l_shape` (a corner at the back is missing) or `corner_cut` (a corner at the street is cut off)."""
    width: float
    """Extent along the street [m]."""
    depth: float
    """Extent away from it [m]."""
    is_mirrored: bool = False
    """Whether the left corner is missing instead of the right one."""

    def ring(self, inset: float = 0.0) -> np.ndarray:
        """Return the corners, counter-clockwise from the left end of the front, all sides moved in by `inset` [m].

        Returns:
            Corners [m], shape [K, 2]; K does not depend on the inset.
        """
        if self.form == "rectangle":
            return rectangle(self.width, self.depth, inset)
        x, y = 0.5 * self.width, 0.5 * self.depth
        if self.form == "l_shape":
            a, b = x - NOTCH[0] * self.width, y - NOTCH[1] * self.depth
            ring = np.array([[-x, -y], [x, -y], [x, b], [a, b], [a, y], [-x, y]])
        else:
            c = min(CUT[0] * min(self.width, self.depth), CUT[1])
            ring = np.array([[-x, -y], [x - c, -y], [x, -y + c], [x, y], [-x, y]])
        if self.is_mirrored:
            ring = np.roll((ring * [-1.0, 1.0])[::-1], 2, axis=0)
        return offset(ring, inset) if inset else ring

    def scaled(self, width: float, depth: float) -> "Plan":
        """Return the same form with another extent [m]."""
        return Plan(self.form, width, depth, self.is_mirrored)


def offset(ring: np.ndarray, inset: float) -> np.ndarray:
    """Return a counter-clockwise polygon [K, 2] with every side moved in by `inset` [m]; corners stay mitred."""
    along = np.roll(ring, -1, axis=0) - ring
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    inward = np.column_stack([-along[:, 1], along[:, 0]])
    before = np.roll(inward, 1, axis=0)
    return ring + inset * (before + inward) / (1.0 + np.sum(before * inward, axis=1, keepdims=True))
