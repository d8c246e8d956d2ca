"""Find the object that a point is inside: a vehicle, a building or the ground."""

# Warp's structs and small number types are objects, not classes, to a type checker.
# pyright: reportGeneralTypeIssues=false, reportArgumentType=false

import math

import numpy as np
import warp as wp

from mmw.kernels.core import line_of_sight as sight
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


def enclosing_objects(scene: DeviceScene, position: np.ndarray) -> np.ndarray:
    """Return the object that each point is inside, -1 for a point in the open.

    A place is inside something if nearly all rays upward hit an odd number of surfaces: inside a closed solid every
    ray out crosses its skin once more than it enters. The winding of faces does not matter.

    Args:
        scene: Town and vehicles with a batch loaded; its first frame counts.
        position: World frame [m], shape [N, 3].

    Returns:
        Object ids, the one that most rays hit first, shape [N], int32.
    """
    turn = np.arange(RAYS) * math.pi * (3.0 - math.sqrt(5.0))  # golden angle: even in azimuth at every height
    up = np.linspace(0.02, 0.98, RAYS)
    across = np.sqrt(1.0 - up**2)
    direction = np.stack([across * np.cos(turn), across * np.sin(turn), up], axis=1).astype(np.float32)
    device, shape = scene.device, (len(position), RAYS)
    count, first = (wp.empty(shape, dtype=int, device=device) for _ in range(2))
    frame = wp.zeros(len(position), dtype=int, device=device)
    origin = (np.asarray(position) - scene.origin).astype(np.float32)
    rays = (wp.array(vectors, dtype=wp.vec3, device=device) for vectors in (origin, direction))
    inputs = [scene.struct, frame, *rays, REACH_M]
    wp.launch(sight.count_hits_kernel, shape, inputs, [count, first], device=device, block_dim=BLOCK_DIM)
    is_odd, objects = count.numpy() % 2 == 1, first.numpy()
    around = [int(np.bincount(row[row >= 0]).argmax()) if (row >= 0).any() else -1 for row in objects]
    return np.where(is_odd.mean(axis=1) >= INSIDE_SHARE, around, -1).astype(np.int32)
