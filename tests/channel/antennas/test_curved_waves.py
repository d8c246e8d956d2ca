"""Waves of curved surfaces over arrays against Fermat's principle on spheres and cylinders."""

import numpy as np
import pytest
from scipy.optimize import minimize

from mmw.channel import CarrierPaths, PlanarArray, apply_arrays, ula
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.physics.em.interaction import SPECULAR
from tests.fixtures.path_tables import CARRIER, basis, random_turns, sight

WAVE = SPEED_OF_LIGHT / CARRIER
ISO = PlanarArray(pattern="iso")


def shortest(tx: np.ndarray, rx: np.ndarray, radius: float, is_ball: bool) -> tuple[np.ndarray, float]:
    """Return the point of reflection on a sphere, or a cylinder along z, around the origin, and the path's length."""

    def point(x: np.ndarray) -> np.ndarray:
        across = np.array([np.cos(x[0]), np.sin(x[0]), 0.0])
        if not is_ball:
            return radius * (across + x[1] * np.array([0.0, 0.0, 1.0]))
        return radius * (np.cos(x[1]) * across + np.sin(x[1]) * np.array([0.0, 0.0, 1.0]))

    def length(x: np.ndarray) -> float:
        p = point(x)
        return float(np.linalg.norm(p - tx) + np.linalg.norm(p - rx))

    middle = tx / np.linalg.norm(tx) + rx / np.linalg.norm(rx)
    start = np.array([np.arctan2(middle[1], middle[0]), 0.0])
    found = minimize(length, start, method="Nelder-Mead", options={"xatol": 1e-9, "fatol": 1e-15, "maxiter": 4000})
    return point(found.x), found.fun


def reflected(tx: np.ndarray, rx: np.ndarray, radius: float, is_ball: bool) -> CarrierPaths:
    """Return the path between two points."""
    point, length = shortest(tx, rx, radius, is_ball)
    normal = point / radius if is_ball else point * [1, 1, 0] / radius
    bend = (np.eye(3) - np.outer(normal, normal)) / radius
    if not is_ball:
        bend[2] = bend[:, 2] = 0.0
    out, back = sight(tx[None], point[None]), basis(((point - rx) / np.linalg.norm(point - rx))[None])
    return CarrierPaths(**{
        **vars(out), "tau": np.array([length / SPEED_OF_LIGHT]), "theta_r": back[0], "phi_r": back[1],
        "interaction": np.array([[SPECULAR]], dtype=np.int8), "vertex": point[None, None],
        "first_segment_m": np.array([np.linalg.norm(point - tx)]), "curvature": bend[[0, 0, 0, 1, 1, 2],
                                                                                    [0, 1, 2, 1, 2, 2]][None],
    })  # fmt: skip


@pytest.mark.parametrize(("radius", "is_ball"), [(0.1, False), (0.5, False), (8.0, False), (0.5, True), (8.0, True)])
def test_waves_are_those_of_every_element(radius: float, is_ball: bool) -> None:
    """An aperture of 1 x 256 at one end and of 1 x 16 at the other, as close as 10 m.

    The surface is known to second order at the point of reflection, and what both ends add together too: phases are
    right to 0.01 rad, where a flat mirror in its place is off by radians.
    """
    rng = np.random.default_rng(8)
    tx, rx = np.array([10.0 + radius, 2.0, 1.0]), np.array([5.0, 12.0 + radius, -1.0])
    arrays = ula(8, horizontal_spacing=127.5 / 7, pattern="iso"), ula(3, horizontal_spacing=3.75, pattern="iso")
    turns = [random_turns(rng, 1) for _ in range(2)]
    paths = reflected(tx, rx, radius, is_ball)
    places = [
        end + array.local_positions(CARRIER) @ turn[0].T
        for end, array, turn in zip((tx, rx), arrays, turns, strict=True)
    ]
    exact = np.array([[shortest(t, r, radius, is_ball)[1] for t in places[0]] for r in places[1]])
    turn = np.exp(2j * np.pi / WAVE * (exact - SPEED_OF_LIGHT * paths.tau[0]))
    flat = CarrierPaths(**{**vars(paths), "curvature": np.full((1, 6), np.nan)})
    errors = []
    for one in (paths, flat):
        alone = apply_arrays(one, ISO, ISO, CARRIER, *turns)[0]
        phase = np.angle(apply_arrays(one, *arrays, CARRIER, *turns, wavefront="spherical")[0] / alone * turn)
        errors.append(np.abs(phase).max())
    print(errors)
    assert errors[0] < 0.02
    assert errors[1] > 0.2
