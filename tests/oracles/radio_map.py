"""Closed forms of radio maps."""

import numpy as np

from mmw.channel.antennas.arrays import PlanarArray
from mmw.channel.radio_map.measurement_surface import MeasurementSurface
from mmw.channel.radio_map.radio_map import RadioMap, RadioMapConfig
from mmw.channel.radio_map.solver import solve_radio_map
from mmw.channel.radio_map.transmitters import Transmitters
from mmw.config import ChannelConfig
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.physics.materials.material import Material, RadioMaterial
from mmw.scene.scene_data import SceneData
from tests.fixtures.device_rays import loaded

CARRIER = 28e9
WAVELENGTH = SPEED_OF_LIGHT / CARRIER
UNIT = (WAVELENGTH / (4 * np.pi)) ** 2
UPRIGHT = (0.5, 0.5, 0.5, 0.5)
"""Orientation of a plane across the x axis: its x is the world's y, its y the world's z."""


def constant(name: str, eps_r: float, sigma: float, thickness: float, scattering: float = 0.0) -> Material:
    radio = RadioMaterial(
        "constant", relative_permittivity=eps_r, conductivity=sigma, thickness=thickness, scattering=scattering
    )
    return Material(name, radio, "none", 0.3, (0.5, 0.5, 0.5))


def isotropic(*positions: list[float], polarization: str = "V", power: float = 44.0) -> Transmitters:
    count = len(positions)
    return Transmitters(
        tuple(f"tx_{i}" for i in range(count)), np.array(positions, dtype=float), np.tile(np.eye(3), (count, 1, 1)),
        np.full(count, power), PlanarArray(pattern="iso", polarization=polarization),
    )  # fmt: skip


def trace(arrays: SceneData, device: str, tx: Transmitters, surface: MeasurementSurface, **options) -> RadioMap:
    """Return a map in sunny air without losses; `options` of `ChannelConfig`, and `points_per_cell`."""
    scene, points = loaded(arrays, device, [arrays.frames[0]]), options.pop("points_per_cell", 1)
    channel = ChannelConfig(**{"carriers_hz": (CARRIER,), "samples_per_tx": 100_000, "max_depth": 3, **options})
    return solve_radio_map(scene, 0, tx, surface, RadioMapConfig(channel, points), arrays.materials["sunny"])


def cell_mean(surface: MeasurementSurface, function, steps: int = 1) -> np.ndarray:
    """Return the mean of a function of points [C, 3] over flat cells, by the midpoint rule."""
    a, b, d = surface.corners[:, 0], surface.corners[:, 1], surface.corners[:, 3]
    at = (np.arange(steps) + 0.5) / steps
    return np.mean([function(a + u * (b - a) + v * (d - a)) for u in at for v in at], axis=0)


def check(result: RadioMap, expected: np.ndarray, rtol: float = 1e-9) -> None:
    """Compare one transmitter's map to a closed form."""
    np.testing.assert_allclose(result.path_gain[0], expected, rtol=rtol, atol=0.0)


def coefficients(eta: complex, cosine: np.ndarray, thickness: float) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return (R, T) for `V` over level ground (TM) and `H` (TE). Source: ITU-R P.2040-4, equations 37, 43, 44."""
    inner = np.sqrt(eta - 1 + cosine**2 + 0j)
    once = np.exp(-2j * np.pi * thickness / WAVELENGTH * inner) if thickness else np.zeros_like(inner)
    result = {}
    for name, r in (("H", (cosine - inner) / (cosine + inner)), ("V", (eta * cosine - inner) / (eta * cosine + inner))):
        below = 1 - r**2 * once**2
        result[name] = r * (1 - once**2) / below, (1 - r**2) * once / below
    return result
