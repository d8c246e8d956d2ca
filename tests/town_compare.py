"""Are two builds of a town the same town? Their bytes may differ where a library, or a CPU's last bits, does."""

from pathlib import Path

import numpy as np
from pxr import Usd

from mmw.town.author import PAYLOAD

POINT_M = 1e-4
"""How far points, and surfaces of other triangles, may lie apart [m]: ten times the last bit of float32 at 200 m."""
TEXTURE = 2e-3
"""How far texture coordinates may lie apart [m, or picture widths]: half a texel of a tile of 4 m, one of a picture."""
NORMAL = 1e-3
"""How far components of normals may lie apart."""
AREA = 1e-6
"""How much the area of a mesh may differ, as a share."""

TOLERANCES = {"points": POINT_M, "extent": POINT_M, "normals": NORMAL}
FACES = ("faceVertexIndices", "faceVertexCounts")
TEXTURED = ("primvars:st", "primvars:st:indices")


def assert_same_town(one: Path, other: Path, name: str) -> None:
    """Compare two folders of a town: the same prims and properties, the same surfaces with the same pictures on them.

    Points may lie `POINT_M` apart. The order of triangles counts for nothing, nor which corner of one comes first.
    Where a surface is cut into other triangles, its area and where it lies must be the same. Texture coordinates are
    compared as what each vertex has, so that their order counts for nothing either.

    Raises:
        AssertionError: If they differ; the text says where.
    """
    if all((one / file).read_bytes() == (other / file).read_bytes() for file in (PAYLOAD, f"{name}.usda")):
        return
    assert_same_geometry(*(Usd.Stage.Open(str(folder / PAYLOAD)) for folder in (one, other)))
    lines = [(folder / f"{name}.usda").read_text().splitlines() for folder in (one, other)]
    kept = [[line for line in text if "extentsHint" not in line] for text in lines]
    assert kept[0] == kept[1]


def assert_same_geometry(ours: Usd.Stage, theirs: Usd.Stage) -> None:
    """Compare the payloads of two builds; see `assert_same_town`."""
    assert [p.GetPath() for p in ours.TraverseAll()] == [p.GetPath() for p in theirs.TraverseAll()]
    for prim in ours.TraverseAll():
        _assert_same_prim(prim, theirs.GetPrimAtPath(prim.GetPath()))


def _assert_same_prim(prim: Usd.Prim, other: Usd.Prim) -> None:
    assert prim.GetTypeName() == other.GetTypeName(), prim.GetPath()
    assert prim.GetPropertyNames() == other.GetPropertyNames(), prim.GetPath()
    assert prim.GetAllMetadata().keys() == other.GetAllMetadata().keys(), prim.GetPath()
    assert _references(prim) == _references(other), prim.GetPath()
    names = set(prim.GetPropertyNames())
    is_cut_otherwise = "faceVertexIndices" in names and _value(prim, "faceVertexIndices") != _value(
        other, "faceVertexIndices"
    )
    if is_cut_otherwise:
        _assert_same_surface(prim, other)
    if is_cut_otherwise or any(_value(prim, name) != _value(other, name) for name in TEXTURED if name in names):
        _assert_same_textures(prim, other)
    for attribute in prim.GetAttributes():
        name, path = attribute.GetName(), attribute.GetPath()
        of_corners = name == "normals" and attribute.GetMetadata("interpolation") == "faceVarying"
        if name in TEXTURED or (is_cut_otherwise and (name in FACES or of_corners)):
            continue
        a, b = attribute.Get(), other.GetAttribute(name).Get()
        if a != b and name in TOLERANCES:
            assert np.shape(a) == np.shape(b), f"{path}: {np.shape(a)} and {np.shape(b)}"
            apart = np.abs(np.subtract(a, b, dtype=np.float64)).max()
            assert apart <= TOLERANCES[name], f"{path}: {apart} apart"
        else:
            assert a == b, path
    for relation in prim.GetRelationships():
        assert relation.GetTargets() == other.GetRelationship(relation.GetName()).GetTargets(), relation.GetPath()


def _references(prim: Usd.Prim) -> list[str]:
    """Return the names of the files that a prim refers to; their folder depends on where the town was built."""
    listed = prim.GetMetadata("references")
    return [Path(item.assetPath).name for item in listed.GetAddedOrExplicitItems()] if listed else []


def _value(prim: Usd.Prim, name: str) -> object:
    attribute = prim.GetAttribute(name)
    return attribute.Get() if attribute else None


def _faces(prim: Usd.Prim) -> np.ndarray:
    """Return the triangles of a mesh, each from its smallest vertex on, sorted, shape [M, 3]."""
    faces = np.array(_value(prim, "faceVertexIndices")).reshape(-1, 3)
    turned = np.take_along_axis(faces, (np.argmin(faces, axis=1)[:, None] + np.arange(3)) % 3, axis=1)
    return turned[np.lexsort(turned.T[::-1])]


def _points(prim: Usd.Prim) -> np.ndarray:
    return np.array(_value(prim, "points"), np.float64)


