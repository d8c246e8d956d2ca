"""Put a scene on a device: the static town as one mesh, vehicles as instances grouped by frame."""

from collections.abc import Sequence
from copy import copy
from dataclasses import replace

import numpy as np
import warp as wp

from mmw.core.bvh import build_bvhs
from mmw.core.kinematics import Motion, differentiate
from mmw.core.packed_arrays import PackedArrays, borrow_arrays
from mmw.core.remember import remembered
from mmw.core.repeated_launch import launch_again
from mmw.core.replayed_launches import ReplayedLaunches
from mmw.kernels.core import instance_bounds as bounds
from mmw.kernels.core import structs, trace
from mmw.kernels.core.body_motion import instance_motion_kernel
from mmw.scene.foliage import MESH, has_same_crowns, optical_arrays
from mmw.scene.scene_data import MODEL_NONE, Actor, SceneData

REBASE_BEYOND_M = 2000.0
"""Distance from the world origin [m] beyond which a town is traced about its center; float32 resolves 0.12 mm here."""


def instance_actors(arrays: SceneData) -> np.ndarray:
    """Return the actor index of every instance: the actors that have a prototype, in their order. Shape [V], int32."""
    return _with_prototype(arrays.actors)


@remembered()
def _with_prototype(actors: tuple[Actor, ...]) -> np.ndarray:
    return np.array([i for i, actor in enumerate(actors) if actor.model != MODEL_NONE], dtype=np.int32)


@remembered()
def _instance_columns(actors: tuple[Actor, ...]) -> wp.array:
    """Return the same as an array for kernels of the host."""
    return wp.array(_with_prototype(actors), dtype=wp.int32, device="cpu")


def scene_origin(points: np.ndarray) -> np.ndarray:
    """Return the world position of the scene frame's origin [m], shape [3]: zero unless the town is far away."""
    if len(points) == 0 or np.abs(points).max() <= REBASE_BEYOND_M:
        return np.zeros(3)
    return np.round(0.5 * (points.min(axis=0) + points.max(axis=0)))


def _same_instances(one: SceneData, other: SceneData) -> bool:
    """Return whether two scenes have the same actors with geometry."""
    if one.actors is other.actors:
        return True
    return [one.actors[i] for i in instance_actors(one)] == [other.actors[i] for i in instance_actors(other)]


def copy_struct(struct: structs.Scene, **changed: object) -> structs.Scene:
    """Return the argument of kernels with some fields changed; arrays are shared."""
    other = structs.Scene()
    for name in structs.Scene.vars:
        setattr(other, name, changed.get(name, getattr(struct, name)))
    return other


