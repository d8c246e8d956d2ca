"""Show scenes from Python: interactive in 3-D, as the RGB camera sees them, and plots of their paths.

`Scene.show`, `Scene.render` and `Paths.plot` are these functions.
"""

from mmw.viz.scene_view.path_plots import plot_paths
from mmw.viz.scene_view.picture import render_picture
from mmw.viz.scene_view.show import show

__all__ = ["plot_paths", "render_picture", "show"]
