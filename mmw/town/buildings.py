"""One building as meshes: facades cut into wall and glass cells of one plane, roofs, parapets, doors, roof equipment.

Everything is made in the frame of the plan: origin in the middle, x along the street front as seen from
the street, y into the plot, so that the front wall faces -y. Heights are those of the town frame.
"""

from collections import defaultdict
from dataclasses import dataclass

import numpy as np

from mmw.town.block_description import BuildingStyle
from mmw.town.parts import MeshPart
from mmw.town.solids import Mesh, box, flat, lathe, merge, place, quads, wall_cells, weld

Meshes = defaultdict[str, list[Mesh]]
"""Use, such as `facade` -> what has been made for it so far."""

WALL, GLASS, DOOR = 0, 1, 2
PARAPET_THICKNESS = 0.3
CORNICE = (0.25, 0.35)  # overhang, height [m]
BELT = (0.12, 0.14)  # overhang, half the height [m]
ROOF_THICKNESS = 0.2
EAVES = 0.45
DOOR_WIDTH = 1.5
FORECOURT = (2.4, 1.2)  # paved ground in front of and beside a building with a flat roof [m]
SUNK = 0.05  # how far an attached body reaches into the wall, so that no two faces lie in one plane [m]


@dataclass(frozen=True)
class Site:
    """Where a building stands."""

    center: tuple[float, float]
    """Middle of the plan [m]."""
    yaw: float
    """Direction of the plan's x axis, counter-clockwise from east [rad]."""
    width: float
    """Length of the street front [m]."""
    depth: float
    """Extent away from the street [m]."""
    foot: float
    """Height from which the walls rise, below all ground at the plan [m]."""
    floor: float
    """Height of the ground floor [m]."""

    @property
    def ring(self) -> np.ndarray:
        """Corners of the plan, counter-clockwise from the left end of the street front [m], shape [4, 2]."""
        return self._in_town(rectangle(self.width, self.depth))

    @property
    def paved(self) -> np.ndarray:
        """Corners of the paving around a building with a flat roof [m], shape [4, 2], as `ring`."""
        front, side = FORECOURT
        corners = rectangle(self.width + 2 * side, self.depth + front + side)
        return self._in_town(corners + np.array([0.0, 0.5 * (side - front)]))

    def _in_town(self, local: np.ndarray) -> np.ndarray:
        cos, sin = np.cos(self.yaw), np.sin(self.yaw)
        return local @ np.array([[cos, sin], [-sin, cos]]) + np.asarray(self.center)


def rectangle(width: float, depth: float, inset: float = 0.0) -> np.ndarray:
    """Return the corners of a rectangle about the origin, counter-clockwise, its sides moved in by `inset` [m]."""
    x, y = 0.5 * width - inset, 0.5 * depth - inset
    return np.array([[-x, -y], [x, -y], [x, y], [-x, y]])


