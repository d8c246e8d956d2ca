"""Moving vehicles: spawning, car following, junctions, and bodies that stand on their wheels."""

from mmw.traffic.simulation import VehicleTrack, simulate

__all__ = ["VehicleTrack", "simulate"]
