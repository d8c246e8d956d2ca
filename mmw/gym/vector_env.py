"""Environments of Gymnasium whose worlds are stepped together and traced in one batch."""

from abc import abstractmethod
from collections.abc import Callable, Mapping, Sequence
from typing import Any, TypedDict, Unpack

import numpy as np
import pyarrow as pa
from gymnasium import spaces
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from mmw.channel.path_table import CarrierPaths
from mmw.config.load import Source, load_config
from mmw.core.errors import InputError
from mmw.core.transforms import conjugate, quaternion_to_matrix, rotate
from mmw.dataset.frame import Frame
from mmw.generation.batched_simulation import BatchedSimulation
from mmw.gym.beam_tracking import serve
from mmw.gym.handover import TWO_STATIONS, best_beams, check_stations, lost_share
from mmw.gym.link_rate import RadioLink
from mmw.gym.live_env import (
    NO_SENSORS,
    Extra,
    check_episodes,
    check_names,
    check_options,
    place_space,
    snr_space,
    velocity_space,
)
from mmw.traffic.live.control import Control

Looked = tuple[dict[str, np.ndarray], np.ndarray, dict[str, np.ndarray]]
"""Observations, spectral efficiency of what serves [bit/s/Hz], shape [W], and entries of `info`."""


class VectorOptions(TypedDict, total=False):
    """Arguments that all vector environments have, by name; as of the environment of a single world."""

    agent: str
    """Receiver; `cav_1` by default."""
    link: RadioLink | None
    """Radio of every station; the default one if None."""
    max_start: int
    """An episode begins up to so many steps after the first frame; 20 by default."""
    device: str
    """As for `mmw.BatchedSimulation`."""
    extra: Mapping[str, Extra] | None
    """Further observations of the agent."""
    drive: Callable[[Frame], Mapping[str, Control | None]] | None
    """Frame -> controls of vehicles in it."""
    draw_traffic: bool
    """Every episode has traffic of a seed that is drawn; by default a world keeps its own."""


