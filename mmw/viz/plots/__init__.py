"""Figures of a dataset with matplotlib (extra `plot`): a frame with all sensors, radio paths on the map, a link.

import mmw
from mmw.viz.plots import plot_link, plot_paths, render_frame

data = mmw.open("out/quickstart")
render_frame(data, "town03_roundabout", "sunny", 0).savefig("frame.png")

Functions return the matplotlib Figure and show nothing; they need no display.
"""

from mmw.viz.plots.bird_eye import draw_lidar, draw_radar
from mmw.viz.plots.frame import render_frame
from mmw.viz.plots.images import draw_boxes_2d, draw_camera, draw_depth, draw_instances
from mmw.viz.plots.link import plot_link, plot_path_history
from mmw.viz.plots.map import TownPlan, read_town_plan
from mmw.viz.plots.paths import draw_map, draw_paths_above, draw_paths_aside, plot_paths
from mmw.viz.plots.readings import plot_readings
from mmw.viz.plots.samples import SamplePlot, SampleStyle, draw_sample
from mmw.viz.plots.weather_comparison import plot_depth, plot_lidar, plot_radar, plot_sensor

__all__ = [
    "SamplePlot", "SampleStyle", "TownPlan", "draw_boxes_2d", "draw_camera", "draw_depth", "draw_instances",
    "draw_lidar", "draw_map", "draw_paths_above", "draw_paths_aside", "draw_radar", "draw_sample", "plot_depth",
    "plot_lidar", "plot_link", "plot_path_history", "plot_paths", "plot_radar", "plot_readings", "plot_sensor",
    "read_town_plan", "render_frame",
]  # fmt: skip
