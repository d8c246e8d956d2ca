"""Name paths so that a path keeps its name from frame to frame, while its points move on over what carries them."""

from dataclasses import dataclass

import numpy as np

from mmw.channel.links import Links
from mmw.channel.path_solver.surface_table import SurfaceTable
from mmw.core.host_kernels import run_on_host
from mmw.kernels.channel.path_names import numbered_id_kernel, path_name_kernel
from mmw.scene.device_scene import DeviceScene


@dataclass(frozen=True)
class PathNames:
    """Names of P paths and of what their interactions are on: -1 behind the last, for a diffraction the first face."""

    path_id: np.ndarray
    """Identifier of each path, which paths of one link may share until `tell_apart`, shape [P], int64."""
    kind: np.ndarray
    """Row of `mmw.channel.paths.PATH_KINDS`, shape [P], int8."""
    object_id: np.ndarray
    """Object of each interaction, shape [P, D], int32."""
    material_id: np.ndarray
    """Material of each interaction, shape [P, D], int32."""
    body: np.ndarray
    """Batch index times the number of actors, plus the actor, of each interaction, -1 for the town, shape [P, D],
    int32."""

    def take(self, rows: np.ndarray) -> "PathNames":
        """Return some of the paths."""
        return PathNames(*(getattr(self, name)[rows] for name in self.__dataclass_fields__))


def path_names(
    links: Links,
    link: np.ndarray,
    kind: np.ndarray,
    surface: np.ndarray,
    ray: np.ndarray,
    table: SurfaceTable,
    scene: DeviceScene,
) -> PathNames:
    """Return the names of paths.

    A reflection is named by its wall: all coplanar surfaces, or a curved one. A passage is named by its object, of
    which it may cross one pane after the other: it bends nothing, so that the rest tells the path. A diffraction is
    named by the line that its edge belongs to, with the lines beside it, as the edges of a post; a diffuse one by its
    ray.

    Args:
        links: The links.
        link: Link of each path, shape [P].
        kind: Kind of each interaction, 0 behind the last, shape [P, D].
        surface: Surface of each interaction, of a diffraction its wedge, shape [P, D].
        ray: Ray of a diffuse path, shape [P].
        table: Surfaces of the scene.
        scene: The scene, of which actors move.

    Source: the finaliser of SplitMix64, G. L. Steele et al., OOPSLA 2014, applied word by word.
    """
    inputs = links.tx_number, links.rx_number, link, kind, surface, ray, links.batch_index, scene.instance_actor
    others = table.names_on_host, scene.arrays.poses.shape[1]
    outputs = link.shape, link.shape, kind.shape, kind.shape, kind.shape
    return PathNames(*run_on_host(path_name_kernel, link.shape, inputs, others, outputs))


def tell_apart(ids: np.ndarray, link: np.ndarray, rank_by: np.ndarray) -> np.ndarray:
    """Return identifiers that no two paths of a link share: the first of equal ones keeps its own, shape [P].

    Paths of a link with one name are numbered by their strength, as several points of reflection on one vehicle: not by
    their places, as points move on over a whole vehicle while they reflect.

    Args:
        ids: Identifiers of `path_names`, shape [P].
        link: Link of each path, shape [P].
        rank_by: Value by which paths of one name are ranked, lowest first, shape [P]. By length, a path that ends gives
            its name to the next one, with a step of the level. By minus the strength, the name of rank k has the k-th
            strongest, whose level is continuous where two swap and where the weakest ends.
    """
    codes = ids ^ (link.astype(np.int64) << 32)
    codes.sort()
    if not np.count_nonzero(codes[1:] == codes[:-1]):  # all differ, which is far quicker to see
        return ids
    order = np.lexsort((rank_by, ids, link))
    is_new, sorted_link, sorted_ids = np.ones(len(order), dtype=bool), link[order], ids[order]
    is_new[1:] = (sorted_link[1:] != sorted_link[:-1]) | (sorted_ids[1:] != sorted_ids[:-1])
    first = np.maximum.accumulate(np.where(is_new, np.arange(len(order)), 0))
    rank = np.empty(len(order), dtype=np.int64)
    rank[order] = np.arange(len(order)) - first
    return run_on_host(numbered_id_kernel, rank.shape, (ids, rank), (), (rank.shape,))[0]
