"""Choose the values of a radio map that are drawn, and their colors."""

from dataclasses import dataclass

import numpy as np

from mmw.channel.radio_map.radio_map import RadioMap
from mmw.viz.plots.radio_map_plot import LABELS, LOWEST_SHARE
from mmw.viz.plots.style import scale_colors


@dataclass(frozen=True)
class Coverage:
    """The cells of a map that something reaches."""

    label: str
    """Name and unit of the values."""
    values: np.ndarray
    """Value of each cell [dB or dBm], shape [C], float64."""
    triangles: np.ndarray
    """Corners of the triangles of the cells, world frame [m], shape [F, 3, 3], float64."""
    cell: np.ndarray
    """Cell of each triangle, shape [F], int64."""

    @property
    def limits(self) -> tuple[float, float]:
        """Ends of the color scale: above the lowest values of `LOWEST_SHARE` percent; (-1, 0) without any cell."""
        if not len(self.values):
            return -1.0, 0.0
        low, top = float(np.percentile(self.values, LOWEST_SHARE)), float(self.values.max())
        return (low if low < top else top - 1.0), top

    @property
    def colors(self) -> np.ndarray:
        """Color of each cell, 8-bit sRGB, shape [C, 3], uint8."""
        return scale_colors(self.values, *self.limits)


def choose_coverage(radio_map: RadioMap, metric: str) -> Coverage:
    """Return the largest value of a metric in each cell; cells that nothing reaches are left out.

    Args:
        radio_map: The map.
        metric: `path_gain`, `rss` or `sinr`.

    Raises:
        InputError: If there is no such metric.
    """
    values, surface = radio_map.metric_db(metric), radio_map.surface
    is_reached = np.isfinite(values)
    number = np.cumsum(is_reached) - 1
    face = np.flatnonzero(is_reached[surface.cell_of_face])
    triangles = surface.corners.reshape(-1, 3)[surface.faces[face]]
    return Coverage(LABELS[metric], values[is_reached], triangles, number[surface.cell_of_face[face]])
