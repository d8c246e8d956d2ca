"""Surface response against float64 integrals and formulas written a second time in NumPy."""

import numpy as np
import pytest
import warp as wp

from mmw.kernels.shading import brdf
from mmw.kernels.shading.structs import Appearance, SurfacePoint
from tests.fixtures.directions import direction, sphere_about
from tests.fixtures.kernels import launched

wp.set_module_options({"enable_backward": False, "fast_math": True})


@wp.kernel
def direct_kernel(
    surface_point: SurfacePoint,
    appearance: Appearance,
    to_viewer: wp.array[wp.vec3],
    to_light: wp.array[wp.vec3],
    value_out: wp.array[wp.vec3],
):
    """BRDF times cosine of pairs of directions. Launch: dim=N."""
    k = wp.tid()
    value_out[k] = brdf.direct_light(surface_point, appearance, to_viewer[k], to_light[k])


@wp.kernel
def ambient_kernel(
    surface_point: SurfacePoint, appearance: Appearance, to_viewer: wp.array[wp.vec3], diffuse_out: wp.array[wp.vec3],
    specular_out: wp.array[wp.vec3], coat_out: wp.array[float],
):  # fmt: skip
    """Ambient weights. Launch: dim=N."""
    k = wp.tid()
    ambient = brdf.ambient_weights(surface_point, appearance, to_viewer[k])
    diffuse_out[k] = ambient.diffuse
    specular_out[k] = ambient.specular
    coat_out[k] = ambient.coat


@wp.kernel
def fresnel_kernel(cosine: wp.array[float], ior: float, value_out: wp.array2d[float]):
    """Reflectances of a face, of a pane, and after Schlick. Launch: dim=N."""
    k = wp.tid()
    value_out[k, 0] = brdf.fresnel_dielectric(cosine[k], ior)
    value_out[k, 1] = brdf.pane_reflectance(cosine[k], ior)
    value_out[k, 2] = brdf.fresnel_schlick(wp.vec3(0.04, 0.04, 0.04), cosine[k])[0]


def surface(
    color=(1.0, 1.0, 1.0), roughness=0.5, metallic=0.0, f0=0.04, coat=0.0, coat_roughness=0.1, opacity=1.0
) -> tuple[SurfacePoint, Appearance]:
    surface_point, appearance = SurfacePoint(), Appearance()
    surface_point.normal = surface_point.shading_normal = wp.vec3(0.0, 0.0, 1.0)
    surface_point.color, surface_point.opacity = wp.vec3(*color), opacity
    surface_point.roughness, surface_point.metallic = roughness, metallic
    appearance.normal_reflectance, appearance.clearcoat, appearance.clearcoat_roughness = f0, coat, coat_roughness
    return surface_point, appearance


def direct(
    parts: tuple[SurfacePoint, Appearance], to_viewer: np.ndarray, to_light: np.ndarray, device: str
) -> np.ndarray:
    to_viewer, to_light = np.broadcast_arrays(np.atleast_2d(to_viewer), np.atleast_2d(to_light))
    (found,) = launched(direct_kernel, len(to_light), [*parts, to_viewer, to_light], device)
    return found.astype(np.float64)


def ambient(parts: tuple[SurfacePoint, Appearance], to_viewer: np.ndarray, device: str) -> tuple[np.ndarray, ...]:
    to_viewer = np.atleast_2d(to_viewer)
    found = launched(ambient_kernel, len(to_viewer), [*parts, to_viewer], device)
    return tuple(values.astype(np.float64) for values in found)


def reflected_share(parts: tuple[SurfacePoint, Appearance], to_viewer: np.ndarray, device: str) -> np.ndarray:
    """Return the integral of BRDF times cosine over all lights."""
    mirror = to_viewer * [-1.0, -1.0, 1.0]
    lights, solid = sphere_about(mirror)
    return (direct(parts, to_viewer, lights, device) * solid[:, None]).sum(axis=0)


SURFACES = {
    "lambert": surface(f0=0.0),
    "smooth plastic": surface(roughness=0.15),
    "plastic": surface(roughness=0.5),
    "chalk": surface(roughness=1.0),
    "polished metal": surface(roughness=0.2, metallic=1.0),
    "metal": surface(roughness=0.6, metallic=1.0),
    "rough metal": surface(roughness=1.0, metallic=1.0),
    "half metal": surface(roughness=0.5, metallic=0.5),
    "coated plastic": surface(roughness=0.5, coat=1.0),
    "coated metal": surface(roughness=0.4, metallic=1.0, coat=0.7, coat_roughness=0.2),
}
"""White surfaces that absorb nothing."""


