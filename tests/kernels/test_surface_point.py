"""Points that a camera shades where its ray hits a face: colors at the right place, normals, footprints, holes."""

from pathlib import Path

import numpy as np
import pytest
import warp as wp
from PIL import Image
from pxr import Gf, UsdGeom

from mmw.kernels.core.faces import material_of
from mmw.kernels.core.structs import Scene as SceneStruct
from mmw.kernels.core.trace import closest_hit
from mmw.kernels.shading.structs import AppearanceTable, SurfacePoint
from mmw.kernels.shading.surface_point import is_cut_out, ray_hit, surface_point_of
from mmw.scene.device_scene import DeviceScene
from mmw.scene.reader import read_stage
from mmw.scene.scene_data import SceneData
from mmw.sensors.render.appearance_buffers import AppearanceArrays
from tests.fixtures.kernels import launched
from tests.fixtures.material_stages import add_quad, connect, corner_image, give_uv, preview, stage_in
from tests.fixtures.stages import add_polygons, animate

RED, GREEN, BLUE, WHITE = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (1.0, 1.0, 1.0)
CORNERS = {(0.5, 0.5): RED, (1.5, 0.5): GREEN, (0.5, 1.5): BLUE, (1.5, 1.5): WHITE}


@wp.kernel
def surface_point_kernel(
    scene: SceneStruct,
    appearance: AppearanceTable,
    origin: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    spread: float,
    surface_point_out: wp.array[SurfacePoint],
    normal_out: wp.array[wp.vec3],
    is_hole_out: wp.array[wp.bool],
):
    """Find surface points along rays of frame 0. Launch: dim=R, block_dim=64."""
    i = wp.tid()
    near = closest_hit(scene, 0, origin[i], direction[i], 1.0e4, -1)
    if near.face < 0:
        surface_point_out[i].material = -1
        return
    hit = ray_hit(0, origin[i], direction[i], near.t, near.face, near.instance)
    surface_point_out[i] = surface_point_of(scene, appearance, hit, spread)
    normal_out[i] = near.normal
    is_hole_out[i] = is_cut_out(scene, appearance, hit, spread)
    assert surface_point_out[i].material == material_of(scene, near.face, near.instance)


class TracedPoints:
    """Surface points along rays, and normals and holes of the same hits."""

    def __init__(self, arrays: SceneData, device: str, origins, directions, *, spread: float = 1e-4, weather="sunny"):
        scene = DeviceScene(arrays, device, 1)
        scene.load_batch([arrays.frames[0]])
        self.appearance = AppearanceArrays(scene)
        origins = np.asarray(origins, dtype=np.float32).reshape(-1, 3) - scene.origin
        directions = np.broadcast_to(np.asarray(directions, dtype=np.float64), origins.shape)
        directions = directions / np.linalg.norm(directions, axis=1, keepdims=True)
        inputs = [scene.struct, self.appearance.for_weather(weather), origins, directions, spread]
        self.surface_point, self.normal, self.is_hole = launched(surface_point_kernel, len(origins), inputs, device)
        self.direction = directions

    def __getattr__(self, name: str) -> np.ndarray:
        return self.surface_point[name]


def above(points) -> np.ndarray:
    return np.array([(x, y, 5.0) for x, y in points])


def read(stage, **options) -> SceneData:
    stage.Save()
    return read_stage(stage.GetRootLayer().realPath, range(1), ["sunny"], **options)


def textured(folder: Path, **inputs):
    """Write a stage and a material whose color is the image of four corners."""
    stage = stage_in(folder)
    material, shader = preview(stage, "/World/Looks/four")
    connect(stage, shader, "diffuseColor", corner_image(folder / "four.png"), sourceColorSpace="sRGB", **inputs)
    return stage, material


def check_corners(arrays: SceneData, device: str, expected=CORNERS) -> None:
    points_hit = TracedPoints(arrays, device, above(expected), (0, 0, -1))
    np.testing.assert_allclose(points_hit.color, list(expected.values()), atol=1e-3)


def test_texture_orientation(device: str, tmp_path: Path) -> None:
    stage, material = textured(tmp_path)
    give_uv(add_quad(stage, "/World/quad", material))
    check_corners(read(stage), device)


