"""Meshes of foreign stages: n-gons, holes, units, axes, handedness, mirrors, subsets, instances, purposes."""

from pathlib import Path

import numpy as np
import pytest
from pxr import Gf, Usd, UsdGeom, UsdShade, Vt

from mmw.core.mesh import TriangleMesh
from mmw.usd.meshes import MeshReader, bound_materials, place, semantic_label, to_metres
from mmw.usd.triangulate import triangulate
from mmw.worlds.importers.mesh_cleanup import free_name
from tests.fixtures.meshes import area, volume
from tests.fixtures.stages import add_box, add_material, add_polygons, bind, label, new_stage


@pytest.fixture
def stage(tmp_path: Path) -> Usd.Stage:
    return new_stage(tmp_path / "a.usda")


def read(stage: Usd.Stage) -> dict[str, TriangleMesh]:
    """Return every mesh in the world, by its path; further uses of one mesh are numbered."""
    reader = MeshReader(stage, Usd.TimeCode(0))
    found = {}
    for mesh in reader.meshes():
        matrix = reader.to_world(mesh) @ to_metres(stage)
        path = free_name(str(mesh.prim.GetPath()), found)
        found[path] = TriangleMesh(*place(reader.triangles(mesh.prim), matrix))
    return found


def cut(points: np.ndarray, polygons: list[list[int]], holes: tuple[int, ...] = ()) -> tuple[TriangleMesh, np.ndarray]:
    counts, indices = np.array([len(polygon) for polygon in polygons]), np.concatenate(polygons).astype(int)
    corners, polygon = triangulate(points, counts, indices, np.array(holes, dtype=int))
    return TriangleMesh(points, indices[corners]), polygon


def shoelace(flat: np.ndarray) -> float:
    x, y = flat.T
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


