"""Cast single rays into a scene on a device."""

from dataclasses import dataclass

import numpy as np
import warp as wp
from numpy.typing import ArrayLike

from mmw.core.errors import InputError
from mmw.kernels.core.structs import Hit
from mmw.kernels.core.trace import cast_kernel
from mmw.scene.device_scene import DeviceScene

MAX_RAY_LENGTH_M = 1.0e6
"""Length of a ray without a limit [m]."""


@dataclass(frozen=True)
class RayHits:
    """First surface on each of R rays."""

    distance: np.ndarray
    """Distance along the ray [m], inf for a miss, shape [R], float32."""
    object_id: np.ndarray
    """Row of `objects`, -1 for a miss, shape [R], int32."""
    material_id: np.ndarray
    """Material of the weather that is selected, -1 for a miss, shape [R], int32."""
    normal: np.ndarray
    """Unit normal of the face, toward the origin of the ray, shape [R, 3], float32; zero for a miss."""


def cast_rays(
    scene: DeviceScene,
    origins: ArrayLike,
    directions: ArrayLike,
    *,
    batch_index: ArrayLike = 0,
    max_distance: float = np.inf,
) -> RayHits:
    """Find the first surface along each ray.

    Args:
        scene: Scene with a batch of frames loaded.
        origins: Ray origins in the world frame [m], shape [R, 3].
        directions: Unit directions in the world frame, shape [R, 3].
        batch_index: Position of each ray's frame in the batch, shape [R] or one for all.
        max_distance: Rays end here [m].
    """
    start = np.asarray(origins, dtype=np.float64).reshape(-1, 3) - scene.origin
    count, device = len(start), scene.device
    index = np.ascontiguousarray(np.broadcast_to(np.asarray(batch_index, dtype=np.int32), (count,)))
    hits, blocked = wp.empty(count, dtype=Hit, device=device), wp.empty(count, dtype=wp.bool, device=device)
    unit = np.ascontiguousarray(np.asarray(directions, dtype=np.float32).reshape(-1, 3))
    wp.launch(
        cast_kernel,
        dim=count,
        inputs=[
            scene.struct,
            wp.array(index, dtype=wp.int32, device=device),
            wp.array(np.ascontiguousarray(start.astype(np.float32)), dtype=wp.vec3, device=device),
            wp.array(unit, dtype=wp.vec3, device=device),
            float(min(max_distance, MAX_RAY_LENGTH_M)),
            wp.full(count, -1, dtype=wp.int32, device=device),
        ],
        outputs=[hits, blocked],
        device=device,
        block_dim=64,
    )
    found = hits.numpy()
    is_hit = found["object_id"] >= 0
    return RayHits(
        found["t"],
        found["object_id"],
        np.where(is_hit, found["material_id"], -1),
        np.where(is_hit[:, None], found["normal"], np.float32(0.0)),
    )


def ray_arrays(origins: ArrayLike, directions: ArrayLike, max_distance: float) -> tuple[np.ndarray, np.ndarray]:
    """Return origins and unit directions of rays that a user gave, shape [R, 3] each, float64.

    Args:
        origins: Ray origins [m], shape [R, 3], [1, 3] or [3].
        directions: Directions of any length above 0, of these shapes too.
        max_distance: Length of the rays [m].

    Raises:
        InputError: If shapes do not fit, a value is not finite, or a direction is zero.
    """
    start = np.atleast_2d(np.asarray(origins, dtype=np.float64))
    toward = np.atleast_2d(np.asarray(directions, dtype=np.float64))
    fits = len(start) == len(toward) or 1 in (len(start), len(toward))
    if start.shape[1:] != (3,) or toward.shape[1:] != (3,) or not fits:
        raise InputError(
            f"cast_rays: origins {start.shape}, directions {toward.shape}; both need shape [R, 3], or one ray"
        )
    length = np.linalg.norm(toward, axis=-1, keepdims=True)
    if not (np.isfinite(start).all() and np.isfinite(length).all() and (length > 0).all() and max_distance > 0):
        raise InputError(
            "cast_rays: a value is not finite, a direction is zero, or max_distance is not above 0; correct it"
        )
    shape = (max(len(start), len(toward)), 3)
    return np.broadcast_to(start, shape), np.broadcast_to(toward / length, shape)