@pytest.mark.parametrize("name", SURFACES)
def test_white_furnace(device: str, name: str) -> None:
    """A white surface sends on all light from all round, by its ambient weights and by the integral of its BRDF."""
    for angle in np.radians([0.0, 30.0, 60.0, 75.0, 85.0]):
        diffuse, specular, coat = ambient(SURFACES[name], direction(angle), device)
        assert diffuse[0] + specular[0] + coat[0] == pytest.approx(1.0, abs=1e-3)
        assert reflected_share(SURFACES[name], direction(angle), device) == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("roughness", [0.1, 0.3, 0.5, 0.7, 1.0])
def test_ambient_weights_are_the_integral(device: str, roughness: float) -> None:
    """Colored surfaces: both ways of shading agree, and nothing sends on more than it gets."""
    for metallic, coat in ((0.0, 0.0), (1.0, 0.0), (0.3, 0.5)):
        parts = surface((0.8, 0.4, 0.05), roughness, metallic, 0.06, coat)
        for angle in np.radians([10.0, 50.0, 80.0]):
            diffuse, specular, coated = ambient(parts, direction(angle), device)
            total = diffuse[0] + specular[0] + coated[0]
            assert reflected_share(parts, direction(angle), device) == pytest.approx(total, abs=0.01)
            assert (total <= 1.0 + 1e-3).all()


def test_lambert_plane_under_the_sun(device: str) -> None:
    """An index of 1 leaves Lambert's law: luminance = color / pi E cos."""
    parts = surface((0.5, 0.3, 0.1), f0=0.0)
    for angle in np.radians([0.0, 40.0, 80.0]):
        found = direct(parts, direction(0.6, 2.0), direction(angle), device)[0]
        assert found == pytest.approx(np.array([0.5, 0.3, 0.1]) / np.pi * np.cos(angle), rel=1e-3)


def test_matte_plane_under_the_sun(device: str) -> None:
    """With its index of 1.5 a matte plane differs from Lambert's law by what its surface reflects, a few per cent."""
    found = direct(surface((0.5, 0.5, 0.5), roughness=1.0), direction(0.5, 1.0), direction(0.5), device)[0]
    assert found == pytest.approx(0.5 / np.pi * np.cos(0.5), rel=0.05)


def ggx(to_viewer: np.ndarray, to_light: np.ndarray, alpha: float, f0: float) -> float:
    """Cook-Torrance with GGX, height-correlated Smith by lambda functions, and Schlick; float64, times the cosine."""
    half = (to_viewer + to_light) / np.linalg.norm(to_viewer + to_light)
    tan2 = (1.0 - half[2] ** 2) / half[2] ** 2
    distribution = 1.0 / (np.pi * alpha**2 * half[2] ** 4 * (1.0 + tan2 / alpha**2) ** 2)
    away = [0.5 * (np.sqrt(1.0 + alpha**2 * (1.0 - w[2] ** 2) / w[2] ** 2) - 1.0) for w in (to_viewer, to_light)]
    fresnel = f0 + (1.0 - f0) * (1.0 - to_viewer @ half) ** 5
    return distribution * fresnel / (1.0 + sum(away)) / (4.0 * to_viewer[2])


def test_ggx_lobe(device: str) -> None:
    """A black dielectric has the lobe alone."""
    for roughness in (0.2, 0.5, 0.9):
        parts = surface((0.0, 0.0, 0.0), roughness, f0=0.04)
        alpha = np.sqrt(roughness**4 + brdf.GLINT_ALPHA2)
        for viewer, light in (((0.3, 0.0), (0.5, 2.0)), ((1.2, 0.0), (1.1, 3.1)), ((0.0, 0.0), (0.02, 1.0))):
            expected = ggx(direction(*viewer), direction(*light), alpha, 0.04)
            found = direct(parts, direction(*viewer), direction(*light), device)[0]
            late = 2.5e-3 * np.cos(light[0])  # light that bounces twice in the facets
            assert found == pytest.approx(expected, rel=1e-3, abs=late)


def test_coat_lobe(device: str) -> None:
    """A coat over black adds its own lobe, of reflectance 0.04."""
    parts = surface((0.0, 0.0, 0.0), 0.5, f0=0.0, coat=1.0, coat_roughness=0.3)
    viewer, light = direction(0.4), direction(0.5, np.pi)
    expected = ggx(viewer, light, np.sqrt(0.3**4 + brdf.GLINT_ALPHA2), 0.04)
    assert direct(parts, viewer, light, device)[0] == pytest.approx(expected, rel=1e-3)


def test_glint_of_a_mirror_is_finite(device: str) -> None:
    """The sun's highlight in a perfect mirror stays below the luminance of the sun's disc, E / (pi radius^2)."""
    parts = surface(roughness=0.0, metallic=1.0)
    peak = direct(parts, direction(0.3), direction(0.3, np.pi), device)[0]
    assert (peak > 500.0).all() and (peak < 1.0 / (np.pi * 0.00465**2)).all()
    assert peak == pytest.approx(1.0 / (4.0 * np.pi * brdf.GLINT_ALPHA2 * np.cos(0.3)), rel=0.01)


