"""Read levels of links in small scenes."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from mmw.channel import Paths, PathSolver, PlanarArray
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.scene import Receiver, Scene, Transmitter


def add_ends(scene: Scene) -> tuple[Transmitter, Receiver]:
    """Return an isotropic, vertically polarized transmitter and receiver, added to a scene; place them before use."""
    array = PlanarArray(pattern="iso")
    tx = scene.add(Transmitter("tx", position=(0.0, 0.0, 0.0), array=array))
    return tx, scene.add(Receiver("rx", position=(0.0, 0.0, 0.0), array=array))


def over_free_space_db(paths: Paths, distance_m: float) -> np.ndarray:
    """Return the level of the coherent sum of the paths of one link over free space [dB], shape [C]."""
    carriers = np.asarray(paths.carriers_hz)
    field = (paths.a * np.exp(-2j * np.pi * carriers * paths.tau[:, None])).sum(axis=0)
    free = SPEED_OF_LIGHT / (4.0 * np.pi * carriers * distance_m)
    return 20.0 * np.log10(np.maximum(np.abs(field), 1e-30) / free)


def link_levels_db(
    scene: Scene, solver: PathSolver, ends: Sequence[tuple[ArrayLike, ArrayLike]], carriers_hz: Sequence[float]
) -> np.ndarray:
    """Return the levels of links over free space [dB], shape [n, C]; paths add coherently.

    Args:
        scene: A scene without devices.
        solver: How paths are found.
        ends: Positions of transmitter and receiver of each link [m], n of them.
        carriers_hz: Carriers.
    """
    tx, rx = add_ends(scene)
    levels = []
    for one, other in ends:
        tx.position, rx.position = tuple(np.asarray(one, float)), tuple(np.asarray(other, float))
        distance = float(np.linalg.norm(np.subtract(one, other)))
        levels.append(over_free_space_db(solver(scene, carriers_hz=list(carriers_hz)), distance))
    return np.array(levels)
