"""Facades: a wall as a grid of wall, glass and door cells that lie in one plane and share their edges."""

import numpy as np

from mmw.worlds.towns.block_description import BuildingStyle

WALL, GLASS, DOOR = 0, 1, 2
DOOR_WIDTH = 1.5
SHOP_SILL = 0.45
"""Wall below the windows of a shop front [m]; design value."""


def window_columns(style: BuildingStyle, width: float) -> tuple[np.ndarray, np.ndarray]:
    """Return the cell borders across a wall of `width` [m] as fractions [C + 1], and which cells hold windows [C]."""
    bays = max(1, round(width / style.bay_m))
    if style.windows == "punched":
        middle = (np.arange(bays) + 0.5) / bays
        half = 0.5 * style.window_fraction / bays
        borders = np.sort(np.concatenate([[0.0, 1.0], middle - half, middle + half]))
        return borders, np.arange(2 * bays + 1) % 2 == 1
    if style.mullion_m:
        corner = min(0.4, 0.2 * width) / width
        joints = np.linspace(corner, 1 - corner, bays + 1)[1:-1]
        half = 0.5 * min(style.mullion_m, 0.2 * width / bays) / width
        borders = np.sort(np.concatenate([[0.0, corner, 1 - corner, 1.0], joints - half, joints + half]))
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
        door: Whether the middle of the lowest storey is an entrance, and all of it a shop front if the style has one.
        ground: Whether the lowest storey has the height of a ground storey.

    Returns:
        Borders across (fractions) [C + 1], heights [m] [H + 1], kinds `WALL | GLASS | DOOR` [H, C]; the lowest row
        ends at the floor where there is a door, else at the sill.
    """
    across, windows = window_columns(style, width)
    entrance = -1
    if door:
        across, windows, entrance = _with_door(across, windows, width)
    heights = [foot, floor] if door else [foot]  # without one, the walls below and above the floor are one
    level = floor
    for storey in range(storeys):
        tall = style.ground_storey_m if ground and storey == 0 else style.storey_m
        is_shop = style.shop_front and ground and storey == 0
        sill = min(style.sill_m, SHOP_SILL) if is_shop else style.sill_m
        heights += [level + sill, level + tall - style.head_m]
        level += tall
    heights.append(level + crown)
    kinds = np.full((len(heights) - 1, len(across) - 1), WALL)
    kinds[2 if door else 1 : -1 : 2] = np.where(windows, GLASS, WALL)
    if door and style.shop_front:
        kinds[2, 1:-1] = GLASS
    if door:
        kinds[1:3, entrance] = DOOR
    return across, np.array(heights), kinds


def height_of(style: BuildingStyle, storeys: int, ground: bool = True) -> float:
    """Return the height from the lowest floor to the top ceiling [m]."""
    return storeys * style.storey_m + (style.ground_storey_m - style.storey_m if ground else 0.0)
