"""Hold the propagation paths between the transmitters and receivers of a scene, and make channels of them.

The complex gain of path m at frequency f is a_m exp(-j 2 pi f tau_m): `a` holds no carrier phase, `tau` is absolute.
Channels are tensors over [receiver, its antennas, transmitter, its antennas, ...], the axis order of Sionna RT.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import pyarrow as pa
from numpy.typing import ArrayLike

from mmw.channel import path_tensors as tensors
from mmw.channel.antennas.wavefronts import Wavefront
from mmw.channel.links import Links
from mmw.channel.path_arrays import PATH_FIELDS, PathArrays
from mmw.channel.path_table import CarrierPaths
from mmw.channel.path_view import join_paths
from mmw.channel.paths import LOSSES, PATH_KINDS, PathSet
from mmw.channel.rows import path_gain_rows, path_geometry_rows
from mmw.core.errors import InputError
from mmw.core.extras import needed_by
from mmw.core.registry import load_reference
from mmw.storage.arrow_tables import table_from_columns

if TYPE_CHECKING:
    import pandas as pd
    import torch

CYCLIC_PREFIX = 1.0 / 14.0
"""Mean cyclic prefix of an OFDM symbol in parts of its useful time: 14 symbols fill 15 useful times. Source: 3GPP TS
38.211, sections 4.3.2 and 5.3.1, normal cyclic prefix."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Paths(PathArrays):
    """Paths of all pairs of R receivers and T transmitters in one weather, at C carriers; P paths in all.

    Rows are sorted by receiver, transmitter, number of interactions, their kinds and surfaces, until they are sorted
    otherwise. A pair may have no path. The fields are arrays, see `PathArrays`.

    Examples:
        >>> import mmw
        >>> scene = mmw.load_scene("town03")
        >>> transmitter = scene.add(mmw.Transmitter("bs", position=(13.5, -29.5, 10.0)))
        >>> receiver = scene.add(mmw.Receiver("ue", position=(-2.0, 45.0, 1.5)))
        >>> paths = mmw.PathSolver(max_depth=2)(scene, carriers_hz=[4.9e9, 28e9])
        >>> strongest = paths.sort_by_gain(28e9)[:2]
        >>> strongest.kind.tolist(), (strongest.tau * 1e9).round().tolist()  # nanoseconds
        (['los', 'specular'], [255.0, 257.0])
    """

    def __len__(self) -> int:
        return len(self.tau)

    def __repr__(self) -> str:
        carriers = ", ".join(f"{carrier / 1e9:g}" for carrier in self.carriers_hz)
        return (
            f"<{len(self)} paths of {len(self.receivers)} receivers and {len(self.transmitters)} transmitters at "
            f"{carriers} GHz, {self.weather}, frame {self.frame}>"
        )

    def __getitem__(self, rows: Any) -> "Paths":
        """Return some of the paths, by a slice, a mask or indices; transmitters and receivers stay."""
        index = np.arange(len(self))[rows]
        return self._take(np.atleast_1d(index))

    # --- choosing -----------------------------------------------------------------------------------------------------

    def select(
        self,
        *,
        rx: str | Sequence[str] | None = None,
        tx: str | Sequence[str] | None = None,
        kind: str | Sequence[str] | None = None,
        min_gain_db: float | None = None,
    ) -> "Paths":
        """Return the paths of some receivers, transmitters and kinds; other receivers and transmitters leave too.

        Args:
            rx: Name of a receiver, or several; None for all.
            tx: Name of a transmitter, or several; None for all.
            kind: `los`, `specular`, `transmission`, `diffuse` or `diffraction`, or several; None for all.
            min_gain_db: Least gain at any carrier [dB]; None for any.

        Raises:
            InputError: If a name is not known.
        """
        rx_rows, tx_rows = self.receivers.rows(rx, "receiver"), self.transmitters.rows(tx, "transmitter")
        keep = np.isin(self.rx, rx_rows) & np.isin(self.tx, tx_rows)
        if kind is not None:
            wanted = [kind] if isinstance(kind, str) else list(kind)
            if unknown := [name for name in wanted if name not in PATH_KINDS]:
                raise InputError(f"select: kind = {unknown[0]!r}; there are {', '.join(PATH_KINDS)}; name some of them")
            keep &= np.isin(self.kind_id, [PATH_KINDS.index(name) for name in wanted])
        if min_gain_db is not None:
            keep &= (self.gain_db >= min_gain_db).any(axis=1)
        found, number = self._take(np.flatnonzero(keep)), np.full(max(len(self.receivers), len(self.transmitters)), -1)
        number[rx_rows] = np.arange(len(rx_rows))
        rx_index = number[found.rx].astype(np.int32)
        number[tx_rows] = np.arange(len(tx_rows))
        return replace(
            found,
            rx=rx_index,
            tx=number[found.tx].astype(np.int32),
            receivers=self.receivers.take(rx_rows),
            transmitters=self.transmitters.take(tx_rows),
        )

    def sort_by_gain(self, carrier_hz: float | None = None) -> "Paths":
        """Return the paths in the order of their gains at a carrier, the strongest first.

        Raises:
            InputError: If there are several carriers and none is named, or it is not one of them.
        """
        gain = np.abs(self.a[:, self._column(carrier_hz)])
        return self._take(np.argsort(-gain, kind="stable"))

    def _take(self, rows: np.ndarray) -> "Paths":
        columns = {field.name: getattr(self, field.name)[rows] for field in fields(self) if field.name in PATH_FIELDS}
        return replace(self, **columns)

    def _column(self, carrier_hz: float | None) -> int:
        """Return the index of a carrier; of the only one for None."""
        if carrier_hz is None and len(self.carriers_hz) == 1:
            return 0
        found = np.flatnonzero(self.carriers_hz == carrier_hz)
        if not len(found):
            known = ", ".join(f"{carrier:g}" for carrier in self.carriers_hz)
            given = "carrier_hz is missing" if carrier_hz is None else f"carrier_hz = {carrier_hz:g}"
            raise InputError(f"paths: {given}; they have {known} Hz; name one of these")
        return int(found[0])

    # --- channels -----------------------------------------------------------------------------------------------------

    def cir(
        self,
        *,
        carrier_hz: float | None = None,
        num_time_steps: int = 1,
        sampling_frequency: float = 1.0,
        num_paths: int | None = None,
        normalize_delays: bool = False,
        wavefront: Wavefront = "auto",
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the channel impulse response: complex gains with the carrier phase, and delays.

        Args:
            carrier_hz: Carrier [Hz]; None for the only one.
            num_time_steps: Instants, 1 / `sampling_frequency` apart, over which phases turn by the Doppler shifts.
            sampling_frequency: Rate of the instants [Hz].
            num_paths: Paths of each pair in the result: the first ones, or all and padding. None is the most of any.
            normalize_delays: Count delays from the first path of each pair; Sionna RT does by default, mmw does not.
            wavefront: Waves over arrays, see `mmw.channel.apply_arrays`; Sionna RT's synthetic arrays have `plane`.

        Returns:
            a: Shape [num_rx, num_rx_ant, num_tx, num_tx_ant, num_paths, num_time_steps], complex128.
            tau: Delays [s], shape [num_rx, num_tx, num_paths], or [num_rx, num_rx_ant, num_tx, num_tx_ant, num_paths]
                without synthetic arrays. Behind the last path of a pair `a` is 0 and `tau` -1, as in Sionna RT.

        Raises:
            InputError: If the carrier is not one of the paths', or arrays of one side have different antenna counts.

        Examples:
            >>> import mmw
            >>> scene = mmw.load_scene("town03")
            >>> transmitter = scene.add(mmw.Transmitter("bs", position=(13.5, -29.5, 10.0)))
            >>> receiver = scene.add(mmw.Receiver("ue", position=(-2.0, 45.0, 1.5)))
            >>> paths = mmw.PathSolver(max_depth=2)(scene, carriers_hz=[4.9e9, 28e9])
            >>> a, tau = paths.cir(carrier_hz=28e9)
            >>> a.shape[:4], a.shape[4] == tau.shape[2] == len(paths)
            ((1, 1, 1, 1), True)
        """
        times = tensors.instants(num_time_steps, sampling_frequency)
        a, tau = tensors.impulse_response(self, self._column(carrier_hz), times, normalize_delays, wavefront)
        return (a, tau) if num_paths is None else tensors.with_paths(a, tau, num_paths)

    def cfr(
        self,
        frequencies_hz: ArrayLike,
        *,
        carrier_hz: float | None = None,
        num_time_steps: int = 1,
        sampling_frequency: float = 1.0,
        normalize_delays: bool = False,
        normalize: bool = False,
        wavefront: Wavefront = "auto",
    ) -> np.ndarray:
        """Return the channel frequency response H(f) = sum_m a_m exp(-j 2 pi (f_c + f) tau_m).

        Args:
            frequencies_hz: Baseband frequencies f, counted from the carrier [Hz], shape [F].
            carrier_hz: Carrier f_c [Hz]; None for the only one.
            num_time_steps: Instants, 1 / `sampling_frequency` apart, over which phases turn by the Doppler shifts.
            sampling_frequency: Rate of the instants [Hz].
            normalize_delays: Count delays from the first path of each pair; Sionna RT does by default, mmw does not.
            wavefront: Waves over arrays, see `mmw.channel.apply_arrays`; Sionna RT's synthetic arrays have `plane`.
            normalize: Divide each pair by the root mean square of |H| over its antennas, instants and frequencies.

        Returns:
            Shape [num_rx, num_rx_ant, num_tx, num_tx_ant, num_time_steps, num_frequencies], complex128.

        Raises:
            InputError: If the carrier is not one of the paths', or arrays of one side have different antenna counts.

        Examples:
            >>> import mmw
            >>> scene = mmw.load_scene("town03")
            >>> transmitter = scene.add(mmw.Transmitter("bs", position=(13.5, -29.5, 10.0)))
            >>> receiver = scene.add(mmw.Receiver("ue", position=(-2.0, 45.0, 1.5)))
            >>> paths = mmw.PathSolver(max_depth=2)(scene, carriers_hz=[4.9e9, 28e9])
            >>> h = paths.cfr(mmw.channel.subcarrier_frequencies(64, 120e3), carrier_hz=28e9)
            >>> h.shape
            (1, 1, 1, 1, 1, 64)
        """
        times = tensors.instants(num_time_steps, sampling_frequency)
        frequencies = tensors.finite_numbers("frequencies_hz", frequencies_hz)
        return tensors.frequency_response(
            self, self._column(carrier_hz), frequencies, times, normalize_delays, normalize, wavefront
        )

    def taps(
        self,
        bandwidth_hz: float,
        *,
        l_min: int = -6,
        l_max: int,
        carrier_hz: float | None = None,
        num_time_steps: int = 1,
        sampling_frequency: float | None = None,
        normalize_delays: bool = False,
        wavefront: Wavefront = "auto",
    ) -> np.ndarray:
        """Return the taps of the discrete baseband channel, h_l = sum_m a_m sinc(l - W tau_m).

        Args:
            bandwidth_hz: Bandwidth W, the rate of the taps [Hz].
            l_min: First tap; below 0, because a sinc starts before its path.
            l_max: Last tap. With absolute delays it must reach beyond W tau of the last path.
            carrier_hz: Carrier [Hz]; None for the only one.
            num_time_steps: Instants over which phases turn by the Doppler shifts.
            sampling_frequency: Rate of the instants [Hz]; the bandwidth for None.
            normalize_delays: Count delays from the first path of each pair.
            wavefront: Waves over arrays, see `mmw.channel.apply_arrays`.

        Returns:
            Shape [num_rx, num_rx_ant, num_tx, num_tx_ant, num_time_steps, l_max - l_min + 1], complex128.

        Raises:
            InputError: If l_max is below l_min, the bandwidth is not above 0, or the carrier is not one of the paths'.
        """
        times = tensors.instants(num_time_steps, sampling_frequency or bandwidth_hz)
        column = self._column(carrier_hz)
        return tensors.discrete_taps(self, column, bandwidth_hz, l_min, l_max, times, normalize_delays, wavefront)

    def ofdm(
        self,
        num_subcarriers: int,
        subcarrier_spacing_hz: float,
        *,
        num_symbols: int = 14,
        carrier_hz: float | None = None,
        grid: Literal["centered", "fft"] = "fft",
        cyclic_prefix: float = CYCLIC_PREFIX,
        normalize_delays: bool = False,
        normalize: bool = False,
        wavefront: Wavefront = "auto",
    ) -> np.ndarray:
        """Return the frequency response on a grid of OFDM symbols and subcarriers.

        Args:
            num_subcarriers: Number of subcarriers.
            subcarrier_spacing_hz: Their spacing [Hz].
            num_symbols: Number of symbols; each is taken at one instant.
            carrier_hz: Carrier [Hz]; None for the only one.
            grid: Place of the subcarriers, see `mmw.channel.subcarrier_frequencies`.
            cyclic_prefix: Cyclic prefix in parts of the useful time of a symbol [-].
            normalize_delays: Count delays from the first path of each pair.
            normalize: Divide each pair by the root mean square of |H|.
            wavefront: Waves over arrays, see `mmw.channel.apply_arrays`.

        Returns:
            Shape [num_rx, num_rx_ant, num_tx, num_tx_ant, num_symbols, num_subcarriers], complex128.

        Raises:
            InputError: If a number is not above 0, or the carrier is not one of the paths'.
        """
        if not subcarrier_spacing_hz > 0 or not cyclic_prefix >= 0:
            raise InputError(
                f"ofdm: subcarrier_spacing_hz = {subcarrier_spacing_hz:g}, cyclic_prefix = {cyclic_prefix:g}; a "
                "spacing above 0 and a prefix of 0 or more are needed; correct them"
            )
        frequencies = tensors.subcarriers(num_subcarriers, subcarrier_spacing_hz, grid)
        return self.cfr(
            frequencies, carrier_hz=carrier_hz, num_time_steps=num_symbols,
            sampling_frequency=subcarrier_spacing_hz / (1.0 + cyclic_prefix), normalize_delays=normalize_delays,
            normalize=normalize, wavefront=wavefront,
        )  # fmt: skip

    def at_carrier(self, carrier_hz: float | None = None) -> CarrierPaths:
        """Return the paths at one carrier, as tables of a dataset give them, for `mmw.channel` and its statistics.

        Links count all pairs, receiver by receiver: link = rx num_tx + tx.

        Raises:
            InputError: If the carrier is not one of the paths'.
        """
        return tensors.carrier_paths(self, self._column(carrier_hz))[0]

    # --- output -------------------------------------------------------------------------------------------------------

    def to_table(self) -> pa.Table:
        """Return the rows of the view `paths` that a dataset has of these paths: one a path and carrier, sorted by key.

        Raises:
            InputError: If paths lead between single elements.
        """
        if not self.is_synthetic:
            raise InputError(
                "to_table: paths between single elements have no rows in a dataset; solve with synthetic_array=True"
            )
        tx_count = len(self.transmitters)
        link = self.rx.astype(np.int64) * tx_count + self.tx
        order = np.argsort(link, kind="stable")
        own, pairs = self._take(order), np.arange(len(self.receivers) * tx_count, dtype=np.int32)
        rx, tx = pairs // max(tx_count, 1), pairs % max(tx_count, 1)
        links = Links(
            frame=np.full(len(pairs), self.frame, dtype=np.int32),
            batch_index=np.zeros(len(pairs), dtype=np.int32),
            kind=np.zeros(len(pairs), dtype=np.int8),
            tx_actor=tx + np.int32(len(self.receivers)),
            rx_actor=rx,
            tx_antenna=np.zeros(len(pairs), dtype=np.int32),
            rx_antenna=np.zeros(len(pairs), dtype=np.int32),
            tx=self.transmitters.state.take(tx),
            rx=self.receivers.state.take(rx),
        )
        named, found = ((*self.rx_names, *self.tx_names), ("antenna",), links), own._path_set(link[order])
        gains = {"scenario": self.scenario, "weather": self.weather, **path_gain_rows(*named, found, self.weather)}
        geometry = {"scenario": self.scenario, **path_geometry_rows(*named, found)}
        return join_paths(table_from_columns("path_gains", gains), table_from_columns("path_geometry", geometry))

    def to_pandas(self) -> "pd.DataFrame":
        """Return a table of the paths in their order, one row a path and carrier, with the numbers that people read.

        Columns: rx, tx, carrier_hz, kind, depth, delay_s, gain_db, doppler_hz and the angles theta_t, phi_t, theta_r,
        phi_r [rad]. `to_table` has everything.

        Raises:
            InputError: If pandas is not installed.
        """
        with needed_by("Paths.to_pandas"):
            import pandas as pd
        count, carriers = len(self), len(self.carriers_hz)
        row = np.repeat(np.arange(count), carriers)
        columns = {
            "rx": np.array(self.rx_names, dtype=object)[self.rx[row]],
            "tx": np.array(self.tx_names, dtype=object)[self.tx[row]],
            "carrier_hz": np.tile(self.carriers_hz, count),
            "kind": self.kind[row],
            "depth": self.depth[row],
            "delay_s": self.tau[row],
            "gain_db": self.gain_db.ravel(),
            "doppler_hz": self.doppler_hz.ravel(),
            **{name: getattr(self, name)[row] for name in ("theta_t", "phi_t", "theta_r", "phi_r")},
        }
        return pd.DataFrame(columns)

    def _path_set(self, link: np.ndarray) -> PathSet:
        count = len(self.receivers) * len(self.transmitters)
        return PathSet(
            carriers_hz=self.carriers_hz, link=link.astype(np.int32), path_id=self.path_ids, kind=self.kind_id,
            order=self.depth, interaction=self.interaction_types, surface=self.surface_ids, object_id=self.object_ids,
            material_id=self.material_ids, vertex=self.vertices, normal=self.normals, edge=self.edges,
            curvature=self.curvatures, tau=self.tau,
            theta_t=self.theta_t, phi_t=self.phi_t, theta_r=self.theta_r, phi_r=self.phi_r, range_rate=self.range_rate,
            count=np.bincount(link, minlength=count).astype(np.int32), transfer={self.weather: self.transfer},
            a={self.weather: self.a}, loss_db={self.weather: {name: getattr(self, name) for name in LOSSES}},
        )  # fmt: skip

    def torch(self) -> "dict[str, torch.Tensor]":
        """Return the numeric arrays of the paths as tensors that share their memory, by name.

        Raises:
            InputError: If PyTorch is not installed.
        """
        with needed_by("Paths.torch"):
            import torch
        return {name: torch.from_numpy(np.ascontiguousarray(getattr(self, name))) for name in PATH_FIELDS}

    def plot(self, **options: Any) -> Any:
        """Draw the paths and return the figure; see `mmw.viz.scene_view.path_plots.plot_paths` for the options."""
        return load_reference("mmw.viz.scene_view.path_plots:plot_paths")(self, **options)
