"""Texture coordinates of meshes that show pictures: rooms behind windows, signs, signboards, covers; round bodies."""

import zlib

import numpy as np

from mmw.core.errors import InputError
from mmw.core.mesh import TriangleMesh
from mmw.core.planar_surfaces import components
from mmw.worlds.materials.town_decals import ROOMS, SHOP_ASPECT, SHOPS, SIGN_CELLS, SIGNS
from mmw.worlds.materials.vehicle_decals import cell
from mmw.worlds.towns.mesh_part import MeshPart
from mmw.worlds.towns.smooth_normals import PIERS
from mmw.worlds.towns.texture_uv import texture_coordinates

ROOM_WIDTH = {"window_glass": 1.5, "glass_facade": 2.4}
"""Width of a window that shows one room [m]; wider ones show several. Design values."""

ROOM_HEIGHT = 1.9
"""Least height of a window for its room to keep its proportions [m]; design value."""

LEAF_TILE = 2.0
"""Side of the tile of leaves [m], as in `mmw.worlds.materials.textures`: a crown shows whole ones around."""

COLUMN_TILE = 4.0
"""Side of the tile of concrete [m], as in `mmw.worlds.materials.textures`: a round column shows whole ones around."""

COVERS = ("manhole_cover", "drain_grate")
"""Materials whose meshes are many level plates, each of which shows the whole picture."""

MIN_SIDES = 6
"""A column of this many sides or more is round."""

MIN_TEXT = 3.0
"""Width over height from which the side of a board shows its lettering."""


def picture_coordinates(part: MeshPart) -> np.ndarray | None:
    """Return the texture coordinates of the corners of a mesh, shape [M, 3, 2], or None where meters will do.

    Args:
        part: The mesh. Windows and signboards are made of rectangles of two triangles each. The last name of the path
            of a `sign_face` is the name of its sign.
    """
    if part.material in ROOM_WIDTH:
        return _rooms(part, ROOM_WIDTH[part.material])
    if part.material == "sign_face":
        return _sign(part)
    if part.material == "shop_sign":
        return _boards(part)
    if part.material in COVERS:
        return _covers(part)
    if part.material.startswith("foliage") and part.path.endswith("/crown"):
        return _crown(part)
    if part.material == "concrete_structure" and part.path.endswith(PIERS):
        return _piers(part)
    return None


def _rectangles(part: MeshPart) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return width and height [m] of all rectangles, [Q] each, and their normals, [Q, 3].

    Raises:
        InputError: If the mesh does not consist of pairs of triangles that share a diagonal.
    """
    pairs = part.faces.reshape(-1, 2, 3) if len(part.faces) % 2 == 0 else np.zeros((1, 2, 3), int)
    if (pairs[:, 0, 0] != pairs[:, 1, 0]).any() or (pairs[:, 0, 2] != pairs[:, 1, 1]).any() or len(part.faces) % 2:
        raise InputError(f"part {part.path!r}: {part.material} shows pictures on rectangles; make it of quads")
    corners = part.points[np.concatenate([pairs[:, 0], pairs[:, 1, 2:]], axis=1)]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0])
    wide, tall = (np.linalg.norm(corners[:, k] - corners[:, 0], axis=1) for k in (1, 3))
    return wide, tall, normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-300)


def _as_corners(low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return coordinates of the triangles of rectangles of given lower left and upper right ones, each [Q, 2]."""
    left, right, bottom, top = low[:, 0], high[:, 0], low[:, 1], high[:, 1]
    four = np.stack([left, bottom, right, bottom, right, top, left, top], axis=1).reshape(-1, 4, 2)
    return four[:, [[0, 1, 2], [0, 2, 3]]].reshape(-1, 3, 2)


def _numbers(part: MeshPart, count: int, below: int) -> np.ndarray:
    """Return a number for each of `count` pieces of a mesh, the same at every build."""
    return np.random.default_rng(zlib.crc32(part.path.encode())).integers(below, size=count)


