"""Arrays and their response on paths, against per-element spherical waves, symmetries and Sionna RT."""

import numpy as np
import pytest

from mmw.channel import CarrierPaths, PlanarArray, apply_arrays, plane_wave_error, ula, upa
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.transforms import quaternion_from_ypr
from tests.fixtures.path_tables import CARRIER, random_turns, sight

WAVE = SPEED_OF_LIGHT / CARRIER


def test_positions_and_order() -> None:
    array = PlanarArray(num_rows=2, num_cols=3, vertical_spacing=0.7, horizontal_spacing=0.5, polarization="VH")
    expected = [  # column by column from the one on the right of somebody who looks along x, each from its top
        [0, -0.5, 0.35], [0, -0.5, -0.35], [0, 0, 0.35], [0, 0, -0.35], [0, 0.5, 0.35], [0, 0.5, -0.35],
    ]  # fmt: skip
    np.testing.assert_allclose(array.element_positions(CARRIER) / WAVE, expected * 2, atol=1e-14)
    assert (array.element_count, array.polarization_count, array.antenna_count) == (6, 2, 12)
    assert array.aperture_m(CARRIER) == pytest.approx(WAVE * np.hypot(0.7, 1.0))
    line = ula(4).element_positions(CARRIER)
    np.testing.assert_allclose(line[:, 1] / WAVE, [-0.75, -0.25, 0.25, 0.75])
    assert not line[:, [0, 2]].any()
    assert upa(8, 4) == PlanarArray(num_rows=8, num_cols=4)
    np.testing.assert_array_equal(PlanarArray().element_positions(CARRIER), np.zeros((1, 3)))


