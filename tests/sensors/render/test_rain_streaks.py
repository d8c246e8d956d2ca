"""Rain streaks: opacity of the drop-size distribution, length and direction of single streaks, depth, determinism."""

import math
from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from mmw.config.lens import LensConfig
from mmw.core.camera_models import Intrinsics
from mmw.core.transforms import pose_from_ypr
from mmw.kernels.camera.rain_streaks import COVER_SCALE
from mmw.kernels.core import structs
from mmw.physics.weather.weather import Weather
from mmw.sensors.render import rain_streaks as streaks
from mmw.sensors.render.camera import device_camera
from mmw.sensors.render.image_config import ImageConfig
from mmw.sensors.render.rain_streaks import make_rain, streak_cover

CAMERA = LensConfig().intrinsics(160, 120, 90.0)
CALM = Weather(rain_mm_h=25.0, wind_m_s=0.0)


def cover(
    weather: Weather, device: str, *, camera: Intrinsics = CAMERA, views: int = 2, first: int = 0,
    depth: float = np.inf, velocity=(0.0, 0.0, 0.0), rate=(0.0, 0.0, 0.0), pitch: float = 0.0,
    config: ImageConfig | None = None, **change,
) -> np.ndarray:  # fmt: skip
    """Return opacities [A, H, W]; `change` goes to the fields of the rain."""
    table = structs.Views()
    pose = np.tile(pose_from_ypr([5.0, 6.0, 7.0], 0.0, pitch), (views, 1)).astype(np.float32)
    table.pose = wp.array(pose, dtype=wp.transformf, device=device)
    table.batch_index = wp.zeros(views, dtype=int, device=device)
    table.ignore = wp.full(views, -1, dtype=int, device=device)
    twists = tuple(
        wp.array(np.tile(np.float32(part), (views, 1)), dtype=wp.vec3, device=device) for part in (velocity, rate)
    )
    words = (np.arange(2 * first, 2 * (first + views)).reshape(views, 2) * 977 + 5).astype(np.uint32)
    keys = wp.array(words, dtype=wp.vec2ui, device=device)
    t = wp.full(views * camera.height * camera.width, depth, dtype=float, device=device)
    rain = make_rain(weather, config or ImageConfig(), camera)
    for name, value in change.items():
        setattr(rain, name, value)
    found = streak_cover(table, twists, keys, device_camera(camera, 100.0), t, rain)
    return found.numpy() / float(COVER_SCALE)


def expected_mean(weather: Weather, near: float, far: float) -> float:
    """Return the mean opacity: pi/4 D^2 of all drops on a ray, by a sum over diameters."""
    d = np.linspace(streaks.SMALLEST_MM, streaks.LARGEST_MM, 20_001)
    density = 8000.0 * np.exp(-4.1 * weather.rain_mm_h**-0.21 * d)
    return float(np.trapezoid(density * np.pi / 4 * (1e-3 * d) ** 2, d)) * (far - near)


@pytest.mark.parametrize("rain_mm_h", [5.0, 25.0, 100.0])
def test_mean_opacity_is_that_of_the_drop_sizes(device: str, rain_mm_h: float) -> None:
    weather = replace(CALM, rain_mm_h=rain_mm_h)
    found = cover(weather, device, views=6)
    wanted = expected_mean(weather, streaks.NEAREST_M, streaks.RANGE_M)
    spread = found.mean(axis=(1, 2)).std() / math.sqrt(6)
    assert found.mean() == pytest.approx(wanted, abs=4.0 * spread)
    assert found.mean() == pytest.approx(wanted, rel=0.12)


def test_mean_opacity_holds_for_any_lens_and_motion(device: str) -> None:
    wide = LensConfig(model="fisheye", k1=0.02).intrinsics(160, 120, 190.0)
    bent = LensConfig(model="brown_conrady", k1=-0.2, k2=0.03).intrinsics(160, 120, 90.0)
    wanted = expected_mean(CALM, 0.5, 3.0)
    for camera in (wide, bent):
        found = cover(CALM, device, views=3, camera=camera, velocity=(15.0, 2.0, 0.0), nearest=0.5)
        assert found.mean() == pytest.approx(wanted, rel=0.09), camera


def test_what_is_near_hides_drops_behind_it(device: str) -> None:
    found = cover(CALM, device, views=8, depth=1.0)
    assert found.mean() == pytest.approx(expected_mean(CALM, streaks.NEAREST_M, 1.0), rel=0.15)
    assert cover(CALM, device, depth=0.1).max() == 0.0


def test_no_rain_and_no_views(device: str) -> None:
    assert cover(replace(CALM, rain_mm_h=0.0), device).max() == 0.0
    assert cover(CALM, device, views=0).shape == (0, 120, 160)