def _rooms(part: MeshPart, width: float) -> np.ndarray:
    """Give every window the whole rooms that fit its width."""
    wide, tall, _ = _rectangles(part)
    columns, rows = ROOMS
    count = np.maximum(1.0, np.round(wide / (width * np.maximum(1.0, tall / ROOM_HEIGHT))))
    room = _numbers(part, len(wide), columns * rows)
    low = np.column_stack([room % columns, room // columns]).astype(float)
    high = low + np.column_stack([count, np.ones(len(count))])
    return _as_corners(low / ROOMS, high / ROOMS)


def _sign(part: MeshPart) -> np.ndarray:
    """Lay the sign over what looks to the front, by its bounds there; all other faces show the sign's middle."""
    name = part.path.rsplit("/", 1)[1]
    if name not in SIGNS:
        raise InputError(f"part {part.path!r}: no sign of this name; signs are: {', '.join(SIGNS)}; name it so")
    u0, v0, u1, v1 = cell(SIGNS.index(name), SIGN_CELLS)
    corners, normal = part.mesh.corners, part.mesh.normals
    across = np.column_stack([-normal[:, 1], normal[:, 0]])
    along = np.einsum("fcx,fx->fc", corners[:, :, :2], across)
    st = np.empty((len(corners), 3, 2))
    key = np.round(normal, 3)
    for face in np.unique(key, axis=0):
        own = (key == face).all(axis=1)
        s, t = along[own], corners[own][:, :, 2]
        st[own, :, 0] = u0 + (u1 - u0) * _share(s)
        st[own, :, 1] = v0 + (v1 - v0) * _share(t)
    return st


def _share(values: np.ndarray) -> np.ndarray:
    """Return where values lie between their bounds, 0 to 1; a half where there is nothing between them."""
    low, high = values.min(), values.max()
    return (values - low) / (high - low) if high - low > 1e-6 else np.full(values.shape, 0.5)


def _boards(part: MeshPart) -> np.ndarray:
    """Write the name of a shop on the long upright sides of every board; its other sides have the board's color."""
    wide, tall, normal = _rectangles(part)
    tall = np.maximum(tall, 1e-6)
    has_text = (np.abs(normal[:, 2]) < 0.5) & (wide / tall > MIN_TEXT)
    shop = np.repeat(_numbers(part, len(wide) // 6 + 1, len(SHOPS)), 6)[: len(wide)]
    low = np.column_stack([np.full(len(shop), 0.01), 1.0 - (shop + 0.9) / len(SHOPS)])
    high = np.column_stack([np.full(len(shop), 0.02), 1.0 - (shop + 0.2) / len(SHOPS)])
    half = 0.5 * np.minimum(1.0, wide / tall / SHOP_ASPECT)
    low[has_text] = np.column_stack([0.5 - half, 1.0 - (shop + 1.0) / len(SHOPS)])[has_text]
    high[has_text] = np.column_stack([0.5 + half, 1.0 - shop / len(SHOPS)])[has_text]
    return _as_corners(low, high)


def _covers(part: MeshPart) -> np.ndarray:
    """Lay the picture over every plate by the smallest rectangle around it, its longer side along s.

    Of the two orientations the one whose s runs north is chosen, or east on a level, so that last bits, which differ
    between CPUs, decide nothing.
    """
    import shapely  # of the extra `author`, which not every caller needs

    st = np.empty((len(part.faces), 3, 2))
    plate = components(len(part.points), part.faces[:, [0, 1]].ravel(), part.faces[:, [1, 2]].ravel())[part.faces[:, 0]]
    for number in np.unique(plate):
        own = plate == number
        xy = part.points[part.faces[own]][:, :, :2]
        outline = shapely.MultiPoint(np.round(xy.reshape(-1, 2), 6))
        corner, a, _, b = shapely.get_coordinates(shapely.oriented_envelope(outline))[:4]
        along, aside = a - corner, b - corner
        if np.linalg.norm(along) < np.linalg.norm(aside) - 1e-5:
            along, aside = aside, along
        if (np.round(along[1], 5), along[0]) < (0.0, 0.0):
            corner, along = corner + along, -along
        if along[0] * aside[1] < along[1] * aside[0]:
            corner, aside = corner + aside, -aside  # seen from above, the picture is not mirrored
        axes = np.stack([along / (along @ along), aside / (aside @ aside)], axis=1)
        found = (xy - corner) @ axes
        low, high = found.min(axis=(0, 1)), found.max(axis=(0, 1))  # the outline is rounded: not quite 0 and 1
        st[own] = (found - low) / (high - low)
    return np.clip(st, 0.0, 1.0)


def _crown(part: MeshPart) -> np.ndarray:
    """Wrap leaves around the axis of a crown, and lay them from above where it is level; meters, as texture tiles."""
    mesh = TriangleMesh(part.points - part.points.mean(axis=0), part.faces)
    corners, normal = mesh.corners, mesh.normals
    reach = 0.8 * float(np.hypot(*corners[:, :, :2].reshape(-1, 2).T).max())
    st = _wrapped(corners[:, :, :2], corners[:, :, 2], reach, LEAF_TILE)
    level = np.abs(normal[:, 2]) > 0.6
    st[level] = corners[level][:, :, :2]
    return st


def _wrapped(away: np.ndarray, height: np.ndarray, radius: float, tile: float) -> np.ndarray:
    """Return coordinates [F, 3, 2] of corners `away` from an axis [m], [F, 3, 2], with whole tiles [m] around it."""
    turns = max(1, round(2 * np.pi * radius / tile))
    angle, middle = np.arctan2(away[..., 1], away[..., 0]), np.arctan2(*away.mean(axis=1).T[::-1])[:, None]
    angle = middle + (angle - middle + np.pi) % (2 * np.pi) - np.pi  # no face reaches around the back
    return np.stack([angle * turns * tile / (2 * np.pi), height], axis=-1)


def _piers(part: MeshPart) -> np.ndarray:
    """Wrap the texture around every upright round column without a seam; meters, as texture tiles.

    The columns and cross-heads that are boxes have the coordinates of walls, and all ends those of level ground.
    """
    st, index = texture_coordinates(part.mesh)
    result = (st[part.faces] if index is None else st[index].reshape(-1, 3, 2)).astype(float)
    body = components(len(part.points), part.faces[:, [0, 1]].ravel(), part.faces[:, [1, 2]].ravel())[part.faces[:, 0]]
    for number in np.unique(body):
        own = np.flatnonzero(body == number)
        corners = part.points[part.faces[own]]
        sides = np.ptp(corners[:, :, 2], axis=1) > 1e-3
        if sides.sum() < 2 * MIN_SIDES:
            continue
        axis = corners.reshape(-1, 3)[:, :2].mean(axis=0)
        away = corners[sides][:, :, :2] - axis
        radius = float(np.linalg.norm(away, axis=2).mean())
        if np.abs(np.linalg.norm(away, axis=2) - radius).max() > 0.01:
            continue
        result[own[sides]] = _wrapped(away, corners[sides][:, :, 2], radius, COLUMN_TILE)
    return result
