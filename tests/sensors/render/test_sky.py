"""The sky against closed forms, brute-force integrals and published bands of daylight."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
import warp as wp

from mmw.kernels.shading import sky as kernel
from mmw.physics.weather.weather import PRESETS, Weather
from mmw.sensors.render.sky import atmosphere, clouds, sky
from mmw.sensors.render.sky import prefilter as sky_blur
from tests.fixtures.kernels import launched
from tests.fixtures.rgb_scenes import toward
from tests.oracles.tracing import trapezoid

CLEAR = Weather(cloudiness=0.0)
ROWS = 128
"""Rows of the maps here: less work than for pictures."""


@wp.kernel
def radiance_kernel(
    sky: kernel.Sky, direction: wp.array[wp.vec3], roughness: float,
    radiance_out: wp.array[wp.vec3], irradiance_out: wp.array[wp.vec3], disc_out: wp.array[wp.vec3],
):  # fmt: skip
    """Radiance, irradiance and the sun's disc in directions. Launch: (N,)."""
    row = wp.tid()
    radiance_out[row] = kernel.sky_radiance(sky, direction[row], roughness)
    irradiance_out[row] = kernel.sky_irradiance(sky, direction[row])
    disc_out[row] = kernel.sun_disc(sky, direction[row])


def baked_sky(weather: Weather) -> sky.BakedSky:
    return sky.bake(weather, 0, ROWS)


def look(baked: kernel.Sky, directions: np.ndarray, device: str, roughness: float = 0.0) -> list[np.ndarray]:
    """Return radiance, irradiance and disc in directions, shape [N, 3] each."""
    return launched(radiance_kernel, len(directions), [baked, directions, roughness], device)


def test_sun_stands_where_azimuth_and_altitude_say() -> None:
    east = sky.sun_direction(Weather(sun_azimuth_deg=90.0, sun_altitude_deg=0.0))
    np.testing.assert_allclose(east, (1.0, 0.0, 0.0), atol=1e-12)
    south = sky.sun_direction(Weather(sun_azimuth_deg=180.0, sun_altitude_deg=30.0))
    np.testing.assert_allclose(south, (0.0, -math.cos(math.pi / 6.0), 0.5), atol=1e-12)


def test_transmittance_at_the_zenith_is_that_of_an_exponential_atmosphere() -> None:
    air = sky.clear_air(CLEAR)
    found = atmosphere.transmittance(air, np.array(atmosphere.EARTH_M), np.array(1.0))
    depth = np.array(air.rayleigh) * 8_000.0 * -math.expm1(-100.0 / 8.0)
    depth += np.array(air.haze) * 1_200.0 + atmosphere.OZONE_PER_M * 15_000.0
    np.testing.assert_allclose(found, np.exp(-depth), rtol=1e-3)


@pytest.mark.parametrize("altitude_deg", [1.0, 10.0, 40.0])
def test_slanted_transmittance_is_the_integral_along_the_ray(altitude_deg: float) -> None:
    air = sky.clear_air(CLEAR)
    sine = math.sin(math.radians(altitude_deg))
    s = np.linspace(0.0, 1.2e6, 400_001)
    height = np.sqrt(6_360e3**2 + s**2 + 2.0 * 6_360e3 * s * sine) - 6_360e3
    inside = height < 100e3
    gas = trapezoid(np.where(inside, np.exp(-height / 8e3), 0.0), s)
    haze = trapezoid(np.where(inside, np.exp(-height / 1.2e3), 0.0), s)
    ozone = trapezoid(np.maximum(1.0 - np.abs(height - 25e3) / 15e3, 0.0), s)
    depth = np.array(air.rayleigh) * gas + np.array(air.haze) * haze + atmosphere.OZONE_PER_M * ozone
    found = atmosphere.columns(np.array(atmosphere.EARTH_M), np.array(sine)) @ np.stack(
        (air.rayleigh, air.haze, atmosphere.OZONE_PER_M)
    )
    np.testing.assert_allclose(found, depth, rtol=0.01)


