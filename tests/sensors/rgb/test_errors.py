"""Bad input of the RGB camera, from the stage to the picture: handled and named, never silently.

Parts are tested with bad input elsewhere: shader nodes that are not read (`tests/usd/test_materials.py`), formats,
corrupt and huge textures (`tests/kernels/test_texture.py`), coordinates and faces without area
(`tests/kernels/test_surface_point.py`), wrong keys of the section (`tests/sensors/test_errors.py`).
"""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pxr import Gf, Usd, UsdShade

from mmw.physics.weather.weather import Weather
from mmw.scene.device_scene import DeviceScene
from mmw.scene.reader import read_stage
from mmw.sensors.render.projection import intrinsics_of
from mmw.sensors.render.visibility_buffer import trace_samples
from mmw.sensors.rgb.simulate import RgbRenderer
from tests.fixtures.material_stages import KINDS, add_quad, connect, give_uv, preview, stage_in
from tests.fixtures.rgb_scenes import SMALL, Rendering, at, even_sky, lambert, on_ground, render
from tests.fixtures.scenes import arrays_from_parts, box_model, box_part, ground_part, pose
from tests.fixtures.stages import add_polygons

ABOVE = (1.0, 1.0, 3.0, 90.0, 90.0, 0.0)
"""Over the middle of the square from (0, 0) to (2, 2), looking down."""
FALLBACK = (0.3, 0.6, 0.2)


def picture_of(stage: Usd.Stage, folder: Path, device: str, **options) -> Rendering:
    """Return a rendering of a stage from above, under an even sky of 1 kcd/m2."""
    stage.Save()
    arrays = read_stage(folder / "stage.usda", range(1), ["sunny"])
    return render(arrays, device, at(ABOVE), sky=even_sky(device, 1.0), **options)


def textured(folder: Path, file: str, *, with_uv: bool = True) -> tuple[Usd.Stage, UsdShade.Shader]:
    """Return a stage with a Lambert square whose color is a texture file, with a fallback."""
    stage = stage_in(folder)
    material, shader = preview(stage, "/World/Looks/picture", {"ior": 1.0, "roughness": 1.0})
    connect(stage, shader, "diffuseColor", file, fallback=(*FALLBACK, 1.0))
    quad = add_quad(stage, "/World/quad", material)
    if with_uv:
        give_uv(quad)
    return stage, shader


@pytest.mark.parametrize("debug", [False, True])
def test_missing_texture_is_noted_once_and_drawn_as_its_fallback(device: str, tmp_path: Path, debug: bool) -> None:
    """Two squares and three weathers share one texture that is not there: one note; magenta in debug."""
    stage, shader = textured(tmp_path, "gone.png")
    material = UsdShade.Material.Get(stage, shader.GetPath().GetParentPath())
    give_uv(add_quad(stage, "/World/second", material, x=3))
    rendering = picture_of(stage, tmp_path, device, debug=debug)
    (note,) = rendering.camera.notes
    for text in ("/World/Looks/picture", "gone.png", "not there", "magenta" if debug else "fallback"):
        assert text in note
    expected = (1.0, 0.0, 1.0) if debug else FALLBACK
    np.testing.assert_allclose(
        rendering.one()[20:28, 28:36], np.broadcast_to(expected, (8, 8, 3)), rtol=0.01, atol=1e-3
    )


def test_missing_texture_without_fallback_is_not_magenta(device: str, tmp_path: Path) -> None:
    stage = stage_in(tmp_path)
    material, shader = preview(stage, "/World/Looks/picture", {"ior": 1.0})
    connect(stage, shader, "diffuseColor", "gone.png")
    give_uv(add_quad(stage, "/World/quad", material))
    middle = picture_of(stage, tmp_path, device).one()[24, 32]
    assert np.ptp(middle) < 1e-3 and middle.max() <= 1.0


