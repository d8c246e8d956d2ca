"""Lamps, grilles, plates, wipers and lettering of the vehicle models, as panels. All lengths in meters, body frame."""

from dataclasses import dataclass

from mmw.worlds.materials.vehicle_decals import PLATE_CELLS, cell
from mmw.worlds.vehicles.surface_panels import Panel, Side

PLATE = (0.52, 0.112)
"""Width and height of a number plate [m]; source: European plates of one line, 520 x 110 to 520 x 120 mm."""

Span = tuple[float, float]


@dataclass(frozen=True)
class CarFront:
    """The front of a car."""

    knee: float
    """y where the nose turns into the sides."""
    corner: float
    """Radius of that turn."""
    lamp: tuple[float, float, float, float]
    """Head lamp: inner y, inner and outer height of its foot, height of the lamp."""
    grille: tuple[float, float, float]
    """Half width, z of foot and top."""
    intake: tuple[float, float, float]
    """The same of the lower air intake."""


@dataclass(frozen=True)
class CarRear:
    """The rear of a car."""

    knee: float
    corner: float
    lamp: tuple[float, float, float, float]
    """Tail lamp: inner y, y of its outer end around the corner, z of foot and top."""
    brake: tuple[float, float, float]
    """Third brake lamp: half width, z of foot and top."""
    lid: tuple[float, float]
    """Edge of the lid: half width, z."""


def band(side: Side, u: Span, v: Span, part: str, rise: float = 0.004, **more) -> Panel:
    """Return a panel with upright and level edges."""
    corners = ((u[0], v[0]), (u[1], v[0]), (u[1], v[1]), (u[0], v[1]))
    return Panel(side, corners, part, rise, **more)


def plates(index: int, front_z: float, rear_z: float) -> tuple[Panel, ...]:
    """Return the two number plates of the model with this number."""
    half, height = PLATE[0] / 2, PLATE[1]
    return tuple(
        band(side, (-half, half), (z, z + height), "plates", 0.006, cells=(4, 1), picture=cell(index, PLATE_CELLS))
        for side, z in (("front", front_z), ("rear", rear_z))
    )


def face_panels(face: CarFront) -> tuple[Panel, ...]:
    """Return head lamps with indicators in dark housings, grille with bars and badge, air intake with fog lamps."""
    wrap, mirror = (face.knee, face.corner), True
    inner, foot, outer_foot, height = face.lamp
    end = face.knee + 1.15 * face.corner

    def lamp(start: float, stop: float, low: float, high: float, part: str, rise: float, cells: Span) -> Panel:
        def at(share: float, level: float) -> tuple[float, float]:
            y = inner + share * (end - inner)
            return y, foot + share * (outer_foot - foot) + level * height * (0.8 + 0.2 * share)

        corners = (at(start, low), at(stop, low), at(stop, high), at(start, high))
        columns, rows = int(cells[0]), int(cells[1])
        return Panel("front", corners, part, rise, 0.025, (columns, rows), mirror, wrap)

    half, low, high = face.grille
    bar = (high - low) / 4
    bars = [
        band("front", (-half + 0.03, half - 0.03), (low + k * bar - 0.006, low + k * bar + 0.006), "rims", 0.003,
             cells=(6, 1))
        for k in (1, 2, 3)
    ]  # fmt: skip
    middle = (low + high) / 2
    width, intake_low, intake_high = face.intake
    fog = (intake_low + intake_high) / 2
    return (
        lamp(0.0, 1.0, 0.0, 1.0, "gloss", 0.004, (7, 2)),
        lamp(0.06, 0.36, 0.14, 0.86, "lights_front", 0.004, (2, 1)),
        lamp(0.41, 0.76, 0.14, 0.86, "lights_front", 0.004, (3, 1)),
        lamp(0.81, 0.96, 0.2, 0.8, "lights_amber", 0.004, (1, 1)),
        band("front", (-half, half), (low, high), "gloss", cells=(6, 2), round=0.035),
        *bars,
        band("front", (-0.05, 0.05), (middle - 0.05, middle + 0.05), "rims", 0.006, round=0.049),
        band("front", (-width, width), (intake_low, intake_high), "trim", cells=(7, 1), round=0.03),
        band("front", (face.knee - 0.12, face.knee), (fog - 0.03, fog + 0.03), "lights_clear", 0.004, round=0.028,
             mirror=True),
    )  # fmt: skip


