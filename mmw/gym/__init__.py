"""Environments of Gymnasium and PettingZoo on live simulations: choose beams, stations and speeds of vehicles.

import gymnasium
import mmw.gym
env = gymnasium.make("mmw/BeamTracking-v0")
envs = gymnasium.make_vec("mmw/BeamTracking-v0", num_envs=64, vectorization_mode="vector_entry_point")
"""

from mmw.core.extras import needed_by as _needed_by

with _needed_by("mmw.gym (mmw.Simulation(mode='live') steps without it)"):
    import gymnasium as _gymnasium
    import pettingzoo as _pettingzoo  # noqa: F401

from mmw.gym.beam_tracking import BeamTracking
from mmw.gym.fleet import Fleet
from mmw.gym.handover import Handover
from mmw.gym.link_rate import RadioLink
from mmw.gym.vector_env import BeamTrackingVector, HandoverVector, VectorOptions

__all__ = ["BeamTracking", "BeamTrackingVector", "Fleet", "Handover", "HandoverVector", "RadioLink", "VectorOptions"]

for _entry, _vector in ((BeamTracking, BeamTrackingVector), (Handover, HandoverVector)):
    if f"mmw/{_entry.__name__}-v0" not in _gymnasium.registry:
        _gymnasium.register(f"mmw/{_entry.__name__}-v0", entry_point=_entry, vector_entry_point=_vector)
