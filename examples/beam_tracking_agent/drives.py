"""Drives of `mmw/BeamTracking-v0`, traced once: no beam moves a vehicle, so all methods and epochs can share them."""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mmw.core.extras import needed_by

with needed_by("examples.beam_tracking_agent"):
    import gymnasium

import mmw.gym  # noqa: F401  (registers the environment)
from mmw.gym.live_env import motion_from

CONFIG, PEER = "town10_crossroad", "rsu_1"
TRAFFIC = "scenarios.town10_crossroad.traffic"
OVERRIDES = (
    "sensors=[]",
    "channel.carriers_hz=[28e9]",
    "channel.candidates=exhaustive",
    "channel.antennas=[{mount: {cav: {position_m: [0, 0, 1.6]}, rsu: {position_m: [0, 0, 2.5]}}}]",
    f"{TRAFFIC}.cav_models=[sedan, sedan, sedan]",
    f"{TRAFFIC}.models=[sedan, city_bus, box_truck]",
)
"""Antennas on the roofs of cars and on a low pole, so that buses and trucks block them. Design values."""

STEP_S = 0.1
"""Time from one decision to the next, `frames_per_step` of the environment [s]."""


class Drive(NamedTuple):
    """Frames of a vehicle, one a step of the environment (100 ms); arrays are float32."""

    rates: np.ndarray
    """Spectral efficiency of every beam [bit/s/Hz], shape [T, beams]."""
    snr_db: np.ndarray
    """SNR of every beam [dB], shape [T, beams]."""
    position: np.ndarray
    """Place in the axes of the station [m], shape [T, 3]."""
    velocity: np.ndarray
    """Velocity in the axes of the station [m/s], shape [T, 3]."""

    def observe(self, t: int, beam: int) -> dict[str, Any]:
        """Return the observation of `BeamTracking` in frame t, which a beam served."""
        return {
            "beam": np.int64(beam),
            "snr_db": self.snr_db[t, beam : beam + 1],
            "position": self.position[t],
            "velocity": self.velocity[t],
        }


def make_environment(frames: int, device: str = "auto") -> gymnasium.Env:
    """Return the environment, whose episodes begin with the first of so many frames of 10 ms."""
    overrides = (*OVERRIDES, f"frames.count={frames}")
    return gymnasium.make("mmw/BeamTracking-v0", config=CONFIG, overrides=overrides, max_start=0, device=device)


def record(env: gymnasium.Env, seed: int) -> list[Drive]:
    """Step through an episode of a traffic seed, and return what each connected vehicle meets."""
    own: Any = env.unwrapped
    env.reset(options={"traffic_seed": seed})
    rows: dict[str, list] = {name: [] for name, agent in own.frame.agents.items() if agent.role == "cav"}
    is_over = False
    while True:
        for name, seen in rows.items():
            snr = own.link.snr(own.frame, name, (PEER,))[0]
            place = motion_from(own.frame, name, PEER)
            rates = own.link.spectral_efficiency(snr)
            seen.append((rates, own.link.snr_db(snr), place["position"], place["velocity"]))
        if is_over:
            break
        is_over = env.step(np.int64(0))[3]
    return [Drive(*(np.array(part, np.float32) for part in zip(*seen, strict=True))) for seen in rows.values()]


def read_drives(seeds: Sequence[int], frames: int, folder: Path) -> list[list[Drive]]:
    """Return the drives of each traffic seed; what the folder does not have is traced now and kept there."""
    folder.mkdir(parents=True, exist_ok=True)
    files = {seed: folder / f"{CONFIG}_{frames}_{seed}.npz" for seed in seeds}
    missing = [seed for seed, file in files.items() if not file.is_file()]
    if missing:
        env, began, used = make_environment(frames), time.perf_counter(), time.process_time()
        steps = 0
        for seed in missing:
            drives = record(env, seed)
            steps += sum(len(drive.rates) - 1 for drive in drives)
            np.savez(files[seed], *(part for drive in drives for part in drive))
        env.close()
        spent, used = time.perf_counter() - began, time.process_time() - used
        print(f"{len(missing)} traffic seeds, {steps} steps of vehicles traced in {spent:.0f} s (CPU {used:.0f} s)")
    parts = [list(np.load(file).values()) for file in files.values()]
    return [[Drive(*one[i : i + 4]) for i in range(0, len(one), 4)] for one in parts]


def features(observation: dict[str, Any], beams: int) -> np.ndarray:
    """Return the observation as numbers near 1 for a neural network, float32, shape [beams + 20].

    A beam of a linear array along y is best for a range of its electrical angle pi sin(azimuth), a 64th of a turn wide;
    sines and cosines of its multiples make that easy to learn.
    """
    place, beam = observation["position"], np.zeros(beams)
    beam[observation["beam"]] = 1.0
    away = np.linalg.norm(place)
    angles = np.pi * place[1] / away * 2.0 ** np.arange(6)
    state = (observation["snr_db"] / 20.0, [away / 50.0], place / away, observation["velocity"] / 10.0)
    return np.concatenate([beam, *state, np.cos(angles), np.sin(angles)]).astype(np.float32)


class Replay(gymnasium.Env[np.ndarray, np.int64]):
    """`BeamTracking` on recorded drives: each episode is a part of a random one, and begins with a random beam.

    Observations are `features`.
    """

    def __init__(self, drives: Sequence[Drive], steps: int) -> None:
        """Take drives and the steps of an episode."""
        self.drives, self.steps = drives, steps
        self.beams = drives[0].rates.shape[1]
        seen = features(drives[0].observe(0, 0), self.beams)
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, seen.shape, np.float32)
        self.action_space = gymnasium.spaces.Discrete(self.beams)
        self.drive, self.t, self.stop = drives[0], 0, 0

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[np.ndarray, dict]:
        """Begin an episode; see `gymnasium.Env.reset`."""
        super().reset(seed=seed)
        self.drive = self.drives[self.np_random.integers(len(self.drives))]
        self.t = int(self.np_random.integers(len(self.drive.rates) - self.steps))
        self.stop = self.t + self.steps
        return features(self.drive.observe(self.t, int(self.np_random.integers(self.beams))), self.beams), {}

    def step(self, action: np.int64) -> tuple[np.ndarray, float, bool, bool, dict]:
        """Serve the next frame with a beam; see `gymnasium.Env.step`."""
        self.t += 1
        seen = features(self.drive.observe(self.t, int(action)), self.beams)
        return seen, float(self.drive.rates[self.t, int(action)]), False, self.t == self.stop, {}