class DeviceScene:
    """Town and vehicles on one device, for a batch of frames at a time.

    The scene frame is the world frame moved by `origin`: a position in it is the world position minus `origin`, which
    is zero for every town within 2 km of the world's origin. The batch index of a frame is its position in the batch.

    Attributes:
        arrays: The scene on the host.
        device: Warp device name.
        struct: Argument of kernels.
        origin: World position of the scene frame's origin [m], shape [3], float64.
        instance_actor: Actor index of each instance, shape [V].
        instance_radius_m: Radius of a sphere about the origin of an instance that contains any instance [m].
        surface_count: Number of surfaces of town and instances.
        surface_offset: First surface id of each instance, shape [V].
        batch_frames: Loaded frames by batch index.
        sweep_s: Longest time before a frame at which instances can be traced where they were then [s].
    """

    def __init__(
        self,
        arrays: SceneData,
        device: str,
        max_batch_frames: int,
        *,
        sweep_s: float = 0.0,
        instance_constructor: str | None = None,
    ):
        """Build the BVHs of town and prototypes; `load_batch` adds the vehicles.

        Args:
            arrays: The scene on the host.
            device: Warp device name.
            max_batch_frames: Frames in the largest batch, > 0.
            sweep_s: Longest sweep before a frame for rays of `closest_hit_at` [s], >= 0.
            instance_constructor: Constructor of the BVH over instances; the default is LBVH on CUDA and SAH on the CPU.

        Raises:
            ValueError: If `max_batch_frames` is not positive, or `sweep_s` is negative or not finite.
        """
        if max_batch_frames < 1:
            raise ValueError(f"max_batch_frames = {max_batch_frames}; a batch needs at least one frame")
        if not 0.0 <= sweep_s < np.inf:
            raise ValueError(f"sweep_s = {sweep_s}; a scene needs a time of 0 s or more; give the length of one sweep")
        self.arrays = arrays
        self.device = device
        self.max_batch_frames = max_batch_frames
        self.sweep_s = sweep_s
        self.batch_frames: tuple[int, ...] = ()
        self.origin = scene_origin(arrays.points)
        self._origin: list[float] = self.origin.tolist()
        self._is_cuda = wp.get_device(device).is_cuda
        self._instance_constructor = instance_constructor
        # On CUDA Warp rebuilds a tree in place with LBVH alone.
        self._is_rebuilt = not self._is_cuda or instance_constructor in (None, "lbvh")
        self.instance_actor = instance_actors(arrays)
        self._differentiate()
        self.struct = structs.Scene()
        self._load_meshes()
        self._load_models()
        self._optical: DeviceScene | None = None
        self._may_have_leaves = arrays.foliage == "leaves"

    @property
    def optical(self) -> "DeviceScene":
        """The scene as light and radar meet it, which sensors trace; the radio channel traces the scene itself.

        It is the scene itself, or one with leaves in place of the hulls of crowns that shares the loaded batch and all
        else, made at the first call. `load_batch` and `replace_arrays` are for the scene alone, which passes them on.
        """
        if self._optical is None and self._may_have_leaves:
            leafy = optical_arrays(self.arrays)
            self._may_have_leaves = leafy is not self.arrays
            if self._may_have_leaves:
                self._optical = self._with_arrays(leafy)
                self._optical.struct = copy_struct(self.struct)
                self._optical._load_meshes()
        return self if self._optical is None else self._optical

    @property
    def batch_size(self) -> int:
        """Number of loaded frames."""
        return len(self.batch_frames)

    def _differentiate(self, motion: Motion | None = None) -> None:
        """Keep the derivatives of the whole recording, so that they do not depend on the batch."""
        motion = motion or differentiate(self.arrays.poses, self.arrays.pose_dt)
        self._derivatives = motion.velocity, motion.world_rate

    def replace_arrays(self, arrays: SceneData, motion: Motion | None = None) -> None:
        """Take other frames, poses, materials or actors without geometry; `load_batch` must follow.

        The meshes on the device stay, so that this costs no build of a tree.

        Args:
            arrays: The scene with the same meshes: `points`, `faces`, `models`, the actors that have geometry and
                what is foliage are those that the device holds.
            motion: `differentiate(arrays.poses, arrays.pose_dt)`, if at hand.

        Raises:
            ValueError: If a mesh is another one.
        """
        self._check_meshes("replace_arrays", arrays)
        self.arrays, self.instance_actor, self.batch_frames = arrays, instance_actors(arrays), ()
        self._differentiate(motion)
        self._optical = self._optical_with(arrays)

    def with_agents(self, arrays: SceneData) -> "DeviceScene":
        """Return the scene with further actors without geometry, which shares the loaded batch and all else.

        It costs nothing, and serves until this scene loads another batch; `load_batch` is for this scene alone.

        Args:
            arrays: The scene with the same meshes, see `replace_arrays`; in the loaded frames, the poses of actors that
                have geometry are the same too.

        Raises:
            ValueError: If a mesh is another one.
        """
        self._check_meshes("with_agents", arrays)
        other = self._with_arrays(arrays)
        if self.optical is not self:
            other._optical = self._optical_with(arrays)
        return other

    def _with_arrays(self, arrays: SceneData) -> "DeviceScene":
        """Return the scene with other arrays and everything else shared, which is its own optical scene."""
        other = copy(self)
        other.arrays, other.instance_actor = arrays, instance_actors(arrays)
        other._optical, other._may_have_leaves = None, False
        return other

    def _optical_with(self, arrays: SceneData) -> "DeviceScene | None":
        """Return the optical scene with all but the static mesh of other arrays; None if there is none yet."""
        if self._optical is None:
            return None
        leafy = {name: getattr(self._optical.arrays, name) for name in MESH}
        return self._optical._with_arrays(replace(arrays, **leafy))

    def _check_meshes(self, method: str, arrays: SceneData) -> None:
        meshes = ("points", "faces", "material", "object_id", "surface", "models")
        if (
            any(getattr(arrays, name) is not getattr(self.arrays, name) for name in meshes)
            or not _same_instances(self.arrays, arrays)
            or not has_same_crowns(self.arrays, arrays)
        ):
            raise ValueError(f"{method}: another mesh or another actor with geometry; make a new DeviceScene")

    def check_loaded(self, kind: str, batch_index: np.ndarray, frame: np.ndarray) -> None:
        """Check that frames are loaded at their batch indices, shape [n] each; `kind` names a row in the message.

        Raises:
            ValueError: If a frame is not.
        """
        loaded = np.array([*self.batch_frames, np.iinfo(np.int64).min])  # an index behind the last is that of no frame
        is_loaded = (batch_index >= 0) & (loaded.take(batch_index, mode="clip") == frame)
        if not is_loaded.all():
            row = int(np.argmin(is_loaded))
            raise ValueError(
                f"{kind} {row}: frame {frame[row]} at batch index {batch_index[row]}; the scene holds frames "
                f"{list(self.batch_frames[:8])}; call load_batch with the frames that the {kind}s were made for"
            )

    def _array(self, values: np.ndarray, dtype: type) -> wp.array:
        return wp.array(values, dtype=dtype, device=self.device)

    def _load_meshes(self) -> None:
        arrays, struct = self.arrays, self.struct
        town = (arrays.points - self.origin).astype(np.float32)[arrays.faces]
        models = [model.points.astype(np.float32)[model.faces] for model in arrays.models]
        has_town = len(town) > 0
        struct.tree, roots = build_bvhs([town, *models] if has_town else models, self.device)
        struct.town_root = int(roots[0]) if has_town else -1
        model = np.array([arrays.actors[i].model for i in self.instance_actor], dtype=np.int32)
        struct.instance_root = self._array(roots[int(has_town) :][model], wp.int32)
        struct.town_corner = self._array(town.reshape(-1, 3, 3), wp.vec3)
        struct.model_corner = self._array(np.concatenate([np.zeros((0, 3, 3), np.float32), *models]), wp.vec3)
        struct.town_material = self._array(arrays.material, wp.int32)
        struct.town_object = self._array(arrays.object_id, wp.int32)
        struct.town_surface = self._array(arrays.surface, wp.int32)

    def _load_models(self) -> None:
        arrays, struct = self.arrays, self.struct
        actors = [arrays.actors[i] for i in self.instance_actor]
        model = np.array([actor.model for actor in actors], dtype=np.int32)
        face_offset = np.cumsum([0] + [len(m.faces) for m in arrays.models])
        surfaces = np.array([int(m.surface.max()) + 1 for m in arrays.models], dtype=np.int64)
        ends = arrays.town_surface_count + np.cumsum(surfaces[model] if len(model) else [], dtype=np.int64)
        self.surface_offset = np.concatenate([[arrays.town_surface_count], ends])[:-1].astype(np.int32)
        self.surface_count = int(ends[-1]) if len(ends) else arrays.town_surface_count
        struct.instance_count = len(actors)
        struct.instance_object = self._array(np.array([a.object_id for a in actors], dtype=np.int32), wp.int32)
        struct.instance_face_offset = self._array(face_offset[model].astype(np.int32), wp.int32)
        struct.instance_surface_offset = self._array(self.surface_offset, wp.int32)
        none = [np.zeros(0, np.int32)]
        struct.model_material = self._array(np.concatenate(none + [m.material for m in arrays.models]), wp.int32)
        struct.model_surface = self._array(np.concatenate(none + [m.surface for m in arrays.models]), wp.int32)
        wheels = np.cumsum([0] + [len(m.wheels) for m in arrays.models])
        wheel = [np.where(m.wheel >= 0, m.wheel + k, -1) for m, k in zip(arrays.models, wheels[:-1], strict=True)]
        struct.model_wheel = self._array(np.concatenate(none + wheel).astype(np.int32), wp.int32)
        struct.wheels = self._array(
            np.concatenate([np.zeros((0, 4))] + [m.wheels for m in arrays.models]).astype(np.float32), wp.vec4
        )
        lower = np.array([m.points.min(axis=0) for m in arrays.models]).reshape(-1, 3)[model]
        upper = np.array([m.points.max(axis=0) for m in arrays.models]).reshape(-1, 3)[model]
        self._model_lower = self._array(lower.astype(np.float32), wp.vec3)
        self._model_upper = self._array(upper.astype(np.float32), wp.vec3)
        frames, instances = self.max_batch_frames, len(actors)
        struct.instance_aabb_center = self._array((0.5 * (lower + upper)).astype(np.float32), wp.vec3)
        # Slightly more than half the extent, as a margin for rounding.
        half = 0.5001 * (upper - lower) + 1e-3
        struct.instance_aabb_half_extent = self._array(half.astype(np.float32), wp.vec3)
        around_origin = np.linalg.norm(half, axis=1) + 0.5 * np.linalg.norm(lower + upper, axis=1)
        self.instance_radius_m = float(around_origin.max(initial=0.0))
        self._lower = wp.zeros(frames * instances, dtype=wp.vec3, device=self.device)
        self._upper = wp.zeros(frames * instances, dtype=wp.vec3, device=self.device)
        self._group = wp.full(frames * instances, frames, dtype=wp.int32, device=self.device)
        kinds = (wp.transformf, wp.vec3, wp.vec3, wp.bool)
        self._motion = PackedArrays(self.device, tuple(((frames, instances), kind) for kind in kinds), is_pinned=True)
        self._copied: wp.Event | None = None
        self._placed = ReplayedLaunches(self.device)
        names = ("instance_pose", "instance_velocity", "instance_rate", "instance_present")
        for name, array in zip(names, self._motion.arrays, strict=True):
            setattr(struct, name, array)
            array.zero_()
        struct.group_root = wp.full(frames, -1, dtype=wp.int32, device=self.device)
        struct.instances = wp.zeros(1, dtype=wp.uint64, device=self.device)
        self._instances: wp.Bvh | None = None

    def load_batch(self, frames: Sequence[int]) -> None:
        """Load a batch of frames: batch index b holds `frames[b]`. The same frame may be listed more than once.

        Args:
            frames: Frame numbers, 1 to `max_batch_frames` of them.

        Raises:
            ValueError: If there are none or too many, or the scene does not cover one.
        """
        if not 1 <= len(frames) <= self.max_batch_frames:
            raise ValueError(f"batch of {len(frames)} frames; this scene holds 1 to {self.max_batch_frames} at a time")
        rows = self.arrays.frame_rows(frames)
        self.batch_frames = tuple(int(frame) for frame in frames)
        self._load_poses(rows)
        if self._optical is not None:  # its arrays of poses are these
            self._optical.batch_frames, self._optical.sweep_s = self.batch_frames, self.sweep_s
            self._optical._instances = self._instances

    def _load_poses(self, rows: np.ndarray) -> None:
        if self.struct.instance_count == 0:
            return
        if self._copied is not None:  # what is overwritten has been copied to the device
            wp.synchronize_event(self._copied)
        shape = len(rows), len(self.arrays.actors)
        block = borrow_arrays("cpu", ((*shape, 7), wp.float64), (shape, wp.vec3d), (shape, wp.vec3d))
        for target, values in zip(block.host, (self.arrays.poses, *self._derivatives), strict=True):
            target[...] = values[rows]
        given = *block.arrays, _instance_columns(self.arrays.actors), *self._origin
        frames = self.max_batch_frames, self.struct.instance_count
        launch_again(instance_motion_kernel, frames, [*given, *self._motion.host_arrays], "cpu")
        block.release()
        if self._is_rebuilt:
            self._placed.run(self._place_instances, self.sweep_s)
        else:
            self._place_instances()
        if self._is_cuda:
            self._copied = wp.get_stream(self.device).record_event(self._copied)

    def _place_instances(self) -> None:
        """Copy the poses of the batch to the device and build the tree of its instances, in place after the first one.

        Warp reads boxes and groups anew when it rebuilds a tree: it is the same one as if it were made now.
        """
        pose, velocity, rate, is_present = self._motion.upload()
        given = pose, is_present, self._model_lower, self._model_upper, velocity, rate, self.sweep_s
        boxes = self._lower, self._upper, self._group
        launch_again(bounds.instance_bounds_kernel, pose.shape, [*given, *boxes], self.device)
        tree = self._instances
        if tree is None or not self._is_rebuilt:
            tree = wp.Bvh(self._lower, self._upper, constructor=self._instance_constructor, groups=self._group)
        else:
            tree.rebuild(self._instance_constructor)
        self._instances = tree
        launch_again(
            trace.group_root_kernel,
            (self.max_batch_frames,),
            [tree.id, self.struct.group_root, self.struct.instances],
            self.device,
            block_dim=64,  # as all kernels of its module: a second block size would compile the module twice
        )
