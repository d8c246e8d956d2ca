"""Radar cross sections of spheres and plates, and what weather does to them and to the power."""

from dataclasses import replace

import numpy as np
import pytest

from mmw.physics.em.attenuation import fog_attenuation, rain_attenuation
from mmw.physics.em.gas_attenuation import gas_attenuation
from mmw.physics.materials.material import LIDAR_REFLECTANCE_905NM, Material, RadioMaterial
from mmw.physics.weather.weather import PRESETS, Weather
from mmw.sensors import Radar
from mmw.sensors.radar.reflectivity import ROUGHNESS, reflectivity_table
from tests.fixtures.radar_scenes import AT_ORIGIN, dense, sphere, wall_ahead, watched
from tests.fixtures.scenes import material
from tests.oracles.tracing import trapezoid

# Radar cross sections


@pytest.mark.parametrize(("radius", "distance"), [(0.1, 10.0), (1.0, 90.0), (3.0, 400.0)])
def test_sphere_has_the_rcs_of_its_cross_section(device: str, radius: float, distance: float) -> None:
    """Geometric optics: pi a^2 for a perfect conductor far away."""
    half = 1.2 * np.degrees(radius / distance)
    config = Radar(
        mount=AT_ORIGIN, range_m=500.0, horizontal_fov_deg=2 * half, vertical_fov_deg=2 * half, azimuth_rays=300,
        elevation_rays=300,
    )  # fmt: skip
    conductor = replace(material("metal_pole"), radio=RadioMaterial("itu", itu="itu_pec"))
    arrays = watched([sphere(radius, distance)], materials={"metal_pole": conductor})
    points = dense(arrays, device, config)
    rcs = np.sum(10 ** (points.rcs_dbsm.astype(float) / 10))
    assert rcs == pytest.approx(np.pi * radius**2, rel=0.05)
    # Closer: a mirror ball d away weakens a spherical wave to a / (2 d (d + a)), so pi a^2 d^2 / (d + a)^2. The slope
    # lengthens the lobe by 1 + s^2, and Lambert's share scatters 8/3 as much back.
    metal = ROUGHNESS["steel"]
    lobe = (1.0 - metal.diffuse_share) * (1.0 + metal.slope**2) + metal.diffuse_share * 8.0 / 3.0
    assert rcs == pytest.approx(np.pi * radius**2 * (1.0 - radius / distance) ** 2 * lobe, rel=0.01)


def test_mean_rcs_is_right_on_the_coarsest_grid(device: str) -> None:
    """A ball 1.1 deg wide and rays 1.5 deg apart: it is met by one ray or none, and right in the mean over frames."""
    frames, distance = 2000, 50.0
    leaves = {"leaves": replace(material("leaves"), nonvisual_base="leaf_grass")}
    arrays = watched([sphere(0.5, distance, "leaves")], poses=np.zeros((frames, 0, 7)), materials=leaves)
    config = Radar(mount=AT_ORIGIN, horizontal_fov_deg=4.5, vertical_fov_deg=4.5, azimuth_rays=3, elevation_rays=3)
    points = dense(arrays, device, config)
    each = np.zeros(frames)
    np.add.at(each, np.repeat(np.arange(frames), np.diff(points.offsets)), 10 ** (points.rcs_dbsm.astype(float) / 10))
    # Lambert's law over the part of the ball in view; u is the cosine from the ball's middle.
    u = np.linspace(0.5 / distance, 1.0, 20_001)
    cosine = (distance * u - 0.5) / np.sqrt(distance**2 + 0.25 - distance * u)
    expected = 4.0 * 0.22**2 * 2.0 * np.pi * 0.25 * trapezoid(cosine**2, u)
    error = each.std() / np.sqrt(frames)
    assert error < 0.05 * expected and abs(each.mean() - expected) < 4.0 * error


