"""Let waves pass the foliage of a scene: trace without it, and measure how long each path runs inside."""

import numpy as np
import warp as wp

from mmw.channel.path_solver.traced_paths import TracedPaths
from mmw.core.bvh import build_bvhs
from mmw.kernels.channel.foliage import Hulls, length_inside_kernel
from mmw.kernels.core import structs
from mmw.scene.device_scene import DeviceScene, copy_struct
from mmw.scene.foliage import foliage_faces
from mmw.scene.mesh_edges import find_edges

BOX_MARGIN_M = 0.01
"""Enlargement of the boxes of faces [m]: a ray in single precision meets the box of every face that it crosses."""


class Foliage:
    """Foliage of the static world of a scene: its faces with a material whose medium is foliage.

    Waves pass it; what they lose follows from the length inside its closed hulls, where overlapping hulls count once.
    Faces that close no volume are passed without loss. Foliage of instances, which move, stays a solid.

    Attributes:
        is_foliage: Whether a surface of the scene is foliage, shape [G], bool.
        solid_faces: Which faces of the static world are none, shape [M], bool.
        outward: Outward normals of its surfaces, 0 where they close no volume, shape [G, 3].
        open_faces: Number of foliage faces that close no volume.
    """

    def __init__(self, scene: DeviceScene, surface_count: int):
        """Find the foliage, and build BVHs of the rest and of the closed hulls.

        Args:
            scene: The scene; nothing of its batch is used.
            surface_count: Number of surfaces G of town and instances.
        """
        arrays = scene.arrays
        of_face = foliage_faces(arrays)
        self.is_foliage = np.zeros(surface_count, dtype=bool)
        self.is_foliage[arrays.surface[of_face]] = True
        self.solid_faces = ~of_face
        self.outward = np.zeros((surface_count, 3))
        self._town: dict[str, object] = {}
        self._hulls: Hulls | None = None
        self.open_faces = 0
        if of_face.any():
            self._town = self._solid_town(scene)
            self._hulls = self._closed_hulls(scene, arrays.faces[of_face], arrays.surface[of_face])

    def _solid_town(self, scene: DeviceScene) -> dict[str, object]:
        """Return the fields of `structs.Scene` that lack the foliage."""
        arrays, keep, struct = scene.arrays, self.solid_faces, {}
        town = (arrays.points - scene.origin).astype(np.float32)[arrays.faces[keep]]
        models = [model.points.astype(np.float32)[model.faces] for model in arrays.models]
        meshes = [town, *models] if len(town) else models
        model = np.array([arrays.actors[i].model for i in scene.instance_actor], dtype=np.int32)
        struct["town_root"], root = -1, np.zeros(0, dtype=np.int32)
        if meshes:
            struct["tree"], root = build_bvhs(meshes, scene.device)
            struct["town_root"] = int(root[0]) if len(town) else -1
        for name, values, dtype in (
            ("town_corner", town.reshape(-1, 3, 3), wp.vec3),
            ("town_material", arrays.material[keep], wp.int32),
            ("town_object", arrays.object_id[keep], wp.int32),
            ("town_surface", arrays.surface[keep], wp.int32),
            ("instance_root", root[len(meshes) - len(models) :][model], wp.int32),
        ):
            struct[name] = wp.array(values, dtype=dtype, device=scene.device)
        return struct

    def _closed_hulls(self, scene: DeviceScene, faces: np.ndarray, surface: np.ndarray) -> "Hulls | None":
        """Return the faces that close volumes, which look outward, or None; count the others."""
        points = scene.arrays.points - scene.origin
        used, index = np.unique(faces, return_inverse=True)
        mesh = find_edges(points[used], index.reshape(faces.shape))
        self.open_faces = int(mesh.is_open.sum())
        if mesh.is_open.all():
            return None
        outward = np.where(mesh.is_turned[:, None], mesh.welded[:, ::-1], mesh.welded)
        corner = points[used][outward[~mesh.is_open]]
        self.outward[surface[~mesh.is_open]] = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
        hulls = Hulls()
        hulls.corner = wp.array(corner, dtype=wp.vec3d, device=scene.device)
        low, high = (
            wp.array(values.astype(np.float32), dtype=wp.vec3, device=scene.device)
            for values in (corner.min(axis=1) - BOX_MARGIN_M, corner.max(axis=1) + BOX_MARGIN_M)
        )
        self._bvh = wp.Bvh(low, high)
        hulls.bvh = self._bvh.id
        return hulls

    def scene_without(self, scene: DeviceScene) -> structs.Scene:
        """Return the argument of kernels that trace the scene, with its loaded batch, as if there were no foliage."""
        if not self._town:
            return scene.struct
        return copy_struct(scene.struct, **self._town)

    def lengths_inside(self, scene: DeviceScene, tx: np.ndarray, rx: np.ndarray, found: TracedPaths) -> np.ndarray:
        """Return how long each path runs inside foliage [m], shape [P], float64.

        Args:
            scene: The scene.
            tx: Begin of each path, world frame [m], shape [P, 3].
            rx: End of each path [m], shape [P, 3].
            found: The paths.
        """
        count, depth = found.kind.shape
        if self._hulls is None or not count:
            return np.zeros(count)
        step = np.arange(depth + 1)
        points = np.concatenate([tx[:, None], found.vertex, rx[:, None]], axis=1) - scene.origin
        points[:, 1:] = np.where((step < found.order[:, None])[..., None], points[:, 1:], (rx - scene.origin)[:, None])
        is_segment = step <= found.order[:, None]
        begin, end = points[:, :-1][is_segment], points[:, 1:][is_segment]
        length = wp.empty(len(begin), dtype=wp.float64, device=scene.device)
        wp.launch(
            length_inside_kernel,
            dim=len(begin),
            inputs=[self._hulls, *(wp.array(at, dtype=wp.vec3d, device=scene.device) for at in (begin, end))],
            outputs=[length],
            device=scene.device,
            block_dim=64,
        )
        return np.bincount(np.nonzero(is_segment)[0], weights=length.numpy(), minlength=count)
