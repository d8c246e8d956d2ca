"""Far fields of arrays on the device against `antenna_field`, for patterns of every kind."""

import numpy as np
import pytest
import warp as wp

from mmw.channel.antennas.arrays import PlanarArray
from mmw.channel.antennas.patterns import Pattern, PatternTable, antenna_field
from mmw.channel.radio_map.solver import map_sources
from mmw.channel.radio_map.transmitters import Transmitters
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.kernels.channel.transmitted_field import MapSources, transmitted_field
from mmw.physics.em.vectors import direction_angles, spherical_basis, unit_vector
from tests.fixtures.device_rays import loaded
from tests.fixtures.path_tables import random_turns
from tests.fixtures.scenes import arrays_from_parts

CARRIER = 28e9


@wp.kernel
def field_kernel(
    sources: MapSources,
    direction: wp.array[wp.vec3d],
    real_out: wp.array[wp.vec3d],
    imag_out: wp.array[wp.vec3d],
):
    """Give the field of the second transmitter. Launch: dim=N."""
    i = wp.tid()
    field = transmitted_field(sources, 1, direction[i])
    real_out[i] = field.real
    imag_out[i] = field.imag


def tables() -> dict[str, PatternTable]:
    rng = np.random.default_rng(4)
    theta = np.pi * np.concatenate([[0.0], np.sort(rng.uniform(0.05, 0.95, 11)), [1.0]])
    phi = np.linspace(-2.0, 4.28, 17, endpoint=False) + rng.uniform(-0.05, 0.05, 17)
    values = 20.0 * (rng.normal(size=(2, 13, 17)) + 1j * rng.normal(size=(2, 13, 17)))
    return {
        "complex": PatternTable(theta, phi, values[0], values[1]),
        "real": PatternTable(theta, phi, values[0].real),
        "round": PatternTable(theta, np.array([0.3]), values[0][:, :1]),
    }


def smooth(theta: np.ndarray, phi: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return a pattern of both components with a turning phase, 20 dBi at most."""
    return 10.0 * np.sin(theta) ** 2 * np.exp(1j * np.cos(phi)), 3j * np.sin(theta) * np.sin(phi)


PATTERNS: dict[str, tuple[Pattern, float]] = {
    **{name: (name, 3e-7) for name in ("iso", "dipole", "tr38901")},
    "hw_dipole": ("hw_dipole", 1e-5),
    **{name: (table, 1e-12) for name, table in tables().items()},
    "function": (smooth, 1e-5),
}
"""Name -> pattern, and the largest error of one element relative to the strongest field."""

ARRAY_ERROR = 1e-6
"""Error that the phases of an array add: 2 pi, the beam width of `tr38901` and the pi / 2 of `hw_dipole`, which counts
most near its axis, have 24 bits in the kernel."""


@pytest.mark.parametrize("shape", [(1, 1), (2, 3)])
@pytest.mark.parametrize(("polarization", "model"), [("V", "tr38901_2"), ("cross", "tr38901_1"), (0.7, "tr38901_2")])
@pytest.mark.parametrize("name", PATTERNS)
def test_field_of_an_array(name: str, polarization, model, shape, device: str) -> None:
    pattern, tolerance = PATTERNS[name]
    rng = np.random.default_rng(8)
    array = PlanarArray(
        *shape, 0.6, 0.5, pattern=pattern, polarization=polarization, polarization_model=model,
        orientation=(0.3, -0.2, 1),
    )  # fmt: skip
    weight = rng.normal(size=(2, array.antenna_count)) + 1j * rng.normal(size=(2, array.antenna_count))
    weight /= np.linalg.norm(weight, axis=1)[:, None]
    rotation = random_turns(rng, 2)
    tx = Transmitters(("a", "b"), np.zeros((2, 3)), rotation, np.zeros(2), array)
    sources, peak = map_sources(loaded(arrays_from_parts([]), device), tx, np.arange(2), array, weight, CARRIER)
    turn = rotation[1] @ array.rotation
    local = rng.normal(size=(400, 3))
    local /= np.linalg.norm(local, axis=1)[:, None]
    grid = np.meshgrid(np.linspace(0, np.pi, 13), np.linspace(-np.pi, np.pi, 9))  # poles, axes and the seam
    local = np.concatenate([local, unit_vector(grid[0].ravel(), grid[1].ravel())])
    direction = local @ turn.T
    outputs = [wp.zeros(len(direction), dtype=wp.vec3d, device=device) for _ in range(2)]
    inputs = [sources, wp.array(direction, dtype=wp.vec3d, device=device)]
    wp.launch(field_kernel, dim=len(direction), inputs=inputs, outputs=outputs, device=device)
    found = peak * (outputs[0].numpy() + 1j * outputs[1].numpy())

    field = antenna_field(direction, np.tile(turn, (len(direction), 1, 1)), pattern, polarization, model)
    offset = array.element_positions(CARRIER)[: array.element_count] @ rotation[1].T
    phase = np.exp(2j * np.pi * CARRIER / SPEED_OF_LIGHT * direction @ offset.T)
    parts = np.einsum("psx,pe,se->px", field, phase, weight[1].reshape(-1, array.element_count))
    basis = spherical_basis(*direction_angles(direction))
    expected = parts[:, :1] * basis[0] + parts[:, 1:] * basis[1]
    away = np.abs(local[:, 2]) < 1 - 1e-12  # at the pole itself the azimuth is rounding
    error = np.abs(found - expected)[away].max() / np.abs(expected).max()
    assert error < tolerance + (ARRAY_ERROR if array.element_count > 1 else 0.0)
    assert np.isfinite(found).all()
