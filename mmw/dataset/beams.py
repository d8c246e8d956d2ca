"""Search the best pairs of beams of links, and give the search and frequency responses to SQL."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
import pyarrow as pa

from mmw.channel.antennas.array_response import apply_arrays
from mmw.channel.antennas.arrays import PlanarArray, ula
from mmw.channel.antennas.wavefronts import Wavefront
from mmw.channel.codebook import BeamPairs, beam_gains, best_beams, dft_codebook
from mmw.channel.path_table import KEY_TYPE, CarrierPaths, padded_lists
from mmw.channel.response import frequency_response, subcarrier_frequencies
from mmw.core.constants import SPEED_OF_LIGHT
from mmw.core.transforms import normalize, quaternion_to_matrix

PORTION = 256
"""Links searched at once: array responses of 16 x 64 antennas and 5 paths are 21 MB. Design value."""


@dataclass(frozen=True)
class BeamSearch:
    """Settings of an exhaustive beam search; by default those of the Multimodal-Wireless paper.

    H is averaged over the subcarriers, as in the paper, with the first path of each link at delay 0, as in its files: a
    receiver is synchronised. With the time of flight in H, subcarriers would cancel in the average.

    Examples:
        >>> import mmw
        >>> from mmw.channel import ula
        >>> search = BeamSearch(tx_array=ula(32), rx_array=ula(4), tx_beams=32, rx_beams=8, subcarriers=64)
        >>> beams = mmw.connect("out/quickstart", search=search)
        >>> beams.sql("SELECT count(*) FROM beams WHERE frame = 0 AND weather = 'sunny'").fetchall()
        [(6,)]
    """

    tx_array: PlanarArray = field(default_factory=lambda: ula(64))
    """Array of the transmitter (`peer`), on its agent."""
    rx_array: PlanarArray = field(default_factory=lambda: ula(16))
    """Array of the receiver (`agent`), on its agent."""
    tx_beams: int | tuple[int, int] = 64
    """Beams of the transmitter's DFT codebook, see `dft_codebook`."""
    rx_beams: int | tuple[int, int] = 64
    """Beams of the receiver's DFT codebook."""
    subcarriers: int = 1024
    """Subcarriers that H is averaged over."""
    spacing_hz: float = 120e3
    """Distance between subcarriers [Hz]."""
    wavefront: Wavefront = "auto"
    """Waves over the arrays, see `mmw.channel.apply_arrays`."""

    @cached_property
    def codebooks(self) -> tuple[np.ndarray, np.ndarray]:
        """Precoders and combiners as columns, shapes [N_t, Q_t] and [N_r, Q_r]."""
        return dft_codebook(self.tx_array, self.tx_beams), dft_codebook(self.rx_array, self.rx_beams)

    def best(self, paths: CarrierPaths, tx_rotation: np.ndarray, rx_rotation: np.ndarray) -> BeamPairs:
        """Return the best pair of every link.

        Args:
            paths: Paths of L links at one carrier.
            tx_rotation: Agent-to-world rotations of the transmitters, shape [L, 3, 3].
            rx_rotation: The same for the receivers.
        """
        tx_book, rx_book = self.codebooks
        frequencies = subcarrier_frequencies(self.subcarriers, self.spacing_hz)
        found = []
        for first in range(0, paths.link_count, PORTION):
            links = np.arange(first, min(first + PORTION, paths.link_count))
            part, carrier = paths.take(links), paths.carrier_hz
            ends = self.tx_array, self.rx_array, carrier, tx_rotation[links], rx_rotation[links]
            a = apply_arrays(part, *ends, wavefront=self.wavefront)
            h = frequency_response(a, part, frequencies, carrier, average=True, normalize_delays=True)
            found.append(best_beams(beam_gains(h, tx_book, rx_book)))
        names = ("rx_beam", "tx_beam", "gain")
        empty = BeamPairs(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0))
        return BeamPairs(*(np.concatenate([getattr(part, name) for part in [empty, *found]]) for name in names))

    def sql(
        self,
        tau_s: pa.ChunkedArray,
        transfer: pa.ChunkedArray,
        angles: pa.ChunkedArray,
        interactions: pa.ChunkedArray,
        vertices: pa.ChunkedArray,
        first_segment_m: pa.ChunkedArray,
        edges: pa.ChunkedArray,
        curvatures: pa.ChunkedArray,
        tx_rotation: pa.ChunkedArray,
        rx_rotation: pa.ChunkedArray,
        carrier_hz: pa.ChunkedArray,
    ) -> pa.StructArray:
        """Return rx_beam, tx_beam (-1 without path) and gain of each row, for DuckDB.

        Args:
            tau_s: Delays of the row's paths [s].
            transfer: Eight numbers a path: real and imaginary part of tt, tp, pt, pp.
            angles: Four numbers a path: azimuth and zenith of departure, then of arrival [rad].
            interactions: Interactions of each path, a list a path.
            vertices: Three numbers for each of them [m], a list a path.
            first_segment_m: Lengths to the first vertex [m].
            edges: Unit vector along the edge of each path, a list a path, empty without an edge.
            curvatures: Six numbers of the curved surface of each path [1/m], a list a path, empty without one.
            tx_rotation: Quaternion x, y, z, w of the transmitting agent.
            rx_rotation: Quaternion of the receiving agent.
            carrier_hz: Carrier [Hz].
        """
        carriers = carrier_hz.to_numpy()
        link, tau = flat_lists(tau_s)
        t = flat_lists(transfer)[1].reshape(-1, 8)
        angle = flat_lists(angles)[1].reshape(-1, 4)
        geometry = {
            "interaction": np.nan_to_num(nested_lists(interactions, 1)[..., 0], nan=0.0).astype(np.int8),
            "vertex": nested_lists(vertices, 3),
            "first_segment_m": flat_lists(first_segment_m)[1],
            **{
                name: np.pad(nested_lists(column, width), ((0, 0), (0, 1), (0, 0)), constant_values=np.nan)[:, 0]
                for name, column, width in (("edge", edges, 3), ("curvature", curvatures, 6))
            },
        }
        turns = [
            quaternion_to_matrix(normalize(flat_lists(turn)[1].reshape(-1, 4))) for turn in (tx_rotation, rx_rotation)
        ]
        rx_beam, tx_beam, gain = np.full(len(carriers), -1), np.full(len(carriers), -1), np.zeros(len(carriers))
        for carrier in np.unique(carriers):
            rows = np.flatnonzero(carriers == carrier)
            path = np.flatnonzero(carriers[link] == carrier)
            own = np.searchsorted(rows, link[path])
            own_geometry = {name: values[path] for name, values in geometry.items()}
            one = plain_paths(float(carrier), len(rows), own, tau[path], t[path], angle[path], **own_geometry)
            pairs = self.best(one, turns[0][rows], turns[1][rows])
            rx_beam[rows], tx_beam[rows], gain[rows] = pairs.rx_beam, pairs.tx_beam, pairs.gain
        columns = [pa.array(rx_beam, pa.int32()), pa.array(tx_beam, pa.int32()), pa.array(gain)]
        return pa.StructArray.from_arrays(columns, names=["rx_beam", "tx_beam", "gain"])


