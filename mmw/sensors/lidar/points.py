"""Hold the output of a LiDAR: one point cloud for each view."""

from dataclasses import dataclass

from mmw.sensors.samples import Array, PointSamples


@dataclass(frozen=True)
class PointCloud(PointSamples):
    """Point clouds of A views in one weather, or the one of a single view; N returns in all.

    The returns of a view are channel by channel from the top, in firing order, of one ray the strongest before the
    last; rays without a return have no row.
    """

    values: Array
    """x, y, z and intensity of each return, see the properties, shape [N, 4], float32; a column is one piece of
    memory."""
    ring: Array
    """Channel, 0 the highest, shape [N], uint8."""
    object_id: Array
    """Object that was hit, -1 for rain and fog, shape [N], int32."""
    label: Array
    """0 surface, 1 rain, 2 fog, shape [N], uint8."""
    time_offset: Array
    """Time of firing after the frame's instant [s], -0.01 to 0, shape [N], float32; 0 for a still picture."""
    return_number: Array
    """0 the strongest or only return of its ray, 1 the last one of two, shape [N], uint8."""
    scene_flow: Array | None = None
    """Displacement of each point until the next frame, sensor frame [m], shape [N, 3], float32; None unless the sensor
    is configured for it."""

    @property
    def xyz(self) -> Array:
        """Points in the sensor frame, x forward, y left, z up, on a grid of 1/1024 m [m], shape [N, 3], float32."""
        return self.values[:, :3]

    @property
    def x(self) -> Array:
        """Forward in the sensor frame [m], shape [N], float32."""
        return self.values[:, 0]

    @property
    def y(self) -> Array:
        """Left in the sensor frame [m], shape [N], float32."""
        return self.values[:, 1]

    @property
    def z(self) -> Array:
        """Up in the sensor frame [m], shape [N], float32."""
        return self.values[:, 2]

    @property
    def intensity(self) -> Array:
        """0 to 1 on a grid of 1/256, shape [N], float32: received power x range^2, in `carla` exp(-rate d)."""
        return self.values[:, 3]
