"""Arrays with elements anywhere: as planar ones where they are alike, spherical waves elsewhere, and errors."""

import json
from dataclasses import asdict

import numpy as np
import pytest

from mmw.channel import AntennaArray, PlanarArray, apply_arrays, dft_codebook, per_element_links, plane_wave_error, upa
from mmw.channel.antennas.arrays import ElementArray
from mmw.channel.links import make_links
from mmw.core.constants import SPEED_OF_LIGHT
from tests.fixtures.path_tables import CARRIER, random_turns, sight
from tests.fixtures.scenes import ground_part
from tests.oracles.channel import channel, link_scene

WAVE = SPEED_OF_LIGHT / CARRIER


def like(array: PlanarArray, unit: str) -> AntennaArray:
    """Return the same array by the places of its elements."""
    places = PlanarArray(array.num_rows, array.num_cols).element_positions(CARRIER)
    where = {"positions": places / WAVE} if unit == "wavelengths" else {"positions_m": places}
    names = ("pattern", "polarization", "polarization_model", "orientation")
    return AntennaArray(**where, **{name: getattr(array, name) for name in names})


def ring(count: int, radius: float) -> np.ndarray:
    angle = 2 * np.pi * np.arange(count) / count
    return radius * np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)


@pytest.mark.parametrize("unit", ["wavelengths", "m"])
@pytest.mark.parametrize("polarization", ["V", "cross"])
def test_elements_of_a_planar_array_by_their_places(unit: str, polarization: str) -> None:
    planar = upa(3, 4, pattern="tr38901", polarization=polarization, orientation=(0.3, -0.2, 0.1))
    own = like(planar, unit)
    assert (own.element_count, own.antenna_count) == (planar.element_count, planar.antenna_count)
    np.testing.assert_allclose(own.element_positions(CARRIER), planar.element_positions(CARRIER), atol=1e-16)
    assert own.aperture_m(CARRIER) == pytest.approx(planar.aperture_m(CARRIER), rel=1e-14)
    assert plane_wave_error(own, 10.0, CARRIER, planar) == pytest.approx(
        plane_wave_error(planar, 10.0, CARRIER, planar), rel=1e-14
    )
    rng = np.random.default_rng(1)
    paths = sight(rng.normal(0, 5, (20, 3)), rng.normal(0, 50, (20, 3)))
    turns = [random_turns(rng, 20) for _ in range(2)]
    a, b = (apply_arrays(paths, array, array, CARRIER, *turns) for array in (own, planar))
    np.testing.assert_allclose(a, b, atol=1e-13 * np.abs(b).max())


def test_wavelengths_follow_the_carrier_and_meters_do_not() -> None:
    half, fixed = AntennaArray(positions=ring(6, 0.5)), AntennaArray(positions_m=ring(6, 0.02))
    for carrier in (3.5e9, 28e9):
        np.testing.assert_allclose(half.element_positions(carrier), ring(6, 0.5 * SPEED_OF_LIGHT / carrier), atol=1e-17)
        np.testing.assert_array_equal(fixed.element_positions(carrier), ring(6, 0.02))
    assert fixed.aperture_m(28e9) == pytest.approx(0.04)
    assert AntennaArray(positions=[[0, 0, 0]]).aperture_m(28e9) == 0.0


def test_a_ring_is_within_the_plane_wave_error_of_spherical_waves() -> None:
    rng = np.random.default_rng(3)
    array, single = AntennaArray(positions=ring(16, 2.0), pattern="iso"), PlanarArray(pattern="iso")
    away = rng.normal(size=(30, 3))
    away *= (rng.uniform(2, 20, 30) / np.linalg.norm(away, axis=1))[:, None]
    tx = rng.normal(0, 1, (30, 3))
    paths, turn = sight(tx, tx + away), random_turns(rng, 30)
    elements = tx[:, None] + np.einsum("pij,nj->pni", turn, array.element_positions(CARRIER))
    r = np.linalg.norm((tx + away)[:, None] - elements, axis=2)
    gain = apply_arrays(paths, array, single, CARRIER, turn, wavefront="plane")[:, 0]
    gain = gain * np.exp(-2j * np.pi * CARRIER * paths.tau)[:, None]
    alone = apply_arrays(paths, single, single, CARRIER, turn)[:, 0]  # its polarization
    phase = np.abs(np.angle(gain / alone * np.exp(2j * np.pi * r / WAVE)))
    bound = plane_wave_error(array, paths.tau * SPEED_OF_LIGHT, CARRIER)
    assert (phase.max(axis=1) <= bound * (1 + 1e-6)).all() and phase.max() > 0.05 * bound.max()


def test_every_element_is_a_link() -> None:
    config = channel(carriers_hz=(CARRIER,))
    arrays = link_scene([ground_part(50.0)], (0.0, 0.0, 8.0), (30.0, 2.0, 1.5))
    links = make_links(arrays, [0], config)
    array = AntennaArray(positions=ring(5, 1.0), orientation=(0.0, 0.0, 0.0))
    expanded, link, rx_element, tx_element = per_element_links(links, array, PlanarArray(), CARRIER)
    assert len(expanded) == 5 * len(links) and set(tx_element.tolist()) == set(range(5)) and not rx_element.any()
    np.testing.assert_allclose(
        expanded.tx.position - links.tx.position[link], array.element_positions(CARRIER)[tx_element], atol=1e-15
    )


def test_an_array_is_a_key_and_json() -> None:
    one, same = AntennaArray(positions=ring(3, 1.0)), AntennaArray(positions=ring(3, 1.0).tolist())
    assert one == same and len({one, same, AntennaArray(positions_m=ring(3, 1.0))}) == 2
    assert json.loads(json.dumps(asdict(one)))["positions"][0] == [1.0, 0.0, 0.0]
    assert isinstance(one, ElementArray) and isinstance(PlanarArray(), ElementArray)
    with pytest.raises(TypeError):
        ElementArray()  # pyright: ignore[reportAbstractUsage]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({}, "positions and positions_m are both given or both missing; give one"),
        ({"positions": [[0, 0, 0]], "positions_m": [[0, 0, 0]]}, "positions and positions_m are both given"),
        ({"positions": []}, "positions hold no element; at least one is needed"),
        ({"positions_m": np.zeros((0, 3))}, "positions_m hold no element"),
        ({"positions": [0.0, 1.0, 2.0]}, r"positions of shape \(3,\); finite numbers of shape \[elements, 3\]"),
        ({"positions": [[0.0, 1.0]]}, r"positions of shape \(1, 2\)"),
        ({"positions": [[0.0, np.nan, 0.0]]}, r"positions of shape \(1, 3\); finite numbers"),
        ({"positions": [["a", 0.0, 0.0]]}, "positions are no numbers of shape"),
        ({"positions": [[0.0, 0.0], [1.0]]}, "positions are no numbers of shape"),
        ({"positions": [[0, 0, 0]], "pattern": "mine"}, "pattern = 'mine'; one of iso, dipole"),
        ({"positions": [[0, 0, 0]], "pattern": 7}, "pattern = 7; one of iso, dipole"),
        ({"positions": [[0, 0, 0]], "orientation": (0.0, 1.0)}, "orientation"),
    ],
)
def test_errors(change: dict, message: str) -> None:
    with pytest.raises(ValueError, match=f"antenna array: {message}"):
        AntennaArray(**change)


def test_a_codebook_needs_rows_and_columns() -> None:
    with pytest.raises(ValueError, match="an AntennaArray has no rows and columns; a PlanarArray is needed"):
        dft_codebook(AntennaArray(positions=ring(4, 1.0)))  # pyright: ignore[reportArgumentType]
