"""Radiance of every sample in one weather, from what was traced for all of them. No ray is cast here."""

import warp as wp

from mmw.kernels.air import Air, sky_through_air, through_air, transmittance
from mmw.kernels.brdf import GLINT_ALPHA2, ambient_weights, direct_light
from mmw.kernels.camera import Camera, tile_column, tile_row
from mmw.kernels.lamps import Lamps, lamp_emission, lamp_light
from mmw.kernels.looks import Appearance, Extras, Samples, Surfaces
from mmw.kernels.mirror import footprint_on, is_sharp, mirror_direction, mirror_start, mirrored, water_weight
from mmw.kernels.packing import unpack_unit
from mmw.kernels.sky import Sky, sky_irradiance, sky_radiance
from mmw.kernels.structs import Scene, Views
from mmw.kernels.surfaces import read_surface
from mmw.kernels.surfel import interpolated_normal, patch_of, toward_viewer
from mmw.kernels.visibility import pixel_direction, place_of, row_of_thread, sample_row
from mmw.kernels.wet import Wet, film_light, film_weights, wetted

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": True})

SHADED_GROUND = wp.constant(0.5)
"""Light of what blocks the sky, over that of open ground [-]: half of it lies in shadow. Design value."""

MIRRORED_OPEN = wp.constant(0.7)
"""Share of the sky that is in sight from what a mirror shows, where no ray asks [-]. Design value."""

SHARP_IMAGE = wp.constant(0.15)
"""Roughness of a base under a coat up to which it shows the image of its one mirrored ray [-]. Design value."""

BLURS_IMAGE = wp.constant(0.4)
"""Roughness from which it shows the blurred sky alone [-]. Design value."""

LEAST_ROUGH_SKY = wp.constant(0.1)
"""Roughness that a sky mirrored without a ray has at least [-]: nothing sharp is drawn where nothing was traced."""


@wp.struct
class Weather:
    """One weather to the camera."""

    appearance: Appearance
    sky: Sky
    air: Air
    wet: Wet
    lamps: Lamps
    glow: wp.vec3
    """Luminance of open ground under the sky and the sun [kcd/m2]."""


@wp.struct
class Light:
    """Light that reaches the samples, the same in every weather with the same sun."""

    sun: wp.array[wp.uint8]
    """Share of the sun's disc in sight, in 255ths, a row a sample; empty where all of it is."""
    sky: wp.array[wp.uint8]
    """Share of the sky in sight, weighted by the cosine, in 255ths, a row a pixel; empty where all of it is."""
    mirror: wp.array[int]
    """Mirrored ray of each sample, -1 for none; empty where none was sent."""


@wp.struct
class Mirrors:
    """Mirrored rays and what they meet."""

    row: wp.array[int]
    """Sample that each was sent from."""
    samples: Samples
    surfaces: Surfaces
    sun: wp.array[wp.uint8]
    """255 where the sun lights what was met, else 0; empty where it always does."""


@wp.kernel
def mirror_shade_kernel(
    scene: Scene,
    weather: Weather,
    views: Views,
    camera: Camera,
    extras: Extras,
    samples: Samples,
    surfaces: Surfaces,
    mirrors: Mirrors,
    # out
    image_out: wp.array[wp.vec3],
):
    """Shade what mirrored rays bring [kcd/m2].

    Launch: dim=mirrored rays, block_dim=64.
    """
    ray = wp.tid()
    source = mirrors.row[ray]
    place = place_of(camera, extras, source)
    direction = pixel_direction(camera, views.pose[place.view], place.u, place.v)
    away = mirror_direction(weather.appearance, samples, surfaces, source, direction)
    if mirrors.samples.face[ray] < 0:
        image_out[ray] = sky_radiance(weather.sky, away, 0.0)
        return
    start = mirror_start(views, samples, source, place.view, direction)
    t = mirrors.samples.t[ray]
    normal = unpack_unit(mirrors.samples.normal[ray])
    surfel = read_surface(weather.appearance, mirrors.surfaces, ray, start + t * away, normal)
    look = weather.appearance.looks[surfel.material]
    if weather.wet.wetness + weather.wet.puddles > 0.0:
        width = (samples.t[source] + t) / camera.fx
        surfel = wetted(weather.wet, look, surfel, 0.0, footprint_on(normal, away, width)).surfel
    ambient = ambient_weights(surfel, look, -away)
    irradiance = MIRRORED_OPEN * sky_irradiance(weather.sky, surfel.shading_normal)
    irradiance += (1.0 - MIRRORED_OPEN) * SHADED_GROUND * wp.PI * weather.glow
    light = wp.cw_mul(ambient.diffuse, irradiance) / wp.PI
    glossy = mirrored(away, surfel.shading_normal, normal)
    light += wp.cw_mul(ambient.specular, sky_radiance(weather.sky, glossy, wp.max(ambient.specular_roughness, 0.3)))
    is_lit = wp.bool(True)
    if mirrors.sun.shape[0] > 0:
        is_lit = mirrors.sun[ray] > wp.uint8(0)
    if is_lit:
        sun = weather.sky.sun_direction
        light += wp.cw_mul(direct_light(surfel, look, -away, sun), weather.sky.sun_illuminance)
    slot = views.slot[place.view]
    light += lamp_emission(weather.lamps, scene, slot, mirrors.samples.instance[ray], look, surfel, -away)
    image_out[ray] = through_air(weather.air, weather.sky, light, start, away, t)


