"""Track the best beam of a roadside unit towards a vehicle, without searching all of them."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
from gymnasium import spaces

from mmw.config.load import Source
from mmw.core.errors import InputError
from mmw.dataset.frame import Frame
from mmw.gym.link_rate import RadioLink
from mmw.gym.live_env import NO_SENSORS, Extra, LiveEnv
from mmw.traffic.live.control import Control


class BeamTracking(LiveEnv):
    """Choose the transmit beam for the next step from the present one.

    Action: a beam. It serves the frame after the step, and the reward is its spectral efficiency there [bit/s/Hz].

    Observation, all of the present frame:

    - `beam`: the beam that served;
    - `snr_db`: the SNR that it had [dB], shape [1];
    - `position`, `velocity`: of the vehicle in the axes of the station [m], [m/s], shape [3] each;
    - what `extra` adds, such as an image of a camera.

    `info`: `best_beam` and `best_reward`, those of an exhaustive search in the same frame.

    Examples:
        >>> import gymnasium, mmw.gym
        >>> env = gymnasium.make("mmw/BeamTracking-v0", overrides=("frames.count=40", "sensors=[]"), max_start=0)
        >>> observation, info = env.reset(seed=1)
        >>> _, reward, *_, info = env.step(info["best_beam"])
        >>> bool(0.0 < reward <= info["best_reward"])
        True
        >>> env.close()
    """

    def __init__(
        self,
        config: Source = "quickstart",
        *,
        overrides: tuple[str, ...] = ("frames.count=1000", NO_SENSORS),
        agent: str = "cav_1",
        peer: str = "rsu_1",
        link: RadioLink | None = None,
        frames_per_step: int = 10,
        max_start: int = 20,
        device: str = "auto",
        extra: Mapping[str, Extra] | None = None,
        drive: Callable[[Frame], Mapping[str, Control | None]] | None = None,
    ) -> None:
        """Make the simulation.

        Args:
            config: Configuration, as for `mmw.Simulation`.
            overrides: `key=value` that change it.
            agent: Receiver.
            peer: Transmitter.
            link: Radio; the default one if None.
            frames_per_step: Frames of 10 ms from one decision to the next.
            max_start: An episode begins up to so many steps after the first frame.
            device: As for `mmw.Simulation`.
            extra: Name -> space and function of further observations of the agent, such as
                `{"image": (Box(0, 255, (48, 64, 3), np.uint8), lambda agent: agent.sensor("front").rgb)}`.
            drive: Frame -> controls of vehicles in it; without, all have their drivers.

        Raises:
            InputError: If the configuration cannot be stepped, is too short, or has no such agents.
        """
        self.link = RadioLink() if link is None else link
        super().__init__(
            config,
            overrides=overrides,
            agent=agent,
            peers=(peer,),
            frames_per_step=frames_per_step,
            max_start=max_start,
            device=device,
            extra=extra,
            drive=drive,
            state={"beam": spaces.Discrete(self.link.beam_count)},
        )
        self.action_space = spaces.Discrete(self.link.beam_count)
        self._beam = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin an episode with a random beam; see `gymnasium.Env.reset`."""
        self._start(seed, options)
        self._beam = int(self.np_random.integers(self.link.beam_count))
        observation, _, info = self._look()
        return observation, info

    def step(self, action: np.int64) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Serve the next step with a beam; see `gymnasium.Env.step`.

        Raises:
            InputError: If there is no such beam, or the episode is over.
        """
        if not self.action_space.contains(action):
            raise InputError(f"action = {action!r}; a beam from 0 to {self.link.beam_count - 1} is needed")
        is_over = self._advance()
        self._beam = int(action)
        observation, reward, info = self._look()
        return observation, reward, False, is_over, info

    def _look(self) -> tuple[dict[str, Any], float, dict[str, Any]]:
        snr = self.link.snr(self.frame, self.agent, self.peers)
        served = serve(self.link, snr, np.array([self._beam]))
        observation = {
            "beam": np.int64(self._beam),
            "snr_db": served.snr_db[0],
            **self._motion(self.peers[0]),
            **self._extras(),
        }
        info = {"best_beam": int(served.best[0]), "best_reward": float(served.best_rate[0])}
        return observation, float(served.rate[0]), info


class Served(NamedTuple):
    """SNR and spectral efficiency of beams in W worlds."""

    snr_db: np.ndarray
    """SNR of the beam that serves [dB], shape [W, 1], float32."""
    rate: np.ndarray
    """Its spectral efficiency [bit/s/Hz], shape [W]."""
    best: np.ndarray
    """Best beam, shape [W]."""
    best_rate: np.ndarray
    """Its spectral efficiency [bit/s/Hz], shape [W]."""


def serve(link: RadioLink, snr: np.ndarray, beam: np.ndarray) -> Served:
    """Return what the beams of some worlds give, shape [W], from SNRs of shape [W, beams, subcarriers]."""
    rates, world = link.spectral_efficiency(snr), np.arange(len(snr))
    best = rates.argmax(axis=1)
    snr_db = link.snr_db(snr[world, beam])[:, None].astype(np.float32)
    return Served(snr_db, rates[world, beam], best, rates[world, best])
