"""Trace links of both directions once: find the unique ones and add their reverse."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from mmw.channel.links import Links
from mmw.channel.path_solver.path_names import path_names, tell_apart
from mmw.channel.path_solver.surface_table import SurfaceTable
from mmw.channel.path_solver.traced_paths import reverse_columns
from mmw.channel.paths import PathSet
from mmw.config import ChannelConfig
from mmw.core.remember import remembered
from mmw.physics.em.interaction import TRANSMISSION
from mmw.scene.device_scene import DeviceScene


def unique_links(links: Links, config: ChannelConfig) -> tuple[np.ndarray, np.ndarray]:
    """Return the links that have to be traced, and for every link the one that reads a traced link backward.

    Two links of one frame are each other's reverse if each starts at the antenna where the other ends, with the same
    attitude there. The one with the lower transmitter is traced, so that few transmitters serve all pairs. Antennas of
    different polarizations have no reverse: the loss by rain is that of the transmitter's.

    Args:
        links: The links.
        config: The antennas.

    Returns:
        Rows of `links` to trace, shape [T]; and the row, among those, that each link is the reverse of, -1 for a link
        that is traced itself, shape [L].
    """
    if _are_one_way(links.tx_actor, links.tx_antenna, links.rx_actor, links.rx_antenna):
        return all_links(len(links))
    tx, rx = links.tx_number, links.rx_number
    order = np.lexsort((tx, np.maximum(tx, rx), np.minimum(tx, rx), links.batch_index))
    first, second = order[:-1], order[1:]
    polarization = np.array([antenna.polarization for antenna in config.antennas])
    is_pair = (links.batch_index[first] == links.batch_index[second]) & (tx[first] == rx[second])
    is_pair &= (rx[first] == tx[second]) & (tx[first] < tx[second])
    is_pair &= polarization[links.tx_antenna[first]] == polarization[links.rx_antenna[first]]
    for one, other in ((links.tx, links.rx), (links.rx, links.tx)):
        is_pair &= (one.position[first] == other.position[second]).all(axis=1)
        is_pair &= (one.rotation[first] == other.rotation[second]).all(axis=(1, 2))
        is_pair &= (one.velocity[first] == other.velocity[second]).all(axis=1)
    reverse_of = np.full(len(links), -1)
    reverse_of[second[is_pair]] = first[is_pair]
    traced = np.flatnonzero(reverse_of < 0)
    number = np.full(len(links), -1)
    number[traced] = np.arange(len(traced))
    return traced, np.where(reverse_of >= 0, number[reverse_of], -1)


@remembered(owners=4, size=16)
def _are_one_way(tx_actor: np.ndarray, tx_antenna: np.ndarray, rx_actor: np.ndarray, rx_antenna: np.ndarray) -> bool:
    """Return whether no antenna is an end of both kinds; these fields of links stay while the same agents are there."""
    tx, rx = (
        {*zip(*map(np.ndarray.tolist, end), strict=True)} for end in ((tx_actor, tx_antenna), (rx_actor, rx_antenna))
    )
    return tx.isdisjoint(rx)


@lru_cache(16)
def all_links(count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return what `unique_links` does for a number of links of which none is the reverse of another one, read-only."""
    traced, reverse_of = np.arange(count), np.full(count, -1)
    for values in (traced, reverse_of):  # all searches of as many links share them
        values.setflags(write=False)
    return traced, reverse_of


def add_reversed_links(
    paths: PathSet,
    links: Links,
    traced: np.ndarray,
    reverse_of: np.ndarray,
    table: SurfaceTable,
    rank_by: np.ndarray,
    scene: DeviceScene,
) -> PathSet:
    """Return the paths of all links from those of the traced ones.

    The transfer backward is the transpose, and the coefficient between the same two antennas is the same: mirrors and
    slabs are reciprocal. Not for diffraction and diffuse scattering, whose models tell the ends apart.

    Args:
        paths: CarrierPaths of the traced links; `link` counts among them.
        links: All links.
        traced: Rows of the traced links, from `unique_links`.
        reverse_of: Row of the traced link that each link is the reverse of, from `unique_links`.
        table: Surfaces of the scene.
        rank_by: Value by which paths of one name are numbered, lowest first, shape [P].
        scene: The scene.
    """
    backward = np.flatnonzero(reverse_of >= 0)
    begin = np.cumsum(paths.count) - paths.count
    many = paths.count[reverse_of[backward]]
    link = np.repeat(backward, many)
    row = np.repeat(begin[reverse_of[backward]] - np.cumsum(many) + many, many) + np.arange(len(link))
    joined = {}
    for name, fill in (("interaction", 0), ("surface", -1), ("object_id", -1), ("material_id", -1), ("vertex", np.nan)):
        values = getattr(paths, name)
        joined[name] = np.concatenate([values, reverse_columns(values[row], paths.order[row], fill)])
    interaction = joined["interaction"][len(paths) :]
    normal = reverse_columns(paths.normal[row], paths.order[row], np.nan)
    normal = np.where((interaction == TRANSMISSION)[..., None], -normal, normal)
    joined["normal"] = np.concatenate([paths.normal, normal])
    for angle in ("theta", "phi"):
        at_tx, at_rx = getattr(paths, f"{angle}_t"), getattr(paths, f"{angle}_r")
        joined[f"{angle}_t"] = np.concatenate([at_tx, at_rx[row]])
        joined[f"{angle}_r"] = np.concatenate([at_rx, at_tx[row]])
    all_link = np.concatenate([traced[paths.link], link])
    own = np.concatenate([np.arange(len(paths)), row])
    for name in ("kind", "order", "edge", "curvature", "tau", "range_rate"):
        joined[name] = getattr(paths, name)[own]
    surface, no_ray = joined["surface"][len(paths) :], np.full(len(link), -1)
    back = path_names(links, link, interaction, surface, no_ray, table, scene)
    joined["path_id"] = np.concatenate([paths.path_id, tell_apart(back.path_id, link, rank_by[row])])
    depth = interaction.shape[1]
    keys = [joined["surface"][:, k] for k in reversed(range(depth))]
    keys += [joined["interaction"][:, k] for k in reversed(range(depth))]
    order = np.lexsort((*keys, joined["order"], all_link))
    is_back = np.concatenate([np.zeros(len(paths), dtype=bool), np.ones(len(row), dtype=bool)])[order]
    own = own[order]

    def transfer(values: np.ndarray) -> np.ndarray:
        taken = values[own]
        return np.where(is_back[:, None, None, None], taken.swapaxes(2, 3), taken)

    return replace(
        paths,
        link=all_link[order].astype(np.int32),
        **{name: values[order] for name, values in joined.items()},
        count=np.bincount(all_link, minlength=len(links)).astype(np.int32),
        transfer={weather: transfer(values) for weather, values in paths.transfer.items()},
        a={weather: values[own] for weather, values in paths.a.items()},
        loss_db={w: {name: values[own] for name, values in losses.items()} for w, losses in paths.loss_db.items()},
    )
