"""The vehicle assets: closed and outward, of the declared size, on the ground, bound, and equal to a rebuild."""

import math
import shutil

import numpy as np
import pytest
import trimesh
from pxr import Sdf, Usd, UsdGeom, UsdShade
from scipy.sparse.csgraph import connected_components

from mmw.core.mesh import TriangleMesh, separate
from mmw.core.resources import assets_dir
from mmw.usd.material_library import PAINTS
from mmw.usd.semantics import CARLA_TAG
from mmw.usd.validate import validate_stage
from mmw.usd.vehicle_catalog import load_catalog
from mmw.worlds.checks.coplanar_faces import find_overlaps
from mmw.worlds.vehicles.build import build_shape, build_vehicle
from mmw.worlds.vehicles.models import BLUEPRINTS
from mmw.worlds.vehicles.primitives import Shape, box, corner_normals, pod, weld
from mmw.worlds.vehicles.surface_panels import Panel, build_panel, cast
from mmw.worlds.vehicles.wheel import wheel

FOLDER = assets_dir() / "vehicles"
MODELS = sorted(BLUEPRINTS)
PARTS = {"body", "glass", "rubber", "rims", "trim", "gloss", "lights_front", "lights_rear", "lights_amber", "plates"}


@pytest.fixture(params=MODELS)
def model(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture
def stage(model: str) -> Usd.Stage:
    return Usd.Stage.Open(str(FOLDER / model / f"{model}.usda"))


def meshes(stage: Usd.Stage) -> dict[str, UsdGeom.Mesh]:
    return {p.GetName(): UsdGeom.Mesh(p) for p in stage.GetDefaultPrim().GetChildren() if p.IsA(UsdGeom.Mesh)}


def triangles(mesh: UsdGeom.Mesh) -> np.ndarray:
    """Return the corners of the triangles [m], shape [M, 3, 3]."""
    points = np.array(mesh.GetPointsAttr().Get(), dtype=np.float64)
    return points[np.array(mesh.GetFaceVertexIndicesAttr().Get()).reshape(-1, 3)]


def all_triangles(stage: Usd.Stage) -> np.ndarray:
    return np.concatenate([triangles(mesh) for mesh in meshes(stage).values()])


def components(corners: np.ndarray) -> tuple[trimesh.Trimesh, np.ndarray]:
    """Return the triangles welded by position, and the connected component of each face, shape [M]."""
    points, faces = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    mesh = trimesh.Trimesh(points, faces.reshape(-1, 3), process=False)
    return mesh, trimesh.graph.connected_component_labels(mesh.face_adjacency, node_count=len(mesh.faces))


def test_every_component_is_closed_and_turned_outward(stage):
    mesh, component = components(all_triangles(stage))
    assert mesh.is_watertight and mesh.is_winding_consistent
    volume = np.bincount(component, np.linalg.det(mesh.triangles) / 6)
    assert len(volume) >= 5 and np.all(volume > 1e-6)
    assert mesh.area_faces.min() > 0


def test_no_two_faces_lie_in_one_plane_and_overlap(stage):
    mesh = separate(all_triangles(stage))
    assert len(find_overlaps(mesh.corners, mesh.normals, mesh.areas).area) == 0


def test_no_part_floats(stage):
    mesh, component = components(all_triangles(stage))
    pieces = [mesh.triangles[component == index].reshape(-1, 3) for index in range(component.max() + 1)]
    low, high = (np.array([side(piece, axis=0) for piece in pieces]) for side in (np.min, np.max))
    touches = (low[:, None] <= high + 0.12).all(axis=2)
    assert connected_components(touches & touches.T)[0] == 1


def test_shading_normals_follow_the_faces(stage):
    for mesh in meshes(stage).values():
        face = separate(triangles(mesh)).normals
        normals = np.array(mesh.GetNormalsAttr().Get(), dtype=np.float64).reshape(-1, 3, 3)
        assert mesh.GetNormalsInterpolation() == UsdGeom.Tokens.faceVarying
        assert mesh.GetSubdivisionSchemeAttr().Get() == UsdGeom.Tokens.none
        np.testing.assert_allclose(np.linalg.norm(normals, axis=2), 1.0, atol=1e-5)
        assert np.einsum("mci,mi->mc", normals, face).min() > 0.3


def test_size_is_the_declared_one_within_a_centimetre(model, stage):
    declared = load_catalog()[model]
    named = meshes(stage)
    corners = np.concatenate(
        [triangles(mesh).reshape(-1, 3) for name, mesh in named.items() if name not in ("trim", "mirror")]
    )
    low, high = corners.min(axis=0), corners.max(axis=0)  # mirrors are outside the box, and their shells are trim
    assert abs(high[1] - low[1] - declared.width) < 0.01
    every = all_triangles(stage).reshape(-1, 3)
    assert abs(np.ptp(every[:, 0]) - declared.length) < 0.01
    assert abs(every[:, 2].max() - declared.height) < 0.01
    center = np.array([(every[:, 0].min() + every[:, 0].max()) / 2, 0.0, declared.height / 2])
    np.testing.assert_allclose(declared.center, center, atol=1e-5)
    hint = np.array(UsdGeom.ModelAPI(stage.GetDefaultPrim()).GetExtentsHint())
    np.testing.assert_allclose(hint, [every.min(axis=0), every.max(axis=0)], atol=1e-5)


def test_four_wheels_touch_the_ground_below_the_axles(model, stage):
    declared = load_catalog()[model]
    corners = all_triangles(stage).reshape(-1, 3)
    assert abs(corners[:, 2].min()) < 1e-6
    rubber = triangles(meshes(stage)["rubber"]).reshape(-1, 3)
    for x in (declared.wheelbase / 2, -declared.wheelbase / 2):
        for side in (1.0, -1.0):
            tyre = rubber[(np.abs(rubber[:, 0] - x) < 1.01 * declared.wheel_radius) & (side * rubber[:, 1] > 0)]
            contact = tyre[tyre[:, 2] < 1e-6]
            assert len(contact) and np.allclose(contact[:, 0], x, atol=1e-5)
            assert math.isclose(np.ptp(tyre[:, 2]), 2 * declared.wheel_radius, abs_tol=1e-5)
            assert side * tyre[:, 1].max() <= declared.width / 2 or side < 0
    front = rubber[rubber[:, 0] > 0]
    middles = [(front[keep, 1].min() + front[keep, 1].max()) / 2 for keep in (front[:, 1] > 0, front[:, 1] < 0)]
    assert math.isclose(middles[0] - middles[1], declared.track, abs_tol=1e-5)


def test_asset_is_a_labelled_component_that_validates_in_every_paint(model, stage):
    root = stage.GetDefaultPrim()
    assert Usd.ModelAPI(root).GetKind() == "component" and root.HasAuthoredPayloads()
    assert load_catalog()[model].label in CARLA_TAG
    assert set(meshes(stage)) >= PARTS
    assert validate_stage(stage) == []
    for paint in PAINTS:
        with Usd.EditContext(stage, stage.GetSessionLayer()):  # a town that another test has open shares the layer
            root.GetVariantSet("paint").SetVariantSelection(paint)
        for name, mesh in meshes(stage).items():
            material = UsdShade.MaterialBindingAPI(mesh.GetPrim()).ComputeBoundMaterial()[0]
            assert material and material.GetPrim().GetAttribute("mmw:radio:model").HasAuthoredValue()
            assert (material.GetPrim().GetName() == f"car_paint_{paint}") == (name == "body")


def test_rebuild_equals_the_committed_asset(model, tmp_path):
    path = build_vehicle(model, tmp_path / model)
    assert path.read_bytes() == (FOLDER / model / f"{model}.usda").read_bytes()
    built, shipped = (
        Sdf.Layer.OpenAsAnonymous(str(folder / model / "geometry.usdc")).ExportToString()
        for folder in (tmp_path, FOLDER)
    )
    assert built == shipped


def test_triangle_count_and_flat_panels(stage):
    corners = all_triangles(stage)
    assert 5000 <= len(corners) <= 9000
    mesh, _ = components(corners)
    flat = mesh.face_adjacency[mesh.face_adjacency_angles < 1e-3]
    panel = trimesh.graph.connected_component_labels(flat, node_count=len(corners))
    area = np.bincount(panel, mesh.area_faces)
    normal = np.zeros((len(area), 3))
    normal[panel] = mesh.face_normals
    side = np.abs(normal[:, 1]) > 0.9
    screen = (np.abs(normal[:, 0]) > 0.3) & (normal[:, 2] > 0.0)
    assert area[side].max() > 0.3 and area[screen].max() > 0.25  # what a specular reflection needs


def test_catalog_agrees_with_the_blueprints():
    catalog = load_catalog()
    assert sorted(catalog) == MODELS and len(catalog) >= 6
    for name, model in catalog.items():
        blueprint = BLUEPRINTS[name]
        assert (model.length, model.width, model.height) == (blueprint.length, blueprint.width, blueprint.height)
        assert (model.wheelbase, model.track) == (blueprint.wheelbase, blueprint.wheels.track)
        assert model.paints[0] == blueprint.paints[0] and sorted(model.paints) == sorted(PAINTS)
        assert model.asset.is_file() and model.name == name


def test_catalog_says_what_an_asset_lacks(tmp_path):
    with pytest.raises(ValueError, match="one is needed"):
        load_catalog(tmp_path)
    shutil.copytree(FOLDER / "sedan", tmp_path / "sedan")
    path = tmp_path / "sedan" / "sedan.usda"
    path.write_text(path.read_text().replace("custom float mmw:vehicle:track = 1.58\n", ""))
    with pytest.raises(ValueError, match="mmw:vehicle:track"):
        load_catalog(tmp_path)


def test_unknown_model_lists_the_known_ones():
    with pytest.raises(ValueError, match=r"'rocket'.*sedan"):
        build_shape("rocket")


def test_box_has_the_volume_of_its_formula():
    bevel, size = 0.1, np.array([1.0, 2.0, 3.0])
    shape = box((0, 0, 0), size, "trim", bevel)
    mesh = trimesh.Trimesh(shape.points, shape.faces, process=False)
    cut_edges = 4 * bevel**2 / 2 * (size - 2 * bevel).sum()
    cut_corners = 8 * (bevel**3 - bevel**3 / 6)  # of a corner cube, the tetrahedron between its three cuts remains
    assert mesh.is_watertight and math.isclose(mesh.volume, size.prod() - cut_edges - cut_corners, rel_tol=1e-9)
    with pytest.raises(ValueError, match="bevel"):
        box((0, 0, 0), (1, 1, 0.1), "trim", 0.06)


def test_wheel_stands_on_a_vertex_and_needs_matching_spokes():
    shape = wheel(0.3, 0.2, 0.2, 5)
    assert trimesh.Trimesh(shape.points, shape.faces, process=False).is_watertight
    assert math.isclose(shape.points[:, 2].min(), -0.3, abs_tol=1e-12)
    with pytest.raises(ValueError, match="spokes"):
        wheel(0.3, 0.2, 0.2, 7)


def test_corner_normals_smooth_below_the_crease_only():
    cube = box((0, 0, 0), (1, 1, 1), "trim")
    np.testing.assert_allclose(corner_normals(cube), np.repeat(cube.normals[:, None], 3, axis=1), atol=1e-12)
    fold = np.array([[0.0, -1, 0.1], [0, 1, 0.1], [1, 0, 0], [-1, 0, 0]])  # a roof of 0.2 rad along y
    normals = corner_normals(TriangleMesh(fold, np.array([[0, 2, 1], [1, 3, 0]])))
    np.testing.assert_allclose(normals[0, 0], [0, 0, 1], atol=1e-12)


def test_weld_drops_faces_without_area():
    points = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 0, 0]])
    welded = weld(Shape(points, np.array([[0, 1, 2], [1, 3, 2]], dtype=np.int32), np.array(["a", "b"])))
    assert len(welded.points) == 3 and len(welded.faces) == 1 and welded.parts.tolist() == ["a"]


