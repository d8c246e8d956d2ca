"""Dimensions of every vehicle model, after typical vehicles of each class. All lengths in meters, in the body frame."""

from dataclasses import dataclass

from mmw.worlds.vehicles.body_details import (
    BUS_PANELS,
    TRUCK_PANELS,
    CarFront,
    CarRear,
    back_panels,
    band,
    face_panels,
    plates,
    side_marker,
    wipers,
)
from mmw.worlds.vehicles.surface_panels import Panel

Table = tuple[tuple[float, float], ...]
"""Pairs (where, value), interpolated linearly and held beyond the ends."""


@dataclass(frozen=True)
class Wheels:
    """Four wheels of one radius."""

    radius: float
    width: float
    rim: float
    """Rim radius [m]."""
    track: float
    """Distance between the middles of the left and the right tyre [m]."""
    spokes: int = 5
    rear_width: float = 0.0
    """Width of a rear wheel, where it is a twin; 0 for `width`. The outer side stays in line with the front wheel."""


@dataclass(frozen=True)
class Body:
    """A lofted skin: what `mmw.worlds.vehicles.body_loft.build_skin` needs. x is forward, from the middle between the
    axles."""

    front: float
    rear: float
    half_width: float
    axles: tuple[float, ...]
    """x of the axles that have an arch in this skin."""
    axle_height: float
    arch_radius: float
    well_y: float
    """y of the inner wall of the wheel wells."""
    top: Table
    """Height of the center line by x: hood, windshield, roof, tail."""
    belt: Table
    """Height of the shoulder below the side windows by x."""
    floor: Table
    """Height of the floor by x."""
    plan: Table
    """Share of the half width by x: the taper of nose and tail in plan."""
    side: Table
    """Share of the half width by z, below the belt; flat between the heights named."""
    screens: tuple[tuple[float, float], ...]
    """x from, to of windshield and rear window."""
    windows: tuple[tuple[float, float], ...]
    """x from, to of each side window."""
    pillars: tuple[tuple[float, float], ...] = ()
    """x from, to of each dark pillar between side windows."""
    right_doors: tuple[tuple[float, float], ...] = ()
    """x from, to of each glazed door on the right side."""
    seams: tuple[float, ...] = ()
    """x of each door edge."""
    tumblehome: float = 0.4
    """Lean of the side windows inward, per meter of height."""
    crown: float = 0.03
    """Drop of the hood from its middle to its edge."""
    roof_crown: float = 0.06
    """Drop of the roof from its middle to its edge."""
    ledge: float = 0.025
    """Width of the step at the foot of the side windows."""
    frame: float = 0.06
    """Height of the door frame above the side windows."""
    lip: float = 0.05
    """Height of the dark cladding along the lower edge and the arches."""
    mid_z: float = 0.38
    """Height of the lowest crease of the side."""
    char_z: float = 0.64
    """Height of the character line: the widest row."""
    columns: tuple[float, ...] = (0.0, 0.45, 0.66, 0.82, 0.93, 1.0)
    """Lattice lines across hood, roof and ends, as shares of the half width; flat up to the second."""
    nose: tuple[float, Table] = (0.14, ((0.2, 0.05), (0.38, 0.0), (0.5, 0.0), (0.64, 0.03), (0.76, 0.10)))
    """Bow in plan, and set-back by height, of the nose."""
    tail: tuple[float, Table] = (0.12, ((0.2, 0.06), (0.38, 0.0), (0.64, 0.0), (0.68, 0.02), (1.0, 0.10)))
    """Bow in plan, and set-back by height, of the tail."""
    nose_parts: tuple[tuple[int, int, int, int, str], ...] = ()
    """Parts of the nose: column from, to, row from, to, name; later entries win."""
    tail_parts: tuple[tuple[int, int, int, int, str], ...] = ()
    """Parts of the tail."""
    bed: tuple[float, float, float] | None = None
    """Open load bed: x of its front and rear wall and height of its floor. The third and fourth lattice line from
    outside bound the humps above the wheels."""


@dataclass(frozen=True)
class Block:
    """A box added to the skin, its edges bevelled or rounded."""

    low: tuple[float, float, float]
    high: tuple[float, float, float]
    part: str
    bevel: float = 0.0
    mirror: bool = False
    """True for a second one at -y."""
    is_pod: bool = False
    """True for a shell with rounded sides, on which no panel lies."""


