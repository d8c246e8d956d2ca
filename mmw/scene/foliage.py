"""Find the foliage of a scene, and put leaves in place of the hulls of its crowns."""

from dataclasses import replace

import numpy as np

from mmw.scene.leaf_cards import LeafCards, leaf_cards
from mmw.scene.mesh_edges import find_edges
from mmw.scene.scene_data import SceneData

SHEET_M = 0.05
"""Mean thickness below which a closed body is a leaf itself, or a sheet of them, and no crown [m]; design value."""

MESH = ("points", "faces", "material", "object_id", "surface", "uv", "normals")
"""Fields of `SceneData` that hold the mesh of the static world."""


def optical_arrays(arrays: SceneData) -> SceneData:
    """Return a scene as light and radar meet it: leaf cards in place of hulls of crowns if its foliage is `leaves`.

    A card has object, material and surface of the hull's face that it lies below. Foliage that closes no volume, or
    sheets, such as leaves of the stage's own, stay as they are, and so does that of instances, which move. A crown is
    named by its object and its number in it: its leaves do not depend on the rest of the scene.

    Returns:
        The scene; `arrays` itself if it has no such hull.
    """
    if arrays.foliage == "hull":
        return arrays
    row = np.flatnonzero(foliage_faces(arrays))
    if not len(row):
        return arrays
    faces = arrays.faces[row]
    used, index = np.unique(faces, return_inverse=True)
    hulls = find_edges(arrays.points[used], index.reshape(faces.shape))
    outward, body = np.where(hulls.is_turned[:, None], faces[:, ::-1], faces), hulls.body
    is_closed = ~hulls.is_open & ~_sheets(arrays.points[outward], body)
    if not is_closed.any():
        return arrays
    closed = np.flatnonzero(is_closed)
    order = closed[np.argsort(body[closed], kind="stable")]
    made: list[LeafCards] = []
    below: list[np.ndarray] = []
    number: dict[int, int] = {}
    for own in np.split(order, np.flatnonzero(np.diff(body[order])) + 1):
        thing = int(arrays.object_id[row[own[0]]])
        number[thing] = number.get(thing, -1) + 1
        name = arrays.objects[thing].prim_path if arrays.objects else str(thing)
        made.append(leaf_cards(arrays.points, outward[own], seed=f"{name} {number[thing]}"))
        below.append(row[own][made[-1].hull_face])
    keep = np.ones(len(arrays.faces), dtype=bool)
    keep[row[closed]] = False
    hull_face = np.concatenate(below)
    first = len(arrays.points) + np.cumsum([0] + [len(cards.points) for cards in made[:-1]])
    leaves = {
        "points": np.concatenate([cards.points for cards in made]),
        "faces": np.concatenate([cards.faces + k for cards, k in zip(made, first, strict=True)]).astype(np.int32),
        "uv": np.concatenate([cards.uv for cards in made]),
        "normals": np.concatenate([cards.normals for cards in made]),
        **{name: getattr(arrays, name)[hull_face] for name in ("material", "object_id", "surface")},
    }
    old = {name: getattr(arrays, name) if name == "points" else getattr(arrays, name)[keep] for name in MESH}
    return replace(arrays, **{name: np.concatenate([old[name], leaves[name]]) for name in MESH})


def _sheets(corner: np.ndarray, body: np.ndarray) -> np.ndarray:
    """Return which faces, of corners [M, 3, 3] in m, belong to bodies [M] thinner than `SHEET_M`, shape [M], bool."""
    from_body = corner - corner[body][:, :1]
    cross = np.cross(from_body[:, 1] - from_body[:, 0], from_body[:, 2] - from_body[:, 0])
    volume = np.bincount(body, weights=np.einsum("fx,fx->f", from_body[:, 0], cross) / 6.0)
    area = np.bincount(body, weights=0.5 * np.linalg.norm(cross, axis=1))
    return (volume < 0.5 * SHEET_M * area)[body]


def has_same_crowns(one: SceneData, other: SceneData) -> bool:
    """Return whether two scenes with the same mesh have leaves in the same places, or both have none."""
    if one.foliage != other.foliage or one.foliage == "hull" or one.materials is other.materials:
        return one.foliage == other.foliage
    return np.array_equal(foliage_faces(one), foliage_faces(other))


def foliage_faces(arrays: SceneData) -> np.ndarray:
    """Return which faces of the static world are foliage in some weather, shape [M], bool."""
    by_weather = [[m.radio.medium == "foliage" for m in some] for some in arrays.materials.values()]
    is_leafy = np.any(by_weather, axis=0) if by_weather else np.zeros(0, dtype=bool)
    return is_leafy[arrays.material] if len(arrays.material) else np.zeros(0, dtype=bool)