def test_plate_has_the_rcs_of_a_rough_plate(device: str) -> None:
    """Normal incidence: s0 A, s0 = |G|^2 / 2 s^2; turned by two slopes e^-2 of it; less than a smooth plate."""
    config = Radar(mount=AT_ORIGIN, horizontal_fov_deg=4.0, vertical_fov_deg=4.0, azimuth_rays=300, elevation_rays=300)
    metal, area = ROUGHNESS["steel"], 1.0
    found = []
    for angle in (0.0, 2.0 * metal.slope):
        points = dense(watched([wall_ahead(50.0, 0.5, yaw=angle)]), device, config)
        found.append(np.sum(10 ** (points.rcs_dbsm.astype(float) / 10)))
    expected = area * (1.0 - metal.diffuse_share) / (2.0 * metal.slope**2)
    assert found[0] == pytest.approx(expected, rel=0.02)
    assert found[1] / found[0] == pytest.approx(np.exp(-2.0), rel=0.15)
    smooth = 4.0 * np.pi * area**2 / config.wavelength**2
    assert 10.0 < found[0] < smooth  # 18.8 dBsm: that of a traffic sign; the smooth plate would have 59 dBsm on axis


# Weather


@pytest.mark.parametrize("name", ["sunny", "rainy", "heavy_fog"])
def test_weather_takes_from_the_power_both_ways(device: str, name: str) -> None:
    """Metal does not get wet; so the difference to no air is the loss of ITU's models over twice the distance."""
    arrays, config = watched([wall_ahead(80.0, 20.0)]), Radar(mount=AT_ORIGIN, wet_radome_db=3.0)
    weather = PRESETS[name]
    with_air = dense(arrays, device, config, weather=weather)
    loss_db = np.sum(gas_attenuation(np.array([76.5e9]), weather.dry_pressure_hpa, weather.temperature_c,
                                     weather.water_vapour_g_m3))  # fmt: skip
    radome = 0.0
    if weather.rain_mm_h:
        loss_db += rain_attenuation(weather.rain_mm_h, 76.5e9)
        radome = 3.0 * 2.5 ** (1 / 3)
    loss_db += fog_attenuation(weather.liquid_water_g_m3, 76.5e9, weather.temperature_c)
    equation = 10 * np.log10(config.link_constant) + 30.0 + with_air.rcs_dbsm - 40 * np.log10(with_air.range)
    beams = 6.0206 * ((np.degrees(with_air.azimuth) / 55.0) ** 2 + (np.degrees(with_air.elevation) / 15.0) ** 2)
    expected = equation - beams - radome - 2.0 * loss_db * with_air.range / 1000.0
    np.testing.assert_allclose(with_air.power_db, expected, atol=2e-3)


def test_water_makes_ground_reflect_more_and_scatter_less() -> None:
    asphalt, steel, paint = material("asphalt"), material("metal_pole"), replace(material("asphalt"), coating="paint")
    wet_soil = Material("mud", RadioMaterial("itu", itu="itu_wet_loam"), "soil", 0.2, (0.2, 0.2, 0.2))
    dry = reflectivity_table((asphalt, steel, paint, wet_soil), Weather(), 76.5e9)
    wet = reflectivity_table((asphalt, steel, paint, wet_soil), Weather(wetness=1.0), 76.5e9)
    np.testing.assert_array_equal(dry[1:], wet[1:])
    assert wet[0, 0] > dry[0, 0] and wet[0, 2] < dry[0, 2] and wet[0, 1] == dry[0, 1]
    # Asphalt has no row of P.2040 at 76.5 GHz: |Gamma0| = 0.35 of the table, index 2.08.
    power = dry[0, 0] / dry[0, 1] + dry[0, 2] / 4.0
    assert power == pytest.approx(0.35**2, rel=1e-5)


def test_reflection_is_that_of_the_radio_channel() -> None:
    concrete = material("concrete_facade")
    row = reflectivity_table((concrete,), Weather(), 76.5e9)[0]
    permittivity = 5.24 - 1j * 0.0462 * 76.5**0.7822 * 17.98 / 76.5  # ITU-R P.2040-4, equation 12: 17.98 sigma / f
    index = np.sqrt(permittivity)
    assert row[0] / row[1] + row[2] / 4.0 == pytest.approx(abs((index - 1) / (index + 1)) ** 2, rel=1e-3)


def test_every_base_has_a_roughness() -> None:
    assert set(ROUGHNESS) == set(LIDAR_REFLECTANCE_905NM)
    for rough in ROUGHNESS.values():
        assert 0.0 < rough.slope <= 0.5 and 0.0 < rough.gamma0 < 1.0 and 0.0 <= rough.diffuse_share <= 1.0
