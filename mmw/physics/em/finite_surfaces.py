"""Say how far the edges of a finite surface count in its reflection, and so not in the diffraction at its edges.

The Kirchhoff integral over a surface holds the waves of its edges near the direction of reflection; the uniform theory
of diffraction holds the same waves in its terms of reflection. Of an edge that counts in the integral, diffraction
keeps what the integral lacks, as the fringe waves of the physical theory of diffraction do.

Source: P. Ya. Ufimtsev, Fundamentals of the Physical Theory of Diffraction, 2nd edition, 2014, chapter 4.
"""

import numpy as np

from mmw.kernels.channel.finite_surfaces import FAR_EDGE, LOBE, NEAR_EDGE

WEAKEST_SHARE = 10.0 ** (-25.0 / 20.0)
"""A reflection at a flat surface with less of the mirror's amplitude than this at every carrier is left out [-].
Design value."""


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
