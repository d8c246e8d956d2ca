"""Cast rays against the town and the vehicles of one frame; only this file queries the BVH of instances.

A ray is tested against the static town first, which tightens `t_max`; then the vehicles of its own frame. The vehicles
of all frames of a batch share one `wp.Bvh`; each frame is one group of it, and the query starts at the root of that
group. Town and models have BVHs of their own kind.

- Directions are unit vectors. A surface is hit where 0 <= t < t_max; exactly 0 happens only to an origin that lies on
  the surface, so a ray that leaves a surface starts a little off it.
- Instances move rigidly, so `t` in the instance's frame is `t` in the scene.
- `wp.bvh_get_group_root` gives -1 for a frame without vehicles, and a query reads -1 as "the whole BVH", that is
  the vehicles of all frames. Every query here is guarded by the root.
- A query of that BVH keeps its stack in shared memory, one stack a thread: two queries alive in one thread would
  overwrite each other. Launch kernels that call these functions, and all others of their modules, with `block_dim=64`,
  so that the stacks of a block fit: 8 KiB, and as much again where rays traverse Warp's BVHs of the meshes.
- Within a rolling sweep every vehicle is where it is at the instant of the ray (`closest_hit_at`); its box in the BVH
  then covers the whole sweep (`DeviceScene.sweep_s`).
- Equal distances go to the town, then to the lower instance index and the lower face, so the result does not depend
  on the BVH, and the BVH may depend on the batch.
"""

import warp as wp

from mmw.kernels.core.bvh import Tree, is_any_face, nearest_face
from mmw.kernels.core.faces import face_normal, material_of
from mmw.kernels.core.rigid_motion import instance_pose_at
from mmw.kernels.core.structs import MISS_ID, Candidates, Hit, RawHit, Scene

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": False})

TRACE_REGISTERS = 80
"""Registers of a thread that casts one ray, on CUDA: the compiler's choice is 96, and the smaller number has more rays
in flight, 8 % more a second on an H100 (`bench/README.md`)."""

PICTURE_REGISTERS = 64
"""The same for rays of pictures, of which those of a block go side by side: 2 % more of them a second than with 80 or
96. A LiDAR's need the same time with both."""

FACE_BITS = wp.constant(wp.uint64(0xFFFFFFFF))
"""The part of what `nearest_face` returns that names the face."""

TIE_REACH = wp.constant(1.000001)
"""A later instance is searched to this multiple of the distance so far, so that equal distances are found."""


@wp.func
def nearest_in_tree(tree: Tree, root: int, origin: wp.vec3, direction: wp.vec3, t_max: float) -> RawHit:
    """Return the first face of one mesh on a ray, such as the road under a wheel; its `t` is `t_max` for a miss.

    Args:
        tree: BVHs of some meshes.
        root: Root of the one.
        origin: Start of the ray in the mesh's frame [m].
        direction: Unit direction in the mesh's frame.
        t_max: Length of the ray [m].
    """
    near = RawHit()
    near.t = t_max
    near.instance = MISS_ID
    found = nearest_face(tree, root, origin, direction, t_max)
    near.face = int(wp.uint32(found & FACE_BITS)) - 1
    if near.face >= 0:
        near.t = wp.cast(wp.uint32(found >> wp.uint64(32)), float)
    return near


@wp.func
def nearest_in_town(scene: Scene, origin: wp.vec3, direction: wp.vec3, t_max: float) -> RawHit:
    """Return what the ray hits first of the static town; its `t` is `t_max` for a miss."""
    near = RawHit()
    near.t = t_max
    near.face = MISS_ID
    near.instance = MISS_ID
    if scene.town_root >= 0:
        near = nearest_in_tree(scene.tree, scene.town_root, origin, direction, t_max)
    return near