def test_orientation_and_fixed_spacing() -> None:
    flat = ula(3, orientation=(0.0, 0.0, np.pi / 2))  # left side up: y goes to z
    np.testing.assert_allclose(
        flat.element_positions(CARRIER) / WAVE, [[0, 0, -0.5], [0, 0, 0], [0, 0, 0.5]], atol=1e-15
    )
    same = ula(3, orientation=tuple(quaternion_from_ypr(0.0, 0.0, np.pi / 2)))
    np.testing.assert_allclose(same.rotation, flat.rotation, atol=1e-15)
    wide = upa(2, 2, horizontal_spacing_m=0.02)
    for carrier in (4.9e9, CARRIER):
        vertical, horizontal = wide.spacing_m(carrier)
        assert horizontal == 0.02 and vertical == 0.5 * SPEED_OF_LIGHT / carrier


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"num_rows": 0}, "num_rows = 0"),
        ({"horizontal_spacing": 0.0}, "horizontal_spacing = 0.0"),
        ({"vertical_spacing_m": -1.0}, "vertical_spacing_m = -1.0"),
        ({"orientation": (0.0, 1.0)}, "orientation"),
        ({"orientation": (0.0, 0.0, 0.0, 0.0)}, "a rotation is needed; give"),
        ({"num_cols": float("nan")}, "num_cols = nan; a whole number from 1 on"),
        ({"polarization": "X"}, "polarization = 'X'"),
        ({"polarization": float("nan")}, "slant angles are finite"),
        ({"polarization_model": "mine"}, "'mine'; tr38901_1 or tr38901_2 is needed"),
        ({"pattern": "mine"}, "pattern = 'mine'; one of iso, dipole, hw_dipole, tr38901, a table or a function"),
    ],
)
def test_array_errors(change: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        PlanarArray(**change)


def test_single_isotropic_antennas_give_the_stored_transfer() -> None:
    """Row = receive, column = transmit component; a transfer that is not symmetric shows which is which."""
    rng = np.random.default_rng(6)
    paths = sight(rng.normal(0, 5, (20, 3)), rng.normal(0, 50, (20, 3)))
    paths = CarrierPaths(**{**vars(paths), "transfer": rng.normal(size=(20, 2, 2)) + 1j * rng.normal(size=(20, 2, 2))})
    iso, dual = PlanarArray(pattern="iso"), PlanarArray(pattern="iso", polarization="VH")
    np.testing.assert_allclose(apply_arrays(paths, iso, iso, CARRIER)[:, 0, 0], paths.transfer[:, 0, 0], atol=1e-14)
    np.testing.assert_allclose(apply_arrays(paths, dual, dual, CARRIER), paths.transfer, atol=1e-14)
    sent = apply_arrays(paths, dual, iso, CARRIER)
    np.testing.assert_allclose(sent, paths.transfer[:, :1], atol=1e-14)


def test_response_is_within_the_plane_wave_error_of_spherical_waves() -> None:
    """1x256 by 1x16, and a tilted 8x8 by 4x4, against lambda / (4 pi r) e^{-jkr} between every two elements."""
    rng = np.random.default_rng(7)
    for tx_array, rx_array, nearest in (
        (ula(256, pattern="iso"), ula(16, pattern="iso"), 40.0),
        (upa(8, 8, pattern="iso", orientation=(0.3, 0.2, 0.1)), upa(4, 4, pattern="iso"), 5.0),
    ):
        count = 12
        away = rng.normal(size=(count, 3))
        away[:, 2] *= 0.1
        away *= (nearest * rng.uniform(1, 5, count) / np.linalg.norm(away, axis=1))[:, None]
        tx = rng.normal(0, 1, (count, 3))
        paths = sight(tx, tx + away)
        turns = [random_turns(rng, count) for _ in range(2)]
        steered = {}
        for name, array, turn, points in (("t", tx_array, turns[0], tx), ("r", rx_array, turns[1], tx + away)):
            steered[name] = points[:, None] + np.einsum("pij,nj->pni", turn, array.element_positions(CARRIER))
        r = np.linalg.norm(steered["r"][:, :, None] - steered["t"][:, None], axis=3)
        exact = WAVE / (4 * np.pi * r) * np.exp(-2j * np.pi * r / WAVE)
        a = apply_arrays(paths, tx_array, rx_array, CARRIER, *turns, wavefront="plane")
        ends = [PlanarArray(pattern="iso", orientation=array.orientation) for array in (tx_array, rx_array)]
        polarization = (
            apply_arrays(paths, *ends, CARRIER, *turns)
            / (WAVE / (4 * np.pi * paths.tau * SPEED_OF_LIGHT))[:, None, None]
        )
        assert np.abs(polarization).max() <= 1 + 1e-12
        plane = a / polarization * np.exp(-2j * np.pi * CARRIER * paths.tau)[:, None, None]
        bound = plane_wave_error(tx_array, paths.tau * SPEED_OF_LIGHT, CARRIER, rx_array)
        worst = np.abs(np.angle(plane / exact)).max(axis=(1, 2))
        assert (worst <= bound * (1 + 1e-6)).all()
        assert worst.max() > 0.05 * bound.max()  # the bound is not a vacuous one
        assert np.abs(np.abs(plane / exact) - 1).max() < 0.05


def test_plane_wave_error_is_reached_and_halves_with_distance() -> None:
    array, r = ula(64), 30.0
    half = array.aperture_m(CARRIER) / 2
    cosine = half / (2 * r)  # k . d = d^2 / (2 r)
    spherical = np.sqrt(r**2 - 2 * r * half * cosine + half**2)
    error = 2 * np.pi / WAVE * (spherical - (r - half * cosine))
    assert plane_wave_error(array, r, CARRIER) == pytest.approx(error, rel=1e-9)
    np.testing.assert_allclose(plane_wave_error(array, [r, 2 * r], CARRIER), [error, error / 2], rtol=1e-9)
    fraunhofer = 2 * array.aperture_m(CARRIER) ** 2 / WAVE
    assert plane_wave_error(array, fraunhofer, CARRIER) == pytest.approx(np.pi / 8)
    with pytest.raises(ValueError, match="above 0 m"):
        plane_wave_error(array, 0.0, CARRIER)


def test_circular_antennas_receive_their_own_hand() -> None:
    """Reciprocity: two antennas of the same hand that face each other couple fully, those of opposite hands not."""
    paths = sight(np.zeros((1, 3)), np.array([[20.0, 0, 0]]))
    facing = np.diag([-1.0, -1.0, 1.0])
    right = PlanarArray(pattern=lambda theta, phi: (1j / np.sqrt(2), 1 / np.sqrt(2)))
    left = PlanarArray(pattern=lambda theta, phi: (-1j / np.sqrt(2), 1 / np.sqrt(2)))
    scale = np.abs(paths.transfer).max()
    assert np.abs(apply_arrays(paths, right, right, CARRIER, rx_rotation=facing)) == pytest.approx(scale)
    assert np.abs(apply_arrays(paths, right, left, CARRIER, rx_rotation=facing)) == pytest.approx(0, abs=1e-12 * scale)


def test_apply_arrays_errors() -> None:
    paths, one = sight(np.zeros((2, 3)), np.ones((2, 3))), PlanarArray()
    with pytest.raises(ValueError, match=r"carrier_hz = 4\.9e\+09, the paths are at 2\.8e\+10 Hz"):
        apply_arrays(paths, one, one, 4.9e9)
    with pytest.raises(ValueError, match=r"tx_rotation has shape \(3, 3, 3\).*L = 2 links"):
        apply_arrays(paths, one, one, CARRIER, np.zeros((3, 3, 3)))
    with pytest.raises(ValueError, match="rx_rotation holds a matrix that is no rotation"):
        apply_arrays(paths, one, one, CARRIER, None, np.ones((3, 3)))
