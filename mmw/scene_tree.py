"""The trees that rays walk: built on the CPU, one a mesh, then put one behind the other."""

from collections.abc import Sequence

import numpy as np
import warp as wp

from mmw.kernels.tree import LEAF_ROWS, NODE_ROWS, Tree
from mmw.kernels.tree_build import BINS, Work, build_tree_kernel

REFERENCE_ROW = 6
"""Row of a node that holds the references to its children."""


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
    for corners in meshes:
        own_nodes, own_leaves = build_tree(corners)
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


def build_tree(corners: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the tree of one mesh.

    Args:
        corners: Corners of the triangles [m], shape [M, 3, 3]; M > 0.

    Returns:
        Nodes, shape [N, NODE_ROWS, 4], and leaves, shape [L, LEAF_ROWS, 4], float32; the root is node 0.
    """
    faces = len(corners)
    work = Work()
    work.corner = wp.array(np.ascontiguousarray(corners, dtype=np.float32), dtype=wp.vec3, device="cpu")
    work.lower, work.upper = _empty(faces, wp.vec3), _empty(faces, wp.vec3)
    work.order, work.waiting = _empty(faces, int), _empty((faces, 4), int)
    work.bin_count, work.cost_behind = _empty(BINS, int), _empty(BINS, float)
    work.bin_lower, work.bin_upper = _empty(BINS, wp.vec3), _empty(BINS, wp.vec3)
    nodes, leaves, counts = _empty((faces, NODE_ROWS), wp.vec4), _empty((faces, LEAF_ROWS), wp.vec4), _empty(2, int)
    wp.launch(build_tree_kernel, dim=1, inputs=[work], outputs=[nodes, leaves, counts], device="cpu")
    node_count, leaf_count = counts.numpy()
    return nodes.numpy()[:node_count].copy(), leaves.numpy()[:leaf_count].copy()


def _empty(shape: int | tuple[int, ...], dtype: type) -> wp.array:
    return wp.empty(shape, dtype=dtype, device="cpu")
