"""Closed forms of radio maps, and how far a map may be from them."""

import numpy as np
import pytest

from mmw.channel.antennas.arrays import PlanarArray
from mmw.channel.radio_map.measurement_surface import MeasurementSurface
from mmw.channel.radio_map.radio_map import RadioMap, RadioMapConfig
from mmw.channel.radio_map.solver import solve_radio_map
from mmw.channel.radio_map.transmitters import Transmitters
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


def trace(arrays: SceneData, device: str, tx: Transmitters, surface: MeasurementSurface, **config) -> RadioMap:
    scene = loaded(arrays, device, [arrays.frames[0]])
    settings = RadioMapConfig(**{"carrier_hz": CARRIER, "samples_per_tx": 400_000, **config})
    return solve_radio_map(scene, 0, tx, surface, settings, arrays.materials["sunny"])


def cell_mean(surface: MeasurementSurface, function, steps: int = 6) -> np.ndarray:
    """Return the mean of a function of points [C, 3] over flat cells, by the midpoint rule."""
    a, b, d = surface.corners[:, 0], surface.corners[:, 1], surface.corners[:, 3]
    at = (np.arange(steps) + 0.5) / steps
    return np.mean([function(a + u * (b - a) + v * (d - a)) for u in at for v in at], axis=0)


def poisson(result: RadioMap, gain: np.ndarray, most: float | np.ndarray) -> np.ndarray:
    """Return the standard deviation that independent rays would give, |E|^2 / cos(theta) <= `most`, shape of `gain`.

    A gain is a sum of shares u |E|^2 / cos(theta), u = (lambda / 4 pi)^2 4 pi / (N A). Of independent rays its variance
    is the sum of the squared shares, at most u `most` gain. A lattice fills the sphere more evenly than that.
    """
    wavelength = SPEED_OF_LIGHT / result.config.carrier_hz
    share = (wavelength / (4 * np.pi)) ** 2 * 4 * np.pi / result.config.samples_per_tx / result.surface.area
    return np.sqrt(share * most * gain)


def check(result: RadioMap, expected: np.ndarray, most: float | np.ndarray, sum_error: float = 2e-3) -> None:
    """Compare one transmitter's map to a closed form: each cell to three standard deviations, and the sum."""
    gain = result.path_gain[0]
    assert (np.abs(gain - expected) <= 3 * poisson(result, expected, most)).all()
    assert gain.sum() == pytest.approx(expected.sum(), rel=sum_error)


def coefficients(eta: complex, cosine: np.ndarray, thickness: float) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Return (R, T) for `V` over level ground (TM) and `H` (TE). Source: ITU-R P.2040-4, equations 37, 43, 44."""
    inner = np.sqrt(eta - 1 + cosine**2 + 0j)
    once = np.exp(-2j * np.pi * thickness / WAVELENGTH * inner) if thickness else np.zeros_like(inner)
    result = {}
    for name, r in (("H", (cosine - inner) / (cosine + inner)), ("V", (eta * cosine - inner) / (eta * cosine + inner))):
        below = 1 - r**2 * once**2
        result[name] = r * (1 - once**2) / below, (1 - r**2) * once / below
    return result