def back_panels(back: CarRear) -> tuple[Panel, ...]:
    """Return tail lamps with indicator and reverse lamp, third brake lamp, edge of the lid, reflectors."""
    inner, outer, low, high = back.lamp
    wrap, height = (back.knee, back.corner), high - low
    end = back.knee + outer
    if height > end - inner:  # upright: one above the other
        across = (inner + 0.015, back.knee + 0.4 * outer)
        clear, amber = (across, (low + 0.02, low + 0.28 * height)), (across, (low + 0.32 * height, low + 0.55 * height))
    else:
        span = 0.3 * (back.knee - inner) + 0.02
        upward = (low + 0.02, low + 0.36 * height)
        clear = ((inner + 0.02, inner + 0.02 + span), upward)
        amber = ((inner + 0.04 + span, inner + 0.04 + 2.2 * span), upward)
    half, brake_low, brake_high = back.brake
    return (
        band("rear", (inner, end), (low, high), "lights_rear", 0.006, round=0.025, cells=(6, 2), mirror=True,
             wrap=wrap),
        band("rear", *clear, "lights_clear", 0.003, round=0.012, mirror=True, wrap=wrap),
        band("rear", *amber, "lights_amber", 0.003, round=0.012, cells=(2, 1), mirror=True, wrap=wrap),
        band("rear", (-half, half), (brake_low, brake_high), "lights_brake", 0.006, cells=(3, 1)),
        band("rear", (-back.lid[0], back.lid[0]), (back.lid[1], back.lid[1] + 0.006), "trim", 0.003, cells=(6, 1)),
    )  # fmt: skip


def wipers(x: float, y: float, back: float) -> tuple[Panel, ...]:
    """Return two wipers at rest on the foot of a windshield, from (x, y) to the right, `back` further up its slope."""
    return tuple(
        Panel(
            "top",
            ((x, start), (x - 0.022, start), (x - back - 0.03, end), (x - back - 0.008, end)),
            "trim", 0.016, 0.0, (1, 3),
        )
        for start, end in ((y, 0.06), (0.0, -y + 0.06))
    )  # fmt: skip


def side_marker(x: float, z: float) -> Panel:
    """Return the amber repeaters of the indicators on both wings."""
    return band("left", (x - 0.045, x + 0.045), (z - 0.014, z + 0.014), "lights_amber", 0.006, round=0.013, mirror=True)