def _assert_same_surface(prim: Usd.Prim, other: Usd.Prim) -> None:
    """Compare meshes whose triangles come in another order, or are others."""
    path, faces, theirs = prim.GetPath(), _faces(prim), _faces(other)
    counts = (_value(mesh, "faceVertexCounts") for mesh in (prim, other))
    assert all(set(count) == {3} for count in counts), f"{path}: not of triangles"
    points, there = _points(prim), _points(other)
    assert points.shape == there.shape, f"{path}: {len(points)} and {len(there)} points"
    if faces.shape == theirs.shape and (faces == theirs).all():
        return
    vectors = [_area_vectors(p, f) for p, f in ((points, faces), (there, theirs))]
    areas = [np.linalg.norm(some, axis=1).sum() for some in vectors]
    assert abs(areas[0] - areas[1]) <= AREA * areas[1], f"{path}: {areas[0]} and {areas[1]} m^2"
    turned = np.linalg.norm(vectors[0].sum(axis=0) - vectors[1].sum(axis=0))
    assert turned <= AREA * areas[1], f"{path}: triangles of {turned} m^2 look to the other side"
    ours, others = ({tuple(face) for face in some.tolist()} for some in (faces, theirs))
    for these, own, those, far in ((ours, points, others, there), (others, there, ours, points)):
        alone, rest = sorted(these - those), sorted(those - these)
        assert alone and rest, f"{path}: triangles are missing or there twice"
        samples = np.einsum("sc,fcx->fsx", SAMPLES, own[np.array(alone)]).reshape(-1, 3)
        apart = _distances(samples, far[np.array(rest)]).max()
        assert apart <= POINT_M, f"{path}: surfaces are {apart} m apart"


SAMPLES = np.array([[i, j, 6 - i - j] for i in range(7) for j in range(7 - i)]) / 6.0
"""Where in a triangle its distance is measured: barycentric coordinates."""


def _area_vectors(points: np.ndarray, faces: np.ndarray) -> np.ndarray:
    a, b, c = (points[faces[:, k]] for k in range(3))
    return 0.5 * np.cross(b - a, c - a)


def _distances(samples: np.ndarray, corners: np.ndarray) -> np.ndarray:
    """Return the distance of each sample [S, 3] to the nearest of some triangles [T, 3, 3], shape [S]."""
    nearest = np.full(len(samples), np.inf)
    for a, b, c in corners:
        normal = np.cross(b - a, c - a)
        size = np.linalg.norm(normal)
        if size > 0.0:
            out = (samples - a) @ normal / size
            inside = np.ones(len(samples), bool)
            for start, end in ((a, b), (b, c), (c, a)):
                inside &= (samples - start) @ np.cross(normal, end - start) >= 0.0
            nearest = np.where(inside, np.minimum(nearest, np.abs(out)), nearest)
        for start, end in ((a, b), (b, c), (c, a)):
            side = end - start
            along = np.clip((samples - start) @ side / max(float(side @ side), 1e-300), 0.0, 1.0)
            nearest = np.minimum(nearest, np.linalg.norm(samples - start - along[:, None] * side, axis=1))
    return nearest


def _assert_same_textures(prim: Usd.Prim, other: Usd.Prim) -> None:
    """Compare what texture coordinates each vertex has, whatever their order and the triangles'."""
    path = prim.GetPath()
    (vertex, st), (others, there) = _textures(prim), _textures(other)
    assert np.array_equal(np.unique(vertex), np.unique(others)), path
    for own, values, ones, theirs in ((vertex, st, others, there), (others, there, vertex, st)):
        begin, end = np.searchsorted(ones, own, "left"), np.searchsorted(ones, own, "right")
        left = np.ones(len(own), bool)
        for k in range(int((end - begin).max(initial=0))):
            at = np.minimum(begin + k, end - 1)
            left &= np.abs(values - theirs[at]).max(axis=1) > TEXTURE
        assert not left.any(), f"{path}: vertex {own[left][0]} has {values[left][0]}, which it has not in the other"
    if len(_faces(prim)) == len(_faces(other)) and (_faces(prim) == _faces(other)).all():
        at = [_corner_textures(mesh) for mesh in (prim, other)]
        apart = np.abs(at[0] - at[1]).max(initial=0.0)
        assert apart <= TEXTURE, f"{path}: corners are {apart} apart"


def _corners(prim: Usd.Prim) -> tuple[np.ndarray, np.ndarray]:
    """Return vertex and texture coordinates of each corner, shapes [3 M] and [3 M, 2]."""
    faces, st = np.array(_value(prim, "faceVertexIndices")), np.array(_value(prim, "primvars:st"), np.float64)
    indices = _value(prim, "primvars:st:indices")
    if indices is not None:
        st = st[np.array(indices)]
    return faces, st if len(st) == len(faces) else st[faces]


def _textures(prim: Usd.Prim) -> tuple[np.ndarray, np.ndarray]:
    """Return the different texture coordinates of every vertex, sorted by vertex: shapes [K] and [K, 2]."""
    vertex, st = _corners(prim)
    keyed = np.unique(np.column_stack([vertex, st]), axis=0)
    return keyed[:, 0].astype(int), keyed[:, 1:]


def _corner_textures(prim: Usd.Prim) -> np.ndarray:
    """Return texture coordinates in the order of `_faces`, shape [M, 3, 2]."""
    vertex, st = _corners(prim)
    faces, st = vertex.reshape(-1, 3), st.reshape(-1, 3, 2)
    turns = (np.argmin(faces, axis=1)[:, None] + np.arange(3)) % 3
    faces, st = np.take_along_axis(faces, turns, axis=1), np.take_along_axis(st, turns[:, :, None], axis=1)
    return st[np.lexsort(faces.T[::-1])]
