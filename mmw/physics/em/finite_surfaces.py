"""Say how far the edges of a finite surface count in its reflection, and so not in the diffraction at its edges.

The Kirchhoff integral over a surface holds the waves of its edges near the direction of reflection; the uniform theory
of diffraction holds the same waves in its terms of reflection. Of an edge that counts in the integral, diffraction
keeps what the integral lacks, as the fringe waves of the physical theory of diffraction do.

Source: P. Ya. Ufimtsev, Fundamentals of the Physical Theory of Diffraction, 2nd edition, 2014, chapter 4.
"""

import numpy as np

from mmw.core.constants import SPEED_OF_LIGHT
from mmw.kernels.channel.finite_surfaces import FAR_EDGE, LOBE, NEAR_EDGE
from mmw.physics.em.transition import scaled_tail

WEAKEST_SHARE = 10.0 ** (-25.0 / 20.0)
"""A reflection at a flat surface with less of the mirror's amplitude than this at every carrier is left out [-].
Design value."""

WEAKEST_CURVED_SHARE = 10.0 ** (-50.0 / 20.0)
"""The same at a curved surface, which spreads what it reflects: a post of 0.1 m has -36 dB at 200 m [-]. Design
value."""


def edge_share(distance: np.ndarray, width: np.ndarray) -> np.ndarray:
    """Return the share with which an edge counts in the integral over its surface, 0 to 1.

    Args:
        distance: Distance of the edge from the point of reflection, Fresnel coordinate.
        width: Smaller extent of the surface, Fresnel coordinate.

    Returns:
        1 near the point, 0 far from it; see `edge_share` of `kernels/channel/finite_surfaces.py`.
    """
    scaled = distance / (1.0 + LOBE.value / np.maximum(width, 1e-9))
    t = np.clip((FAR_EDGE.value - scaled) / (FAR_EDGE.value - NEAR_EDGE.value), 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)


def finite_edge_share(
    before_m: np.ndarray, behind_m: np.ndarray, scale: np.ndarray, carriers_hz: tuple[float, ...]
) -> np.ndarray:
    """Return the share of the wave of an endless edge that one of finite length has, shape [Q, C], complex128.

    exp(j pi/4) / sqrt(2) times the integral of exp(-j pi/2 w^2) over the edge, in Fresnel coordinates w = x sin(beta)
    sqrt(2 (s' + s) / (lambda s' s)) around the point of diffraction: 1 in the middle of a long edge, 1/2 at its end. An
    end counts as far as `edge_share` says.

    Args:
        before_m: Length of the edge from its begin to the point of diffraction [m], shape [Q].
        behind_m: Length from there to its end [m], shape [Q].
        scale: sin(beta) sqrt((s' + s) / (s' s)), for the angle beta between edge and path [m^-0.5], shape [Q].
        carriers_hz: Carrier frequencies [Hz], shape [C].

    Source: method of stationary phase with end points, e.g. L. B. Felsen and N. Marcuvitz, Radiation and Scattering of
    Waves, section 4.2 (the Fresnel integral over what lies beyond the end is its edge wave).
    """
    wave = np.sqrt(2.0 * np.array(carriers_hz) / SPEED_OF_LIGHT) * scale[:, None]
    share = np.ones(wave.shape, dtype=np.complex128)
    for length in (before_m, behind_m):
        end = length[:, None] * wave
        beyond = 0.5 * np.exp(-0.5j * np.pi * end**2) * scaled_tail(0.5 * np.pi * end**2)
        share -= edge_share(end, np.full(end.shape, np.inf)) * beyond
    return share