def test_lamps_burn_and_plates_read_from_left_to_right(stage):
    named = meshes(stage)
    for part, lamp in (("lights_front", "headlight"), ("lights_rear", "taillight")):
        material = UsdShade.MaterialBindingAPI(named[part].GetPrim()).ComputeBoundMaterial()[0]
        assert material.GetPrim().GetAttribute("mmw:lamp").Get() == lamp
        assert max(material.ComputeSurfaceSource()[0].GetInput("emissiveColor").Get()) >= 1.0
        x = triangles(named[part])[..., 0]
        assert x.min() > 0.0 if lamp == "headlight" else x.max() < 0.0
    corners = triangles(named["plates"])
    st = np.array(UsdGeom.PrimvarsAPI(named["plates"]).GetPrimvar("st").ComputeFlattened()).reshape(-1, 3, 2)
    seen = np.ptp(st, axis=1).min(axis=1) > 0.0  # faces of the picture; the walls behind it have none
    assert st.min() >= 0.0 and st.max() <= 1.0
    for side in (1.0, -1.0):
        chosen = seen & (side * corners[:, 0, 0] > 0.0)
        y, z = corners[chosen][..., 1].ravel(), corners[chosen][..., 2].ravel()
        u, v = st[chosen][..., 0].ravel(), st[chosen][..., 1].ravel()
        assert np.corrcoef(side * y, u)[0, 1] > 0.999 and np.corrcoef(z, v)[0, 1] > 0.99
        assert 0.5 < np.ptp(y) < 0.53 and 0.10 < np.ptp(z) < 0.13


