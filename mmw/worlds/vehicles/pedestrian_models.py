"""Figures of people in mid-stride, from closed limbs. Figure frame: x forward, y left, z up, origin on the ground."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mmw.core.errors import InputError
from mmw.worlds.vehicles.primitives import Shape, join, pod, quads, weld

STRIDE = np.radians(18.0)
"""Swing of the legs to the front and to the back [rad]; of the arms, three quarters of it; design value."""

SIDES = 12
"""Facets around a limb."""

ANGLES = 2 * np.pi * np.append(np.arange(SIDES), 0) / SIDES
"""Angles of the edges of the facets, the last one that of the first [rad]."""


@dataclass(frozen=True)
class Figure:
    """One kind of person. Proportions are those of a body 1 m tall, scaled by `height`.

    Source of the proportions: Drillis and Contini, Body Segment Parameters, 1966, as drawn in Winter, Biomechanics and
    Motor Control of Human Movement, 4th ed., figure 4.1, rounded to 0.01.
    """

    height: float
    """Crown of the head above the ground [m]."""
    build: float = 1.0
    """Girth against the average [-]."""
    head: float = 1.0
    """Size of the head against the average [-]; a child's is larger."""
    has_skirt: bool = False
    """Whether a coat or skirt reaches to the knees."""
    has_long_hair: bool = False
    """Whether the hair reaches to the shoulders."""
    has_short_sleeves: bool = False
    """Whether the forearms are bare."""
    skin: str = "skin"
    """Material of the library, as are the next two."""
    hair: str = "hair"
    trousers: str = "cloth_dark"
    colors: tuple[str, ...] = ("navy", "grey", "red", "ochre", "white", "olive", "teal")
    """Variants of the clothing; the first is the asset's own selection."""


FIGURES = {
    "man": Figure(1.79, 1.05, trousers="cloth_denim"),
    "woman": Figure(
        1.66, 0.95, has_skirt=True, has_long_hair=True, skin="skin_light", hair="hair_brown",
        colors=("red", "white", "navy", "grey", "ochre", "olive", "teal"),
    ),
    "child": Figure(
        1.25, 0.95, 1.25, has_short_sleeves=True, skin="skin_dark", trousers="cloth_beige",
        colors=("ochre", "red", "white", "navy", "grey", "olive", "teal"),
    ),
}  # fmt: skip
"""Name -> figure. Heights: averages of adults and of eight-year-olds, rounded; design values."""


def limb(start, end, radii: tuple[tuple[float, float], ...], part: str, flatten: float = 1.0) -> Shape:
    """Return a closed body of revolution between two points, rounded off at both ends.

    Args:
        start: Axis' first point [m], shape [3].
        end: Axis' last point [m], shape [3].
        radii: (share of the axis, radius [m]); the ends close to a point.
        part: Part name of every face.
        flatten: Thickness along the frame's x against y [-], for upright limbs.
    """
    start, end = np.asarray(start, float), np.asarray(end, float)
    axis = (end - start) / np.linalg.norm(end - start)
    side = np.array([0.0, 1.0, 0.0])
    front = np.cross(side, axis)
    front /= np.linalg.norm(front)
    share, radius = np.array([(radii[0][0], 0.0), *radii, (radii[-1][0], 0.0)]).T[:, :, None]
    ring = flatten * np.cos(ANGLES)[:, None] * front + np.sin(ANGLES)[:, None] * side
    return weld(quads(start + share * (end - start) + radius * ring[:, None], lambda _, __: part))


def loft(rings: Sequence[tuple[float, float, float, float]], part: str) -> Shape:
    """Return a closed upright body of elliptic sections, closed to a point at both ends.

    Args:
        rings: Height, middle along x, half depth along x, half width along y [m] of each section, from below.
        part: Part name of every face.
    """
    table = np.array([(*rings[0][:2], 0.0, 0.0), *rings, (*rings[-1][:2], 0.0, 0.0)])
    grid = np.empty((SIDES + 1, len(table), 3))
    grid[..., 0] = table[:, 1] + np.cos(ANGLES)[:, None] * table[:, 2]
    grid[..., 1] = np.sin(ANGLES)[:, None] * table[:, 3]
    grid[..., 2] = table[:, 0]
    return weld(quads(grid, lambda _, __: part))


