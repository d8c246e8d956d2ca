"""Order of paths and their duplicates in NumPy, one pass over all pairs of the same distance in the order of length."""

import numpy as np

from mmw.channel.path_solver.image_method import path_lengths
from mmw.channel.path_solver.traced_paths import TracedPaths
from mmw.kernels.channel.path_order import SAME_NORMAL_COS, SAME_POINT_M
from mmw.kernels.channel.surfaces import LIFT
from mmw.physics.em.interaction import DIFFRACTION
from mmw.physics.em.vectors import dot, norm


def rows_in_order(
    found: TracedPaths, tx: np.ndarray, rx: np.ndarray, area: np.ndarray, origin: np.ndarray
) -> np.ndarray:
    """Return the rows to keep, sorted by (link, order, kinds, surfaces).

    Args:
        found: The paths.
        tx: Transmitter of each link [m], shape [L, 3].
        rx: Receiver [m], shape [L, 3].
        area: Areas of all surfaces [m^2].
        origin: World position of the scene frame's origin [m].
    """
    length = path_lengths(tx[found.link], rx[found.link], found)
    reach = np.fmax.reduce(np.abs(found.vertex - origin), axis=(1, 2), initial=0.0)  # NaN does not count
    apart = np.maximum(SAME_POINT_M, LIFT.value * (5.0 + reach))
    columns = range(found.kind.shape[1] - 1, -1, -1)  # the last key sorts first
    keys = [found.ray, *(values[:, k] for values in (found.surface, found.kind) for k in columns)]
    rank = np.lexsort((*keys, found.order, found.link))
    exact = rank[found.ray[rank] == -1]
    near_rank = exact[np.lexsort((length[exact], found.order[exact], found.link[exact]))]
    dropped = np.zeros(len(found), dtype=bool)
    has_none = (found.kind == DIFFRACTION) | (found.surface < 0)
    size = np.where(has_none, 0.0, area[np.where(has_none, 0, found.surface)]).sum(axis=1)
    rank_of = np.empty(len(found), dtype=np.int64)
    rank_of[rank] = np.arange(len(found))
    for step in range(1, len(near_rank)):
        one, other = near_rank[:-step], near_rank[step:]
        near = (found.link[one] == found.link[other]) & (found.order[one] == found.order[other])
        near &= (length[other] - length[one] <= 2.0 * apart[one] * found.order[one]) & (found.order[one] > 0)
        one, other = one[near], other[near]
        is_edge = found.kind[one] == DIFFRACTION
        same = (found.kind[one] == found.kind[other]).all(axis=1)
        same &= (np.nan_to_num(norm(found.vertex[one] - found.vertex[other])) <= apart[one, None]).all(axis=1)
        is_bent = np.abs(dot(found.normal[one], found.normal[other])) < SAME_NORMAL_COS
        same &= ~(is_bent & ~is_edge).any(axis=1)
        one, other = one[same], other[same]
        is_first = np.where(size[one] == size[other], rank_of[one] < rank_of[other], size[one] < size[other])
        dropped[np.where(is_first, other, one)] = True
    return rank[~dropped[rank]]
