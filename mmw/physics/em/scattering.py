"""Compute diffuse scattering at rough surfaces: the effective-roughness model, one or two patches a ray.

Source: V. Degli-Esposti, F. Fuschini, E. M. Vitucci and G. Falciasecca, "Measurement and modeling of scattering from
buildings", IEEE Trans. AP 55(1), 2007; the solid angle of a ray tube as in Sionna RT 2.2.
"""

from collections.abc import Callable
from dataclasses import dataclass
from math import comb

import numpy as np

from mmw.physics.em.field import PathGeometry, perpendicular
from mmw.physics.em.surface_response import SurfaceResponse
from mmw.physics.em.vectors import dot
from mmw.physics.materials.material import Material, RadioMaterial
from mmw.physics.materials.scattering_patterns import LOBES, scattered_density


@dataclass(frozen=True)
class ScatteringPoints:
    """The diffuse reflections of a set of paths: one row each, B of them, in the order of paths and interactions."""

    path: np.ndarray
    """Row of the path, shape [B]."""
    step: np.ndarray
    """Index of the interaction in its path, shape [B]."""
    normal: np.ndarray
    """Unit normal, turned to where the wave comes from, shape [B, 3]."""
    solid_angle: np.ndarray
    """Solid angle of the ray that hit the patch, seen from the end that sent it [sr], shape [B]; in paths with two
    patches the product with that of the ray between them [sr^2]."""
    is_backward: np.ndarray
    """True if that end is the receiver, shape [B]."""