def flat_lists(column: pa.ChunkedArray) -> tuple[np.ndarray, np.ndarray]:
    """Return the row of each element of a list column, shape [n], int64, and the elements, shape [n], float64."""
    array = column.combine_chunks()
    if isinstance(array, pa.ChunkedArray):  # no chunk at all
        return np.zeros(0, dtype=np.int64), np.zeros(0)
    lengths = np.diff(array.offsets.to_numpy())
    return np.repeat(np.arange(len(array)), lengths), array.flatten().to_numpy().astype(np.float64, copy=False)


def nested_lists(column: pa.ChunkedArray, width: int) -> np.ndarray:
    """Return the elements of lists in a list column in groups of `width`, NaN behind the last, [lists, most, width]."""
    array = column.combine_chunks()
    if isinstance(array, pa.ChunkedArray):  # no chunk at all
        return np.zeros((0, 0, width))
    return padded_lists(array.flatten(), width)


def plain_paths(
    carrier_hz: float,
    links: int,
    link: np.ndarray,
    tau: np.ndarray,
    t: np.ndarray,
    angle: np.ndarray,
    *,
    interaction: np.ndarray | None = None,
    vertex: np.ndarray | None = None,
    first_segment_m: np.ndarray | None = None,
    edge: np.ndarray | None = None,
    curvature: np.ndarray | None = None,
) -> CarrierPaths:
    """Return paths without names of links, coefficients and Doppler shifts.

    Args:
        carrier_hz: Carrier [Hz].
        links: Number of links L.
        link: Link of each path, growing, shape [P].
        tau: Delays [s], shape [P].
        t: Real and imaginary part of tt, tp, pt, pp, shape [P, 8].
        angle: Azimuth and zenith of departure and of arrival [rad], shape [P, 4].
        interaction: As in `CarrierPaths`; None for lines of sight.
        vertex: As in `CarrierPaths`; given with the interactions, as are the next ones.
        first_segment_m: As in `CarrierPaths`.
        edge: As in `CarrierPaths`.
        curvature: As in `CarrierPaths`.
    """
    count = len(tau)
    return CarrierPaths(
        carrier_hz=carrier_hz,
        keys=np.empty(links, dtype=KEY_TYPE),
        link=link.astype(np.int64),
        row=np.arange(count),
        is_los=np.zeros(count, dtype=bool),
        tau=tau,
        transfer=(t[:, 0::2] + 1j * t[:, 1::2]).reshape(-1, 2, 2),
        a=np.zeros(count, dtype=np.complex128),
        theta_t=angle[:, 1],
        phi_t=angle[:, 0],
        theta_r=angle[:, 3],
        phi_r=angle[:, 2],
        doppler_hz=np.zeros(count),
        interaction=np.zeros((count, 0), dtype=np.int8) if interaction is None else interaction,
        vertex=np.zeros((count, 0, 3)) if vertex is None else vertex,
        first_segment_m=SPEED_OF_LIGHT * tau if first_segment_m is None else first_segment_m,
        edge=np.full((count, 3), np.nan) if edge is None else edge,
        curvature=np.full((count, 6), np.nan) if curvature is None else curvature,
    )


