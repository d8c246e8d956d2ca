"""Groups of flat surfaces in one plane, so that one image serves them all."""

from itertools import product

import numpy as np

from mmw.core.planar_surfaces import linked_rows
from mmw.physics.em.vectors import dot

SAME_PLANE_M = 1e-4
"""Farthest that the corners of a surface's box may lie from the plane of its group, beyond what they do from its
own [m]: less than float32 rays resolve in a town."""

REACH_M = 100.0
"""Distance over which the tilt of two normals is measured against `SAME_PLANE_M` in the first, coarse search [m]."""


def group_coplanar(
    normal: np.ndarray, offset: np.ndarray, lower: np.ndarray, upper: np.ndarray, area: np.ndarray, part: np.ndarray
) -> np.ndarray:
    """Return the plane group of every surface, 0 to K - 1, numbered by their first surfaces, shape [N], int32.

    Args:
        normal: Unit normals, either side, shape [N, 3].
        offset: normal . p of the planes [m], shape [N].
        lower: Low corners of the surfaces' boxes [m], shape [N, 3].
        upper: High corners [m], shape [N, 3].
        area: Areas [m^2], shape [N]; the largest surface of a group gives its plane.
        part: Surfaces of different parts never share a group, such as town and models, shape [N].
    """
    count = len(normal)
    if count == 0:
        return np.zeros(0, dtype=np.int32)
    lead = np.argmax(np.abs(normal) > 1e-6, axis=1)
    sign = np.sign(normal[np.arange(count), lead])
    sign[sign == 0.0] = 1.0
    normal, offset = normal * sign[:, None], offset * sign
    key = np.concatenate([normal * REACH_M, offset[:, None]], axis=1) / (20.0 * SAME_PLANE_M)
    group = linked_rows(key, part)
    order = np.lexsort((-area, group))
    is_first = np.append(True, group[order][1:] != group[order][:-1])
    leader = order[is_first][np.cumsum(is_first) - 1]
    leader = leader[np.argsort(order, kind="stable")]  # largest surface of each surface's group
    row = np.flatnonzero(leader != np.arange(count))
    lead, low, high = leader[row], lower[row], upper[row]
    off = np.zeros(len(row))
    for pick in product((False, True), repeat=3):
        corner = np.where(np.array(pick), high, low)
        off_own = np.abs(dot(normal[row], corner) - offset[row])
        off_lead = np.abs(dot(normal[lead], corner) - offset[lead])
        off = np.maximum(off, np.abs(off_lead - off_own))
    apart = row[off > SAME_PLANE_M]
    leader[apart] = apart
    return np.unique(leader, return_inverse=True)[1].reshape(-1).astype(np.int32)