@pytest.mark.parametrize(
    ("interpolation", "values", "indices"),
    [
        ("vertex", [(0, 0), (1, 0), (1, 1), (0, 1)], None),
        ("varying", [(1, 1), (0, 1), (0, 0), (1, 0)], [2, 3, 0, 1]),
        ("faceVarying", [(0, 0), (1, 0), (1, 1), (0, 1)], None),
        ("faceVarying", [(0, 1), (0, 0), (1, 0), (1, 1)], [1, 2, 3, 0]),
    ],
)
@pytest.mark.parametrize("is_left_handed", [False, True])
def test_interpolations(device: str, tmp_path: Path, interpolation, values, indices, is_left_handed) -> None:
    stage, material = textured(tmp_path)
    mesh = give_uv(add_quad(stage, "/World/quad", material), values, interpolation, indices=indices)
    if is_left_handed:
        mesh.CreateOrientationAttr(UsdGeom.Tokens.leftHanded)
    check_corners(read(stage), device)


@pytest.mark.parametrize(("interpolation", "values"), [("uniform", [(0.2, 0.2)]), ("constant", [(0.2, 0.2)])])
def test_one_coordinate_for_a_face(device: str, tmp_path: Path, interpolation, values) -> None:
    stage, material = textured(tmp_path)
    give_uv(add_quad(stage, "/World/quad", material), values, interpolation)
    check_corners(read(stage), device, dict.fromkeys(CORNERS, RED))


def test_concave_polygon_with_coordinates_of_its_corners(device: str, tmp_path: Path) -> None:
    """An L of six corners; texture coordinates are half of x and y, given by corner in another order of points."""
    stage, material = textured(tmp_path)
    outline = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
    points = np.array([(x, y, 0) for x, y in outline], dtype=float)
    mesh = add_polygons(stage, "/World/l", points[::-1], [[5, 4, 3, 2, 1, 0]], material)
    give_uv(mesh, [(x / 2, y / 2) for x, y in outline], "faceVarying")
    check_corners(read(stage), device, {k: v for k, v in CORNERS.items() if k != (1.5, 1.5)})


def test_mirrored_and_stretched_placements(device: str, tmp_path: Path) -> None:
    stage, material = textured(tmp_path)
    mesh = give_uv(add_quad(stage, "/World/quad", material))
    mesh.AddTranslateOp().Set(Gf.Vec3d(2, 0, 0))
    mesh.AddScaleOp().Set(Gf.Vec3f(-1, 3, 1))
    expected = {(1.5, 1.5): RED, (0.5, 1.5): GREEN, (1.5, 4.5): BLUE, (0.5, 4.5): WHITE}
    check_corners(read(stage), device, expected)


def test_point_instancer_and_actor(device: str, tmp_path: Path) -> None:
    stage, material = textured(tmp_path)
    instancer = UsdGeom.PointInstancer.Define(stage, "/World/many")
    give_uv(add_quad(stage, "/World/many/one", material))
    instancer.CreatePrototypesRel().AddTarget("/World/many/one")
    instancer.CreateProtoIndicesAttr([0, 0])
    instancer.CreatePositionsAttr([(10, 0, 0), (20, 0, 0)])
    animate(stage, "/World/car", np.array([(-4.0, 1.0, 0.0), (-3.0, 1.0, 0.0)]), np.pi / 2)
    give_uv(add_quad(stage, "/World/car/body", material))
    arrays = read(stage)
    for shift in (10, 20):
        check_corners(arrays, device, {(x + shift, y): c for (x, y), c in CORNERS.items()})
    check_corners(arrays, device, {(-4 - y, 1 + x): c for (x, y), c in CORNERS.items()})  # turned by 90 deg


