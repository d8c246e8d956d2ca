"""Wet surfaces: areas of puddles by counting, rings by their means, darkening against the LiDAR's formula."""

from dataclasses import replace

import numpy as np
import pytest
import warp as wp

from mmw.kernels.shading import wet_surfaces as kernels
from mmw.kernels.shading.structs import Appearance, SurfacePoint
from mmw.kernels.shading.wet_surfaces import Wet, film_light, film_weights, puddle_at, ripple_normal, wetted
from mmw.physics.materials.material import wet_reflectance
from mmw.physics.weather.weather import PRESETS, Weather
from mmw.sensors.render.wet_surfaces import make_wet
from tests.fixtures.directions import direction, sphere_about
from tests.fixtures.kernels import launched
from tests.fixtures.scenes import material

wp.set_module_options({"enable_backward": False, "fast_math": True})


@wp.kernel
def puddle_kernel(
    wet: Wet,
    appearance: Appearance,
    normal: wp.vec3,
    footprint: float,
    point: wp.array[wp.vec3],
    share_out: wp.array[float],
):
    """Shares of standing water. Launch: dim=N."""
    k = wp.tid()
    share_out[k] = puddle_at(wet, appearance, normal, point[k], footprint)


@wp.kernel
def ripple_kernel(wet: Wet, point: wp.array[wp.vec3], time: float, normal_out: wp.array[wp.vec3]):
    """Compute normals of standing water. Launch: dim=N."""
    k = wp.tid()
    normal_out[k] = ripple_normal(wet, point[k], time)


@wp.kernel
def wetted_kernel(
    wet: Wet, appearance: Appearance, surface_point: SurfacePoint, point: wp.array[wp.vec3], to_viewer: wp.vec3,
    to_light: wp.array[wp.vec3],
    color_out: wp.array[wp.vec3], film_out: wp.array[wp.vec4], normal_out: wp.array[wp.vec3],
    light_out: wp.array[float],
):  # fmt: skip
    """Wet surface points: color; roughness, film, its roughness and its share; its normal; its lobe. Launch: dim=N."""
    k = wp.tid()
    own = surface_point
    own.point = point[k]
    found = wetted(wet, appearance, own, 1.5, 0.0)
    color_out[k] = found.surface_point.color
    film_out[k] = wp.vec4(
        found.surface_point.roughness, found.film, found.film_roughness, film_weights(found, to_viewer)
    )
    normal_out[k] = found.film_normal
    light_out[k] = film_light(found, to_viewer, to_light[k], 1.05e-4)


def water(wetness: float = 0.0, puddles: float = 0.0, rain: float = 0.0) -> Wet:
    return make_wet(Weather(rain_mm_h=rain, wetness=wetness, puddles=puddles), np.zeros(3))


def ground(color=(0.2, 0.15, 0.1), roughness: float = 0.9, normal=(0.0, 0.0, 1.0)) -> tuple[SurfacePoint, Appearance]:
    surface_point, appearance = SurfacePoint(), Appearance()
    surface_point.normal = surface_point.shading_normal = wp.vec3(*normal)
    surface_point.color, surface_point.roughness, surface_point.opacity = wp.vec3(*color), roughness, 1.0
    appearance.normal_reflectance, appearance.is_porous, appearance.holds_puddles = 0.04, True, True
    return surface_point, appearance


def scattered(count: int, half: float = 1000.0) -> np.ndarray:
    points = np.zeros((count, 3), dtype=np.float32)
    points[:, :2] = np.random.default_rng(3).uniform(-half, half, (count, 2))
    return points


def puddles_of(wet: Wet, points: np.ndarray, device: str, footprint: float = 0.0, normal=(0.0, 0.0, 1.0)) -> np.ndarray:
    inputs = [wet, ground()[1], wp.vec3(*normal), footprint, points]
    return launched(puddle_kernel, len(points), inputs, device)[0]


def wet_of(
    wet: Wet,
    parts: tuple[SurfacePoint, Appearance],
    device: str,
    points=((0.0, 0.0, 0.0),),
    angle: float = 1.4,
    lights=None,
) -> tuple[np.ndarray, ...]:
    points = np.float32(points)
    lights = np.zeros_like(points) if lights is None else np.float32(lights)
    inputs = [wet, parts[1], parts[0], points, wp.vec3(*direction(angle)), lights]
    return tuple(launched(wetted_kernel, len(points), inputs, device))


