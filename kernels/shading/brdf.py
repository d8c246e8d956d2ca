"""Reflect light at surfaces: GGX microfacets with a diffuse base, clear coat and panes of glass.

The inputs are those of UsdPreviewSurface (metallic workflow). Layers, from the eye down:

- the clear coat, a dielectric of reflectance 0.04: what it reflects of the light from all round, as a function of the
  viewer's angle, is taken from all below it (`Ambient.coat`);
- the specular lobe, GGX with height-correlated Smith masking, Schlick's Fresnel term between `f0` and `f90`, and the
  light that bounces more than once between the facets, after Kulla and Conty;
- the diffuse base of a dielectric, which gets what the lobe lets through on the way in and lets out again what it lets
  through on the way out, after Kelemen and Szirmay-Kalos.

All but the coat is reciprocal, and a surface that absorbs nothing reflects all it gets (white furnace). That needs
the albedo of the lobe, which has no closed form: `lobe_albedo` is our own fit to its integral. A dielectric that is
less than 2 % reflective loses its reflection at grazing angles as well, so an index of 1 gives a Lambert surface.

A surface of opacity below 1 (and no cut-out) is a pane: two parallel faces by the exact Fresnel equations, behind them
its own color. Lights are points at infinity; the highlight of the sun is spread by its disc, see `GLINT_ALPHA2`.

Sources: B. Walter et al., "Microfacet models for refraction through rough surfaces", EGSR 2007 (GGX); E. Heitz,
"Understanding the masking-shadowing function", JCGT 3(2), 2014 (Smith, height-correlated); C. Schlick, "An inexpensive
BRDF model", CGF 13(3), 1994; C. Kulla and A. Conty, "Revisiting physically based shading at Imageworks", SIGGRAPH
course 2017; C. Kelemen and L. Szirmay-Kalos, "A microfacet based coupled specular-matte BRDF model", Eurographics 2001;
S. Lagarde and C. de Rousiers, "Moving Frostbite to physically based rendering", SIGGRAPH course 2014 (f90).
"""

import warp as wp

from mmw.kernels.shading.structs import Appearance, SurfacePoint

wp.set_module_options({"enable_backward": False, "default_grid_stride": False, "fast_math": True})

MIN_COSINE = wp.constant(0.01)
"""Cosines toward the viewer below this count as this: interpolated normals may point away, and the fits end here."""
COAT_REFLECTANCE = wp.constant(0.04)
"""Reflectance of the clear coat at normal incidence: lacquer of index 1.5. Source: UsdPreviewSurface."""
F90_SLOPE = wp.constant(50.0)
"""Reflectance at grazing incidence over the one at normal incidence, up to 1. Source: Lagarde and de Rousiers."""
GLINT_ALPHA2 = wp.constant(1.05e-4)
"""Added to the square of GGX's alpha of every lobe [-]. (0.00465 / 2)^2 from the radius of the sun's disc, 0.00465 rad:
a half vector turns by half the angle of its light, and the peak F E / (4 pi alpha^2) of the highlight in a mirror is
then F times the luminance E / (pi radius^2) of the disc. The rest, 1e-4, is waviness of 0.4 degrees rms slope (orange
peel of paint, panes that are not quite flat): design value, with which highlights are wide enough for pixels."""


@wp.struct
class Ambient:
    """Luminance that leaves toward a viewer over the luminance that arrives.

    It is diffuse * E(n) / pi + specular * L(reflected direction, specular_roughness) + coat * L(reflected direction,
    coat_roughness), with E the irradiance and L the luminance blurred as that roughness does.
    """

    diffuse: wp.vec3
    specular: wp.vec3
    specular_roughness: float
    coat: float
    coat_roughness: float


@wp.func
def fresnel_schlick(f0: wp.vec3, cosine: float) -> wp.vec3:
    """Return the reflectance at an angle from that at normal incidence. Source: Schlick 1994."""
    x = 1.0 - wp.clamp(cosine, 0.0, 1.0)
    x5 = x * x * x * x * x
    return f0 * (1.0 - x5) + wp.vec3(x5, x5, x5)


@wp.func
def fresnel_polarised(cosine: float, ior: float) -> wp.vec2:
    """Return the reflectances of a smooth dielectric for light polarised across and in the plane of incidence.

    Both are 1 where all is reflected internally.

    Args:
        cosine: Of the angle of incidence, 0 to 1.
        ior: Refractive index beyond the surface over that before it; below 1 on the way out.

    Source: Fresnel's equations, for example E. Hecht, "Optics", section 4.6.
    """
    c = wp.clamp(cosine, 0.0, 1.0)
    g2 = ior * ior - 1.0 + c * c
    result = wp.vec2(1.0, 1.0)
    if g2 > 0.0:
        g = wp.sqrt(g2)
        s = (c - g) / (c + g)
        p = (ior * ior * c - g) / (ior * ior * c + g)
        result = wp.vec2(s * s, p * p)
    return result


