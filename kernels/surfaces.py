"""What samples show before any light falls on it: textures are read once, and every weather shades the result."""

import warp as wp

from mmw.kernels.camera import Camera
from mmw.kernels.looks import Appearance, Extras, Samples, Surfaces, Surfel
from mmw.kernels.packing import pack_unit, unpack_unit
from mmw.kernels.structs import Scene, Views
from mmw.kernels.surfel import surfel_of
from mmw.kernels.visibility import pixel_direction, place_of, row_of_thread

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": True})


@wp.func
def write_surface(
    surfel: Surfel, row: int,
    # out
    surfaces_out: Surfaces,
):  # fmt: skip
    """Store a surfel without its place, which follows from its ray."""
    surfaces_out.material[row] = surfel.material
    color = surfel.color
    halves = wp.vec4h(wp.float16(color[0]), wp.float16(color[1]), wp.float16(color[2]), wp.float16(surfel.roughness))
    surfaces_out.color[row] = wp.cast(halves, wp.uint64)
    surfaces_out.normal[row] = pack_unit(surfel.shading_normal)
    more = wp.vec2h(wp.float16(surfel.metallic), wp.float16(surfel.opacity))
    surfaces_out.more[row] = wp.cast(more, wp.uint32)
    if surfaces_out.emission.shape[0] > 0:
        light = surfel.emission
        emitted = wp.vec4h(wp.float16(light[0]), wp.float16(light[1]), wp.float16(light[2]), wp.float16(0.0))
        surfaces_out.emission[row] = wp.cast(emitted, wp.uint64)


@wp.func
def read_surface(appearance: Appearance, surfaces: Surfaces, row: int, point: wp.vec3, normal: wp.vec3) -> Surfel:
    """Return a stored surfel.

    Args:
        appearance: Looks of the materials.
        surfaces: What was stored.
        row: Its row.
        point: Where it is, scene frame [m].
        normal: Normal of its face, scene frame.
    """
    surfel = Surfel()
    surfel.point = point
    surfel.normal = normal
    surfel.shading_normal = unpack_unit(surfaces.normal[row])
    surfel.material = surfaces.material[row]
    color = wp.cast(surfaces.color[row], wp.vec4h)
    surfel.color = wp.vec3(float(color[0]), float(color[1]), float(color[2]))
    surfel.roughness = float(color[3])
    more = wp.cast(surfaces.more[row], wp.vec2h)
    surfel.metallic = float(more[0])
    surfel.opacity = float(more[1])
    if surfaces.emission.shape[0] > 0:
        light = wp.cast(surfaces.emission[row], wp.vec4h)
        surfel.emission = wp.vec3(float(light[0]), float(light[1]), float(light[2]))
    else:
        surfel.emission = appearance.looks[surfel.material].emission
    return surfel


@wp.kernel
def surface_kernel(
    scene: Scene,
    appearance: Appearance,
    views: Views,
    camera: Camera,
    extras: Extras,
    samples: Samples,
    # out
    surfaces_out: Surfaces,
):
    """Read colours, roughness and normals of what every sample shows.

    Launch: dim=threads of all tiles and further samples, block_dim=64.
    """
    row = row_of_thread(camera, views.slot.shape[0], wp.tid())
    if row < 0:
        return
    face = samples.face[row]
    if face < 0:
        return
    place = place_of(camera, extras, row)
    pose = views.pose[place.view]
    surfel = surfel_of(
        scene, appearance, views.slot[place.view], wp.transform_get_translation(pose),
        pixel_direction(camera, pose, place.u, place.v), samples.t[row], face, samples.instance[row], 1.0 / camera.fx,
    )  # fmt: skip
    write_surface(surfel, row, surfaces_out)
