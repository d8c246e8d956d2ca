"""Paths of satellites against the image method of one wall, in float64, and plane waves from any distance."""

import numpy as np
import pytest

from mmw.channel.path_solver.surface_table import make_surface_table
from mmw.channel.paths import PathSet
from mmw.scene.device_scene import DeviceScene
from mmw.scene.scene_data import SceneData
from mmw.scene.views import Views
from mmw.sensors import Gnss
from mmw.sensors.gnss import satellite_paths as module
from mmw.sensors.gnss.code_tracking import CARRIER_HZ, SignalPaths
from mmw.sensors.gnss.satellite_paths import Sightings, channel_config, satellite_paths, signal_paths
from tests.fixtures.scenes import arrays_from_parts, box_part, wall_part

PLACE = np.array([3.0, 2.0, 2.0])
WALL_Y = 14.0
MIRRORS = {"physics": "paper", "max_depth": 1, "samples_per_tx": 20_000}


def toward(azimuth_deg: float, elevation_deg: float) -> np.ndarray:
    """Return the direction of an azimuth, clockwise from north, and an elevation."""
    azimuth, elevation = np.radians([azimuth_deg, elevation_deg])
    across = np.cos(elevation)
    return np.array([across * np.sin(azimuth), across * np.cos(azimuth), np.sin(elevation)])


def wall() -> SceneData:
    """Return a wall 12 m to the north of the receiver, 400 m wide and 200 m high, that faces it."""
    return arrays_from_parts([wall_part("north", (-200.0, WALL_Y), (200.0, WALL_Y), 200.0)])


def traced(arrays: SceneData, config: Gnss, directions: list[np.ndarray]) -> tuple[PathSet, SignalPaths, np.ndarray]:
    """Return the paths of satellites in some directions to a level receiver, and what arrives."""
    scene = DeviceScene(arrays, "cpu", 1)
    scene.load_batch([0])
    pose = np.array([[*PLACE, 0, 0, 0, 1.0]])
    zero = np.zeros(1, dtype=np.int32)
    views = Views(np.zeros(1, dtype=np.int64), zero, zero, pose, zero - 1)
    count = len(directions)
    sightings = Sightings(np.zeros(count, dtype=np.int64), np.arange(count), np.array(directions))
    table = make_surface_table(scene, **channel_config(config).surface_options)
    materials = arrays.materials
    paths = satellite_paths(scene, views, np.array([[4.0, -3.0, 0.5]]), sightings, config, materials, table)
    return paths, *signal_paths(paths, "sunny", views, sightings, config)


def concrete_reflection(cosine: float) -> tuple[complex, complex]:
    """Return TE and TM coefficients of concrete at L1: ITU-R P.2040, 5.24 and 0.0462 f^0.7822 S/m, f in GHz."""
    permittivity = 5.24 - 17.98j * 0.0462 * (CARRIER_HZ / 1e9) ** 0.7822 / (CARRIER_HZ / 1e9)
    root = np.sqrt(permittivity - 1.0 + cosine**2)
    return (cosine - root) / (cosine + root), (permittivity * cosine - root) / (permittivity * cosine + root)


@pytest.mark.parametrize(("azimuth", "elevation"), [(180.0, 35.0), (215.0, 20.0), (130.0, 60.0)])
def test_one_wall_by_the_image_method(azimuth: float, elevation: float) -> None:
    direction = toward(azimuth, elevation)
    config = Gnss(mode="ray_traced", axial_ratio_db=0.0, **MIRRORS)
    _, found, is_los = traced(wall(), config, [direction])
    assert is_los.tolist() == [True] and found.count.tolist() == [2]
    direct, reflected = np.argsort(found.excess)
    assert abs(found.excess[direct]) < 1e-9
    assert found.excess[reflected] == pytest.approx(2.0 * (WALL_Y - PLACE[1]) * -direction[1], abs=1e-5)
    # The wall sends back what a receiver 12 m behind it would have: its normal velocity counts twice the other way.
    velocity = np.array([4.0, -3.0, 0.5])
    rates = -velocity @ direction, -(velocity * [1, -1, 1]) @ direction
    np.testing.assert_allclose(found.range_rate[[direct, reflected]], rates, atol=0.02)
    # Right-handed waves stay so by the mean of both coefficients, with opposite signs at normal incidence.
    te, tm = concrete_reflection(abs(direction[1]))
    gain = 0.5 * (1.0 + direction[2])  # the reflection comes from the same elevation
    assert abs(found.amplitude[direct]) == pytest.approx(gain, rel=1e-4)
    # 2e-3: seen from 50 km the wall turns the wave 5e-4 rad less than a plane wave.
    assert abs(found.amplitude[reflected]) == pytest.approx(gain * abs(te + tm) / 2.0, rel=2e-3)
    # The left-handed part of an antenna takes the rest, by its axial ratio.
    _, mixed, _ = traced(wall(), config.model_copy(update={"axial_ratio_db": 6.0}), [direction])
    cross = (10.0**0.3 - 1.0) / (10.0**0.3 + 1.0)
    added = np.abs(mixed.amplitude - found.amplitude)
    assert added[reflected] == pytest.approx(cross * gain * abs(te - tm) / 2.0, rel=2e-3)
    assert added[direct] < 1e-4  # the line of sight is right-handed
    assert -20.0 * np.log10(cross) == pytest.approx(9.6, abs=0.1)