def scattering_pattern(radio: RadioMaterial, k_in: np.ndarray, k_out: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Return the density of scattered power over the hemisphere, which integrates to 1 [1/sr], shape [B].

    Args:
        radio: The material: pattern, exponents, share of the forward lobe. A pattern of a user has no exponents.
        k_in: Unit directions of the incoming waves, shape [B, 3].
        k_out: Unit directions of the scattered waves, shape [B, 3].
        normal: Unit normals on the side of the incoming waves, shape [B, 3].

    Raises:
        InputError: If a pattern of a user is not known in this process, or returns no densities.

    Source: Degli-Esposti et al. 2007, equations 5 (Lambertian), 8 to 11 (directive) and 13 (backscattering).
    """
    if radio.scattering_pattern not in LOBES:
        return scattered_density(radio.scattering_pattern, k_in, k_out, normal)
    cos_out = np.maximum(dot(k_out, normal), 0.0)
    if radio.scattering_pattern == "lambertian":
        return cos_out / np.pi
    cos_in = np.minimum(np.abs(dot(k_in, normal)), 1.0)
    mirrored = k_in - 2.0 * dot(k_in, normal)[:, None] * normal
    forward = (0.5 * (1.0 + dot(mirrored, k_out))) ** radio.alpha_r
    share = radio.lobe_share if radio.scattering_pattern == "backscattering" else 1.0
    backward = (0.5 * (1.0 - dot(k_in, k_out))) ** radio.alpha_i
    whole = share * lobe_integral(radio.alpha_r, cos_in) + (1.0 - share) * lobe_integral(radio.alpha_i, cos_in)
    return np.where(cos_out > 0.0, (share * forward + (1.0 - share) * backward) / whole, 0.0)


def lobe_integral(exponent: int, cosine: np.ndarray) -> np.ndarray:
    """Return the integral of a lobe ((1 + cos psi) / 2)^exponent over the hemisphere, shape of `cosine`.

    Args:
        exponent: At least 1.
        cosine: Cosine of the angle between the axis of the lobe and the normal.

    Source: Degli-Esposti et al. 2007, equations 9 to 11.
    """
    sine = np.sqrt(1.0 - cosine**2)
    total = np.zeros_like(cosine)
    for j in range(exponent + 1):
        part = np.full_like(cosine, 2.0 * np.pi / (j + 1))
        if j % 2:
            part = part * cosine * sum(comb(2 * w, w) * (sine / 2.0) ** (2 * w) for w in range((j - 1) // 2 + 1))
        total += comb(exponent, j) * part
    return total / 2.0**exponent


def rough_spreading(geometry: PathGeometry, hits: ScatteringPoints) -> tuple[np.ndarray, np.ndarray]:
    """Return the paths with patches, shape [Q], and the spreading factor of each, shape [Q].

    A patch dA that a wave reaches at theta_i and leaves at theta_s intercepts dA cos theta_i of it. Seen from the
    transmitter, whose ray has the solid angle dW = dA cos theta_i / d_t^2, that is sqrt(dW) / d_r; seen from the
    receiver, whose ray has dW = dA cos theta_s / d_r^2, it is sqrt(dW cos theta_i / cos theta_s) / d_t; d_t and d_r are
    the lengths of the path before and behind the patch.

    Two patches at the distance r intercept dA_1 cos theta_i1 dA_2 cos theta_i2 / (d_t r d_r)^2. Rays of the transmitter
    and of the first patch have dW_1 = dA_1 cos theta_i1 / d_t^2 and dW_2 = dA_2 cos theta_i2 / r^2, so it is
    sqrt(dW_1 dW_2) / d_r; rays from the receiver give sqrt(dW_1 dW_2) / d_t with the ratios of cosines of both patches.

    Source: Degli-Esposti et al. 2007, equation 2.
    """
    before, behind = geometry.lengths_around(hits.path, hits.step)
    cosine_in = np.abs(dot(geometry.direction[hits.path, hits.step], hits.normal))
    cosine_out = np.maximum(np.abs(dot(geometry.direction[hits.path, hits.step + 1], hits.normal)), 1e-12)
    path, first, count = np.unique(hits.path, return_index=True, return_counts=True)
    last = first + count - 1
    turned = np.sqrt(np.multiply.reduceat(cosine_in / cosine_out, first)) / before[first]
    return path, np.sqrt(hits.solid_angle[first]) * np.where(hits.is_backward[first], turned, 1.0 / behind[last])


def rough_amplitude(
    geometry: PathGeometry, hits: ScatteringPoints, materials: tuple[Material, ...], material_id: np.ndarray
) -> np.ndarray:
    """Return sqrt(f_s) of each diffuse reflection, shape [B].

    Source: Degli-Esposti et al. 2007, equation 4.
    """
    k_in, k_out = geometry.direction[hits.path, hits.step], geometry.direction[hits.path, hits.step + 1]
    out = np.zeros(len(hits.path))
    for index in np.unique(material_id):
        rows = np.nonzero(material_id == index)[0]
        density = scattering_pattern(materials[index].radio, k_in[rows], k_out[rows], hits.normal[rows])
        out[rows] = np.sqrt(density)
    return out


def rough_matrices(
    amplitude: np.ndarray, share: np.ndarray, materials: tuple[Material, ...], material_id: np.ndarray
) -> np.ndarray:
    """Return S sqrt(f_s) times the cross-polarisation matrix of each diffuse reflection, shape [B, 2, 2].

    Args:
        amplitude: sqrt(f_s), shape [B].
        share: S, shape [B].
        materials: Materials by id.
        material_id: Their materials, shape [B].

    Source: Sionna RT 2.2's matrix for the cross-polarised share.
    """
    xpd = np.array([material.radio.xpd for material in materials])[material_id]
    straight, across = np.sqrt(1.0 - xpd), np.sqrt(xpd)
    out = np.empty((len(amplitude), 2, 2))
    scale = share * amplitude
    out[:, 0, 0], out[:, 0, 1] = scale * straight, scale * -across
    out[:, 1, 0], out[:, 1, 1] = scale * across, scale * straight
    return out


def rough_columns(
    geometry: PathGeometry, hits: ScatteringPoints, material_id: np.ndarray, response: SurfaceResponse
) -> Callable[[int, np.ndarray], np.ndarray]:
    """Return the function that weakens a field as much as a mirror of the same material would.

    Gamma = |E_reflected| / |E_incoming| follows from the polarization that comes in, so it is worked out for each of
    the transmitter's two components: for a mixture of them the transfer is an approximation.

    Args:
        geometry: The paths.
        hits: Their diffuse reflections.
        material_id: Their materials, shape [B].
        response: The materials at the carrier.

    Returns:
        A function of the number of an interaction and the field that comes to it, shape [P, 2, 2] (component, column),
        that gives a factor for each column, shape [P, 2].

    Source: Degli-Esposti et al. 2007, equation 3.
    """
    k_in = geometry.direction[hits.path, hits.step]
    te_axis = perpendicular(k_in, hits.normal)
    tm_axis = np.cross(k_in, te_axis)
    te, tm = response.reflection(material_id, geometry.cosine[hits.path, hits.step])
    basis = geometry.incoming[hits.path, hits.step]

    def factor(step: int, field: np.ndarray) -> np.ndarray:
        out = np.ones((len(field), 2))
        at = hits.step == step
        own = field[hits.path[at]]
        along_te, along_tm = (
            dot(basis[at, 0], axis[at])[:, None] * own[:, 0] + dot(basis[at, 1], axis[at])[:, None] * own[:, 1]
            for axis in (te_axis, tm_axis)
        )
        power = np.abs(along_te) ** 2 + np.abs(along_tm) ** 2
        specular_share = np.abs(te[at, None] * along_te) ** 2 + np.abs(tm[at, None] * along_tm) ** 2
        out[hits.path[at]] = np.sqrt(specular_share / np.where(power > 0.0, power, 1.0))
        return out

    return factor