def test_huge_texture_is_made_smaller_and_noted(device: str, tmp_path: Path) -> None:
    codes = np.zeros((1000, 4500, 3), dtype=np.uint8)
    codes[:500, :2250], codes[500:, 2250:] = (188, 0, 0), (0, 188, 0)
    Image.fromarray(codes).save(tmp_path / "wide.png")
    stage, _ = textured(tmp_path, "wide.png")
    rendering = picture_of(stage, tmp_path, device)
    (note,) = rendering.camera.notes
    for text in ("/World/Looks/picture", "wide.png", "4500 x 1000", "2048 x 455"):
        assert text in note
    image, half = rendering.one(), ((188 / 255 + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(image[14, 22], (half, 0.0, 0.0), atol=0.01)  # the upper left of the picture
    np.testing.assert_allclose(image[34, 42], (0.0, half, 0.0), atol=0.01)


def test_unsupported_shader_node_is_named_and_the_rest_is_drawn(device: str, tmp_path: Path) -> None:
    stage = stage_in(tmp_path)
    given = {"diffuseColor": Gf.Vec3f(*FALLBACK), "ior": 1.0, "roughness": 1.0}
    material, shader = preview(stage, "/World/Looks/odd", given)
    node = UsdShade.Shader.Define(stage, "/World/Looks/odd/Noise")
    node.CreateIdAttr("ND_fractal3d_color3")
    shader.GetInput("diffuseColor").ConnectToSource(node.CreateOutput("out", KINDS.Color3f))
    add_quad(stage, "/World/quad", material)
    rendering = picture_of(stage, tmp_path, device)
    (note,) = rendering.scene.arrays.look_notes
    assert "ND_fractal3d_color3" in note and "/World/Looks/odd/Noise" in note
    np.testing.assert_allclose(rendering.one()[24, 32], FALLBACK, rtol=0.01)


def test_faces_without_area_are_no_trouble(device: str, tmp_path: Path) -> None:
    """A textured square with a needle, a point and a folded face over it: the picture is that of the square."""
    Image.fromarray(np.full((4, 4, 3), 255, dtype=np.uint8)).save(tmp_path / "white.png")
    stage, shader = textured(tmp_path, "white.png")
    material = UsdShade.Material.Get(stage, shader.GetPath().GetParentPath())
    plain = picture_of(stage, tmp_path, device).one()
    points = [(0.2, 0.2, 0.5), (1.8, 1.8, 0.5), (1.0, 1.0, 0.5), (0.5, 1.5, 0.5)]
    mesh = add_polygons(stage, "/World/needles", np.array(points), [[0, 1, 2], [3, 3, 3], [0, 1, 0]], material)
    give_uv(mesh, [(0, 0), (1, 1), (0.5, 0.5), (0, 1)])
    rendering = picture_of(stage, tmp_path, device)
    np.testing.assert_allclose(rendering.one(), plain, atol=2e-3)
    assert np.isfinite(rendering.camera.normals(rendering.buffer).numpy()).all()


def test_empty_scene_is_all_sky(device: str) -> None:
    """Radiance of a real sky, a picture, no normals, no flow, no depth."""
    empty = arrays_from_parts([], materials={"m": lambert(0.5)})
    rendering = render(empty, device, at((0.0, 0.0, 2.0, 30.0, -20.0, 0.0)))
    image = rendering.one()
    assert image.min() > 0.1 and image[0, :, 2].min() > image[0, :, 0].max()  # blue at the top
    assert (rendering.objects() == -1).all() and not rendering.depth().depth.numpy().any()
    assert not rendering.camera.normals(rendering.buffer).numpy().any()
    assert not rendering.camera.flow(rendering.buffer).numpy().any()
    assert rendering.rgb()["sunny"].shape == (1, 48, 64, 3)


def test_scene_without_materials_is_all_sky(device: str) -> None:
    image = render(arrays_from_parts([]), device, at((0.0, 0.0, 2.0)), sky=even_sky(device, 0.7)).one()
    np.testing.assert_allclose(image, 0.7, rtol=1e-3)


def test_no_views_make_no_pictures(device: str) -> None:
    rendering = render(on_ground(), device, at((0.0, 0.0, 2.0)).take(slice(0)))
    assert rendering.light()["sunny"].shape == (0, 48, 64, 3)
    assert rendering.rgb()["sunny"].shape == (0, 48, 64, 3)
    assert rendering.camera.normals(rendering.buffer).shape == (0, 48, 64)
    assert rendering.camera.flow(rendering.buffer).shape == (0, 48, 64)


def test_frame_that_is_not_loaded(device: str) -> None:
    poses = np.array([[pose(0.0, 0.0)], [pose(1.0, 0.0)]])
    arrays = arrays_from_parts([ground_part()], [box_model("car")], [("veh_001", "vehicle", 0)], poses)
    scene = DeviceScene(arrays, device, 1)
    scene.load_batch([0])
    camera = RgbRenderer(scene, {"sunny": Weather()})
    with pytest.raises(ValueError, match=r"frame 1 at batch index 0; the scene holds frames \[0\]"):
        trace_samples(scene, at((0.0, 0.0, 2.0), frame=1), intrinsics_of(SMALL), 100.0, camera.alpha_cutouts)


def test_view_inside_a_solid(device: str) -> None:
    """A camera in a closed box sees its walls from within: dark, finite, and everywhere a surface."""
    room = box_part("Buildings/room", (4.0, 4.0, 4.0), (0.0, 0.0, 0.0), "m", "building")
    arrays = arrays_from_parts([room], materials={"m": lambert(0.5)})
    noon = Weather(cloudiness=0.0)
    rendering = render(arrays, device, at((0.0, 0.0, 0.0, 20.0, 10.0, 0.0)), weathers={"sunny": noon})
    assert (rendering.objects() >= 0).all()
    inside = rendering.one()
    outside = render(arrays, device, at((-8.0, 0.0, 5.0, 0.0, 25.0, 0.0)), weathers={"sunny": noon}).one()
    # Nothing lights a closed room but the share of `SHADED_GROUND` that stands for light from all that hides the sky.
    assert inside.max() < 0.3 * outside.max()
    normals = rendering.camera.normals(rendering.buffer).numpy()[0]
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, atol=1e-4)


def test_tiny_range_sees_the_sky(device: str) -> None:
    """Surfaces beyond `range_m` are sky, and nearer ones are not; the sky is that of any range."""
    arrays = arrays_from_parts(
        [box_part("Buildings/wall", (1.0, 40.0, 40.0), (5.5, 0.0, 0.0), "m", "building")], materials={"m": lambert(0.0)}
    )
    for range_m, expected in ((0.001, 2.0), (4.9, 2.0), (5.1, 0.0)):
        config = SMALL.model_copy(update={"range_m": range_m})
        image = render(arrays, device, at((0.0, 0.0, 0.0)), config=config, sky=even_sky(device, 2.0)).one()
        np.testing.assert_allclose(image, expected, atol=2e-3)


def test_absent_actor_is_not_drawn(device: str) -> None:
    """A vehicle without a pose in a frame leaves ground, no shadow and no lamp there."""
    poses = np.array([[pose(6.0, 0.0)], [(np.nan,) * 7], [pose(6.0, 0.0)]])
    arrays = on_ground(models=[box_model("car")], actors=[("veh_001", "vehicle", 0)], poses=poses)
    place, dusk = (0.0, 0.0, 2.0, 0.0, 10.0, 0.0), {"sunny": Weather(sun_altitude_deg=-20.0)}
    rendering = render(arrays, device, at(place, place, frame=(1, 0)), weathers=dusk)
    objects = rendering.objects()
    number = arrays.actors[0].object_id
    assert not (objects[0] == number).any() and (objects[1] == number).any()
    empty = render(on_ground(), device, at(place), weathers=dusk).one()
    np.testing.assert_array_equal(rendering.light()["sunny"][0], empty)
