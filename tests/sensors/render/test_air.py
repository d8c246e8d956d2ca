"""Fog, haze and rain before a camera: Koschmieder's law, the extinction of every other sensor, no seam to the sky."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import warp as wp

from mmw.kernels.shading import aerial_perspective as kernel
from mmw.kernels.shading.sky import Sky, sky_radiance
from mmw.physics.weather.optics import extinction, visibility
from mmw.physics.weather.weather import PRESETS, Weather
from mmw.sensors.render.sky import sky
from tests.fixtures.kernels import launched
from tests.fixtures.rgb_scenes import toward
from tests.oracles.tracing import trapezoid


@wp.kernel
def air_kernel(
    air: kernel.Air,
    sky: Sky,
    radiance: wp.vec3,
    origin: wp.vec3,
    direction: wp.array[wp.vec3],
    distance: wp.array[float],
    surface_out: wp.array[wp.vec3],
    airlight_out: wp.array[wp.vec3],
    passed_out: wp.array[wp.vec3],
    sky_out: wp.array[wp.vec3],
):
    """Surface through air, airlight, transmittance, and the sky itself. Launch: (N,)."""
    row = wp.tid()
    d = direction[row]
    surface_out[row] = kernel.through_air(air, sky, radiance, origin, d, distance[row])
    airlight_out[row] = kernel.airlight(air, sky.sun_direction, d)
    passed_out[row] = kernel.transmittance(air, origin, d, distance[row])
    sky_out[row] = sky_radiance(sky, d, 0.0)


def see(
    weather: Weather, device: str, directions: np.ndarray, distance: np.ndarray | float,
    radiance: float = 0.0, height: float = 2.0, ground_z: float = 0.0, rows: int = 128,
) -> list[np.ndarray]:  # fmt: skip
    """Return light at a camera, airlight, transmittance and the sky, shape [N, 3] each."""
    air, above = sky.make_air(weather, device, ground_z, rows=rows), sky.make_sky(weather, device, rows=rows)
    far = np.broadcast_to(distance, len(directions))
    inputs = [air, above, wp.vec3(radiance), wp.vec3(0.0, 0.0, height), directions, far]
    return launched(air_kernel, len(directions), inputs, device)


@pytest.mark.parametrize("name", ["light_fog", "foggy", "heavy_fog"])
def test_black_target_at_the_visual_range_has_a_contrast_of_5_percent(name: str, device: str) -> None:
    target, light, _, _ = see(PRESETS[name], device, toward(70.0, 0.0), PRESETS[name].visibility_m)
    np.testing.assert_allclose((light - target) / light, 0.05, rtol=1e-4)


def test_black_target_in_rain_too(device: str) -> None:
    weather = PRESETS["rainy"]
    target, light, _, _ = see(weather, device, toward(70.0, 0.0), visibility(weather))
    np.testing.assert_allclose(((light - target) / light)[:, 1], 0.05, rtol=1e-4)


@pytest.mark.parametrize("name", list(PRESETS))
def test_extinction_is_that_of_every_sensor(name: str, device: str) -> None:
    distance = np.array([1.0, 30.0, 100.0, 400.0])
    passed = see(PRESETS[name], device, np.repeat(toward(10.0, 0.0), 4, axis=0), distance)[2]
    np.testing.assert_allclose(passed[:, 1], np.exp(-extinction(PRESETS[name], 550) * distance), rtol=1e-4)


def test_haze_takes_more_blue_and_fog_is_grey(device: str) -> None:
    red, green, blue = see(Weather(), device, toward(0.0, 0.0), 5_000.0)[2][0]
    assert red > green > blue
    red, green, blue = see(Weather(visibility_m=900.0), device, toward(0.0, 0.0), 500.0)[2][0]
    assert red == green == blue


def test_nothing_happens_up_close(device: str) -> None:
    found = see(PRESETS["heavy_fog"], device, toward(0.0, 20.0), 0.0, radiance=3.0)[0]
    np.testing.assert_allclose(found, 3.0, rtol=1e-6)


def test_fog_begins_where_it_should_and_rain_at_once(device: str) -> None:
    weather = Weather(visibility_m=100.0, fog_start_m=40.0)
    passed = see(weather, device, np.repeat(toward(0.0, 0.0), 2, axis=0), np.array([30.0, 100.0]))[2]
    np.testing.assert_allclose(passed[:, 1], (1.0, math.exp(-60.0 * math.log(20.0) / 100.0)), rtol=1e-4)
    wet = replace(weather, rain_mm_h=25.0)
    share = extinction(wet, 550) - extinction(weather, 550)
    assert see(wet, device, toward(0.0, 0.0), 30.0)[2][0, 1] == pytest.approx(math.exp(-share * 30.0), rel=1e-4)


@pytest.mark.parametrize("elevation_deg", [-6.0, -0.3, 0.0, 0.3, 50.0, 90.0])
@pytest.mark.parametrize("start", [0.0, 12.0])
def test_density_that_falls_with_height_is_its_integral(elevation_deg: float, start: float, device: str) -> None:
    weather = Weather(visibility_m=50.0, fog_falloff_per_m=0.05, fog_start_m=start)
    passed = see(weather, device, toward(33.0, elevation_deg), 60.0, height=17.0, ground_z=10.0)[2][0, 1]
    s = np.linspace(start, 60.0, 20_001)
    height = np.maximum(7.0 + s * math.sin(math.radians(elevation_deg)), 0.0)
    depth = extinction(weather, 550) * trapezoid(np.exp(-0.05 * height), s)
    assert passed == pytest.approx(math.exp(-depth), rel=2e-3)


@pytest.mark.parametrize(
    ("visibility_m", "cloudiness"), [(50.0, 0.2), (800.0, 0.2), (5_000.0, 0.2), (20_000.0, 0.2), (20_000.0, 1.0)]
)
def test_far_things_merge_with_the_horizon(visibility_m: float, cloudiness: float, device: str) -> None:
    weather = Weather(visibility_m=visibility_m, cloudiness=cloudiness, sun_azimuth_deg=77.0, sun_altitude_deg=20.0)
    azimuth = np.linspace(0.0, 350.0, 36)
    far, _, _, above = see(weather, device, toward(azimuth, 0.0), 3e6, rows=512)
    np.testing.assert_allclose(far, above, rtol=0.03)
    ground, _, _, _ = see(weather, device, toward(azimuth, -0.05), 3e6, rows=512)
    np.testing.assert_allclose(ground, far, rtol=0.03)


def test_dense_fog_hides_the_sky_and_clear_air_does_not(device: str) -> None:
    at = toward(np.linspace(0.0, 330.0, 12), 25.0)
    _, light, _, seen = see(PRESETS["heavy_fog"], device, at, 1.0, rows=512)
    np.testing.assert_allclose(seen, light, rtol=2e-3)
    assert sky.layer_depth(Weather()) == 0.0
    assert sky.layer_depth(Weather(visibility_m=sky.HAZE_VISIBILITY_M)) == 0.0
    assert sky.layer_depth(Weather(visibility_m=sky.HAZE_VISIBILITY_M * 0.999)) < 1e-3


def test_light_grows_steadily_less_as_air_thickens_into_fog() -> None:
    sights = (20e3, 10_001.0, 9_999.0, 1_001.0, 999.0, 200.0, 50.0)
    found = [sky.bake(Weather(visibility_m=v, cloudiness=1.0), 0, 128).horizontal_klux for v in sights]
    for (thin, light), (thick, less) in pairwise(zip(sights, found, strict=True)):
        if thin - thick < 3.0:
            assert less == pytest.approx(light, rel=0.005)
        else:
            assert less < light * 1.001


def test_sun_glows_through_thin_fog_only(device: str) -> None:
    thin = Weather(visibility_m=800.0, cloudiness=0.0, sun_altitude_deg=25.0, sun_azimuth_deg=90.0)
    to_sun, away = see(thin, device, toward(np.array([90.0, 270.0]), 5.0), 1.0)[1]
    assert to_sun[1] > 1.3 * away[1]
    without = see(replace(thin, scattering_intensity=0.0), device, toward(90.0, 5.0), 1.0)[1][0]
    assert without[1] < to_sun[1]
    to_sun, away = see(replace(thin, visibility_m=50.0), device, toward(np.array([90.0, 270.0]), 5.0), 1.0)[1]
    np.testing.assert_allclose(to_sun, away, rtol=1e-3)


def test_scattering_shares_out_all_light() -> None:
    cosine, weight = np.polynomial.legendre.leggauss(120)
    for g in (0.0, 0.5, kernel.FOG_ANISOTROPY):
        share = np.array([kernel.henyey_greenstein(float(c), g) for c in cosine])
        assert 2.0 * math.pi * (weight @ share) == pytest.approx(1.0, rel=1e-5)
        assert 2.0 * math.pi * (weight @ (share * cosine)) == pytest.approx(g, abs=1e-5)