@pytest.mark.parametrize("side", ["front", "rear", "left", "right", "top"])
@pytest.mark.parametrize("radius", [0.0, 0.05])
def test_panel_on_a_box_is_closed_and_lies_before_it(side, radius):
    skin = box((-2.0, -1.0, 0.0), (2.0, 1.0, 1.5), "body")
    corners = ((-0.3, 0.4), (0.4, 0.4), (0.4, 0.9), (-0.3, 0.9))
    shape = build_panel(Panel(side, corners, "gloss", 0.01, radius, (3, 2), picture=(0.0, 0.0, 1.0, 1.0)), skin)
    mesh = trimesh.Trimesh(shape.points, shape.faces, process=False)
    assert mesh.is_watertight and mesh.volume > 0.0
    axis, reach = {"front": (0, 2.0), "rear": (0, -2.0), "left": (1, 1.0), "right": (1, -1.0), "top": (2, 1.5)}[side]
    sign = np.sign(reach)
    face = np.isclose(shape.points[shape.faces][..., axis], reach + 0.01 * sign).all(axis=1)
    cut = (4.0 - 2.0 * math.sqrt(2.0)) * radius**2  # an eighth of a circle is one chord
    assert mesh.area_faces[face].sum() == pytest.approx(0.7 * 0.5 - cut, rel=2e-3)
    assert (sign * mesh.face_normals[face, axis]).min() > 0.999
    coordinates = shape.coordinates()
    assert np.ptp(coordinates[face].reshape(-1, 2), axis=0) == pytest.approx(1.0) and not coordinates[~face].any()


