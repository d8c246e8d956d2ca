"""Open a dataset: SQL over every table with DuckDB, Arrow, pandas and NumPy tables, or one frame with everything in it.

import mmw
mmw.connect("out/quickstart").sql("SELECT frame, agent, gain_db FROM links WHERE carrier_hz = 28e9").df()
mmw.open("out/quickstart").frame("town03_roundabout", "sunny", 0).agents["cav_1"].sweeps["lidar"].points
"""

from mmw.dataset.beams import BeamSearch
from mmw.dataset.dataset import Dataset, connect, open_dataset
from mmw.dataset.frame import Frame

__all__ = ["BeamSearch", "Dataset", "Frame", "connect", "open_dataset"]