def build_figure(name: str) -> Shape:
    """Return a figure with the parts `shirt`, `trousers`, `skin`, `hair`, `eyes`, `lips` and `rubber` (shoes).

    Raises:
        InputError: If there is no such figure.
    """
    if name not in FIGURES:
        raise InputError(f"figure = {name!r}; needed is one of {', '.join(FIGURES)}; name one of them")
    figure = FIGURES[name]
    h, g = figure.height, figure.height * figure.build
    shapes = [*trunk(h, g, figure.has_skirt), *head(h, figure)]
    for sign in (1, -1):
        shapes += [
            *_leg(h, g, sign, 0.042 if figure.has_skirt else 0.050),
            *_arm(h, g, sign, "skin" if figure.has_short_sleeves else "shirt"),
        ]
    shape = join(shapes)
    return shape.moved((0.0, 0.0, -float(shape.points[:, 2].min())))


def trunk(h: float, g: float, has_skirt: bool) -> list[Shape]:
    """Return shirt and hips of a standing figure of height `h` and girth `g` [m], or a coat to the knees."""
    chest = (
        (0.55, 0.0, 0.063, 0.090), (0.61, 0.0, 0.057, 0.082), (0.68, 0.004, 0.062, 0.093), (0.74, 0.007, 0.067, 0.102),
        (0.785, 0.002, 0.061, 0.107), (0.812, -0.003, 0.050, 0.096), (0.832, -0.006, 0.038, 0.060),
        (0.850, -0.003, 0.034, 0.035),
    )  # fmt: skip
    hem = ((0.475, 0.0, 0.06, 0.085), (0.48, 0.0, 0.075, 0.106), (0.52, 0.0, 0.072, 0.102))
    if has_skirt:
        hem = (
            (0.285, 0.01, 0.15, 0.105),
            (0.29, 0.01, 0.168, 0.123),
            (0.42, 0.004, 0.122, 0.118),
            (0.52, 0.0, 0.078, 0.104),
        )
    hips = ((0.44, 0.0, 0.028, 0.04), (0.455, 0.0, 0.055, 0.085), (0.50, 0.0, 0.062, 0.092), (0.53, 0.0, 0.05, 0.08))
    return [
        loft([(z * h, x * g, depth * g, width * g) for z, x, depth, width in rings], part)
        for rings, part in (((*hem, *chest), "shirt"), (hips, "trousers"))
    ]


def _leg(h: float, g: float, sign: int, apart: float) -> list[Shape]:
    hip, swing = 0.52 * h, sign * np.sin(STRIDE)
    y = apart * g * sign
    knee = np.array([0.5 * swing * hip + 0.012 * h, y, 0.27 * h])
    ankle = np.array([swing * hip - 0.02 * h, y, 0.045 * h])
    thigh = ((-0.03, 0.02), (0.0, 0.034), (0.2, 0.051), (0.5, 0.049), (0.9, 0.039), (1.0, 0.037), (1.06, 0.026))
    shin = ((-0.1, 0.02), (-0.04, 0.034), (0.05, 0.037), (0.3, 0.041), (0.7, 0.034), (0.97, 0.030), (1.0, 0.024))
    return [
        limb((0, y, hip), knee, tuple((share, radius * g) for share, radius in thigh), "trousers"),
        limb(knee, ankle, tuple((share, radius * g) for share, radius in shin), "trousers"),
        shoe(ankle, h, g),
    ]


def _arm(h: float, g: float, sign: int, forearm: str) -> list[Shape]:
    swing, shoulder = sign * np.sin(STRIDE), 0.795 * h
    y = 0.104 * g * sign
    elbow = np.array([-0.75 * swing * 0.17 * h, 1.16 * y, shoulder - 0.17 * h])
    hand = elbow + np.array([-0.75 * swing * 0.15 * h + 0.035 * h, 0.0, -0.15 * h])
    palm = hand + np.array([0.014 * h, 0.0, -0.085 * h])
    upper = ((-0.1, 0.010), (-0.06, 0.021), (0.06, 0.031), (0.3, 0.031), (0.8, 0.026), (1.0, 0.025), (1.06, 0.016))
    lower = ((-0.12, 0.012), (-0.06, 0.022), (0.06, 0.025), (0.4, 0.023), (0.97, 0.017), (1.0, 0.013))
    fist = ((-0.1, 0.011), (0.1, 0.013), (0.4, 0.018), (0.75, 0.017), (0.95, 0.011), (1.0, 0.006))
    return [
        limb((0, y, shoulder), elbow, tuple((share, radius * g) for share, radius in upper), "shirt"),
        limb(elbow, hand, tuple((share, radius * g) for share, radius in lower), forearm),
        limb(hand, palm, tuple((share, radius * g) for share, radius in fist), "skin", 1.3),
    ]


