"""Propagation paths of a batch: geometry once, gains for every weather and carrier."""

from dataclasses import dataclass

import numpy as np

from mmw.constants import SPEED_OF_LIGHT

PATH_LOS = 0
"""`Paths.kind` of the line of sight."""
PATH_SPECULAR = 1
"""`Paths.kind` of one specular reflection."""
PATH_KINDS = ("los", "specular")
"""Name of each kind."""


@dataclass(frozen=True)
class Paths:
    """One row a path, sorted by (link, kind, surface). World frame, metres, seconds, radians, time convention e^{+jwt}.

    A path is the same path in the next frame if transmitter, receiver and surface are the same. A link without any
    path is there with `count` 0. A path in a null of a pattern is there with gain 0.

    The coefficients `a` hold no carrier phase: the complex gain at frequency f is `a exp(-2 pi j f tau)`, and `tau`
    is absolute (length over the speed of light, float64), so nothing is lost.
    """

    carriers_hz: np.ndarray
    """Carrier frequencies [Hz], shape [C]."""
    link: np.ndarray
    """Row of `Links`, shape [P], int32."""
    kind: np.ndarray
    """`PATH_LOS` or `PATH_SPECULAR`, shape [P], int8."""
    surface: np.ndarray
    """Global surface id of the reflection, -1 for the line of sight, shape [P], int32."""
    object_id: np.ndarray
    """Object that reflects, -1 for the line of sight, shape [P], int32."""
    material_id: np.ndarray
    """Material that reflects, -1 for the line of sight, shape [P], int32."""
    vertex: np.ndarray
    """Point of reflection [m], shape [P, 3], float64; NaN for the line of sight."""
    normal: np.ndarray
    """Unit normal there, turned to the ends, shape [P, 3]; NaN for the line of sight."""
    tau: np.ndarray
    """Absolute delay [s], shape [P], float64."""
    theta_t: np.ndarray
    """Zenith of departure, shape [P]."""
    phi_t: np.ndarray
    """Azimuth of departure, shape [P]."""
    theta_r: np.ndarray
    """Zenith of arrival: direction from the receiver back along the path, shape [P]."""
    phi_r: np.ndarray
    """Azimuth of arrival, shape [P]."""
    range_rate: np.ndarray
    """Rate of change of the path's length [m/s], positive when it grows, shape [P]."""
    count: np.ndarray
    """Number of paths of each link, shape [L], int32."""
    transfer: dict[str, np.ndarray]
    """Weather -> 2x2 polarimetric transfer, shape [P, C, 2, 2], complex128: row = receive, column = transmit component
    in the world's (theta, phi) basis at arrival and departure; it holds lambda / (4 pi length), but no pattern."""
    a: dict[str, np.ndarray]
    """Weather -> coefficient F_r^T transfer F_t with the configured antennas, shape [P, C], complex128."""

    def __len__(self) -> int:
        return len(self.link)

    @property
    def doppler_hz(self) -> np.ndarray:
        """Doppler shift -f / c times the range rate [Hz], shape [P, C]."""
        return -self.range_rate[:, None] * self.carriers_hz[None, :] / SPEED_OF_LIGHT

    @property
    def index(self) -> np.ndarray:
        """Number of each path within its link, from 0, shape [P], int32."""
        return (np.arange(len(self)) - (np.cumsum(self.count) - self.count)[self.link]).astype(np.int32)
