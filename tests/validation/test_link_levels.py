"""Levels of links in small scenes."""

import numpy as np

from mmw.channel import PathSolver
from mmw.validation.link_levels import link_levels_db
from mmw.validation.targets import load_target


def test_a_link_beside_a_plate_has_free_space(device: str) -> None:
    plate = np.array([(0.0, 50.0, 0.0), (2.0, 50.0, 0.0), (0.0, 50.0, 2.0)])
    scene = load_target((plate, np.array([[0, 1, 2]])), device)
    solver = PathSolver(max_depth=0, air_losses=False)
    level = link_levels_db(
        scene, solver, [((0.0, 0.0, 2.0), (10.0, 0.0, 2.0)), ((0.0, 0.0, 2.0), (3.0, 4.0, 2.0))], [28e9]
    )
    np.testing.assert_allclose(level, 0.0, atol=1e-9)


def test_a_plate_blocks(device: str) -> None:
    plate = np.array([(5.0, -1.0, 0.0), (5.0, 1.0, 0.0), (5.0, 1.0, 4.0), (5.0, -1.0, 4.0)])
    scene = load_target((plate, np.array([[0, 1, 2], [0, 2, 3]])), device)
    level = link_levels_db(scene, PathSolver(max_depth=0), [((0.0, 0.0, 2.0), (10.0, 0.0, 2.0))], [28e9])
    assert level[0, 0] < -200.0
