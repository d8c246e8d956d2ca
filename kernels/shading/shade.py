"""Compute the radiance of every sample in one weather, from what was traced for all of them. Casts no ray."""

import warp as wp

from mmw.kernels.camera.camera import tile_column, tile_row
from mmw.kernels.camera.image_samples import Picture, SampleRay, ray_at, ray_of, row_of_thread, sample_row
from mmw.kernels.core.compiler import PICTURE_SHADING
from mmw.kernels.core.packing import unpack_unit
from mmw.kernels.core.structs import Scene
from mmw.kernels.shading.aerial_perspective import Air, sky_through_air, through_air, transmittance
from mmw.kernels.shading.brdf import GLINT_ALPHA2, ambient_weights, direct_light
from mmw.kernels.shading.lights import Lights, light_emission, reflected_lights
from mmw.kernels.shading.reflections import (
    Reflections,
    footprint_on,
    reflect,
    reflected_ray,
    reflection_image,
    water_weight,
)
from mmw.kernels.shading.sky import Sky, sky_irradiance, sky_radiance
from mmw.kernels.shading.structs import MATT, SMOOTH, AppearanceTable, Extras, Surfaces
from mmw.kernels.shading.surface_point import interpolated_normal, patch_of, ray_hit, toward_viewer
from mmw.kernels.shading.surface_samples import coat_weight, read_surface
from mmw.kernels.shading.wet_surfaces import Wet, Wetted, film_light, film_weights, wetted

wp.set_module_options(PICTURE_SHADING)

SHADED_GROUND = wp.constant(0.5)
"""Light of what blocks the sky, over that of open ground [-]: half of it lies in shadow. Design value."""

REFLECTED_OPEN_SKY = wp.constant(0.7)
"""Share of the sky that is in sight from what a reflection shows, where no ray was sent [-]. Design value."""

SHARP_IMAGE = wp.constant(0.15)
"""Roughness of a base under a coat up to which it shows the image of its one reflected ray [-]. Design value."""

BLURS_IMAGE = wp.constant(0.4)
"""Roughness from which it shows the blurred sky alone [-]. Design value."""

MIN_ROUGH_SKY = wp.constant(0.1)
"""Roughness that a sky reflected without a ray has at least [-]: nothing sharp is drawn where nothing was traced."""


@wp.struct
class Weather:
    """One weather to the camera."""

    appearance_table: AppearanceTable
    sky: Sky
    air: Air
    wet: Wet
    lights: Lights
    glow: wp.vec3
    """Luminance of open ground under the sky and the sun [kcd/m2]."""


@wp.struct
class Light:
    """Light that reaches the samples, the same in every weather with the same sun."""

    sun: wp.array[wp.uint8]
    """Share of the sun's disc in sight, in 255ths, a row a sample; empty where all of it is."""
    sky: wp.array[wp.uint8]
    """Share of the sky in sight, weighted by the cosine, in 255ths, a row a pixel; empty where all of it is."""
    reflection: wp.array[int]
    """Reflected ray of each sample, -1 for none; empty where none was sent."""


@wp.kernel
def reflection_shade_kernel(
    scene: Scene,
    weather: Weather,
    picture: Picture,
    surfaces: Surfaces,
    reflections: Reflections,
    # out
    image_out: wp.array[wp.vec3],
):
    """Shade what reflected rays bring [kcd/m2].

    Launch: dim=room for reflected rays, block_dim=256.
    """
    number = wp.tid()
    if number >= reflections.count[0]:
        return
    ray = reflected_ray(picture, surfaces, reflections.row[number])
    away = ray.direction
    if reflections.samples.face[number] < 0:
        image_out[number] = sky_radiance(weather.sky, away, 0.0)
        return
    t = reflections.samples.t[number]
    normal = unpack_unit(reflections.samples.normal[number])
    surface_point = read_surface(weather.appearance_table, reflections.surfaces, number, ray.start + t * away, normal)
    appearance = weather.appearance_table.appearances[surface_point.material]
    if weather.wet.wetness + weather.wet.puddles > 0.0:
        width = (ray.t + t) / picture.camera.fx
        surface_point = wetted(
            weather.wet, appearance, surface_point, 0.0, footprint_on(normal, away, width)
        ).surface_point
    ambient = ambient_weights(surface_point, appearance, -away)
    irradiance = REFLECTED_OPEN_SKY * sky_irradiance(weather.sky, surface_point.shading_normal)
    irradiance += (1.0 - REFLECTED_OPEN_SKY) * SHADED_GROUND * wp.PI * weather.glow
    light = wp.cw_mul(ambient.diffuse, irradiance) / wp.PI
    glossy = reflect(away, surface_point.shading_normal, normal)
    light += wp.cw_mul(ambient.specular, sky_radiance(weather.sky, glossy, wp.max(ambient.specular_roughness, 0.3)))
    is_lit = wp.bool(True)
    if reflections.sun.shape[0] > 0:
        is_lit = reflections.sun[number] > wp.uint8(0)
    if is_lit:
        sun = weather.sky.sun_direction
        light += wp.cw_mul(direct_light(surface_point, appearance, -away, sun), weather.sky.sun_illuminance)
    instance = reflections.samples.instance[number]
    light += light_emission(weather.lights, scene, ray.source.batch_index, instance, appearance, surface_point, -away)
    image_out[number] = through_air(weather.air, weather.sky, light, ray.start, away, t)


