"""A radio map is the sum of the paths of links: at the middles of 1,000 cells, in every weather, with every option."""

import numpy as np
import pytest

import mmw
from mmw.channel import MeasurementSurface, PlanarArray, RadioMapSolver, plane_grid
from mmw.channel.path_solver.path_solver import PathSolver
from mmw.physics.weather.weather import PRESETS
from mmw.scene.radio_devices import Receiver, Transmitter
from mmw.scene.scene import Scene
from tests.fixtures.scenes import two_cars

CARRIER = 28e9
ARRAY = PlanarArray(2, 2, pattern="tr38901", polarization="cross")


def some_cells(surface: MeasurementSurface, count: int) -> MeasurementSurface:
    """Return `count` random cells."""
    rows = np.random.default_rng(5).choice(len(surface), count, replace=False)
    return MeasurementSurface(surface.corners[rows])


def power_of_paths(scene: Scene, points: np.ndarray, options: dict, weather: str) -> np.ndarray:
    """Return the power of all paths from each transmitter to isotropic receivers of both polarizations, [T, N]."""
    for name in list(scene.receivers):
        scene.remove(name)
    scene.rx_array = PlanarArray(pattern="iso", polarization="VH")
    for number, point in enumerate(points):
        scene.add(Receiver(f"rx_{number}", position=point))
    paths = PathSolver(check_places=False, **options)(scene, carriers_hz=CARRIER, weathers=[weather])[weather]
    a, _ = paths.cir()  # [rx, 2, tx, antennas, paths, 1]
    arriving = a[..., 0].sum(axis=3) * a.shape[3] ** -0.5
    return (np.abs(arriving) ** 2).sum(axis=(1, 3)).T


def check_same(scene: Scene, surface: MeasurementSurface, options: dict) -> dict[str, np.ndarray]:
    """Check that a map has the power of the paths in every weather, and return the maps by weather."""
    maps = {}
    for weather in scene.weathers:
        result = RadioMapSolver(**options)(scene, carrier_hz=CARRIER, surface=surface, weather=weather)
        maps[weather] = result.path_gain
        np.testing.assert_allclose(
            result.path_gain, power_of_paths(scene, surface.center, options, weather), rtol=1e-9, atol=1e-30
        )
    return maps


def street() -> Scene:
    """Return a canyon with cars and two transmitters."""
    weathers = {name: PRESETS[name] for name in ("sunny", "rainy")}
    arrays = two_cars(2)
    arrays.materials.setdefault("rainy", arrays.materials["sunny"])
    scene = Scene(arrays, weathers, device="cpu")
    scene.tx_array = ARRAY
    scene.add(Transmitter("bs", position=(-30.0, 6.0, 8.0), orientation=(0, 0, 0.2, 1)))
    scene.add(Transmitter("other", position=(30.0, 0.0, 5.0), orientation=(0, 0, 1, 0.1)))
    return scene


@pytest.mark.parametrize(
    "options",
    [
        {"max_depth": 3, "samples_per_tx": 30_000},
        {"max_depth": 2, "refraction": True, "candidates": "exhaustive"},
        {"max_depth": 2, "diffraction": True, "refraction": True, "samples_per_tx": 2_000},
        {"max_depth": 1, "diffraction": True, "diffraction_lit_region": False, "los": False},
        {"max_depth": 1, "finite_surfaces": True, "samples_per_tx": 30_000},
        {"max_depth": 1, "diffuse_reflection": True, "diffuse_samples": 100, "specular_reflection": False},
        {"max_depth": 1, "diffuse_reflection": True, "diffuse_error_db": 3.0, "specular_reflection": False},
    ],
    ids=["reflections", "exhaustive", "diffraction", "shadow", "finite", "diffuse", "diffuse by error"],
)
def test_a_map_is_the_sum_of_the_paths_in_sun_and_rain(options: dict) -> None:
    surface = some_cells(plane_grid((0.0, 0.0, 1.5), (90.0, 40.0), 1.0), 1000)
    maps = check_same(street(), surface, options)
    assert (maps["sunny"] > 0).mean() > 0.3
    assert (maps["rainy"][maps["sunny"] > 0] < maps["sunny"][maps["sunny"] > 0]).all()


@pytest.mark.slow
@pytest.mark.parametrize(
    "options",
    [
        {"max_depth": 2, "refraction": True, "samples_per_tx": 200_000},
        {"max_depth": 1, "diffraction": True},
        {"max_depth": 1, "finite_surfaces": True, "foliage": True, "samples_per_tx": 200_000},
    ],
    ids=["reflections", "diffraction", "finite surfaces and foliage"],
)
def test_a_map_of_a_town_is_the_sum_of_the_paths(options: dict) -> None:
    scene = mmw.load_scene("town03", weather=["sunny", "rainy"], device="cpu")
    scene.tx_array = ARRAY
    scene.add(Transmitter("bs", position=(13.5, -29.5, 10.0), orientation=(0, 0, 0.84, 0.54)))
    surface = some_cells(plane_grid((13.5, -29.5, 1.5), (200.0, 200.0), 2.0), 1000)
    maps = check_same(scene, surface, options)
    is_reached = maps["sunny"] > 0
    ratio = maps["rainy"][is_reached] / maps["sunny"][is_reached]
    assert len(ratio) > 300 and 0.1 < ratio.min() < 0.99
