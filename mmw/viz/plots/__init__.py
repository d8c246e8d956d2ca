"""Figures of a dataset with matplotlib (extra `plot`): a frame with all sensors, radio paths on the map, a link.

import mmw
from mmw.viz.plots import plot_link, plot_paths, render_frame

data = mmw.open("out/quickstart")
render_frame(data, "town03_roundabout", "sunny", 0).savefig("frame.png")

Functions return the matplotlib Figure and show nothing; they need no display.
"""

from mmw.viz.plots.bird_eye import draw_lidar, draw_radar
from mmw.viz.plots.frame import render_frame
from mmw.viz.plots.images import draw_camera, draw_depth
from mmw.viz.plots.link import plot_link
from mmw.viz.plots.map import TownPlan, read_town_plan
from mmw.viz.plots.paths import draw_map, draw_paths_above, draw_paths_aside, plot_paths

__all__ = [
    "TownPlan", "draw_camera", "draw_depth", "draw_lidar", "draw_map", "draw_paths_above", "draw_paths_aside",
    "draw_radar", "plot_link", "plot_paths", "read_town_plan", "render_frame",
]  # fmt: skip
