"""Find edges close to reflected paths, whose waves are strong, for paths that reflect once and diffract once.

Launched rays find the wedges of surfaces that they meet, and of slender ones, such as posts far away, they meet few and
others in every frame. What diffracts strongly lies within a few Fresnel zones of a reflected path, and is looked for
there without rays.
"""

from collections.abc import Iterator

import numpy as np
import warp as wp

from mmw.channel.path_solver.candidate_output import PAIRS_AT_ONCE, Candidates, selected_pairs
from mmw.channel.path_solver.search import Search
from mmw.kernels.channel.diffraction_candidates import near_edges_kernel, near_mirrors_kernel
from mmw.physics.em.finite_surfaces import WEAKEST_SHARE

NEAR_ZONE = 5.0
"""Farthest edge, in Fresnel coordinates at the longest wavelength: the wave of a straight edge is 27 dB down there. An
edge at v makes a path longer by v^2 / 4 wavelengths. Design value."""

LONG_EDGE_M = 0.5
"""Lines of edges shorter than this diffract little, and are left to the rays [m]. Design value."""


def near_edge_candidates(search: Search, link: np.ndarray, plane: np.ndarray) -> Iterator[Candidates]:
    """Yield candidates of one reflection and one diffraction.

    Args:
        search: Surfaces with outlines and wedges.
        link: Link of each reflection, in the order of the transmitters, shape [N].
        plane: Plane that may reflect it, shape [N].
    """
    table, device = search.table, search.scene.device
    wedges = table.wedges
    long = np.flatnonzero(wedges.reach > LONG_EDGE_M).astype(np.int32)
    if table.is_mirror is not None:
        keep = table.is_mirror[table.lead[plane]]
        link, plane = link[keep], plane[keep]
    outlines = search.outlines
    keep = _near_mirrors(search, link, plane)
    link, plane = link[keep], plane[keep]
    if not len(link) or not len(long):
        return
    rows = wp.array(long, dtype=wp.int32, device=device)
    at_once = max(1, PAIRS_AT_ONCE // len(long))
    for begin in range(0, len(link), at_once):
        own, mirror = link[begin : begin + at_once], plane[begin : begin + at_once]
        pairs = [wp.array(values, dtype=wp.int32, device=device) for values in (own, mirror)]
        for is_behind in (False, True):
            inputs = [search.forward.ends, table.device, wedges.device, search.pose, *pairs, rows, is_behind]
            inputs += [outlines.shortest_m, WEAKEST_SHARE, 0.25 * NEAR_ZONE**2 * outlines.longest_m]
            row, index = selected_pairs(search, near_edges_kernel, inputs, (len(own), len(long)))
            step = np.full((len(row), search.config.max_depth), -1, dtype=np.int32)
            step[:, 1 if is_behind else 0] = -2 - long[index]
            step[:, 0 if is_behind else 1] = mirror[row]
            yield own[row], step, True


def _near_mirrors(search: Search, link: np.ndarray, plane: np.ndarray) -> np.ndarray:
    """Return which reflections are on their plane's surfaces or so near that an edge may turn a path to them, [N]."""
    device = search.scene.device
    is_near = wp.empty(len(link), dtype=wp.uint8, device=device)
    pairs = [wp.array(values, dtype=wp.int32, device=device) for values in (link, plane)]
    inputs = [search.forward.ends, search.table.device, search.pose, *pairs, search.outlines.longest_m, NEAR_ZONE]
    wp.launch(near_mirrors_kernel, dim=len(link), inputs=inputs, outputs=[is_near], device=device)
    return is_near.numpy().view(np.bool_)
