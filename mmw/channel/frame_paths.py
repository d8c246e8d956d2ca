"""Make `CarrierPaths` of links that were just traced, as rows of the dataset would give them, without these rows."""

from typing import Any

import numpy as np

from mmw.channel.links import Links
from mmw.channel.path_table import KEY_TYPE, CarrierPaths, first_segments
from mmw.channel.paths import PathSet
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.remember import remembered


class FramePaths:
    """Paths of some frames in the order of the rows of the tables, at every carrier.

    Links are in the order of the keys of table `links`.
    """

    def __init__(
        self,
        links: Links,
        paths: PathSet,
        weather: str,
        actors: tuple[str, ...],
        antennas: tuple[str, ...],
        scenario: str,
    ) -> None:
        """Bring the paths into their order.

        Args:
            links: The links.
            paths: Their paths.
            weather: Weather of the gains.
            actors: Name of each actor, the same tuple in every frame.
            antennas: Name of each antenna, the same tuple in every frame.
            scenario: Name of the scenario.
        """
        frame = links.frame - links.frame[:1]  # the same for one frame after the other
        ends = np.array([links.tx_antenna, links.rx_antenna, links.tx_actor, links.rx_actor, frame], dtype=np.int32)
        order, keys = _ordered_links(actors, antennas, ends.tobytes(), scenario, weather)
        keys = keys.copy()
        keys["frame"] = links.frame if order is None else links.frame[order]
        if order is None:
            count, path, link = paths.count.astype(np.int64), slice(None), paths.link.astype(np.int64)
        else:
            count = paths.count[order].astype(np.int64)
            link = np.repeat(np.arange(len(order)), count)
        first = (count.cumsum() - count).take(link)
        number = np.arange(len(link))
        if order is not None:
            path = (paths.count.cumsum() - paths.count)[order][link] + number - first
        self._row = (len(paths.carriers_hz) - 1) * first + number, count.take(link)
        self._carriers_hz, self._approach = paths.carriers_hz, -paths.range_rate[path]
        self._transfer, self._a = (_stored(values[weather][path]) for values in (paths.transfer, paths.a))
        depth, tx = int(paths.order.max(initial=0)), links.tx.position.take(paths.link[path], axis=0)
        vertex, tau = paths.vertex[path], paths.tau[path]
        self._columns = {
            "keys": keys,
            "link": link,
            "is_los": paths.order[path] == 0,
            "tau": tau,
            "interaction": paths.interaction[path, :depth],
            "vertex": vertex[:, :depth],
            "first_segment_m": first_segments(tx, vertex, tau),
            **{name: getattr(paths, name)[path] for name in _SAME_COLUMNS},
        }
        for values in self._columns.values():
            values.setflags(write=False)

    def at(self, carrier: int) -> CarrierPaths:
        """Return the paths at one carrier, bit for bit those of `CarrierPaths.from_table` of their rows.

        `row` counts the rows of the view `paths`. Arrays that are the same at every carrier are one, which is
        read-only.

        Args:
            carrier: Row of the carrier in `paths.carriers_hz`.
        """
        row, count = self._row
        carrier_hz = float(self._carriers_hz[carrier])
        return unchecked_paths(
            **self._columns,
            carrier_hz=carrier_hz,
            row=row + carrier * count,
            transfer=self._transfer[:, carrier].copy(),
            a=self._a[:, carrier].copy(),
            doppler_hz=self._approach * carrier_hz / SPEED_OF_LIGHT,
        )


def unchecked_paths(**fields: Any) -> CarrierPaths:
    """Return paths of arrays that fit by how they were made, without the checks of `CarrierPaths`."""
    paths = object.__new__(CarrierPaths)
    paths.__dict__.update(fields)
    return paths


_SAME_COLUMNS = ("theta_t", "phi_t", "theta_r", "phi_r", "edge", "curvature")
"""Columns of `PathSet` that paths have at every carrier."""


def _stored(values: np.ndarray) -> np.ndarray:
    """Return complex numbers as their two columns give them: a part of -0 becomes 0."""
    return values.real + 1j * values.imag


@remembered(owners=2, size=16)
def _ordered_links(
    actors: tuple[str, ...], antennas: tuple[str, ...], ends: bytes, scenario: str, weather: str
) -> tuple[np.ndarray | None, np.ndarray]:
    """Return the links in their order, shape [L], None where they are in it, and their keys without the frame, [L].

    Args:
        actors: Name of each actor.
        antennas: Name of each antenna.
        ends: Antenna of transmitter and receiver, actor of both, of each link, and its frame, counted from that of the
            first link: int32, shape [5, L].
        scenario: Name of the scenario.
        weather: Weather of the gains.
    """
    (agent, of_agent), (antenna, of_antenna) = _ranked(actors), _ranked(antennas)
    of_link = np.frombuffer(ends, dtype=np.int32).reshape(5, -1)
    tx_antenna, rx_antenna, tx, rx, frame = of_link
    order = np.lexsort((of_antenna[tx_antenna], of_antenna[rx_antenna], of_agent[tx], of_agent[rx], frame))
    tx_antenna, rx_antenna, tx, rx, _ = of_link[:, order]
    keys = np.empty(len(order), dtype=KEY_TYPE)
    keys["scenario"], keys["weather"] = scenario, weather
    keys["agent"], keys["peer"], keys["antenna"], keys["peer_antenna"] = (
        agent[rx],
        agent[tx],
        antenna[rx_antenna],
        antenna[tx_antenna],
    )
    return order if (order[1:] < order[:-1]).any() else None, keys


@remembered()
def _ranked(names: tuple[str, ...]) -> tuple[np.ndarray, np.ndarray]:
    """Return names as an array, and the place of each in their order."""
    rank = np.empty(len(names), dtype=np.int64)
    rank[sorted(range(len(names)), key=names.__getitem__)] = np.arange(len(names))
    return np.array(names, dtype=object), rank