@wp.func
def nearer_body(
    scene: Scene, instance: int, pose: wp.transformf, origin: wp.vec3, direction: wp.vec3, near: RawHit
) -> RawHit:
    """Return what a ray hits first, from the nearest so far and an instance at a pose."""
    to_local = wp.transform_inverse(pose)
    body = nearest_in_tree(
        scene.tree,
        scene.instance_root[instance],
        wp.transform_point(to_local, origin),
        wp.transform_vector(to_local, direction),
        near.t * TIE_REACH,
    )
    found = near
    if body.face >= 0 and (body.t < near.t or (body.t == near.t and instance < near.instance)):
        found = body
        found.instance = instance
    return found


@wp.func
def is_blocked_by(
    scene: Scene, batch_index: int, instance: int, origin: wp.vec3, direction: wp.vec3, t_max: float
) -> wp.bool:
    """Return whether an instance lies on a ray before `t_max`."""
    to_local = wp.transform_inverse(scene.instance_pose[batch_index, instance])
    return is_any_face(
        scene.tree,
        scene.instance_root[instance],
        wp.transform_point(to_local, origin),
        wp.transform_vector(to_local, direction),
        t_max,
    )


@wp.func
def closest_hit_raw_among(
    scene: Scene, batch_index: int, origin: wp.vec3, direction: wp.vec3, t_max: float, ignore: int,
    candidates: Candidates, group: int,
) -> RawHit:  # fmt: skip
    """Return what the ray hits first among the town and given instances; it does not search the BVH of instances.

    Args:
        scene: Town and vehicles.
        batch_index: Position of the ray's frame in the batch.
        origin: Start of the ray, scene frame [m].
        direction: Unit direction, scene frame.
        t_max: Length of the ray [m].
        ignore: Instance that the ray passes through, -1 for none.
        candidates: Instances by group of rays.
        group: Group of the ray.
    """
    near = nearest_in_town(scene, origin, direction, t_max)
    for k in range(candidates.count[group]):
        instance = int(candidates.instance[group, k])
        if instance != ignore:
            near = nearer_body(scene, instance, scene.instance_pose[batch_index, instance], origin, direction, near)
    if near.face < 0:
        near.t = wp.inf
    return near


@wp.func
def occluded_among(
    scene: Scene,
    batch_index: int,
    origin: wp.vec3,
    direction: wp.vec3,
    t_max: float,
    candidates: Candidates,
    group: int,
) -> bool:
    """Return whether anything lies on the ray before `t_max`; see `closest_hit_raw_among`. A negative group has no
    instances."""
    blocked = wp.bool(False)
    if scene.town_root >= 0:
        blocked = is_any_face(scene.tree, scene.town_root, origin, direction, t_max)
    if group >= 0 and not blocked:
        for k in range(candidates.count[group]):
            if not blocked:
                instance = int(candidates.instance[group, k])
                blocked = is_blocked_by(scene, batch_index, instance, origin, direction, t_max)
    return blocked


@wp.func
def object_of(scene: Scene, near: RawHit) -> int:
    """Return the object id of what `closest_hit_raw` found, -1 for a miss."""
    object_id = wp.int32(MISS_ID)
    if near.face >= 0:
        if near.instance < 0:
            object_id = scene.town_object[near.face]
        else:
            object_id = scene.instance_object[near.instance]
    return object_id


@wp.func
def surface_of(scene: Scene, near: RawHit) -> int:
    """Return the surface id of what `closest_hit_raw` found, -1 for a miss."""
    surface = wp.int32(MISS_ID)
    if near.face >= 0:
        if near.instance < 0:
            surface = scene.town_surface[near.face]
        else:
            face = scene.instance_face_offset[near.instance] + near.face
            surface = scene.instance_surface_offset[near.instance] + scene.model_surface[face]
    return surface


@wp.func
def world_normal(scene: Scene, batch_index: int, near: RawHit) -> wp.vec3:
    """Return the unit normal of what `closest_hit_raw` found, after the winding, in the scene frame."""
    normal = face_normal(scene, near.face, near.instance)
    if near.instance >= 0:
        normal = wp.transform_vector(scene.instance_pose[batch_index, near.instance], normal)
    return normal


