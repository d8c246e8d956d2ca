"""Thin out the diffuse paths of links that have many: weak ones stand for others, so that sums keep their mean."""

from dataclasses import replace
from itertools import pairwise

import numpy as np

from mmw.channel.path_solver.traced_paths import TracedPaths


def thin_out(paths: TracedPaths, row: np.ndarray, weight: np.ndarray, most: int) -> TracedPaths:
    """Return at most about `most` of the paths of each link, whose solid angles make up for those that go.

    A path of weight w stays with the share p = min(1, w n / W) of paths like it, for the sum W of the weights of its
    link and n of `most`, and counts 1 / p times. By the variance of such a choice the relative standard error of the
    sum grows by less than 1 / sqrt(n). Which paths stay follows from the sum of the shares along their order, and not
    from other links. Links with fewer paths keep all of them.

    Args:
        paths: The paths.
        row: Link of each, shape [P].
        weight: What each contributes, up to a factor, shape [P].
        most: The number n.

    Source: systematic sampling with unequal probabilities, W. G. Madow, "On the theory of systematic sampling, II",
    Annals of Mathematical Statistics 20, 1949; known in rendering as Russian roulette, J. Arvo and D. Kirk, "Particle
    transport and image synthesis", SIGGRAPH 1990.
    """
    keys = [paths.surface[:, k] for k in reversed(range(paths.surface.shape[1]))]
    order = np.lexsort((*keys, paths.order, paths.ray, row))
    share, keep = np.ones(len(paths)), np.ones(len(paths), dtype=bool)
    first = np.searchsorted(row[order], np.arange(int(row.max(initial=-1)) + 2))
    for begin, end in pairwise(first):
        own = order[begin:end]
        if len(own) > most:
            part = np.minimum(1.0, weight[own] * (most / weight[own].sum()))
            end_of = np.cumsum(part)
            keep[own] = np.floor(end_of + 0.5) > np.floor(end_of - part + 0.5)
            share[own] = part
    kept = np.flatnonzero(keep)
    out = paths.take(kept)
    return replace(out, solid_angle=out.solid_angle / share[kept])