@wp.func
def fresnel_dielectric(cosine: float, ior: float) -> float:
    """Return the reflectance of a smooth dielectric for unpolarised light; see `fresnel_polarised`."""
    r = fresnel_polarised(cosine, ior)
    return 0.5 * (r[0] + r[1])


@wp.func
def pane_reflectance(cosine: float, ior: float) -> float:
    """Return the reflectance of a clear pane in air for unpolarised light.

    It is 2 R / (1 + R) for either polarization: both faces, with all that bounces between them.

    Source: G. Stokes, "On the intensity of the light reflected from or transmitted through a pile of plates", Proc. R.
    Soc. 11, 1862.
    """
    r = fresnel_polarised(cosine, ior)
    return r[0] / (1.0 + r[0]) + r[1] / (1.0 + r[1])


@wp.func
def wavy_alpha2(roughness: float) -> float:
    """Return the square of GGX's alpha of a lobe from its perceptual roughness, with `GLINT_ALPHA2`."""
    alpha = roughness * roughness
    return wp.min(alpha * alpha + GLINT_ALPHA2, 1.0)


@wp.func
def lobe_albedo(n_v: float, roughness: float) -> wp.vec2:
    """Return what the specular lobe sends on of light from all round: x for a reflectance of 1, y for (1 - v.h)^5.

    With Schlick's term the albedo of a reflectance f0 is f0 (x - y) + f90 y.

    Args:
        n_v: Cosine between normal and viewer, `MIN_COSINE` to 1.
        roughness: Perceptual roughness, 0 to 1.

    Source: fit of ours to the integral over visible normals (220 x 220 points for each of 26 angles and 19
    roughnesses); largest errors 0.009 and 0.011 (where the cosine is 0.01), rms 0.002 of both.
    """
    a = wp.sqrt(wavy_alpha2(roughness))
    r = wp.sqrt(a)
    h = wp.sqrt(n_v * n_v + a * a)
    s = n_v / h
    lost0 = 0.042552 + s * (-0.3669 + s * (2.8864 + s * (-5.2694 + s * 4.0137)))
    lost0 += n_v * (-3.9837 + s * (-17.169 + s * (38.123 - s * 16.452)))
    lost0 += n_v * n_v * (-10.588 + s * (9.0808 - s * 1.3919) + n_v * (16.516 - s * 14.092 - n_v * 0.24305))
    lost1 = -0.29211 + s * (6.8635 + s * (6.2941 - s * 13.693)) + n_v * (14.673 + s * (20.425 - s * 12.994))
    lost1 += n_v * n_v * (-2.2308 - s * 8.6274 + n_v * 3.1604)
    lost2 = 0.70994 + s * (-15.08 - s * 9.1963) + n_v * (-4.1504 + s * 2.4931 - n_v * 3.1778)
    lost3 = -0.68231 + s * 5.6669 - n_v * 0.29732 + a * 0.23767
    white = 1.0 - wp.clamp((1.0 - s) * (lost0 + a * (lost1 + a * (lost2 + a * lost3))), 0.0, 1.0)
    z0 = 1.0234 + r * (-0.45237 + r * (1.8476 - r * 7.0937)) + n_v * (1.8643 + r * (-8.2263 + r * 4.8398))
    z0 += n_v * n_v * (-6.4504 + r * 2.9992 - n_v * 0.69493)
    z1 = -2.811 + r * (8.7231 - r * 0.69907) + n_v * (6.1287 - r * 5.0873 + n_v * 1.2671)
    z = wp.clamp(z0 + h * z1, 0.0, 1.0)  # fifth root of the mean of (1 - v.h)^5
    return wp.vec2(white, white * z * z * z * z * z)


@wp.func
def mean_lobe_albedo(roughness: float) -> wp.vec2:
    """Return the means of `lobe_albedo` over the hemisphere, weighted by the cosine.

    Source: fit to the integral of `lobe_albedo`; largest errors 0.0005 and 0.0006.
    """
    a = wp.sqrt(wavy_alpha2(roughness))
    r = wp.sqrt(a)
    lost = 0.40423 + r * (0.90898 + r * (5.8202 + r * (-18.194 + r * (17.204 - r * 5.5487))))
    y = 0.050088 + a * (-0.19649 + a * (0.33641 + a * (-0.25825 + a * 0.071256)))
    return wp.vec2(1.0 - a * r * lost, y)


