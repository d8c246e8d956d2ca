"""The trees that rays walk: built on the CPU, one a mesh, then put one behind the other; and rays on one mesh."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from mmw.kernels.rays import rays_kernel
from mmw.kernels.tree import LEAF_FACES, LEAF_ROWS, NODE_ROWS, REFERENCE_ROW, Tree
from mmw.kernels.tree_build import BINS, Work, build_tree_kernel

LEAF_FACES_CUDA = 2
"""Triangles in a leaf at most where a thread tests them one by one: on an H100 incoherent rays are 8 % faster than with
`LEAF_FACES`, others 1 % (`bench/README.md`). A CPU tests that many at once."""


def build_trees(meshes: Sequence[np.ndarray], device: str) -> tuple[Tree, np.ndarray]:
    """Return the trees of meshes on a device, and the root of each.

    Args:
        meshes: Corners of the triangles of each mesh [m], shape [M, 3, 3]; M > 0.
        device: Warp device name.

    Returns:
        The trees; the number of each root, shape [K], int32.
    """
    nodes, leaves = [np.zeros((0, NODE_ROWS, 4), np.float32)], [np.zeros((0, LEAF_ROWS, 4), np.float32)]
    roots, node_count, leaf_count = [], 0, 0
    leaf_faces = LEAF_FACES_CUDA if wp.get_device(device).is_cuda else int(LEAF_FACES)
    for corners in meshes:
        own_nodes, own_leaves = build_tree(corners, leaf_faces)
        child = own_nodes[:, REFERENCE_ROW].view(np.int32)
        child += np.where(child >= 0, node_count, -8 * leaf_count).astype(np.int32)
        roots.append(node_count)
        node_count, leaf_count = node_count + len(own_nodes), leaf_count + len(own_leaves)
        nodes.append(own_nodes)
        leaves.append(own_leaves)
    tree = Tree()
    tree.nodes = wp.array(np.concatenate(nodes).reshape(-1, 4), dtype=wp.vec4, device=device)
    tree.leaves = wp.array(np.concatenate(leaves).reshape(-1, 4), dtype=wp.vec4, device=device)
    return tree, np.array(roots, dtype=np.int32)


def build_tree(corners: np.ndarray, leaf_faces: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the tree of one mesh.

    Args:
        corners: Corners of the triangles [m], shape [M, 3, 3]; M > 0.
        leaf_faces: Triangles in a leaf at most, 1 to `LEAF_FACES`.

    Returns:
        Nodes, shape [N, NODE_ROWS, 4], and leaves, shape [L, LEAF_ROWS, 4], float32; the root is node 0.
    """
    faces = len(corners)
    work = Work()
    work.corner = wp.array(np.ascontiguousarray(corners, dtype=np.float32), dtype=wp.vec3, device="cpu")
    work.lower, work.upper = _empty(faces, wp.vec3), _empty(faces, wp.vec3)
    work.order, work.waiting = _empty(faces, int), _empty((faces, 4), int)
    work.bin_count, work.cost_behind = _empty((3, BINS), int), _empty(BINS, float)
    work.bin_lower, work.bin_upper = _empty((3, BINS), wp.vec3), _empty((3, BINS), wp.vec3)
    nodes, leaves, counts = _empty((faces, NODE_ROWS), wp.vec4), _empty((faces, LEAF_ROWS), wp.vec4), _empty(2, int)
    wp.launch(build_tree_kernel, dim=1, inputs=[work, leaf_faces], outputs=[nodes, leaves, counts], device="cpu")
    node_count, leaf_count = counts.numpy()
    return nodes.numpy()[:node_count].copy(), leaves.numpy()[:leaf_count].copy()


def _empty(shape: int | tuple[int, ...], dtype: type) -> wp.array:
    return wp.empty(shape, dtype=dtype, device="cpu")


class RayMesh:
    """Triangles to cast rays on, in float64 coordinates.

    They are moved to their own middle, so that float32 keeps a hundredth of a millimetre.
    """

    def __init__(self, points: np.ndarray, faces: np.ndarray, device: str = "cpu") -> None:
        """Build the tree.

        Args:
            points: Vertices in the world frame [m], shape [N, 3].
            faces: Triangles, shape [M, 3], at least one.
            device: Warp device.
        """
        self._device = device
        self._origin = 0.5 * (points.min(axis=0) + points.max(axis=0))
        self._tree, _ = build_trees([(points - self._origin)[faces]], device)

    def cast(self, origin: np.ndarray, direction: np.ndarray, t_max: float) -> tuple[np.ndarray, np.ndarray]:
        """Return what rays meet first.

        Args:
            origin: Starts [m], shape [R, 3].
            direction: Unit directions, shape [R, 3] or [3].
            t_max: Length of the rays [m].

        Returns:
            Distance [m], shape [R], float64, inf for a miss; face, shape [R], -1 for a miss.
        """
        count, device = len(origin), self._device
        ways = np.ascontiguousarray(np.broadcast_to(direction, (count, 3)), dtype=np.float32)
        exact = origin - self._origin
        starts = exact.astype(np.float32)
        rays = [wp.array(values, dtype=wp.vec3, device=device) for values in (starts, ways)]
        t, face = wp.empty(count, dtype=float, device=device), wp.empty(count, dtype=int, device=device)
        inputs = [self._tree, *rays, t_max]
        wp.launch(rays_kernel, dim=count, inputs=inputs, outputs=[t, face], block_dim=64, device=device)
        # From where a ray was meant to start, not from where float32 puts it.
        return t.numpy() + np.einsum("rx,rx->r", starts - exact, ways), face.numpy()