TRUCK_PANELS = (
    band("front", (0.58, 0.95), (0.66, 0.86), "gloss", round=0.03, cells=(4, 1), mirror=True, wrap=(0.84, 0.16)),
    band("front", (0.62, 0.80), (0.69, 0.83), "lights_front", 0.004, round=0.05, mirror=True),
    band("front", (0.83, 0.93), (0.69, 0.83), "lights_amber", 0.004, round=0.02, mirror=True, wrap=(0.84, 0.16)),
    band("front", (-0.62, 0.62), (0.98, 1.16), "gloss", round=0.03, cells=(6, 1)),
    band("front", (-0.58, 0.58), (1.06, 1.08), "rims", 0.008, cells=(6, 1)),
    band("front", (-0.5, 0.5), (0.47, 0.60), "gloss", round=0.03, cells=(4, 1)),
    band("left", (-3.3, 1.1), (1.3, 2.95), "lettering", 0.003, picture=(0.0, 0.0, 1.0, 1.0)),
    band("right", (-3.3, 1.1), (1.3, 2.95), "lettering", 0.003, picture=(0.0, 0.0, 1.0, 1.0)),
    band("rear", (0.50, 0.86), (0.74, 0.90), "lights_rear", 0.006, round=0.02, mirror=True),
    band("rear", (0.53, 0.62), (0.76, 0.88), "lights_clear", 0.003, round=0.02, mirror=True),
    band("rear", (0.74, 0.83), (0.76, 0.88), "lights_amber", 0.003, round=0.02, mirror=True),
    band("rear", (-0.006, 0.006), (1.06, 3.14), "trim", 0.003),
    band("rear", (0.20, 0.23), (1.08, 3.12), "rims", 0.004, mirror=True),
    band("rear", (0.17, 0.33), (1.55, 1.59), "trim", 0.006, mirror=True),
    band("rear", (1.02, 1.09), (1.3, 1.36), "trim", 0.005, mirror=True),
    band("rear", (1.02, 1.09), (2.7, 2.76), "trim", 0.005, mirror=True),
    band("rear", (0.9, 1.06), (3.09, 3.13), "lights_rear", 0.005, mirror=True),
    *(band("left", (x - 0.06, x + 0.06), (1.06, 1.11), "lights_amber", mirror=True) for x in (1.0, -0.4, -1.9, -3.4)),
)
"""Panels of the box truck: lamps, grille, lettering on the box, doors of the box with their bars and hinges."""

BUS_PANELS = (
    band("front", (0.66, 1.22), (0.56, 0.84), "gloss", round=0.05, cells=(4, 1), mirror=True, wrap=(1.06, 0.2)),
    band("front", (0.70, 0.86), (0.62, 0.78), "lights_front", 0.004, round=0.075, mirror=True),
    band("front", (0.89, 1.05), (0.62, 0.78), "lights_front", 0.004, round=0.075, mirror=True),
    band("front", (1.08, 1.18), (0.62, 0.78), "lights_amber", 0.004, round=0.02, mirror=True, wrap=(1.06, 0.2)),
    band("front", (-0.5, 0.5), (0.42, 0.52), "gloss", round=0.03, cells=(4, 1)),
    band("front", (-0.78, 0.78), (2.52, 2.78), "sign", 0.006, cells=(8, 1), picture=(0.0, 0.0, 1.0, 1.0)),
    *(
        Panel("front", ((y, 1.30), (y - 0.05, 1.33), (y - 0.78, 1.52), (y - 0.76, 1.47)), "trim", 0.010, 0.0, (1, 5))
        for y in (0.86, 0.04)
    ),
    band("rear", (-0.85, 0.85), (0.82, 1.34), "trim", cells=(6, 1), round=0.03),
    *(band("rear", (-0.78, 0.78), (z, z + 0.02), "gloss", 0.003, cells=(4, 1)) for z in (0.9, 1.0, 1.1, 1.2)),
    band("rear", (0.98, 1.14), (0.66, 1.34), "lights_rear", 0.006, round=0.04, mirror=True),
    band("rear", (1.00, 1.12), (0.90, 1.04), "lights_amber", 0.003, round=0.04, mirror=True),
    band("rear", (1.00, 1.12), (0.70, 0.84), "lights_clear", 0.003, round=0.04, mirror=True),
    band("rear", (-0.25, 0.25), (2.84, 2.87), "lights_brake", 0.006, cells=(3, 1)),
    *(band("right", (x - 0.012, x + 0.012), (0.42, 2.58), "trim", 0.006) for x in (5.22, 4.64, 4.06, 0.7, 0.08, -0.54)),
    *(band("right", (x + 0.05, x + 0.08), (1.3, 1.9), "rims", 0.008) for x in (4.06, 4.64, -0.54, 0.08)),
    *(band("left", (x - 0.06, x + 0.06), (0.72, 0.77), "lights_amber", 0.003, mirror=True)
      for x in (4.2, 1.5, -1.2, -4.4)),
)  # fmt: skip
"""Panels of the city bus: lamps, destination sign, wipers, engine grille, edges and grab rails of the doors."""