@wp.func
def mean_pane_reflectance(normal_reflectance: float) -> float:
    """Return the mean of `pane_reflectance` over the hemisphere, weighted by the cosine.

    Source: fit of ours to the integral for an index from 1.02 to 2.2; largest error 0.0012.
    """
    x = wp.sqrt(normal_reflectance)
    return 0.00121 + x * (0.93005 + x * (-1.98757 + x * (6.38452 - x * 6.1658)))


@wp.func
def ior_of(normal_reflectance: float) -> float:
    """Return the refractive index of a dielectric from its reflectance at normal incidence."""
    x = wp.min(wp.sqrt(normal_reflectance), 0.95)
    return (1.0 + x) / (1.0 - x)


@wp.func
def is_pane(surface_point: SurfacePoint, appearance: Appearance) -> bool:
    """Return whether a surface is clear glass, not a cut-out."""
    return surface_point.opacity < 1.0 and appearance.opacity_threshold <= 0.0


@wp.func
def lobe(n_v: float, n_l: float, sine2_h: float, alpha2: float) -> float:
    """Return the GGX lobe D G / (4 n.v n.l), without its Fresnel term [1/sr].

    Args:
        n_v: Cosine between normal and viewer.
        n_l: Cosine between normal and light.
        sine2_h: Square of the sine between normal and half vector: of a cross product, which float32 keeps exact.
        alpha2: Square of GGX's alpha.
    """
    d = alpha2 * (1.0 - sine2_h) + sine2_h
    smith = n_l * wp.sqrt(alpha2 + (1.0 - alpha2) * n_v * n_v) + n_v * wp.sqrt(alpha2 + (1.0 - alpha2) * n_l * n_l)
    return alpha2 / (wp.PI * d * d) * 0.5 / smith


@wp.func
def grazing_reflectance(f0: float) -> float:
    """Return the reflectance at grazing incidence of a surface with this one at normal incidence."""
    return wp.min(F90_SLOPE * f0, 1.0)


@wp.func
def multiple_share(f0: float, f90: float, mean_albedo: float) -> float:
    """Return which share of the light that leaves the facets late was not absorbed before.

    Source: Kulla and Conty 2017, with the mean of Schlick's term over the hemisphere.
    """
    mean = f0 + (f90 - f0) / 21.0
    return mean * mean * mean_albedo / (1.0 - mean * (1.0 - mean_albedo))


@wp.struct
class Base:
    """Part of a surface's reflection that does not depend on the light: reflectances at the viewer's angle."""

    f0: wp.vec3
    f90: float
    late: wp.vec3
    """`multiple_share` per channel."""
    dielectric_f0: float
    dielectric_f90: float
    dielectric_late: float
    albedo: wp.vec2
    """`lobe_albedo` toward the viewer."""
    mean: wp.vec2
    diffuse: wp.vec3
    """Color of the diffuse base."""
    under_coat: float
    """Share that the coat leaves."""
    coat: float
    """Share that the coat reflects."""


@wp.func
def dielectric_albedo(base: Base, albedo: wp.vec2) -> float:
    """Return what a dielectric's surface sends on of light from all round, given `lobe_albedo` or its mean."""
    once = base.dielectric_f0 * (albedo[0] - albedo[1]) + base.dielectric_f90 * albedo[1]
    return once + base.dielectric_late * (1.0 - albedo[0])


@wp.func
def base_of(surface_point: SurfacePoint, appearance: Appearance, n_v: float) -> Base:
    """Return what of a surface does not depend on the light."""
    base = Base()
    metallic = surface_point.metallic
    color = surface_point.color
    base.dielectric_f0 = appearance.normal_reflectance
    base.dielectric_f90 = grazing_reflectance(base.dielectric_f0)
    metal_f90 = grazing_reflectance(wp.max(color))
    base.f0 = color * metallic + wp.vec3(1.0, 1.0, 1.0) * (base.dielectric_f0 * (1.0 - metallic))
    base.f90 = metal_f90 * metallic + base.dielectric_f90 * (1.0 - metallic)
    base.albedo = lobe_albedo(n_v, surface_point.roughness)
    base.mean = mean_lobe_albedo(surface_point.roughness)
    base.dielectric_late = multiple_share(base.dielectric_f0, base.dielectric_f90, base.mean[0])
    for i in range(3):
        late = multiple_share(color[i], metal_f90, base.mean[0])
        base.late[i] = late * metallic + base.dielectric_late * (1.0 - metallic)
    base.diffuse = color * (1.0 - metallic)
    base.coat = wp.float32(0.0)
    if appearance.clearcoat > 0.0:
        coat = lobe_albedo(n_v, appearance.clearcoat_roughness)
        base.coat = appearance.clearcoat * (COAT_REFLECTANCE * (coat[0] - coat[1]) + coat[1])
    base.under_coat = 1.0 - base.coat
    return base


