"""Hold one radio link of a frame at one carrier."""

from dataclasses import dataclass, fields

import numpy as np


@dataclass(frozen=True)
class Link:
    """One radio link at one carrier."""

    agent: str
    """Receiver."""
    peer: str
    """Transmitter."""
    antenna: str
    """Antenna of the receiver."""
    peer_antenna: str
    """Antenna of the transmitter."""
    carrier: int
    """Number of the carrier in the configuration, from 0."""
    carrier_hz: float
    is_los: bool
    gain_db: float | None
    """Sum of the powers of the paths [dB]; None without any path."""
    paths: dict[str, np.ndarray]
    """Columns of the view `paths`, shape [P] each; of lists an object array of arrays."""

    @property
    def a(self) -> np.ndarray:
        """Coefficients without the carrier phase, shape [P], complex128."""
        return self.paths["a_re"] + 1j * self.paths["a_im"]

    def vertices(self, path: int) -> np.ndarray:
        """Return the places of a path's interactions in the world, from transmitter to receiver [m], shape [n, 3]."""
        return np.asarray(self.paths["vertices"][path], dtype=np.float64).reshape(-1, 3)


LINK_FIELDS = tuple(one.name for one in fields(Link) if one.name != "paths")
"""Fields of `Link` that are columns of table `links`."""
