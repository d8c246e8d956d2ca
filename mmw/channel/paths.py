"""Hold the propagation paths of a batch: geometry once, gains for every weather and carrier."""

from dataclasses import dataclass, fields, replace

import numpy as np

from mmw.core.constants import SPEED_OF_LIGHT
from mmw.physics.em.interaction import DIFFUSE

PATH_KINDS = ("los", "specular", "transmission", "diffuse", "diffraction")
"""Name of each kind of path."""

PATH_LOS, PATH_SPECULAR, PATH_TRANSMISSION, PATH_DIFFUSE, PATH_DIFFRACTION = range(5)
"""`PathSet.kind`: a path is of the last kind, in this order, that any of its interactions is."""

AIR_LOSSES = ("rain_db", "fog_db", "gas_db")
"""Losses of the air along a path, one table column each."""

LOSSES = (*AIR_LOSSES, "foliage_db")
"""Losses along a path, one table column each."""

LOS_STATES = ("clear", "foliage", "blocked")
"""States of the line of sight of a link: it is free, it passes foliage, or there is none."""


@dataclass(frozen=True)
class PathSet:
    """One row a path, sorted by (link, order, kinds, surfaces). World frame, meters, seconds, radians, e^{+jwt}.

    A link without any path is there with `count` 0. A path in a null of a pattern is there with gain 0.

    The coefficients `a` hold no carrier phase: the complex gain at frequency f is `a exp(-2 pi j f tau)`, and `tau`
    is absolute (length over the speed of light, float64), so nothing is lost. They hold the losses of air and foliage.
    """

    carriers_hz: np.ndarray
    """Carrier frequencies [Hz], shape [C]."""
    link: np.ndarray
    """Row of `Links`, shape [P], int32."""
    path_id: np.ndarray
    """Identifier of a path, the same in every frame: a hash of transmitter, receiver and its interactions in order,
    shape [P], int64. A diffuse path also hashes its ray, so its identifier is in one frame only."""
    kind: np.ndarray
    """Row of `PATH_KINDS`, shape [P], int8."""
    order: np.ndarray
    """Number of interactions, shape [P], int8."""
    interaction: np.ndarray
    """Each interaction from transmitter to receiver (see `mmw.physics.em.interaction`), or 0, shape [P, D], int8."""
    surface: np.ndarray
    """Global surface of each interaction (of a diffraction: its wedge), -1 behind the last, shape [P, D], int32."""
    object_id: np.ndarray
    """Object of each interaction, -1 behind the last, shape [P, D], int32."""
    material_id: np.ndarray
    """Material of each interaction (of a diffraction: of its first face), -1 behind the last, shape [P, D], int32."""
    vertex: np.ndarray
    """Point of each interaction [m], NaN behind the last, shape [P, D, 3], float64."""
    normal: np.ndarray
    """Unit normal there, turned to where the wave comes from, shape [P, D, 3]; NaN behind the last, 0 for a
    diffraction."""
    edge: np.ndarray
    """Unit vector along the edge that diffracts, NaN for a path without one, shape [P, 3]."""
    curvature: np.ndarray
    """Curvature of the surface that reflects, NaN for flat ones: xx, xy, xz, yy, yz, zz of a symmetric matrix over its
    tangent plane, positive where it bends away from the ends [1/m], shape [P, 6]."""
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
    loss_db: dict[str, dict[str, np.ndarray]]
    """Weather -> name among `LOSSES` -> loss of air or foliage that `transfer` and `a` hold [dB], shape [P, C]."""

    def __len__(self) -> int:
        return len(self.link)

    def rows_within(self, range_db: float) -> np.ndarray:
        """Return the rows of the paths that are not weaker than the strongest of their link by more than a range.

        The strength of a path is the Frobenius norm of its transfer; it stays if it is strong enough at any carrier in
        any weather, so that all have the same paths. Diffuse paths stay: each is a weak part of one rough surface.

        Args:
            range_db: The range [dB].
        """
        is_kept = (self.interaction == DIFFUSE).any(axis=1)
        for transfer in self.transfer.values():
            strength = np.linalg.norm(transfer, axis=(2, 3))
            most = np.zeros((len(self.count), strength.shape[1]))
            np.maximum.at(most, self.link, strength)
            is_kept |= (strength >= most[self.link] * 10.0 ** (-range_db / 20.0)).any(axis=1)
        return np.flatnonzero(is_kept)

    def take(self, rows: np.ndarray) -> "PathSet":
        """Return some of the paths, in their order."""
        by_path = {
            field.name: value[rows]
            for field in fields(self)
            if field.name not in ("carriers_hz", "count") and isinstance(value := getattr(self, field.name), np.ndarray)
        }
        return replace(
            self,
            **by_path,
            count=np.bincount(self.link[rows], minlength=len(self.count)).astype(np.int32),
            transfer={weather: values[rows] for weather, values in self.transfer.items()},
            a={weather: values[rows] for weather, values in self.a.items()},
            loss_db={w: {name: values[rows] for name, values in one.items()} for w, one in self.loss_db.items()},
        )

    def los_state(self, weather: str) -> np.ndarray:
        """Return the state of the line of sight of each link, a row of `LOS_STATES`, shape [L]."""
        state = np.full(len(self.count), LOS_STATES.index("blocked"))
        sight = np.flatnonzero(self.kind == PATH_LOS)
        in_foliage = self.loss_db[weather]["foliage_db"][sight].any(axis=1)
        state[self.link[sight]] = np.where(in_foliage, LOS_STATES.index("foliage"), LOS_STATES.index("clear"))
        return state

    @property
    def doppler_hz(self) -> np.ndarray:
        """Doppler shift -f / c times the range rate [Hz], shape [P, C]."""
        return -self.range_rate[:, None] * self.carriers_hz[None, :] / SPEED_OF_LIGHT

    @property
    def index(self) -> np.ndarray:
        """Number of each path within its link, from 0, shape [P], int32."""
        return (np.arange(len(self)) - (np.cumsum(self.count) - self.count)[self.link]).astype(np.int32)
