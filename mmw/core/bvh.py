"""Build BVHs of meshes, and cast rays on a single mesh.

Our own BVHs are built on the CPU, one per mesh, and concatenated. Warp's are those of one `wp.Mesh` each, if
`mmw.core.bvh_kind` has selected them.
"""

import weakref
from collections.abc import Sequence

import numpy as np
import warp as wp

from mmw.core.bvh_kind import kind_to_build
from mmw.kernels.core.bvh import LEAF_FACES, LEAF_ROWS, NODE_ROWS, REFERENCE_ROW, Tree
from mmw.kernels.core.bvh_build import BINS, Work, build_tree_kernel
from mmw.kernels.core.mesh_rays import rays_kernel

LEAF_FACES_CUDA = 2
"""Maximum number of triangles in a leaf on CUDA, where a thread tests them one by one: on an H100 incoherent rays are
8 % faster than with `LEAF_FACES`, others 1 % (`bench/README.md`). A CPU tests `LEAF_FACES` at once."""

WARP_BUILD = {"cuda": ("cubql", 2), "cpu": ("sah", 4)}
"""Constructor of Warp's BVHs and maximum number of triangles in a leaf: the fastest of all constructors with 1, 2 and
4, on an H100 and on a CPU with AVX-512 (`bench/README.md`)."""

BOX_MARGIN = 5e-7
"""Enlargement of Warp's bounding boxes, relative to the size of the mesh plus `BOX_RANGE_M`. Distances to the sides of
a box, which Warp compares directly, have errors up to 3 * 2^-24: with this margin, rounding loses no triangle at that
distance from the origin of its ray, nor at twice that."""

BOX_RANGE_M = 1000.0
"""Length of rays on small meshes, such as a vehicle [m]."""


def build_bvhs(meshes: Sequence[np.ndarray], device: str) -> tuple[Tree, np.ndarray]:
    """Return the BVHs of meshes on a device, and the root of each.

    Args:
        meshes: Corners of the triangles of each mesh [m], shape [M, 3, 3]; M > 0.
        device: Warp device name.

    Returns:
        The BVHs; the root of each, shape [K], int32.

    Raises:
        InputError: If no BVH kind was selected, and the environment names an unknown one.
    """
    if kind_to_build() == "warp":
        return _build_warp(meshes, device), np.arange(len(meshes), dtype=np.int32)
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
    tree.meshes = wp.empty(0, dtype=wp.uint64, device=device)
    return tree, np.array(roots, dtype=np.int32)


def build_tree(corners: np.ndarray, leaf_faces: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the BVH of one mesh.

    Args:
        corners: Corners of the triangles [m], shape [M, 3, 3]; M > 0.
        leaf_faces: Maximum number of triangles in a leaf, 1 to `LEAF_FACES`.

    Returns:
        Nodes, shape [N, NODE_ROWS, 4], and leaves, shape [L, LEAF_ROWS, 4], float32; the root is node 0.
    """
    faces = len(corners)
    work = Work()
    work.corner = wp.array(np.ascontiguousarray(corners, dtype=np.float32), dtype=wp.vec3, device="cpu")
    work.lower, work.upper = _empty(faces, wp.vec3), _empty(faces, wp.vec3)
    work.order, work.stack = _empty(faces, int), _empty((faces, 4), int)
    work.bin_count, work.cost_behind = _empty((3, BINS), int), _empty(BINS, float)
    work.bin_lower, work.bin_upper = _empty((3, BINS), wp.vec3), _empty((3, BINS), wp.vec3)
    nodes, leaves, counts = _empty((faces, NODE_ROWS), wp.vec4), _empty((faces, LEAF_ROWS), wp.vec4), _empty(2, int)
    wp.launch(build_tree_kernel, dim=1, inputs=[work, leaf_faces], outputs=[nodes, leaves, counts], device="cpu")
    node_count, leaf_count = counts.numpy()
    return nodes.numpy()[:node_count].copy(), leaves.numpy()[:leaf_count].copy()


def _build_warp(meshes: Sequence[np.ndarray], device: str) -> Tree:
    """Return Warp's BVHs of meshes, which exist as long as the array of their ids."""
    built = [_build_warp_mesh(np.ascontiguousarray(corners, dtype=np.float32), device) for corners in meshes]
    tree = Tree()
    tree.nodes = wp.empty(0, dtype=wp.vec4, device=device)
    tree.leaves = wp.empty(0, dtype=wp.vec4, device=device)
    tree.meshes = wp.array(np.array([mesh.id for mesh in built], dtype=np.uint64), dtype=wp.uint64, device=device)
    weakref.finalize(tree.meshes, built.clear).atexit = False
    return tree


def _build_warp_mesh(corners: np.ndarray, device: str) -> wp.Mesh:
    """Return Warp's BVH of one mesh, with boxes enlarged by `BOX_MARGIN`."""
    margin = BOX_MARGIN * (np.abs(corners).max() + BOX_RANGE_M)
    boxed = np.stack([corners.min(axis=1) - margin, corners.max(axis=1) + margin, corners[:, 0]], axis=1)
    constructor, leaf_faces = WARP_BUILD["cuda" if wp.get_device(device).is_cuda else "cpu"]
    points = wp.array(boxed.reshape(-1, 3), dtype=wp.vec3, device=device)
    mesh = wp.Mesh(
        points=points,
        indices=wp.array(np.arange(3 * len(corners), dtype=np.int32), dtype=wp.int32, device=device),
        bvh_constructor=constructor,
        bvh_leaf_size=leaf_faces,
    )
    # The BVH uses the boxes of its construction until it is refit.
    points.assign(corners.reshape(-1, 3))
    return mesh


def _empty(shape: int | tuple[int, ...], dtype: type) -> wp.array:
    return wp.empty(shape, dtype=dtype, device="cpu")


class RayMesh:
    """Triangle mesh for ray casting, with float64 coordinates.

    It is centered at the origin, so that float32 resolves a hundredth of a millimeter.
    """

    def __init__(self, points: np.ndarray, faces: np.ndarray, device: str = "cpu") -> None:
        """Build the BVH.

        Args:
            points: Vertices in the world frame [m], shape [N, 3].
            faces: Triangles, shape [M, 3], at least one.
            device: Warp device.
        """
        self._device = device
        self._origin = 0.5 * (points.min(axis=0) + points.max(axis=0))
        self._tree, _ = build_bvhs([(points - self._origin)[faces]], device)

    def cast(self, origin: np.ndarray, direction: np.ndarray, t_max: float) -> tuple[np.ndarray, np.ndarray]:
        """Return the closest hits of rays.

        Args:
            origin: Ray origins [m], shape [R, 3].
            direction: Unit directions, shape [R, 3] or [3].
            t_max: Length of the rays [m].

        Returns:
            Distance [m], shape [R], float64, inf for a miss; face, shape [R], -1 for a miss.
        """
        count, device = len(origin), self._device
        directions = np.ascontiguousarray(np.broadcast_to(direction, (count, 3)), dtype=np.float32)
        exact = origin - self._origin
        starts = exact.astype(np.float32)
        rays = [wp.array(values, dtype=wp.vec3, device=device) for values in (starts, directions)]
        t, face = wp.empty(count, dtype=float, device=device), wp.empty(count, dtype=int, device=device)
        inputs = [self._tree, *rays, t_max]
        wp.launch(rays_kernel, dim=count, inputs=inputs, outputs=[t, face], block_dim=64, device=device)
        # Distance from the exact origin of a ray, not from its float32 origin.
        return t.numpy() + np.einsum("rx,rx->r", starts - exact, directions), face.numpy()
