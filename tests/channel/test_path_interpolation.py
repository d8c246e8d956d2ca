"""Interpolation between two frames: the cubic, and transfers whose bases swing about the zenith, in closed form."""

from dataclasses import replace

import numpy as np
import pytest

from mmw.channel.path_interpolation import cubic_between
from mmw.channel.path_table import CarrierPaths
from mmw.channel.path_tracks import tracks_from_rows
from mmw.core.constants import FRAME_DT, SPEED_OF_LIGHT
from mmw.physics.em.vectors import spherical_basis
from tests.fixtures.path_tables import CARRIER, basis, sight


def test_cubic_is_exact_for_cubics() -> None:
    cubic, s = np.polynomial.Polynomial([2.0, -1.0, 0.5, 3.0]), np.linspace(0, 1, 11)
    ends = [tuple(np.full(11, p(x)) for x in (0.0, 1.0)) for p in (cubic, cubic.deriv())]
    for found, expected in zip(cubic_between(ends[0], ends[1], s), (cubic(s), cubic.deriv()(s)), strict=True):
        np.testing.assert_allclose(found, expected, rtol=1e-13)


def mirrored(frames: np.ndarray, offset_m: float) -> CarrierPaths:
    """Return the reflection at a tilted perfect mirror under a mast, in closed form: E goes to 2 (n . E) n - E."""
    normal = np.array([np.sin(0.1), 0.0, np.cos(0.1)])
    mirror = 2 * np.outer(normal, normal) - np.eye(3)
    tx = np.array([0.0, 0.0, 8.0])
    rx = np.stack([-4.05 + 20 * frames * FRAME_DT, np.full(len(frames), offset_m), np.full(len(frames), 1.5)], axis=1)
    unit = rx + mirror @ tx  # from the transmitter's image, -mirror tx
    length = np.linalg.norm(unit, axis=1)
    arrive = unit / length[:, None]
    theta_t, phi_t, *out = basis(-arrive @ mirror)
    theta_r, phi_r, *back = basis(-arrive)
    scale = SPEED_OF_LIGHT / CARRIER / (4 * np.pi * length)
    transfer = np.array([[np.einsum("pi,ij,pj->p", b, mirror, o) for o in out] for b in back]).transpose(2, 0, 1)
    angles = {"theta_t": theta_t, "phi_t": phi_t, "theta_r": theta_r, "phi_r": phi_r}
    rows = replace(sight(np.zeros_like(rx), rx), tau=length / SPEED_OF_LIGHT, **angles)
    doppler = -CARRIER / SPEED_OF_LIGHT * 20 * arrive[:, 0]
    return replace(rows, transfer=scale[:, None, None] * transfer + 0j, doppler_hz=doppler)


def world(rows: CarrierPaths) -> np.ndarray:
    """Return transfers between fields in world axes, which have no zenith, shape [P, 3, 3]."""
    ends = ((rows.theta_r, rows.phi_r), (rows.theta_t, rows.phi_t))
    bases = [np.stack(spherical_basis(*angles), axis=-1) for angles in ends]
    return bases[0] @ rows.transfer @ bases[1].swapaxes(1, 2)


@pytest.mark.parametrize("offset_m", [0.0, 1e-3, 0.3])
def test_under_a_mast(offset_m: float) -> None:
    """Azimuths jump by pi, or swing, where a direction passes the zenith, and entries of the transfer with them."""
    stored, exact = mirrored(np.arange(41), offset_m), mirrored(np.arange(40) + 0.5, offset_m)
    found = tracks_from_rows(stored, np.zeros(41, dtype=np.int64)).at((np.arange(40) + 0.5) * FRAME_DT)
    plain = replace(exact, transfer=0.5 * (stored.transfer[1:] + stored.transfer[:-1]))
    field, *others = (world(rows) for rows in (exact, found, plain))
    errors = [np.linalg.norm(other - field, axis=(1, 2)) / np.linalg.norm(field, axis=(1, 2)) for other in others]
    assert errors[0].max() < 1e-4 and errors[1].max() > 0.02
    assert np.abs(2 * np.pi * CARRIER * (found.tau - exact.tau)).max() < 1e-3
