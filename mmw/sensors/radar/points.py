"""Hold the output of a radar: one list of points for each view, power maps and samples of the receivers."""

from dataclasses import dataclass, replace
from typing import Literal, Self

import numpy as np

from mmw.sensors.samples import PointSamples, Samples

MapKind = Literal["range_azimuth", "range_doppler"]

LABEL_OBJECT, LABEL_RAIN, LABEL_FALSE_ALARM = 0, 1, 2
"""Values of `RadarPoints.label`: an echo of a surface, rain clutter, noise above the threshold."""


@dataclass(frozen=True)
class RadarMaps(Samples):
    """One kind of map of A views in one weather, or the one of a single view.

    Pixel (i, j) is at row_first + i row_step and column_first + j column_step.
    """

    kind: MapKind
    values: np.ndarray
    """Received power, echo and noise [dBm], shape [A, rows, columns], float32."""
    row_first: float
    """Range of row 0 [m]."""
    row_step: float
    """Range from row to row [m]."""
    column_first: float
    """Of column 0: direction cosine along y, sin(azimuth) cos(elevation), or radial velocity [m/s]."""
    column_step: float
    """From column to column, in the same unit."""


@dataclass(frozen=True)
class RadarPoints(PointSamples):
    """Points of A views in one weather, or those of a single view; N points in all.

    Angles are in the right-handed sensor frame, x forward, y left, z up: CARLA's azimuth is minus this one, its
    altitude is this elevation. `carla` has no power: `power_db`, `snr_db` and `rcs_dbsm` are None then.
    """

    range: np.ndarray
    """Distance from the sensor [m], shape [N], float32."""
    azimuth: np.ndarray
    """Angle in the x-y plane, positive toward y (left) [rad], shape [N], float32."""
    elevation: np.ndarray
    """Angle above the x-y plane [rad], shape [N], float32."""
    velocity: np.ndarray
    """Radial velocity relative to the sensor, positive while the distance grows [m/s], shape [N], float32."""
    power_db: np.ndarray | None
    """Received power [dBm], losses of the weather included, shape [N], float32."""
    snr_db: np.ndarray | None
    """The same over the noise power of `Radar.noise_w` [dB], shape [N], float32."""
    rcs_dbsm: np.ndarray | None
    """Radar cross section, losses of the weather not included [dBsm], shape [N], float32."""
    object_id: np.ndarray
    """Object that the point lies on, -1 for clutter and false alarms, shape [N], int32."""
    label: np.ndarray
    """0 object, 1 rain clutter, 2 false alarm, shape [N], uint8."""
    maps: tuple[RadarMaps, ...] = ()
    """Power maps, one of each kind in `Radar.maps`."""
    iq: np.ndarray | None = None
    """Samples of the receivers [W^0.5], shape [A, antennas, chirps, samples], complex64; None without `Radar.iq`."""
    path_type: np.ndarray | None = None
    """Path of the echo: 0 direct, with what interferes with it, clutter and noise; 1 over the ground, resolved from the
    direct one; ghosts over a mirror: 2 out over the mirror and back from the object, at its angle (type 1, second
    order); 3 the reverse, at the angle of the mirror (type 2, second order); 4 over the mirror both ways, the image
    (type 2, third order). `object_id` is the object that is mirrored. Shape [N], uint8; None without multipath.

    Source of the types: F. Kraus, N. Scheiner, W. Ritter, K. Dietmayer, "The Radar Ghost Dataset", IROS 2021."""

    @property
    def direct_object_id(self) -> np.ndarray:
        """Object that each point lies on, -1 for clutter, false alarms and what multipath puts elsewhere, shape [N]."""
        return self.object_id if self.path_type is None else np.where(self.path_type == 0, self.object_id, -1)

    def view(self, index: int) -> Self:
        """Return the points, maps and samples of one view."""
        points = super(RadarPoints, replace(self, maps=(), iq=None)).view(index)
        iq = None if self.iq is None else self.iq[index]
        return replace(points, maps=tuple(maps.view(index) for maps in self.maps), iq=iq)
