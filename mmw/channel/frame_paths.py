"""Make `CarrierPaths` of links that were just traced, as rows of the dataset would give them, without these rows."""

import numpy as np

from mmw.channel.links import Links
from mmw.channel.path_table import KEY_TYPE, CarrierPaths, first_segments
from mmw.channel.paths import PathSet
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.remember import remembered


def frame_paths(
    links: Links,
    paths: PathSet,
    weather: str,
    carrier: int,
    actors: tuple[str, ...],
    antennas: tuple[str, ...],
    scenario: str,
) -> CarrierPaths:
    """Return the paths at one carrier, bit for bit those of `CarrierPaths.from_table` of their rows.

    Links are in the order of the keys of table `links`, and `row` counts the rows of the view `paths`.

    Args:
        links: The links.
        paths: Their paths.
        weather: Weather of the gains.
        carrier: Row of the carrier in `paths.carriers_hz`.
        actors: Name of each actor, the same tuple in every frame.
        antennas: Name of each antenna, the same tuple in every frame.
        scenario: Name of the scenario.
    """
    (agent, of_agent), (antenna, of_antenna) = _ranked(actors), _ranked(antennas)
    own = (links.tx_antenna, links.rx_antenna, links.tx_actor, links.rx_actor)
    ranks = (names[values] for names, values in zip((of_antenna, of_antenna, of_agent, of_agent), own, strict=True))
    order = np.lexsort((*ranks, links.frame))
    keys = np.empty(len(links), dtype=KEY_TYPE)
    keys["scenario"], keys["weather"], keys["frame"] = scenario, weather, links.frame[order]
    keys["agent"], keys["peer"] = agent[links.rx_actor[order]], agent[links.tx_actor[order]]
    keys["antenna"], keys["peer_antenna"] = antenna[links.rx_antenna[order]], antenna[links.tx_antenna[order]]
    count = paths.count[order].astype(np.int64)
    link, before = np.repeat(np.arange(len(order)), count), np.cumsum(count) - count
    index = np.arange(len(paths)) - before[link]  # within its link
    path = (np.cumsum(paths.count) - paths.count)[order][link] + index
    depth, tx = int(paths.order.max(initial=0)), links.tx.position[paths.link[path]]
    vertex, tau = paths.vertex[path], paths.tau[path]
    return CarrierPaths(
        carrier_hz=float(paths.carriers_hz[carrier]),
        keys=keys,
        link=link,
        row=len(paths.carriers_hz) * before[link] + carrier * count[link] + index,
        is_los=paths.order[path] == 0,
        tau=tau,
        transfer=_stored(paths.transfer[weather][path, carrier]),
        a=_stored(paths.a[weather][path, carrier]),
        theta_t=paths.theta_t[path],
        phi_t=paths.phi_t[path],
        theta_r=paths.theta_r[path],
        phi_r=paths.phi_r[path],
        doppler_hz=-paths.range_rate[path] * paths.carriers_hz[carrier] / SPEED_OF_LIGHT,
        interaction=paths.interaction[path, :depth],
        vertex=vertex[:, :depth],
        first_segment_m=first_segments(tx, vertex, tau),
        edge=paths.edge[path],
        curvature=paths.curvature[path],
    )


def _stored(values: np.ndarray) -> np.ndarray:
    """Return complex numbers as their two columns give them: a part of -0 becomes 0."""
    return values.real + 1j * values.imag


@remembered()
def _ranked(names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return names as an array, and the place of each in their order."""
    rank = np.empty(len(names), dtype=np.int64)
    rank[sorted(range(len(names)), key=names.__getitem__)] = np.arange(len(names))
    return np.array(names, dtype=object), rank