def test_names_of_coordinates(device: str, tmp_path: Path) -> None:
    """The name that the material gives counts before `st`; else common names, else any texture coordinates."""
    stage, material = textured(tmp_path, varname="second")
    both = give_uv(give_uv(add_quad(stage, "/World/both", material), [(0.9, 0.9)] * 4), name="second")
    assert both
    for k, name in enumerate(("UVMap", "some_uv")):
        quad = give_uv(add_quad(stage, f"/World/{name}", material), name=name)
        quad.AddTranslateOp().Set(Gf.Vec3d(10 * (k + 1), 0, 0))
    arrays = read(stage)
    for shift in (0, 10, 20):
        check_corners(arrays, device, {(x + shift, y): c for (x, y), c in CORNERS.items()})


def test_mesh_without_coordinates_has_the_mean(device: str, tmp_path: Path) -> None:
    stage, material = textured(tmp_path)
    add_quad(stage, "/World/first", material)
    add_quad(stage, "/World/second", material, x=10)
    give_uv(add_quad(stage, "/World/third", material, x=20))
    arrays = read(stage)
    (note,) = arrays.look_notes
    assert "/World/Looks/four" in note and "/World/first" in note and "mean" in note
    check_corners(arrays, device, dict.fromkeys([*CORNERS, (10.5, 0.5)], (0.5, 0.5, 0.5)))
    check_corners(arrays, device, {(x + 20, y): c for (x, y), c in CORNERS.items()})


def test_footprint_grows_with_distance(device: str, tmp_path: Path) -> None:
    """Fine stripes: from near, from so far that a pixel covers many, and at a slant that covers many along it."""
    stage = stage_in(tmp_path)
    material, shader = preview(stage, "/World/Looks/stripes")
    codes = np.repeat(np.repeat(np.where(np.arange(64) % 2, 255, 0)[None], 64, axis=0)[..., None], 3, axis=2)
    Image.fromarray(codes.astype(np.uint8)).save(tmp_path / "stripes.png")
    connect(stage, shader, "diffuseColor", "stripes.png", sourceColorSpace="raw", wrapS="repeat", wrapT="repeat")
    give_uv(add_quad(stage, "/World/quad", material))
    arrays = read(stage)
    x = (2 * np.arange(20) + 1) / 64 + 0.5  # middles of stripes
    near = TracedPoints(arrays, device, [(v, 1.0, 0.5) for v in x], (0, 0, -1), spread=1e-3)
    assert near.color[:, 0].std() > 0.45
    far = TracedPoints(arrays, device, [(v, 1.0, 400.0) for v in x], (0, 0, -1), spread=1e-3)
    np.testing.assert_allclose(far.color[:, 0], 0.5, atol=0.01)
    down = np.array([0.0, 1.0, -0.1])  # along the stripes
    slant = TracedPoints(arrays, device, [(v, 1.0, 0.0) - 10.0 * down for v in x], down, spread=1e-3)
    assert slant.color[:, 0].std() > 0.4
    down = np.array([1.0, 0.0, -0.1])  # across them: a pixel covers 10 mm / 0.1, three stripes
    slant = TracedPoints(arrays, device, [(v, 1.0, 0.0) - 10.0 * down for v in x], down, spread=1e-2)
    np.testing.assert_allclose(slant.color[:, 0], 0.5, atol=0.1)


