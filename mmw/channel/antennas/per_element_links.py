"""Expand links of arrays to a link for every pair of elements, for exact tracing."""

from dataclasses import replace

import numpy as np

from mmw.channel.antennas.arrays import ElementArray
from mmw.channel.links import Links
from mmw.physics.em.vectors import rotate
from mmw.scene.mounted_antennas import RadioDevices


def per_element_links(
    links: Links, tx_array: ElementArray, rx_array: ElementArray, carrier_hz: float
) -> tuple[Links, np.ndarray, np.ndarray, np.ndarray]:
    """Return links between all pairs of elements of two arrays, to be traced one by one.

    Near an array the waves are spheres, and obstacles and reflections differ from element to element; this traces all
    of it, at N_t N_r times the cost. `mmw.channel.apply_arrays` makes the same from one trace for far paths.

    Args:
        links: Links between the phase centers.
        tx_array: Array of every transmitter, in the agent's frame.
        rx_array: Array of every receiver.
        carrier_hz: Carrier that the spacing in wavelengths is for [Hz].

    Returns:
        The links, L x N_r x N_t rows (transmitter elements run fastest); and for each the row of `links`, the receiver
        element and the transmitter element, shape [L N_r N_t] each. Elements count as in the arrays, without
        polarizations. The rotations of the ends are those of the arrays.
    """
    tx_count, rx_count = tx_array.element_count, rx_array.element_count
    link, rx_element, tx_element = (
        index.ravel() for index in np.indices((len(links), rx_count, tx_count)).astype(np.int32)
    )

    def ends(side: RadioDevices, array: ElementArray, element: np.ndarray) -> RadioDevices:
        offset = array.element_positions(carrier_hz)[: array.element_count]
        moved = rotate(side.rotation[link], offset[element])
        return RadioDevices(side.position[link] + moved, side.rotation[link] @ array.rotation, side.velocity[link])

    tx, rx = ends(links.tx, tx_array, tx_element), ends(links.rx, rx_array, rx_element)
    return replace(links.take(link), tx=tx, rx=rx), link, rx_element, tx_element
