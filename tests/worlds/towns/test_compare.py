"""The comparison of two builds of a town finds what differs, and nothing else."""

from collections.abc import Callable
from functools import cache
from typing import Any

import numpy as np
import pytest
from pxr import Sdf, Usd, Vt

from mmw.worlds.towns.write_usd import PAYLOAD
from tests.fixtures import town_checks
from tests.fixtures.town_compare import assert_same_geometry

GRASS = "/Town/Terrain/block_00"
"""A mesh with texture coordinates of its vertices."""


@cache
def geometry() -> Sdf.Layer:
    """Return some of a shipped town: a few things of each group."""
    town = Sdf.Layer.FindOrOpen(str(town_checks.folder_of("town10") / PAYLOAD))
    some = Sdf.Layer.CreateAnonymous(".usda")
    Sdf.CreatePrimInLayer(some, "/Town").specifier = Sdf.SpecifierDef
    for group in town.GetPrimAtPath("/Town").nameChildren:
        if group.name in ("Terrain", "Buildings", "Props", "Parked"):
            Sdf.CreatePrimInLayer(some, group.path).specifier = Sdf.SpecifierDef
            for child in [child for k, child in enumerate(group.nameChildren) if k < 4 or child.path == GRASS]:
                assert Sdf.CopySpec(town, child.path, some, child.path)
    return some


def changed(change: Callable[[Sdf.Layer], object] = lambda layer: None) -> Usd.Stage:
    layer = Sdf.Layer.CreateAnonymous(".usda")
    layer.TransferContent(geometry())
    change(layer)
    return Usd.Stage.Open(layer)


def a_mesh(layer: Sdf.Layer, below: str, has: str = "points") -> Sdf.PrimSpec:
    """Return the first mesh at or below a prim that has an attribute."""
    found: list[Sdf.PrimSpec] = []

    def look(path: Sdf.Path) -> None:
        if path.IsPrimPath() and not found and layer.GetPrimAtPath(path).attributes.get(has):
            found.append(layer.GetPrimAtPath(path))

    layer.Traverse(below, look)
    return found[0]


def edit(mesh: Sdf.PrimSpec, name: str, change: Callable[[np.ndarray], np.ndarray], where: Any = slice(None)) -> None:
    """Change some of the values of an attribute."""
    attribute = mesh.attributes[name]
    values = np.array(attribute.default)
    if where == slice(None):
        values = np.ascontiguousarray(change(values))
    else:
        values[where] = change(values[where])
    attribute.default = type(attribute.default).FromNumpy(values)


def move(mesh: Sdf.PrimSpec, by: float, count: int | None = None) -> None:
    edit(mesh, "points", lambda x: x + by, (slice(count), 0))


def of_faces(change: Callable[[np.ndarray], np.ndarray]) -> Callable[[Sdf.Layer], None]:
    """Return a change of the triangles [M, 3] of the grass."""

    def apply(layer: Sdf.Layer) -> None:
        mesh = layer.GetPrimAtPath(GRASS)
        edit(mesh, "faceVertexIndices", lambda flat: change(flat.reshape(-1, 3)).reshape(-1))
        count = len(mesh.attributes["faceVertexIndices"].default) // 3
        mesh.attributes["faceVertexCounts"].default = Vt.IntArray([3] * count)

    return apply


def flipped_diagonal(faces: np.ndarray) -> np.ndarray:
    """Cut the first two triangles that share an edge by the other diagonal."""
    for i, one in enumerate(faces):
        for j, other in enumerate(faces[:i]):
            both = set(one.tolist()) & set(other.tolist())
            if len(both) == 2:
                while one[0] in both:
                    one = np.roll(one, 1)
                (far,) = set(other.tolist()) - both
                faces[[i, j]] = [one[0], one[1], far], [one[0], far, one[2]]
                return faces
    raise AssertionError("no two triangles share an edge")


def other_diagonal_on_a_slope(layer: Sdf.Layer) -> None:
    def raised(points: np.ndarray) -> np.ndarray:
        return np.column_stack([points[:, :2], 0.1 * np.sin(points[:, 0]) * np.sin(points[:, 1])])

    edit(layer.GetPrimAtPath(GRASS), "points", raised)


def flipped_texture(layer: Sdf.Layer) -> None:
    edit(a_mesh(layer, "/Town", "primvars:st"), "primvars:st", lambda s: -s - 1.0, (0, 0))


def exchanged_pictures(layer: Sdf.Layer) -> None:
    """Swap the corners of the first triangle of a sign or a window; the values stay the same."""
    indices = "primvars:st:indices"
    edit(a_mesh(layer, "/Town/Buildings", indices), indices, lambda three: np.roll(three, -1), slice(3))


def without_a_prim(layer: Sdf.Layer) -> None:
    parent = layer.GetPrimAtPath("/Town/Props")
    del parent.nameChildren[next(iter(parent.nameChildren)).name]


def other_car(layer: Sdf.Layer) -> None:
    """Turn the first parked car into a van."""
    car = next(iter(layer.GetPrimAtPath("/Town/Parked").nameChildren))
    (model,) = [child for child in car.nameChildren if child.referenceList.prependedItems]
    model.referenceList.prependedItems[0] = Sdf.Reference("../../vehicles/van/van.usda")


def other_material(layer: Sdf.Layer) -> None:
    targets = layer.GetPrimAtPath(GRASS).relationships["material:binding"].targetPathList
    targets.explicitItems = ["/Town/Materials/asphalt"]


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(lambda layer: move(a_mesh(layer, "/Town/Buildings"), 0.01), id="building-1-cm"),
        pytest.param(lambda layer: move(layer.GetPrimAtPath(GRASS), 2e-4, 1), id="vertex-0.2-mm"),
        pytest.param(of_faces(lambda faces: faces[1:]), id="no-face"),
        pytest.param(of_faces(lambda faces: np.concatenate([faces, faces[:1]])), id="face-twice"),
        pytest.param(of_faces(lambda faces: np.concatenate([faces[:1, ::-1], faces[1:]])), id="face-turned-over"),
        pytest.param(of_faces(lambda faces: np.concatenate([faces[:1] * 0, faces[1:]])), id="face-of-no-area"),
        pytest.param(flipped_texture, id="texture"),
        pytest.param(exchanged_pictures, id="corners-of-a-picture"),
        pytest.param(without_a_prim, id="no-prop"),
        pytest.param(other_material, id="material"),
        pytest.param(other_car, id="parked-car"),
    ],
)
def test_another_town_is_found(change: Callable[[Sdf.Layer], None]) -> None:
    with pytest.raises(AssertionError):
        assert_same_geometry(changed(change), changed())


@pytest.mark.parametrize(
    "change",
    [
        pytest.param(lambda layer: None, id="nothing"),
        pytest.param(lambda layer: move(a_mesh(layer, "/Town/Buildings"), 2e-5), id="last-bits"),
        pytest.param(of_faces(lambda faces: np.roll(faces[::-1], 1, axis=1)), id="order-of-triangles"),
        pytest.param(of_faces(flipped_diagonal), id="other-triangles-of-a-level-surface"),
    ],
)
def test_the_same_town_is_accepted(change: Callable[[Sdf.Layer], None]) -> None:
    assert_same_geometry(changed(change), changed())


def test_other_triangles_of_a_slope_are_another_surface() -> None:
    def cut(layer: Sdf.Layer) -> None:
        other_diagonal_on_a_slope(layer)
        of_faces(flipped_diagonal)(layer)

    with pytest.raises(AssertionError, match=r"apart|m\^2"):
        assert_same_geometry(changed(cut), changed(other_diagonal_on_a_slope))
