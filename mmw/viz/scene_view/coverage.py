"""Choose the values of a radio map that are drawn, and their colors."""

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from mmw.channel.radio_map.solver import RadioMap
from mmw.core.errors import InputError
from mmw.viz.plots.radio_map_plot import LOWEST_SHARE
from mmw.viz.plots.style import scale_colors

Metric = Literal["path_gain", "rss", "sinr"]
"""Quantity of a map: path gain, received signal strength, or SINR, in each cell of the transmitter that is strongest
there."""

LABELS: dict[str, str] = {"path_gain": "path gain [dB]", "rss": "RSS [dBm]", "sinr": "SINR [dB]"}
"""Metric -> name and unit for people."""


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
    """Return the values of a metric; cells that nothing reaches are left out.

    Raises:
        InputError: If there is no such metric.
    """
    if metric not in get_args(Metric):
        raise InputError(f"radio map: metric = {metric!r}; one of {', '.join(LABELS)} is needed; name one")
    server, surface = radio_map.tx_association, radio_map.surface
    cell = np.flatnonzero(server >= 0)
    if metric == "path_gain":
        values = radio_map.path_gain_db.max(axis=0)[cell]
    else:
        values = (radio_map.rss_dbm if metric == "rss" else radio_map.sinr_db)[server[cell], cell]
    number = np.full(len(surface), -1, dtype=np.int64)
    number[cell] = np.arange(len(cell))
    of_face = np.repeat(number, len(surface.faces) // len(surface))
    triangles = surface.corners.reshape(-1, 3)[surface.faces[of_face >= 0]]
    return Coverage(LABELS[metric], values, triangles, of_face[of_face >= 0])
