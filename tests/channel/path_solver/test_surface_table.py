"""Points in surfaces of many triangles are found through boxes around blocks of them, as without."""

import numpy as np
import pytest
import warp as wp

from mmw.channel.path_solver.surface_table import triangle_blocks
from mmw.kernels.channel.surfaces import BLOCK, Surfaces, local_triangle
from mmw.kernels.core.compiler import DOUBLE_PRECISION

wp.set_module_options(DOUBLE_PRECISION)


@wp.kernel
def find_kernel(surfaces: Surfaces, surface: wp.array[int], point: wp.array[wp.vec3d], corner_out: wp.array[int]):
    i = wp.tid()
    corner_out[i] = local_triangle(surfaces, surface[i], point[i])


def grid(rng: np.random.Generator, cells: int) -> np.ndarray:
    """Return the triangles of a square of 1 m, in any order, shape [2 cells^2, 3, 3]."""
    x, y = np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij")
    low = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 1, 3)
    shapes = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]])
    triangles = (low[:, None] + shapes).reshape(-1, 3, 3) / cells
    return triangles[rng.permutation(len(triangles))]


@pytest.mark.parametrize("is_sorted", [True, False])
def test_a_point_is_in_the_first_triangle_that_holds_it(is_sorted: bool, device: str) -> None:
    """Oracle: every triangle is asked by barycentric coordinates."""
    rng = np.random.default_rng(2)
    sizes = (1, 3, 16, 2)  # of 2, 18, 512 and 8 triangles
    parts = [grid(rng, cells) for cells in sizes]
    if is_sorted:
        parts = [part[np.lexsort(part.mean(axis=1).T)] for part in parts]
    triangle, count = np.concatenate(parts), np.array([len(part) for part in parts])
    first = np.cumsum(count) - count
    first_block, lower, upper = triangle_blocks(triangle, first, count)
    assert len(lower) == sum(-(-n // BLOCK) for n in count if n > BLOCK)

    surface = rng.integers(0, len(sizes), 4000)
    point = np.append(rng.uniform(-0.2, 1.2, (4000, 2)), np.zeros((4000, 1)), axis=1)
    surfaces, out = Surfaces(), wp.empty(len(point), dtype=int, device=device)
    for name, values, dtype in (
        ("row", np.arange(len(sizes)), wp.int32),
        ("first", first, wp.int32),
        ("triangle_count", count, wp.int32),
        ("corner", triangle.reshape(-1, 3), wp.vec3d),
        ("first_block", first_block, wp.int32),
        ("block_lower", lower, wp.vec3d),
        ("block_upper", upper, wp.vec3d),
    ):
        setattr(surfaces, name, wp.array(values, dtype=dtype, device=device))
    given = [surfaces, wp.array(surface, dtype=int, device=device), wp.array(point, dtype=wp.vec3d, device=device)]
    wp.launch(find_kernel, dim=len(point), inputs=given, outputs=[out], device=device)

    for own, at, corner in zip(surface, point, out.numpy(), strict=True):
        a, b, c = parts[own].swapaxes(0, 1)[..., :2]
        share = np.linalg.solve(np.stack([b - a, c - a], axis=-1), (at[:2] - a)[..., None])[..., 0]
        holds = np.flatnonzero((share >= 0.0).all(axis=1) & (share.sum(axis=1) <= 1.0))
        assert corner == (3 * (first[own] + holds[0]) if len(holds) else -1)