@pytest.mark.parametrize("seed", range(6))
def test_concave_polygons_keep_area_and_winding(seed: int) -> None:
    rng = np.random.default_rng(seed)
    count = int(rng.integers(5, 14))
    angle = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    radius = np.where(np.arange(count) % 2, rng.uniform(0.2, 0.5, count), rng.uniform(1.0, 3.0, count))
    flat = radius[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    frame = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    frame *= np.linalg.det(frame)  # a rotation, no mirror
    points = np.column_stack([flat, np.zeros(count)]) @ frame.T + rng.normal(size=3)
    mesh, polygon = cut(points, [list(range(count))])
    assert len(mesh.faces) == count - 2
    np.testing.assert_array_equal(polygon, 0)
    assert area(mesh) == pytest.approx(shoelace(flat), rel=1e-9)
    assert (mesh.crosses @ frame[:, 2] > 0.0).all()


def test_concave_quad_is_cut_inside() -> None:
    points = np.array([[0, 0, 0], [4, 0, 0], [1, 1, 0], [0, 4, 0]], dtype=float)  # an arrow; corner 2 points inward
    mesh, _ = cut(points, [[1, 2, 3, 0]])
    assert area(mesh) == pytest.approx(shoelace(points[[1, 2, 3, 0], :2]))


def test_mixed_polygons_in_order_without_holes() -> None:
    points = np.array([[x, y, 0] for y in range(3) for x in range(3)], dtype=float)
    polygons = [[0, 1, 4, 3], [1, 2, 5], [3, 4, 7, 6], [4, 5, 8], [4, 8, 7], [0, 1]]
    mesh, polygon = cut(points, polygons, holes=(2,))
    np.testing.assert_array_equal(polygon, [0, 0, 1, 3, 4])
    assert area(mesh) == pytest.approx(1.0 + 0.5 + 0.5 + 0.5)


@pytest.mark.parametrize("scale", [(1, 1, 1), (-1, 1, 1), (-1, -1, 1), (-2, -3, -0.5)])
@pytest.mark.parametrize("handed", ["rightHanded", "leftHanded"])
def test_mirrors_and_handedness_keep_faces_outward(stage: Usd.Stage, scale: tuple[float, ...], handed: str) -> None:
    box = add_box(stage, "/World/box", (2, 2, 2))
    if handed == "leftHanded":
        box.GetOrientationAttr().Set(handed)
        indices = np.array(box.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)[:, ::-1]
        box.GetFaceVertexIndicesAttr().Set(indices.ravel().tolist())
    UsdGeom.Xformable(box).AddScaleOp().Set(Gf.Vec3f(*scale))
    (mesh,) = read(stage).values()
    assert volume(mesh) == pytest.approx(8.0 * abs(np.prod(scale)))


def test_what_is_no_geometry_is_left_out(stage: Usd.Stage) -> None:
    for name in ("default", "render", "proxy", "guide"):
        UsdGeom.Imageable(add_box(stage, f"/World/{name}", (1, 1, 1))).CreatePurposeAttr(name)
    UsdGeom.Imageable(UsdGeom.Xform.Define(stage, "/World/aid")).CreatePurposeAttr("guide")
    add_box(stage, "/World/aid/inherits", (1, 1, 1))
    UsdGeom.Imageable(UsdGeom.Xform.Define(stage, "/World/hidden")).MakeInvisible()
    add_box(stage, "/World/hidden/below", (1, 1, 1))
    stage.CreateClassPrim("/class_of_boxes")
    add_box(stage, "/class_of_boxes/box", (1, 1, 1))
    assert sorted(read(stage)) == ["/World/default", "/World/render"]


def test_instances(stage: Usd.Stage) -> None:
    add_box(stage, "/Prototypes/crate/box", (2, 2, 2), (0, 0, 1))
    UsdGeom.Imageable(UsdGeom.Scope.Define(stage, "/Prototypes")).MakeInvisible()
    for k in range(3):
        use = UsdGeom.Xform.Define(stage, f"/World/crate_{k}")
        use.AddTranslateOp().Set(Gf.Vec3d(10.0 * k, 0, 0))
        use.GetPrim().GetReferences().AddInternalReference("/Prototypes/crate")
        use.GetPrim().SetInstanceable(True)
    found = read(stage)
    assert sorted(found) == [f"/World/crate_{k}/box" for k in range(3)]
    for k, path in enumerate(sorted(found)):
        np.testing.assert_allclose(found[path].points.mean(axis=0), [10.0 * k, 0, 1], atol=1e-12)


def test_point_instancer(stage: Usd.Stage) -> None:
    instancer = UsdGeom.PointInstancer.Define(stage, "/World/trees")
    instancer.AddTranslateOp().Set(Gf.Vec3d(100, 0, 0))
    add_box(stage, "/World/trees/protos/small", (1, 1, 1))
    tall = UsdGeom.Xform.Define(stage, "/World/trees/protos/tall")
    tall.AddTranslateOp().Set(Gf.Vec3d(0, 0, 5))
    add_box(stage, "/World/trees/protos/tall/box", (2, 2, 10))
    instancer.CreatePrototypesRel().SetTargets(["/World/trees/protos/small", "/World/trees/protos/tall"])
    instancer.CreateProtoIndicesAttr([0, 1, 1, 0])
    instancer.CreatePositionsAttr([Gf.Vec3f(0, 10.0 * k, 0) for k in range(4)])
    instancer.CreateScalesAttr([Gf.Vec3f(1 + k) for k in range(4)])
    instancer.CreateInvisibleIdsAttr([3])
    found = read(stage).values()
    means = sorted(tuple(np.round(mesh.points.mean(axis=0), 6)) for mesh in found)
    assert means == [(100, 0, 0), (100, 10, 10), (100, 20, 15)]
    assert sorted(round(volume(mesh), 3) for mesh in found) == [1.0, 320.0, 1080.0]


def test_subsets_have_materials_of_their_own(stage: Usd.Stage) -> None:
    red, blue = add_material(stage, "/World/red"), add_material(stage, "/World/blue")
    points = np.array([[x, y, 0] for y in range(2) for x in range(4)], dtype=float)
    mesh = add_polygons(stage, "/World/strip", points, [[0, 1, 5, 4], [1, 2, 6, 5], [2, 3, 7, 6]], red)
    indices = Vt.IntArray([1])
    subset = UsdShade.MaterialBindingAPI(mesh).CreateMaterialBindSubset("middle", indices)
    bind(subset.GetPrim(), blue)
    triangles = MeshReader(stage, Usd.TimeCode(0)).triangles(mesh.GetPrim())
    materials, index = bound_materials(mesh.GetPrim(), triangles.polygon)
    assert [materials[k].GetName() for k in index] == ["red", "red", "blue", "blue", "red", "red"]
    subset.GetIndicesAttr().Set(Vt.IntArray([0, 1, 2]))
    materials, index = bound_materials(mesh.GetPrim(), triangles.polygon)
    assert [material.GetName() for material in materials] == ["blue"]
    assert not index.any()


def test_deepest_label_wins(stage: Usd.Stage) -> None:
    label(stage.GetPrimAtPath("/World"), "building")
    plain, window = add_box(stage, "/World/plain", (1, 1, 1)), add_box(stage, "/World/window", (1, 1, 1))
    label(window.GetPrim(), "static")
    odd = add_box(stage, "/World/odd", (1, 1, 1))
    label(odd.GetPrim(), "spaceship")
    assert [semantic_label(p.GetPrim()) for p in (plain, window, odd)] == ["building", "static", "building"]
    assert semantic_label(stage.DefinePrim("/elsewhere")) == "unlabeled"


@pytest.mark.parametrize(
    ("kind", "size", "expected"),
    [
        ("Cube", (3, 3, 3), 27.0),
        ("Sphere", (2, 2, 2), 4 / 3 * np.pi),
        ("Cylinder", (2, 2, 5), 5 * np.pi),
        ("Cone", (2, 2, 5), 5 / 3 * np.pi),
        ("Capsule", (2, 2, 7), 5 * np.pi + 4 / 3 * np.pi),
    ],
)
@pytest.mark.parametrize("axis", ["X", "Y", "Z"])
def test_shapes(stage: Usd.Stage, kind: str, size: tuple[float, ...], expected: float, axis: str) -> None:
    prim = stage.DefinePrim("/World/shape", kind)
    for name, value in (("size", 3.0), ("radius", 1.0), ("height", 5.0), ("axis", axis)):
        if prim.HasAttribute(name):
            prim.GetAttribute(name).Set(value)
    (mesh,) = read(stage).values()
    shift = {"X": 1, "Y": 2, "Z": 0}[axis] if prim.HasAttribute("axis") else 0
    low, high = mesh.bounds
    np.testing.assert_allclose(high - low, np.roll(size, shift), rtol=0.01)
    np.testing.assert_allclose(high + low, 0.0, atol=0.02)
    assert volume(mesh) == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize(("axis", "size"), [("X", (0, 4, 2)), ("Y", (2, 0, 4)), ("Z", (2, 4, 0))])
def test_plane_faces_along_its_axis(stage: Usd.Stage, axis: str, size: tuple[float, ...]) -> None:
    prim = stage.DefinePrim("/World/plane", "Plane")
    for name, value in (("width", 2.0), ("length", 4.0), ("axis", axis)):
        prim.GetAttribute(name).Set(value)
    (mesh,) = read(stage).values()
    np.testing.assert_allclose(np.ptp(mesh.points, axis=0), size)
    np.testing.assert_allclose(mesh.crosses.sum(axis=0), 16.0 * (np.arange(3) == "XYZ".index(axis)))