@dataclass(frozen=True)
class Blueprint:
    """One vehicle model."""

    label: str
    """Semantic class, a key of `mmw.usd.semantics.CARLA_TAG`."""
    length: float
    width: float
    """Width without mirrors."""
    height: float
    wheelbase: float
    wheels: Wheels
    bodies: tuple[Body, ...]
    blocks: tuple[Block, ...] = ()
    panels: tuple[Panel, ...] = ()
    """On the bodies, on the blocks that are no pods, and on the panels before."""
    paints: tuple[str, ...] = ("red", "blue", "white", "black", "silver", "green", "grey", "graphite")
    """Paint variants; the first one is the default."""


_FRONT_CAR = ((0, 5, 0, 1, "trim"),)
_REAR_CAR = ((0, 5, 0, 2, "trim"),)

_SEDAN = Body(
    front=2.265, rear=-2.435, half_width=0.925, axles=(1.4, -1.4), axle_height=0.325, arch_radius=0.365, well_y=0.66,
    top=((2.265, 0.76), (2.14, 0.82), (1.6, 0.92), (1.05, 0.985), (0.22, 1.375), (0.0, 1.42), (-0.35, 1.45),
         (-0.75, 1.44), (-1.1, 1.39), (-1.80, 1.10), (-1.95, 1.075), (-2.3, 1.05), (-2.435, 1.02)),
    belt=((2.265, 0.72), (2.14, 0.77), (1.6, 0.85), (1.05, 0.90), (-1.0, 0.955), (-1.8, 0.985), (-2.435, 0.98)),
    floor=((2.265, 0.24), (1.9, 0.18), (-1.9, 0.18), (-2.435, 0.28)),
    plan=((2.265, 0.90), (2.14, 0.955), (1.98, 0.985), (1.79, 1.0), (-1.79, 1.0), (-2.1, 0.985), (-2.3, 0.96),
          (-2.435, 0.92)),
    side=((0.18, 0.94), (0.38, 0.975), (0.64, 1.0), (1.0, 0.955)),
    screens=((1.05, 0.22), (-1.1, -1.80)), windows=((0.78, -0.16), (-0.22, -1.02), (-1.07, -1.42)),
    pillars=((-0.16, -0.22), (-1.02, -1.07)), seams=(0.98, -0.19, -1.02), tumblehome=0.42,
    nose_parts=_FRONT_CAR, tail_parts=_REAR_CAR,
)  # fmt: skip

_HATCHBACK = Body(
    front=2.165, rear=-2.115, half_width=0.895, axles=(1.315, -1.315), axle_height=0.316, arch_radius=0.355,
    well_y=0.64,
    top=((2.165, 0.79), (2.05, 0.85), (1.55, 0.95), (1.02, 1.02), (0.25, 1.38), (0.03, 1.43), (-0.35, 1.46),
         (-0.9, 1.45), (-1.35, 1.405), (-1.56, 1.36), (-1.96, 1.04), (-2.06, 1.01), (-2.115, 0.98)),
    belt=((2.165, 0.75), (2.05, 0.80), (1.55, 0.88), (1.02, 0.935), (-0.9, 0.975), (-1.96, 1.0), (-2.115, 0.95)),
    floor=((2.165, 0.23), (1.8, 0.17), (-1.7, 0.17), (-2.115, 0.27)),
    plan=((2.165, 0.89), (2.05, 0.95), (1.88, 0.985), (1.7, 1.0), (-1.7, 1.0), (-1.96, 0.975), (-2.115, 0.93)),
    side=((0.17, 0.94), (0.38, 0.975), (0.66, 1.0), (1.0, 0.955)),
    screens=((1.02, 0.25), (-1.56, -1.96)), windows=((0.76, -0.22), (-0.28, -1.0), (-1.08, -1.36)),
    pillars=((-0.22, -0.28),), seams=(0.96, -0.25, -1.02), tumblehome=0.38, mid_z=0.38, char_z=0.66,
    nose_parts=_FRONT_CAR, tail_parts=_REAR_CAR,
    nose=(0.14, ((0.2, 0.04), (0.38, 0.0), (0.5, 0.0), (0.66, 0.03), (0.79, 0.09))),
    tail=(0.12, ((0.2, 0.05), (0.38, 0.0), (0.66, 0.0), (0.7, 0.02), (1.0, 0.06))),
)  # fmt: skip