def test_sunlight_above_the_atmosphere_is_white() -> None:
    np.testing.assert_allclose(atmosphere.TO_RGB.sum(axis=0), 1.0)
    np.testing.assert_allclose(atmosphere.RAYLEIGH_PER_M[5], 13.558e-6)
    nothing = atmosphere.Air((0.0,) * 11, (0.0,) * 11)
    red, green, blue = atmosphere.sun_illuminance(nothing, 1.0)
    assert max(red, green) < blue  # ozone alone, which makes light blue
    assert 0.9 * atmosphere.SUN_KLUX < green < atmosphere.SUN_KLUX


def test_clear_daylight_lies_in_the_published_band_and_grows_with_the_sun() -> None:
    """Illuminance of level ground, CIE and IES: about 105 klux at 65 deg, 50 at 30, 0.4 to 0.9 at the horizon."""
    altitudes = (-30.0, -12.0, -6.0, -3.0, 0.0, 2.0, 10.0, 30.0, 65.0, 90.0)
    found = [baked_sky(replace(CLEAR, sun_altitude_deg=a)).horizontal_klux for a in altitudes]
    assert all(b >= a * 0.9999 for a, b in pairwise(found))
    at = dict(zip(altitudes, found, strict=True))
    assert 90.0 < at[65.0] < 115.0
    assert 45.0 < at[30.0] < 60.0
    assert 0.4 < at[0.0] < 0.9
    assert 0.002 < at[-6.0] < 0.008
    assert at[-30.0] == pytest.approx(sky.NIGHT_KLUX, rel=0.03)


def test_a_clear_zenith_is_blue_and_a_low_sun_red() -> None:
    air = sky.clear_air(CLEAR)
    zenith = atmosphere.sky_radiance(air, math.radians(65.0), np.array([math.pi / 2]), np.array([0.0]))[0, 0]
    assert zenith[2] > 1.5 * zenith[0]
    red, green, blue = atmosphere.sun_illuminance(air, math.radians(3.0))
    assert red > 2.0 * green > 4.0 * blue
    twilight = atmosphere.sky_radiance(air, math.radians(-3.0), np.array([math.pi / 2]), np.array([0.0]))[0, 0]
    assert twilight[2] > twilight[1] > twilight[0]


def test_overcast_sky_is_that_of_the_cie() -> None:
    up = np.linspace(0.0, 1.0, 20_001)
    light = sky.overcast_luminance(np.array(20.0), up)
    assert light[-1] / light[0] == pytest.approx(3.0)
    assert trapezoid(2.0 * math.pi * light * up, up) == pytest.approx(20.0, rel=1e-6)


def test_clouds_and_rain_take_light_away() -> None:
    clear = baked_sky(CLEAR).horizontal_klux
    overcast = baked_sky(Weather(cloudiness=1.0))
    assert overcast.horizontal_klux / clear == pytest.approx(0.25, rel=0.01)  # Kasten and Czeplak
    assert not overcast.sun_illuminance.any()
    assert not baked_sky(Weather(cloudiness=0.8)).sun_illuminance.any()
    assert baked_sky(Weather(cloudiness=0.1)).horizontal_klux == pytest.approx(clear, rel=0.1)
    light, hard, violent = (baked_sky(PRESETS[n]).horizontal_klux for n in ("light_rain", "rainy", "heavy_rain"))
    assert overcast.horizontal_klux > light > 8.0 > hard > violent > 3.0


def test_clouds_cover_their_share_of_the_sky_and_leave_the_sun_free() -> None:
    at = sky_blur.directions(64)[:26]  # from 17 deg up
    to_sun = sky.sun_direction(CLEAR)
    weight = sky_blur.solid_angles(64)[:26, None]
    covers = []
    for share in (0.1, 0.3, 0.6):
        light = clouds.heaps(at, to_sun, share, 0)
        covers.append(float((weight * light[..., 2]).sum() / (weight.sum() * 128)))
        assert clouds.heaps(to_sun[None, None], to_sun, share, 0)[0, 0, 2] < 0.05
    assert 0.01 < covers[0] < 0.15 < covers[1] < 0.5 < covers[2] < 0.9
    assert not np.array_equal(clouds.heaps(at, to_sun, 0.3, 1), clouds.heaps(at, to_sun, 0.3, 0))