class LiveVectorEnv(VectorEnv[dict[str, np.ndarray], np.ndarray, np.ndarray]):
    """W worlds of a `BatchedSimulation`, each as the environment of a single world.

    World k has traffic of `seed` + k of the configuration; town, vehicles and weather are the same in all. Its rewards
    are those of the single environment with this `seed`, and with the first one as `scene_seed`. A world whose
    episode is over starts anew in the next step, in which its action counts for nothing and its reward is 0.
    """

    metadata = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}  # noqa: RUF012  (as Gymnasium declares)

    def __init__(
        self,
        num_envs: int,
        config: Source,
        *,
        overrides: tuple[str, ...],
        peers: tuple[str, ...],
        frames_per_step: int,
        choices: int | None,
        state: str,
        agent: str = "cav_1",
        link: RadioLink | None = None,
        max_start: int = 20,
        device: str = "auto",
        extra: Mapping[str, Extra] | None = None,
        drive: Callable[[Frame], Mapping[str, Control | None]] | None = None,
        draw_traffic: bool = False,
    ) -> None:
        """Make the simulation; arguments as of the environments and `VectorOptions`.

        `choices` is the number of actions, None for the beams of the link; `state` names the observation of the last.
        """
        self.link = RadioLink() if link is None else link
        self._choices, self._state = self.link.beam_count if choices is None else choices, state
        self.agent, self.peers = agent, peers
        self._stride, self._max_start, self._draws_traffic = frames_per_step, max_start, draw_traffic
        self._extra, self._drive = dict(extra or {}), drive
        self._simulation = BatchedSimulation(load_config(config, overrides), num_envs, device=device)
        own: dict[str, spaces.Space[Any]] = {
            state: spaces.Discrete(self._choices),
            "snr_db": snr_space(len(peers)),
            "position": place_space(),
            "velocity": velocity_space(),
        }
        try:
            check_episodes(self._simulation.frames, frames_per_step, max_start)
            check_names(self._simulation.present[0], (agent, *peers), self._extra, own)
        except InputError:
            self._simulation.close()
            raise
        self.num_envs = num_envs
        self.single_observation_space = spaces.Dict(
            {**own, **{name: space for name, (space, _) in self._extra.items()}}
        )
        self.single_action_space = spaces.Discrete(self._choices)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._random = [seeding.np_random(None)[0] for _ in range(num_envs)]
        self._is_over = np.zeros(num_envs, dtype=bool)
        self._serving = np.zeros(num_envs, dtype=np.int64)

    @property
    def simulation(self) -> BatchedSimulation:
        """The simulation, for `save` and for looking at the present frames."""
        return self._simulation

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
        """Begin episodes at random frames, with random first choices; see `gymnasium.vector.VectorEnv.reset`.

        Args:
            seed: Of the start of each world, or of the first one, the others having those after it.
            options: `traffic_seed` of the first world, the others having those after it; `reset_mask`, shape [W], bool:
                worlds that start anew.

        Raises:
            InputError: If an option is not known, or there are not as many seeds as worlds.
        """
        check_options(options, ("traffic_seed", "reset_mask"))
        given = dict(options or {})
        mask = np.asarray(given.get("reset_mask", np.ones(self.num_envs, dtype=bool)))
        if mask.shape != (self.num_envs,) or mask.dtype != bool or not mask.any():
            raise InputError(
                f"reset_mask = {mask}; a truth value for each of {self.num_envs} worlds, one true, is needed"
            )
        seeds = [seed + k for k in range(self.num_envs)] if isinstance(seed, int) else seed
        if seeds is not None and len(seeds) != self.num_envs:
            raise InputError(
                f"seed has {len(seeds)} entries for {self.num_envs} worlds; give one for each, or one number"
            )
        chosen = np.flatnonzero(mask).tolist()
        for world in chosen:
            own = None if seeds is None else seeds[world]
            if own is not None:
                self._random[world] = seeding.np_random(own)[0]
        traffic = given.get("traffic_seed")
        self._begin(chosen, None if traffic is None else [traffic + world for world in chosen])
        self._is_over[chosen] = False
        observations, _, infos = self._look()
        return observations, _with_masks(infos, mask)

    def _begin(self, worlds: list[int], traffic: list[int] | None = None) -> None:
        """Begin episodes of some worlds: traffic, first frame, first choice, each drawn by the world's generator."""
        if traffic is None and self._draws_traffic:
            traffic = [int(self._random[world].integers(2**31)) for world in worlds]
        self._simulation.reset(traffic, worlds=worlds)
        wait = {world: int(self._random[world].integers(self._max_start + 1)) * self._stride for world in worlds}
        for passed in range(max(wait.values(), default=0)):
            self._simulation.step(worlds=[world for world in worlds if wait[world] > passed])
        for world in worlds:
            self._serving[world] = int(self._random[world].integers(self._choices))

    def step(
        self, actions: np.ndarray
    ) -> tuple[dict[str, np.ndarray], np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Serve the next step; see `gymnasium.vector.VectorEnv.step`.

        Raises:
            InputError: If there is no such choice in a world. No world has moved then.
        """
        taken = np.asarray(actions)
        if taken.shape != (self.num_envs,) or not np.issubdtype(taken.dtype, np.integer):
            raise InputError(f"actions = {actions!r}; a whole number for each of {self.num_envs} worlds is needed")
        is_known = (taken >= 0) & (taken < self._choices)
        if not is_known.all():
            world = int(np.argmin(is_known))
            raise InputError(f"world {world}: action = {taken[world]}; 0 to {self._choices - 1} is needed")
        starting, going = np.flatnonzero(self._is_over).tolist(), np.flatnonzero(~self._is_over).tolist()
        if starting:
            self._begin(starting)
        for _ in range(self._stride if going else 0):
            present = self._simulation.present if self._drive else []
            controls = [self._drive(present[world]) for world in going] if self._drive else None
            self._simulation.step(controls, worlds=going)
        before = self._serving.copy()
        self._serving[going] = taken[going]
        observations, rates, infos = self._look()
        rewards = self._rewards(rates, before != self._serving)
        rewards[starting] = 0.0
        last = np.array([frame.frame for frame in self._simulation.present]) + self._stride
        truncated = last >= self._simulation.frames.stop
        truncated[starting] = False
        self._is_over = truncated.copy()
        return (
            observations,
            rewards,
            np.zeros(self.num_envs, dtype=bool),
            truncated,
            _with_masks(infos, np.ones(self.num_envs, dtype=bool)),
        )

    @abstractmethod
    def _look(self) -> Looked:
        """Return what the present frames of all worlds show."""

    def _rewards(self, rates: np.ndarray, has_changed: np.ndarray) -> np.ndarray:
        """Return the rewards of worlds, shape [W]; `has_changed` tells whether another choice serves than before."""
        return rates

    def _snr(self) -> tuple[np.ndarray, dict[str, np.ndarray]]:
        """Return the SNR of every beam, shape [W, peers, beams, subcarriers], and the observations that all have."""
        poses = _Poses(self._simulation.table("poses"))
        own, others = poses.of(self.agent), [poses.of(peer) for peer in self.peers]
        paths = self._simulation.paths(self.link.carrier_hz)
        links = [_links(paths, self.agent, peer, self.num_envs) for peer in self.peers]
        turns = [np.stack([quaternion_to_matrix(pose) for pose in one.turn]) for one in (*others, own)]
        at_peer = np.stack(turns[:-1], axis=1).reshape(-1, 3, 3)
        at_agent = np.repeat(turns[-1], len(self.peers), axis=0)
        snr = self.link.snr_of(paths.take(np.stack(links, axis=1).reshape(-1)), at_peer, at_agent)
        back = conjugate(others[0].turn)
        present = self._simulation.present if self._extra else []
        extras = {
            name: np.stack([take(frame.agents[self.agent]) for frame in present])
            for name, (_, take) in self._extra.items()
        }
        observed = {
            self._state: self._serving.copy(),
            "position": rotate(back, own.place - others[0].place).astype(np.float32),
            "velocity": rotate(back, own.velocity).astype(np.float32),
            **extras,
        }
        return snr.reshape(self.num_envs, len(self.peers), *snr.shape[1:]), observed

    def close_extras(self, **kwargs: Any) -> None:
        """Free the device."""
        self._simulation.close()


class BeamTrackingVector(LiveVectorEnv):
    """`BeamTracking` in several worlds at once: `make_vec` with `vectorization_mode="vector_entry_point"`.

    Examples:
        >>> import gymnasium, mmw.gym
        >>> envs = gymnasium.make_vec(
        ...     "mmw/BeamTracking-v0", num_envs=2, vectorization_mode="vector_entry_point",
        ...     overrides=("frames.count=40", "sensors=[]"), max_start=0,
        ... )
        >>> observations, infos = envs.reset(seed=1)
        >>> _, rewards, *_, infos = envs.step(infos["best_beam"])
        >>> rewards.shape, bool((rewards <= infos["best_reward"]).all())
        ((2,), True)
        >>> envs.close()
    """

    def __init__(
        self,
        num_envs: int,
        config: Source = "quickstart",
        *,
        overrides: tuple[str, ...] = ("frames.count=1000", NO_SENSORS),
        peer: str = "rsu_1",
        frames_per_step: int = 10,
        **options: Unpack[VectorOptions],
    ) -> None:
        """Make the simulation.

        Args:
            num_envs: Worlds.
            config: Configuration, as for `mmw.BatchedSimulation`.
            overrides: `key=value` that change it.
            peer: Transmitter.
            frames_per_step: Frames of 10 ms from one decision to the next.
            options: What all vector environments have, see `VectorOptions`.

        Raises:
            InputError: If the configuration cannot be stepped, is too short, or has no such agents.
        """
        super().__init__(
            num_envs, config, overrides=overrides, peers=(peer,), frames_per_step=frames_per_step, choices=None,
            state="beam", **options,
        )  # fmt: skip

    def _look(self) -> Looked:
        snr, observed = self._snr()
        served = serve(self.link, snr[:, 0], self._serving)
        infos = {"best_beam": served.best, "best_reward": served.best_rate}
        return {**observed, "snr_db": served.snr_db}, served.rate.copy(), infos


class HandoverVector(LiveVectorEnv):
    """`Handover` in several worlds at once: `make_vec` with `vectorization_mode="vector_entry_point"`."""

    def __init__(
        self,
        num_envs: int,
        config: Source = "quickstart",
        *,
        overrides: tuple[str, ...] = TWO_STATIONS,
        peers: tuple[str, ...] = ("rsu_1", "rsu_2"),
        interruption_s: float = 0.05,
        frames_per_step: int = 10,
        **options: Unpack[VectorOptions],
    ) -> None:
        """Make the simulation; arguments that are not here are those of `BeamTrackingVector`.

        Args:
            num_envs: Worlds.
            config: Configuration, as for `mmw.BatchedSimulation`.
            overrides: `key=value` that change it.
            peers: Transmitters, two or more.
            interruption_s: Time without link after a change of station [s], at most a step.
            frames_per_step: Frames of 10 ms from one decision to the next.
            options: What all vector environments have, see `VectorOptions`.

        Raises:
            InputError: If the configuration cannot be stepped, is too short, or has no such agents.
        """
        check_stations(peers)
        self._lost = lost_share(interruption_s, frames_per_step)
        super().__init__(
            num_envs, config, overrides=overrides, peers=tuple(peers), frames_per_step=frames_per_step,
            choices=len(peers), state="serving", **options,
        )  # fmt: skip

    def _rewards(self, rates: np.ndarray, has_changed: np.ndarray) -> np.ndarray:
        return np.where(has_changed, 1.0 - self._lost, 1.0) * rates

    def _look(self) -> Looked:
        snr, observed = self._snr()
        snr_db, rates = best_beams(self.link, snr)
        best, world = rates.argmax(axis=1), np.arange(self.num_envs)
        infos = {"best_peer": best, "best_reward": rates[world, best]}
        return {**observed, "snr_db": snr_db}, rates[world, self._serving], infos


class _Motion:
    """Places [m], turns to the world and velocities [m/s] of one agent in all worlds, shape [W, 3], [W, 4], [W, 3]."""

    def __init__(self, place: np.ndarray, turn: np.ndarray, velocity: np.ndarray) -> None:
        self.place, self.turn, self.velocity = place, turn, velocity


class _Poses:
    """Table `poses` of all worlds."""

    def __init__(self, table: pa.Table) -> None:
        self._agent = np.array(table.column("agent").to_pylist())
        names = ("x", "y", "z", "qx", "qy", "qz", "qw", "vx", "vy", "vz")
        self._values = np.stack([table.column(name).to_numpy() for name in names], axis=1)

    def of(self, agent: str) -> _Motion:
        """Return the motion of an agent, which is in every world; rows are ordered by world."""
        rows = self._values[self._agent == agent]
        return _Motion(rows[:, :3], rows[:, 3:7], rows[:, 7:])


def _links(paths: CarrierPaths, agent: str, peer: str, worlds: int) -> np.ndarray:
    """Return the link from a peer to an agent in every world, shape [W].

    Raises:
        InputError: If a world has none.
    """
    keys = paths.keys
    found = np.flatnonzero((keys["agent"] == agent) & (keys["peer"] == peer))
    found = found[np.argsort(keys["frame"][found], kind="stable")]
    if not np.array_equal(keys["frame"][found], np.arange(worlds)):
        raise InputError(f"link from {peer!r} to {agent!r}: not every world has one; name agents of channel.links")
    return found


def _with_masks(infos: Mapping[str, np.ndarray], mask: np.ndarray) -> dict[str, Any]:
    """Return entries of `info` as a vector environment gives them, with the worlds that have them."""
    return {**infos, **{f"_{name}": mask.copy() for name in infos}}