def csi_sql(
    tau_s: pa.ChunkedArray,
    a_re: pa.ChunkedArray,
    a_im: pa.ChunkedArray,
    carrier_hz: pa.ChunkedArray,
    frequencies_hz: pa.ChunkedArray,
) -> pa.StructArray:
    """Return H(f_k) between the configured single antennas of each row as lists `re` and `im`, for DuckDB.

    Args:
        tau_s: Delays of the row's paths [s].
        a_re: Real parts of their coefficients.
        a_im: Imaginary parts.
        carrier_hz: Carrier [Hz].
        frequencies_hz: Frequencies counted from the carrier [Hz].
    """
    carriers = carrier_hz.to_numpy()
    link, tau = flat_lists(tau_s)
    a = flat_lists(a_re)[1] + 1j * flat_lists(a_im)[1]
    wanted = [tuple(row) for row in frequencies_hz.to_pylist()]
    kinds = list(dict.fromkeys(zip(carriers.tolist(), wanted, strict=True)))
    kind = np.array([kinds.index(key) for key in zip(carriers.tolist(), wanted, strict=True)], dtype=np.int64)
    found: list[np.ndarray] = [np.zeros(0, dtype=np.complex128)] * len(carriers)
    for number, (carrier, frequencies) in enumerate(kinds):
        rows = np.flatnonzero(kind == number)
        path = np.flatnonzero(kind[link] == number)
        own, zeros = np.searchsorted(rows, link[path]), np.zeros((len(path), 8))
        paths = plain_paths(carrier, len(rows), own, tau[path], zeros, zeros[:, :4])
        h = frequency_response(a[path, None, None], paths, np.array(frequencies), carrier)[:, 0, 0]
        for row, values in zip(rows, h, strict=True):
            found[row] = values
    type_ = pa.list_(pa.float64())
    columns = [pa.array([getattr(h, part) for h in found], type_) for part in ("real", "imag")]
    return pa.StructArray.from_arrays(columns, names=["re", "im"])
