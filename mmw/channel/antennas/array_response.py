"""Apply arrays to paths: the coefficient between every antenna of both ends, under plane or spherical waves.

    A_m[r, t] = F_r^T T_m F_t exp(+j 2 pi / lambda (k_t . d_t + k_r . d_r))       plane waves

with T_m the stored 2x2 transfer, F the element fields in the world's (theta, phi) basis, d the antennas' offsets from
the phase center, k_t the direction of departure and k_r the one from the receiver back along the path. Spherical waves
have exp(-j 2 pi / lambda (L_rt - L)) with the length L_rt of the path between the elements, see `wavefronts`. A_m is at
the carrier, and holds no carrier phase: the complex gain is A_m exp(-j 2 pi f_c tau_m).

Source: 3GPP TR 38.901, section 7.5, step 11 (fields, transfer, array phases); Sionna RT 2.2, synthetic arrays.
"""

from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from mmw.channel.antennas.arrays import ElementArray
from mmw.channel.antennas.patterns import antenna_field
from mmw.channel.antennas.spherical_response import ArrayEnd, spherical_response
from mmw.channel.antennas.wavefronts import MAX_PLANE_WAVE_ERROR_RAD, Wavefront, find_wavefronts
from mmw.channel.path_table import CarrierPaths, encode_key, read_column, read_numbers
from mmw.core.choices import check_choice
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.errors import InputError
from mmw.core.transforms import normalize, quaternion_to_matrix
from mmw.physics.em.vectors import unit_vector

POSE_COLUMNS = ("scenario", "weather", "frame", "agent", "qx", "qy", "qz", "qw")
"""Columns of table `poses` that `rotations_from_poses` needs."""


def apply_arrays(
    paths: CarrierPaths,
    tx_array: ElementArray,
    rx_array: ElementArray,
    carrier_hz: float,
    tx_rotation: ArrayLike | None = None,
    rx_rotation: ArrayLike | None = None,
    *,
    wavefront: Wavefront = "auto",
    max_plane_error_rad: float = MAX_PLANE_WAVE_ERROR_RAD,
) -> np.ndarray:
    """Return the coefficients A_m of every path between all antennas.

    Args:
        paths: CarrierPaths of L links.
        tx_array: Array of the transmitters (`peer`).
        rx_array: Array of the receivers (`agent`).
        carrier_hz: Carrier of the paths [Hz], given again because spacings in wavelengths depend on it.
        tx_rotation: Agent-to-world rotations of the transmitters, shape [L, 3, 3] or [3, 3]; None for agents whose axes
            are the world's. `rotations_from_poses` gives them.
        rx_rotation: The same for the receivers.
        wavefront: `plane` waves; `spherical` ones, whose phases are those of every element's own path; or `auto`:
            spherical for the paths whose plane wave could be wrong by more than `max_plane_error_rad`.
        max_plane_error_rad: That limit [rad]; pi / 8 is the Fraunhofer distance 2 D^2 / lambda.

    Returns:
        Voltage ratios without the carrier phase, shape [P, N_r, N_t], complex128: 16 P N_r N_t bytes. Process links
        in portions (`CarrierPaths.take`) where that is too much.

    Raises:
        InputError: If the carrier is not that of the paths, a rotation has another shape or is none, or a path needs
            spherical waves and its rows do not tell them (`WAVEFRONT_COLUMNS`), or its kind is not known.

    Examples:
        >>> import mmw
        >>> from mmw.channel import ula
        >>> paths = mmw.open_dataset("out/quickstart").paths(28e9, weather="sunny", frames=range(0, 1))
        >>> a = apply_arrays(paths, ula(64), ula(16), 28e9)
        >>> a.shape == (len(paths), 16, 64)
        True
    """
    if carrier_hz != paths.carrier_hz:
        raise InputError(
            f"apply_arrays: carrier_hz = {carrier_hz:g}, the paths are at {paths.carrier_hz:g} Hz; a transfer holds "
            "for one carrier; make CarrierPaths of the rows at the carrier that is wanted"
        )
    check_choice("apply_arrays: wavefront", wavefront, Wavefront)
    tx, rx = _End(paths, tx_array, tx_rotation, "tx"), _End(paths, rx_array, rx_rotation, "rx")
    element = np.einsum("pri,pij,ptj->prt", rx.field, paths.transfer, tx.field)
    shape = len(paths), rx_array.antenna_count, tx_array.antenna_count
    if wavefront == "plane" or not tx.elements.radius + rx.elements.radius > 0.0:
        return _plane(element, tx, rx).reshape(shape)
    waves = find_wavefronts(paths)
    error = waves.plane_wave_error(tx.elements.radius, rx.elements.radius, carrier_hz)
    is_spherical = error > (max_plane_error_rad if wavefront == "auto" else -1.0)
    if len(paths) and is_spherical.all():
        return spherical_response(element, waves, tx.elements, rx.elements, carrier_hz).reshape(shape)
    full, rows = _plane(element, tx, rx), np.flatnonzero(is_spherical)
    if len(rows):
        ends = tx.elements.take(rows), rx.elements.take(rows)
        full[rows] = spherical_response(element[rows], waves.take(rows), *ends, carrier_hz)
    return full.reshape(shape)