_SUV = Body(
    front=2.27, rear=-2.38, half_width=0.94, axles=(1.35, -1.35), axle_height=0.36, arch_radius=0.41, well_y=0.66,
    top=((2.27, 0.97), (2.16, 1.03), (1.6, 1.10), (1.08, 1.15), (0.42, 1.58), (0.18, 1.64), (-0.3, 1.69), (-1.2, 1.68),
         (-1.75, 1.64), (-1.98, 1.59), (-2.25, 1.17), (-2.33, 1.13), (-2.38, 1.08)),
    belt=((2.27, 0.93), (2.16, 0.98), (1.6, 1.04), (1.08, 1.07), (-1.0, 1.11), (-2.25, 1.14), (-2.38, 1.05)),
    floor=((2.27, 0.32), (1.9, 0.23), (-1.85, 0.23), (-2.38, 0.36)),
    plan=((2.27, 0.90), (2.16, 0.955), (2.0, 0.985), (1.79, 1.0), (-1.79, 1.0), (-2.15, 0.98), (-2.38, 0.93)),
    side=((0.23, 0.955), (0.48, 0.985), (0.80, 1.0), (1.12, 0.965)),
    screens=((1.08, 0.42), (-1.98, -2.25)), windows=((0.82, -0.22), (-0.28, -1.1), (-1.17, -1.82)),
    pillars=((-0.22, -0.28), (-1.1, -1.17)), seams=(0.93, -0.25, -1.04), tumblehome=0.32, lip=0.1, mid_z=0.48,
    char_z=0.80,
    nose_parts=_FRONT_CAR,
    tail_parts=_REAR_CAR,
    nose=(0.14, ((0.3, 0.05), (0.48, 0.0), (0.65, 0.0), (0.80, 0.02), (0.97, 0.08))),
    tail=(0.10, ((0.3, 0.04), (0.48, 0.0), (0.80, 0.0), (0.84, 0.02), (1.1, 0.06))),
)  # fmt: skip

_PICKUP = Body(
    front=2.53, rear=-2.79, half_width=0.93, axles=(1.545, -1.545), axle_height=0.385, arch_radius=0.44, well_y=0.63,
    top=((2.53, 1.05), (2.42, 1.12), (1.85, 1.19), (1.30, 1.24), (0.65, 1.69), (0.42, 1.76), (0.0, 1.82), (-0.5, 1.81),
         (-0.76, 1.77), (-0.98, 1.20), (-1.0, 1.13), (-2.74, 1.13), (-2.79, 1.11)),
    belt=((2.53, 1.01), (2.42, 1.07), (1.85, 1.12), (1.30, 1.14), (-0.95, 1.16), (-1.0, 1.12), (-2.74, 1.12),
          (-2.79, 1.08)),
    floor=((2.53, 0.42), (2.15, 0.35), (-2.1, 0.35), (-2.79, 0.48)),
    plan=((2.53, 0.90), (2.42, 0.955), (2.25, 0.985), (2.03, 1.0), (-2.7, 1.0), (-2.79, 0.985)),
    side=((0.35, 0.96), (0.56, 0.985), (0.86, 1.0), (1.2, 0.965)),
    screens=((1.30, 0.65), (-0.76, -0.98)), windows=((1.02, 0.12), (0.06, -0.66)),
    pillars=((0.12, 0.06),), seams=(1.08, 0.09, -0.74, -0.99), tumblehome=0.34, crown=0.03, lip=0.07, mid_z=0.56,
    char_z=0.86, columns=(0.0, 0.62, 0.645, 0.87, 0.90, 1.0), bed=(-1.08, -2.70, 0.66), roof_crown=0.05,
    nose_parts=_FRONT_CAR,
    tail_parts=_REAR_CAR,
    nose=(0.12, ((0.4, 0.05), (0.56, 0.0), (0.75, 0.0), (0.86, 0.02), (1.05, 0.08))),
    tail=(0.0, ((0.45, 0.03), (0.56, 0.0), (1.1, 0.01))),
)  # fmt: skip

