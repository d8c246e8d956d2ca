"""Environments of Gymnasium and PettingZoo on live simulations: choose beams, stations and speeds of vehicles.

import gymnasium
import mmw.gym
env = gymnasium.make("mmw/BeamTracking-v0")
"""

from mmw.core.extras import needed_by as _needed_by

with _needed_by("mmw.gym (mmw.Simulation(mode='live') steps without it)"):
    import gymnasium as _gymnasium
    import pettingzoo as _pettingzoo  # noqa: F401

from mmw.gym.beam_tracking import BeamTracking
from mmw.gym.fleet import Fleet
from mmw.gym.handover import Handover
from mmw.gym.link_rate import RadioLink

__all__ = ["BeamTracking", "Fleet", "Handover", "RadioLink"]

for _name, _entry in (("BeamTracking", BeamTracking), ("Handover", Handover)):
    if f"mmw/{_name}-v0" not in _gymnasium.registry:
        _gymnasium.register(f"mmw/{_name}-v0", entry_point=_entry)