class _End:
    """Array of one end of all paths."""

    def __init__(
        self, paths: CarrierPaths, array: ElementArray, rotation: ArrayLike | None, end: Literal["tx", "rx"]
    ) -> None:
        turn = np.eye(3) if rotation is None else np.asarray(rotation, dtype=np.float64)
        if turn.shape not in ((3, 3), (paths.link_count, 3, 3)):
            raise InputError(
                f"apply_arrays: {end}_rotation has shape {turn.shape}; it is [3, 3], or [L, 3, 3] with L = "
                f"{paths.link_count} links"
            )
        if np.abs(turn @ np.swapaxes(turn, -1, -2) - np.eye(3)).max(initial=0.0) > 1e-6:
            raise InputError(
                f"apply_arrays: {end}_rotation holds a matrix that is no rotation; its rows must be orthonormal"
            )
        turn = np.broadcast_to(turn, (paths.link_count, 3, 3))[paths.link]
        angles = (paths.theta_t, paths.phi_t) if end == "tx" else (paths.theta_r, paths.phi_r)
        self._carrier_hz, self._direction = paths.carrier_hz, unit_vector(*angles)
        kind = array.pattern, array.polarization, array.polarization_model
        self.field = antenna_field(self._direction, turn @ array.rotation, *kind)
        """Element fields, shape [P, polarizations, 2]."""
        self.elements = ArrayEnd(array.element_positions(paths.carrier_hz)[: array.element_count], turn)

    def plane_phase(self) -> np.ndarray:
        """Return the phasors of the elements under plane waves, shape [P, elements]."""
        local = np.einsum("pji,pj->pi", self.elements.turn, self._direction)
        return np.exp(2j * np.pi * self._carrier_hz / SPEED_OF_LIGHT * (local @ self.elements.offset.T))


def _plane(element: np.ndarray, tx: _End, rx: _End) -> np.ndarray:
    """Return coefficients under plane waves, shape [P, polarizations, N_r, polarizations, N_t]."""
    tx_phase, rx_phase = tx.plane_phase(), rx.plane_phase()
    return element[:, :, None, :, None] * rx_phase[:, None, :, None, None] * tx_phase[:, None, None, None, :]