def window_columns(style: BuildingStyle, width: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the cell borders across a wall of `width` [m] as fractions [C + 1], and which cells hold windows [C]."""
    bays = max(1, round(width / style.bay_m))
    if style.windows == "punched":
        middle = (np.arange(bays) + 0.5) / bays
        half = 0.5 * style.window_fraction / bays
        borders = np.sort(np.concatenate([[0.0, 1.0], middle - half, middle + half]))
        return borders, np.arange(2 * bays + 1) % 2 == 1
    corner = min(0.4 if style.windows == "curtain" else 0.8, 0.2 * width) / width
    borders = np.concatenate([[0.0], np.linspace(corner, 1 - corner, bays + 1), [1.0]])
    return borders, np.r_[False, np.ones(bays, bool), False]


def _with_door(across: np.ndarray, windows: np.ndarray, width: float) -> tuple[np.ndarray, np.ndarray, int]:
    """Cut a door out of the middle window column; return borders, window columns and the door's column."""
    columns = np.flatnonzero(windows)
    column = int(columns[len(columns) // 2])
    left, right = across[column : column + 2]
    half = 0.5 * DOOR_WIDTH / width
    if right - left < 2 * half + 0.4 / width:
        return across, windows, column
    middle = 0.5 * (left + right)
    across = np.insert(across, column + 1, [middle - half, middle + half])
    return across, np.insert(windows, column, [True, True]), column + 1


def facade_cells(
    style: BuildingStyle, width: float, storeys: int, foot: float, floor: float, crown: float, door: bool, ground: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the grid of one facade.

    Args:
        style: Layout of the windows.
        width: Length of the wall [m].
        storeys: Storeys from `floor` up.
        foot: Height where the wall begins [m], below `floor`.
        floor: Height of the lowest floor [m].
        crown: Wall above the top ceiling, such as a parapet [m].
        door: Whether the middle of the lowest storey is an entrance.
        ground: Whether the lowest storey has the height of a ground storey.

    Returns:
        Borders across (fractions) [C + 1], heights [m] [H + 1], kinds `WALL | GLASS | DOOR` [H, C].
    """
    across, windows = window_columns(style, width)
    entrance = -1
    if door:
        across, windows, entrance = _with_door(across, windows, width)
    heights = [foot, floor]
    level = floor
    for storey in range(storeys):
        tall = style.ground_storey_m if ground and storey == 0 else style.storey_m
        heights += [level + style.sill_m, level + tall - style.head_m]
        level += tall
    heights.append(level + crown)
    kinds = np.full((len(heights) - 1, len(across) - 1), WALL)
    kinds[2:-1:2] = np.where(windows, GLASS, WALL)
    if door:
        kinds[1:3, entrance] = DOOR
    return across, np.array(heights), kinds


def height_of(style: BuildingStyle, storeys: int, ground: bool = True) -> float:
    """Return the height from the lowest floor to the top ceiling [m]."""
    return storeys * style.storey_m + (style.ground_storey_m - style.storey_m if ground else 0.0)


def _walls(
    style: BuildingStyle,
    width: float,
    depth: float,
    storeys: int,
    foot: float,
    floor: float,
    crown: float,
    ground: bool,
    out: Meshes,
) -> None:
    """Add the four facades of a block to the lists of meshes `out`."""
    ring = rectangle(width, depth)
    for side in range(4):
        start, end = ring[side], ring[(side + 1) % 4]
        length = width if side % 2 == 0 else depth
        grid = facade_cells(style, length, storeys, foot, floor, crown, ground and side == 0, ground)
        meshes = wall_cells(start, end, *grid)
        for kind, name in ((WALL, "facade"), (GLASS, "glass"), (DOOR, "door")):
            if kind in meshes:
                out[name].append(meshes[kind])


def _flat_roof(style: BuildingStyle, width: float, depth: float, top: float, out: Meshes) -> None:
    """Add a roof behind a parapet with a cornice."""
    rim = top + style.parapet_m
    overhang = CORNICE[0] if style.windows == "punched" else 0.0
    rings = [
        (rectangle(width, depth, PARAPET_THICKNESS), top),
        (rectangle(width, depth, PARAPET_THICKNESS), rim),
        (rectangle(width, depth, -overhang), rim),
    ]
    if overhang:
        rings += [(rectangle(width, depth, -overhang), rim - CORNICE[1]), (rectangle(width, depth), rim - CORNICE[1])]
    points = np.concatenate([np.column_stack([ring, np.full(4, z)]) for ring, z in rings])
    corner, following = np.arange(4), np.roll(np.arange(4), -1)
    strips = [
        np.column_stack([following, corner, corner + 4, following + 4]) + 4 * strip for strip in range(len(rings) - 1)
    ]
    out["facade"].append(quads(points, np.concatenate(strips)))
    out["roof"].append(flat(rectangle(width, depth, PARAPET_THICKNESS), top))


def _belt(width: float, depth: float, level: float, out: Meshes) -> None:
    """Add a stone belt around the walls at the floor of the first storey."""
    reach, half = BELT
    rings = [(0.0, level - half), (reach, level - half), (reach, level + half), (0.0, level + half)]
    points = np.concatenate([np.column_stack([rectangle(width, depth, -r), np.full(4, z)]) for r, z in rings])
    corner, following = np.arange(4), np.roll(np.arange(4), -1)
    strips = [np.column_stack([corner, following, following + 4, corner + 4]) + 4 * k for k in range(3)]
    out["structure"].append(quads(points, np.concatenate(strips)))


def _gable_roof(style: BuildingStyle, width: float, depth: float, top: float, out: Meshes) -> None:
    """Add a pitched roof along the longer side and the wall triangles under its ends."""
    turned = depth > width
    length, run = (depth, 0.5 * width) if turned else (width, 0.5 * depth)
    rise = style.pitch * run
    reach, drop = run + EAVES, style.pitch * EAVES
    edge, thick = -drop, ROOF_THICKNESS
    section = np.array(
        [(-reach, edge), (0, rise), (reach, edge), (reach, edge + thick), (0, rise + thick), (-reach, edge + thick)]
    )
    half = 0.5 * length + EAVES
    points = np.concatenate(
        [np.column_stack([np.full(6, x), section[:, 0], top + section[:, 1]]) for x in (-half, half)]
    )
    sides = [[i + 6, (i + 1) % 6 + 6, (i + 1) % 6, i] for i in range(6)]
    ends = [[0, 1, 4, 5], [1, 2, 3, 4], [11, 10, 7, 6], [10, 9, 8, 7]]
    roof = quads(points, [*(side[::-1] for side in sides), *(end[::-1] for end in ends)])
    out["roof"].append(place(roof, (0, 0, 0), 0.5 * np.pi if turned else 0.0))
    for sign in (-1, 1):
        across, _ = window_columns(style, 2 * run)
        along = sign * run * (2 * across - 1)
        base = np.column_stack([np.full(len(along), sign * 0.5 * length), along, np.full(len(along), top)])
        apex = len(base)
        faces = [[i, i + 1, apex] for i in range(apex - 1)]
        end = Mesh(np.vstack([base, [sign * 0.5 * length, 0.0, top + rise]]), np.array(faces, np.int32))
        out["facade"].append(place(end, (0, 0, 0), 0.5 * np.pi if turned else 0.0))


def _hip_roof(style: BuildingStyle, width: float, depth: float, top: float, out: Meshes) -> None:
    """Add a roof that slopes to all four sides, with a level soffit under its eaves."""
    turned = depth > width
    long, short = (max(width, depth), min(width, depth))
    low = rectangle(long, short, -EAVES)
    run = 0.5 * short + EAVES
    ridge = 0.5 * (long - short)
    points = np.vstack(
        [np.column_stack([low, np.full(4, z)]) for z in (top, top + ROOF_THICKNESS)]
        + [[[x, 0.0, top + ROOF_THICKNESS + style.pitch * run] for x in (-ridge, ridge)]]
    )
    fascia = [[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6], [3, 0, 4, 7], [0, 3, 2, 1]]
    slopes = quads(points, [*fascia, [4, 5, 9, 8], [6, 7, 8, 9]])
    ends = Mesh(points, np.array([[5, 6, 9], [7, 4, 8]], np.int32))
    out["roof"].append(place(merge([slopes, ends]), (0, 0, 0), 0.5 * np.pi if turned else 0.0))


def _equipment(width: float, depth: float, top: float, rng: np.random.Generator, out: Meshes) -> None:
    """Add a stair head, cooling units and now and then a tank, one to each quarter of a flat roof."""
    quarters = rng.permutation(4)[: rng.integers(1, 5)]
    for order, quarter in enumerate(quarters):
        x = (0.22 + 0.04 * rng.random()) * width * (1 if quarter % 2 else -1)
        y = (0.22 + 0.04 * rng.random()) * depth * (1 if quarter // 2 else -1)
        room = 0.36 * min(width, depth)
        if order == 0:
            out["structure"].append(box((min(3.2, room), min(4.0, room), 2.6), (x, y, top + 1.3), bottom=False))
        elif order == 3:
            stand = box((1.2, 1.2, 1.2), (x, y, top + 0.6), bottom=False)
            tank = lathe([(1.1, top + 1.2), (1.1, top + 3.0), (0.0, top + 3.6)], 7, (x, y))
            out["metal"] += [stand, tank]
        else:
            out["metal"].append(box((min(2.4, room), min(1.6, room), 1.3), (x, y, top + 0.65), bottom=False))


def _entrance(style: BuildingStyle, width: float, depth: float, foot: float, floor: float, out: Meshes) -> None:
    """Add a step below the door and a canopy above it."""
    across, windows = window_columns(style, width)
    columns = np.flatnonzero(windows)
    column = columns[len(columns) // 2]
    left, right = (across[column : column + 2] - 0.5) * width
    x, size, front = 0.5 * (left + right), right - left + 0.6, -0.5 * depth
    above = floor + style.ground_storey_m - style.head_m + 0.2
    reach = 1.2
    size = min(size, 4.0)
    middle = front - 0.5 * (reach - SUNK)
    out["structure"].append(box((size, reach + SUNK, floor - foot), (x, middle, 0.5 * (floor + foot)), bottom=False))
    out["metal"].append(box((size, reach + SUNK, 0.15), (x, middle, above)))


def _forecourt(site: Site) -> Mesh:
    """Return the paving around a building, a hand's breadth below its floor."""
    front, side = FORECOURT
    size = (site.width + 2 * side, site.depth + front + side, site.floor - 0.1 - site.foot)
    middle = (0.0, 0.5 * (side - front), 0.5 * (site.floor - 0.1 + site.foot))
    return box(size, middle, bottom=False)


def _chimney(
    style: BuildingStyle, width: float, depth: float, top: float, rng: np.random.Generator, out: Meshes
) -> None:
    """Add a chimney beside the ridge."""
    long, short = max(width, depth), min(width, depth)
    x, y = (0.3 * long * rng.choice([-1, 1]), 0.12 * short)
    ridge = top + style.pitch * 0.5 * short
    low, high = ridge - style.pitch * 0.12 * short - 0.8, ridge + 0.9
    stack = box((0.8, 0.6, high - low), (x, y, 0.5 * (low + high)), bottom=False)
    out["chimney"].append(place(stack, (0, 0, 0), 0.5 * np.pi if depth > width else 0.0))


def build_building(
    name: str, style: BuildingStyle, site: Site, storeys: int, rng: np.random.Generator
) -> list[MeshPart]:
    """Return the meshes of one building, one for each material and use.

    Args:
        name: Name of the prim under `Buildings`.
        style: Materials, window layout and roof.
        site: Plan, ground floor and foot, in the town frame.
        storeys: Storeys above the ground floor level, the ground storey included, >= 1.
        rng: Chooses roof equipment and chimneys.
    """
    out: Meshes = defaultdict(list)
    width, depth, floor = site.width, site.depth, site.floor
    is_flat = style.roof_form == "flat"
    crown = style.parapet_m if is_flat else 0.0
    if is_flat and style.windows == "punched":
        _belt(width, depth, floor + style.ground_storey_m, out)
    base = min(style.podium_storeys, storeys - 1) if style.podium_storeys else storeys
    _walls(style, width, depth, base, site.foot, floor, crown, True, out)
    _entrance(style, width, depth, site.foot, floor, out)
    top = floor + height_of(style, base)
    if is_flat:
        _flat_roof(style, width, depth, top, out)
        if base < storeys:
            width, depth = width - 2 * 0.14 * site.width, depth - 2 * 0.14 * site.depth
            _walls(style, width, depth, storeys - base, top - 0.3, top, crown, False, out)
            top += height_of(style, storeys - base, ground=False)
            _flat_roof(style, width, depth, top, out)
        _equipment(width, depth, top, rng, out)
    else:
        (_gable_roof if style.roof_form == "gable" else _hip_roof)(style, width, depth, top, out)
        _chimney(style, width, depth, top, rng, out)
    if is_flat:
        out["forecourt"].append(_forecourt(site))
    material = {
        "facade": style.facade, "glass": style.glass, "door": style.door, "roof": style.roof, "chimney": "brick_facade",
        "structure": "concrete_structure", "metal": "metal_fascia", "forecourt": "concrete_sidewalk",
    }  # fmt: skip
    label = {"forecourt": "sidewalk"}
    at = (*site.center, 0.0)
    return [
        MeshPart(
            f"Buildings/{name}/{part}",
            *place(weld(merge(out[part])), at, site.yaw),
            material[part],
            label.get(part, "building"),
        )
        for part in material
        if out[part]
    ]