@wp.func
def direct_light(surface_point: SurfacePoint, appearance: Appearance, to_viewer: wp.vec3, to_light: wp.vec3) -> wp.vec3:
    """Return BRDF times cosine of a far light [1/sr]: times its illuminance in klux, at normal incidence, kcd/m2.

    Zero for a light behind the face or behind the shading normal.

    Args:
        surface_point: The point, with its interpolated inputs.
        appearance: Its material, for index, coat and kind.
        to_viewer: Unit direction, scene frame.
        to_light: Unit direction, scene frame.
    """
    result = wp.vec3()
    n = surface_point.shading_normal
    n_l = wp.dot(n, to_light)
    if n_l > 0.0 and wp.dot(surface_point.normal, to_light) > 0.0:
        n_v = wp.clamp(wp.dot(n, to_viewer), MIN_COSINE, 1.0)
        half = wp.normalize(to_viewer + to_light)
        v_h = wp.clamp(wp.dot(to_viewer, half), 0.0, 1.0)
        sine = wp.cross(n, half)
        sine2 = wp.min(wp.dot(sine, sine), 1.0)
        specular_lobe = lobe(n_v, n_l, sine2, wavy_alpha2(surface_point.roughness))
        if is_pane(surface_point, appearance):
            ior = ior_of(appearance.normal_reflectance)
            through = (1.0 - pane_reflectance(n_v, ior)) * (1.0 - pane_reflectance(n_l, ior))
            behind = through / (wp.PI * (1.0 - mean_pane_reflectance(appearance.normal_reflectance)))
            glint = specular_lobe * pane_reflectance(v_h, ior)
            result = (surface_point.color * behind + wp.vec3(glint, glint, glint)) * n_l
        else:
            x = 1.0 - v_h
            x5 = x * x * x * x * x
            base = base_of(surface_point, appearance, n_v)
            light = lobe_albedo(wp.max(n_l, MIN_COSINE), surface_point.roughness)
            grazing = wp.vec3(base.f90, base.f90, base.f90)
            specular = (base.f0 * (1.0 - x5) + grazing * x5) * specular_lobe
            late = base.late * ((1.0 - base.albedo[0]) * (1.0 - light[0]) / (wp.PI * (1.0 - base.mean[0])))
            into = (1.0 - dielectric_albedo(base, base.albedo)) * (1.0 - dielectric_albedo(base, light))
            diffuse = base.diffuse * (into / (wp.PI * (1.0 - dielectric_albedo(base, base.mean))))
            result = (specular + late + diffuse) * (base.under_coat * n_l)
            if appearance.clearcoat > 0.0:
                coat = lobe(n_v, n_l, sine2, wavy_alpha2(appearance.clearcoat_roughness))
                shine = appearance.clearcoat * (COAT_REFLECTANCE * (1.0 - x5) + x5) * coat * n_l
                result += wp.vec3(shine, shine, shine)
    return result


@wp.func
def ambient_weights(surface_point: SurfacePoint, appearance: Appearance, to_viewer: wp.vec3) -> Ambient:
    """Return how much of the light from all round a surface sends to a viewer, by its lobe.

    Source: split sum of B. Karis, "Real shading in Unreal Engine 4", SIGGRAPH course 2013; late light among the diffuse
    after C. Fdez-Aguera, "A multiple-scattering microfacet model for real-time image-based lighting", JCGT 8(1), 2019.

    Args:
        surface_point: The point, with its interpolated inputs.
        appearance: Its material, for index, coat and kind.
        to_viewer: Unit direction, scene frame.
    """
    ambient = Ambient()
    n_v = wp.clamp(wp.dot(surface_point.shading_normal, to_viewer), MIN_COSINE, 1.0)
    ambient.specular_roughness = surface_point.roughness
    ambient.coat_roughness = appearance.clearcoat_roughness
    if is_pane(surface_point, appearance):
        reflectance = pane_reflectance(n_v, ior_of(appearance.normal_reflectance))
        ambient.specular = wp.vec3(reflectance, reflectance, reflectance)
        ambient.diffuse = surface_point.color * (1.0 - reflectance)
    else:
        base = base_of(surface_point, appearance, n_v)
        grazing = wp.vec3(base.f90, base.f90, base.f90) * base.albedo[1]
        ambient.specular = (base.f0 * (base.albedo[0] - base.albedo[1]) + grazing) * base.under_coat
        into = 1.0 - dielectric_albedo(base, base.albedo)
        ambient.diffuse = (base.diffuse * into + base.late * (1.0 - base.albedo[0])) * base.under_coat
        ambient.coat = base.coat
    return ambient