@wp.func
def hit_of(scene: Scene, near: RawHit) -> Hit:
    """Return what `closest_hit_raw` found with every id, and its normal after the winding in the frame of its mesh."""
    hit = Hit()
    hit.t = near.t
    hit.face = near.face
    hit.instance = near.instance
    hit.object_id = object_of(scene, near)
    hit.material_id = MISS_ID
    hit.surface = surface_of(scene, near)
    if near.face >= 0:
        hit.material_id = material_of(scene, near.face, near.instance)
        hit.normal = face_normal(scene, near.face, near.instance)
    return hit


def _make_cast(is_moving: bool) -> tuple[wp.Function, wp.Function, wp.Function]:
    """Return the search of a ray among instances and the casts without ids and with them; instances are at their
    frame, or move until the ray."""

    @wp.func
    def among_instances(
        scene: Scene, batch_index: int, origin: wp.vec3, direction: wp.vec3, found: RawHit, ignore: int,
        time_offset: float,
    ) -> RawHit:  # fmt: skip
        """Return what the ray hits first of the instances and what was found of the town."""
        near = found
        root = scene.group_root[batch_index]
        if root >= 0:  # -1 would search every frame's vehicles
            first = batch_index * scene.instance_count
            item = wp.int32(0)
            query = wp.bvh_query_ray(scene.instances[0], origin, direction, root)
            is_more = wp.bool(True)
            while is_more:  # quicker than a search in the head of the loop, see `bench/README.md`
                is_more = wp.bvh_query_next(query, item, near.t)
                instance = item - first
                if is_more and instance != ignore:
                    if wp.static(is_moving):
                        pose = instance_pose_at(scene, batch_index, instance, time_offset)
                    else:
                        pose = scene.instance_pose[batch_index, instance]
                    near = nearer_body(scene, instance, pose, origin, direction, near)
        return near

    @wp.func
    def cast_raw(
        scene: Scene, batch_index: int, origin: wp.vec3, direction: wp.vec3, t_max: float, ignore: int,
        time_offset: float,
    ) -> RawHit:  # fmt: skip
        """Return what the ray hits first, without ids."""
        town = nearest_in_town(scene, origin, direction, t_max)
        near = among_instances(scene, batch_index, origin, direction, town, ignore, time_offset)
        if near.face < 0:
            near.t = wp.inf
        return near

    @wp.func
    def cast(
        scene: Scene, batch_index: int, origin: wp.vec3, direction: wp.vec3, t_max: float, ignore: int,
        time_offset: float,
    ) -> Hit:  # fmt: skip
        """Return what the ray hits first, with every id and the normal towards the ray."""
        hit = hit_of(scene, cast_raw(scene, batch_index, origin, direction, t_max, ignore, time_offset))
        if hit.instance >= 0:
            if wp.static(is_moving):
                pose = instance_pose_at(scene, batch_index, hit.instance, time_offset)
            else:
                pose = scene.instance_pose[batch_index, hit.instance]
            hit.normal = wp.transform_vector(pose, hit.normal)
        hit.normal = wp.where(wp.dot(hit.normal, direction) > 0.0, -hit.normal, hit.normal)
        return hit

    return among_instances, cast_raw, cast


_among_instances, _cast_raw, _cast = _make_cast(is_moving=False)
_, _, _cast_moving = _make_cast(is_moving=True)


@wp.func
def nearest_with_instances(scene: Scene, batch_index: int, origin: wp.vec3, direction: wp.vec3, town: RawHit) -> RawHit:
    """Return what the ray hits first, given what it hits of the town, as `nearest_in_town` has it for the whole ray."""
    return _among_instances(scene, batch_index, origin, direction, town, MISS_ID, 0.0)


@wp.func
def closest_hit_raw(
    scene: Scene, batch_index: int, origin: wp.vec3, direction: wp.vec3, t_max: float, ignore: int
) -> RawHit:
    """Return what the ray hits first, without ids: the cheap form of `closest_hit` for kernels that need few of them.

    Args:
        scene: Town and vehicles.
        batch_index: Position of the ray's frame in the batch.
        origin: Start of the ray, scene frame [m].
        direction: Unit direction, scene frame.
        t_max: Length of the ray [m].
        ignore: Instance that the ray passes through, -1 for none.
    """
    return _cast_raw(scene, batch_index, origin, direction, t_max, ignore, 0.0)


