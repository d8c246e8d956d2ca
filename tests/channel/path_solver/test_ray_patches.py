"""Threads take every ray of a lattice once, and those of a block are neighbors on the sphere."""

import numpy as np
import pytest
import warp as wp

from mmw.channel.path_solver.candidates import ray_patches
from mmw.kernels.channel.ray_launch import PATCH, RayPatches, ray_of
from mmw.kernels.core.geometry import fibonacci_direction


@wp.kernel
def rays_kernel(patches: RayPatches, ray_out: wp.array[int], direction_out: wp.array[wp.vec3]):
    thread = wp.tid()
    ray_out[thread] = ray_of(patches, thread)
    direction_out[thread] = fibonacci_direction(wp.max(ray_out[thread], 0), patches.ray_count)


@pytest.mark.parametrize("ray_count", [2, 3, 10, 997, 4096, 100_000, 1_000_000])
def test_every_ray_is_taken_once_beside_its_neighbors(ray_count: int, device: str) -> None:
    patches, threads = ray_patches(ray_count, device)
    ray, direction = wp.empty(threads, dtype=int, device=device), wp.empty(threads, dtype=wp.vec3, device=device)
    wp.launch(rays_kernel, dim=threads, inputs=[patches], outputs=[ray, direction], device=device)
    rays = ray.numpy()
    assert sorted(rays[rays >= 0]) == list(range(ray_count))
    assert threads % PATCH**2 == 0
    blocks, is_full = direction.numpy().reshape(-1, PATCH**2, 3), (rays >= 0).reshape(-1, PATCH**2).all(axis=1)
    if ray_count < 4096:
        return
    assert threads < 1.4 * ray_count and is_full.mean() > 0.7
    reach = np.linalg.norm(blocks[is_full] - blocks[is_full].mean(axis=1, keepdims=True), axis=2).max(axis=1)
    cap = np.sqrt(PATCH**2 * 4.0 / ray_count)  # radius of a circle of as many rays
    assert np.median(reach) < 1.8 * cap
    assert np.quantile(reach, 0.9) < 2.2 * cap  # only patches at the poles are long