def test_blocked_satellites_arrive_over_the_wall_alone() -> None:
    block = box_part("Buildings/south", (200.0, 4.0, 20.0), (0.0, -6.0, 10.0), "concrete_facade", "building")
    arrays = arrays_from_parts([wall_part("north", (-200.0, WALL_Y), (200.0, WALL_Y), 200.0), block])
    low, high = toward(180.0, 50.0), toward(180.0, 85.0)
    _, found, is_los = traced(arrays, Gnss(mode="ray_traced", **MIRRORS), [low, high])
    assert is_los.tolist() == [False, True] and found.count.tolist() == [1, 2]
    assert found.excess[0] == pytest.approx(24.0 * np.cos(np.radians(50.0)), abs=1e-5)


def test_diffraction_lights_the_shadow_of_a_roof() -> None:
    """Behind the edge of a screen the field is half of the free one on the boundary, and falls in the shadow."""
    block = box_part("Buildings/south", (400.0, 4.0, 40.0), (0.0, -20.0, 20.0), "concrete_facade", "building")
    arrays = arrays_from_parts([block])
    edge = np.degrees(np.arctan2(40.0 - PLACE[2], 18.0 + PLACE[1]))  # of the near roof edge
    directions = [toward(180.0, edge + bend) for bend in (-0.01, -1.0, -3.0, -8.0)]
    config = Gnss(mode="ray_traced", max_depth=1, samples_per_tx=5000)
    _, found, is_los = traced(arrays, config, directions)
    assert not is_los.any() and found.count.tolist() == [1, 1, 1, 1]
    gain = 0.5 * (1.0 + np.array(directions)[:, 2])
    level = 20.0 * np.log10(np.abs(found.amplitude) / gain)
    assert level[0] == pytest.approx(-6.0, abs=0.6)
    assert (np.diff(level) < -2.0).all() and level[-1] < -15.0


def test_lengths_do_not_depend_on_the_distance(monkeypatch: pytest.MonkeyPatch) -> None:
    """Lengths of plane waves at depth 2, and amplitudes, with satellites at 20 and at 100 km."""
    parts = [wall_part("north", (-200.0, WALL_Y), (200.0, WALL_Y), 100.0)]
    parts.append(wall_part("south", (200.0, -9.0), (-200.0, -9.0), 20.0))
    directions = [toward(azimuth, elevation) for azimuth in (170.0, 200.0) for elevation in (55.0, 66.0)]
    results = []
    for distance in (20e3, 50e3, 100e3):
        monkeypatch.setattr(module, "DISTANCE_M", distance)
        config = Gnss(mode="ray_traced", physics="paper", max_depth=2, samples_per_tx=20_000)
        results.append(traced(arrays_from_parts(parts), config, directions)[1])
    near, usual, far = results
    assert usual.count.tolist() == [2, 2, 2, 2]  # one and two reflections, and a line of sight with one
    for other in (near, far):
        np.testing.assert_array_equal(other.count, usual.count)
        np.testing.assert_allclose(other.excess, usual.excess, atol=2e-3)
        np.testing.assert_allclose(np.abs(other.amplitude), np.abs(usual.amplitude), rtol=5e-3)