_VAN = Body(
    front=2.475, rear=-2.655, half_width=0.965, axles=(1.6, -1.6), axle_height=0.335, arch_radius=0.385, well_y=0.68,
    top=((2.475, 0.96), (2.38, 1.03), (2.05, 1.15), (1.78, 1.25), (1.08, 1.78), (0.86, 1.85), (0.4, 1.90), (-0.4, 1.91),
         (-2.4, 1.90), (-2.6, 1.87), (-2.655, 1.83)),
    belt=((2.475, 0.92), (2.38, 0.98), (2.05, 1.08), (1.78, 1.12), (1.0, 1.13), (-2.655, 1.13)),
    floor=((2.475, 0.27), (2.1, 0.2), (-2.1, 0.2), (-2.655, 0.3)),
    plan=((2.475, 0.90), (2.38, 0.95), (2.2, 0.985), (1.99, 1.0), (-2.4, 1.0), (-2.6, 0.985), (-2.655, 0.965)),
    side=((0.2, 0.955), (0.42, 0.985), (0.74, 1.0), (1.14, 0.985)),
    screens=((1.78, 1.08),), windows=((1.50, 1.06), (1.02, 0.42)), pillars=((1.06, 1.02),),
    seams=(1.34, 0.34, -0.66, -2.3), tumblehome=0.17, roof_crown=0.07, lip=0.06, mid_z=0.42, char_z=0.74, frame=0.12,
    nose_parts=_FRONT_CAR,
    tail_parts=(*_REAR_CAR, (0, 4, 6, 7, "glass")),
    nose=(0.14, ((0.3, 0.05), (0.42, 0.0), (0.6, 0.0), (0.74, 0.03), (0.96, 0.10))),
    tail=(0.02, ((0.3, 0.03), (0.42, 0.0), (0.74, 0.0), (0.8, 0.015), (1.2, 0.03), (1.9, 0.07))),
)  # fmt: skip

_CAB = Body(
    front=3.09, rear=1.42, half_width=1.02, axles=(2.0,), axle_height=0.40, arch_radius=0.47, well_y=0.72,
    top=((3.09, 1.30), (3.0, 1.36), (2.70, 2.10), (2.55, 2.20), (2.2, 2.26), (1.6, 2.26), (1.46, 2.24), (1.42, 2.20)),
    belt=((3.09, 1.26), (3.0, 1.28), (2.7, 1.28), (1.42, 1.28)),
    floor=((3.09, 0.42), (1.42, 0.42)),
    plan=((3.09, 0.93), (3.0, 0.97), (2.85, 0.99), (2.6, 1.0), (1.42, 1.0)),
    side=((0.42, 0.97), (0.65, 0.99), (0.95, 1.0), (1.3, 0.985)),
    screens=((3.0, 2.70),), windows=((2.84, 1.78),), seams=(2.76, 1.66), tumblehome=0.13, ledge=0.015, lip=0.08,
    mid_z=0.65, char_z=0.92, roof_crown=0.07,
    nose_parts=_FRONT_CAR,
    nose=(0.10, ((0.42, 0.02), (0.6, 0.0), (0.9, 0.0), (1.3, 0.05))), tail=(0.0, ((0.0, 0.0), (3.0, 0.0))),
)  # fmt: skip

_BUS = Body(
    front=5.64, rear=-6.35, half_width=1.275, axles=(2.95, -2.95), axle_height=0.48, arch_radius=0.55, well_y=0.88,
    top=((5.64, 2.86), (5.52, 2.97), (5.2, 3.04), (4.5, 3.05), (-5.7, 3.05), (-6.2, 3.02), (-6.35, 2.92)),
    belt=((5.64, 1.20), (-6.35, 1.20)),
    floor=((5.64, 0.36), (4.6, 0.30), (-5.4, 0.30), (-6.35, 0.42)),
    plan=((5.64, 0.95), (5.52, 0.975), (5.2, 1.0), (-6.0, 1.0), (-6.2, 0.99), (-6.35, 0.96)),
    side=((0.3, 0.985), (0.6, 1.0), (1.21, 1.0)),
    screens=(),
    windows=((5.34, 4.05), (3.98, 2.45), (2.38, 0.85), (0.78, -0.75), (-0.82, -2.35), (-2.42, -3.95), (-4.02, -5.5)),
    pillars=((4.05, 3.98), (2.45, 2.38), (0.85, 0.78), (-0.75, -0.82), (-2.35, -2.42), (-3.95, -4.02)),
    right_doors=((5.22, 4.66), (4.62, 4.06), (0.70, 0.10), (0.06, -0.54)), tumblehome=0.04, roof_crown=0.12,
    ledge=0.012, frame=0.42, lip=0.06, mid_z=0.6, char_z=0.85, columns=(0.0, 0.4, 0.7, 0.86, 0.95, 1.0),
    nose_parts=((0, 5, 0, 1, "trim"), (0, 5, 4, 7, "glass"), (0, 4, 7, 8, "gloss")),
    tail_parts=((0, 5, 0, 1, "trim"), (0, 4, 6, 7, "glass")),
    nose=(0.16, ((0.36, 0.03), (0.6, 0.0), (1.2, 0.0), (2.9, 0.14))),
    tail=(0.06, ((0.4, 0.04), (0.6, 0.0), (1.2, 0.0), (2.9, 0.06))),
)  # fmt: skip


