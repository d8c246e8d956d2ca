"""Hold what the environments share: a live simulation, its episodes, and where a vehicle is seen from a station."""

from collections.abc import Callable, Collection, Iterable, Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from mmw.config.load import Source, load_config
from mmw.core.errors import InputError
from mmw.core.transforms import conjugate, rotate
from mmw.dataset.frame import Agent, Frame
from mmw.generation.simulation import Simulation
from mmw.gym.link_rate import LOWEST_SNR_DB
from mmw.traffic.live.control import Control

Extra = tuple[spaces.Space[Any], Callable[[Agent], Any]]
"""Space of a further observation, and the function that takes it of the agent in the present frame."""

FARTHEST_M = 2000.0
"""Bounds of places in observations [m]; nearer than any link of the shipped towns is long."""

FASTEST_M_S = 100.0
"""Bounds of velocities in observations [m/s]."""

HIGHEST_SNR_DB = 120.0
"""Upper bound of the SNR in observations [dB]."""

NO_SENSORS = "sensors=[]"


class LiveEnv(gymnasium.Env[dict[str, Any], np.int64]):
    """Episodes of a live simulation in which one vehicle decides every `frames_per_step` frames.

    An episode begins at a random frame of the same drive, up to `max_start` steps after the first, and is truncated
    where the frames of the configuration end. `reset(options={"traffic_seed": n})` makes another fleet, in seconds.
    """

    metadata = {"render_modes": []}  # noqa: RUF012  (as Gymnasium declares it)

    def __init__(
        self,
        config: Source,
        *,
        overrides: tuple[str, ...],
        agent: str,
        peers: tuple[str, ...],
        frames_per_step: int,
        max_start: int,
        device: str,
        extra: Mapping[str, Extra] | None,
        drive: Callable[[Frame], Mapping[str, Control | None]] | None,
        state: Mapping[str, spaces.Space[Any]],
    ) -> None:
        """Make the simulation; arguments as of the environments, and `state`, the spaces of their last decision."""
        self._simulation = Simulation(load_config(config, overrides), mode="live", device=device)
        self.agent, self.peers = agent, peers
        self._stride, self._max_start = frames_per_step, max_start
        self._extra, self._drive = dict(extra or {}), drive
        self.frame: Frame = self._simulation.reset()
        own = {
            **state,
            "snr_db": snr_space(len(peers)),
            "position": place_space(),
            "velocity": velocity_space(),
        }
        try:
            check_episodes(self._simulation.frames, frames_per_step, max_start)
            check_names(self.frame, (agent, *peers), self._extra, own)
        except InputError:
            self._simulation.close()
            raise
        self.observation_space = spaces.Dict({**own, **{name: space for name, (space, _) in self._extra.items()}})

    @property
    def simulation(self) -> Simulation:
        """The simulation, for `save` and for looking at the present frame."""
        return self._simulation

    def _start(self, seed: int | None, options: Mapping[str, Any] | None) -> None:
        """Begin an episode at a random frame."""
        super().reset(seed=seed)
        check_options(options, ("traffic_seed",))
        traffic = (options or {}).get("traffic_seed")
        self.frame = self._simulation.reset(traffic)
        for _ in range(int(self.np_random.integers(self._max_start + 1)) * self._stride):
            self.frame = self._simulation.step()

    def _advance(self) -> bool:
        """Go on by one step; return whether the episode can have no further one."""
        for _ in range(self._stride):
            controls = self._drive(self.frame) if self._drive else None
            self.frame = self._simulation.step(controls)
        return self.frame.frame + self._stride >= self._simulation.frames.stop

    def _motion(self, peer: str) -> dict[str, np.ndarray]:
        return motion_from(self.frame, self.agent, peer)

    def _extras(self) -> dict[str, Any]:
        agent = self.frame.agents[self.agent]
        return {name: take(agent) for name, (_, take) in self._extra.items()}

    def close(self) -> None:
        """Free the device."""
        self._simulation.close()


def check_episodes(frames: range, frames_per_step: int, max_start: int) -> None:
    """Check that the live frames of an episode are enough.

    Raises:
        InputError: If they are not.
    """
    if frames_per_step < 1 or max_start < 0:
        raise InputError(f"frames_per_step = {frames_per_step}, max_start = {max_start}; at least 1 and 0 are needed")
    if len(frames) <= (max_start + 1) * frames_per_step:
        raise InputError(
            f"frames.count: {len(frames)} live frames; an episode that begins up to {max_start} steps of "
            f"{frames_per_step} frames late needs more; raise it or lower max_start"
        )


def check_names(frame: Frame, agents: Iterable[str], extra: Iterable[str], own: Collection[str]) -> None:
    """Check that the agents are in a frame, and that further observations have names of their own.

    Raises:
        InputError: If they are not, or have not.
    """
    for name in agents:
        if name not in frame.agents:
            raise InputError(f"agent {name!r}: there are {', '.join(frame.agents)}; name one of them")
    for name in extra:
        if name in own:
            raise InputError(f"extra = {name!r}: the environment has an observation of this name; choose another")


def check_options(options: Mapping[str, Any] | None, known: Collection[str]) -> None:
    """Check the names of the options of `reset`.

    Raises:
        InputError: If one is not known.
    """
    for name in options or {}:
        if name not in known:
            raise InputError(f"options = {dict(options or {})}: {name} is not known; there is {' and '.join(known)}")


def motion_from(frame: Frame, agent: str, peer: str) -> dict[str, np.ndarray]:
    """Return place [m] and velocity [m/s] of an agent in the axes of a peer, `position` and `velocity`, float32."""
    own, other = frame.agents[agent], frame.agents[peer]
    turn = conjugate(other.pose[3:])
    velocity = np.array([own.row[axis] for axis in ("vx", "vy", "vz")])
    return {
        "position": rotate(turn, own.pose[:3] - other.pose[:3]).astype(np.float32),
        "velocity": rotate(turn, velocity).astype(np.float32),
    }


def place_space() -> spaces.Box:
    """Return the space of places."""
    return spaces.Box(-FARTHEST_M, FARTHEST_M, (3,), np.float32)


def velocity_space() -> spaces.Box:
    """Return the space of velocities."""
    return spaces.Box(-FASTEST_M_S, FASTEST_M_S, (3,), np.float32)


def snr_space(count: int) -> spaces.Box:
    """Return the space of so many SNRs [dB]."""
    return spaces.Box(LOWEST_SNR_DB, HIGHEST_SNR_DB, (count,), np.float32)