_SKULL = (
    (0.02, 0.13, 0.13, 0.12), (0.10, 0.09, 0.25, 0.20), (0.28, 0.04, 0.33, 0.275), (0.45, 0.0, 0.395, 0.315),
    (0.62, -0.02, 0.415, 0.33), (0.80, -0.03, 0.375, 0.295), (0.92, -0.03, 0.26, 0.205), (0.98, -0.03, 0.13, 0.10),
)  # fmt: skip
"""Sections of the head: height above the chin, middle along x, half depth, half width, as shares of its height; after
a breadth of 0.66 and a depth of 0.83 of the height of the head. Design values."""

_HAIR = (
    (0.20, -0.26, 0.10, 0.20), (0.24, -0.24, 0.17, 0.28), (0.38, -0.21, 0.24, 0.33), (0.52, -0.17, 0.305, 0.350),
    (0.62, -0.12, 0.36, 0.362), (0.74, -0.05, 0.42, 0.352), (0.86, -0.03, 0.385, 0.30), (0.96, -0.03, 0.27, 0.20),
    (1.02, -0.03, 0.13, 0.10),
)  # fmt: skip
"""Sections of the hair, likewise."""

_LONG_HAIR = (
    (-0.28, -0.30, 0.06, 0.16), (-0.25, -0.29, 0.12, 0.26), (0.0, -0.27, 0.17, 0.34), (0.24, -0.24, 0.22, 0.36),
)  # fmt: skip


def head(h: float, figure: Figure) -> list[Shape]:
    """Return neck, head, hair and face of a standing figure of height `h` [m]."""
    tall = 0.135 * h * figure.head
    low, middle = h - 1.02 * tall, 0.014 * h

    def sections(table) -> list[tuple[float, float, float, float]]:
        return [(low + t * tall, middle + x * tall, depth * tall, width * tall) for t, x, depth, width in table]

    def bead(t: float, x: float, y: float, half: tuple[float, float, float], part: str) -> Shape:
        centre = np.array([middle + x * tall, y * tall, low + t * tall])
        return pod(centre - np.array(half) * tall, centre + np.array(half) * tall, part, 6, 4)

    hair = (*_LONG_HAIR, *_HAIR[2:]) if figure.has_long_hair else _HAIR
    neck = ((0.0, 0.035 * h), (0.5, 0.031 * h), (1.0, 0.031 * h))
    nose = ((0.0, 0.02 * tall), (0.4, 0.04 * tall), (0.85, 0.055 * tall), (1.0, 0.03 * tall))
    face = [bead(0.2, 0.345, 0.0, (0.03, 0.095, 0.024), "lips")]
    for side in (1, -1):
        face.append(bead(0.53, 0.35, 0.135 * side, (0.03, 0.045, 0.022), "eyes"))
        face.append(bead(0.605, 0.36, 0.14 * side, (0.025, 0.065, 0.016), "hair"))
        if not figure.has_long_hair:
            face.append(bead(0.45, -0.02, 0.335 * side, (0.07, 0.035, 0.11), "skin"))
    top = np.array([middle + 0.36 * tall, 0.0, low + 0.55 * tall])
    tip = np.array([middle + 0.40 * tall, 0.0, low + 0.32 * tall])
    return [
        limb((0.0, 0, 0.80 * h), (middle, 0, low + 0.3 * tall), neck, "skin"),
        loft(sections(_SKULL), "skin"),
        loft(sections(hair), "hair"),
        limb(top, tip, nose, "skin"),
        *face,
    ]


def shoe(ankle: np.ndarray, h: float, g: float) -> Shape:
    """Return a shoe level on the ground."""
    length = 0.15 * h
    heel = np.array([ankle[0] - 0.3 * length, ankle[1], 0.024 * g])
    outline = ((0.0, 0.012), (0.05, 0.020), (0.2, 0.024), (0.45, 0.024), (0.75, 0.023), (0.93, 0.017), (1.0, 0.010))
    return limb(heel, heel + np.array([length, 0.0, 0.0]), tuple((share, r * g) for share, r in outline), "rubber")
