"""Describe the antenna elements at both ends of links, where they differ from link to link."""

from dataclasses import dataclass, replace

import numpy as np

from mmw.channel.antennas.arrays import ROW_KEYS, PlanarArray
from mmw.channel.antennas.patterns import antenna_field, slant_angles
from mmw.channel.links import Links
from mmw.config import ChannelConfig
from mmw.config.antennas import AntennaConfig
from mmw.core.remember import remembered
from mmw.physics.em.field import PathGeometry


@dataclass(frozen=True)
class EndElements:
    """Elements at one end of L links."""

    arrays: tuple[PlanarArray, ...]
    """Arrays whose elements they are."""
    index: np.ndarray
    """Array of each link's end, shape [L], int32."""

    @property
    def tilt(self) -> np.ndarray:
        """Tilt of each link's polarization against the horizontal [rad], shape [L]: pi/2 for V, pi/4 for a slant of 45
        degrees, 0 for H."""
        of_array = [np.pi / 2 - abs(slant_angles(array.polarization)[0]) for array in self.arrays]
        return np.array(of_array)[self.index]

    def field(
        self, direction: np.ndarray, angles: tuple[np.ndarray, np.ndarray], rotation: np.ndarray, link: np.ndarray
    ) -> np.ndarray:
        """Return the far field of the element of the first polarization, at the phase center.

        Args:
            direction: Unit directions away from the antenna, world frame, shape [P, 3].
            angles: Their zenith and azimuth [rad], shape [P] each.
            rotation: Device-to-world rotation of every link's end, shape [L, 3, 3].
            link: Link of each path, shape [P].

        Returns:
            Components (theta, phi) in the world's basis, shape [P, 1, 2].
        """
        if not len(link):
            return np.zeros((0, 1, 2))
        if len(self.arrays) == 1:
            return _first_field(self.arrays[0], direction, angles, rotation[link])
        parts = []
        for number in np.unique(self.index[link]):
            rows = np.flatnonzero(self.index[link] == number)
            own = angles[0][rows], angles[1][rows]
            parts.append((rows, _first_field(self.arrays[number], direction[rows], own, rotation[link[rows]])))
        field = np.empty((len(link), 1, 2), dtype=np.result_type(*(part.dtype for _, part in parts)))
        for rows, part in parts:
            field[rows] = part
        return field


def _first_field(
    array: PlanarArray, direction: np.ndarray, angles: tuple[np.ndarray, np.ndarray], rotation: np.ndarray
) -> np.ndarray:
    """Return the field of the first polarization of an array's elements on devices that are turned, [P, 1, 2]."""
    turn = rotation if is_level(array) else rotation @ array.rotation
    kind = array.pattern, array.polarization, array.polarization_model
    return antenna_field(direction, turn, *kind, angles)[:, :1]


@dataclass(frozen=True)
class LinkElements:
    """Elements at both ends of L links."""

    tx: EndElements
    rx: EndElements

    @property
    def is_uniform(self) -> bool:
        """True if all elements of both ends are equal, so that a link and its reverse have one coefficient."""
        first, *others = (*self.tx.arrays, *self.rx.arrays)
        return all(same_element(first, other) for other in others)

    def fields(
        self, geometry: PathGeometry, tx_rotation: np.ndarray, rx_rotation: np.ndarray, link: np.ndarray
    ) -> np.ndarray:
        """Return the far fields of transmitters and receivers, shape [P, 2, 2] (end, component).

        See `EndElements.field`.

        Args:
            geometry: The paths.
            tx_rotation: Device-to-world rotation of every link's transmitter, shape [L, 3, 3].
            rx_rotation: Device-to-world rotation of every link's receiver, shape [L, 3, 3].
            link: Link of each path, shape [P].
        """
        if len(link) and len(self.tx.arrays) == len(self.rx.arrays) == 1 and self.tx.arrays[0] is self.rx.arrays[0]:
            turns, angles = np.empty((len(link), 2, 3, 3)), geometry.angles.reshape(-1, 2)
            turns[:, 0], turns[:, 1] = tx_rotation.take(link, axis=0), rx_rotation.take(link, axis=0)
            given = geometry.ends.reshape(-1, 3), (angles[:, 0], angles[:, 1]), turns.reshape(-1, 3, 3)
            both = _first_field(self.tx.arrays[0], *given)
            return both.reshape(-1, 2, 2)
        departing, arriving = (geometry.theta_t, geometry.phi_t), (geometry.theta_r, geometry.phi_r)
        transmit = self.tx.field(geometry.departure, departing, tx_rotation, link)
        return np.concatenate([transmit, self.rx.field(geometry.arrival, arriving, rx_rotation, link)], axis=1)

    def take(self, rows: np.ndarray) -> "LinkElements":
        """Return those of some links."""
        return LinkElements(*(replace(end, index=end.index[rows]) for end in (self.tx, self.rx)))


def configured_array(antenna: AntennaConfig) -> PlanarArray:
    """Return the array of a configured antenna, in the axes of its mount."""
    return PlanarArray(**{name: getattr(antenna, name) for name in ROW_KEYS})


def configured_elements(config: ChannelConfig, links: Links) -> LinkElements:
    """Return the elements of the configured antennas at both ends of links."""
    arrays = _configured_arrays(config.antennas)
    return LinkElements(tx=EndElements(arrays, links.tx_antenna), rx=EndElements(arrays, links.rx_antenna))


@remembered(size=8)
def _configured_arrays(antennas: tuple[AntennaConfig, ...]) -> tuple[PlanarArray, ...]:
    return tuple(configured_array(antenna) for antenna in antennas)


def is_level(array: PlanarArray) -> bool:
    """Return whether the axes of an array are those of its device."""
    return not any(array.orientation[:3])


def same_element(one: PlanarArray, other: PlanarArray) -> bool:
    """Return whether two arrays are known to have equal elements: of own patterns only if they are one object."""
    if one is other:
        return True
    keys = ("pattern", "polarization", "polarization_model", "orientation")
    named = isinstance(one.pattern, str) and isinstance(other.pattern, str)
    return named and all(getattr(one, key) == getattr(other, key) for key in keys)