def test_reciprocity(device: str) -> None:
    """Without a coat, viewer and light may change places."""
    rng = np.random.default_rng(1)
    to_viewer, to_light = (rng.normal(size=(200, 3)) for _ in range(2))
    for v in (to_viewer, to_light):
        v[:, 2] = np.abs(v[:, 2]) + 0.1
        v /= np.linalg.norm(v, axis=1, keepdims=True)
    panes = surface((0.05, 0.06, 0.05), 0.1, opacity=0.3)
    for parts in (surface(roughness=0.4), surface(roughness=0.8, metallic=1.0), surface(metallic=0.5), panes):
        there = direct(parts, to_viewer, to_light, device) / to_light[:, 2:]
        back = direct(parts, to_light, to_viewer, device) / to_viewer[:, 2:]
        assert there == pytest.approx(back, rel=2e-3, abs=1e-5)


def test_no_light_from_behind(device: str) -> None:
    parts = surface()
    assert (direct(parts, direction(0.2), direction(1.6), device) == 0.0).all()
    parts[0].shading_normal = wp.vec3(0.6, 0.0, 0.8)  # before the bent normal, behind the face
    assert (direct(parts, direction(0.2), direction(1.7), device) == 0.0).all()


def snell(cosine: np.ndarray, ior: float) -> tuple[np.ndarray, np.ndarray]:
    """Fresnel's reflectances for both polarizations by the angle of refraction."""
    inside = np.sqrt(1.0 - (1.0 - cosine**2) / ior**2 + 0j)
    s = abs((cosine - ior * inside) / (cosine + ior * inside)) ** 2
    p = abs((ior * cosine - inside) / (ior * cosine + inside)) ** 2
    return s, p


@pytest.mark.parametrize("ior", [1.33, 1.5, 2.0, 1.0 / 1.5])
def test_fresnel(device: str, ior: float) -> None:
    cosine = np.linspace(0.02, 1.0, 99)
    out = wp.zeros((99, 3), dtype=wp.float32, device=device)
    inputs = [wp.array(np.float32(cosine), dtype=wp.float32, device=device), ior]
    wp.launch(fresnel_kernel, dim=99, inputs=inputs, outputs=[out], device=device)
    face, pane, schlick = out.numpy().T
    s, p = snell(cosine, ior)
    assert face == pytest.approx(0.5 * (s + p), abs=2e-5)
    if ior > 1.0:
        sums = [sum(r * ((1 - r) * r**k) * (1 - r) for k in range(0, 4001, 2)) + r for r in (s, p)]
        away = slice(5, None)  # at grazing incidence the sum over bounces converges slowly
        # Bounces between the faces: R + T R T + T R^3 T + ...
        assert pane[away] == pytest.approx(0.5 * (sums[0] + sums[1])[away], abs=1e-4)
    assert schlick == pytest.approx(0.04 + 0.96 * (1.0 - cosine) ** 5, abs=1e-5)
    if ior == 1.5:
        brewster = np.cos(np.arctan(1.5))
        at = np.argmin(abs(cosine - brewster))
        assert face[at] == pytest.approx(0.5 * ((1.5**2 - 1) / (1.5**2 + 1)) ** 2, abs=2e-3)
    if ior < 1.0:
        assert (face[np.sqrt(1.0 - cosine**2) > ior] == 1.0).all()


def test_pane(device: str) -> None:
    """Window glass reflects by Fresnel's law at both faces; the rest is its own dark color."""
    dark = (0.02, 0.03, 0.04)
    parts = surface(dark, 0.05, f0=0.04, opacity=0.2)
    for angle in np.radians([0.0, 45.0, 70.0]):
        s, p = snell(np.array([np.cos(angle)]), 1.5)
        expected = float((s / (1 + s) + p / (1 + p))[0])
        diffuse, specular, coat = ambient(parts, direction(angle), device)
        assert specular[0] == pytest.approx(expected, abs=1e-4)
        assert diffuse[0] == pytest.approx(np.array(dark) * (1.0 - expected), abs=1e-5)
        assert coat[0] == 0.0
        total = diffuse[0] + specular[0]
        assert reflected_share(parts, direction(angle), device) == pytest.approx(total, abs=0.01)


def test_cut_out_is_no_pane(device: str) -> None:
    """Opacity of leaves is a mask: their edges are not glass."""
    parts = surface((0.3, 0.4, 0.1), opacity=0.6)
    parts[1].opacity_threshold = 0.5
    solid = ambient(surface((0.3, 0.4, 0.1)), direction(0.3), device)
    assert ambient(parts, direction(0.3), device)[0] == pytest.approx(solid[0])