def rotations_from_poses(poses: Any, paths: CarrierPaths, which: Literal["tx", "rx"]) -> np.ndarray:
    """Return the agent-to-world rotation of one end of every link, shape [L, 3, 3].

    Args:
        poses: Rows of table `poses` with at least `POSE_COLUMNS`: a pyarrow Table, a pandas DataFrame or a mapping.
        paths: CarrierPaths whose links are looked up by scenario, weather, frame and agent.
        which: `tx` for the transmitters (`peer`), `rx` for the receivers (`agent`).

    Raises:
        InputError: If a column is missing, an agent has two poses in a frame, or the pose of a link's end is not there.

    Examples:
        >>> import mmw
        >>> data, frames = mmw.open_dataset("out/quickstart"), range(0, 1)
        >>> paths = data.paths(28e9, weather="sunny", frames=frames)
        >>> rotations_from_poses(data.read("poses", weather="sunny", frames=frames), paths, "tx").shape
        (3, 3, 3)
    """
    if which not in ("tx", "rx"):
        raise InputError(f"rotations_from_poses: which = {which!r}; it is tx or rx")
    count, codes = paths.link_count, np.zeros(0)
    for name in POSE_COLUMNS[:4]:
        key = "peer" if which == "tx" and name == "agent" else name
        column = read_column(poses, "poses", name, POSE_COLUMNS)
        code, values = encode_key(name, [column, read_column({key: paths.keys[key]}, "keys", key, (key,))])
        codes = np.unique(codes * len(values) + code, return_inverse=True)[1] if len(codes) else code
    known, wanted = codes[: len(codes) - count], codes[len(codes) - count :]
    order = np.argsort(known, kind="stable")
    twice = np.flatnonzero(np.diff(known[order]) == 0)
    if len(twice):
        raise InputError(f"table poses: rows {order[twice[0]]} and {order[twice[0] + 1]} are one agent in one frame")
    index = np.searchsorted(known, wanted, sorter=order)
    row = order[np.minimum(index, len(known) - 1)] if len(known) else np.zeros(count, dtype=np.int64)
    is_there = known[row] == wanted if len(known) else np.zeros(count, dtype=bool)
    if not is_there.all():
        lost = paths.keys[~is_there][0]
        agent = lost["peer"] if which == "tx" else lost["agent"]
        raise InputError(
            f"table poses: {int((~is_there).sum())} links have no pose of their {which}, the first {agent} in scenario "
            f"{lost['scenario']}, weather {lost['weather']}, frame {lost['frame']}; read poses of the same frames"
        )
    parts = [read_numbers(name, read_column(poses, "poses", name, POSE_COLUMNS))[row] for name in POSE_COLUMNS[4:]]
    return quaternion_to_matrix(normalize(np.stack(parts, axis=-1)))


def plane_wave_error(
    array: ElementArray, distance_m: ArrayLike, carrier_hz: float, other: ElementArray | None = None
) -> np.ndarray:
    """Return the largest phase error of the plane-wave model over an array [rad], shape of `distance_m`.

    A point source at distance r is sqrt(r^2 - 2 r k . d + d^2) away from an element at offset d, and r - k . d for a
    plane wave. The difference is never below 0, and largest, d^2 / (2 r), in the direction with k . d = d^2 / (2 r).
    With |d| <= D / 2 the phase is off by pi D^2 / (4 lambda r) at most: pi / 8 at the Fraunhofer distance 2 D^2 /
    lambda. With arrays at both ends the difference of their offsets counts, and D is the sum of both apertures. The
    common phase is exact: it comes from the delay between the phase centers.

    Args:
        array: Array of one end.
        distance_m: Length of the path [m]; of a reflected one its whole length, as a flat surface only mirrors it.
        carrier_hz: Carrier [Hz].
        other: Array of the other end; None for a single antenna there.

    Raises:
        InputError: If a distance is not above 0.

    Source: C. A. Balanis, Antenna Theory, section 4.4 (far-field region).

    Examples:
        >>> from mmw.channel import ula
        >>> plane_wave_error(ula(64), [10.0, 100.0], 28e9).round(2).tolist()
        [0.83, 0.08]
    """
    distance = np.asarray(distance_m, dtype=np.float64)
    if (~(distance > 0)).any():
        raise InputError(f"plane_wave_error: distance_m holds {distance.min():g}; distances are above 0 m")
    aperture = array.aperture_m(carrier_hz) + (other.aperture_m(carrier_hz) if other else 0.0)
    return np.pi * aperture**2 * carrier_hz / (4 * SPEED_OF_LIGHT * distance)
