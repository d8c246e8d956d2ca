"""Points in surfaces of many triangles, and in planes of many surfaces, are found through boxes, as without."""

import numpy as np
import pytest
import warp as wp

from mmw.channel.path_solver.box_trees import HostTrees, box_trees, triangle_trees
from mmw.kernels.channel.box_tree import FEW, LEAF
from mmw.kernels.channel.surfaces import Surfaces, local_triangle, next_member
from mmw.kernels.core.compiler import DOUBLE_PRECISION

wp.set_module_options(DOUBLE_PRECISION)


@wp.kernel
def find_kernel(surfaces: Surfaces, surface: wp.array[int], point: wp.array[wp.vec3d], corner_out: wp.array[int]):
    i = wp.tid()
    corner_out[i] = local_triangle(surfaces, surface[i], point[i])


@wp.kernel
def member_kernel(
    surfaces: Surfaces, plane: wp.array[int], point: wp.array[wp.vec3d], slack: wp.vec3d, held_out: wp.array2d[int]
):
    i = wp.tid()
    index = surfaces.first_member[plane[i]] - 1
    for k in range(held_out.shape[1]):
        if k == 0 or index >= 0:
            index = next_member(surfaces, plane[i], index, point[i], slack)
        held_out[i, k] = index


def grid(rng: np.random.Generator, cells: int) -> np.ndarray:
    """Return the triangles of a square of 1 m, in any order, shape [2 cells^2, 3, 3]."""
    x, y = np.meshgrid(np.arange(cells), np.arange(cells), indexing="ij")
    low = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 1, 3)
    shapes = np.array([[[0, 0, 0], [1, 0, 0], [1, 1, 0]], [[0, 0, 0], [1, 1, 0], [0, 1, 0]]])
    triangles = (low[:, None] + shapes).reshape(-1, 3, 3) / cells
    return triangles[rng.permutation(len(triangles))]


def check_trees(trees: HostTrees, first: np.ndarray, count: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> None:
    """Assert that each tree is one, and that the box of each node has all entries below it."""
    assert sorted(trees.order) == list(range(len(lower)))
    assert ((trees.root >= 0) == (count > FEW)).all()
    for own, root in enumerate(trees.root):
        if root < 0:
            continue
        entries: list[int] = []
        for node in range(root, trees.node[root, 0]):
            behind, begin, end = trees.node[node]
            below = trees.node[node:behind]
            leaves = below[below[:, 1] < below[:, 2]]
            assert node < behind <= trees.node[root, 0] and len(leaves)
            assert (begin < end) == (behind == node + 1)
            held = trees.order[leaves[0, 1] : leaves[-1, 2]]
            assert (trees.lower[node] <= lower[held]).all() and (trees.upper[node] >= upper[held]).all()
            assert (leaves[1:, 1] == leaves[:-1, 2]).all() and (leaves[:, 2] - leaves[:, 1] <= LEAF).all()
            if begin < end:
                entries += trees.order[begin:end].tolist()
        assert sorted(entries) == list(range(first[own], first[own] + count[own]))


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
    trees = triangle_trees(triangle, first, count)
    check_trees(trees, first, count, triangle.min(axis=1), triangle.max(axis=1))

    surface = rng.integers(0, len(sizes), 4000)
    point = np.append(rng.uniform(-0.2, 1.2, (4000, 2)), np.zeros((4000, 1)), axis=1)
    surfaces, out = Surfaces(), wp.empty(len(point), dtype=int, device=device)
    for name, values, dtype in (
        ("row", np.arange(len(sizes)), wp.int32),
        ("first", first, wp.int32),
        ("triangle_count", count, wp.int32),
        ("corner", triangle.reshape(-1, 3), wp.vec3d),
    ):
        setattr(surfaces, name, wp.array(values, dtype=dtype, device=device))
    surfaces.triangles = trees.to_device(device)
    given = [surfaces, wp.array(surface, dtype=int, device=device), wp.array(point, dtype=wp.vec3d, device=device)]
    wp.launch(find_kernel, dim=len(point), inputs=given, outputs=[out], device=device)

    for own, at, corner in zip(surface, point, out.numpy(), strict=True):
        a, b, c = parts[own].swapaxes(0, 1)[..., :2]
        share = np.linalg.solve(np.stack([b - a, c - a], axis=-1), (at[:2] - a)[..., None])[..., 0]
        holds = np.flatnonzero((share >= 0.0).all(axis=1) & (share.sum(axis=1) <= 1.0))
        assert corner == (3 * (first[own] + holds[0]) if len(holds) else -1)


@pytest.mark.parametrize("slack", [0.0, 0.05])
def test_the_surfaces_of_a_plane_that_hold_a_point_come_in_order(slack: float, device: str) -> None:
    """Oracle: every surface of the plane is asked. Surfaces are squares of one triangle pair that overlap."""
    rng = np.random.default_rng(3)
    count = np.array([1, 40, FEW, 700, 3])
    first = np.concatenate([[0], np.cumsum(count)])
    low = np.append(rng.uniform(0.0, 1.0, (first[-1], 2)), np.zeros((first[-1], 1)), axis=1)
    size = rng.uniform(0.02, 0.25, (first[-1], 1, 1))
    triangle = low[:, None] + size * np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 0, 0], [1, 1, 0], [0, 1, 0]])
    lower, upper = triangle.min(axis=1), triangle.max(axis=1)
    trees = box_trees(first[:-1], count, lower, upper)
    check_trees(trees, first[:-1], count, lower, upper)
    every = np.arange(first[-1])
    surfaces = Surfaces()
    for name, values, dtype in (
        ("row", every, wp.int32),
        ("lower", lower, wp.vec3d),
        ("upper", upper, wp.vec3d),
        ("first", 2 * every, wp.int32),
        ("triangle_count", np.full(first[-1], 2), wp.int32),
        ("corner", triangle.reshape(-1, 3), wp.vec3d),
        ("first_member", first, wp.int32),
        ("member", every, wp.int32),
    ):
        setattr(surfaces, name, wp.array(values, dtype=dtype, device=device))
    surfaces.members = trees.to_device(device)
    surfaces.triangles = triangle_trees(triangle.reshape(-1, 3, 3), 2 * every, np.full(first[-1], 2)).to_device(device)
    plane = rng.integers(0, len(count), 500)
    point = np.append(rng.uniform(-0.1, 1.3, (500, 2)), np.zeros((500, 1)), axis=1)
    out = wp.full((500, 64), -2, dtype=int, device=device)
    given = [surfaces, wp.array(plane, dtype=int, device=device), wp.array(point, dtype=wp.vec3d, device=device)]
    wp.launch(member_kernel, dim=500, inputs=[*given, wp.vec3d(slack, slack, slack)], outputs=[out], device=device)

    some = 0
    for own, at, found in zip(plane, point, out.numpy(), strict=True):
        inside = ((at >= lower) & (at <= upper)).all(axis=1)
        inside[: first[own]] = inside[first[own + 1] :] = False
        held = np.flatnonzero(inside)
        assert len(held) < 64
        some += len(held)
        assert (found[: len(held)] == held).all()
        assert (found[len(held) :] == -1).all()
    assert some > 500