@wp.func
def open_beside(
    views: Views, camera: Camera, samples: Samples, sky: wp.array[wp.uint8], pixel: int, view: int,
    normal: wp.vec3, point: wp.vec3,
) -> float:  # fmt: skip
    """Return the share of open sky at the pixel about another one that lies most nearly in the plane of a point."""
    best = wp.float32(1.0e9)
    is_open = wp.float32(1.0)
    line = pixel // camera.width
    u = pixel - line * camera.width
    v = line - view * camera.height
    pose = views.pose[view]
    for i in range(-1, 2):
        for j in range(-1, 2):
            beside_u = wp.clamp(u + j, 0, camera.width - 1)
            beside_v = wp.clamp(v + i, 0, camera.height - 1)
            row = sample_row(camera, view, beside_u, beside_v)
            t = samples.t[row]
            if t < wp.inf:
                direction = pixel_direction(camera, pose, float(beside_u) + 0.5, float(beside_v) + 0.5)
                there = wp.transform_get_translation(pose) + t * direction
                apart = wp.abs(wp.dot(there - point, normal))
                apart += 1.0 - wp.dot(normal, unpack_unit(samples.normal[row]))
                if apart < best:
                    best = apart
                    is_open = float(sky[row]) / 255.0
    return is_open


@wp.kernel
def shade_kernel(
    scene: Scene,
    weather: Weather,
    views: Views,
    time: wp.array[float],
    camera: Camera,
    extras: Extras,
    samples: Samples,
    surfaces: Surfaces,
    light: Light,
    image: wp.array[wp.vec3],
    # out
    radiance_out: wp.array[wp.vec3],
):
    """Shade every sample [kcd/m2]. `time` is that of each view's frame [s], `image` what mirrored rays bring.

    Launch: dim=threads of all tiles and further samples, block_dim=64.
    """
    row = row_of_thread(camera, views.slot.shape[0], wp.tid())
    if row < 0:
        return
    place = place_of(camera, extras, row)
    pose = views.pose[place.view]
    direction = pixel_direction(camera, pose, place.u, place.v)
    t = samples.t[row]
    if t == wp.inf:
        radiance_out[row] = sky_through_air(weather.sky, direction)
        return
    origin = wp.transform_get_translation(pose)
    point = origin + t * direction
    normal = unpack_unit(samples.normal[row])
    sun = wp.float32(1.0)
    if light.sun.shape[0] > 0:
        sun = float(light.sun[row]) / 255.0
    is_open = wp.float32(1.0)
    if light.sky.shape[0] > 0:
        if row < extras.first:
            is_open = float(light.sky[row]) / 255.0
        else:
            pixel = extras.row[(row - extras.first) // extras.offset.shape[0]]
            is_open = open_beside(views, camera, samples, light.sky, pixel, place.view, normal, point)
    ray = wp.int32(-1)
    if light.mirror.shape[0] > 0:
        ray = light.mirror[row]

    sky = weather.sky
    to_viewer = -direction
    surfel = read_surface(weather.appearance, surfaces, row, point, normal)
    look = weather.appearance.looks[surfel.material]
    sharp = is_sharp(look, surfel.roughness, surfel.metallic, surfel.opacity)
    wet = wetted(weather.wet, look, surfel, time[place.view], footprint_on(normal, direction, t / camera.fx))
    surfel = wet.surfel
    ambient = ambient_weights(surfel, look, to_viewer)
    dark = (1.0 - is_open) * SHADED_GROUND * weather.glow
    color = wp.cw_mul(ambient.diffuse, is_open * sky_irradiance(sky, surfel.shading_normal) / wp.PI + dark)
    lit = sun > 0.0 and sky.sun_illuminance[1] > 0.0
    if lit:
        color += sun * wp.cw_mul(direct_light(surfel, look, to_viewer, sky.sun_direction), sky.sun_illuminance)

    # A ray may be there for another weather, in which the surface is wetter.
    weight = wp.float32(1.0)
    if not sharp:
        weight = water_weight(wet.film, normal, to_viewer)
    share = film_weights(wet, to_viewer)
    # Where no ray was sent, what hides the sky from the surface hides it from the mirror too.
    away = mirrored(direction, surfel.shading_normal, normal)
    blurred = is_open * sky_radiance(sky, away, wp.max(ambient.specular_roughness, LEAST_ROUGH_SKY)) + dark
    reflected = blurred
    if ray >= 0 and weight > 0.0:
        reflected = image[ray]
    # Under a coat the base is rougher and shows the ray's image only as far as it is smooth itself.
    clear = wp.clamp((BLURS_IMAGE - surfel.roughness) / (BLURS_IMAGE - SHARP_IMAGE), 0.0, 1.0)
    base = wp.where(sharp, wp.lerp(blurred, reflected, clear), blurred)
    color += wp.cw_mul(ambient.specular, base) + ambient.coat * reflected
    color += lamp_emission(weather.lamps, scene, views.slot[place.view], samples.instance[row], look, surfel, to_viewer)
    if share > 0.0:
        over = mirrored(direction, wet.film_normal, normal)
        sheen = is_open * sky_radiance(sky, over, wet.film_roughness) + dark
        if ray >= 0 and weight > 0.0:
            sheen = wp.lerp(sheen, wp.lerp(0.5 * (reflected + sheen), reflected, wet.puddle), weight)
        color = (1.0 - share) * color + share * sheen
        if lit:
            color += sun * film_light(wet, to_viewer, sky.sun_direction, GLINT_ALPHA2) * sky.sun_illuminance
    radiance_out[row] = through_air(weather.air, sky, color, origin, direction, t)


@wp.kernel
def lamp_kernel(
    scene: Scene,
    weather: Weather,
    views: Views,
    time: wp.array[float],
    camera: Camera,
    extras: Extras,
    samples: Samples,
    surfaces: Surfaces,
    # out
    radiance_out: wp.array[wp.vec3],
):
    """Add the light that head lamps and street lamps cast [kcd/m2]; for weathers in which it counts.

    Launch: dim=threads of all tiles and further samples, block_dim=64.
    """
    row = row_of_thread(camera, views.slot.shape[0], wp.tid())
    if row < 0:
        return
    t = samples.t[row]
    if t == wp.inf:
        return
    place = place_of(camera, extras, row)
    pose = views.pose[place.view]
    direction = pixel_direction(camera, pose, place.u, place.v)
    origin = wp.transform_get_translation(pose)
    normal = unpack_unit(samples.normal[row])
    surfel = read_surface(weather.appearance, surfaces, row, origin + t * direction, normal)
    look = weather.appearance.looks[surfel.material]
    wet = wetted(weather.wet, look, surfel, time[place.view], footprint_on(normal, direction, t / camera.fx))
    light = lamp_light(weather.lamps, scene, views.slot[place.view], wet, look, -direction)
    radiance_out[row] = radiance_out[row] + wp.cw_mul(light, transmittance(weather.air, origin, direction, t))


@wp.kernel
def resolve_kernel(
    extras: Extras,
    # out
    radiance_out: wp.array[wp.vec3],
):
    """Average the samples of each pixel on an edge.

    Launch: dim=E.
    """
    edge = wp.tid()
    count = extras.offset.shape[0]
    pixel = extras.row[edge]
    total = radiance_out[pixel]
    for k in range(count):
        total += radiance_out[extras.first + edge * count + k]
    radiance_out[pixel] = total / (1.0 + float(count))


@wp.kernel
def normal_kernel(
    scene: Scene,
    appearance: Appearance,
    views: Views,
    camera: Camera,
    samples: Samples,
    # out
    normal_out: wp.array3d[wp.vec3],
):
    """Read the interpolated normal of what every pixel's centre sees, sensor frame, zero for nothing.

    Launch: dim=(A, ceil(H / 8), ceil(W / 8), 64), block_dim=64.
    """
    view, down, aside, lane = wp.tid()
    v = tile_row(down, lane)
    u = tile_column(aside, lane)
    if u >= camera.width or v >= camera.height:
        return
    row = sample_row(camera, view, u, v)
    face = samples.face[row]
    normal = wp.vec3(0.0, 0.0, 0.0)
    if face >= 0:
        slot = views.slot[view]
        pose = views.pose[view]
        instance = samples.instance[row]
        direction = pixel_direction(camera, pose, float(u) + 0.5, float(v) + 0.5)
        origin = wp.transform_get_translation(pose)
        patch = patch_of(scene, slot, origin, direction, samples.t[row], face, instance)
        smooth = -patch.direction
        if wp.dot(patch.normal, patch.normal) > 0.5:
            side = wp.where(wp.dot(patch.normal, patch.direction) > 0.0, -1.0, 1.0)
            smooth = toward_viewer(
                interpolated_normal(appearance, patch, instance) * side, patch.normal * side, patch.direction
            )
        if instance >= 0:
            smooth = wp.transform_vector(scene.instance_pose[slot, instance], smooth)
        normal = wp.transform_vector(wp.transform_inverse(pose), smooth)
    normal_out[view, v, u] = normal