@pytest.mark.parametrize("share", [0.02, 0.1, 0.3, 0.5, 0.8, 0.97])
def test_share_of_puddles(device: str, share: float) -> None:
    """Over 4 km2 the standing water covers the weather's share, sharp or as far pixels see it."""
    points = scattered(200_000)
    near = puddles_of(water(puddles=share), points, device)
    assert near.mean() == pytest.approx(share, abs=0.01)
    assert (near > 0.5).mean() == pytest.approx(share, abs=0.01)
    rim = ((near > 0.01) & (near < 0.99)).mean()
    assert rim < 0.07
    for footprint in (0.5, 5.0, 50.0):
        far = puddles_of(water(puddles=share), points, device, footprint)
        assert far.mean() == pytest.approx(share, abs=0.01)
    assert far == pytest.approx(share, abs=1e-5)


def test_puddles_of_all_and_none(device: str) -> None:
    points = scattered(1000)
    assert (puddles_of(water(puddles=1.0), points, device) == 1.0).all()
    assert (puddles_of(water(wetness=1.0), points, device) == 0.0).all()
    assert (puddles_of(water(puddles=0.9), points, device, normal=(0.3, 0.0, 0.954)) == 0.0).all()


def test_size_of_puddles(device: str) -> None:
    """Along a line puddles are decimeters to some meters long, and their rims are centimeters wide."""
    line = np.zeros((400_000, 3), dtype=np.float32)
    line[:, 0] = np.arange(400_000) * 0.005
    mask = puddles_of(water(puddles=0.3), line, device)
    edges = np.diff(np.flatnonzero(np.diff((mask > 0.5).astype(int))))
    lengths = edges[::2] if mask[0] < 0.5 else edges[1::2]
    assert 0.5 < np.median(lengths) * 0.005 < 4.0
    rising = np.diff(np.flatnonzero(np.diff(((mask > 0.1) & (mask < 0.9)).astype(int))))
    assert 0.005 < np.median(rising[::2]) * 0.005 < 0.2


def test_puddles_stay_in_the_world(device: str) -> None:
    """A scene whose frame is moved has the same puddles at the same places of the world."""
    points = scattered(2000, 50.0)
    here = puddles_of(water(puddles=0.5), points, device)
    moved = make_wet(Weather(puddles=0.5), np.array([40.0, -24.0, 3.0]))
    assert puddles_of(moved, points - np.float32([40.0, -24.0, 3.0]), device) == pytest.approx(here, abs=1e-3)


def ripples(wet: Wet, points: np.ndarray, time: float, device: str) -> np.ndarray:
    return launched(ripple_kernel, len(points), [wet, points, time], device)[0]


def test_rings_of_rain(device: str) -> None:
    """No rain, no rings; rings have no mean slope, a bounded one, are more in more rain, and run."""
    points = scattered(100_000, 100.0)
    assert (ripples(water(puddles=1.0), points, 1.0, device) == [0.0, 0.0, 1.0]).all()
    rms = []
    for rain in (2.0, 25.0, 100.0):
        normal = ripples(water(puddles=1.0, rain=rain), points, 7.3, device)
        assert np.linalg.norm(normal, axis=1) == pytest.approx(1.0, abs=1e-5)
        slope = -normal[:, :2] / normal[:, 2:]
        rms.append(np.sqrt((slope**2).sum(axis=1).mean()))
        assert np.abs(slope.mean(axis=0)).max() < 5.0 * rms[-1] / np.sqrt(len(points))
        assert np.linalg.norm(slope, axis=1).max() <= kernels.RING_LAYERS * kernels.RING_SLOPE
    assert 0.0 < rms[0] < 0.5 * rms[1] and rms[1] < rms[2] < 0.1
    wet = water(puddles=1.0, rain=25.0)
    assert (ripples(wet, points, 7.3, device) == ripples(wet, points, 7.3, device)).all()
    assert np.abs(ripples(wet, points, 7.3, device) - ripples(wet, points, 7.4, device)).max() > 0.03


