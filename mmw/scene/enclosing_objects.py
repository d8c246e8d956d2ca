"""Find the object that a point is inside: a vehicle, a building or the ground."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

import math
from functools import cache

import numpy as np
import warp as wp

from mmw.core.device import thread_spread
from mmw.core.packed_arrays import borrow_arrays
from mmw.kernels.core import line_of_sight as sight
from mmw.kernels.core import structs
from mmw.scene.device_scene import DeviceScene

BLOCK_DIM = 64
"""Threads of a block for kernels that query a BVH, whose stacks lie in shared memory."""

RAYS = 64
"""Rays that are sent out of each place; design value."""

INSIDE_SHARE = 0.9
"""Share of the rays that must hit an odd number of surfaces for a place that counts as inside. All do in a closed
solid or below the ground; a few may slip through an open mesh. Design value."""

REACH_M = 5_000.0
"""Length of the rays [m]: out of any town."""


class EnclosingQuery:
    """Question which object each of some points is inside; the device answers while other work is queued.

    A place is inside something if nearly all rays upward hit an odd number of surfaces: inside a closed solid every
    ray out crosses its skin once more than it enters. The winding of faces does not matter.
    """

    def __init__(self, scene: DeviceScene, position: np.ndarray, struct: "structs.Scene | None" = None):
        """Send the rays.

        Args:
            scene: Town and vehicles with a batch loaded; its first frame counts.
            position: World frame [m], shape [N, 3].
            struct: What the rays meet; the whole scene by default.
        """
        count, device = len(position), scene.device
        points, rays = ((count,), wp.vec3), ((count, RAYS), wp.int32)
        self._given = borrow_arrays(device, ((count,), wp.int32), points, ((RAYS,), wp.vec3))
        self._out = borrow_arrays(device, rays, rays)
        frame, origin, direction = self._given.host
        frame[...], origin[...], direction[...] = 0, position - scene.origin, _directions()
        inputs = [scene.struct if struct is None else struct, *self._given.upload(), REACH_M]
        shape = (count, RAYS, thread_spread(device, count * RAYS))
        wp.launch(sight.count_hits_kernel, shape, inputs, self._out.arrays, device=device, block_dim=BLOCK_DIM)

    def object_ids(self) -> np.ndarray:
        """Return the object around each point, -1 in the open: the one that most rays hit first, shape [N], int32.

        It can be asked once.
        """
        count, objects = self._out.download()
        odd = (count % 2).sum(axis=1)
        inside = np.full(len(count), -1, dtype=np.int32)
        for row in np.flatnonzero(odd >= INSIDE_SHARE * RAYS):
            inside[row] = np.bincount(objects[row][objects[row] >= 0]).argmax()
        self._given.release()
        self._out.release()
        return inside


def enclosing_objects(scene: DeviceScene, position: np.ndarray) -> np.ndarray:
    """Return the object that each point is inside, -1 for a point in the open; see `EnclosingQuery`.

    Args:
        scene: Town and vehicles with a batch loaded; its first frame counts.
        position: World frame [m], shape [N, 3].

    Returns:
        Object ids, shape [N], int32.
    """
    return EnclosingQuery(scene, position).object_ids()


@cache
def _directions() -> np.ndarray:
    """Return the directions of the rays, even over the upper half space, shape [RAYS, 3]."""
    turn = np.arange(RAYS) * math.pi * (3.0 - math.sqrt(5.0))  # golden angle: even in azimuth at every height
    up = np.linspace(0.02, 0.98, RAYS)
    across = np.sqrt(1.0 - up**2)
    return np.stack([across * np.cos(turn), across * np.sin(turn), up], axis=1)
