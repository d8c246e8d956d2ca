"""Choose which of several stations serves a vehicle, where a change interrupts the link."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces

from mmw.config.load import Source
from mmw.core.constants import FRAME_DT
from mmw.core.errors import InputError
from mmw.dataset.frame import Frame
from mmw.gym.link_rate import RadioLink
from mmw.gym.live_env import NO_SENSORS, Extra, LiveEnv
from mmw.traffic.live.control import Control

STATIONS = (
    "{name: rsu_1, position_m: [14.0, -30.5, 0.14], yaw_deg: 115}",
    "{name: rsu_2, position_m: [-30.0, 14.0, 0.14], yaw_deg: -25}",
)
"""Stations of the default scenario: the one of the quickstart, and another one across the roundabout."""


TWO_STATIONS = (
    "frames.count=1000",
    NO_SENSORS,
    f"scenarios.town03_roundabout.rsus=[{', '.join(STATIONS)}]",
)
"""Overrides that make the default scenario."""


class Handover(LiveEnv):
    """Choose the station that serves in the next step; each uses the best beam of its codebook.

    Action: a station, by its place in `peers`. The reward is its spectral efficiency in the frame after the step
    [bit/s/Hz], times the share of the step that the link is up: a change of station interrupts it.

    Observation: `serving`, the station that served; `snr_db` of the best beam of every station [dB], shape [peers];
    `position`, `velocity` of the vehicle in the axes of the first station [m], [m/s]; and what `extra` adds.

    `info`: `best_peer` and `best_reward`, of the strongest station without interruption.
    """

    def __init__(
        self,
        config: Source = "quickstart",
        *,
        overrides: tuple[str, ...] = TWO_STATIONS,
        agent: str = "cav_1",
        peers: tuple[str, ...] = ("rsu_1", "rsu_2"),
        link: RadioLink | None = None,
        interruption_s: float = 0.05,
        frames_per_step: int = 10,
        max_start: int = 20,
        device: str = "auto",
        extra: Mapping[str, Extra] | None = None,
        drive: Callable[[Frame], Mapping[str, Control | None]] | None = None,
    ) -> None:
        """Make the simulation; arguments that are not here are those of `BeamTracking`.

        Args:
            config: Configuration, as for `mmw.Simulation`.
            overrides: `key=value` that change it.
            agent: Receiver.
            peers: Transmitters, two or more.
            link: Radio of every station; the default one if None.
            interruption_s: Time without link after a change of station [s], at most a step; design value, between the
                0 and 60 ms of 3GPP TS 38.133.
            frames_per_step: Frames of 10 ms from one decision to the next.
            max_start: An episode begins up to so many steps after the first frame.
            device: As for `mmw.Simulation`.
            extra: Further observations.
            drive: Frame -> controls of vehicles in it.

        Raises:
            InputError: If the configuration cannot be stepped, is too short, or has no such agents.
        """
        self.link = RadioLink() if link is None else link
        check_stations(peers)
        self._lost = lost_share(interruption_s, frames_per_step)
        super().__init__(
            config,
            overrides=overrides,
            agent=agent,
            peers=tuple(peers),
            frames_per_step=frames_per_step,
            max_start=max_start,
            device=device,
            extra=extra,
            drive=drive,
            state={"serving": spaces.Discrete(len(peers))},
        )
        self.action_space = spaces.Discrete(len(peers))
        self._serving = 0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[dict[str, Any], dict[str, Any]]:
        """Begin an episode with a random station; see `gymnasium.Env.reset`."""
        self._start(seed, options)
        self._serving = int(self.np_random.integers(len(self.peers)))
        observation, _, info = self._look()
        return observation, info

    def step(self, action: np.int64) -> tuple[dict[str, Any], float, bool, bool, dict[str, Any]]:
        """Serve the next step by a station; see `gymnasium.Env.step`.

        Raises:
            InputError: If there is no such station, or the episode is over.
        """
        if not self.action_space.contains(action):
            raise InputError(f"action = {action!r}; a station from 0 to {len(self.peers) - 1} is needed")
        is_over = self._advance()
        share = 1.0 if int(action) == self._serving else 1.0 - self._lost
        self._serving = int(action)
        observation, rate, info = self._look()
        return observation, share * rate, False, is_over, info

    def _look(self) -> tuple[dict[str, Any], float, dict[str, Any]]:
        snr_db, rates = best_beams(self.link, self.link.snr(self.frame, self.agent, self.peers))
        best = int(np.argmax(rates))
        observation = {
            "serving": np.int64(self._serving),
            "snr_db": snr_db,
            **self._motion(self.peers[0]),
            **self._extras(),
        }
        return observation, float(rates[self._serving]), {"best_peer": best, "best_reward": float(rates[best])}


def best_beams(link: RadioLink, snr: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return SNR [dB], float32, and spectral efficiency [bit/s/Hz] of the best beam of each station.

    Args:
        link: Radio of the stations.
        snr: SNRs, shape [..., beams, subcarriers].
    """
    return link.snr_db(snr).max(axis=-1).astype(np.float32), link.spectral_efficiency(snr).max(axis=-1)


def lost_share(interruption_s: float, frames_per_step: int) -> float:
    """Return the share of a step that a change of station interrupts.

    Raises:
        InputError: If the interruption is negative or longer than a step.
    """
    step_s = frames_per_step * FRAME_DT
    if not 0.0 <= interruption_s <= step_s:
        raise InputError(f"interruption_s = {interruption_s}; 0 to one step, {step_s:g} s, is needed")
    return interruption_s / step_s


def check_stations(peers: Sequence[str]) -> None:
    """Check that there are two or more different stations.

    Raises:
        InputError: If there are not.
    """
    if len(set(peers)) != len(peers) or len(peers) < 2:
        raise InputError(f"peers = {peers}: two or more different stations are needed")