def moments(image: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the center (u, v) of an opacity and its 2 x 2 second moments [px^2]."""
    v, u = np.mgrid[: image.shape[0], : image.shape[1]] + 0.5
    place = np.stack([u.ravel(), v.ravel()], axis=1)
    share = image.ravel() / image.sum()
    middle = share @ place
    return middle, (place - middle).T @ ((place - middle) * share[:, None])


def single(device: str, view: int, **rest) -> tuple[np.ndarray, float] | None:
    """Return the opacity of one drop of 2 mm, 0.9 to 1.1 m away, and its area over that at 1 m; None without one.

    The area at 1 m is pi/4 (fx D)^2 over cos^3 of the angle off the axis. Two drops have 1.65 times as much or more.
    """
    found = cover(
        CALM, device, views=1, first=view, count=1.0, nearest=0.9, range=1.1, smallest=2.0, largest=2.0, cos_reach=0.9,
        aperture=0.0, **rest,
    )[0]  # fmt: skip
    inner = found[10:-10, 10:-10]
    if inner.sum() == 0.0 or inner.sum() < found.sum():
        return None
    q = (moments(found)[0] - [CAMERA.cx, CAMERA.cy]) / CAMERA.fx
    ratio = found.sum() / ((1.0 + q @ q) ** 1.5 * np.pi / 4 * (CAMERA.fx * 0.002) ** 2)
    return (found, ratio) if ratio < 1.5 else None


@pytest.mark.parametrize(
    ("velocity", "pitch"),
    [((0.0, 0.0, 0.0), 0.0), ((0.0, 12.0, 0.0), 0.0), ((0.0, -4.0, 0.0), 0.3), ((0.0, 0.0, -3.0), 0.0)],
)
def test_streak_is_as_long_as_the_drop_goes(device: str, velocity: tuple[float, float, float], pitch: float) -> None:
    """A bar of length L has a variance of L^2 / 12; fall speed of 2 mm by Atlas: 6.55 m/s. fx = 80 px: thin streaks."""
    config = ImageConfig(shutter_ms=20.0)
    speed = 9.65 - 10.3 * math.exp(-1.2)
    tried = 0
    for view in range(60):
        drop = single(device, view, velocity=velocity, pitch=pitch, config=config)
        if drop is None or tried >= 6:
            continue
        middle, spread = moments(drop[0])
        # Place of the drop, from the image; its distance is 1 m within 0.1.
        q = (middle - [CAMERA.cx, CAMERA.cy]) / CAMERA.fx
        ray = np.array([1.0, -q[0], -q[1]]) / math.hypot(1.0, *q)
        moving = np.array([0.0, 0.0, -speed]) - np.array(velocity)
        cos, sin = math.cos(pitch), math.sin(pitch)  # world to sensor: the inverse of a turn about y, nose down
        moving = np.array([cos * moving[0] - sin * moving[2], moving[1], sin * moving[0] + cos * moving[2]])
        ends = [ray + s * 0.01 * moving for s in (-1, 1)]
        way = np.diff([[-p[1] / p[0], -p[2] / p[0]] for p in ends], axis=0)[0] * CAMERA.fx
        value, axes = np.linalg.eigh(spread)
        length = math.sqrt(12.0 * (value[1] - value[0]))
        assert length == pytest.approx(np.linalg.norm(way), rel=0.13, abs=0.5), view
        assert abs(axes[:, 1] @ way) / np.linalg.norm(way) > 0.99
        tried += 1
    assert tried >= 4


def test_one_drop_takes_its_area(device: str) -> None:
    """The area of a drop does not depend on how far it falls; it goes by 1 / distance^2, 0.9 to 1.1 m."""
    drops = [single(device, view, config=ImageConfig(shutter_ms=5.0 + view % 3 * 7.0)) for view in range(60)]
    ratio = np.array([drop[1] for drop in drops if drop is not None])
    assert len(ratio) >= 10
    assert ratio.min() > 1 / 1.1**2 - 0.02 and ratio.max() < 1 / 0.9**2 + 0.02
    assert ratio.min() < 0.95 and ratio.max() > 1.05


def test_streaks_do_not_depend_on_the_batch(device: str) -> None:
    whole = cover(CALM, device, views=4)
    parts = np.concatenate([cover(CALM, device, views=1, first=0), cover(CALM, device, views=3, first=1)])
    np.testing.assert_array_equal(whole, parts)
    np.testing.assert_array_equal(whole, cover(CALM, device, views=4))
    assert (whole[0] != whole[1]).any()
