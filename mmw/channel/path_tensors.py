"""Make channel tensors of the paths of a scene, over receivers, their antennas, transmitters and theirs."""

from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from mmw.channel import response
from mmw.channel.antennas.array_response import apply_arrays
from mmw.channel.antennas.arrays import PlanarArray
from mmw.channel.antennas.patterns import antenna_field
from mmw.channel.antennas.wavefronts import Wavefront
from mmw.channel.path_table import KEY_TYPE, CarrierPaths, first_segments
from mmw.core.errors import InputError
from mmw.physics.em.field import combine
from mmw.physics.em.vectors import unit_vector

if TYPE_CHECKING:
    from mmw.channel.scene_paths import Paths, RadioEnds


def subcarriers(count: int, spacing_hz: float, grid: Literal["centered", "fft"]) -> np.ndarray:
    """Return the baseband frequencies of OFDM subcarriers [Hz], see `subcarrier_frequencies`."""
    return response.subcarrier_frequencies(count, spacing_hz, grid)


def instants(count: int, rate_hz: float) -> np.ndarray:
    """Return the times of some instants, from 0 on [s], shape [count].

    Raises:
        InputError: If there is none, or the rate is not above 0.
    """
    if isinstance(count, bool) or int(count) != count or count < 1 or not 0.0 < rate_hz < np.inf:
        raise InputError(
            f"num_time_steps = {count}, sampling_frequency = {rate_hz:g}; at least one step and a rate above 0 Hz are "
            "needed; correct them"
        )
    return np.arange(int(count)) / rate_hz


def finite_numbers(name: str, values: ArrayLike) -> np.ndarray:
    """Return numbers as float64, shape [K].

    Raises:
        InputError: If one is not finite, or they have another shape.
    """
    numbers = np.atleast_1d(np.asarray(values, dtype=np.float64))
    if numbers.ndim != 1 or not np.isfinite(numbers).all():
        raise InputError(f"{name} of shape {np.shape(values)}: finite numbers of shape [K] are needed; correct them")
    return numbers