def test_uniform_sky_stays_uniform_and_a_linear_one_has_its_closed_form() -> None:
    ones = np.ones((sky_blur.ROWS, 2 * sky_blur.ROWS, 1))
    up = sky_blur.directions(sky_blur.ROWS)
    for roughness in (0.2, 0.6, 1.0, None):
        np.testing.assert_allclose(sky_blur.blur(ones, roughness), 1.0)
    # Irradiance over pi of the luminance w . z is 2 / 3 n . z, on any axis.
    np.testing.assert_allclose(sky_blur.blur(up, None), up * 2.0 / 3.0, atol=2e-3)


def test_blurred_map_is_the_mean_over_the_lobe() -> None:
    image = baked_sky(Weather(cloudiness=0.5)).small
    at = sky_blur.directions(sky_blur.ROWS)
    weight = sky_blur.solid_angles(sky_blur.ROWS)[:, None]
    found = sky_blur.blur(image, 0.4)
    for row, column in ((3, 11), (25, 100), (40, 0)):
        lobe = weight * sky_blur.ggx_lobe(at @ at[row, column], 0.4)
        mean = (lobe[..., None] * image).sum(axis=(0, 1)) / lobe.sum()
        np.testing.assert_allclose(found[row, column], mean, rtol=1e-6)


@pytest.mark.parametrize("weather", [Weather(), Weather(cloudiness=0.5, sun_altitude_deg=5.0), PRESETS["foggy"]])
def test_irradiance_is_the_integral_over_the_hemisphere(weather: Weather, device: str) -> None:
    normals = toward(np.array([0.0, 40.0, 180.0, 270.0, 359.0]), np.array([90.0, 30.0, 0.0, -30.0, -90.0]))
    found = look(sky.make_sky(weather, device, rows=ROWS), normals, device)[1]
    image = baked_sky(weather).map.astype(float)
    at, weight = sky_blur.directions(ROWS), sky_blur.solid_angles(ROWS)
    for normal, light in zip(normals, found, strict=True):
        cosine = np.maximum(at @ normal, 0.0) * weight[:, None]
        np.testing.assert_allclose(light, np.einsum("rc,rck->k", cosine, image), rtol=0.01)


