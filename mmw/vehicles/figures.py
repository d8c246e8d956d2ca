"""Figures of people in mid-stride, from closed limbs. Figure frame: x forward, y left, z up, origin on the ground."""

from dataclasses import dataclass

import numpy as np

from mmw.vehicles.shapes import Shape, join, quads, weld

STRIDE = np.radians(18.0)
"""Swing of the legs to the front and to the back [rad]; of the arms, three quarters of it; design value."""

SIDES = 10
"""Facets around a limb."""


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
    colors: tuple[str, ...] = ("navy", "grey", "red", "ochre", "white")
    """Variants of the clothing; the first is the asset's own selection."""


FIGURES = {
    "man": Figure(1.79, 1.05),
    "woman": Figure(1.66, 0.95, has_skirt=True, colors=("red", "white", "navy", "grey", "ochre")),
    "child": Figure(1.25, 0.95, 1.25, colors=("ochre", "red", "white", "navy", "grey")),
}
"""Name -> figure. Heights: averages of adults and of eight-year-olds, rounded; design values."""


def limb(start, end, radii: tuple[tuple[float, float], ...], part: str, flatten: float = 1.0) -> Shape:
    """Return a closed body of revolution between two points, rounded off at both ends.

    Args:
        start: Axis' first point [m], shape [3].
        end: Axis' last point [m], shape [3].
        radii: (share of the way, radius [m]) along the axis; the ends close to a point.
        part: Part name of every face.
        flatten: Thickness along the frame's x against y [-], for upright limbs.
    """
    start, end = np.asarray(start, float), np.asarray(end, float)
    axis = (end - start) / np.linalg.norm(end - start)
    side = np.array([0.0, 1.0, 0.0])
    front = np.cross(side, axis)
    front /= np.linalg.norm(front)
    angle = 2 * np.pi * np.arange(SIDES + 1) / SIDES
    angle[-1] = angle[0]
    profile = [(radii[0][0], 0.0), *radii, (radii[-1][0], 0.0)]
    grid = np.empty((SIDES + 1, len(profile), 3))
    for column, (share, radius) in enumerate(profile):
        ring = flatten * np.cos(angle)[:, None] * front + np.sin(angle)[:, None] * side
        grid[:, column] = start + share * (end - start) + radius * ring
    return weld(quads(grid, lambda _, __: part))


def build_figure(name: str) -> Shape:
    """Return a figure with the parts `shirt`, `trousers`, `skin`, `hair` and `rubber` (shoes).

    Raises:
        ValueError: If there is no such figure.
    """
    if name not in FIGURES:
        raise ValueError(f"figure = {name!r}; needed is one of {', '.join(FIGURES)}; name one of them")
    figure = FIGURES[name]
    h, g = figure.height, figure.height * figure.build
    hip, shoulder = 0.52 * h, 0.80 * h
    sway = np.sin(STRIDE)
    shapes = [_trunk(h, g, hip, shoulder), *_head(h, figure.head)]
    if figure.has_skirt:
        shapes.append(limb((0, 0, 0.27 * h), (0, 0, 0.60 * h), ((0.0, 0.105 * g), (1.0, 0.085 * g)), "shirt", 0.9))
    for sign in (1, -1):
        swing = sign * sway
        y = 0.052 * g * sign
        knee = np.array([0.5 * swing * hip + 0.012 * h, y, 0.27 * h])
        ankle = np.array([swing * hip - 0.02 * h, y, 0.045 * h])
        shapes += [
            limb((0, y, hip), knee, ((0.0, 0.048 * g), (0.15, 0.052 * g), (1.0, 0.036 * g)), "trousers"),
            limb(knee, ankle, ((-0.05, 0.036 * g), (0.35, 0.038 * g), (1.0, 0.026 * g)), "trousers"),
            _shoe(ankle, h, g),
        ]
        arm = 0.108 * g * sign
        elbow = np.array([-0.75 * swing * 0.17 * h, 1.06 * arm, shoulder - 0.17 * h])
        hand = elbow + np.array([-0.75 * swing * 0.15 * h + 0.035 * h, 0.0, -0.15 * h])
        palm = hand + np.array([0.01 * h, 0.0, -0.07 * h])
        shapes += [
            limb((0, arm, shoulder), elbow, ((-0.05, 0.026 * g), (0.1, 0.031 * g), (1.0, 0.023 * g)), "shirt"),
            limb(elbow, hand, ((-0.05, 0.023 * g), (1.0, 0.017 * g)), "shirt"),
            limb(hand, palm, ((0.0, 0.016 * g), (0.5, 0.02 * g), (1.0, 0.012 * g)), "skin"),
        ]
    shape = join(shapes)
    return shape.moved((0.0, 0.0, -float(shape.points[:, 2].min())))


def _trunk(h: float, g: float, hip: float, shoulder: float) -> Shape:
    outline = (
        (0.0, 0.06 * g), (0.08, 0.09 * g), (0.35, 0.078 * g), (0.75, 0.10 * g), (0.93, 0.105 * g), (1.0, 0.06 * g)
    )  # fmt: skip
    return limb((0, 0, hip - 0.03 * h), (0, 0, shoulder + 0.03 * h), outline, "shirt", 0.62)


def _head(h: float, size: float) -> list[Shape]:
    low, top = h - 0.14 * h * size, h
    tall = top - low
    oval = ((0.04, 0.2 * tall), (0.25, 0.32 * tall), (0.6, 0.38 * tall), (0.88, 0.26 * tall), (1.0, 0.10 * tall))
    cap = ((0.42, 0.36 * tall), (0.6, 0.41 * tall), (0.9, 0.29 * tall), (1.0, 0.12 * tall))
    return [
        limb((0.005, 0, 0.80 * h), (0.012, 0, low + 0.3 * tall), ((0.0, 0.036 * h), (1.0, 0.033 * h)), "skin"),
        limb((0.012, 0, low), (0.012, 0, top - 0.005), oval, "skin", 1.15),
        limb((-0.012, 0, low), (-0.012, 0, top), cap, "hair", 1.1),
    ]


def _shoe(ankle: np.ndarray, h: float, g: float) -> Shape:
    """Return a shoe that stands level on the ground."""
    length = 0.15 * h
    heel = np.array([ankle[0] - 0.3 * length, ankle[1], 0.021 * g])
    toe = heel + np.array([length, 0.0, 0.0])
    return limb(heel, toe, ((0.0, 0.012 * g), (0.12, 0.021 * g), (0.7, 0.021 * g), (1.0, 0.01 * g)), "rubber")
