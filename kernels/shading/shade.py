"""Radiance of every sample in one weather, from what was traced for all of them. No ray is cast here."""

import warp as wp

from mmw.kernels.camera.camera import tile_column, tile_row
from mmw.kernels.camera.image_samples import Picture, SampleRay, ray_at, ray_of, row_of_thread, sample_row
from mmw.kernels.core.compiler import PICTURE_SHADING
from mmw.kernels.core.packing import unpack_unit
from mmw.kernels.core.structs import Scene
from mmw.kernels.shading.aerial_perspective import Air, sky_through_air, through_air, transmittance
from mmw.kernels.shading.brdf import GLINT_ALPHA2, ambient_weights, direct_light
from mmw.kernels.shading.lights import Lamps, lamp_emission, lamp_light
from mmw.kernels.shading.reflections import Mirrors, footprint_on, mirror_image, mirror_ray, mirrored, water_weight
from mmw.kernels.shading.sky import Sky, sky_irradiance, sky_radiance
from mmw.kernels.shading.structs import MATT, SMOOTH, Appearance, Extras, Surfaces
from mmw.kernels.shading.surface_point import interpolated_normal, patch_of, toward_viewer
from mmw.kernels.shading.surface_samples import coat_weight, read_surface
from mmw.kernels.shading.wet_surfaces import Wet, Wetted, film_light, film_weights, wetted

wp.set_module_options(PICTURE_SHADING)

SHADED_GROUND = wp.constant(0.5)
"""Light of what blocks the sky, over that of open ground [-]: half of it lies in shadow. Design value."""

MIRRORED_OPEN = wp.constant(0.7)
"""Share of the sky that is in sight from what a mirror shows, where no ray asks [-]. Design value."""

SHARP_IMAGE = wp.constant(0.15)
"""Roughness of a base under a coat up to which it shows the image of its one mirrored ray [-]. Design value."""

BLURS_IMAGE = wp.constant(0.4)
"""Roughness from which it shows the blurred sky alone [-]. Design value."""

MIN_ROUGH_SKY = wp.constant(0.1)
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


