"""Interpolate the points of surfaces that a camera shades: corners, normals, footprints, textures. Casts no ray."""

import warp as wp

from mmw.kernels.core.faces import face_corners, face_row, material_of
from mmw.kernels.core.structs import Scene
from mmw.kernels.shading.structs import AppearanceTable, SurfacePoint
from mmw.kernels.shading.texture import MAX_TAPS, sample_texture

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": True})

MIN_COSINE = wp.constant(0.02)
"""A shading normal makes at least this cosine with the direction to the viewer and with the face's normal [-]. Design
value: 1.1 degrees, so that what shades with it divides by no zero."""

MIN_VIEW_COSINE = wp.constant(0.01)
"""Footprints grow no longer than at this cosine of incidence [-]; design value, far beyond what the taps reach."""

MIN_ROUGHNESS = wp.constant(0.02)
"""Roughness that a texture gives is at least this [-]; design value."""


@wp.struct
class RayHit:
    """A ray and the face that it hit."""

    batch_index: int
    """Position of the ray's frame in the batch."""
    origin: wp.vec3
    """Start of the ray, scene frame [m]."""
    direction: wp.vec3
    """Unit direction, scene frame."""
    t: float
    """Distance to the point [m]."""
    face: int
    """Face of the town or of the instance's model, >= 0."""
    instance: int
    """Instance, -1 for the town."""


@wp.func
def ray_hit(batch_index: int, origin: wp.vec3, direction: wp.vec3, t: float, face: int, instance: int) -> RayHit:
    """Return a ray with its hit."""
    hit = RayHit()
    hit.batch_index = batch_index
    hit.origin = origin
    hit.direction = direction
    hit.t = t
    hit.face = face
    hit.instance = instance
    return hit


@wp.struct
class Patch:
    """A face around a point of it, in the frame of its mesh: what texture and normal are interpolated from."""

    row: int
    """Row of the face in `Scene.town_*` or `Scene.model_*`."""
    point: wp.vec3
    """The point [m]."""
    direction: wp.vec3
    """Direction of the ray that hit it, unit."""
    normal: wp.vec3
    """Unit normal after the winding; zero for a face without area."""
    toward_b: wp.vec3
    """Gradient of the weight of the second corner [1/m]; zero for a face without area."""
    toward_c: wp.vec3
    """Gradient of the weight of the third corner [1/m]."""
    weight: wp.vec3
    """Weights of the corners, each 0 to 1, together 1."""


@wp.func
def local_ray(scene: Scene, batch_index: int, instance: int, origin: wp.vec3, direction: wp.vec3):
    """Return origin and direction of a ray in the frame of an instance; as they are for the town."""
    start = origin
    along = direction
    if instance >= 0:
        to_local = wp.transform_inverse(scene.instance_pose[batch_index, instance])
        start = wp.transform_point(to_local, origin)
        along = wp.transform_vector(to_local, direction)
    return start, along


@wp.func
def distance_to_face(
    scene: Scene, batch_index: int, face: int, instance: int, origin: wp.vec3, direction: wp.vec3
) -> float:
    """Return the distance at which a ray hits one face [m], inf if it misses it.

    Source: T. Moeller and B. Trumbore, "Fast, minimum storage ray/triangle intersection", 1997.

    Args:
        scene: Town and vehicles.
        batch_index: Position of the ray's frame in the batch.
        face: Face of the town or of the instance's model, >= 0.
        instance: Instance, -1 for the town.
        origin: Start of the ray, scene frame [m].
        direction: Unit direction, scene frame.
    """
    start, along = local_ray(scene, batch_index, instance, origin, direction)
    corners = face_corners(scene, face, instance)
    ab = corners[1] - corners[0]
    ac = corners[2] - corners[0]
    from_a = start - corners[0]
    square = wp.cross(along, ac)
    volume = wp.dot(ab, square)
    t = wp.inf
    if volume != 0.0:
        across = wp.cross(from_a, ab)
        b = wp.dot(from_a, square) / volume
        c = wp.dot(along, across) / volume
        if b >= 0.0 and c >= 0.0 and b + c <= 1.0:
            t = wp.dot(ac, across) / volume
            t = wp.where(t >= 0.0, t, wp.inf)
    return t


@wp.func
def patch_of(scene: Scene, hit: RayHit) -> Patch:
    """Return the face around the point that a ray hit."""
    patch = Patch()
    start, patch_direction = local_ray(scene, hit.batch_index, hit.instance, hit.origin, hit.direction)
    patch.direction = patch_direction
    corners = face_corners(scene, hit.face, hit.instance)
    a = corners[0]
    ab = corners[1] - a
    ac = corners[2] - a
    across = wp.cross(ab, ac)
    square = wp.dot(across, across)
    patch.row = face_row(scene, hit.face, hit.instance)
    patch.point = start + hit.t * patch.direction
    patch.weight = wp.vec3(1.0, 0.0, 0.0)
    if square > 0.0:
        patch.normal = across / wp.sqrt(square)
        patch.toward_b = wp.cross(ac, across) / square
        patch.toward_c = wp.cross(across, ab) / square
        b = wp.clamp(wp.dot(patch.point - a, patch.toward_b), 0.0, 1.0)
        c = wp.clamp(wp.dot(patch.point - a, patch.toward_c), 0.0, 1.0 - b)
        patch.weight = wp.vec3(1.0 - b - c, b, c)
    return patch


