"""The trees that rays walk, and rays on one mesh.

Our own are built on the CPU, one a mesh, then put one behind the other. Warp's are those of a `wp.Mesh` each, where
`mmw.core.bvh_kind` has chosen them.
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
"""Triangles in a leaf at most where a thread tests them one by one: on an H100 incoherent rays are 8 % faster than with
`LEAF_FACES`, others 1 % (`bench/README.md`). A CPU tests that many at once."""

WARP_BUILD = {"cuda": ("cubql", 2), "cpu": ("sah", 4)}
"""How Warp builds its trees, and triangles in a leaf of them at most: the best of its constructors with 1, 2 and 4, on
an H100 and on a CPU with AVX-512 (`bench/README.md`)."""

BOX_MARGIN = 5e-7
"""How much larger Warp's boxes are than what they hold, over the size of the mesh and `BOX_RANGE_M`. Distances to the
sides of a box, which it compares as they are, are wrong by 3 * 2^-24 at most: rounding loses no triangle that lies so
far from where its ray starts, nor one two times further."""

BOX_RANGE_M = 1000.0
"""Length of rays on small things, such as a vehicle [m]."""


def build_bvhs(meshes: Sequence[np.ndarray], device: str) -> tuple[Tree, np.ndarray]:
    """Return the trees of meshes on a device, and the root of each.

    Args:
        meshes: Corners of the triangles of each mesh [m], shape [M, 3, 3]; M > 0.
        device: Warp device name.

    Returns:
        The trees; the root of each, shape [K], int32.

    Raises:
        InputError: If nobody has chosen the kind of trees, and the environment names none that there is.
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


def _build_warp(meshes: Sequence[np.ndarray], device: str) -> Tree:
    """Return Warp's trees of meshes, which live as long as the array of their ids."""
    built = [_build_warp_mesh(np.ascontiguousarray(corners, dtype=np.float32), device) for corners in meshes]
    tree = Tree()
    tree.nodes = wp.empty(0, dtype=wp.vec4, device=device)
    tree.leaves = wp.empty(0, dtype=wp.vec4, device=device)
    tree.meshes = wp.array(np.array([mesh.id for mesh in built], dtype=np.uint64), dtype=wp.uint64, device=device)
    weakref.finalize(tree.meshes, built.clear).atexit = False
    return tree


def _build_warp_mesh(corners: np.ndarray, device: str) -> wp.Mesh:
    """Return Warp's tree of one mesh, whose boxes are `BOX_MARGIN` larger than its triangles.

    Args:
        corners: Corners of the triangles [m], shape [M, 3, 3], float32.
        device: Warp device name.
    """
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
    # The tree keeps the boxes that it was built over until it is told to refit.
    points.assign(corners.reshape(-1, 3))
    return mesh


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
        self._tree, _ = build_bvhs([(points - self._origin)[faces]], device)

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
