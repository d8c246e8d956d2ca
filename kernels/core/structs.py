"""Types that host and kernels share: sentinels, the scene, views and hits."""

import warp as wp

from mmw.kernels.core.bvh import Tree

MISS_ID = wp.constant(-1)
"""Object, material, surface, face and instance of a miss."""


@wp.struct
class Scene:
    """All surfaces that a ray can hit, for the frames of one batch; a batch index is the position of a frame in it."""

    tree: Tree
    """BVHs of the town, in the scene frame, and of all models, each in its own."""
    town_root: int
    """Root of the static town's BVH; -1 for a scene without static geometry."""
    town_corner: wp.array2d[wp.vec3]
    """Corners of each town face, scene frame [m], shape [M, 3]."""
    town_material: wp.array[int]
    """Material id of each town face, shape [M]."""
    town_object: wp.array[int]
    """Object id of each town face, shape [M]."""
    town_surface: wp.array[int]
    """Surface id of each town face, shape [M]."""
    instances: wp.array[wp.uint64]
    """wp.Bvh id over instance boxes, grouped by batch index, shape [1]; item = batch_index * V + instance. It is in
    memory as each batch has another one, which recorded launches must find."""
    group_root: wp.array[int]
    """BVH root of each frame's group, shape [S]; -1 where the frame has no instance present."""
    instance_count: int
    """V: instances of a frame, present or not."""
    instance_pose: wp.array2d[wp.transformf]
    """Instance to scene frame, shape [S, V]."""
    instance_velocity: wp.array2d[wp.vec3]
    """Velocity of the instance's origin in the scene frame [m/s], shape [S, V]; zero where it is absent."""
    instance_rate: wp.array2d[wp.vec3]
    """Angular velocity of the instance about the axes of the scene frame [rad/s], shape [S, V]; zero where absent."""
    instance_present: wp.array2d[wp.bool]
    """True if the instance is in the scene, shape [S, V]."""
    instance_aabb_center: wp.array[wp.vec3]
    """Middle of a box about the instance's model, in its frame [m], shape [V]."""
    instance_aabb_half_extent: wp.array[wp.vec3]
    """Half the sides of that box [m], shape [V]."""
    instance_root: wp.array[int]
    """Root of the BVH of the instance's model, shape [V]."""
    instance_object: wp.array[int]
    """Object id, shape [V]."""
    instance_face_offset: wp.array[int]
    """First face of the instance's model in `model_*`, shape [V]."""
    instance_surface_offset: wp.array[int]
    """Surface id of the instance = this offset + local surface, shape [V]."""
    model_corner: wp.array2d[wp.vec3]
    """Corners of each face of all models, one after the other, each in its model's frame [m]."""
    model_material: wp.array[int]
    """Material id of each face of all models, one after the other."""
    model_surface: wp.array[int]
    """Local surface index of each face of all models."""
    model_wheel: wp.array[int]
    """Row of `wheels` that each face of all models turns with, -1 for a face that is fixed to its body."""
    wheels: wp.array[wp.vec4]
    """Wheels of all models, one after the other: center x, y, z in the model's frame [m] and radius [m], shape [W]."""


@wp.struct
class Candidates:
    """The only instances that some rays can hit, by group of rays."""

    count: wp.array[int]
    """Number of them, shape [G]."""
    instance: wp.array2d[wp.int16]
    """Their numbers, rising, shape [G, V]."""


@wp.struct
class Views:
    """Sensor poses: one row a view."""

    batch_index: wp.array[int]
    """Position of the view's frame in the batch, shape [A]."""
    pose: wp.array[wp.transformf]
    """Sensor to scene frame, shape [A]."""
    ignore: wp.array[int]
    """Instance that the view does not see, -1 for none, shape [A]."""


@wp.struct
class Hit:
    """The nearest surface on a ray."""

    t: float
    """Distance along the unit direction [m], inf for a miss."""
    object_id: int
    material_id: int
    surface: int
    face: int
    instance: int
    """Instance index, -1 for the town or a miss (tell them apart by `object_id`)."""
    normal: wp.vec3
    """Unit geometric normal in the scene frame, turned against the ray."""


@wp.struct
class RawHit:
    """First hit of a ray, before its ids are looked up."""

    t: float
    """Distance along the unit direction [m], inf for a miss."""
    face: int
    """Face of the town, or of the instance's model; -1 for a miss."""
    instance: int
    """Instance index, -1 for the town or a miss."""
