"""Compute the spectral efficiency of every beam of a transmitter towards one receiver in a frame."""

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from mmw.channel.antennas.array_response import apply_arrays
from mmw.channel.antennas.arrays import PlanarArray, ula
from mmw.channel.codebook import dft_codebook
from mmw.channel.path_table import CarrierPaths
from mmw.channel.radio_map.radio_map import BOLTZMANN
from mmw.channel.response import frequency_response, subcarrier_frequencies
from mmw.core.errors import InputError
from mmw.core.transforms import quaternion_to_matrix
from mmw.dataset.frame import Frame

REFERENCE_K = 290.0
"""Temperature of the noise figure [K]. Source: IEEE Std 161, definition of the noise factor."""

LOWEST_SNR_DB = -60.0
"""SNR that stands for no path at all, and for less [dB]."""


@dataclass(frozen=True)
class RadioLink:
    """Radio of a link with a codebook at the transmitter and one antenna at the receiver.

    The power is divided evenly over the subcarriers. Spectral efficiency is the mean over them of log2(1 + SNR).

    Source: capacity of parallel Gaussian channels with equal power, D. Tse and P. Viswanath, Fundamentals of Wireless
    Communication, Cambridge 2005, section 5.3.3. Default values are design values in the ranges of 3GPP TR 38.901.
    """

    carrier_hz: float = 28e9
    """One of `channel.carriers_hz` [Hz]."""
    tx_array: PlanarArray = field(default_factory=lambda: ula(64))
    """Array of the transmitter, on its agent."""
    beams: int | tuple[int, int] = 64
    """Beams of its DFT codebook, see `mmw.channel.dft_codebook`."""
    power_dbm: float = 20.0
    """Transmit power [dBm]."""
    bandwidth_hz: float = 100e6
    noise_figure_db: float = 7.0
    subcarriers: int = 16
    """Frequencies that the bandwidth is sampled at."""

    @cached_property
    def codebook(self) -> np.ndarray:
        """Precoders as columns, shape [antennas, beams]."""
        return dft_codebook(self.tx_array, self.beams)

    @property
    def beam_count(self) -> int:
        """Beams of the codebook."""
        return self.codebook.shape[1]

    @property
    def noise_w(self) -> float:
        """Noise in the bandwidth [W]."""
        return BOLTZMANN * REFERENCE_K * self.bandwidth_hz * 10.0 ** (0.1 * self.noise_figure_db)

    def snr(self, frame: Frame, agent: str, peers: tuple[str, ...]) -> np.ndarray:
        """Return the SNR of every beam of some transmitters at every subcarrier, shape [peers, beams, subcarriers].

        Args:
            frame: A frame, live or stored.
            agent: Receiver.
            peers: Transmitters.

        Raises:
            InputError: If there is no such link at this carrier.
        """
        paths = frame.paths(self.carrier_hz)
        pairs = [(str(key["agent"]), str(key["peer"])) for key in paths.keys]
        missing = [peer for peer in peers if (agent, peer) not in pairs]
        if missing:
            raise InputError(
                f"link from {missing[0]!r} to {agent!r}: there is none in frame {frame.frame}; there are "
                f"{', '.join(f'{tx} to {rx}' for rx, tx in pairs) or 'none'}; name one of them"
            )
        own = paths.take([pairs.index((agent, peer)) for peer in peers])
        turns = [quaternion_to_matrix(frame.agents[name].pose[3:]) for name in (*peers, agent)]
        return self.snr_of(own, np.stack(turns[:-1]), np.stack(turns[-1:] * len(peers)))

    def snr_of(self, own: CarrierPaths, tx_turns: np.ndarray, rx_turns: np.ndarray) -> np.ndarray:
        """Return the SNR of every beam of some links at every subcarrier, shape [links, beams, subcarriers].

        Args:
            own: Paths of the links at the carrier.
            tx_turns: Rotation of each transmitter from its own to the world frame, shape [links, 3, 3].
            rx_turns: That of each receiver, shape [links, 3, 3].
        """
        ends = self.tx_array, ula(1), self.carrier_hz, tx_turns, rx_turns
        spacing = self.bandwidth_hz / self.subcarriers
        frequencies = subcarrier_frequencies(self.subcarriers, spacing)
        h = frequency_response(apply_arrays(own, *ends), own, frequencies, self.carrier_hz, normalize_delays=True)
        amplitude = np.einsum("lak,ab->lbk", h[:, 0], self.codebook)
        return 10.0 ** (0.1 * self.power_dbm - 3.0) / self.noise_w * np.abs(amplitude) ** 2

    @staticmethod
    def spectral_efficiency(snr: np.ndarray) -> np.ndarray:
        """Return the spectral efficiency [bit/s/Hz] of SNRs over the last axis."""
        return np.log2(1.0 + snr).mean(axis=-1)

    @staticmethod
    def snr_db(snr: np.ndarray) -> np.ndarray:
        """Return the mean SNR over the last axis [dB], at least `LOWEST_SNR_DB`."""
        return 10.0 * np.log10(np.maximum(snr.mean(axis=-1), 10.0 ** (0.1 * LOWEST_SNR_DB)))