@wp.struct
class Footprint:
    """Texture coordinates and footprint of a pixel on a textured face."""

    st: wp.vec2
    """Texture coordinates of the mesh at the point."""
    ds: wp.vec2
    """Short side of the pixel on the surface, in texture coordinates: across the ray."""
    dt: wp.vec2
    """Long side: along the ray."""
    along_s: wp.vec3
    """Gradient of s on the face [1/m], in the frame of the mesh."""
    along_t: wp.vec3
    """Gradient of t."""


@wp.func
def footprint_of(table: AppearanceTable, patch: Patch, instance: int, width: float) -> Footprint:
    """Return texture coordinates of a point, and how far they reach over a pixel that is `width` [m] wide there."""
    if instance >= 0:
        st_a = table.model_uv[patch.row, 0]
        st_b = table.model_uv[patch.row, 1]
        st_c = table.model_uv[patch.row, 2]
    else:
        st_a = table.town_uv[patch.row, 0]
        st_b = table.town_uv[patch.row, 1]
        st_c = table.town_uv[patch.row, 2]
    ab = st_b - st_a
    ac = st_c - st_a
    footprint = Footprint()
    footprint.st = st_a + ab * patch.weight[1] + ac * patch.weight[2]
    footprint.along_s = patch.toward_b * ab[0] + patch.toward_c * ac[0]
    footprint.along_t = patch.toward_b * ab[1] + patch.toward_c * ac[1]
    across = wp.cross(patch.normal, patch.direction)
    sine = wp.length(across)
    if sine > 1.0e-3:
        across = across / sine
    else:  # straight ahead, every direction on the face will do
        other = wp.where(wp.abs(patch.normal[0]) < 0.5, wp.vec3(1.0, 0.0, 0.0), wp.vec3(0.0, 1.0, 0.0))
        across = wp.normalize(wp.cross(patch.normal, other))
    along = wp.cross(across, patch.normal)
    reach = width / wp.max(wp.abs(wp.dot(patch.normal, patch.direction)), MIN_VIEW_COSINE)
    footprint.ds = wp.vec2(wp.dot(footprint.along_s, across), wp.dot(footprint.along_t, across)) * width
    footprint.dt = wp.vec2(wp.dot(footprint.along_s, along), wp.dot(footprint.along_t, along)) * reach
    return footprint


@wp.func
def interpolated_normal(table: AppearanceTable, patch: Patch, instance: int) -> wp.vec3:
    """Return the unit normal between the corners, in the mesh's frame, on the side that the winding gives the face."""
    if instance >= 0:
        a = table.model_normal[patch.row, 0]
        b = table.model_normal[patch.row, 1]
        c = table.model_normal[patch.row, 2]
    else:
        a = table.town_normal[patch.row, 0]
        b = table.town_normal[patch.row, 1]
        c = table.town_normal[patch.row, 2]
    normal = a * patch.weight[0] + b * patch.weight[1] + c * patch.weight[2]
    length = wp.length(normal)
    if length < 1.0e-3:
        return patch.normal
    side = wp.where(wp.dot(a + b + c, patch.normal) < 0.0, -1.0, 1.0)  # normals that were written inside out
    return normal * (side / length)


@wp.func
def mapped_normal(table: AppearanceTable, use: int, footprint: Footprint, normal: wp.vec3) -> wp.vec3:
    """Return a normal bent by a normal map, in the mesh's frame; as it is where texture coordinates span no area.

    The map's x runs along growing u of the texture, its y along growing v.
    """
    used = table.uses[use]
    along_u = footprint.along_s * used.row_u[0] + footprint.along_t * used.row_u[1]
    along_v = footprint.along_s * used.row_v[0] + footprint.along_t * used.row_v[1]
    toward_u = wp.cross(along_v, normal)
    toward_v = wp.cross(normal, along_u)
    turn = wp.sign(wp.dot(along_u, toward_u))
    u_length = wp.length(toward_u)
    v_length = wp.length(toward_v)
    if u_length <= 0.0 or v_length <= 0.0:
        return normal
    bent = sample_texture(table, use, footprint.st, footprint.ds, footprint.dt, 1)
    mapped = toward_u * (turn * bent[0] / u_length) + toward_v * (turn * bent[1] / v_length) + normal * bent[2]
    length = wp.length(mapped)
    return wp.where(length > 1.0e-3, mapped / wp.max(length, 1.0e-3), normal)


@wp.func
def toward_viewer(normal: wp.vec3, face_normal: wp.vec3, direction: wp.vec3) -> wp.vec3:
    """Return a shading normal bent as little as needed to face the viewer and stay on the visible side of the face."""
    bent = normal
    short = MIN_COSINE - wp.dot(bent, face_normal)
    if short > 0.0:
        bent = wp.normalize(bent + face_normal * short)
    short = MIN_COSINE + wp.dot(bent, direction)
    if short > 0.0:
        bent = wp.normalize(bent - direction * short)
    return bent


