"""Drive several vehicles and choose their beams together: a parallel environment of PettingZoo."""

from typing import Any

import numpy as np
from gymnasium import spaces
from gymnasium.utils import seeding
from pettingzoo import ParallelEnv

from mmw.config.load import Source, load_config
from mmw.core.errors import InputError
from mmw.dataset.frame import Frame
from mmw.generation.simulation import Simulation
from mmw.gym.link_rate import RadioLink
from mmw.gym.live_env import NO_SENSORS, motion_from, place_space, snr_space, velocity_space
from mmw.traffic.live.control import Control

SPEEDS_M_S = (0.0, 4.0, 8.0, 12.0)
"""Target speeds that a vehicle can choose [m/s]; its driver keeps to gaps and right of way."""


class Fleet(ParallelEnv):
    """Vehicles that each choose a target speed and the beam that serves them, every `frames_per_step` frames.

    Action of a vehicle: (place in `SPEEDS_M_S`, beam). Its reward is the spectral efficiency of the beam in the frame
    after the step [bit/s/Hz] plus `speed_weight` times its speed [m/s] there.

    Observation of a vehicle: `beam` and `snr_db` [dB] that served it, `position` [m] and `velocity` [m/s] in the axes
    of the station. `infos` has `best_beam` and `best_rate` of an exhaustive search.
    """

    metadata = {"name": "mmw_fleet_v0", "render_modes": []}  # noqa: RUF012  (as PettingZoo declares it)

    def __init__(
        self,
        config: Source = "quickstart",
        *,
        overrides: tuple[str, ...] = ("frames.count=1000", NO_SENSORS),
        vehicles: tuple[str, ...] = ("cav_1", "cav_2", "cav_3"),
        peer: str = "rsu_1",
        link: RadioLink | None = None,
        speed_weight: float = 0.1,
        frames_per_step: int = 10,
        device: str = "auto",
    ) -> None:
        """Make the simulation.

        Args:
            config: Configuration, as for `mmw.Simulation`.
            overrides: `key=value` that change it.
            vehicles: Agents that decide.
            peer: Station that serves them all.
            link: Radio of every link; the default one if None.
            speed_weight: Weight of the speed in the reward [bit/s/Hz per m/s].
            frames_per_step: Frames of 10 ms from one decision to the next.
            device: As for `mmw.Simulation`.

        Raises:
            InputError: If the configuration cannot be stepped, is too short, or has no such agents.
        """
        if frames_per_step < 1 or not vehicles or len(set(vehicles)) != len(vehicles):
            raise InputError(
                f"frames_per_step = {frames_per_step}, vehicles = {vehicles}; at least 1, and each vehicle once, are "
                "needed"
            )
        self.link = RadioLink() if link is None else link
        self.simulation = Simulation(load_config(config, overrides), mode="live", device=device)
        self.frame: Frame = self.simulation.reset()
        unknown = [name for name in (*vehicles, peer) if name not in self.frame.agents]
        if unknown or len(self.simulation.frames) <= frames_per_step:
            known, count = ", ".join(self.frame.agents), len(self.simulation.frames)
            self.simulation.close()
            if unknown:
                raise InputError(f"agent {unknown[0]!r}: there are {known}; name one of them")
            raise InputError(f"frames.count: {count} live frames; a step has {frames_per_step}; raise it")
        self.possible_agents = list(vehicles)
        self.agents: list[str] = []
        self._peer, self._stride, self._weight = peer, frames_per_step, speed_weight
        self._beams: dict[str, int] = {}
        self._random, _ = seeding.np_random(0)
        beams = self.link.beam_count
        parts = {"beam": spaces.Discrete(beams), "snr_db": snr_space(1)}
        observed = {**parts, "position": place_space(), "velocity": velocity_space()}
        self._observed = {name: spaces.Dict(dict(observed)) for name in vehicles}
        self._acted = {name: spaces.MultiDiscrete([len(SPEEDS_M_S), beams]) for name in vehicles}
        self.observation_spaces = dict(self._observed)
        self.action_spaces = dict(self._acted)

    def observation_space(self, agent: str) -> spaces.Dict:
        """Return the space of a vehicle's observations."""
        return self._observed[agent]

    def action_space(self, agent: str) -> spaces.MultiDiscrete:
        """Return the space of a vehicle's actions."""
        return self._acted[agent]

    def reset(
        self, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin an episode with random beams; see `pettingzoo.ParallelEnv.reset`."""
        if seed is not None:
            self._random, _ = seeding.np_random(seed)
        self.frame = self.simulation.reset((options or {}).get("traffic_seed"))
        self.agents = list(self.possible_agents)
        self._beams = {name: int(self._random.integers(self.link.beam_count)) for name in self.agents}
        observations, _, infos = self._look()
        return observations, infos

    def step(
        self, actions: dict[str, Any]
    ) -> tuple[dict[str, Any], dict[str, float], dict[str, bool], dict[str, bool], dict[str, Any]]:
        """Drive on and serve with the beams; see `pettingzoo.ParallelEnv.step`.

        Raises:
            InputError: If an action is missing or none of its space, or the episode is over.
        """
        for name in self.agents:
            if name not in actions or not self._acted[name].contains(np.asarray(actions[name])):
                raise InputError(
                    f"action of {name} = {actions.get(name)!r}; (0 to {len(SPEEDS_M_S) - 1}, 0 to "
                    f"{self.link.beam_count - 1}) is needed"
                )
        controls = {name: Control(target_speed_m_s=SPEEDS_M_S[int(actions[name][0])]) for name in self.agents}
        self._beams = {name: int(actions[name][1]) for name in self.agents}
        self.frame = self.simulation.step(controls)
        for _ in range(self._stride - 1):
            self.frame = self.simulation.step()
        observations, rewards, infos = self._look()
        is_over = self.frame.frame + self._stride >= self.simulation.frames.stop
        terminated, truncated = dict.fromkeys(self.agents, False), dict.fromkeys(self.agents, is_over)
        if is_over:
            self.agents = []
        return observations, rewards, terminated, truncated, infos

    def _look(self) -> tuple[dict[str, Any], dict[str, float], dict[str, Any]]:
        observations, rewards, infos = {}, {}, {}
        for name in self.agents:
            snr = self.link.snr(self.frame, name, (self._peer,))[0]
            rates, beam = self.link.spectral_efficiency(snr), self._beams[name]
            motion = motion_from(self.frame, name, self._peer)
            snr_db = self.link.snr_db(snr[beam : beam + 1]).astype(np.float32)
            observations[name] = {"beam": np.int64(beam), "snr_db": snr_db, **motion}
            speed = float(np.linalg.norm(motion["velocity"]))
            rewards[name] = float(rates[beam]) + self._weight * speed
            infos[name] = {"best_beam": int(np.argmax(rates)), "best_rate": float(rates.max())}
        return observations, rewards, infos

    def close(self) -> None:
        """Free the device."""
        self.simulation.close()
