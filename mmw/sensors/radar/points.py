"""Hold the output of a radar: one list of points for each view."""

from dataclasses import dataclass

import numpy as np

LABEL_OBJECT, LABEL_RAIN, LABEL_FALSE_ALARM = 0, 1, 2
"""Values of `RadarPoints.label`: an echo of a surface, rain clutter, noise above the threshold."""


@dataclass(frozen=True)
class RadarPoints:
    """Points of a batch in one weather, A views and N points in all; those of view a are rows `offsets[a]` to
    `offsets[a + 1]`.

    Angles are in the right-handed sensor frame, x forward, y left, z up: CARLA's azimuth is minus this one, its
    altitude is this elevation. `carla` has no power: `power_db`, `snr_db` and `rcs_dbsm` are None then.
    """

    offsets: np.ndarray
    """First point of every view, and N, shape [A + 1], int32."""
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
