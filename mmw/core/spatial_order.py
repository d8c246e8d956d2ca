"""Sort points so that neighbors in the order are near each other."""

import numpy as np

MORTON_STEPS = 2**20 - 1
"""Steps of the longest side of the box of points that are brought into a spatial order."""


def spatial_order(points: np.ndarray) -> np.ndarray:
    """Return an order of points in which neighbors in the order are near each other, shape [N].

    Args:
        points: Shape [N, 3].

    Source: G. M. Morton, A computer oriented geodetic data base, IBM, 1966: bits of the three coordinates in turn.
    """
    low = points.min(axis=0)
    extent = (points.max(axis=0) - low).max()
    step = ((points - low) * (MORTON_STEPS / extent if extent > 0.0 else 0.0)).astype(np.uint64)
    code = np.zeros(len(points), dtype=np.uint64)
    for bit in range(MORTON_STEPS.bit_length()):
        for axis in range(3):
            code |= ((step[:, axis] >> np.uint64(bit)) & np.uint64(1)) << np.uint64(3 * bit + axis)
    return np.argsort(code, kind="stable")