def carrier_paths(paths: "Paths", column: int) -> tuple[CarrierPaths, np.ndarray]:
    """Return paths at one carrier, sorted by link, and the row that each had.

    Links count pairs of receiver and transmitter; without synthetic arrays, pairs of their elements: receiver, its
    element, transmitter, its element, the last one fastest.
    """
    (rx_count, rx_elements), (tx_count, tx_elements) = (
        (len(side), 1 if paths.is_synthetic else _one(side, [array.element_count for array in side.arrays]))
        for side in (paths.receivers, paths.transmitters)
    )
    rx = paths.rx.astype(np.int64) * rx_elements + paths.rx_element
    link = (rx * tx_count + paths.tx) * tx_elements + paths.tx_element
    order = np.argsort(link, kind="stable")
    count = rx_count * rx_elements * tx_count * tx_elements
    keys = np.empty(count, dtype=KEY_TYPE)
    keys["scenario"], keys["weather"], keys["frame"] = paths.scenario, paths.weather, paths.frame
    keys["antenna"] = keys["peer_antenna"] = "antenna"
    if count:
        keys["agent"] = np.repeat(np.array(paths.rx_names, dtype=object), count // rx_count)
        peers = np.repeat(np.array(paths.tx_names, dtype=object), tx_elements)
        keys["peer"] = np.tile(peers, count // len(peers))
    return CarrierPaths(
        carrier_hz=float(paths.carriers_hz[column]),
        keys=keys,
        link=link[order],
        row=order,
        is_los=paths.is_los[order],
        tau=paths.tau[order],
        transfer=paths.transfer[order, column],
        a=paths.a[order, column],
        **{name: getattr(paths, name)[order] for name in ("theta_t", "phi_t", "theta_r", "phi_r")},
        doppler_hz=paths.doppler_hz[order, column],
        interaction=paths.interaction_types[order],
        vertex=paths.vertices[order],
        first_segment_m=first_segments(paths.tx_positions[paths.tx[order]], paths.vertices[order], paths.tau[order]),
        edge=paths.edges[order],
        curvature=paths.curvatures[order],
    ), order


def _one(side: "RadioEnds", counts: list[int]) -> int:
    """Return the antenna count that all devices of a side have, 1 if there is none."""
    if len(set(counts)) > 1:
        listed = ", ".join(f"{name} {count}" for name, count in zip(side.names, counts, strict=True))
        raise InputError(
            f"paths: the arrays of one side differ in their antennas ({listed}); a tensor needs equal counts; select "
            "devices with equal arrays"
        )
    return counts[0] if counts else 1


def _coefficients(paths: "Paths", column: int, wavefront: Wavefront) -> np.ndarray:
    """Return the coefficients between all antennas, shape [P, N_r, N_t]; of single elements over polarizations only."""
    at, order = carrier_paths(paths, column)
    tx, rx = paths.transmitters, paths.receivers
    if not paths.is_synthetic:
        return _element_coefficients(paths, at, order)
    shape = (len(at), *(_one(side, [array.antenna_count for array in side.arrays]) for side in (rx, tx)))
    pair_rx, pair_tx = np.divmod(np.arange(at.link_count), max(len(tx), 1))
    kinds: dict[tuple[int, int], list[int]] = {}
    for link, (r, t) in enumerate(zip(pair_rx, pair_tx, strict=True)):
        kinds.setdefault((id(rx.arrays[r]), id(tx.arrays[t])), []).append(link)
    if len(kinds) == 1:
        turns = tx.state.rotation[pair_tx], rx.state.rotation[pair_rx]
        return apply_arrays(at, tx.arrays[0], rx.arrays[0], at.carrier_hz, *turns, wavefront=wavefront)
    out = np.zeros(shape, dtype=np.complex128)
    for links in kinds.values():
        own, t, r = at.take(links), pair_tx[links], pair_rx[links]
        turns, arrays = (tx.state.rotation[t], rx.state.rotation[r]), (tx.arrays[t[0]], rx.arrays[r[0]])
        part = apply_arrays(own, *arrays, at.carrier_hz, *turns, wavefront=wavefront)
        out[np.isin(at.link, links)] = part
    return out


def _element_coefficients(paths: "Paths", at: CarrierPaths, order: np.ndarray) -> np.ndarray:
    """Return the coefficients between the polarizations of the elements that each path connects, [P, Q_r, Q_t]."""
    fields = []
    for side, index, theta, phi in (
        (paths.receivers, paths.rx[order], at.theta_r, at.phi_r),
        (paths.transmitters, paths.tx[order], at.theta_t, at.phi_t),
    ):
        polarizations = _one(side, [array.polarization_count for array in side.arrays])
        field = np.zeros((len(at), polarizations, 2), dtype=np.complex128)
        for number, array in enumerate(side.arrays):
            rows = np.flatnonzero(index == number)
            turn = np.broadcast_to(side.state.rotation[number] @ array.rotation, (len(rows), 3, 3))
            field[rows] = _field(array, unit_vector(theta[rows], phi[rows]), turn)
        fields.append(field)
    return combine(fields[0], at.transfer[:, None], fields[1])[:, 0]


def _field(array: PlanarArray, direction: np.ndarray, turn: np.ndarray) -> np.ndarray:
    return antenna_field(direction, turn, array.pattern, array.polarization, array.polarization_model)


def _to_tensor(paths: "Paths", values: np.ndarray) -> np.ndarray:
    """Return values of links, shape [L, q_r, q_t, ...], over [num_rx, num_rx_ant, num_tx, num_tx_ant, ...]."""
    tx, rx = paths.transmitters, paths.receivers
    rest = values.shape[3:]
    if paths.is_synthetic:
        shaped = values.reshape(len(rx), len(tx), *values.shape[1:])
        return np.moveaxis(shaped, 2, 1)
    rx_elements, tx_elements = (_one(side, [array.element_count for array in side.arrays]) for side in (rx, tx))
    shaped = values.reshape(len(rx), rx_elements, len(tx), tx_elements, *values.shape[1:])
    moved = np.moveaxis(shaped, (4, 5), (1, 4))  # antenna n = p M N + e: polarizations run slowest
    return moved.reshape(len(rx), values.shape[1] * rx_elements, len(tx), values.shape[2] * tx_elements, *rest)


def impulse_response(
    paths: "Paths", column: int, times: np.ndarray, normalize_delays: bool, wavefront: Wavefront
) -> tuple[np.ndarray, np.ndarray]:
    """Return gains and delays, see `Paths.cir`."""
    a, at = _coefficients(paths, column, wavefront), _delayed(paths, column, normalize_delays)
    gains, tau = response.impulse_response(a, at, at.carrier_hz, times)
    if paths.is_synthetic:
        return _to_tensor(paths, gains), tau.reshape(len(paths.receivers), len(paths.transmitters), -1)
    width = gains.shape[1:3]
    spread = np.broadcast_to(tau[:, None, None], (len(tau), *width, tau.shape[1]))
    return _to_tensor(paths, gains), _to_tensor(paths, spread)


def with_paths(a: np.ndarray, tau: np.ndarray, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Return gains and delays, see `Paths.cir`, with `count` paths: cut, or padded by gain 0 and delay -1.

    Raises:
        InputError: If the count is below 1.
    """
    if count < 1:
        raise InputError(f"num_paths = {count}; at least 1 is needed; correct it")
    short = max(count - tau.shape[-1], 0)
    a = np.pad(a, [(0, 0)] * 4 + [(0, short), (0, 0)])
    tau = np.pad(tau, [(0, 0)] * (tau.ndim - 1) + [(0, short)], constant_values=-1.0)
    return a[..., :count, :], tau[..., :count]


def frequency_response(
    paths: "Paths",
    column: int,
    frequencies: np.ndarray,
    times: np.ndarray,
    normalize_delays: bool,
    normalize: bool,
    wavefront: Wavefront,
) -> np.ndarray:
    """Return the frequency response, see `Paths.cfr`."""
    a, at = _coefficients(paths, column, wavefront), _delayed(paths, column, normalize_delays)
    values = response.frequency_response(a, at, frequencies, at.carrier_hz, times)
    h = _to_tensor(paths, values)
    if normalize:
        scale = np.sqrt(np.mean(np.abs(h) ** 2, axis=(1, 3, 4, 5), keepdims=True))
        h = h / np.where(scale > 0, scale, 1.0)
    return h


def discrete_taps(
    paths: "Paths",
    column: int,
    bandwidth_hz: float,
    l_min: int,
    l_max: int,
    times: np.ndarray,
    normalize_delays: bool,
    wavefront: Wavefront,
) -> np.ndarray:
    """Return the taps, see `Paths.taps`."""
    a, at = _coefficients(paths, column, wavefront), _delayed(paths, column, normalize_delays)
    return _to_tensor(paths, response.taps(a, at, bandwidth_hz, l_min, l_max, at.carrier_hz, times))


def _delayed(paths: "Paths", column: int, normalize_delays: bool) -> CarrierPaths:
    """Return paths whose delays count from the first path of each pair of devices, if so wanted."""
    at, _ = carrier_paths(paths, column)
    if not normalize_delays:
        return at
    pair = paths.rx[at.row].astype(np.int64) * len(paths.transmitters) + paths.tx[at.row]
    first = np.full(len(paths.receivers) * len(paths.transmitters), np.inf)
    np.minimum.at(first, pair, at.tau)
    return CarrierPaths(**{**vars(at), "tau": at.tau - first[pair]})