@wp.func
def pick(value: wp.vec4, channel: int) -> float:
    """Return one channel of a texture's value."""
    picked = value[0]
    if channel == 1:
        picked = value[1]
    elif channel == 2:
        picked = value[2]
    elif channel == 3:
        picked = value[3]
    return picked


@wp.func
def number_from(table: AppearanceTable, use: int, footprint: Footprint, max_taps: int) -> float:
    """Return the number that a texture gives, 0 to 1."""
    value = sample_texture(table, use, footprint.st, footprint.ds, footprint.dt, max_taps)
    return wp.clamp(pick(value, table.uses[use].channel), 0.0, 1.0)


@wp.func
def surface_point_of(scene: Scene, table: AppearanceTable, hit: RayHit, spread: float) -> SurfacePoint:
    """Return the point that a ray hit as a camera shades it.

    Args:
        scene: Town and vehicles.
        table: Appearances and textures.
        hit: The ray and the face that it hit.
        spread: Angle of one pixel [rad]: textures are filtered over spread * t.
    """
    patch = patch_of(scene, hit)
    surface_point = SurfacePoint()
    surface_point.point = hit.origin + hit.t * hit.direction
    surface_point.material = material_of(scene, hit.face, hit.instance)
    appearance = table.appearances[surface_point.material]
    surface_point.color = appearance.color
    surface_point.emission = appearance.emission
    surface_point.roughness = appearance.roughness
    surface_point.metallic = appearance.metallic
    surface_point.opacity = wp.where(appearance.opacity_threshold > 0.0, 1.0, appearance.opacity)
    if wp.dot(patch.normal, patch.normal) < 0.5:  # a face without area
        surface_point.normal = -hit.direction
        surface_point.shading_normal = -hit.direction
        return surface_point
    shading = interpolated_normal(table, patch, hit.instance)
    if (
        appearance.color_texture >= 0
        or appearance.normal_texture >= 0
        or appearance.roughness_texture >= 0
        or appearance.metallic_texture >= 0
        or appearance.emission_texture >= 0
        or appearance.opacity_texture >= 0
    ):
        footprint = footprint_of(table, patch, hit.instance, spread * hit.t)
        if appearance.color_texture >= 0:
            color = sample_texture(table, appearance.color_texture, footprint.st, footprint.ds, footprint.dt, MAX_TAPS)
            surface_point.color = wp.vec3(
                wp.clamp(color[0], 0.0, 1.0), wp.clamp(color[1], 0.0, 1.0), wp.clamp(color[2], 0.0, 1.0)
            )
        if appearance.normal_texture >= 0:
            shading = mapped_normal(table, appearance.normal_texture, footprint, shading)
        if appearance.roughness_texture >= 0:
            surface_point.roughness = wp.max(
                number_from(table, appearance.roughness_texture, footprint, 1), MIN_ROUGHNESS
            )
        if appearance.metallic_texture >= 0:
            surface_point.metallic = number_from(table, appearance.metallic_texture, footprint, 1)
        if appearance.emission_texture >= 0:
            glow = sample_texture(
                table, appearance.emission_texture, footprint.st, footprint.ds, footprint.dt, MAX_TAPS
            )
            surface_point.emission = wp.vec3(wp.max(glow[0], 0.0), wp.max(glow[1], 0.0), wp.max(glow[2], 0.0))
        if appearance.opacity_texture >= 0 and appearance.opacity_threshold <= 0.0:
            surface_point.opacity = number_from(table, appearance.opacity_texture, footprint, MAX_TAPS)
    side = wp.where(wp.dot(patch.normal, patch.direction) > 0.0, -1.0, 1.0)
    shading = toward_viewer(shading * side, patch.normal * side, patch.direction)
    surface_point.normal = patch.normal * side
    surface_point.shading_normal = shading
    if hit.instance >= 0:
        pose = scene.instance_pose[hit.batch_index, hit.instance]
        surface_point.normal = wp.transform_vector(pose, surface_point.normal)
        surface_point.shading_normal = wp.transform_vector(pose, shading)
    return surface_point


@wp.func
def is_cut_out(scene: Scene, table: AppearanceTable, hit: RayHit, spread: float) -> wp.bool:
    """Return whether a ray hit a hole that an opacity texture cuts; see `surface_point_of`."""
    appearance = table.appearances[material_of(scene, hit.face, hit.instance)]
    is_hole = wp.bool(False)
    if appearance.opacity_threshold > 0.0:
        if appearance.opacity_texture >= 0:
            patch = patch_of(scene, hit)
            footprint = footprint_of(table, patch, hit.instance, spread * hit.t)
            is_hole = number_from(table, appearance.opacity_texture, footprint, MAX_TAPS) < appearance.opacity_threshold
        else:
            is_hole = appearance.opacity < appearance.opacity_threshold
    return is_hole
