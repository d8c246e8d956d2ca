"""Links in both directions: traced once, read both ways."""

from dataclasses import replace

import numpy as np

from mmw.channel.links import Links
from mmw.channel.paths import PathSet, path_ids
from mmw.physics.em.interaction import TRANSMISSION


def one_way(links: Links) -> tuple[np.ndarray, np.ndarray]:
    """Return the links that have to be traced, and for every link the one that reads a traced link backward.

    Two links of one frame are each other's reverse if each starts where the other ends, with the same attitude there.
    The one with the lower transmitter is traced, so that few transmitters serve all pairs.

    Args:
        links: The links.

    Returns:
        Rows of `links` to trace, shape [T]; and the row, among those, that each link is the reverse of, -1 for a link
        that is traced itself, shape [L].
    """
    low = np.minimum(links.tx_actor, links.rx_actor)
    high = np.maximum(links.tx_actor, links.rx_actor)
    order = np.lexsort((links.tx_actor, high, low, links.slot))
    first, second = order[:-1], order[1:]
    is_pair = (links.slot[first] == links.slot[second]) & (links.tx_actor[first] == links.rx_actor[second])
    is_pair &= (links.rx_actor[first] == links.tx_actor[second]) & (links.tx_actor[first] < links.tx_actor[second])
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


def read_both_ways(paths: PathSet, links: Links, traced: np.ndarray, reverse_of: np.ndarray) -> PathSet:
    """Return the paths of all links from those of the traced ones.

    The transfer backward is the transpose, and with equal antennas at both ends the coefficient is the same: mirrors
    and slabs are reciprocal. Not for diffraction and diffuse scattering, whose models tell the ends apart.

    Args:
        paths: Paths of the traced links; `link` counts among them.
        links: All links.
        traced: What `one_way` returns.
        reverse_of: What `one_way` returns.
    """
    backward = np.flatnonzero(reverse_of >= 0)
    begin = np.cumsum(paths.count) - paths.count
    many = paths.count[reverse_of[backward]]
    link = np.repeat(backward, many)
    row = np.repeat(begin[reverse_of[backward]] - np.cumsum(many) + many, many) + np.arange(len(link))
    column = paths.order[row, None].astype(np.int64) - 1 - np.arange(paths.interaction.shape[1])
    is_there, column = column >= 0, np.maximum(column, 0)

    def turned(values: np.ndarray, nothing: float) -> np.ndarray:
        taken = values[row[:, None], column]
        return np.where(is_there.reshape(is_there.shape + (1,) * (taken.ndim - 2)), taken, nothing).astype(values.dtype)

    interaction = turned(paths.interaction, 0)
    normal = turned(paths.normal, np.nan)
    normal = np.where((interaction == TRANSMISSION)[..., None], -normal, normal)
    all_link = np.concatenate([traced[paths.link], link])
    joined = {
        "interaction": np.concatenate([paths.interaction, interaction]),
        "surface": np.concatenate([paths.surface, turned(paths.surface, -1)]),
        "object_id": np.concatenate([paths.object_id, turned(paths.object_id, -1)]),
        "material_id": np.concatenate([paths.material_id, turned(paths.material_id, -1)]),
        "vertex": np.concatenate([paths.vertex, turned(paths.vertex, np.nan)]),
        "normal": np.concatenate([paths.normal, normal]),
        "theta_t": np.concatenate([paths.theta_t, paths.theta_r[row]]),
        "phi_t": np.concatenate([paths.phi_t, paths.phi_r[row]]),
        "theta_r": np.concatenate([paths.theta_r, paths.theta_t[row]]),
        "phi_r": np.concatenate([paths.phi_r, paths.phi_t[row]]),
    }
    own = np.concatenate([np.arange(len(paths)), row])
    for name in ("kind", "order", "tau", "range_rate"):
        joined[name] = getattr(paths, name)[own]
    back_id = path_ids(links.tx_actor[link], links.rx_actor[link], interaction, joined["surface"][len(paths) :])
    joined["path_id"] = np.concatenate([paths.path_id, back_id])
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