def test_rings_run_outwards(device: str) -> None:
    """A ring that is at a point now is farther out a little later: slopes of small steps are continuous."""
    points = scattered(20_000, 20.0)
    wet = water(puddles=1.0, rain=50.0)
    change = np.abs(ripples(wet, points, 3.0, device) - ripples(wet, points, 3.0005, device)).max()
    assert change < 0.03


@pytest.mark.parametrize("wetness", [0.3, 1.0])
def test_darkening_is_that_of_the_lidar(device: str, wetness: float) -> None:
    """Each channel darkens as the LiDAR's reflectance, but for its absorption in the film (0.7 % at 905 nm)."""
    color, *_ = wet_of(water(wetness), ground((0.5, 0.2, 0.05)), device)
    for dry, found in zip((0.5, 0.2, 0.05), color[0], strict=True):
        expected = wet_reflectance(replace(material("asphalt"), lidar_reflectance=dry), wetness, 905)
        assert found == pytest.approx(expected, rel=0.008)
        assert found < dry


def test_what_gets_wet(device: str) -> None:
    """Ground most, walls less, undersides and dense materials not; films lie on what looks up."""
    soaked = water(1.0)
    dry = 0.2
    level, film, *_ = wet_of(soaked, ground(), device)
    wall, on_wall, *_ = wet_of(soaked, ground(normal=(1.0, 0.0, 0.0)), device, angle=0.3)
    under, below, *_ = wet_of(soaked, ground(normal=(0.0, 0.0, -1.0)), device)
    assert level[0, 0] < wall[0, 0] < under[0, 0] == pytest.approx(dry)
    assert film[0, 0] == pytest.approx(kernels.SOAKED_ROUGHNESS) and film[0, 1] > 0.3
    assert on_wall[0, 1] == 0.0 and below[0, 1] == 0.0
    surface_point, appearance = ground(roughness=0.2)
    appearance.is_porous = appearance.holds_puddles = False
    roof, on_roof, *_ = wet_of(soaked, (surface_point, appearance), device)
    assert roof[0, 0] == pytest.approx(dry) and on_roof[0, 1] > 0.0
    unchanged, none, *_ = wet_of(water(), ground(), device)
    assert unchanged[0] == pytest.approx([0.2, 0.15, 0.1]) and (none[0, [1, 3]] == 0.0).all()


def test_standing_water_reflects(device: str) -> None:
    """A puddle without rain is level, whole and reflects as water does by Fresnel's law."""
    for angle, expected in ((0.0, 0.0201), (np.radians(60.0), 0.0593), (np.radians(80.0), 0.3871)):
        _, film, normal, _ = wet_of(water(1.0, 1.0), ground(), device, angle=angle)
        assert film[0, 1] == 1.0 and normal[0] == pytest.approx([0.0, 0.0, 1.0])
        assert film[0, 3] == pytest.approx(expected, abs=0.03)
    shares = [wet_of(water(1.0, 1.0), ground(), device, angle=a)[1][0, 3] for a in np.linspace(0.0, 1.55, 40)]
    assert (np.diff(shares) > -2e-3).all() and shares[-1] < 1.0


def test_film_keeps_energy(device: str) -> None:
    """The film reflects the integral of its lobe of light from all round, and never more than its share."""
    parts = ground()
    for wet in (water(1.0), water(1.0, 1.0, 50.0)):
        for angle in (0.3, 1.0, 1.3):
            lights, solid = sphere_about(direction(angle) * [-1.0, -1.0, 1.0])
            _, film, _, light = wet_of(wet, parts, device, np.zeros_like(lights), angle, lights)
            found = float((light * solid).sum())
            assert 0.0 <= film[0, 3] <= film[0, 1] <= 1.0
            assert found == pytest.approx(film[0, 3], abs=0.02)


def test_presets(device: str) -> None:
    """A fifth of a road is under water in rain, and it is only damp in fog."""
    points = scattered(20_000, 200.0)
    origin = np.array([5000.0, 100.0, 0.0])
    _, rain, *_ = wet_of(make_wet(PRESETS["rainy"], origin), ground(), device, points)
    _, fog, *_ = wet_of(make_wet(PRESETS["foggy"], origin), ground(), device, points)
    assert (rain[:, 1] > 0.99).mean() == pytest.approx(0.2, abs=0.05)
    assert fog[:, 1].max() < 0.35