@wp.func
def open_beside(picture: Picture, sky: wp.array[wp.uint8], ray: SampleRay, row: int) -> float:
    """Return the share of open sky for a further sample: that of the pixel around it most nearly in its plane."""
    camera = picture.camera
    samples = picture.samples
    pixel = picture.extras.row[(row - picture.extras.first) // picture.extras.offset.shape[0]]
    point = samples.t[row] * ray.direction
    normal = unpack_unit(samples.normal[row])
    best = wp.float32(1.0e9)
    is_open = wp.float32(1.0)
    line = pixel // camera.width
    u = pixel - line * camera.width
    v = line - ray.view * camera.height
    for i in range(-1, 2):
        for j in range(-1, 2):
            beside_u = wp.clamp(u + j, 0, camera.width - 1)
            beside_v = wp.clamp(v + i, 0, camera.height - 1)
            beside = sample_row(camera, ray.view, beside_u, beside_v)
            t = samples.t[beside]
            if t < wp.inf:
                there = ray_at(picture, ray.view, float(beside_u) + 0.5, float(beside_v) + 0.5)
                apart = wp.abs(wp.dot(t * there.direction - point, normal))
                apart += 1.0 - wp.dot(normal, unpack_unit(samples.normal[beside]))
                if apart < best:
                    best = apart
                    is_open = float(sky[beside]) / 255.0
    return is_open


@wp.func
def wet_surface(
    weather: Weather, time: wp.array[float], picture: Picture, surfaces: Surfaces, ray: SampleRay, row: int
) -> Wetted:
    """Return what a sample with a hit shows, with the water of the weather on it."""
    t = picture.samples.t[row]
    normal = unpack_unit(picture.samples.normal[row])
    surface_point = read_surface(weather.appearance_table, surfaces, row, ray.origin + t * ray.direction, normal)
    appearance = weather.appearance_table.appearances[surface_point.material]
    footprint = footprint_on(normal, ray.direction, t / picture.camera.fx)
    return wetted(weather.wet, appearance, surface_point, time[ray.view], footprint)


@wp.kernel(cuda_max_registers=64)
def shade_kernel(
    scene: Scene,
    weather: Weather,
    time: wp.array[float],
    picture: Picture,
    surfaces: Surfaces,
    light: Light,
    image: wp.array[wp.vec3],
    # out
    radiance_out: wp.array[wp.vec3],
):
    """Shade every sample [kcd/m2]. `time` is that of each view's frame [s], `image` what reflected rays bring.

    Launch: dim=threads of all tiles and further samples that are shaded, block_dim=256.
    """
    row = row_of_thread(picture, wp.tid())
    if row < 0:
        return
    ray = ray_of(picture, row)
    direction = ray.direction
    sky = weather.sky
    t = picture.samples.t[row]
    if t == wp.inf:
        radiance_out[row] = sky_through_air(sky, direction)
        return
    normal = unpack_unit(picture.samples.normal[row])
    sun = wp.float32(1.0)
    if light.sun.shape[0] > 0:
        sun = float(light.sun[row]) / 255.0
    is_open = wp.float32(1.0)
    if light.sky.shape[0] > 0:
        if row < picture.extras.first:
            is_open = float(light.sky[row]) / 255.0
        else:
            is_open = open_beside(picture, light.sky, ray, row)

    to_viewer = -direction
    appearance = weather.appearance_table.appearances[surfaces.material[row]]
    gloss = surfaces.gloss[row]
    sharp = gloss != MATT
    # A ray may be there for another weather, in which the surface is wetter.
    weight = wp.float32(1.0)
    if gloss > MATT and gloss < SMOOTH:  # a coat
        weight = coat_weight(appearance, unpack_unit(surfaces.normal[row]), to_viewer)
    wet = wet_surface(weather, time, picture, surfaces, ray, row)
    if not sharp:
        weight = water_weight(wet.film, normal, to_viewer)
    surface_point = wet.surface_point
    ambient = ambient_weights(surface_point, appearance, to_viewer)
    dark = (1.0 - is_open) * SHADED_GROUND * weather.glow
    color = wp.cw_mul(ambient.diffuse, is_open * sky_irradiance(sky, surface_point.shading_normal) / wp.PI + dark)
    lit = sun > 0.0 and sky.sun_illuminance[1] > 0.0
    if lit:
        color += sun * wp.cw_mul(
            direct_light(surface_point, appearance, to_viewer, sky.sun_direction), sky.sun_illuminance
        )

    # Where no ray was sent, what hides the sky from the surface hides it from its reflection too.
    away = reflect(direction, surface_point.shading_normal, normal)
    blurred = is_open * sky_radiance(sky, away, wp.max(ambient.specular_roughness, MIN_ROUGH_SKY)) + dark
    traced = wp.vec3()
    if light.reflection.shape[0] > 0 and weight > 0.0:
        found = reflection_image(picture, surfaces, light.reflection, image, row)
        traced = wp.vec3(found[0], found[1], found[2])
        weight *= found[3]
    else:
        weight = wp.float32(0.0)
    reflected = blurred
    base = blurred
    if sharp:
        reflected = wp.lerp(blurred, traced, weight)
        # Under a coat the base is rougher and shows the ray's image only as far as it is smooth itself.
        clear = wp.clamp((BLURS_IMAGE - surface_point.roughness) / (BLURS_IMAGE - SHARP_IMAGE), 0.0, 1.0)
        base = wp.lerp(blurred, reflected, clear)
    color += wp.cw_mul(ambient.specular, base) + ambient.coat * reflected
    color += light_emission(
        weather.lights, scene, ray.batch_index, picture.samples.instance[row], appearance, surface_point, to_viewer
    )
    share = film_weights(wet, to_viewer)
    if share > 0.0:
        over = reflect(direction, wet.film_normal, normal)
        sheen = is_open * sky_radiance(sky, over, wet.film_roughness) + dark
        # A film reflects half as sharply as a puddle.
        sheen = wp.lerp(sheen, wp.lerp(0.5 * (traced + sheen), traced, wet.puddle), weight)
        color = (1.0 - share) * color + share * sheen
        if lit:
            color += sun * film_light(wet, to_viewer, sky.sun_direction, GLINT_ALPHA2) * sky.sun_illuminance
    radiance_out[row] = through_air(weather.air, sky, color, ray.origin, direction, t)


@wp.kernel
def lights_kernel(
    scene: Scene,
    weather: Weather,
    time: wp.array[float],
    picture: Picture,
    surfaces: Surfaces,
    # out
    radiance_out: wp.array[wp.vec3],
):
    """Add the light that headlights and street lights cast [kcd/m2]; for weathers in which it counts.

    Launch: dim=threads of all tiles and further samples that are shaded, block_dim=256.
    """
    row = row_of_thread(picture, wp.tid())
    if row < 0:
        return
    t = picture.samples.t[row]
    if t == wp.inf:
        return
    ray = ray_of(picture, row)
    wet = wet_surface(weather, time, picture, surfaces, ray, row)
    appearance = weather.appearance_table.appearances[wet.surface_point.material]
    light = reflected_lights(weather.lights, scene, ray.batch_index, wet, appearance, -ray.direction)
    arriving = wp.cw_mul(light, transmittance(weather.air, ray.origin, ray.direction, t))
    radiance_out[row] = radiance_out[row] + arriving


@wp.kernel
def resolve_kernel(
    extras: Extras,
    radiance: wp.array[wp.vec3],
    # out
    mean_out: wp.array[wp.vec3],
):
    """Average the samples of each pixel on an edge.

    Launch: dim=E.
    """
    edge = wp.tid()
    if edge >= extras.count[0]:
        return
    count = extras.offset.shape[0]
    total = radiance[extras.row[edge]]
    for k in range(count):
        total += radiance[extras.source[edge * count + k]]
    mean_out[edge] = total / (1.0 + float(count))


@wp.kernel
def put_back_kernel(
    extras: Extras,
    mean: wp.array[wp.vec3],
    # out
    radiance_out: wp.array[wp.vec3],
):
    """Write the averages to their pixels, after all of them are made. Launch: dim=E."""
    edge = wp.tid()
    if edge >= extras.count[0]:
        return
    radiance_out[extras.row[edge]] = mean[edge]


@wp.kernel
def normal_kernel(
    scene: Scene,
    table: AppearanceTable,
    picture: Picture,
    # out
    normal_out: wp.array3d[wp.vec3],
):
    """Read the interpolated normal of what every pixel's center sees, sensor frame, zero for nothing.

    Launch: dim=(A, ceil(H / 8), ceil(W / 8), 64), block_dim=256.
    """
    view, down, aside, lane = wp.tid()
    v = tile_row(down, lane)
    u = tile_column(aside, lane)
    if u >= picture.camera.width or v >= picture.camera.height:
        return
    row = sample_row(picture.camera, view, u, v)
    face = picture.samples.face[row]
    normal = wp.vec3(0.0, 0.0, 0.0)
    if face >= 0:
        instance = picture.samples.instance[row]
        ray = ray_at(picture, view, float(u) + 0.5, float(v) + 0.5)
        hit = ray_hit(ray.batch_index, ray.origin, ray.direction, picture.samples.t[row], face, instance)
        patch = patch_of(scene, hit)
        smooth = -patch.direction
        if wp.dot(patch.normal, patch.normal) > 0.5:
            side = wp.where(wp.dot(patch.normal, patch.direction) > 0.0, -1.0, 1.0)
            smooth = toward_viewer(
                interpolated_normal(table, patch, instance) * side, patch.normal * side, patch.direction
            )
        if instance >= 0:
            smooth = wp.transform_vector(scene.instance_pose[ray.batch_index, instance], smooth)
        normal = wp.transform_vector(wp.transform_inverse(picture.views.pose[view]), smooth)
    normal_out[view, v, u] = normal
