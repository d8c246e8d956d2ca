"""Lenses: OpenCV's published formulas in float64, round trips, device against host, folding lenses refused."""

import math
from collections.abc import Callable

import numpy as np
import pytest
import warp as wp

from mmw.config.lens import LensConfig, check_lens
from mmw.core.camera_models import Distortion, Intrinsics
from mmw.kernels.camera.camera import Camera, camera_ray, project_point
from mmw.sensors.render.camera import device_camera
from mmw.sensors.render.projection import project, unproject
from tests.fixtures.kernels import launched

SIZE = (640, 480)
LENSES = {
    "pinhole": ({}, 110.0),
    "off_axis": ({"fx_px": 300.0, "fy_px": 310.0, "cx_px": 290.3, "cy_px": 251.7}, 90.0),
    "barrel": ({"model": "brown_conrady", "k1": -0.28, "k2": 0.07, "p1": 0.0007, "p2": -0.0004, "k3": -0.008}, 75.0),
    "pincushion": ({"model": "brown_conrady", "k1": 0.12, "k2": 0.03, "p1": -0.002, "p2": 0.003}, 80.0),
    "rational": (
        {"model": "brown_conrady", "k1": 4.3, "k2": 1.4, "k3": 0.02, "k4": 4.7, "k5": 2.4, "k6": 0.2, "p1": 2e-4},
        120.0,
    ),
    "equidistant": ({"model": "fisheye"}, 180.0),
    "fisheye": ({"model": "fisheye", "k1": 0.05, "k2": -0.012, "k3": 0.002, "k4": -0.0001}, 200.0),
    "widest": ({"model": "fisheye", "k1": -0.02, "k2": 0.001}, 220.0),
}


def lens(name: str) -> Intrinsics:
    keys, fov_deg = LENSES[name]
    return LensConfig(**keys).intrinsics(*SIZE, fov_deg)


def opencv(name: str, points: np.ndarray) -> np.ndarray:
    """Return pixels of points [N, 3], centers at +0.5, written after OpenCV's documentation, in its axes and order."""
    keys, _ = LENSES[name]
    camera = lens(name)
    k = {f"k{i}": keys.get(f"k{i}", 0.0) for i in range(1, 7)} | {p: keys.get(p, 0.0) for p in ("p1", "p2")}
    right, down, ahead = -points[:, 1], -points[:, 2], points[:, 0]
    if keys.get("model") == "fisheye":
        with np.errstate(divide="ignore", invalid="ignore"):
            a, b = right / ahead, down / ahead
        r = np.sqrt(a * a + b * b)
        theta = np.where(ahead > 0, np.arctan(r), np.pi - np.arctan(r))  # OpenCV's atan(r), beyond 90 deg too
        bent = theta * (1 + k["k1"] * theta**2 + k["k2"] * theta**4 + k["k3"] * theta**6 + k["k4"] * theta**8)
        length = np.hypot(right, down)
        x, y = bent * right / length, bent * down / length
    else:
        a, b = right / ahead, down / ahead
        r2 = a * a + b * b
        radial = (1 + k["k1"] * r2 + k["k2"] * r2**2 + k["k3"] * r2**3) / (
            1 + k["k4"] * r2 + k["k5"] * r2**2 + k["k6"] * r2**3
        )
        x = a * radial + 2 * k["p1"] * a * b + k["p2"] * (r2 + 2 * a * a)
        y = b * radial + k["p1"] * (r2 + 2 * b * b) + 2 * k["p2"] * a * b
    cx, cy = camera.cx - 0.5, camera.cy - 0.5  # OpenCV's pixel centers are at whole numbers
    return np.stack([camera.fx * x + cx, camera.fy * y + cy], axis=1) + 0.5


@wp.kernel
def both_ways_kernel(
    camera: Camera,
    pixel: wp.array[wp.vec2],
    distance: wp.array[float],
    # out
    ray_out: wp.array[wp.vec3],
    pixel_out: wp.array[wp.vec2],
):
    row = wp.tid()
    ray = camera_ray(camera, pixel[row][0], pixel[row][1])
    ray_out[row] = ray
    pixel_out[row] = project_point(camera, distance[row] * ray)


def on_device(camera: Intrinsics, pixels: np.ndarray, device: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the device's ray through each pixel [N, 3], and the pixel of a point on that ray [N, 2]."""
    count = len(pixels)
    distance = np.geomspace(0.2, 500.0, count).astype(np.float32)
    rays, back = launched(both_ways_kernel, count, [device_camera(camera, 100.0), pixels, distance], device)
    return rays, back


def image_points(step: float = 7.3) -> np.ndarray:
    u, v = np.meshgrid(
        np.append(np.arange(0.0, SIZE[0], step), SIZE[0]), np.append(np.arange(0.0, SIZE[1], step), SIZE[1])
    )
    return np.stack([u.ravel(), v.ravel()], axis=1)


@pytest.mark.parametrize("name", LENSES)
def test_projection_is_opencvs(name: str) -> None:
    camera, pixels = lens(name), image_points()
    rays = unproject(camera, pixels)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0, rtol=1e-12)
    points = rays * np.linspace(0.5, 80.0, len(rays))[:, None]
    np.testing.assert_allclose(opencv(name, points), pixels, atol=1e-6)
    np.testing.assert_allclose(project(camera, points), pixels, atol=1e-6)


@pytest.mark.parametrize("name", LENSES)
def test_device_rays_are_the_hosts(device: str, name: str) -> None:
    """The point that a pixel's ray meets projects into that pixel, by the float64 formulas, within 0.001 px."""
    camera, pixels = lens(name), image_points()
    rays, back = on_device(camera, pixels, device)
    np.testing.assert_allclose(np.linalg.norm(rays, axis=1), 1.0, rtol=3e-7)
    np.testing.assert_allclose(opencv(name, rays.astype(np.float64)), pixels, atol=1e-3)
    np.testing.assert_allclose(back, pixels, atol=1e-3)