def _mirrors(x: float, y: float, z: float, size: float = 1.0) -> tuple[Block, ...]:
    """Return a pair of door mirrors whose inner end is at (x, y, z), their glass, and the stems that hold them."""
    rear, width, height = x - 0.1 * size, 0.2 * size, 0.145 * size
    low, high = (y + 0.2 * width, z + 0.2 * height), (y + 0.8 * width, z + 0.8 * height)
    return (
        Block((rear, y, z), (x + 0.1 * size, y + width, z + height), "trim", 0.0, True, True),
        Block((rear, *low), (x, *high), "mirror", 0.0, True),
        Block((x - 0.05, y - 0.09, z - 0.01), (x + 0.05, y + 0.05, z + 0.04), "trim", 0.015, True),
    )


def _handle(x: float, y: float, z: float) -> Block:
    """Return a pair of door handles that end at half width y."""
    return Block((x - 0.1, y - 0.05, z), (x + 0.1, y, z + 0.032), "gloss", 0.008, True)


_WORK_PAINTS = ("white", "silver", "red", "blue", "black", "green", "grey", "graphite")
_BUS_PAINTS = ("blue", "red", "white", "silver", "green", "black", "grey", "graphite")

BLUEPRINTS: dict[str, Blueprint] = {
    "sedan": Blueprint(
        "car", 4.71, 1.85, 1.45, 2.80, Wheels(0.325, 0.22, 0.225, 1.58), (_SEDAN,),
        (*_mirrors(0.80, 0.87, 0.93), _handle(0.11, 0.925, 0.80), _handle(-0.71, 0.925, 0.81)),
        (*face_panels(CarFront(0.66, 0.20, (0.40, 0.59, 0.635, 0.115), (0.36, 0.56, 0.695), (0.56, 0.27, 0.375))),
         *back_panels(CarRear(0.68, 0.18, (0.40, 0.25, 0.70, 0.87), (0.17, 0.955, 0.975), (0.66, 0.60))),
         *plates(0, 0.41, 0.72), *wipers(0.985, 0.70, 0.05), side_marker(1.86, 0.70)),
    ),
    "hatchback": Blueprint(
        "car", 4.29, 1.79, 1.46, 2.63, Wheels(0.316, 0.205, 0.215, 1.54, 6), (_HATCHBACK,),
        (*_mirrors(0.79, 0.84, 0.96), _handle(0.06, 0.895, 0.82), _handle(-0.70, 0.895, 0.83)),
        (*face_panels(CarFront(0.62, 0.20, (0.40, 0.60, 0.66, 0.135), (0.33, 0.58, 0.70), (0.54, 0.27, 0.385))),
         *back_panels(CarRear(0.66, 0.17, (0.50, 0.24, 0.70, 0.92), (0.2, 1.355, 1.372), (0.62, 0.52))),
         *plates(1, 0.43, 0.60), *wipers(0.955, 0.68, 0.05), side_marker(1.78, 0.72)),
    ),
    "suv": Blueprint(
        "car", 4.66, 1.88, 1.69, 2.70, Wheels(0.36, 0.235, 0.24, 1.61), (_SUV,),
        (*_mirrors(0.86, 0.88, 1.10, 1.1), _handle(0.05, 0.94, 0.95), _handle(-0.78, 0.94, 0.96),
         Block((-1.7, 0.60, 1.58), (0.1, 0.64, 1.68), "trim", 0.012, True)),
        (*face_panels(CarFront(0.68, 0.20, (0.47, 0.79, 0.83, 0.10), (0.42, 0.66, 0.89), (0.58, 0.35, 0.46))),
         *back_panels(CarRear(0.72, 0.18, (0.46, 0.25, 0.86, 1.03), (0.22, 1.575, 1.592), (0.68, 0.64))),
         *plates(2, 0.50, 0.72), *wipers(1.015, 0.72, 0.05), side_marker(1.85, 0.90)),
    ),
    "pickup": Blueprint(
        "car", 5.33, 1.86, 1.82, 3.09, Wheels(0.385, 0.255, 0.24, 1.57, 6), (_PICKUP,),
        (*_mirrors(1.06, 0.87, 1.17, 1.2), _handle(0.34, 0.93, 1.0), _handle(-0.50, 0.93, 1.0)),
        (*face_panels(CarFront(0.68, 0.19, (0.50, 0.85, 0.885, 0.13), (0.45, 0.72, 0.98), (0.60, 0.44, 0.55))),
         *back_panels(CarRear(0.80, 0.10, (0.73, 0.10, 0.78, 1.05), (0.2, 1.07, 1.09), (0.70, 0.60))),
         *plates(3, 0.585, 0.65), *wipers(1.235, 0.70, 0.06), side_marker(2.05, 0.96)),
    ),
    "van": Blueprint(
        "car", 5.14, 1.93, 1.91, 3.20, Wheels(0.335, 0.215, 0.215, 1.64, 6), (_VAN,),
        (*_mirrors(1.50, 0.92, 1.16, 1.3), _handle(0.52, 0.965, 0.98), _handle(0.16, 0.965, 0.98)),
        (*face_panels(CarFront(0.70, 0.20, (0.46, 0.70, 0.755, 0.145), (0.42, 0.62, 0.80), (0.60, 0.32, 0.44))),
         *back_panels(CarRear(0.88, 0.08, (0.82, 0.10, 0.78, 1.15), (0.2, 1.855, 1.875), (0.84, 0.50))),
         band("rear", (-0.004, 0.004), (0.52, 1.10), "trim", 0.003, cells=(1, 3)),
         *plates(4, 0.47, 0.58), *wipers(1.72, 0.72, 0.07), side_marker(2.09, 0.90)),
        _WORK_PAINTS,
    ),
    "box_truck": Blueprint(
        "truck", 7.10, 2.30, 3.20, 4.00, Wheels(0.40, 0.235, 0.255, 1.76, 6, 0.50), (_CAB,),
        (Block((-4.0, -1.15, 1.0), (1.32, 1.15, 3.2), "body", 0.04),
         Block((-3.9, -0.42, 0.60), (1.9, 0.42, 1.02), "trim", 0.02),
         Block((-3.97, -1.08, 0.50), (-3.87, 1.08, 0.64), "trim", 0.02),
         Block((-3.99, -0.9, 0.62), (-3.88, 0.9, 1.03), "trim", 0.01),
         Block((-1.1, 0.86, 0.48), (1.1, 0.96, 0.62), "trim", 0.02, True),
         Block((-0.5, 0.36, 0.50), (0.7, 0.88, 0.92), "trim", 0.04, True),
         Block((-0.9, 0.40, 0.80), (-0.84, 0.9, 1.02), "trim", 0.01, True),
         Block((0.9, 0.40, 0.55), (0.96, 0.9, 1.02), "trim", 0.01, True),
         Block((2.78, 0.98, 1.40), (2.84, 1.30, 1.44), "trim", 0.01, True),
         Block((2.74, 1.18, 1.30), (2.86, 1.38, 1.72), "trim", 0.0, True, True),
         Block((2.738, 1.21, 1.36), (2.80, 1.35, 1.66), "mirror", 0.0, True),
         _handle(1.82, 1.02, 1.12)),
        TRUCK_PANELS + plates(5, 0.67, 0.70) + wipers(2.985, 0.72, 0.04) + (side_marker(2.72, 1.0),),
        _WORK_PAINTS,
    ),
    "city_bus": Blueprint(
        "bus", 12.0, 2.55, 3.05, 5.90, Wheels(0.48, 0.28, 0.30, 2.16, 10, 0.56), (_BUS,),
        (Block((5.15, 1.10, 2.42), (5.62, 1.40, 2.47), "trim", 0.015, True),
         Block((5.52, 1.30, 1.86), (5.62, 1.50, 2.46), "trim", 0.0, True, True),
         Block((5.516, 1.33, 1.95), (5.57, 1.47, 2.37), "mirror", 0.0, True),
         Block((-4.6, -0.8, 2.98), (-1.6, 0.8, 3.045), "trim", 0.02)),
        BUS_PANELS + plates(6, 0.60, 0.64),
        _BUS_PAINTS,
    ),
}  # fmt: skip
"""Model name -> dimensions."""
