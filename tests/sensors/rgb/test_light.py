"""Light of the RGB camera against closed forms: furnace, Lambert, panes, shadows of the sun, open sky."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

import math
from dataclasses import replace

import numpy as np
import pytest
import trimesh

from mmw.physics.weather.weather import Weather
from mmw.scene.scene_data import SceneData
from mmw.sensors.render.projection import intrinsics_of, project
from mmw.sensors.render.sky.sky import SUN_RADIUS, bake, sun_direction
from mmw.worlds.towns.mesh_part import MeshPart
from tests.fixtures.rgb_scenes import SMALL, at, even_sky, glowing, lambert, matter, on_ground, render
from tests.fixtures.scenes import arrays_from_parts, box_model, box_part, ground_part, pose, quad_part

WHITE = (1.0, 1.0, 1.0)
DOWN = (0.0, 90.0, 0.0)
"""Yaw, pitch, roll [deg] of a camera that looks down with its upper edge towards the east."""
FURNACE = {
    "lambert": lambert(1.0),
    "dielectric": matter(color=WHITE, ior=1.5, roughness=0.6),
    "glossy dielectric": matter(color=WHITE, ior=1.5, roughness=0.15),
    "rough metal": matter(color=WHITE, metallic=1.0, roughness=0.7),
    "mirror": matter(color=WHITE, metallic=1.0, roughness=0.05),
    "half a metal": matter(color=WHITE, metallic=0.5, roughness=0.4),
    "car paint": matter(color=WHITE, roughness=0.4, clearcoat=1.0, clearcoat_roughness=0.03),
    "pane": matter(color=WHITE, opacity=0.2, roughness=0.02),
}


def sphere_part(center: tuple[float, float, float], radius: float) -> MeshPart:
    """Return a ball of 20,480 flat triangles."""
    ball = trimesh.creation.icosphere(subdivisions=5, radius=radius)
    return MeshPart("Buildings/ball", np.array(ball.vertices) + center, np.array(ball.faces, np.int32), "m", "building")


@pytest.mark.parametrize("name", FURNACE)
def test_white_furnace(device: str, name: str) -> None:
    """A surface that absorbs nothing is invisible under a sky that is the same all round: every pixel is the sky."""
    box = box_part("Buildings/box", (1.0, 1.0, 1.0), (4.0, 0.0, 0.0), "m", "building")
    arrays = arrays_from_parts([box, sphere_part((4.0, 500.0, 0.0), 0.8)], materials={"m": FURNACE[name]})
    views = at((0.0, 0.0, 1.0, 5.0, 14.0, 0.0), (0.0, 500.0, 1.0, 5.0, 14.0, 0.0))
    rendering = render(arrays, device, views, sky=even_sky(device, 2.0))
    assert ((rendering.objects() >= 0).sum(axis=(1, 2)) > 200).all()
    np.testing.assert_allclose(rendering.light()["sunny"], 2.0, rtol=2e-3)


@pytest.mark.parametrize("altitude_deg", [2.0, 10.0, 35.0, 65.0, 90.0])
def test_lambert_plane_under_the_sun(device: str, altitude_deg: float) -> None:
    """L = albedo E sin(altitude) / pi on the level, and with the cosine to a slope."""
    sun = Weather(sun_altitude_deg=altitude_deg, sun_azimuth_deg=130.0)
    albedo, klux = np.array([0.8, 0.4, 0.1]), 100.0
    slope = np.array([(-20.0, -20.0, 9.0), (-20.0, 20.0, 9.0), (20.0, 20.0, -9.0), (20.0, -20.0, -9.0)])
    arrays = on_ground(quad_part("Props/slope", slope[::-1], "m", "static"), albedo=albedo, half=60.0, z=-20.0)
    views = at((40.0, -40.0, 5.0, 0.0, 85.0, 0.0), (0.0, 0.0, 15.0, *DOWN))
    light = render(arrays, device, views, sky=even_sky(device, 0.0, sun=sun, klux=klux)).light()["sunny"]
    to_sun = sun_direction(sun)
    level, tilted = to_sun[2], float(np.dot(to_sun, (9.0, 0.0, 20.0))) / math.hypot(9.0, 20.0)
    assert tilted > 0.0
    for image, cosine in zip(light, (level, tilted), strict=True):
        assert np.ptp(image[..., 0]) < 0.01 * image[..., 0].mean()
        np.testing.assert_allclose(image.mean(axis=(0, 1)), albedo * klux * cosine / math.pi, rtol=0.01)


@pytest.mark.parametrize("ior", [1.3, 1.5])
def test_gloss_of_a_dielectric_keeps_within_the_light(device: str, ior: float) -> None:
    """A white dielectric seen beside the highlight sends on less than a Lambert one, by what it reflects elsewhere."""
    sun = Weather(sun_altitude_deg=40.0, sun_azimuth_deg=90.0)
    arrays = arrays_from_parts([ground_part(60.0, 0.0, "m")], materials={"m": matter(color=WHITE, ior=ior)})
    # The sun stands in the east, the camera too: its highlight lies on the other side.
    image = render(
        arrays, device, at((20.0, 0.0, 15.0, 180.0, 60.0, 0.0)), sky=even_sky(device, 0.0, sun=sun, klux=100.0)
    ).one()
    share = image * math.pi / (100.0 * math.sin(math.radians(40.0)))
    lost = ((ior - 1.0) / (ior + 1.0)) ** 2
    assert (share < 1.0).all() and (share > 1.0 - 4.0 * lost).all()


def test_open_ground_is_as_bright_as_its_sky_says(device: str) -> None:
    """Sun and sky of a real weather: a white plane has the illuminance of the baked sky over pi."""
    weather = Weather(sun_altitude_deg=30.0, cloudiness=0.0)
    views = at((0.0, 0.0, 1.5, *DOWN))
    rendering = render(on_ground(albedo=1.0, half=100.0), device, views, weathers={"sunny": weather})
    luminance = rendering.one().mean(axis=(0, 1)) @ (0.2126, 0.7152, 0.0722)
    assert luminance * math.pi == pytest.approx(bake(weather).horizontal_klux, rel=0.01)


def pane_reflectance(angle: np.ndarray, ior: float) -> np.ndarray:
    """Return what a clear pane reflects of unpolarised light, by Snell and Fresnel, all bounces between its faces."""
    inside = np.arcsin(np.sin(angle) / ior)
    s = (np.cos(angle) - ior * np.cos(inside)) / (np.cos(angle) + ior * np.cos(inside))
    p = (ior * np.cos(angle) - np.cos(inside)) / (ior * np.cos(angle) + np.cos(inside))
    return s**2 / (1.0 + s**2) + p**2 / (1.0 + p**2)


@pytest.mark.parametrize("of", ["wall", "sky", "sun-lit wall"])
def test_pane_reflects_by_fresnel(device: str, of: str) -> None:
    """A pane in the plane y = 0, seen at 0, 30, 56 and 75 degrees: what it reflects is a wall at y = 50, or the sky."""
    glass = matter("glass", "clear_glass", color=(0.0, 0.0, 0.0), opacity=0.3, roughness=0.02, ior=1.5)
    wall = glowing((3.0, 2.0, 1.0), "wall") if of == "wall" else lambert((0.9, 0.5, 0.3), "wall")
    corners = [(-400.0, 50.0, -300.0), (-400.0, 50.0, 300.0), (400.0, 50.0, 300.0), (400.0, 50.0, -300.0)]
    pane = [(-200.0, 0.0, -200.0), (200.0, 0.0, -200.0), (200.0, 0.0, 200.0), (-200.0, 0.0, 200.0)]
    parts = [quad_part("Buildings/pane", pane[::-1], "glass", "building")]
    if of != "sky":
        parts.append(quad_part("Buildings/wall", corners[::-1], "wall", "building"))
    sun = Weather(sun_altitude_deg=40.0, sun_azimuth_deg=180.0)
    expected, sky = np.array([3.0, 2.0, 1.0]), even_sky(device, 0.0)
    if of == "sky":
        sky, expected = even_sky(device, 1.5), np.full(3, 1.5)
    elif of == "sun-lit wall":  # the sun stands in the south: it lights the wall's front, which looks there
        sky = even_sky(device, 0.0, sun=sun, klux=80.0)
        expected = np.array([0.9, 0.5, 0.3]) * 80.0 * math.cos(math.radians(40.0)) / math.pi
    config = SMALL.model_copy(update={"width_px": 16, "height_px": 12, "fov_deg": 4.0})
    angles = [0.0, 30.0, 56.0, 75.0]
    places = [(-math.tan(math.radians(a)) * 5.0, 5.0, 0.0, -90.0 + a, 0.0, 0.0) for a in angles]
    materials = {"glass": glass, "wall": wall}
    if of == "sun-lit wall":  # seen through by nobody: the pane must not shade the wall
        parts[0] = quad_part("Buildings/pane", [(x, y, z / 40.0) for x, y, z in pane[::-1]], "glass", "building")
    for place, angle in zip(places, angles, strict=True):
        rendering = render(arrays_from_parts(parts, materials=materials), device, at(place), config=config, sky=sky)
        incidence = np.arccos(np.clip(-rendering.rays[..., 1], -1.0, 1.0))
        assert abs(math.degrees(incidence.mean()) - angle) < 1.5
        share = pane_reflectance(incidence, 1.5)
        np.testing.assert_allclose(rendering.one(), share[..., None] * expected, rtol=0.01)


SUN_40 = Weather(sun_altitude_deg=40.0, sun_azimuth_deg=90.0, cloudiness=0.0)
"""In the east, so that shadows lie in the west."""
NARROW = SMALL.model_copy(
    update={"width_px": 48, "height_px": 64, "fov_deg": 0.75 * math.degrees(2.0 * math.atan(0.25 / 10.0))}
)
"""0.375 m across 48 pixels at 10 m: 7.8 mm a pixel."""
EDGE_X = -1.0 - 2.0 / math.tan(math.radians(40.0))
"""End of the shadow of the upper edge at x = -1, z = 2."""


def profile_of(image: np.ndarray) -> np.ndarray:
    """Return light over that of the lit ground along x, from the lit side on; columns run towards the south."""
    line = image[..., 1].mean(axis=1)
    return line / line.max()


def edge_of(profile: np.ndarray) -> tuple[float, float]:
    """Return place and standard deviation [px] of the step of a profile, pixel edges at whole numbers."""
    step = np.abs(np.diff(profile))
    place = np.arange(1, len(profile))
    middle = np.average(place, weights=step)
    return float(middle), float(np.sqrt(np.average((place - middle) ** 2, weights=step)))


def box_on_ground(**rest) -> SceneData:
    """Return a box, 2 m each way, on white ground."""
    return on_ground(box_part("Buildings/box", (2.0, 8.0, 2.0), (0.0, 0.0, 1.0), "m", "building"), albedo=1.0, **rest)


def test_edge_of_a_shadow(device: str) -> None:
    """The edge of a box's shadow lies where the sun's direction says, within a pixel of 8 mm, and is as wide as the
    sun: a uniform disc of radius R spreads the edge by R / 2 rms. The filter adds to it (the mean over 3 pixels 0.82 px
    rms, in quadrature), and pixels that take the value on which their neighbors agree take from it."""
    sky = even_sky(device, 0.0, sun=SUN_40, klux=100.0)
    rendering = render(box_on_ground(), device, at((EDGE_X, 0.0, 10.0, *DOWN)), config=NARROW, sky=sky)
    profile = profile_of(rendering.one())
    place, spread = edge_of(profile)
    lens = intrinsics_of(NARROW)
    assert abs(place - lens.cy) < 1.0
    way = 2.0 / math.sin(math.radians(40.0))
    radius_px = way * SUN_RADIUS / math.sin(math.radians(40.0)) / 10.0 * lens.fx
    assert radius_px == pytest.approx(2.9, abs=0.1)
    assert profile.min() < 1e-3
    assert 0.85 < spread / (radius_px / 2.0) < 1.25


def test_shadow_of_a_vehicle_follows_it(device: str) -> None:
    sky = even_sky(device, 0.0, sun=SUN_40, klux=100.0)
    moved = 0.1
    rows = np.array([[pose(0.0, 0.0)], [pose(moved, 0.0)]])
    model = box_model("car", (2.0, 4.0, 2.0), (0.0, 0.0, 1.0))
    arrays = on_ground(albedo=1.0, models=[model], actors=[("veh_001", "vehicle", 0)], poses=rows)
    place = (EDGE_X + 0.05, 0.0, 10.0, *DOWN)
    light = render(arrays, device, at(place, place, frame=(0, 1)), config=NARROW, sky=sky).light()["sunny"]
    first, second = (edge_of(profile_of(image))[0] for image in light)
    points = np.array([(10.0, 0.0, EDGE_X + dx - place[0]) for dx in (0.0, moved)])
    expected = project(intrinsics_of(NARROW), points)[:, 1]
    np.testing.assert_allclose([first, second], expected, atol=1.0)


def test_no_shadows_where_none_are_wanted(device: str) -> None:
    sky = even_sky(device, 0.0, sun=SUN_40, klux=100.0)
    config = SMALL.model_copy(update={"shadows": False})
    views = at((-8.0, 0.0, 6.0, 0.0, 45.0, 0.0))
    images = [render(box_on_ground(), device, views, config=c, sky=sky) for c in (SMALL, config)]
    ground = images[0].objects()[0] == images[0].objects()[0][-1, 0]
    lit = 100.0 * math.sin(math.radians(40.0)) / math.pi
    shaded, plain = (image.one()[..., 1][ground] for image in images)
    assert (shaded < 0.5 * lit).mean() > 0.05
    # Pixels that the box's edge crosses show its dark side too.
    assert (np.abs(plain - lit) < 0.01 * lit).mean() > 0.97


def open_share(distance: np.ndarray, height: float) -> np.ndarray:
    """Return the sky view factor of level ground before an endless wall: 1 - (1 - cos(elevation of its top)) / 2."""
    return 0.5 + 0.5 * np.cos(np.arctan2(height, distance))


@pytest.mark.parametrize("glow", [0.0, 2.0])
def test_corner_is_darker_by_what_the_wall_hides(device: str, glow: float) -> None:
    """Ground before a black wall: 1/2 of the sky at its foot, more farther away.

    The model adds for what is hidden half of the light of open ground (`SHADED_GROUND`), whatever hides it. Rays end
    after 60 m, so the wall is that long to both sides. Tolerance: 16 directions, and the filter that spreads them.
    """
    materials = {"m": lambert(0.6), "black": lambert(0.0, "black")}
    height = 8.0
    wall = box_part("Buildings/wall", (400.0, 1.0, height), (0.0, 0.5, 0.5 * height), "black", "building")
    arrays = arrays_from_parts([ground_part(300.0, 0.0, "m"), wall], materials=materials)
    config = SMALL.model_copy(update={"fov_deg": 12.0})
    for distance in (0.25, 2.0, 8.0, 30.0):
        rendering = render(
            arrays, device, at((0.0, -distance, 2.0, *DOWN)), config=config, sky=even_sky(device, 3.0), glow=glow
        )
        image = rendering.one()
        assert (rendering.depth().depth_m.numpy() > 1.9).all()
        x, y = rendering.rays[..., 0], rendering.rays[..., 1]
        away = distance - 2.0 * y / -rendering.rays[..., 2]
        assert np.abs(x).max() < 1.0
        share = open_share(away, height)
        expected = 0.6 * (3.0 * share + 0.5 * glow * (1.0 - share))
        off = (image[..., 1] - expected) / (0.6 * (3.0 - 0.5 * glow))  # error of the share
        assert abs(off.mean()) < 0.02, distance
        inner = off[8:-8, 8:-8]  # at the border the filter has fewer rays
        assert inner.std() < 0.06 and np.abs(inner).max() < 0.12 and np.abs(off).max() < 0.4, distance


def test_sky_light_without_rays(device: str) -> None:
    """The section says of `sky_light: false`: all of the sky everywhere."""
    arrays, views = on_ground(albedo=0.6, half=300.0), at((0.0, 0.0, 5.0, *DOWN))
    config = SMALL.model_copy(update={"sky_light": False})
    image = render(arrays, device, views, config=config, sky=even_sky(device, 3.0)).one()
    np.testing.assert_allclose(image, 0.6 * 3.0, rtol=0.01)


def test_weathers_with_other_suns_have_their_own_shadows(device: str) -> None:
    """Two weathers of one camera, sun in the east and in the west: each has the shadow that it has alone."""
    weathers = {"east": SUN_40, "west": replace(SUN_40, sun_azimuth_deg=270.0)}
    arrays, views = box_on_ground(weathers=tuple(weathers)), at((0.0, 0.0, 20.0, *DOWN))
    together = render(arrays, device, views, weathers=weathers).light()
    rows = together["east"][0, :, 32, 1]
    # Up in the picture is east: the shadow of a sun in the east lies below the box, on row 29, its mirror on row 18.
    assert rows[29] < 0.6 * rows[18] and together["west"][0, 18, 32, 1] < 0.6 * together["west"][0, 29, 32, 1]
    for name, weather in weathers.items():
        alone = render(arrays, device, views, weathers={name: weather}).light()[name]
        np.testing.assert_array_equal(alone, together[name])
