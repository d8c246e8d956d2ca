"""Radar cross sections of bodies over their aspect: closed forms, and shipped bodies beside what is published."""

from pathlib import Path

import numpy as np
import pytest

import mmw
from mmw.core.errors import InputError
from mmw.core.resources import assets_dir
from mmw.physics.weather.weather import Weather
from mmw.sensors import radar_cross_section
from mmw.sensors.radar.reflectivity import ROUGHNESS, normal_reflection
from mmw.validation.targets import ball
from tests.fixtures.targets import load_target

AROUND = np.radians(np.arange(0.0, 360.0, 10.0))


def asset(kind: str, name: str) -> mmw.Scene:
    return mmw.load_scene(assets_dir() / kind / name / f"{name}.usda", device="cpu")


def decibels(values: np.ndarray) -> np.ndarray:
    return 10.0 * np.log10(values)


@pytest.mark.parametrize("elevation", [0.0, 0.9, -0.9])
def test_rough_ball_has_its_closed_form_from_every_side(tmp_path: Path, elevation: float) -> None:
    """Geometric optics with the lobe of the slope, 1 + s^2, and Lambert's 8/3; 100 radii away, so 0.99^2."""
    scene = load_target(tmp_path, ball(0.5, 5), "itu_pec")
    found = radar_cross_section(scene, [0.0, 2.0, -2.5], elevation_rad=elevation, rays=40_000)
    rough = ROUGHNESS["none"]
    lobe = (1.0 - rough.diffuse_share) * (1.0 + rough.slope**2) + rough.diffuse_share * 8.0 / 3.0
    # The facets of the mesh and the bounding cube's half diagonal, by which the distance is counted: within 2 %.
    np.testing.assert_allclose(found, np.pi * 0.25 * 0.98 * lobe, rtol=0.02)


def test_bands_differ_by_the_reflection_alone(tmp_path: Path) -> None:
    """The same rays are cast at each carrier, so a body of one material follows |Gamma|^2 of it."""
    scene = load_target(tmp_path, ball(0.5, 4), "itu_skin")
    low, high = (radar_cross_section(scene, [0.3], carrier_hz=f)[0] for f in (10e9, 76.5e9))
    (skin,) = (one for one in scene.materials_by_id() if one.radio.itu == "itu_skin")
    expected = abs(normal_reflection(skin, 10e9)) ** 2 / abs(normal_reflection(skin, 76.5e9)) ** 2
    assert low / high == pytest.approx(expected, rel=1e-3)  # distances and rays are rounded to single precision


@pytest.mark.parametrize(
    ("kind", "name", "mean"),
    [
        ("vehicles", "sedan", 8.6), ("vehicles", "suv", 9.6), ("vehicles", "box_truck", 15.8),
        ("pedestrians", "man", -4.5), ("pedestrians", "child", -7.9), ("cyclists", "cyclist", -3.2),
        ("drones", "quadrotor", -14.1),
    ],
)  # fmt: skip
def test_shipped_bodies_keep_their_mean(kind: str, name: str, mean: float) -> None:
    """At 76.5 GHz [dBsm], as docs/sensors/radar.md says; the random rays of 36 aspects move it by 0.1 dB."""
    assert decibels(radar_cross_section(asset(kind, name), AROUND).mean()) == pytest.approx(mean, abs=0.3)


def test_a_car_is_brightest_broadside() -> None:
    front, left, rear, right = radar_cross_section(asset("vehicles", "sedan"), np.radians([0.0, 90.0, 180.0, 270.0]))
    assert decibels(left) == pytest.approx(decibels(right), abs=0.3)  # it is symmetric
    assert left > rear > front


def test_water_dims_and_brightens_by_the_weather_of_the_scene(tmp_path: Path) -> None:
    """Metal does not get wet: the weather counts for surfaces that do."""
    for itu, changes in (("itu_pec", False), ("itu_concrete", True)):
        path = load_target(tmp_path, ball(0.5, 3), itu, base="concrete" if changes else "steel", only_file=True)
        scene = mmw.load_scene(path, weather={"dry": Weather(), "wet": Weather(wetness=1.0)}, device="cpu")
        dry, wet = (radar_cross_section(scene, [0.0], weather=name)[0] for name in ("dry", "wet"))
        assert (wet > dry) if changes else (wet == dry)


def test_arguments_are_checked(tmp_path: Path) -> None:
    scene = load_target(tmp_path, ball(0.5, 2), "itu_pec")
    with pytest.raises(InputError, match="elevation between"):
        radar_cross_section(scene, [0.0], elevation_rad=2.0)
    with pytest.raises(InputError, match=r"finite azimuths of shape \[N\]"):
        radar_cross_section(scene, [[0.0]])
    large = load_target(tmp_path, ball(12.0, 2), "itu_pec")
    with pytest.raises(InputError, match="load one body alone"):
        radar_cross_section(large, [0.0])
