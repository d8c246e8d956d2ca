"""Geometry of RGB pictures: where points land, textures, edges, holes, normals; equal bytes whatever the batch."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from PIL import Image

from mmw.config.lens import LensConfig
from mmw.core.transforms import invert, pose_from_mount, rotate, transform_points
from mmw.physics.materials.appearance import TextureUse
from mmw.physics.weather.weather import PRESETS, Weather
from mmw.scene.reader import read_stage
from mmw.scene.scene_data import SceneData
from mmw.sensors.render import visibility_buffer
from mmw.sensors.render.projection import intrinsics_of, project, unproject
from mmw.sensors.render.sky.sky import sun_direction
from mmw.worlds.towns.mesh_part import MeshPart
from tests.fixtures.material_stages import add_quad, connect, give_uv, preview, stage_in
from tests.fixtures.rgb_scenes import SMALL, Rendering, at, even_sky, glowing, lambert, matter, on_ground, render
from tests.fixtures.scenes import arrays_from_parts, box_model, box_part, ground_part, pose, quad_part, street_canyon

MOUNT = (12.0, -7.0, 3.0, 40.0, -10.0, 5.0)
"""Place [m], yaw, pitch and roll [deg] of a camera that looks nowhere in particular."""
LENSES = {
    "pinhole": SMALL.model_copy(update={"fov_deg": 90.0}),
    "brown_conrady": SMALL.model_copy(
        update={"fov_deg": 80.0, "lens": LensConfig(model="brown_conrady", k1=-0.2, k2=0.03, p1=0.002, p2=-0.001)}
    ),
    "fisheye": SMALL.model_copy(update={"fov_deg": 170.0, "lens": LensConfig(model="fisheye", k1=0.02, k2=-0.003)}),
}
DOWN_NORTH_UP = (90.0, 90.0, 0.0)
"""Yaw, pitch and roll [deg] of a camera that looks down with north at its upper edge, like a map."""


def facing_square(center: np.ndarray, eye: np.ndarray, half: float, turn: float) -> np.ndarray:
    """Return the corners of a square about a point that faces an eye, turned about the line of sight [4, 3]."""
    back = (eye - center) / np.linalg.norm(eye - center)
    across = np.cross((0.0, 0.0, 1.0), back)
    across /= np.linalg.norm(across)
    up = np.cross(back, across)
    angles = turn + np.radians([45.0, 135.0, 225.0, 315.0])
    return center + math.sqrt(2.0) * half * (np.cos(angles)[:, None] * across + np.sin(angles)[:, None] * up)


def middle_of(outline: np.ndarray) -> tuple[np.ndarray, float]:
    """Return centroid and area of a polygon, by the shoelace formula."""
    after = np.roll(outline, -1, axis=0)
    cross = outline[:, 0] * after[:, 1] - outline[:, 1] * after[:, 0]
    return ((outline + after) * cross[:, None]).sum(axis=0) / (3.0 * cross.sum()), abs(cross.sum()) / 2.0


@pytest.mark.parametrize("name", LENSES)
def test_known_points_land_where_the_projection_says(device: str, name: str) -> None:
    """Five bright squares in space: the middles of their pictures lie within 0.1 px of those of the areas that the
    projected points of their outlines enclose."""
    config = LENSES[name].model_copy(update={"samples": 9})
    lens, eye = intrinsics_of(config), pose_from_mount(MOUNT[:3], *MOUNT[3:])
    pixels = np.array([(10.3, 9.1), (53.6, 8.2), (31.8, 24.4), (11.2, 39.4), (54.1, 38.7)])
    if name == "fisheye":
        pixels = (pixels - (32.0, 24.0)) * (0.9, 0.9) + (32.0, 24.0)
    distance = np.array([10.0, 25.0, 60.0, 15.0, 40.0])
    points = transform_points(eye, unproject(lens, pixels) * distance[:, None])
    squares = [facing_square(point, eye[:3], 2.5 * distance[k] / lens.fx, 0.35 + k) for k, point in enumerate(points)]
    parts = [quad_part(f"Props/p{k}", corners, "glow", "static") for k, corners in enumerate(squares)]
    arrays = arrays_from_parts(parts, materials={"glow": glowing()})
    image = render(arrays, device, at(MOUNT), config=config, sky=even_sky(device, 0.0)).one()[..., 1].astype(float)
    v, u = np.mgrid[: config.height_px, : config.width_px] + 0.5
    for corners, point in zip(squares, points, strict=True):
        share = np.arange(16)[:, None] / 16.0
        outline = np.concatenate([a + share * (b - a) for a, b in zip(corners, np.roll(corners, -1, 0), strict=True)])
        place, area = middle_of(project(lens, transform_points(invert(eye), outline)))
        straight = project(lens, transform_points(invert(eye), point))
        assert np.abs(place - straight).max() < 0.5  # perspective: the middle of an area is not that of the square
        near = (np.abs(u - place[0]) < 9.0) & (np.abs(v - place[1]) < 9.0)
        light = image[near]
        assert light.sum() == pytest.approx(area, rel=0.05)
        middle = np.array([np.average(u[near], weights=light), np.average(v[near], weights=light)])
        np.testing.assert_allclose(middle, place, atol=0.1)


def test_left_is_left_and_up_is_up(device: str) -> None:
    """A red square to the left of a camera, a green one above and a blue one to the right."""
    arrays, materials = [], {}
    for name, color, y, z in (
        ("red", (1, 0, 0), 3.0, 0.0),
        ("green", (0, 1, 0), 0.0, 3.0),
        ("blue", (0, 0, 1), -3.0, 0.0),
    ):
        corners = facing_square(np.array([10.0, y, z]), np.zeros(3), 0.7, 0.0)
        arrays.append(quad_part(f"Props/{name}", corners, name, "static"))
        materials[name] = glowing(color, name)
    scene = arrays_from_parts(arrays, materials=materials)
    image = render(scene, device, at((0.0, 0.0, 0.0)), sky=even_sky(device, 0.0)).one()
    v, u = np.mgrid[:48, :64] + 0.5
    middle = [(np.average(u, weights=image[..., k]), np.average(v, weights=image[..., k])) for k in range(3)]
    assert middle[0][0] < 20.0 and middle[2][0] > 44.0 and middle[1][1] < 12.0
    assert [round(m[1]) for m in (middle[0], middle[2])] == [24, 24] and round(middle[1][0]) == 32


CODES = {
    "bottom left": (188, 64, 20),
    "bottom right": (20, 188, 64),
    "top left": (64, 20, 188),
    "top right": (250, 120, 5),
}
"""sRGB codes of the four corners of a texture."""


def linear(codes) -> np.ndarray:
    """Return linear values of 8-bit sRGB codes, by IEC 61966-2-1."""
    c = np.asarray(codes) / 255.0
    return np.where(c <= 0.04045, c / 12.92, ((c + 0.055) / 1.055) ** 2.4)


def textured_quad(folder: Path, codes: np.ndarray, **inputs) -> SceneData:
    """Return a square from (0, 0) to (2, 2) that faces up, from a stage, with st (0, 0) at (0, 0)."""
    Image.fromarray(codes.astype(np.uint8)).save(folder / "picture.png")
    stage = stage_in(folder)
    material, shader = preview(stage, "/World/Looks/picture", {"ior": 1.0, "roughness": 1.0})
    connect(stage, shader, "diffuseColor", "picture.png", wrapS="clamp", wrapT="clamp", **inputs)
    give_uv(add_quad(stage, "/World/quad", material))
    stage.Save()
    return read_stage(folder / "stage.usda", range(1), ["sunny"])


def test_texture_from_a_stage_is_upright_and_decoded(device: str, tmp_path: Path) -> None:
    """Seen from above with north up, the picture is the image of the file, in linear light."""
    codes = np.zeros((16, 16, 3))
    for name, code in CODES.items():
        rows = slice(0, 8) if name.startswith("top") else slice(8, 16)
        columns = slice(0, 8) if name.endswith("left") else slice(8, 16)
        codes[rows, columns] = code
    arrays = textured_quad(tmp_path, codes)
    config = SMALL.model_copy(update={"width_px": 48, "height_px": 48, "fov_deg": math.degrees(2.0 * math.atan(0.1))})
    image = render(arrays, device, at((1.0, 1.0, 10.0, *DOWN_NORTH_UP)), config=config, sky=even_sky(device, 2.0)).one()
    for name, code in CODES.items():
        row, column = 12 if name.startswith("top") else 36, 12 if name.endswith("left") else 36
        found = image[row - 6 : row + 6, column - 6 : column + 6]
        np.testing.assert_allclose(found, np.broadcast_to(2.0 * linear(code), found.shape), rtol=0.005)


@pytest.mark.parametrize("azimuth_deg", [0.0, 90.0, 180.0, 270.0, 30.0])
def test_normal_map_turns_towards_its_light(device: str, tmp_path: Path, azimuth_deg: float) -> None:
    """A map whose normals lean to growing u (east) and a little to growing v (north) is lit as such a slope."""
    lean = np.array([0.6, 0.25, math.sqrt(1.0 - 0.6**2 - 0.25**2)])
    codes = np.round((lean + 1.0) / 2.0 * 255.0)
    normal = codes / 255.0 * 2.0 - 1.0
    normal /= np.linalg.norm(normal)
    Image.fromarray(np.full((4, 4, 3), codes).astype(np.uint8)).save(tmp_path / "normal.png")
    stage = stage_in(tmp_path)
    material, shader = preview(stage, "/World/Looks/bent", {"ior": 1.0, "roughness": 1.0})
    connect(stage, shader, "normal", "normal.png", sourceColorSpace="raw", scale=(2, 2, 2, 1), bias=(-1, -1, -1, 0))
    give_uv(add_quad(stage, "/World/quad", material))
    stage.Save()
    arrays = read_stage(tmp_path / "stage.usda", range(1), ["sunny"])
    sun = Weather(sun_altitude_deg=35.0, sun_azimuth_deg=azimuth_deg)
    sky = even_sky(device, 0.0, sun=sun, klux=100.0)
    image = render(arrays, device, at((1.0, 1.0, 5.0, *DOWN_NORTH_UP)), sky=sky).one()
    cosine = max(float(normal @ sun_direction(sun)), 0.0)
    assert image[24, 32, 1] == pytest.approx(0.18 * 100.0 / math.pi * cosine, rel=0.01, abs=0.01)


VIEW = at((0.0, 0.0, 0.0))
"""From the origin along x."""


def half_plane(slope: float, offset: float) -> SceneData:
    """Return a shining wall at x = 10 that covers z < slope y + offset."""
    along = np.array([0.0, 1.0, slope]) / math.hypot(1.0, slope)
    below = np.array([0.0, slope, -1.0]) / math.hypot(1.0, slope)
    start = np.array([10.0, 0.0, offset])
    corners = [start + 60.0 * along + 60.0 * below, start - 60.0 * along + 60.0 * below, start - 60.0 * along,
               start + 60.0 * along]  # fmt: skip
    return arrays_from_parts([quad_part("Props/wall", corners, "glow", "static")], materials={"glow": glowing()})


def coverage(slope: float, offset: float) -> np.ndarray:
    """Return the share of every pixel that the wall covers, from 64 x 64 points in each."""
    lens = intrinsics_of(SMALL)
    v, u = ((np.arange(n * 64) + 0.5) / 64.0 for n in (lens.height, lens.width))
    z, y = (lens.cy - v) / lens.fy * 10.0, (lens.cx - u) / lens.fx * 10.0
    return (z[:, None] < slope * y + offset).reshape(lens.height, 64, lens.width, 64).mean(axis=(1, 3))


def test_pixels_on_an_edge_follow_what_it_covers(device: str) -> None:
    """More samples, less error against the covered area; edges nearly level and nearly upright are smooth too."""
    for slope in (0.05, 0.37, 1.0, -3.0, -21.0):
        errors: dict[int, list[np.ndarray]] = {1: [], 4: [], 9: []}
        for shift in np.arange(5) / 5.0:  # of a pixel
            offset = shift * 10.0 / intrinsics_of(SMALL).fx * math.hypot(1.0, slope)
            expected = coverage(slope, offset)
            edge = (expected > 0.0) & (expected < 1.0)
            for samples, off in errors.items():
                config = SMALL.model_copy(update={"samples": samples})
                rendering = render(half_plane(slope, offset), device, VIEW, config=config, sky=even_sky(device, 0.0))
                found = rendering.one()[..., 1]
                np.testing.assert_allclose(found[~edge], expected[~edge], atol=1e-6)
                off.append((found - expected)[edge])
        one, four, nine = (float(np.abs(np.concatenate(errors[k])).mean()) for k in (1, 4, 9))
        assert one > 0.15 and four < 0.11 and four < 0.6 * one and nine < 0.06, slope
        assert abs(np.concatenate(errors[4]).mean()) < 0.05 and abs(np.concatenate(errors[9]).mean()) < 0.02, slope


WEATHERS = {name: PRESETS[name] for name in ("sunny", "rainy", "foggy")}


def street(device: str, views, names: tuple[str, ...]) -> Rendering:
    """Return a street of glass and marble with cars, seen in some weathers."""
    model = box_model("car", material=3)
    rows = np.array([[pose(-10.0 + 0.2 * k, -3.0), pose(-16.0, 4.0)] for k in range(4)])
    arrays = street_canyon([model], [("veh_001", "vehicle", 0), ("veh_002", "vehicle", 0)], rows)
    appearances = {
        "asphalt": matter("asphalt", "asphalt", color=(0.1, 0.1, 0.1), roughness=0.9),
        "window_glass": matter("window_glass", "clear_glass", color=(0.05, 0.06, 0.06), opacity=0.3, roughness=0.02),
        "car_paint_red": matter("car_paint_red", "steel", color=(0.5, 0.02, 0.02), clearcoat=1.0),
    }
    materials = tuple(appearances.get(m.name, m) for m in arrays.materials["sunny"])
    arrays = replace(arrays, materials=dict.fromkeys(names, materials))
    return render(arrays, device, views, weathers={name: WEATHERS[name] for name in names})


PLACES = [(-30.0, -6.0, 2.0, 8.0, 3.0, 0.0), (-20.0, 0.0, 1.5, 60.0, 0.0, 0.0), (0.0, 0.0, 6.0, 180.0, 15.0, 0.0)]


def test_bytes_depend_neither_on_batch_nor_on_other_weathers(device: str) -> None:
    """Views alone and together, in one weather and in three, have equal light and equal pictures."""
    views = at(*PLACES, frame=(0, 1, 3))
    whole = street(device, views, tuple(WEATHERS))
    light = whole.light()
    for name in WEATHERS:
        assert len({light[name][k].tobytes() for k in range(3)}) == 3
        alone = street(device, views, (name,))
        np.testing.assert_array_equal(alone.light()[name], light[name])
        np.testing.assert_array_equal(alone.rgb()[name], whole.rgb()[name])
    for k in range(3):
        single = replace(views.take([k]), batch_index=np.zeros(1, dtype=np.int32))
        found = street(device, single, tuple(WEATHERS)).light()
        for name in WEATHERS:
            np.testing.assert_array_equal(found[name][0], light[name][k], err_msg=f"{name}, view {k}")
    again = whole.light()
    assert all(np.array_equal(again[name], light[name]) for name in WEATHERS)


def test_samples_that_find_no_room_move(device: str, monkeypatch: pytest.MonkeyPatch) -> None:
    views = at(*PLACES, frame=(0, 1, 3))
    roomy = street(device, views, ("sunny",)).light()["sunny"]
    monkeypatch.setattr(visibility_buffer, "ROOM_FOR_EXTRAS", 0.0)
    np.testing.assert_array_equal(street(device, views, ("sunny",)).light()["sunny"], roomy)


def test_holes_of_a_cut_out_are_passed_by_all_that_is_seen(device: str, tmp_path: Path) -> None:
    """A pane whose left half an alpha texture cuts away: color, depth and objects show the wall behind there."""
    codes = np.zeros((16, 16, 4), dtype=np.uint8)
    codes[:, 8:, 3] = 255
    Image.fromarray(codes).save(tmp_path / "mask.png")
    use = TextureUse(str(tmp_path / "mask.png"), channel=3, wrap=("clamp", "clamp"))
    leaf = matter(
        "leaf", color=(0.0, 0.0, 0.0), ior=1.0, emission=(0.0, 1.0, 0.0), opacity_threshold=0.5, opacity_texture=use
    )
    front = quad_part(
        "Props/leaf", [(5.0, 1.5, -1.0), (5.0, -1.5, -1.0), (5.0, -1.5, 1.0), (5.0, 1.5, 1.0)], "leaf", "static"
    )
    back = quad_part(
        "Props/wall", [(9.0, 9.0, -9.0), (9.0, -9.0, -9.0), (9.0, -9.0, 9.0), (9.0, 9.0, 9.0)], "glow", "static"
    )
    arrays = arrays_from_parts([front, back], materials={"leaf": leaf, "glow": glowing((1.0, 0.0, 0.0))})
    st = np.array([(0, 0), (1, 0), (1, 1), (0, 1)], dtype=np.float32)
    # `quad_part` splits a quad into (0, 1, 2) and (0, 2, 3) of its corners in the order a, d, b, c of its grid.
    places = arrays.points[arrays.faces[:2]]
    uv = np.zeros((len(arrays.faces), 3, 2), dtype=np.float32)
    uv[:2, :, 0], uv[:2, :, 1] = (1.5 - places[..., 1]) / 3.0, (places[..., 2] + 1.0) / 2.0
    assert {tuple(c) for c in uv[:2].reshape(-1, 2).tolist()} == {tuple(c) for c in st.tolist()}
    config = SMALL.model_copy(update={"fov_deg": 50.0})
    rendering = render(replace(arrays, uv=uv), device, at((0.0, 0.0, 0.0)), config=config, sky=even_sky(device, 0.0))
    image, depth, objects = rendering.one(), rendering.depth().depth_m.numpy()[0], rendering.objects()[0]
    v, u = np.mgrid[:48, :64] + 0.5
    lens = rendering.buffer.intrinsics
    y, z = (lens.cx - u) / lens.fx * 5.0, (lens.cy - v) / lens.fy * 5.0
    on_leaf = (np.abs(y) < 1.5) & (np.abs(z) < 1.0) & (y < 0.0)
    rim = np.minimum.reduce([np.abs(np.abs(y) - 1.5), np.abs(np.abs(z) - 1.0), np.abs(y)]) < 0.15
    leaf_id, wall_id = objects[24, 40], objects[24, 24]
    assert leaf_id != wall_id
    for seen, at_depth, color, number in ((on_leaf, 5.0, (0, 1, 0), leaf_id), (~on_leaf, 9.0, (1, 0, 0), wall_id)):
        where = seen & ~rim
        assert where.sum() > 200
        np.testing.assert_allclose(depth[where], at_depth, rtol=1e-4)
        assert (objects[where] == number).all()
        np.testing.assert_allclose(image[where], np.broadcast_to(color, (where.sum(), 3)), atol=1e-3)


def test_normals_are_those_of_what_is_seen(device: str) -> None:
    """Sensor frame, unit length, towards the camera, zero for the sky; a ball's by geometry."""
    ball = trimesh.creation.icosphere(subdivisions=4, radius=2.0)
    center = np.array([6.0, 0.5, 0.2])
    points, faces = np.array(ball.vertices) + center, np.array(ball.faces, dtype=np.int32)
    parts = [MeshPart("Props/ball", points, faces, "m", "static"), ground_part(30.0, -2.0, "m")]
    arrays = arrays_from_parts(parts, materials={"m": lambert(0.5)})
    corners = np.zeros((len(arrays.faces), 3, 3), dtype=np.float32)
    corners[: len(ball.faces)] = ((arrays.points[arrays.faces[: len(ball.faces)]] - center) / 2.0).astype(np.float32)
    arrays = replace(arrays, normals=corners)
    where = (0.0, 0.0, 0.0, 10.0, 5.0, 20.0)
    rendering = render(arrays, device, at(where))
    normals, objects = rendering.camera.normals(rendering.buffer).numpy()[0], rendering.objects()[0]
    eye = rendering.buffer.views.pose[0]
    assert not normals[objects < 0].any() and (objects < 0).any()
    seen = objects >= 0
    np.testing.assert_allclose(np.linalg.norm(normals[seen], axis=-1), 1.0, atol=1e-5)
    rays = rotate(invert(eye)[3:], rendering.rays)
    assert ((normals * rays).sum(axis=-1)[seen] < 0.0).all()
    level = objects == 1 if rendering.scene.arrays.objects[1].prim_path.endswith("ground") else objects == 0
    np.testing.assert_allclose(rotate(eye[3:], normals[level]), np.broadcast_to((0, 0, 1), (level.sum(), 3)), atol=1e-5)
    on_ball = seen & ~level
    assert on_ball.sum() > 200 and level.sum() > 200
    t = rendering.buffer.samples.t.numpy()[: 48 * 64].reshape(48, 64)
    expected = (rendering.rays * np.where(seen, t, 0.0)[..., None] + eye[:3] - center)[on_ball]
    expected /= np.linalg.norm(expected, axis=-1, keepdims=True)
    cosine = (rotate(eye[3:], normals[on_ball]) * expected).sum(axis=-1)
    assert np.quantile(cosine, 0.02) > math.cos(math.radians(2.0))


def test_flow_of_what_stands_still_is_zero(device: str) -> None:
    box = box_part("Buildings/box", (2.0, 2.0, 2.0), (8.0, 0.0, 1.0), "m", "building")
    rendering = render(on_ground(box, poses=np.zeros((3, 0, 7))), device, at((0.0, 0.0, 2.0), frame=1))
    assert rendering.camera.flow(rendering.buffer).numpy().shape == (1, 48, 64, 2)
    assert np.abs(rendering.camera.flow(rendering.buffer).numpy()).max() < 1e-4