@pytest.mark.parametrize("name", ["pinhole", "barrel", "rational", "fisheye", "widest"])
def test_field_of_view_ends_at_the_edges(name: str) -> None:
    camera, (keys, fov_deg) = lens(name), LENSES[name]
    straight = LensConfig(**{k: x for k, x in keys.items() if k not in ("p1", "p2")}).intrinsics(*SIZE, fov_deg)
    assert straight.fx == pytest.approx(camera.fx)
    left, right = unproject(straight, np.array([[0.0, 240.0], [640.0, 240.0]]))
    bearing = np.degrees(np.arctan2(left[1], left[0])), np.degrees(np.arctan2(right[1], right[0]))
    np.testing.assert_allclose(bearing, [fov_deg / 2, -fov_deg / 2], atol=1e-6)


def test_papers_camera() -> None:
    """fx = W / (2 tan(fov / 2)) = 224.07 px at 640 px and 110 deg: CARLA's pinhole, hand computed."""
    camera = lens("pinhole")
    assert camera.fx == camera.fy == pytest.approx(224.0664, abs=1e-4)
    assert (camera.cx, camera.cy) == (320.0, 240.0)
    np.testing.assert_allclose(project(camera, [[10.0, 2.0, 1.0]]), [[320 - 44.8133, 240 - 22.4066]], atol=1e-4)


def test_points_beside_the_image_do_not_fold_back(device: str) -> None:
    """OpenCV's polynomial maps far points back into a barrel image; here they stay outside, on the device too."""
    camera = lens("barrel")
    angle = np.linspace(0.0, 2.0 * np.pi, 50)[:, None, None]
    off = np.radians(np.linspace(60.0, 89.0, 30))[None, :, None]
    points = np.concatenate(
        [np.cos(off) + 0 * angle, np.sin(off) * np.cos(angle), np.sin(off) * np.sin(angle)], axis=-1
    )
    folded = opencv("barrel", points.reshape(-1, 3))
    inside = lambda p: ((p >= 0) & (p <= SIZE)).all(axis=-1)  # noqa: E731
    assert inside(folded).any(), "the polynomial must fold here, or the test shows nothing"
    found = project(camera, points)
    assert not inside(found).any()
    radius = np.hypot(found[..., 0] - camera.cx, found[..., 1] - camera.cy)
    assert (np.diff(radius, axis=1) > 0).all()
    assert np.isnan(project(camera, [[-1.0, 0.2, 0.1]])).all()


@pytest.mark.parametrize(
    ("keys", "fov_deg", "words"),
    [
        ({"model": "brown_conrady", "k1": -0.4}, 110.0, "folds at a field of view of 8"),
        ({"model": "brown_conrady", "k1": -0.4, "fx_px": 224.0}, 110.0, "not one to one beyond"),
        ({"model": "brown_conrady", "k1": -0.1, "k2": 0.02, "p1": 0.3, "fx_px": 300.0}, 110.0, "not one to one beyond"),
        ({"model": "fisheye", "k1": -0.5}, 200.0, "folds at a field of view of 94"),
        ({"model": "fisheye", "fx_px": 100.0}, 220.0, "not one to one beyond 3[01]"),
        ({"model": "brown_conrady"}, 180.0, "less than 180"),
        ({"cx_px": 700.0}, 90.0, "outside the image"),
    ],
)
def test_lens_without_an_image_is_refused(keys: dict, fov_deg: float, words: str) -> None:
    with pytest.raises(ValueError, match=words) as found:
        check_lens(LensConfig(**keys), *SIZE, fov_deg)
    assert str(found.value).count("; ") >= 2 and "\n" not in str(found.value)


def test_fold_is_where_the_derivative_vanishes() -> None:
    """r (1 - 0.4 r^2) is largest, 0.6086, at r = 0.9129: 136.3 px at fx = 224."""
    peak = math.sqrt(1 / 1.2)
    with pytest.raises(ValueError) as found:
        check_lens(LensConfig(model="brown_conrady", k1=-0.4, fx_px=224.0), *SIZE, 110.0)
    radius = float(str(found.value).split("beyond ")[1].split(" px")[0])
    assert radius == pytest.approx(224.0 * peak * (1 - 0.4 * peak**2), abs=400 / 64 + 1)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: LensConfig(k1=0.1), "no coefficients"),
        (lambda: LensConfig(model="fisheye", p1=0.1), "k1, k2, k3, k4, and p1 = 0.1"),
        (lambda: LensConfig(fy_px=200.0), "without fx_px"),
        (lambda: LensConfig(fx_px=0.0), "greater than 0"),
        (lambda: LensConfig(model="kannala"), "fisheye"),
        (lambda: Distortion("kannala"), "model = 'kannala'; one of pinhole, brown_conrady, fisheye is needed"),
        (lambda: Distortion("fisheye", radial=(0.1, 0.0)), "4 finite numbers are needed"),
        (lambda: Distortion("fisheye", radial=(math.nan, 0.0, 0.0, 0.0)), "4 finite numbers are needed"),
        (lambda: Intrinsics(0, 480, 300.0, 300.0, 0.0, 240.0), "0 x 480 px; at least 1 x 1"),
        (lambda: Intrinsics(640, 480, -300.0, 300.0, 320.0, 240.0), "fx = -300, fy = 300 px; finite numbers above 0"),
        (lambda: Intrinsics(640, 480, 300.0, 300.0, math.nan, 240.0), "cx = nan, cy = 240 px; finite numbers"),
    ],
)
def test_bad_lenses_and_cameras_are_refused(make: Callable[[], object], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        make()