def test_panel_stands_before_a_skin_that_bends_between_its_points():
    angle = np.linspace(-1.2, 1.2, 25)
    arc = np.stack([2.0 + 0.5 * np.cos(angle), 0.5 * np.sin(angle)], axis=1)
    points = np.concatenate([np.column_stack([arc, np.zeros(25)]), np.column_stack([arc, np.ones(25)])])
    index = np.arange(24)
    faces = np.concatenate([np.stack([index, index + 1, index + 26], 1), np.stack([index, index + 26, index + 25], 1)])
    skin = Shape(points, faces.astype(np.int32), np.full(48, "body"))
    corners = ((-0.3, 0.3), (0.3, 0.3), (0.3, 0.6), (-0.3, 0.6))
    panel = build_panel(Panel("front", corners, "gloss", 0.004, cells=(2, 1)), skin)
    y, z = (axis.ravel() for axis in np.meshgrid(np.linspace(-0.29, 0.29, 23), np.linspace(0.31, 0.59, 5)))
    start, inward = np.column_stack([np.full(len(y), 10.0), y, z]), np.tile([-1.0, 0.0, 0.0], (len(y), 1))
    assert (cast(skin, start, inward) - cast(panel, start, inward)).min() > 0.001
    with pytest.raises(ValueError, match="beyond the skin"):
        build_panel(Panel("front", ((-0.3, 0.3), (0.9, 0.3), (0.9, 0.6), (-0.3, 0.6)), "gloss"), skin)


def test_pod_is_closed_outward_and_fills_its_box():
    shape = pod((0.0, 0.0, 0.0), (0.2, 0.3, 0.4), "trim")
    mesh = trimesh.Trimesh(shape.points, shape.faces, process=False)
    assert mesh.is_watertight and 0.5 * 0.024 < mesh.volume < 0.024
    assert shape.points.min() >= -1e-9 and np.all(shape.points <= np.array([0.2, 0.3, 0.4]) + 1e-9)