@wp.kernel
def mirror_shade_kernel(
    scene: Scene,
    weather: Weather,
    picture: Picture,
    surfaces: Surfaces,
    mirrors: Mirrors,
    # out
    image_out: wp.array[wp.vec3],
):
    """Shade what mirrored rays bring [kcd/m2].

    Launch: dim=mirrored rays, block_dim=256.
    """
    number = wp.tid()
    ray = mirror_ray(picture, surfaces, mirrors.row[number])
    away = ray.direction
    if mirrors.samples.face[number] < 0:
        image_out[number] = sky_radiance(weather.sky, away, 0.0)
        return
    t = mirrors.samples.t[number]
    normal = unpack_unit(mirrors.samples.normal[number])
    surfel = read_surface(weather.appearance, mirrors.surfaces, number, ray.start + t * away, normal)
    look = weather.appearance.looks[surfel.material]
    if weather.wet.wetness + weather.wet.puddles > 0.0:
        width = (ray.t + t) / picture.camera.fx
        surfel = wetted(weather.wet, look, surfel, 0.0, footprint_on(normal, away, width)).surfel
    ambient = ambient_weights(surfel, look, -away)
    irradiance = MIRRORED_OPEN * sky_irradiance(weather.sky, surfel.shading_normal)
    irradiance += (1.0 - MIRRORED_OPEN) * SHADED_GROUND * wp.PI * weather.glow
    light = wp.cw_mul(ambient.diffuse, irradiance) / wp.PI
    glossy = mirrored(away, surfel.shading_normal, normal)
    light += wp.cw_mul(ambient.specular, sky_radiance(weather.sky, glossy, wp.max(ambient.specular_roughness, 0.3)))
    is_lit = wp.bool(True)
    if mirrors.sun.shape[0] > 0:
        is_lit = mirrors.sun[number] > wp.uint8(0)
    if is_lit:
        sun = weather.sky.sun_direction
        light += wp.cw_mul(direct_light(surfel, look, -away, sun), weather.sky.sun_illuminance)
    instance = mirrors.samples.instance[number]
    light += lamp_emission(weather.lamps, scene, ray.source.slot, instance, look, surfel, -away)
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
    surfel = read_surface(weather.appearance, surfaces, row, ray.origin + t * ray.direction, normal)
    look = weather.appearance.looks[surfel.material]
    footprint = footprint_on(normal, ray.direction, t / picture.camera.fx)
    return wetted(weather.wet, look, surfel, time[ray.view], footprint)


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
    """Shade every sample [kcd/m2]. `time` is that of each view's frame [s], `image` what mirrored rays bring.

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
    look = weather.appearance.looks[surfaces.material[row]]
    gloss = surfaces.gloss[row]
    sharp = gloss != MATT
    # A ray may be there for another weather, in which the surface is wetter.
    weight = wp.float32(1.0)
    if gloss > MATT and gloss < SMOOTH:  # a coat
        weight = coat_weight(look, unpack_unit(surfaces.normal[row]), to_viewer)
    wet = wet_surface(weather, time, picture, surfaces, ray, row)
    if not sharp:
        weight = water_weight(wet.film, normal, to_viewer)
    surfel = wet.surfel
    ambient = ambient_weights(surfel, look, to_viewer)
    dark = (1.0 - is_open) * SHADED_GROUND * weather.glow
    color = wp.cw_mul(ambient.diffuse, is_open * sky_irradiance(sky, surfel.shading_normal) / wp.PI + dark)
    lit = sun > 0.0 and sky.sun_illuminance[1] > 0.0
    if lit:
        color += sun * wp.cw_mul(direct_light(surfel, look, to_viewer, sky.sun_direction), sky.sun_illuminance)

    # Where no ray was sent, what hides the sky from the surface hides it from the mirror too.
    away = mirrored(direction, surfel.shading_normal, normal)
    blurred = is_open * sky_radiance(sky, away, wp.max(ambient.specular_roughness, MIN_ROUGH_SKY)) + dark
    seen = wp.vec3()
    if light.mirror.shape[0] > 0 and weight > 0.0:
        found = mirror_image(picture, surfaces, light.mirror, image, row)
        seen = wp.vec3(found[0], found[1], found[2])
        weight *= found[3]
    else:
        weight = wp.float32(0.0)
    reflected = blurred
    base = blurred
    if sharp:
        reflected = wp.lerp(blurred, seen, weight)
        # Under a coat the base is rougher and shows the ray's image only as far as it is smooth itself.
        clear = wp.clamp((BLURS_IMAGE - surfel.roughness) / (BLURS_IMAGE - SHARP_IMAGE), 0.0, 1.0)
        base = wp.lerp(blurred, reflected, clear)
    color += wp.cw_mul(ambient.specular, base) + ambient.coat * reflected
    color += lamp_emission(weather.lamps, scene, ray.slot, picture.samples.instance[row], look, surfel, to_viewer)
    share = film_weights(wet, to_viewer)
    if share > 0.0:
        over = mirrored(direction, wet.film_normal, normal)
        sheen = is_open * sky_radiance(sky, over, wet.film_roughness) + dark
        # A film mirrors half as sharply as a puddle.
        sheen = wp.lerp(sheen, wp.lerp(0.5 * (seen + sheen), seen, wet.puddle), weight)
        color = (1.0 - share) * color + share * sheen
        if lit:
            color += sun * film_light(wet, to_viewer, sky.sun_direction, GLINT_ALPHA2) * sky.sun_illuminance
    radiance_out[row] = through_air(weather.air, sky, color, ray.origin, direction, t)


@wp.kernel
def lamp_kernel(
    scene: Scene,
    weather: Weather,
    time: wp.array[float],
    picture: Picture,
    surfaces: Surfaces,
    # out
    radiance_out: wp.array[wp.vec3],
):
    """Add the light that head lamps and street lamps cast [kcd/m2]; for weathers in which it counts.

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
    look = weather.appearance.looks[wet.surfel.material]
    light = lamp_light(weather.lamps, scene, ray.slot, wet, look, -ray.direction)
    seen = wp.cw_mul(light, transmittance(weather.air, ray.origin, ray.direction, t))
    radiance_out[row] = radiance_out[row] + seen


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
    radiance_out[extras.row[edge]] = mean[edge]


@wp.kernel
def normal_kernel(
    scene: Scene,
    appearance: Appearance,
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
        patch = patch_of(scene, ray.slot, ray.origin, ray.direction, picture.samples.t[row], face, instance)
        smooth = -patch.direction
        if wp.dot(patch.normal, patch.normal) > 0.5:
            side = wp.where(wp.dot(patch.normal, patch.direction) > 0.0, -1.0, 1.0)
            smooth = toward_viewer(
                interpolated_normal(appearance, patch, instance) * side, patch.normal * side, patch.direction
            )
        if instance >= 0:
            smooth = wp.transform_vector(scene.instance_pose[ray.slot, instance], smooth)
        normal = wp.transform_vector(wp.transform_inverse(picture.views.pose[view]), smooth)
    normal_out[view, v, u] = normal
