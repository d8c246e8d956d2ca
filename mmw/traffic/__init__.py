"""Move actors: vehicles of three engines, as bodies that stand on their wheels, and pedestrians."""

from mmw.traffic.idm.run import VehicleTrack, run_traffic

__all__ = ["VehicleTrack", "run_traffic"]