@wp.func
def closest_hit(scene: Scene, batch_index: int, origin: wp.vec3, direction: wp.vec3, t_max: float, ignore: int) -> Hit:
    """Return what the ray hits first, with every id and the normal; see `closest_hit_raw` for the arguments."""
    return _cast(scene, batch_index, origin, direction, t_max, ignore, 0.0)


@wp.func
def closest_hit_at(
    scene: Scene, batch_index: int, origin: wp.vec3, direction: wp.vec3, t_max: float, ignore: int, time_offset: float
) -> Hit:
    """Return what a ray of a rolling sweep hits first; every instance is where it is at the instant of the ray.

    See `closest_hit_raw` for the arguments. `time_offset` is the time of the ray after its frame [s], from
    -`DeviceScene.sweep_s` to 0: outside of it the boxes of the BVH do not hold the instances.
    """
    return _cast_moving(scene, batch_index, origin, direction, t_max, ignore, time_offset)


@wp.func
def occluded(scene: Scene, batch_index: int, origin: wp.vec3, direction: wp.vec3, t_max: float, ignore: int) -> bool:
    """Return whether anything lies on the ray before `t_max`; see `closest_hit_raw` for the arguments."""
    blocked = wp.bool(False)
    if scene.town_root >= 0:
        blocked = is_any_face(scene.tree, scene.town_root, origin, direction, t_max)
    root = scene.group_root[batch_index]
    if root >= 0 and not blocked:  # -1 would search every frame's vehicles
        first = batch_index * scene.instance_count
        item = wp.int32(0)
        query = wp.bvh_query_ray(scene.instances[0], origin, direction, root)
        while not blocked and wp.bvh_query_next(query, item, t_max):
            instance = item - first
            if instance != ignore:
                blocked = is_blocked_by(scene, batch_index, instance, origin, direction, t_max)
    return blocked


@wp.kernel
def group_root_kernel(
    instances: wp.uint64,
    # out
    group_root_out: wp.array[int],
    instances_out: wp.array[wp.uint64],
):
    """Look up the root of each frame's group, -1 for a frame without vehicles, and store the BVH's id.

    Launch: dim=S, block_dim=64, after every build.
    """
    batch_index = wp.tid()
    group_root_out[batch_index] = wp.bvh_get_group_root(instances, batch_index)
    if batch_index == 0:
        instances_out[0] = instances


@wp.kernel
def cast_kernel(
    scene: Scene,
    batch_index: wp.array[int],
    origin: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    t_max: float,
    ignore: wp.array[int],
    # out
    hit_out: wp.array[Hit],
    is_blocked_out: wp.array[wp.bool],
):
    """Trace rays that are given one by one.

    Launch: dim=R, block_dim=64.
    """
    ray = wp.tid()
    hit_out[ray] = closest_hit(scene, batch_index[ray], origin[ray], direction[ray], t_max, ignore[ray])
    is_blocked_out[ray] = occluded(scene, batch_index[ray], origin[ray], direction[ray], t_max, ignore[ray])


@wp.kernel
def cast_at_kernel(
    scene: Scene,
    batch_index: wp.array[int],
    origin: wp.array[wp.vec3],
    direction: wp.array[wp.vec3],
    t_max: float,
    ignore: wp.array[int],
    time_offset: wp.array[float],
    # out
    hit_out: wp.array[Hit],
):
    """Trace rays of a rolling sweep that are given one by one, each with its time after its frame [s].

    Launch: dim=R, block_dim=64.
    """
    ray = wp.tid()
    hit_out[ray] = closest_hit_at(
        scene, batch_index[ray], origin[ray], direction[ray], t_max, ignore[ray], time_offset[ray]
    )
