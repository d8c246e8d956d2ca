"""Name paths so that a path keeps its name from frame to frame, while its points move on over what carries them."""

from dataclasses import dataclass

import numpy as np

from mmw.channel.links import Links
from mmw.channel.path_solver.surface_table import SurfaceTable
from mmw.core.host_kernels import run_on_host
from mmw.kernels.channel.path_names import numbered_id_kernel, path_name_kernel


@dataclass(frozen=True)
class PathNames:
    """Names of P paths and of what they meet."""

    path_id: np.ndarray
    """Identifier of each path, shape [P], int64."""
    object_id: np.ndarray
    """Object of each interaction, -1 behind the last, shape [P, D], int32."""
    kind: np.ndarray
    """Row of `mmw.channel.paths.PATH_KINDS`, shape [P], int8."""


def path_names(
    links: Links,
    link: np.ndarray,
    kind: np.ndarray,
    surface: np.ndarray,
    ray: np.ndarray,
    table: SurfaceTable,
    rank_by: np.ndarray,
) -> PathNames:
    """Return the names of paths.

    A reflection is named by its wall: all coplanar surfaces, or a curved one. A passage is named by its object, of
    which it may cross one pane after the other: it bends nothing, so that the rest tells the path. A diffraction is
    named by the line that its edge belongs to, with the lines beside it, as the edges of a post; a diffuse one by its
    ray. Paths of a link with one name are numbered by their strength, as several points of
    reflection on one vehicle: not by their places, as points move on over a whole vehicle while they reflect.

    Args:
        links: The links.
        link: Link of each path, shape [P].
        kind: Kind of each interaction, 0 behind the last, shape [P, D].
        surface: Surface of each interaction, of a diffraction its wedge, shape [P, D].
        ray: Ray of a diffuse path, shape [P].
        table: Surfaces of the scene.
        rank_by: Value by which paths of one name are numbered, lowest first, shape [P].

    Source: the finaliser of SplitMix64, G. L. Steele et al., OOPSLA 2014, applied word by word.
    """
    inputs = links.tx_number, links.rx_number, link, kind, surface, ray
    outputs = link.shape, kind.shape, link.shape
    ids, objects, kinds = run_on_host(path_name_kernel, link.shape, inputs, [table.names_on_host], outputs)
    return PathNames(tell_apart(ids, link, rank_by), objects, kinds)


def tell_apart(ids: np.ndarray, link: np.ndarray, rank_by: np.ndarray) -> np.ndarray:
    """Return identifiers that no two paths of a link share: the first of equal ones keeps its own, shape [P].

    Args:
        ids: Identifiers of `path_name_kernel`, shape [P].
        link: Link of each path, shape [P].
        rank_by: Value by which paths of one name are ranked, lowest first, shape [P]. By length, a path that ends gives
            its name to the next one, with a step of the level. By minus the strength, the name of rank k has the k-th
            strongest, whose level is continuous where two swap and where the weakest ends.
    """
    order = np.lexsort((rank_by, ids, link))
    is_new, sorted_link, sorted_ids = np.ones(len(order), dtype=bool), link[order], ids[order]
    is_new[1:] = (sorted_link[1:] != sorted_link[:-1]) | (sorted_ids[1:] != sorted_ids[:-1])
    if is_new.all():
        return ids
    first = np.maximum.accumulate(np.where(is_new, np.arange(len(order)), 0))
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order)) - first
    return run_on_host(numbered_id_kernel, rank.shape, (ids, rank), (), (rank.shape,))[0]