@pytest.mark.parametrize(
    "weather", [Weather(cloudiness=0.5), Weather(), PRESETS["foggy"], Weather(sun_altitude_deg=-15)]
)
def test_maps_are_read_where_their_texels_are(weather: Weather, device: str) -> None:
    """Toward each texel of the octahedral map the device finds the baked sky of that direction, but for half floats."""
    made = sky.make_sky(weather, device, rows=ROWS)
    size = made.map.shape[0] - 2
    at = sky_blur.octahedral_directions(size)[1:-1, 1:-1].reshape(-1, 3)
    image = sky_blur.octahedral(baked_sky(weather).map, size)[1:-1, 1:-1].reshape(-1, 3)
    assert len(at) == (3 * ROWS // 2) ** 2
    np.testing.assert_allclose(look(made, at, device)[0], image, rtol=2e-3)


def test_octahedral_map_holds_what_the_equirectangular_one_has_in_each_direction() -> None:
    """A map of its own directions stays one, within what lines between texels cut off an arc; borders repeat beyond."""
    at = sky_blur.octahedral_directions(192)
    np.testing.assert_allclose(np.linalg.norm(at, axis=-1), 1.0, rtol=1e-12)
    np.testing.assert_allclose(sky_blur.octahedral(sky_blur.directions(ROWS), 192), at, atol=2e-4)
    for edge, next_to_it in ((at[0], at[1]), (at[-1], at[-2]), (at[:, 0], at[:, 1]), (at[:, -1], at[:, -2])):
        np.testing.assert_allclose(edge[1:-1], next_to_it[-2:0:-1], atol=1e-12)


@pytest.mark.parametrize("roughness", [0.0, 0.1, 0.5])
def test_no_seam_at_north_and_none_at_the_poles(roughness: float, device: str) -> None:
    made = sky.make_sky(Weather(cloudiness=0.3, sun_azimuth_deg=30.0), device, rows=ROWS)
    elevation = np.linspace(-80.0, 80.0, 41)
    west, east = (look(made, toward(a, elevation), device, roughness)[0] for a in (-0.003, 0.003))
    np.testing.assert_allclose(west, east, rtol=0.01)
    around = np.linspace(0.0, 360.0, 32)
    for pole in (89.99, -89.99):
        ring = look(made, toward(around, pole), device, roughness)[0]
        np.testing.assert_allclose(ring, np.broadcast_to(ring.mean(axis=0), ring.shape), rtol=0.03)


def test_sun_disc_holds_the_direct_light(device: str) -> None:
    weather = Weather(sun_altitude_deg=40.0, sun_azimuth_deg=200.0)
    made = sky.make_sky(weather, device, rows=ROWS)
    step = 0.004
    off = np.arange(-0.4, 0.4, step) + 0.5 * step
    elevation, azimuth = np.meshgrid(40.0 + off, 200.0 + off / math.cos(math.radians(40.0)))
    at = toward(azimuth, elevation)
    solid = math.radians(step) ** 2 * np.cos(np.radians(elevation)) / math.cos(math.radians(40.0))
    disc = look(made, at.reshape(-1, 3), device)[2].reshape(at.shape)
    np.testing.assert_allclose((disc * solid[..., None]).sum(axis=(0, 1)), made.sun_illuminance, rtol=0.02)
    apart = np.degrees(np.arccos(np.clip(at @ sky.sun_direction(weather), -1.0, 1.0)))
    assert not disc[apart > 0.27].any()
    assert disc[apart < 0.26].all()
    assert disc[apart < 0.02].mean() > 1.5 * disc[(apart > 0.255) & (apart < 0.262)].mean()  # darker at the limb


def test_exposure_is_that_of_an_incident_light_meter() -> None:
    assert 0.18 * 100.0 / math.pi * sky.exposure(100.0) == pytest.approx(0.18)
    greys = [0.18 * e / math.pi * sky.exposure(e) for e in (100.0, 25.0, 4.0, 1.0, 2e-4)]
    assert greys == sorted(greys, reverse=True)
    assert greys[-1] > 0.015


def test_exposure_counts_lights(device: str) -> None:
    night = Weather(sun_altitude_deg=-15.0)
    dark, lit = (sky.make_sky(night, device, rows=ROWS, lights_klux=klux) for klux in (0.0, 0.01))
    assert dark.exposure == pytest.approx(sky.exposure(baked_sky(night).horizontal_klux))
    assert lit.exposure == pytest.approx(sky.exposure(baked_sky(night).horizontal_klux + 0.01))
    np.testing.assert_array_equal(lit.map.numpy(), dark.map.numpy())


def test_every_weather_has_a_finite_sky_and_the_same_one_twice(device: str) -> None:
    weather = Weather(visibility_m=10.0, sun_altitude_deg=-90.0, rain_mm_h=250.0, fog_falloff_per_m=10.0)
    for case in (weather, replace(weather, sun_altitude_deg=90.0, cloudiness=0.0, mie_scattering_scale=100.0)):
        made = sky.make_sky(case, device, rows=ROWS)
        assert np.isfinite(made.map.numpy().astype(float)).all()
        assert np.isfinite(made.blurred.numpy().astype(float)).all()
        assert (made.map.numpy() >= 0.0).all()
        assert 0.0 < made.exposure < 1e9
    assert sky.make_sky(weather, device, rows=ROWS) is sky.make_sky(replace(weather), device, rows=ROWS)
    again = sky._bake.__wrapped__(weather, 0, ROWS)
    assert again.map.tobytes() == baked_sky(weather).map.tobytes()


def test_carlas_scales_change_haze_and_blue() -> None:
    base = sky.clear_air(CLEAR)
    assert sky.clear_air(replace(CLEAR, mie_scattering_scale=0.06)).haze[5] == pytest.approx(2.0 * base.haze[5])
    assert sky.clear_air(replace(CLEAR, rayleigh_scattering_scale=0.0)).rayleigh == (0.0,) * 11
    # Gas and haze together leave the visibility of the weather.
    assert base.haze[5] + base.rayleigh[5] == pytest.approx(math.log(20.0) / 20_000.0)