def ellipsoid(axes, rings: int = 24) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points, outward normals of the unit sphere at them, and triangles."""
    theta, phi = np.meshgrid(np.linspace(0.1, np.pi - 0.1, rings), np.linspace(0, 2 * np.pi, 2 * rings, endpoint=False))
    ball = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(2 * rings), np.arange(rings - 1), indexing="ij")
    a, b = i * rings + j, ((i + 1) % (2 * rings)) * rings + j
    faces = np.concatenate([np.stack([a, a + 1, b], -1).reshape(-1, 3), np.stack([b, a + 1, b + 1], -1).reshape(-1, 3)])
    return ball * axes, ball, faces


@pytest.mark.parametrize("scale", [(1.0, 1.0, 1.0), (3.0, 1.0, 0.5), (-2.0, 1.0, 1.0)])
@pytest.mark.parametrize("name", ["normals", "primvars:normals"])
def test_normals_of_a_stretched_ball(device: str, tmp_path: Path, scale, name: str) -> None:
    """Normals of a sphere whose prim is scaled: those of the ellipsoid, x / a^2, in closed form."""
    stage = stage_in(tmp_path)
    material, _ = preview(stage, "/World/Looks/plain")
    points, normals, faces = ellipsoid((1.0, 1.0, 1.0))
    mesh = add_polygons(stage, "/World/ball", points, faces.tolist(), material)
    values = [Gf.Vec3f(*map(float, v)) for v in normals]
    if name == "normals":
        mesh.CreateNormalsAttr(values)
        mesh.SetNormalsInterpolation("vertex")
    else:
        UsdGeom.PrimvarsAPI(mesh).CreatePrimvar("normals", mesh.GetNormalsAttr().GetTypeName(), "vertex").Set(values)
    mesh.AddScaleOp().Set(Gf.Vec3f(*scale))
    rng = np.random.default_rng(2)
    target = rng.normal(size=(200, 3)) * 0.2
    direction = rng.normal(size=(200, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    points_hit = TracedPoints(read(stage), device, target - 20.0 * direction, direction)
    exact = np.where(points_hit.material[:, None] >= 0, points_hit.point / np.square(scale), 1.0)
    exact /= np.linalg.norm(exact, axis=1, keepdims=True)
    facing = (exact * direction).sum(axis=1) < -0.2  # nearer the rim normals are bent towards the viewer
    facing &= points_hit.material >= 0
    assert facing.sum() > 80
    angle = np.arccos(np.clip((points_hit.shading_normal * exact).sum(axis=1), -1, 1))[facing]
    flat = np.arccos(np.clip((points_hit.surface_point["normal"] * exact).sum(axis=1), -1, 1))[facing]
    assert angle.max() < 0.02  # the facets are up to that far from the ellipsoid; a wrong rule misses by 0.5
    assert flat.mean() > 5 * angle.mean()
    np.testing.assert_allclose(points_hit.surface_point["normal"], points_hit.normal, atol=1e-5)
    hit = points_hit.material >= 0
    assert hit.mean() > 0.8
    assert ((points_hit.surface_point["normal"] * points_hit.direction).sum(axis=1) < 0)[hit].all()
    assert ((points_hit.shading_normal * points_hit.direction).sum(axis=1) < 0)[hit].all()
    assert ((points_hit.shading_normal * points_hit.surface_point["normal"]).sum(axis=1) > 0)[hit].all()
    np.testing.assert_allclose(np.linalg.norm(points_hit.shading_normal, axis=1)[hit], 1.0, atol=1e-5)


def test_normals_written_inside_out_and_back_sides(device: str, tmp_path: Path) -> None:
    stage = stage_in(tmp_path)
    material, _ = preview(stage, "/World/Looks/plain")
    mesh = add_quad(stage, "/World/quad", material)
    mesh.CreateNormalsAttr([Gf.Vec3f(0.6, 0.0, -0.8)] * 4)
    mesh.SetNormalsInterpolation("vertex")
    arrays = read(stage)
    top = TracedPoints(arrays, device, [(1, 1.2, 5)], (0, 0, -1))
    np.testing.assert_allclose(top.shading_normal[0], (-0.6, 0.0, 0.8), atol=1e-5)
    below = TracedPoints(arrays, device, [(1, 1.2, -5)], (0, 0, 1))
    np.testing.assert_allclose(below.shading_normal[0], (0.6, 0.0, -0.8), atol=1e-5)
    np.testing.assert_allclose(below.surface_point["normal"][0], (0.0, 0.0, -1.0), atol=1e-6)


def test_normal_map(device: str, tmp_path: Path) -> None:
    """A map that leans towards +u leans along +x on a quad whose u runs along x, and along +y after a quarter turn."""
    stage = stage_in(tmp_path)
    lean = np.rint(np.array([0.6, 0.0, 0.8]) * 127.5 + 127.5).astype(np.uint8)
    Image.fromarray(np.tile(lean, (4, 4, 1))).save(tmp_path / "normal.png")
    options = {"sourceColorSpace": "raw", "scale": (2, 2, 2, 1), "bias": (-1, -1, -1, 0)}
    straight, shader = preview(stage, "/World/Looks/straight")
    connect(stage, shader, "normal", "normal.png", **options)
    turned, shader = preview(stage, "/World/Looks/turned")
    connect(stage, shader, "normal", "normal.png", transforms=[{"rotation": -90.0}], **options)
    give_uv(add_quad(stage, "/World/a", straight))
    give_uv(add_quad(stage, "/World/b", turned, x=10))
    mirrored = add_quad(stage, "/World/c", straight, x=20)
    give_uv(mirrored, [(1, 0), (0, 0), (0, 1), (1, 1)])
    points_hit = TracedPoints(read(stage), device, above([(0.9, 0.7), (10.9, 0.7), (20.9, 0.7)]), (0, 0, -1))
    np.testing.assert_allclose(points_hit.shading_normal, [(0.6, 0, 0.8), (0, 0.6, 0.8), (-0.6, 0, 0.8)], atol=0.006)


def test_numbers_from_channels(device: str, tmp_path: Path) -> None:
    stage = stage_in(tmp_path)
    material, shader = preview(stage, "/World/Looks/orm")
    Image.fromarray(np.full((2, 2, 4), (51, 102, 204, 153), dtype=np.uint8)).save(tmp_path / "orm.png")
    for name, output in (("roughness", "g"), ("metallic", "b"), ("emissiveColor", "rgb"), ("opacity", "a")):
        connect(stage, shader, name, "orm.png", output=output, sourceColorSpace="raw")
    give_uv(add_quad(stage, "/World/quad", material))
    points_hit = TracedPoints(read(stage), device, above([(0.9, 0.7)]), (0, 0, -1))
    assert points_hit.roughness[0] == pytest.approx(0.4, abs=1e-3)
    assert points_hit.metallic[0] == pytest.approx(0.8, abs=1e-3)
    np.testing.assert_allclose(points_hit.emission[0], (0.2, 0.4, 0.8), atol=1e-3)
    assert not points_hit.is_hole[0]


def test_holes_of_an_opacity_texture(device: str, tmp_path: Path) -> None:
    stage = stage_in(tmp_path)
    material, shader = preview(stage, "/World/Looks/leaf", {"opacityThreshold": 0.3})
    codes = np.full((8, 8, 4), 255, dtype=np.uint8)
    codes[:, :4, 3] = 0  # the left half is a hole
    Image.fromarray(codes).save(tmp_path / "leaf.png")
    connect(stage, shader, "opacity", "leaf.png", output="a", wrapS="clamp", wrapT="clamp")
    give_uv(add_quad(stage, "/World/quad", material))
    points_hit = TracedPoints(read(stage), device, above(CORNERS), (0, 0, -1))
    assert points_hit.is_hole.tolist() == [True, False, True, False]
    np.testing.assert_array_equal(points_hit.opacity, 1.0)


def test_faces_without_area_make_no_nan(device: str, tmp_path: Path) -> None:
    """Slivers and points among good faces, with coordinates that span nothing, and normals of length zero."""
    stage, material = textured(tmp_path)
    points = np.array([(0, 0, 0), (2, 0, 0), (2, 2, 0), (0, 2, 0), (1, 0, 0), (1, 1e-7, 0)], dtype=float)
    mesh = add_polygons(stage, "/World/bad", points, [[0, 1, 2, 3], [0, 4, 1], [0, 0, 0], [0, 5, 1]], material)
    give_uv(mesh, [(0.2, 0.2)] * 6)
    mesh.CreateNormalsAttr([Gf.Vec3f(0, 0, 0)] * 6)
    mesh.SetNormalsInterpolation("vertex")
    rng = np.random.default_rng(0)
    at = np.concatenate([rng.random((300, 2)) * 2, np.stack([rng.random(300) * 2, np.zeros(300)], axis=1)])
    points_hit = TracedPoints(read(stage), device, above(at), (0.01, 0.02, -1))
    hit = points_hit.material >= 0
    assert hit.sum() > 300
    for name in ("color", "roughness", "shading_normal", "normal"):
        assert np.isfinite(points_hit.surface_point[name][hit]).all(), name
    np.testing.assert_allclose(points_hit.color[hit], np.tile(RED, (hit.sum(), 1)), atol=1e-3)
